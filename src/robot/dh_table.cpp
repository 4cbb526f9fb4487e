#include "robot/dh_table.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <set>
#include <utility>

#include "base/csv.hpp"
#include "base/json_tree.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "base/units.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/urdf_correction.hpp"

namespace kdl_calibration {
namespace {

using tree::Json;
using tree::Node;

constexpr double kLongest = 20.0;  // [m] of any robot
const std::string kTipJoint = "tool0_fixed_joint";

/// A quantity of a row and its kind.
struct DhColumn {
  std::string_view name;
  bool length = false;
  double DhRow::*value = nullptr;
  bool required = true;
};
constexpr std::array kDhColumns = {DhColumn{"a", true, &DhRow::a}, DhColumn{"alpha", false, &DhRow::alpha},
                                   DhColumn{"beta", false, &DhRow::beta, false}, DhColumn{"d", true, &DhRow::d},
                                   DhColumn{"theta", false, &DhRow::theta}};

const char* to_string(DhConvention convention) {
  return convention == DhConvention::standard ? "standard" : "modified";
}

DhConvention dh_convention(const Node& node) {
  const std::string word = tree::name(node);
  for (const DhConvention each : {DhConvention::standard, DhConvention::modified}) {
    if (lower_case(word) == to_string(each)) {
      return each;
    }
  }
  throw InputError(node.where + ": " + shown(word) + " is unknown, expected standard or modified");
}

/// A number of JSON, or text of CSV. A comma is a decimal mark: it did not separate fields.
double dh_number(const Node& node) {
  if (!node.json.is_string()) {
    return tree::number(node);
  }
  std::string text = node.json.get<std::string>();
  std::replace(text.begin(), text.end(), ',', '.');
  const char* first = text.data() + (text.starts_with('+') ? 1 : 0);
  const char* last = text.data() + text.size();
  double value = 0.0;
  const auto [end, error] = std::from_chars(first, last, value);
  if (error != std::errc() || end != last) {
    throw InputError(node.where + ": " + shown(node.json.get<std::string>()) + " is no number");
  }
  return tree::number({.json = value, .where = node.where});
}

/// In SI units; the unit must be one of a length or of an angle.
double dh_quantity(const Node& node, std::string_view name, std::optional<std::string_view> unit_text, bool length) {
  const std::string expected = "expected " + std::string(name) + (length ? "[mm] or [m]" : "[deg] or [rad]");
  if (!unit_text) {
    throw InputError(node.where + ": has no unit, " + expected);
  }
  const Unit unit = unit_named(translated(*unit_text, kUnitWords));
  if (unit == Unit::none || length != (unit == Unit::m || unit == Unit::mm)) {
    throw InputError(node.where + ": unit " + shown(*unit_text) + " is not accepted, " + expected);
  }
  const double value = dh_number(node);
  const bool is_limit = name == "lower" || name == "upper";  // of several turns, perhaps
  if (unit == Unit::rad && !is_limit && std::abs(value) > 2.0 * std::numbers::pi) {
    throw InputError(
        fmt::format("{}: {} rad is more than a turn: degrees? write {}[deg]", node.where, shortest(value), name));
  }
  if (unit == Unit::m && name == "a" && std::abs(value) > kLongest) {
    throw InputError(
        fmt::format("{}: {} m is longer than any robot: millimetres? write a[mm]", node.where, shortest(value)));
  }
  return to_si(value, unit);
}

JointType dh_type(const Node& node) {
  const std::string word = lower_case(tree::name(node));
  if (word != "revolute" && word != "prismatic") {
    throw InputError(node.where + ": " + shown(word) + " is unknown, expected revolute or prismatic");
  }
  return word == "revolute" ? JointType::revolute : JointType::prismatic;
}

/// Sets what the key "alpha[deg]" names. Returns its name without the unit.
std::string set_quantity(const Node& node, const std::string& key, DhRow& row) {
  const auto [name, unit] = name_and_unit(key);
  const Node value = tree::member(node, key);
  if (name == "lower" || name == "upper") {
    (name == "lower" ? row.lower : row.upper) = dh_quantity(value, name, unit, row.type == JointType::prismatic);
    return std::string(name);
  }
  for (const DhColumn& column : kDhColumns) {
    if (column.name == name) {
      row.*column.value = dh_quantity(value, name, unit, column.length);
      return std::string(name);
    }
  }
  throw InputError(node.where + ": unknown column " + shown(key) +
                   ", expected joint, type, a, alpha, beta, d, theta, lower, upper");
}

DhRow dh_row(const Node& node) {
  DhRow row{.joint = tree::name(tree::member(node, "joint"))};
  if (const std::string fault = label_fault(row.joint); !fault.empty()) {
    throw InputError(node.where + ": joint " + fault);
  }
  row.type = tree::has(node, "type") ? dh_type(tree::member(node, "type")) : JointType::revolute;
  std::set<std::string, std::less<>> found;
  for (const auto& [key, value] : node.json.items()) {
    if (key != "joint" && key != "type" && !found.insert(set_quantity(node, key, row)).second) {
      throw InputError(node.where + ": " + std::string(name_and_unit(key).first) +
                       " is there twice, expected each once");
    }
  }
  for (const DhColumn& column : kDhColumns) {
    if (column.required && !found.contains(column.name)) {
      throw InputError(node.where + ": no " + std::string(column.name) + ", expected a number; 0 where there is none");
    }
  }
  if (row.lower.has_value() != row.upper.has_value()) {
    throw InputError(node.where + ": one limit alone, expected lower and upper or neither");
  }
  return row;
}

KDL::Frame dh_frame(const Node& top, const std::string& key) {
  if (!tree::has(top, key)) {
    return KDL::Frame::Identity();
  }
  const Node frame = tree::member(top, key);
  const Eigen::Vector3d p = tree::numbers<3>(tree::member(frame, "position"));
  const Eigen::Matrix3d m = tree::quaternion(tree::member(frame, "quaternion_wxyz")).toRotationMatrix();
  return {KDL::Rotation(m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)),
          KDL::Vector(p.x(), p.y(), p.z())};
}

/// The rows as JSON objects of texts, with their place.
DhTable dh_from_csv(std::string_view text, const std::string& source) {
  LineReader lines(text, source);
  std::string_view line;
  Fields cells;
  const auto next = [&](const std::string& expected) {
    if (!next_record(lines, line)) {
      fail(source, "ends early: expected " + expected);
    }
  };
  next("the line convention,standard or convention,modified");
  const char separator = separator_of(line);
  cells.split(line, separator, lines.place());
  if (cells.size() < 2 || lower_case(cells[0]) != "convention") {
    fail(lines.place(), "states no convention: expected the line convention,standard or convention,modified first");
  }
  DhTable table;
  const Json word = std::string(cells[1]);
  table.convention =
      dh_convention({.json = word, .where = fmt::format("{}:{}: convention", source, lines.place().line)});
  next("a header");
  const char columns = separator_of(line);
  cells.split(line, columns, lines.place());
  std::vector<std::string> header;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    header.emplace_back(cells[i]);
    if (!header.back().empty() && std::count(header.begin(), header.end(), header.back()) > 1) {
      fail(lines.place(), "column " + shown(header.back()) + " is there twice: expected each once");
    }
  }
  while (next_record(lines, line)) {
    cells.split(line, columns, lines.place());
    Json row = Json::object();
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (!cells[i].empty() && (i >= header.size() || header[i].empty())) {
        fail(lines.place(), "value " + shown(cells[i]) + " in a column without a name");
      }
      if (!cells[i].empty()) {
        row[header[i]] = std::string(header[i] == "joint" ? name_in(cells[i]) : cells[i]);
      }
    }
    table.rows.push_back(dh_row({.json = row, .where = fmt::format("{}:{}", source, lines.place().line)}));
  }
  return table;
}

DhTable dh_from_json(std::string_view text, const std::string& source) {
  const Json document = tree::parsed(text, source);
  const Node top{.json = document, .where = source};
  for (const auto& [key, value] : document.items()) {
    constexpr std::array kKnown = {"convention", "base", "joints", "tip", "note", "largest_difference"};
    if (std::find(kKnown.begin(), kKnown.end(), key) == kKnown.end()) {
      throw InputError(source + ": unknown key " + shown(key) + ", expected convention, joints, base, tip, note");
    }
  }
  DhTable table;
  table.convention = dh_convention(tree::member(top, "convention"));
  table.base = dh_frame(top, "base");
  table.tip = dh_frame(top, "tip");
  for (const Node& node : tree::elements(tree::member(top, "joints"))) {
    table.rows.push_back(dh_row(node));
  }
  return table;
}

Json dh_frame_json(const KDL::Frame& frame) {
  Eigen::Matrix3d m;
  for (int i = 0; i < 9; ++i) {
    m(i / 3, i % 3) = frame.M(i / 3, i % 3);
  }
  const Eigen::Quaterniond q(m);
  return {{"position", {frame.p.x() + 0.0, frame.p.y() + 0.0, frame.p.z() + 0.0}},
          {"quaternion_wxyz", {q.w() + 0.0, q.x() + 0.0, q.y() + 0.0, q.z() + 0.0}}};
}

std::string xml_text(const std::string& name) {
  std::string result;
  for (const char c : name) {
    result += c == '&' ? "&amp;" : c == '<' ? "&lt;" : c == '"' ? "&quot;" : std::string(1, c);
  }
  return result;
}

/// [m] How far the last frame is from the first. Each joint that turns is at this value.
double reach_at(const DhTable& table, double angle) {
  KDL::Frame tip;
  for (const DhRow& row : table.rows) {
    const double q = row.type == JointType::prismatic ? 0.0 : angle;
    const KDL::Frame along(KDL::Rotation::RotZ(row.theta + q), KDL::Vector(0.0, 0.0, row.d));
    tip = table.convention == DhConvention::standard ? tip * along * dh_across(row) : tip * dh_across(row) * along;
  }
  return tip.p.Norm();
}

/// Nearly parallel axes have d of hundreds of metres, which cancel at all joint values.
void require_reach_of_a_robot(const DhTable& table, const std::string& source) {
  for (const double angle : {0.0, 0.5, 1.0}) {
    if (const double reach = reach_at(table, angle); reach > kLongest) {
      const DhRow& longest = *std::max_element(table.rows.begin(), table.rows.end(), [](const auto& a, const auto& b) {
        return std::abs(a.d) < std::abs(b.d);
      });
      fail(source, fmt::format("the last frame is {:.4g} m from the first at joint values of {:.1f}, farther than that "
                               "of any robot; d of joint {} is {} m: millimetres? write d[mm]",
                               reach, angle, in_quotes(longest.joint), shortest(longest.d)));
    }
  }
}

/// A joint between these links, as an element of a URDF; without a row it is fixed.
std::string urdf_joint(const std::string& parent, const std::string& child, const KDL::Frame& origin,
                       const DhRow* row) {
  const auto [roll, pitch, yaw] = rpy_of(origin.M);
  const bool limited = row != nullptr && row->lower;
  const bool slides = row != nullptr && row->type == JointType::prismatic;
  const char* type = row == nullptr ? "fixed" : slides ? "prismatic" : limited ? "revolute" : "continuous";
  std::string text = fmt::format(
      "  <joint name=\"{}\" type=\"{}\">\n    <parent link=\"{}\"/>\n    <child link=\"{}\"/>\n"
      "    <origin xyz=\"{} {} {}\" rpy=\"{} {} {}\"/>\n",
      row == nullptr ? kTipJoint : xml_text(row->joint), type, parent, child, shortest(origin.p.x()),
      shortest(origin.p.y()), shortest(origin.p.z()), shortest(roll), shortest(pitch), shortest(yaw));
  if (row != nullptr) {
    text += "    <axis xyz=\"0 0 1\"/>\n";
  }
  if (limited || slides) {  // urdfdom wants a <limit> of a slide; zeros state none
    text += fmt::format("    <limit lower=\"{}\" upper=\"{}\" effort=\"0\" velocity=\"0\"/>\n",
                        shortest(limited ? *row->lower : 0.0), shortest(limited ? *row->upper : 0.0));
  }
  return text + "  </joint>\n";
}

}  // namespace

KDL::Frame dh_across(const DhRow& row) {
  return {KDL::Rotation::RotX(row.alpha) * KDL::Rotation::RotY(row.beta), KDL::Vector(row.a, 0.0, 0.0)};
}

KDL::Frame dh_along(const DhRow& row) { return {KDL::Rotation::RotZ(row.theta), KDL::Vector(0.0, 0.0, row.d)}; }

DhTable parse_dh_table(std::string_view text, const std::string& source) {
  const std::size_t first = text.find_first_not_of(" \t\r\n");
  const bool json = first != std::string_view::npos && text[first] == '{';
  DhTable table = json ? dh_from_json(text, source) : dh_from_csv(text, source);
  if (table.rows.empty()) {
    fail(source, "has no rows: expected one for each joint, from base to tip");
  }
  std::set<std::string> names = {kTipJoint};
  for (const DhRow& row : table.rows) {
    if (!names.insert(row.joint).second) {
      fail(source, "joint name " + shown(row.joint) + " is taken: expected another one for each row");
    }
  }
  require_reach_of_a_robot(table, source);
  return table;
}

std::string dh_json(const DhTable& table, const std::string& note, const std::optional<PoseDifference>& difference) {
  Json json = {{"convention", to_string(table.convention)}};
  if (!note.empty()) {
    json["note"] = note;
  }
  json["base"] = dh_frame_json(table.base);
  json["joints"] = Json::array();
  const bool with_beta =
      std::any_of(table.rows.begin(), table.rows.end(), [](const DhRow& r) { return r.beta != 0.0; });
  for (const DhRow& row : table.rows) {
    const bool slides = row.type == JointType::prismatic;
    Json entry = {{"joint", row.joint}, {"type", slides ? "prismatic" : "revolute"}};
    for (const DhColumn& column : kDhColumns) {
      if (column.required || with_beta) {
        entry[std::string(column.name) + (column.length ? "[m]" : "[rad]")] = row.*column.value + 0.0;
      }
    }
    if (row.lower && row.upper) {
      entry[slides ? "lower[m]" : "lower[rad]"] = *row.lower;
      entry[slides ? "upper[m]" : "upper[rad]"] = *row.upper;
    }
    json["joints"].push_back(entry);
  }
  json["tip"] = dh_frame_json(table.tip);
  if (difference) {
    json["largest_difference"] = {{"position[m]", difference->position}, {"rotation[rad]", difference->rotation}};
  }
  return json.dump(2) + "\n";
}

std::string dh_urdf(const DhTable& table) {
  std::string links = "  <link name=\"base\"/>\n";
  std::string joints;
  std::string parent = "base";
  KDL::Frame origin = table.base;
  for (std::size_t i = 0; i < table.rows.size(); ++i) {
    const DhRow& row = table.rows[i];
    const std::string child = "link_" + std::to_string(i + 1);
    const bool modified = table.convention == DhConvention::modified;
    joints +=
        urdf_joint(parent, child, modified ? origin * dh_across(row) * dh_along(row) : origin * dh_along(row), &row);
    links += "  <link name=\"" + child + "\"/>\n";
    origin = modified ? KDL::Frame::Identity() : dh_across(row);
    parent = child;
  }
  return "<?xml version=\"1.0\"?>\n<robot name=\"dh_table\">\n" + links + "  <link name=\"tool0\"/>\n" + joints +
         urdf_joint(parent, "tool0", origin * table.tip, nullptr) + "</robot>\n";
}

}  // namespace kdl_calibration
