#pragma once

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "results/result_json.hpp"
#include "results/saved_calibration.hpp"

namespace kdl_calibration::cli {

/// Accepts finite numbers between the bounds; `expected` completes the message ("a length in metres, 0 or more").
CLI::Validator number_between(double lower, double upper, const std::string& expected);
CLI::Validator number_from(double lower, const std::string& expected);
CLI::Validator whole_number_between(long lower, long upper, const std::string& expected);
CLI::Validator not_empty(const std::string& expected);
/// Accepts one of these words.
CLI::Validator one_of(const std::vector<std::string>& words);

/// Adds an option for a list, separated by commas or given repeatedly. Items must not be empty and must pass `check`.
CLI::Option* add_list(CLI::App& app, const std::string& name, std::vector<std::string>& values, const std::string& help,
                      const CLI::Validator& check = {});
/// The same for numbers, which may also be separate words.
CLI::Option* add_list(CLI::App& app, const std::string& name, std::vector<double>& values, const std::string& help,
                      const CLI::Validator& check);

/// Adds an option for a file name.
CLI::Option* add_file(CLI::App& app, const std::string& name, std::string& file, const std::string& help);
/// --temperature, of all links or of one, and --payload: at which the calibrated arm is taken.
void add_circumstances(CLI::App& app, Circumstances& circumstances);
/// The calibration there. Warns if it is less certain there, in the middle of the measured joint values, than at any
/// configuration that was left out.
Calibration at_circumstances(const Calibration& found, const Circumstances& circumstances);
/// --report
CLI::Option* add_report_file(CLI::App& app, std::string& report);
/// --json
void add_json_flag(CLI::App& app, bool& json);
/// Adds an example command to the end of the help.
void add_example(CLI::App& app, const std::string& command);
/// Adds an option for one of `words`.
CLI::Option* add_word(CLI::App& app, const std::string& name, std::string& value, const std::vector<std::string>& words,
                      const std::string& help);
/// --orientation, a word of orientation_words()
CLI::Option* add_orientation(CLI::App& app, std::string& orientation);
/// Restricts the option to whole numbers within `range`.
CLI::Option* limit_count(CLI::Option* option, std::pair<int, int> range);
/// Adds an option for a whole number within `range`; help shows the default.
CLI::Option* add_count(CLI::App& app, const std::string& name, int& value, std::pair<int, int> range,
                       const std::string& help);
/// --seed
void add_seed(CLI::App& app, std::uint64_t& seed);

/// The groups named by --effects, each at most once; `others` are words that are not groups and must stand alone.
std::vector<EffectGroup> effect_groups(const std::vector<std::string>& words, const std::vector<std::string>& others);

/// Keys and values of texts key=value. Throws InputError for other texts and for a key that is given twice.
std::vector<std::pair<std::string, std::string>> keys_and_values(const std::string& option,
                                                                 const std::vector<std::string>& texts);
/// Those of --note.
std::vector<std::pair<std::string, std::string>> notes_of(const std::vector<std::string>& texts);

/// --urdf, --dh, --base, --tip
struct RobotArguments {
  std::string urdf = {};  ///< empty: the bundled robot, or that of `dh`
  std::string dh = {};    ///< a DH table
  std::string base = {};
  std::string tip = {};
};
void add_robot_options(CLI::App& app, RobotArguments& arguments);
Robot load(const RobotArguments& arguments);
/// Role and name of each file that a command reads; empty names are left out.
using FileRoles = std::vector<std::pair<std::string, std::string>>;
/// The file of the robot (role "urdf" or "dh") and these files, with their hashes.
std::vector<HashedFile> hashed_files(const RobotArguments& arguments, const Robot& robot, const FileRoles& files);

/// --joints, --degrees, --joint-convention
struct JointArguments {
  std::vector<std::string> joints;
  std::string joint_convention;
  bool degrees = false;
  std::string option = "--joints";  // that states them
};
void add_joint_options(CLI::App& app, JointArguments& arguments);
/// Whether the joint value with this index (the controller's if there is a convention) is a length. A convention maps
/// angles to angles and lengths to lengths, so a controller's value is a length if all joints that depend on it are
/// prismatic.
bool value_is_length(const Robot& robot, const JointConvention* convention, Eigen::Index value);
/// The convention in the order of the robot's joints; none if there is none or if it names others, as for an arm on a
/// rail.
std::optional<JointConvention> fitting_convention(const std::optional<JointConvention>& convention, const Robot& robot);
/// The URDF's values of all joints [rad] or [m]; warns of values outside the limits.
Eigen::VectorXd joint_values(const Robot& robot, const JointArguments& arguments);
/// The same in this convention, for the robot's joints in their order, whatever the arguments name.
Eigen::VectorXd joint_values(const Robot& robot, const JointArguments& arguments,
                             const std::optional<JointConvention>& convention);

/// The joint convention in a file; empty if `file` is. With a robot its columns are in the order of the URDF's joints.
std::optional<JointConvention> convention_of(const std::string& file);
std::optional<JointConvention> convention_of(const std::string& file, const Robot& robot);
/// Configurations of a file, each once, in its order. `joint_convention`: a file as well, for controller's joint
/// values.
Measurements configurations_of(const Robot& robot, const std::string& file, const std::string& joint_convention);

/// Options for an arm, nominal or calibrated, at joint values: those above, --result and --json.
struct ArmAtJoints {
  RobotArguments robot;
  JointArguments joints;
  std::string result;
  bool json = false;
};
void add_arm_at_joints(CLI::App& app, ArmAtJoints& arguments);
/// Warns if a result that was read is not to be trusted.
void warn_if_doubted(const std::string& file, Verdict verdict, const std::vector<Doubt>& doubts);
/// Reads the file of --result; warns if the result is not to be trusted.
CalibrationParts read_result(const std::string& file, const Robot& robot);

}  // namespace kdl_calibration::cli
