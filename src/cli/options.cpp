#include "cli/options.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <numeric>
#include <optional>

#include "base/degree.hpp"
#include "base/number_range.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "cli/data_dir.hpp"
#include "cli/text.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/kinematic_export.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/orientation_reading.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr double kLimitSlack = 1e-9;  // [rad] or [m] tolerance for rounded values

std::string refused(const std::string& value, const std::string& expected) {
  return "'" + value + "' is not accepted, expected " + expected;
}

// Splits at commas. The parser's own splitting silently drops empty items.
std::vector<std::string> items(const std::string& option, const std::vector<std::string>& texts,
                               const CLI::Validator& check) {
  std::vector<std::string> result;
  for (const std::string& text : texts) {
    for (std::size_t start = 0, end = 0; end != std::string::npos; start = end + 1) {
      end = text.find(',', start);
      const std::string item = text.substr(start, end - start);
      const std::string fault =
          item.empty() ? "'" + text + "' has an empty item, expected a value on both sides of each comma" : check(item);
      if (!fault.empty()) {
        throw CLI::ValidationError(option, fault);
      }
      result.push_back(item);
    }
  }
  return result;
}

Eigen::VectorXd given_values(const Robot& robot, const JointArguments& arguments, const JointConvention* convention) {
  const std::vector<std::string> names =
      convention == nullptr ? independent_joint_names(robot.joints) : convention->controller_joints;
  if (arguments.joints.size() != names.size()) {
    throw InputError(fmt::format("{}: has {} values, expected {}: {}", arguments.option, arguments.joints.size(),
                                 names.size(), comma_separated(names)));
  }
  Eigen::VectorXd values(static_cast<Eigen::Index>(names.size()));
  for (std::size_t i = 0; i < names.size(); ++i) {
    const std::optional<double> value = parsed_number(arguments.joints[i]);
    const auto index = static_cast<Eigen::Index>(i);
    const bool length = value_is_length(robot, convention, index);
    if (!value) {
      const std::string unit = length ? "metres" : arguments.degrees ? "degrees" : "radians";
      throw InputError(arguments.option + ": '" + arguments.joints[i] + "' for " + names[i] +
                       " is no number, expected " + unit);
    }
    if (!(std::abs(*value) <= kLargestNumber)) {
      throw InputError(arguments.option + ": '" + arguments.joints[i] + "' for " + names[i] +
                       " is out of range, expected at most 1e12");
    }
    values[index] = arguments.degrees && !length ? *value * kDegree : *value;
  }
  return values;
}

void warn_outside_limits(const Robot& robot, const Eigen::VectorXd& q) {
  std::vector<std::string> outside;
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    const MovingJoint& joint = robot.joints[i];
    const double value = q[static_cast<Eigen::Index>(i)];
    if (value < joint.lower.value_or(value) - kLimitSlack || value > joint.upper.value_or(value) + kLimitSlack) {
      outside.push_back(joint.name);
    }
  }
  if (!outside.empty()) {
    warn(fmt::format("joint values outside the limits of the URDF ({} of {}): {}", outside.size(), robot.joints.size(),
                     comma_separated(outside)));
  }
}

}  // namespace

CLI::Validator number_between(double lower, double upper, const std::string& expected) {
  return {[=](std::string& value) {
            const std::optional<double> number = parsed_number(value);
            return number && *number >= lower && *number <= upper ? std::string() : refused(value, expected);
          },
          "", "number"};
}

CLI::Validator number_from(double lower, const std::string& expected) {
  return {[=](std::string& value) {
            const std::optional<double> number = parsed_number(value);
            const bool fits = number && *number >= lower && *number <= kLargestNumber;
            const bool negligible = fits && *number != 0.0 && std::abs(*number) < kSmallestSigma;
            return fits && !negligible ? std::string() : refused(value, expected + ", from 1e-15 to 1e12 if not 0");
          },
          "", "number"};
}

CLI::Validator whole_number_between(long lower, long upper, const std::string& expected) {
  return {[=](std::string& value) {
            long number = 0;
            const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), number);
            const bool whole = error == std::errc() && end == value.data() + value.size();
            return whole && number >= lower && number <= upper ? std::string() : refused(value, expected);
          },
          "", "whole number"};
}

CLI::Validator not_empty(const std::string& expected) {
  return {[=](std::string& value) { return value.empty() ? refused(value, expected) : std::string(); }, "", "text"};
}

CLI::Validator one_of(const std::vector<std::string>& words) {
  return {[words](std::string& value) {
            const bool known = std::find(words.begin(), words.end(), value) != words.end();
            return known ? std::string() : refused(value, "one of " + comma_separated(words));
          },
          "", "word"};
}

CLI::Option* add_list(CLI::App& app, const std::string& name, std::vector<std::string>& values, const std::string& help,
                      const CLI::Validator& check) {
  const auto take = [&values, name, check](const std::vector<std::string>& texts) {
    values = items(name, texts, check);
  };
  return app.add_option_function<std::vector<std::string>>(name, take, help)->allow_extra_args(false);
}

CLI::Option* add_list(CLI::App& app, const std::string& name, std::vector<double>& values, const std::string& help,
                      const CLI::Validator& check) {
  const auto take = [&values, name, check](const std::vector<std::string>& texts) {
    values.clear();
    for (const std::string& item : items(name, texts, check)) {
      values.push_back(parsed_number(item).value());
    }
  };
  return app.add_option_function<std::vector<std::string>>(name, take, help);
}

CLI::Option* add_file(CLI::App& app, const std::string& name, std::string& file, const std::string& help) {
  return app.add_option(name, file, help)->type_name("FILE")->check(not_empty("a file name"));
}

CLI::Option* add_report_file(CLI::App& app, std::string& report) {
  return add_file(app, "--report", report, "Write a page for people that opens in any browser (HTML)");
}

void add_json_flag(CLI::App& app, bool& json) { app.add_flag("--json", json, "Print JSON, SI units"); }

void add_example(CLI::App& app, const std::string& command) {
  app.footer("Options may also stand in a TOML or INI file: --config FILE\nExample:\n  " + command);
}

CLI::Option* add_word(CLI::App& app, const std::string& name, std::string& value, const std::vector<std::string>& words,
                      const std::string& help) {
  return app.add_option(name, value, help)->type_name("NAME")->check(one_of(words))->capture_default_str();
}

CLI::Option* add_orientation(CLI::App& app, std::string& orientation) {
  return app
      .add_option("--orientation", orientation,
                  "What the three numbers of an orientation are [rx,ry,rz: rotation-vector; A,B,C: moving-zyx; others: "
                  "fixed-xyz]")
      ->type_name("READING")
      ->check(one_of(orientation_words()));
}

CLI::Option* limit_count(CLI::Option* option, std::pair<int, int> range) {
  const auto [least, most] = range;
  return option->type_name("N")->check(
      whole_number_between(least, most, fmt::format("a whole number from {} to {}", least, most)));
}

CLI::Option* add_count(CLI::App& app, const std::string& name, int& value, std::pair<int, int> range,
                       const std::string& help) {
  return limit_count(app.add_option(name, value, help), range)->capture_default_str();
}

void add_seed(CLI::App& app, std::uint64_t& seed) {
  app.add_option("--seed", seed, "Seed of the random numbers; the same seed draws the same ones")
      ->type_name("N")
      ->check(whole_number_between(0, std::numeric_limits<long>::max(), "a whole number, 0 or more"))
      ->capture_default_str();
}

void add_circumstances(CLI::App& app, Circumstances& circumstances) {
  const std::string expected = "a number from -273.15 to 1000, or LINK=NUMBER";
  const auto of = [](const std::string& text) {  // the link, empty for all, and its temperature
    const std::size_t sign = text.rfind('=');
    const bool is_of_all = sign == std::string::npos;
    return std::pair(is_of_all ? "" : text.substr(0, sign), parsed_number(is_of_all ? text : text.substr(sign + 1)));
  };
  app.add_option_function<std::vector<std::string>>(
         "--temperature",
         [&circumstances, of](const std::vector<std::string>& texts) {
           for (const std::string& text : texts) {
             const auto [link, temperature] = of(text);
             const bool is_new = link.empty() ? std::isnan(circumstances.temperature)
                                              : circumstances.link_temperatures.emplace(link, *temperature).second;
             if (!is_new) {
               throw InputError("--temperature: " + (link.empty() ? "that of the arm" : shown(link)) +
                                " is there twice, expected each once");
             }
             circumstances.temperature = link.empty() ? *temperature : circumstances.temperature;
           }
         },
         "Temperature of the arm, or with LINK= of one link, for a result with effects of it; repeatable [the means of "
         "the measurements]")
      ->type_name("[LINK=]DEGC")
      ->allow_extra_args(false)
      ->check(CLI::Validator(
          [=](std::string& value) {
            const auto [link, temperature] = of(value);
            const bool fits = temperature && *temperature >= -273.15 && *temperature <= 1000.0 && value.front() != '=';
            return fits ? std::string() : refused(value, expected);
          },
          "", "temperature"));
  app.add_option("--payload", circumstances.payload,
                 "Payload on the flange, for a result with effects of it [the mean of the measurements]")
      ->type_name("KG")
      ->check(number_between(0.0, 1e5, "a number from 0 to 100000"));
}

Calibration at_circumstances(const Calibration& found, const Circumstances& circumstances) {
  Calibration there = found.at(circumstances);
  const CalibrationParts& parts = found.parts();
  const JointRanges& ranges = parts.region.joints;
  if (ranges.empty() || parts.covariance.rows() != parts.free.size() || !states_any(circumstances)) {
    return there;
  }
  Eigen::VectorXd middle(static_cast<Eigen::Index>(ranges.size()));
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    middle[static_cast<Eigen::Index>(i)] = std::midpoint(ranges[i].first, ranges[i].second);
  }
  const auto is_outside = [&](const CalibratedArm& arm) {
    const std::vector<std::string> targets = arm.targets();
    return std::any_of(targets.begin(), targets.end(),
                       [&](const std::string& target) { return arm.predict(middle, target).outside; });
  };
  if (!is_outside(found.arm()) && is_outside(there.arm())) {
    std::string stated;
    const auto add = [&](const std::string& text) { stated += (stated.empty() ? "" : " and ") + text; };
    if (!std::isnan(circumstances.temperature)) {
      add(fmt::format("{:g} degC", circumstances.temperature));
    }
    for (const auto& [link, temperature] : circumstances.link_temperatures) {
      add(fmt::format("{} at {:g} degC", link, temperature));
    }
    if (!std::isnan(circumstances.payload)) {
      add(fmt::format("{:g} kg", circumstances.payload));
    }
    warn(stated + " is far from what was measured: the calibration may be wrong there");
  }
  return there;
}

std::vector<EffectGroup> effect_groups(const std::vector<std::string>& words, const std::vector<std::string>& others) {
  std::vector<EffectGroup> groups;
  for (const std::string& word : words) {
    const std::optional<EffectGroup> group = effect_group(word);
    const bool other = std::find(others.begin(), others.end(), word) != others.end();
    if (group) {
      groups.push_back(*group);
    } else if (other && words.size() > 1) {
      throw InputError("--effects: " + shown(word) +
                       " is not accepted in a list, expected groups alone: " + comma_separated(effect_group_names()));
    } else if (!other) {
      throw InputError("--effects: " + shown(word) + " is not accepted, expected " + comma_separated(others) +
                       " or a list of " + comma_separated(effect_group_names()));
    }
  }
  std::sort(groups.begin(), groups.end());
  if (std::adjacent_find(groups.begin(), groups.end()) != groups.end()) {
    throw InputError("--effects: a group is given more than once, expected each once");
  }
  return groups;
}

void add_robot_options(CLI::App& app, RobotArguments& arguments) {
  CLI::Option* urdf =
      add_file(app, "--urdf", arguments.urdf, "The robot [the FANUC R-2000iC/165F that comes with kdlcal]");
  add_file(app, "--dh", arguments.dh, "The robot as a table of Denavit-Hartenberg parameters (CSV or JSON)")
      ->excludes(urdf);
  app.add_option("--base", arguments.base, "First link of the chain [the root link]")
      ->type_name("LINK")
      ->check(not_empty("a link"));
  app.add_option("--tip", arguments.tip, "Last link of the chain [the only leaf, else tool0, else flange]")
      ->type_name("LINK")
      ->check(not_empty("a link"));
}

Robot load(const RobotArguments& arguments) {
  const RobotOptions ends = {.base = arguments.base, .tip = arguments.tip};
  if (!arguments.dh.empty()) {
    return load_dh_robot(arguments.dh, ends);
  }
  return load_robot(arguments.urdf.empty() ? default_urdf_path() : std::filesystem::path(arguments.urdf), ends);
}

std::vector<std::pair<std::string, std::string>> keys_and_values(const std::string& option,
                                                                 const std::vector<std::string>& texts) {
  std::vector<std::pair<std::string, std::string>> result;
  for (const std::string& text : texts) {
    const std::size_t end = text.find('=');
    if (end == 0 || end == std::string::npos || !is_utf8(text)) {
      throw InputError(option + ": " + shown(text) + " is not accepted, expected key=value in UTF-8");
    }
    const std::string key = text.substr(0, end);
    if (std::any_of(result.begin(), result.end(), [&](const auto& each) { return each.first == key; })) {
      throw InputError(option + ": " + shown(key) + " is given more than once, expected each key once");
    }
    result.emplace_back(key, text.substr(end + 1));
  }
  return result;
}

std::vector<std::pair<std::string, std::string>> notes_of(const std::vector<std::string>& texts) {
  return keys_and_values("--note", texts);
}

std::vector<HashedFile> hashed_files(const RobotArguments& arguments, const Robot& robot, const FileRoles& files) {
  const bool is_dh = !arguments.dh.empty();
  std::vector<HashedFile> result = {{.role = is_dh ? "dh" : "urdf",
                                     .path = robot.source,
                                     .sha256 = is_dh ? sha256_of_file(arguments.dh) : sha256(robot.urdf)}};
  for (const auto& [role, path] : files) {
    if (!path.empty()) {
      result.push_back({.role = role, .path = path, .sha256 = sha256_of_file(path)});
    }
  }
  return result;
}

bool value_is_length(const Robot& robot, const JointConvention* convention, Eigen::Index value) {
  bool any = false;
  Eigen::Index row = 0;
  for (const std::size_t i : independent_joints(robot.joints)) {
    const bool depends = convention == nullptr ? row == value : convention->matrix(row, value) != 0.0;
    any = any || depends;
    if (depends && robot.joints[i].type != JointType::prismatic) {
      return false;
    }
    ++row;
  }
  return any;
}

void add_joint_options(CLI::App& app, JointArguments& arguments) {
  add_list(app, "--joints", arguments.joints,
           "Joint values from base to tip, separated by commas, rad or m; none for joints that mimic others")
      ->type_name("q1,...,qn")
      ->required();
  app.add_flag("--degrees", arguments.degrees, "Joint angles are in degrees");
  add_file(app, "--joint-convention", arguments.joint_convention,
           "Joint values are the controller's, which this file turns into the URDF's");
}

void add_arm_at_joints(CLI::App& app, ArmAtJoints& arguments) {
  add_robot_options(app, arguments.robot);
  add_joint_options(app, arguments.joints);
  add_file(app, "--result", arguments.result, "Apply the errors of a result that calibrate wrote");
  add_json_flag(app, arguments.json);
}

Eigen::VectorXd joint_values(const Robot& robot, const JointArguments& arguments) {
  return joint_values(robot, arguments, convention_of(arguments.joint_convention, robot));
}

Eigen::VectorXd joint_values(const Robot& robot, const JointArguments& arguments,
                             const std::optional<JointConvention>& convention) {
  Eigen::VectorXd q = given_values(robot, arguments, convention ? &*convention : nullptr);
  if (convention) {
    q = convention->matrix * q + convention->offset;
  }
  q = all_joint_values(robot.joints, q);
  warn_outside_limits(robot, q);
  return q;
}

std::optional<JointConvention> convention_of(const std::string& file) {
  return file.empty() ? std::nullopt : std::optional(read_joint_convention(file));
}

std::optional<JointConvention> convention_of(const std::string& file, const Robot& robot) {
  std::optional<JointConvention> convention = convention_of(file);
  if (convention) {
    convention = matched_convention(*convention, independent_joint_names(robot.joints));
  }
  return convention;
}

std::optional<JointConvention> fitting_convention(const std::optional<JointConvention>& convention,
                                                  const Robot& robot) {
  const std::vector<std::string> names = independent_joint_names(robot.joints);
  const bool fits = convention && std::is_permutation(names.begin(), names.end(), convention->urdf_joints.begin(),
                                                      convention->urdf_joints.end());
  return fits ? std::optional(matched_convention(*convention, names)) : std::nullopt;
}

Measurements configurations_of(const Robot& robot, const std::string& file, const std::string& joint_convention) {
  const std::optional<JointConvention> convention = convention_of(joint_convention);
  return read_configurations(robot, file, convention ? &*convention : nullptr);
}

void warn_if_doubted(const std::string& file, Verdict verdict, const std::vector<Doubt>& doubts) {
  if (verdict == Verdict::not_trusted && !doubts.empty()) {
    warn(file + " is not to be trusted: " + doubts.front().message);
  }
}

CalibrationParts read_result(const std::string& file, const Robot& robot) {
  CalibrationParts saved = read_calibration(file, robot);
  warn_if_doubted(file, saved.verdict, saved.doubts);
  if (saved.verdict == Verdict::not_trusted && saved.doubts.empty() && !saved.warnings.empty()) {
    warn(file + " is not to be trusted: " + saved.warnings.back());  // of a result without hashes
  }
  return saved;
}

}  // namespace kdl_calibration::cli
