#pragma once

// One model of the robot programs of all languages: text in, points and motions out, and the same text with other
// numbers.

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "programs/arm_branch.hpp"

namespace kdl_calibration {

/// A file of a program. KRL keeps the motions of a program in one and its points in another.
struct ProgramText {
  std::string source;  ///< file name, for messages
  std::string text;
};

/// A number of a text; its bytes may be replaced.
struct NumberField {
  std::size_t begin = 0;
  std::size_t end = 0;
  double value = 0.0;
  int decimals = 3;  ///< with which a new value is written
};

/// What the numbers of a point are.
enum class PointNotation : std::uint8_t {
  joints,           ///< values of the controller's joints
  fixed_xyz,        ///< x y z and angles about the fixed axes x, y, z: FANUC's W P R
  moving_zyx,       ///< x y z and angles about the moving axes z, y, x: KUKA's A B C
  quaternion,       ///< x y z and w x y z of a unit quaternion: ABB
  rotation_vector,  ///< x y z and axis times angle: UR
};

/// The value of an external axis at a point.
struct ExternalValue {
  int axis = 0;  ///< E1 to E6: 1 to 6
  double value = 0.0;
  std::optional<bool> is_length;  ///< true: [mm], false: [deg]; none where the text does not say it
};

/// A taught place of the arm: joint values, or a pose of a tool frame in a user frame.
struct ProgramPoint {
  std::string name;      ///< as the language writes it: "P[3]", "p10"; in messages
  std::size_t file = 0;  ///< index of the text
  std::size_t line = 0;
  PointNotation notation = PointNotation::joints;
  std::vector<NumberField> fields;        ///< 6, or 7 with a quaternion
  std::optional<std::string> user_frame;  ///< of a pose: key into ProgramFrames; none where the text does not say it
  std::optional<std::string> tool_frame;
  std::optional<ArmBranch> branch;       ///< of a pose; none: the controller takes the solution next to where it is
  std::vector<NumberField> turn_fields;  ///< numbers that follow the joint values: ProgramLanguage::turns; or empty
  std::optional<SixJoints> near;         ///< joint values [rad] near the pose that the text states beside it
  std::vector<ExternalValue> external;   ///< in the order of the text
};

/// A motion instruction, or one half of a circular one.
struct ProgramMotion {
  std::size_t file = 0;
  std::size_t line = 0;
  bool is_straight = false;          ///< the tool moves along a path; else the joints move
  bool is_curved = false;            ///< that path is a circle or a spline
  std::optional<std::size_t> point;  ///< index of its end; none where that is known at run time only
  bool is_known = true;              ///< ends in its point, on a path that the program states
};

/// A fact that a user has to know, and the lines to which it applies, in order.
struct ProgramRemark {
  std::string what;
  std::vector<std::size_t> lines;
  std::size_t file = 0;
};

/// User frames in the controller's world frame, tool frames in the faceplate's, by their name in the language.
struct ProgramFrames {
  std::map<std::string, Eigen::Isometry3d> user;
  std::map<std::string, Eigen::Isometry3d> tool;
  std::set<std::string> moving_user;     ///< user frames that the robot holds, or that something else moves
  std::set<std::string> standing_tools;  ///< tools that stand in the cell
};

struct Program {
  std::vector<ProgramPoint> points;    ///< those to compensate: taught, and places of the arm's own tool
  std::vector<ProgramMotion> motions;  ///< in the order of the text
  std::vector<ProgramRemark> remarks;  ///< what the controller decides at run time, and points that are left out
  ProgramFrames frames;                ///< those that the program itself states, with the language's zero frames
};

/// A configuration to drive to, and to wait in until it is measured.
struct MeasuringStop {
  std::string label;                   ///< without quotes and line ends
  std::array<double, 6> joint_values;  ///< of the controller, in the language's unit of angles
};

/// How a language writes programs. One file per language defines it; program_language.cpp lists them.
struct ProgramLanguage {
  std::string_view name;   ///< "FANUC LS"
  std::string_view files;  ///< such as ".LS"
  /// Whether the text is written in this language. Exactly one language answers yes to a text of one.
  bool (*is_written_in)(std::string_view text);
  /// Throws InputError with file and line.
  Program (*parse)(const std::vector<ProgramText>& texts);
  /// User and tool frames of a file of the controller. Throws InputError.
  ProgramFrames (*read_frames)(std::string_view text, const std::string& source);
  /// Extension of a file with the same stem that belongs to a program, such as ".dat"; empty if there is none.
  std::string_view companion;
  /// Its controllers count joints in another way than URDFs do: a description of the controller is needed.
  bool needs_description = false;
  std::array<std::string_view, 6> joint_names;
  double length_unit;               ///< [m]
  double angle_unit;                ///< [rad]
  std::array<double, 6> reference;  ///< the controller's joint values [rad] in front, elbow up: see ArmBranch
  std::string_view user_frame;      ///< in messages: "UF"
  std::string_view tool_frame;
  /// The numbers of ProgramPoint::turn_fields for these values of the controller's joints [rad]; may be null.
  std::vector<int> (*turns)(const SixJoints& joint_values);
  /// The bytes of a new value in place of `old`.
  std::string (*write)(std::string_view old, double value, int decimals);
  /// A program of slow joint motions that stops at each configuration until the operator goes on. `name`: letters,
  /// digits and underscores.
  std::string (*drive)(const std::string& name, const std::vector<MeasuringStop>& stops);
};

}  // namespace kdl_calibration
