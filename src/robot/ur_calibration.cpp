#include "robot/ur_calibration.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include "base/csv.hpp"
#include "base/number_range.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/chain_to_dh.hpp"

namespace kdl_calibration {
namespace {

constexpr std::size_t kUrJoints = 6;
constexpr std::array<const char*, kUrJoints> kUrNames = {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint",
                                                         "wrist_1_joint",      "wrist_2_joint",       "wrist_3_joint"};
using SixNumbers = std::array<double, kUrJoints>;

/// The numbers of "[1, 2, 3, 4, 5, 6]  # comment".
SixNumbers six_numbers(std::string_view value, const std::string& key, const Place& place) {
  const std::string expected = key + ": expected six numbers in brackets, separated by commas";
  value = trimmed(value.substr(0, value.find('#')));
  if (!value.starts_with('[') || !value.ends_with(']')) {
    fail(place, expected);
  }
  Fields fields;
  fields.split(value.substr(1, value.size() - 2), ',', place);
  SixNumbers numbers{};
  if (fields.size() != numbers.size()) {
    fail(place, expected);
  }
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const char* last = fields[i].data() + fields[i].size();
    const auto [end, error] = std::from_chars(fields[i].data(), last, numbers[i]);
    if (error != std::errc() || end != last || !(std::abs(numbers[i]) <= kLargestNumber)) {
      fail(place, key + ": " + shown(fields[i]) + " is no number of at most 1e12");
    }
  }
  return numbers;
}

/// Lists by key.
std::map<std::string, SixNumbers> ur_lists(std::string_view text, const std::string& source) {
  std::map<std::string, SixNumbers> lists;
  LineReader lines(text, source);
  for (std::string_view line; lines.next(line);) {
    const std::size_t equals = line.find('=');
    const std::string key(trimmed(line.substr(0, equals)));
    const bool is_list = key == "delta_theta" || key == "delta_a" || key == "delta_d" || key == "delta_alpha";
    if (equals == std::string_view::npos || (!is_list && key != "calibration_status")) {
      continue;
    }
    const std::string_view value = line.substr(equals + 1);
    if (!is_list) {
      if (trimmed(value.substr(0, value.find('#'))) != "2") {
        fail(lines.place(), "calibration_status is not 2: expected the file of a robot whose calibration is finished");
      }
      continue;
    }
    if (!lists.emplace(key, six_numbers(value, key, lines.place())).second) {
      fail(lines.place(), key + " is there twice: expected each list once");
    }
  }
  for (const char* key : {"delta_theta", "delta_a", "delta_d", "delta_alpha"}) {
    if (!lists.contains(key)) {
      fail(source, "no list " + std::string(key) + ": expected a calibration.conf of a Universal Robot");
    }
  }
  return lists;
}

/// The frames before each row, at zero joint values.
std::array<KDL::Frame, kUrJoints> frames_of(const DhTable& table) {
  std::array<KDL::Frame, kUrJoints> frames;
  KDL::Frame frame = table.base;
  for (std::size_t i = 0; i < kUrJoints; ++i) {
    frames[i] = frame;
    frame = frame * dh_along(table.rows[i]) * dh_across(table.rows[i]);
  }
  return frames;
}

/// The table in the maker's form: alpha is (90, 0, 0, 90, -90, 0) degrees, theta zero, a only of rows 2 and 3.
DhTable nominal_ur_table(const Robot& robot) {
  constexpr double kRightAngle = 0.5 * std::numbers::pi;
  constexpr double kRoundedUrdf = 1e-5;
  constexpr std::array kAlpha = {kRightAngle, 0.0, 0.0, kRightAngle, -kRightAngle, 0.0};
  DhTable table = dh_table_of(robot, DhConvention::standard);
  // What commutes with the first joint belongs to the base, what stands behind the last one to the tip.
  DhRow& first = table.rows.front();
  table.base = table.base * KDL::Frame(KDL::Rotation::RotZ(first.theta));
  first.theta = 0.0;
  DhRow& last = table.rows.back();
  table.tip = dh_along(last) * dh_across(last) * table.tip;
  last = {.joint = last.joint, .d = table.tip.p.z()};
  table.tip.p.z(0.0);
  if (first.alpha < 0.0) {  // the same table with all x axes reversed
    const KDL::Frame half_turn(KDL::Rotation(-1, 0, 0, 0, -1, 0, 0, 0, 1));
    table.base = table.base * half_turn;
    table.tip = half_turn * table.tip;
    for (DhRow& row : table.rows) {
      row.a = -row.a;
      row.alpha = -row.alpha;
      row.beta = -row.beta;
    }
  }
  for (std::size_t i = 0; i < kUrJoints; ++i) {
    const DhRow& row = table.rows[i];
    const double offset = i == 1 || i == 2 ? row.d : row.a;
    if (std::abs(row.alpha - kAlpha[i]) > kRoundedUrdf || std::abs(row.theta) > kRoundedUrdf ||
        std::abs(row.beta) > kRoundedUrdf || std::abs(offset) > kRoundedUrdf) {
      throw InputError(robot.source + ": joint " + in_quotes(row.joint) +
                       " is not where the nominal DH table of a Universal Robot has it: expected the maker's URDF, " +
                       "not a corrected one");
    }
  }
  return table;
}

}  // namespace

void require_ur_joints(const Robot& robot) {
  bool known = robot.joints.size() == kUrJoints;
  std::string prefix;
  for (std::size_t i = 0; known && i < kUrJoints; ++i) {
    const std::string& name = robot.joints[i].name;
    const bool ends = name.ends_with(kUrNames[i]);
    prefix = i == 0 && ends ? name.substr(0, name.size() - std::string(kUrNames[0]).size()) : prefix;
    known = ends && name == prefix + kUrNames[i] && robot.joints[i].type != JointType::prismatic;
  }
  if (!known) {
    throw InputError(robot.source + ": is no Universal Robot: expected the joints " +
                     comma_separated({kUrNames.begin(), kUrNames.end()}));
  }
}

std::vector<OriginCorrection> ur_corrections(const Robot& robot, std::string_view calibration,
                                             const std::string& source) {
  require_ur_joints(robot);
  const std::map<std::string, SixNumbers> deltas = ur_lists(calibration, source);
  const DhTable nominal = nominal_ur_table(robot);
  DhTable table = nominal;
  for (std::size_t i = 0; i < kUrJoints; ++i) {
    table.rows[i].theta += deltas.at("delta_theta")[i];
    table.rows[i].a += deltas.at("delta_a")[i];
    table.rows[i].d += deltas.at("delta_d")[i];
    table.rows[i].alpha += deltas.at("delta_alpha")[i];
  }
  const std::array<KDL::Frame, kUrJoints> nominal_axes = frames_of(nominal);
  const std::array<KDL::Frame, kUrJoints> axes = frames_of(table);
  // A turn about the joint's axis and a shift along it, X, commute with the joint's motion and so change no kinematics.
  // They are chosen so that the joint's frame stays close to the nominal one.
  std::vector<OriginCorrection> corrections;
  KDL::Frame before = nominal.base;
  KDL::Frame joint_frame;
  for (std::size_t i = 0; i < kUrJoints; ++i) {
    const KDL::Frame moved = axes[i].Inverse() * nominal_axes[i];
    const double angle = std::atan2(moved.M(1, 0) - moved.M(0, 1), moved.M(0, 0) + moved.M(1, 1));
    const KDL::Frame X(KDL::Rotation::RotZ(angle), KDL::Vector(0.0, 0.0, moved.p.z()));
    joint_frame = joint_frame * robot.joints[i].origin;
    const KDL::Frame on_axis = nominal_axes[i].Inverse() * joint_frame;
    corrections.push_back(
        {.joint = robot.joints[i].name, .correction = robot.joints[i].origin.Inverse() * before * X * on_axis});
    // X^-1 Rz(theta) Tz(d): shifts that may be large and cancel are added first.
    const DhRow& row = table.rows[i];
    const KDL::Frame rest(KDL::Rotation::RotZ(row.theta - angle), KDL::Vector(0.0, 0.0, row.d - moved.p.z()));
    before = on_axis.Inverse() * rest * dh_across(row);
  }
  if (robot.tip_joint.empty()) {
    throw InputError(robot.source + ": no fixed joint between " + in_quotes(robot.joints.back().name) +
                     " and the tip carries the last row: expected the tip flange or tool0");
  }
  corrections.push_back({.joint = robot.tip_joint, .correction = robot.tip_origin.Inverse() * before * nominal.tip});
  constexpr double kLargest = 0.1;  // [m]
  for (const OriginCorrection& correction : corrections) {
    if (const double shift = correction.correction.p.Norm(); shift > kLargest) {
      throw InputError(fmt::format("{}: moves {} by {:.2f} m, expected metres and radians of this robot", source,
                                   in_quotes(correction.joint), shift));
    }
  }
  return corrections;
}

void require_ur_description(const Robot& robot) {
  constexpr double kRounding = 1e-12;
  require_ur_joints(robot);
  for (const MovingJoint& joint : robot.joints) {
    if (!KDL::Equal(joint.axis, KDL::Vector(0.0, 0.0, 1.0), kRounding)) {
      throw InputError(robot.source + ": joint " + in_quotes(joint.name) +
                       " does not turn about z: expected the description whose kinematics are a YAML file");
    }
  }
}

namespace {

/// "key: value  # comment" cut in parts; no key for a blank line.
struct YamlLine {
  std::size_t indentation = 0;
  std::string key;
  std::string_view value;
};

YamlLine yaml_line(std::string_view line, const Place& place) {
  const std::size_t comment = line.find('#');
  if (comment != std::string_view::npos && (comment == 0 || line[comment - 1] == ' ')) {
    line = line.substr(0, comment);
  }
  if (trimmed(line).empty() || line == "---" || line == "...") {
    return {};
  }
  const std::size_t colon = line.find(':');
  if (colon == std::string_view::npos) {
    fail(place, shown(trimmed(line)) + " is no key with a colon: expected the YAML of ur_calibration");
  }
  return {.indentation = line.find_first_not_of(' '),
          .key = std::string(trimmed(line.substr(0, colon))),
          .value = trimmed(line.substr(colon + 1))};
}

double yaml_number_in(const YamlLine& line, const Place& place) {
  const char* first = line.value.data() + (line.value.starts_with('+') ? 1 : 0);
  const char* last = line.value.data() + line.value.size();
  double number = 0.0;
  const auto [end, error] = std::from_chars(first, last, number);
  if (error != std::errc() || end != last || !(std::abs(number) <= kLargestNumber)) {
    fail(place, line.key + ": " + shown(line.value) + " is no number of at most 1e12");
  }
  return number;
}

using SixFrames = std::array<std::array<std::optional<double>, kUrNumbers.size()>, kUrJoints>;

template <std::size_t kSize>
std::optional<std::size_t> place_in(const std::array<const char*, kSize>& names, const std::string& name) {
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? std::nullopt : std::optional(static_cast<std::size_t>(found - names.begin()));
}

/// The frames below the key `kinematics`; other keys beside it are of other programs.
SixFrames ur_frames(std::string_view yaml, const std::string& source) {
  SixFrames frames{};
  std::optional<std::size_t> link;
  bool inside = false;
  std::size_t of_links = 0;  // their indentation
  LineReader lines(yaml, source);
  for (std::string_view text; lines.next(text);) {
    const YamlLine line = yaml_line(text, lines.place());
    if (line.key.empty()) {
      continue;
    }
    if (line.indentation == 0) {
      inside = line.key == "kinematics";
      link.reset();
      of_links = 0;
    } else if (inside && (of_links == 0 || line.indentation == of_links)) {
      of_links = line.indentation;
      link = place_in(kUrLinks, line.key);
      if (!link && line.key != "hash") {
        fail(lines.place(), shown(line.key) + " is unknown, expected shoulder, upper_arm, forearm, wrist_1 to wrist_3");
      }
    } else if (inside && link) {
      const std::optional<std::size_t> number = place_in(kUrNumbers, line.key);
      if (!number || frames[*link][*number]) {
        fail(lines.place(), shown(line.key) + (number ? " is there twice" : " is unknown") +
                                ", expected x, y, z, roll, pitch, yaw, each once");
      }
      frames[*link][*number] = yaml_number_in(line, lines.place());
    }
  }
  return frames;
}

}  // namespace

bool is_ur_yaml(std::string_view text) {
  const std::size_t key = text.starts_with("kinematics:") ? 0 : text.find("\nkinematics:");
  return key != std::string_view::npos;
}

std::vector<NewOrigin> ur_origins(const Robot& robot, std::string_view yaml, const std::string& source) {
  constexpr double kLargest = 0.1;  // [m] and [rad]
  require_ur_description(robot);
  const SixFrames frames = ur_frames(yaml, source);
  std::vector<NewOrigin> origins;
  for (const KDL::Segment& segment : robot.chain.segments) {
    if (segment.getJoint().getType() == KDL::Joint::Fixed) {
      continue;
    }
    const std::size_t link = origins.size();
    std::array<double, kUrNumbers.size()> numbers{};
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      if (!frames[link][i]) {
        fail(source, std::string("kinematics: ") + kUrLinks[link] + " has no " + kUrNumbers[i] +
                         ", expected x, y, z, roll, pitch, yaw");
      }
      numbers[i] = *frames[link][i];
    }
    const auto& [x, y, z, roll, pitch, yaw] = numbers;
    const KDL::Frame nominal = segment.pose(0.0);
    const double shift = (KDL::Vector(x, y, z) - nominal.p).Norm();
    KDL::Vector axis;
    const double turn = (nominal.M.Inverse() * KDL::Rotation::RPY(roll, pitch, yaw)).GetRotAngle(axis);
    if (shift > kLargest || turn > kLargest) {
      fail(source, fmt::format("{} is {:.2f} m and {:.2f} rad from where the URDF has it, expected metres and radians "
                               "of this robot",
                               kUrLinks[link], shift, turn));
    }
    origins.push_back({.joint = segment.getJoint().getName(), .xyz = {x, y, z}, .rpy = {roll, pitch, yaw}});
  }
  return origins;
}

}  // namespace kdl_calibration
