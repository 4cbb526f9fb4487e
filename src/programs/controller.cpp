#include "programs/controller.hpp"

#include <fmt/core.h>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>
#include <string>
#include <string_view>

#include "base/csv.hpp"
#include "base/degree.hpp"
#include "base/json_tree.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/urdf_correction.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;

Isometry3d frame_in(const tree::Node& node) {
  Isometry3d frame = Isometry3d::Identity();
  frame.translation() = tree::numbers<3>(tree::member(node, "position"));
  frame.linear() = tree::quaternion(tree::member(node, "quaternion_wxyz")).toRotationMatrix();
  return frame;
}

tree::Json parsed_file(const std::filesystem::path& file) { return tree::parsed(read_text_file(file), file.string()); }

std::map<int, Isometry3d> frames_in(const tree::Node& node) {
  std::map<int, Isometry3d> frames;
  for (const auto& [key, value] : node.json.items()) {
    int number = 0;
    const auto result = std::from_chars(key.data(), key.data() + key.size(), number);
    if (result.ptr != key.data() + key.size() || number < 1) {
      tree::fail(node, "numbers of frames as keys, 1 or above");
    }
    frames[number] = frame_in({value, node.where + "." + key});
  }
  return frames;
}

NumberedFrames frames_of_json(const std::filesystem::path& file) {
  const tree::Json json = parsed_file(file);
  const tree::Node top{json, file.string()};
  NumberedFrames frames;
  for (const auto& [key, kind] : {std::pair{"user_frames", &frames.user}, std::pair{"tool_frames", &frames.tool}}) {
    if (tree::has(top, key)) {
      *kind = frames_in(tree::member(top, key));
    }
  }
  if (frames.user.empty() && frames.tool.empty()) {
    tree::fail(top, "frames in user_frames or tool_frames");
  }
  return frames;
}

// Reads the variables $MNUFRAME and $MNUTOOL: arrays by motion group and number of positions such as
//     [1,2] =
//   Group: 1   Config: N D B, 0, 0, 0
//   X:  1500.000   Y:     0.000   Z:   300.000
//   W:     0.000   P:     0.000   R:    90.000
class SystemFrameReader {
public:
  explicit SystemFrameReader(LineReader& lines) : lines_(lines) {}

  NumberedFrames read() {
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
        variable_->insert_or_assign(*number_, frame_of_xyzwpr(xyzwpr_));
        number_.reset();
      }
    }
  }

  LineReader& lines_;
  NumberedFrames frames_;
  std::map<int, Isometry3d>* variable_ = nullptr;
  bool found_ = false;
  std::optional<int> number_;  // of the frame whose values come next
  std::size_t next_ = 0;
  Eigen::Matrix<double, 6, 1> xyzwpr_;
};

}  // namespace

Controller read_controller(const std::filesystem::path& file) {
  const tree::Json json = parsed_file(file);
  const tree::Node top{json, file.string()};
  const std::filesystem::path convention = tree::name(tree::member(top, "joint_convention"));
  return {.convention = read_joint_convention(file.parent_path() / convention),
          .X_BW = frame_in(tree::member(top, "world_in_base")),
          .X_FP = frame_in(tree::member(top, "faceplate_in_flange")),
          .frames = {}};
}

NumberedFrames read_numbered_frames(const std::filesystem::path& file) {
  if (file.extension() == ".json") {
    return frames_of_json(file);
  }
  return parse_system_frames(read_text_file(file), file.string());
}

NumberedFrames parse_system_frames(std::string_view text, const std::string& source) {
  LineReader lines(text, source);
  return SystemFrameReader(lines).read();
}

Isometry3d frame_of_xyzwpr(const Eigen::Matrix<double, 6, 1>& xyzwpr) {
  Isometry3d frame = Isometry3d::Identity();
  frame.translation() = xyzwpr.head<3>();
  frame.linear() =
      (Eigen::AngleAxisd(xyzwpr[5], Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(xyzwpr[4], Eigen::Vector3d::UnitY()) *
       Eigen::AngleAxisd(xyzwpr[3], Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  return frame;
}

Eigen::Matrix<double, 6, 1> xyzwpr_of(const Isometry3d& frame, const Eigen::Matrix<double, 6, 1>& old) {
  constexpr double kLocked = 1e-5;  // half of what 0.001 degrees are
  const std::array<double, 3> wpr = rpy_of(to_kdl(frame).M, {old[3], old[4], old[5]}, kLocked);
  Eigen::Matrix<double, 6, 1> result;
  result << frame.translation(), wpr[0], wpr[1], wpr[2];
  return result;
}

}  // namespace kdl_calibration
