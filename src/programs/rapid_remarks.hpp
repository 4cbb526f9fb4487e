#pragma once

// What a RAPID program leaves to run time, and why places stay as they are.

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "programs/program.hpp"

namespace kdl_calibration::rapid {

/// Why a robtarget or jointtarget stays as it is.
enum class Left : std::uint8_t {
  computed,
  untaught,
  no_orientation,
  assigned,
  external,
  unused,
  several_frames,
  unknown_frame,
  stationary,
  moved
};

/// Remarks of one kind are one remark with all its lines.
class Remarks {
public:
  void add(const std::string& what, std::size_t file, std::size_t line) { lines_[{file, what}].push_back(line); }
  void add(Left because, std::size_t file, std::size_t line);
  /// For an instruction, an option or a function that acts at run time, by its name in lower case. False for others.
  bool add_instruction(std::string_view name, std::size_t file, std::size_t line);
  bool add_option(std::string_view name, std::size_t file, std::size_t line);
  bool add_offset(std::string_view name, std::size_t file, std::size_t line);
  /// For a motion whose end is known at run time only; `subject` begins the sentence.
  void add_unknown(std::string_view subject, std::size_t file, std::size_t line);

  std::vector<ProgramRemark> all() const;

private:
  std::map<std::pair<std::size_t, std::string>, std::vector<std::size_t>> lines_;
};

/// Names of the instructions of Remarks::add_instruction.
std::set<std::string, std::less<>> run_time_instructions();

}  // namespace kdl_calibration::rapid
