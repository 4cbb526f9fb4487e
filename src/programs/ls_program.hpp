#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration {

/// A number of the text with the blanks before it; its bytes may be replaced.
struct NumberField {
  std::size_t begin = 0;
  std::size_t end = 0;
  double value = 0.0;
};

/// CONFIG of a Cartesian position, such as 'N U T, 0, 0, 0'.
struct RobotConfiguration {
  bool flip = false;
  bool elbow_up = true;
  bool front = true;
  std::array<int, 3> turns{};  ///< of J1, J4, J6: turn t covers -180 + 360 t < J <= 180 + 360 t degrees

  bool operator==(const RobotConfiguration&) const = default;
};

/// E1 to E6 of a position.
struct ExternalValue {
  int axis = 0;  ///< 1 to 6
  double value = 0.0;
  bool is_length = false;  ///< [mm], else [deg]
};

/// The first motion group of P[number].
struct ProgramPosition {
  int number = 0;
  std::size_t line = 0;
  std::optional<int> user_frame;  ///< none where the program does not say it
  std::optional<int> tool_frame;
  std::optional<RobotConfiguration> configuration;  ///< of a Cartesian position; none of joint values
  std::array<NumberField, 6> fields;                ///< X Y Z [mm] W P R [deg], or J1 to J6 [deg]
  std::vector<ExternalValue> external;              ///< in the order of the text
};

/// A motion instruction, or one half of a circular one.
struct ProgramMotion {
  std::size_t line = 0;
  bool is_straight = false;     ///< L, C, A or S: the tool moves along a path; else J
  std::optional<int> position;  ///< P[number]
  bool is_increment = false;    ///< INC: the position is a step, no place
  bool is_known = true;         ///< ends in its position, on a path that the program states
};

/// A fact that a user has to know, and the lines to which it applies, in order.
struct ProgramRemark {
  std::string what;
  std::vector<std::size_t> lines;
};

/// A FANUC teach pendant program as text (LS file).
struct LsProgram {
  std::vector<ProgramPosition> positions;  ///< those with a taught group 1 that states the place of the arm's own tool
  std::vector<ProgramMotion> motions;
  std::vector<ProgramRemark> remarks;  ///< what the controller decides at run time, and other positions
};

/// Throws InputError with line and position for a text that is no such program, is cut short or goes on after it, a
/// motion to a position that was not taught ("********"), and a number or a group 1 twice.
LsProgram parse_ls_program(std::string_view text, const std::string& source);

/// `text` with other numbers in these fields, which are in the order of the text. A number whose three decimals stay
/// keeps its bytes.
std::string with_numbers(std::string_view text, const std::vector<NumberField>& fields);

}  // namespace kdl_calibration
