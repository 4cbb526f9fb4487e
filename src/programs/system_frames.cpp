#include "programs/system_frames.hpp"

#include <fmt/core.h>
#include <charconv>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "base/csv.hpp"
#include "base/degree.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/pose_numbers.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;

// Reads the variables $MNUFRAME and $MNUTOOL: arrays by motion group and number of positions such as
//     [1,2] =
//   Group: 1   Config: N D B, 0, 0, 0
//   X:  1500.000   Y:     0.000   Z:   300.000
//   W:     0.000   P:     0.000   R:    90.000
class SystemFrameReader {
public:
  explicit SystemFrameReader(LineReader& lines) : lines_(lines) {}

  ProgramFrames read() {
    for (std::string_view line; lines_.next(line);) {
      line = trimmed(line);
      if (line.find('$') != std::string_view::npos) {
        begin_variable(line);
      } else if (variable_ != nullptr && line.starts_with('[')) {
        begin_frame(line);
      } else if (number_ && !line.starts_with("Group:")) {
        values(line);
      }
    }
    if (!found_) {
      fail(lines_.source(), "holds no $MNUFRAME and no $MNUTOOL, expected SYSFRAME.VA of a controller's backup");
    }
    return frames_;
  }

private:
  void begin_variable(std::string_view line) {
    number_.reset();
    variable_ = nullptr;
    for (const auto& [name, kind] : {std::pair{"$MNUFRAME", &frames_.user}, std::pair{"$MNUTOOL", &frames_.tool}}) {
      const std::size_t at = line.find(name);
      const std::size_t end = at + std::string_view(name).size();
      if (at != std::string_view::npos && (end == line.size() || line[end] == ' ' || line[end] == '\t')) {
        variable_ = kind;
        found_ = true;
      }
    }
  }

  void begin_frame(std::string_view line) {
    int group = 0;
    int number = 0;
    const char* end = line.data() + line.size();
    const auto first = std::from_chars(line.data() + 1, end, group);
    if (first.ec == std::errc() && first.ptr != end && *first.ptr == ',') {
      const auto second = std::from_chars(first.ptr + 1, end, number);
      if (second.ec == std::errc() && second.ptr != end && *second.ptr == ']' && number > 0) {
        number_ = group == 1 ? std::optional(number) : std::nullopt;
        next_ = 0;
        return;
      }
    }
    fail(lines_.place(), "has " + shown(line) + ", expected [group,number] =");
  }

  // Takes the numbers of a line "X: 1.000   Y: ..." in order; stars stand for a frame that is not set.
  void values(std::string_view line) {
    constexpr std::string_view kNames = "XYZWPR";
    while (number_ && !(line = trimmed(line)).empty()) {
      if (line[0] != kNames[next_] || line.substr(1, 1) != ":") {
        fail(lines_.place(), fmt::format("has {}, expected {}: and its value", shown(line), kNames[next_]));
      }
      line = trimmed(line.substr(2));
      if (line.starts_with('*')) {
        number_.reset();
        return;
      }
      double value = 0.0;
      const auto result = std::from_chars(line.data(), line.data() + line.size(), value);
      constexpr double kMost = 1e6;
      if (result.ec != std::errc() || !(std::abs(value) < kMost)) {
        fail(lines_.place(), fmt::format("{} is {}, expected a number", kNames[next_], shown(line)));
      }
      line.remove_prefix(static_cast<std::size_t>(result.ptr - line.data()));
      constexpr double kMillimetre = 1e-3;
      xyzwpr_[static_cast<Eigen::Index>(next_)] = value * (next_ < 3 ? kMillimetre : kDegree);
      if (++next_ == kNames.size()) {
        variable_->insert_or_assign(std::to_string(*number_), frame_of_xyzwpr(xyzwpr_));
        number_.reset();
      }
    }
  }

  LineReader& lines_;
  ProgramFrames frames_;
  std::map<std::string, Isometry3d>* variable_ = nullptr;
  bool found_ = false;
  std::optional<int> number_;  // of the frame whose values come next
  std::size_t next_ = 0;
  Eigen::Matrix<double, 6, 1> xyzwpr_;
};

}  // namespace

ProgramFrames parse_system_frames(std::string_view text, const std::string& source) {
  LineReader lines(text, source);
  return SystemFrameReader(lines).read();
}

}  // namespace kdl_calibration
