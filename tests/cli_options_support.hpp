#pragma once

// Options of kdlcal have effects.
//
// How to add a test of an option: add one row to the table of its subcommand (model_options(), fk_options() ... in
// fk_test.cpp, validate_test.cpp, simulate_test.cpp, calibrate_test.cpp, plan_test.cpp). A
// row is the behaviour (the test's name), the option as it stands on the command line and a check, which gets what the
// subcommand did without the option and with it, and says what must differ and what must not. `base` holds further
// words where the option needs company; what they give without the option is made once for all rows, which is why all
// rows of a table find the same input files. An option may have several rows; one without any fails the test of its
// table, `OptionsOfKdlcal.Of...AreAllTested`. Each row is also run with the option in a file (--config), which must do
// the same; of calibrate and plan, whose runs take long, only on the command line.

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "cli_support.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "measurements/readings.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"
#include "report_page_support.hpp"
#include "robot/chain_to_dh.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing {

using Json = nlohmann::json;

const std::string kFanuc = std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf";

/// What one run gave.
struct Answer {
  Outcome outcome;
  Json json;                                 ///< standard output; null where it is no JSON
  std::map<std::string, std::string> files;  ///< that it wrote or changed

  Json file(const std::string& name) const { return Json::parse(files.at(name)); }
};

/// The runs without and with an option.
struct Effect {
  Answer without;
  Answer with;
  std::filesystem::path directory;  ///< with the inputs of both
};

using Check = std::function<void(const Effect& effect)>;

struct OptionCase {
  std::string behaviour;
  Words option;
  Check check;
  Words base = {};
};
// What gtest prints of a row.
inline void PrintTo(const OptionCase& row, std::ostream* stream) { *stream << ::testing::PrintToString(row.option); }

inline std::string behaviour_of(const ::testing::TestParamInfo<OptionCase>& info) { return info.param.behaviour; }

// ---- What differs --------------------------------------------------------------------------------------------------

inline void collect_differences(const Json& a, const Json& b, const std::string& path, std::set<std::string>& result) {
  const std::string inside = path.empty() ? "" : path + "/";
  if (a.is_object() && b.is_object()) {
    std::set<std::string> keys;
    for (const Json* side : {&a, &b}) {
      for (const auto& entry : side->items()) {
        keys.insert(entry.key());
      }
    }
    for (const std::string& key : keys) {
      collect_differences(a.value(key, Json()), b.value(key, Json()), inside + key, result);
    }
  } else if (a.is_array() && b.is_array() && a.size() == b.size()) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      collect_differences(a[i], b[i], inside + "*", result);
    }
  } else if (a != b) {
    result.insert(path);
  }
}

/// Where two documents differ: "parameters/*/std". A key that is absent counts as null. Hashes follow what differs.
inline std::set<std::string> differences(const Json& a, const Json& b) {
  std::set<std::string> result;
  collect_differences(a, b, "", result);
  std::erase_if(result, [](const std::string& place) { return place.starts_with("hashes"); });
  return result;
}

/// Standard output differs in just these places, status and files not at all.
inline Check changes_only(const std::vector<std::string>& places) {
  return [places](const Effect& effect) {
    EXPECT_THAT(differences(effect.without.json, effect.with.json), ::testing::UnorderedElementsAreArray(places));
    EXPECT_EQ(effect.with.outcome.status, effect.without.outcome.status) << effect.with.outcome.err;
    EXPECT_TRUE(effect.with.files == effect.without.files);
  };
}

template <class... Checks>
Check all_checks(const Checks&... checks) {
  return [=](const Effect& effect) { (checks(effect), ...); };
}

/// The value at a place, "/sigma/plan/mean"; null where there is none.
inline Json at(const Json& json, const std::string& place) {
  const Json::json_pointer pointer(place);
  return json.contains(pointer) ? json[pointer] : Json();
}

/// The place of standard output has one value without the option and the other one with it.
inline Check turns(const std::string& place, const Json& without, const Json& with) {
  return [=](const Effect& effect) {
    EXPECT_EQ(at(effect.without.json, place), without) << place;
    EXPECT_EQ(at(effect.with.json, place), with) << place;
  };
}

/// The list at the place has so many entries without the option and with it.
inline Check counts(const std::string& place, std::size_t without, std::size_t with) {
  return [=](const Effect& effect) {
    EXPECT_EQ(at(effect.without.json, place).size(), without) << place;
    EXPECT_EQ(at(effect.with.json, place).size(), with) << place;
  };
}

/// The option does not change the place, lowers its number below this share, or raises it.
inline Check keeps(const std::string& place) {
  return [=](const Effect& effect) { EXPECT_EQ(at(effect.with.json, place), at(effect.without.json, place)) << place; };
}
inline Check lowers(const std::string& place, double share = 1.0) {
  return [=](const Effect& effect) {
    EXPECT_LT(at(effect.with.json, place), share * at(effect.without.json, place).get<double>()) << place;
  };
}
inline Check raises(const std::string& place) {
  return [=](const Effect& effect) { EXPECT_GT(at(effect.with.json, place), at(effect.without.json, place)) << place; };
}

inline Check changes_nothing() { return changes_only({}); }

/// Without the option the command is refused, with it not.
inline Check is_needed() {
  return [](const Effect& effect) {
    EXPECT_EQ(effect.without.outcome.status, 2);
    EXPECT_EQ(effect.with.outcome.status, 0) << effect.with.outcome.err;
  };
}

/// The file that stood there stays without the option, and begins so with it.
inline Check overwrites(const std::string& file, const std::string& beginning) {
  return [=](const Effect& effect) {
    EXPECT_EQ(effect.without.outcome.status, 2);
    EXPECT_TRUE(effect.without.files.empty());
    EXPECT_THAT(effect.with.files.at(file), ::testing::StartsWith(beginning));
  };
}

/// Standard output is the same, and the page holds it.
inline Check writes_page_of_json(const std::string& file) {
  return [=](const Effect& effect) {
    EXPECT_EQ(effect.with.outcome.out, effect.without.outcome.out);
    EXPECT_EQ(data_of_page(effect.with.files.at(file))["result"], effect.with.json);
  };
}

/// Standard output is a table for people without the option, JSON with it.
inline Check turns_the_table_into_json() {
  return [](const Effect& effect) {
    EXPECT_TRUE(effect.without.json.is_null()) << "expected a table: " << effect.without.outcome.out;
    EXPECT_TRUE(effect.with.json.is_object()) << "expected JSON: " << effect.with.outcome.out;
    EXPECT_EQ(effect.with.outcome.err, effect.without.outcome.err);
    EXPECT_EQ(effect.with.outcome.status, effect.without.outcome.status);
    EXPECT_TRUE(effect.with.files == effect.without.files);
  };
}

/// Numbers of two documents agree to this, everything else exactly.
inline void expect_near(const Json& a, const Json& b, double tolerance, const std::string& path = "") {
  ASSERT_TRUE(a.type() == b.type() || (a.is_number() && b.is_number())) << path << ": " << a << " and " << b;
  if (a.is_number()) {
    EXPECT_NEAR(a.get<double>(), b.get<double>(), tolerance * std::max(1.0, std::abs(a.get<double>()))) << path;
  } else if (a.is_structured()) {
    ASSERT_EQ(a.size(), b.size()) << path;
    for (const auto& [key, value] : a.items()) {
      const Json& other = a.is_object() ? b.value(key, Json()) : b[static_cast<std::size_t>(std::stoul(key))];
      expect_near(value, other, tolerance, path + "/" + key);
    }
  } else {
    EXPECT_EQ(a, b) << path;
  }
}

// ---- Inputs --------------------------------------------------------------------------------------------------------

/// q = M c + o of the FANUC with signs, couplings, a factor and offsets; the controller counts from the flange.
inline constexpr const char* kFanucCoupled = R"({"controller_joints": ["A6", "A5", "A4", "A3", "A2", "A1"],
  "urdf_joints": ["joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"],
  "matrix": [[0,0,0,0,0,1], [0,0,0,0,-1,0], [0,0,0,1,1,0], [0,0,-1,0,0,0], [0,1,0.5,0,0,0], [-2,0,0,0,0,0]],
  "offset": [0.1, -0.2, 0.3, -0.4, 0.5, -0.6]})";

/// The FANUC with a fixed wrist: an arm of three joints, with which kdlcal takes half the time or less.
inline constexpr const char* kArm = "arm.urdf";

inline const Robot& arm() {
  static const Robot robot = [] {
    static const std::regex joint(R"re((<joint name="joint_[456]" type=)"revolute")re");
    Robot parsed = parse_robot(std::regex_replace(CommandLine::content(kFanuc), joint, "$1\"fixed\""));
    parsed.source = kArm;
    return parsed;
  }();
  return robot;
}

/// q = M c + o of this arm with a sign, a coupling, a factor and offsets; the controller counts from the flange.
inline constexpr const char* kArmCoupled = R"({"controller_joints": ["A3", "A2", "A1"],
  "urdf_joints": ["joint_1", "joint_2", "joint_3"],
  "matrix": [[0,0,-2],[0,1,0],[1,0.5,0]], "offset": [0.1, -0.2, 0.3]})";

/// Twelve configurations of a FANUC with errors of a millimetre and a milliradian to fit, four to test, three targets,
/// seen from W, in which the base stands turned.
inline Measurements measured_fanuc(const MeasuringNoise& noise, bool poses, const Robot& robot = fanuc()) {
  const ErrorModel model = complete_model(robot);
  const std::vector<TargetFrame> targets = published_targets(3);
  std::vector<std::size_t> with_errors;
  for (const char* name : {"dq2", "dq3", "dq4", "dq5", "Tx1", "Ty1", "Tz2", "Tz3", "Rz3", "Tz4", "Tz5"}) {
    const bool of_arm = std::any_of(model.parameters.begin(), model.parameters.end(),
                                    [&](const ErrorParameter& parameter) { return parameter.name == name; });
    if (of_arm) {
      with_errors.push_back(parameter_index(model, name));
    }
  }
  VirtualExperiment experiment({.model = model,
                                .targets = poses ? as_frames(targets) : targets,
                                .with_errors = with_errors,
                                .X_WB = Eigen::Translation3d(2.0, 1.0, 0.5) * Eigen::Quaterniond(0.6, 0.0, 0.0, 0.8),
                                .random = Random(7)});
  const Eigen::MatrixXd train = experiment.configurations(12);
  const Eigen::MatrixXd test = experiment.configurations(4);
  const Measurements held_out = experiment.measure(test, noise, Split::test);
  // A sigma of its own would stand above the noise that an option states.
  return without_sigmas(joined(experiment.measure(train, noise), held_out));
}

/// A DH table of the robot.
inline std::string dh_of(const Robot& robot) { return dh_json(dh_table_of(robot, DhConvention::modified)); }

/// The robot on a foot, 0.3 m below its base.
inline std::string with_foot(std::string urdf) {
  return urdf.insert(urdf.find("<link"), R"(<link name="foot"/><joint name="screws" type="fixed"><parent link="foot"/>
    <child link="base_link"/><origin xyz="0 0 0.3" rpy="0 0 0"/></joint>)");
}

/// The robot with a hand, 0.2 m along the flange's y.
inline std::string with_hand(std::string urdf) {
  return urdf.insert(urdf.find("<link"), R"(<link name="hand"/><joint name="grip" type="fixed"><parent link="flange"/>
    <child link="hand"/><origin xyz="0 0.2 0" rpy="0 0 0"/></joint>)");
}

/// The measurements with the joint columns of a controller, whose convention this is.
inline std::string in_controller_joints(Measurements measurements, const std::string& convention) {
  const JointConvention matched = matched_convention(parse_joint_convention(convention), measurements.joints);
  measurements.joint_values = matched.matrix.inverse() * (measurements.joint_values.colwise() - matched.offset);
  measurements.joints = matched.controller_joints;
  return measurements_csv(measurements);
}

// ---- Runs ----------------------------------------------------------------------------------------------------------

/// "--a 1 --b --a 2" as lines of a TOML file: "a = ["1", "2"]", "b = true".
inline std::string as_config(const Words& option) {
  std::vector<std::pair<std::string, std::string>> keys;  // in order, with their values
  std::map<std::string, int> counts;
  for (std::size_t i = 0; i < option.size(); ++i) {
    const std::string key = option[i].substr(2);
    const bool has_value = i + 1 < option.size() && option[i + 1].rfind("--", 0) != 0;
    const std::string value = has_value ? Json(option[++i]).dump() : "true";
    if (counts[key]++ == 0) {
      keys.emplace_back(key, value);
    } else {
      std::find_if(keys.begin(), keys.end(), [&](const auto& entry) { return entry.first == key; })->second +=
          ", " + value;
    }
  }
  std::string text;
  for (const auto& [key, value] : keys) {
    text += key + " = " + (counts[key] > 1 ? "[" + value + "]" : value) + "\n";
  }
  return text;
}

class OptionsOfKdlcal : public CommandLine {
protected:
  /// Runs kdlcal and takes away again what it wrote.
  Answer run_and_tidy(const Words& arguments) {
    const auto before = files();
    Answer result{.outcome = run(arguments), .json = nullptr, .files = {}};
    result.json = Json::parse(result.outcome.out, nullptr, false);
    result.json = result.json.is_discarded() ? Json() : result.json;
    for (const auto& [name, text] : files()) {
      const auto old = before.find(name);
      if (old == before.end() || old->second != text) {
        result.files[name] = text;
        old == before.end() ? void(std::filesystem::remove(directory / name)) : void(write(name, old->second));
      }
    }
    return result;
  }

  /// What these words give, made once for all rows: inputs of one name are the same in every test of a suite.
  const Answer& run_once(const Words& words) {
    static std::map<Words, Answer> known;
    const auto found = known.find(words);
    return found != known.end() ? found->second : known.emplace(words, run_and_tidy(words)).first->second;
  }

  /// On the command line and from a file.
  void check_effect(const Words& command, const OptionCase& row) {
    check_effect_on_command_line(command, row);
    expect_the_same_from_a_file(command + row.base, row.option);
  }

  /// On the command line alone, of the arm of three joints where the row names no other robot: where a run takes long.
  void check_effect_on_arm(const Words& command, const OptionCase& row) {
    const Words given = row.base + row.option;
    const bool other_robot = std::any_of(given.begin(), given.end(),
                                         [](const std::string& word) { return word == "--urdf" || word == "--dh"; });
    check_effect_on_command_line(other_robot ? command : command + Words{"--urdf", kArm}, row);
  }

  void check_effect_on_command_line(const Words& command, const OptionCase& row) {
    const Words words = command + row.base;
    const Effect effect{.without = run_once(words), .with = run_once(words + row.option), .directory = directory};
    ASSERT_NE(effect.with.outcome.status, 2) << effect.with.outcome.err;
    row.check(effect);
  }

  void expect_the_same_from_a_file(const Words& words, const Words& option) {
    const Answer& expected = run_once(words + option);
    EXPECT_NE(expected.outcome.status, 2) << expected.outcome.err;
    write("options.toml", "[" + words.front() + "]\n" + as_config(option));
    Answer from_file = run_and_tidy(words + Words{"--config", "options.toml"});
    EXPECT_EQ(from_file.outcome.status, expected.outcome.status) << from_file.outcome.err;
    EXPECT_EQ(without_config(from_file.outcome.out), expected.outcome.out) << "from a file " << text_of("options.toml");
    EXPECT_EQ(from_file.outcome.err, expected.outcome.err);
    for (auto& [name, text] : from_file.files) {
      text = without_config(text);
    }
    EXPECT_TRUE(from_file.files == expected.files);
  }

  /// A result without its word on the file of options, which alone may tell the two ways apart.
  static std::string without_config(const std::string& text) {
    static const std::regex entry(R"(,\s*\{\s*"role":\s*"config"[^}]*\})");
    return std::regex_replace(text, entry, "");
  }

  /// Every option in the help stands in the table, and none that it does not show.
  void expect_a_test_of_every_option(const std::string& subcommand, const std::vector<OptionCase>& table) {
    std::set<std::string> tested;
    for (const OptionCase& row : table) {
      tested.insert(row.option.front().substr(0, row.option.front().find('=')));
    }
    std::set<std::string> known;
    std::istringstream help(run({subcommand, "--help"}).out);
    for (std::string line; std::getline(help, line);) {
      if (line.rfind("  --", 0) == 0) {
        known.insert(line.substr(2, line.find_first_of(" {", 2) - 2));  // of --option{value if none follows}
      }
    }
    EXPECT_GE(known.size(), 5U);
    EXPECT_EQ(tested, known) << "options of kdlcal " << subcommand << ": see cli_options_support.hpp";
  }
};

/// Poses with angles about fixed x, y and z, as Yaskawa shows them: names and digits leave a rotation vector open.
inline std::string angles_csv(const Measurements& poses) {
  std::istringstream rows(measurements_csv(without_orientations(poses)));
  std::string csv;
  std::string row;
  std::getline(rows, row);
  csv += row + ",rx[deg],ry[deg],rz[deg]\n";
  for (std::size_t i = 0; std::getline(rows, row); ++i) {
    const Orientation& q = *poses.observations[i].orientation();
    double roll = 0.0;
    double pitch = 0.0;
    double yaw = 0.0;
    KDL::Rotation::Quaternion(q.x(), q.y(), q.z(), q.w()).GetRPY(roll, pitch, yaw);
    csv += row + "," + fmt::format("{},{},{}\n", roll / kDegree, pitch / kDegree, yaw / kDegree);
  }
  return csv;
}
/// The data contradict the reading without the option.
inline Check is_contradicted_without() {
  return [](const Effect& effect) {
    EXPECT_EQ(effect.without.outcome.status, 1) << effect.without.outcome.err;
    EXPECT_THAT(effect.without.outcome.err, ::testing::HasSubstr("(--orientation fixed-xyz)"));
    EXPECT_EQ(effect.with.outcome.status, 0) << effect.with.outcome.err;
  };
}

/// Joint values alone, and points alone: with a column of configurations, or named C<configuration>_<target>.
inline std::string joints_csv(const Measurements& measured) {
  Measurements once = subset(measured, [&](const Observation& o) { return o.target == 0 && o.repeat == 1; });
  return measurements_csv(once);
}
inline std::string points_csv(const Measurements& measured, bool named) {
  std::string csv = named ? "name,repeat,x,y,z\n" : "configuration,name,repeat,x,y,z\n";
  for (const Observation& row : measured.observations) {
    const std::string& configuration = measured.configurations[static_cast<std::size_t>(row.configuration)];
    const std::string& target = measured.targets[static_cast<std::size_t>(row.target)];
    csv += named ? "C" + configuration + "_" + target : configuration + "," + target;
    csv += "," + std::to_string(row.repeat);
    for (const double coordinate : row.position()) {
      csv += "," + std::to_string(coordinate);
    }
    csv += "\n";
  }
  return csv;
}

class OptionEffect : public OptionsOfKdlcal, public ::testing::WithParamInterface<OptionCase> {};

}  // namespace kdl_calibration::testing
