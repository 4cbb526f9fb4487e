#include "kdl_calibration/joint_convention.hpp"

#include <fmt/core.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "base/csv.hpp"
#include "base/json_reading.hpp"
#include "base/number_range.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"

namespace kdl_calibration {
namespace {

using PlainJson = nlohmann::json;

constexpr std::size_t kMostConventionJoints = 1'000;

PlainJson parse_convention(std::string_view text, const std::string& source) {
  std::set<std::string> keys;
  return parse_json<PlainJson>(text, source, [&](int depth, PlainJson::parse_event_t event, const PlainJson& value) {
    if (depth == 1 && event == PlainJson::parse_event_t::key && !keys.insert(value.get<std::string>()).second) {
      fail(source, "key " + shown(value.get<std::string>()) + " appears twice");
    }
  });
}

std::vector<std::string> convention_names(const PlainJson& json, const std::string& key, const std::string& source) {
  const PlainJson& list = json.at(key);
  if (!list.is_array() || list.empty()) fail(source, "key '" + key + "': expected a list of joint names");
  if (list.size() > kMostConventionJoints) fail(source, "key '" + key + "': more than the limit of 1000 joints");
  std::vector<std::string> names;
  for (const PlainJson& item : list) {
    if (!item.is_string() || item.get_ref<const std::string&>().empty()) {
      fail(source, "key '" + key + "': " + shown(item.dump()) + " is no joint name: expected a string");
    }
    const auto& name = item.get_ref<const std::string&>();
    if (std::find(names.begin(), names.end(), name) != names.end()) {
      fail(source, "key '" + key + "': joint " + shown(name) + " appears twice");
    }
    names.push_back(name);
  }
  return names;
}

/// `where` names the list in messages.
Eigen::VectorXd convention_numbers(const PlainJson& list, std::size_t count, const std::string& where,
                                   const std::string& source) {
  const std::string expected = fmt::format("expected a list of {} numbers, one per joint", count);
  if (!list.is_array()) fail(source, where + ": " + shown(list.dump()) + " is no list: " + expected);
  if (list.size() != count) fail(source, fmt::format("{} has {} entries: {}", where, list.size(), expected));
  Eigen::VectorXd values(static_cast<Eigen::Index>(count));
  for (std::size_t i = 0; i < count; ++i) {
    if (!list[i].is_number()) fail(source, where + ": " + shown(list[i].dump()) + " is no number: " + expected);
    values[static_cast<Eigen::Index>(i)] = list[i].get<double>();
    if (std::abs(values[static_cast<Eigen::Index>(i)]) > kLargestNumber) {
      fail(source, where + ": " + shown(list[i].dump()) + " is out of range: expected at most 1e12");
    }
  }
  return values;
}

void check_convention_keys(const PlainJson& json, const std::string& source) {
  const std::string expected = "expected controller_joints, urdf_joints, matrix and optionally offset, description";
  if (!json.is_object()) fail(source, "no JSON object: " + expected);
  for (const auto& [key, value] : json.items()) {
    const bool known = key == "controller_joints" || key == "urdf_joints" || key == "matrix" || key == "offset";
    if (!known && key != "description") fail(source, "unknown key " + shown(key) + ": " + expected);
  }
  for (const char* key : {"controller_joints", "urdf_joints", "matrix"}) {
    if (!json.contains(key)) fail(source, "missing key '" + std::string(key) + "': " + expected);
  }
  if (json.contains("description") && !json["description"].is_string()) {
    fail(source, "key 'description': " + shown(json["description"].dump()) + " is no text: expected a string");
  }
}

// Checks a convention that was not read from a file.
void require_whole(const JointConvention& convention) {
  const std::size_t count = convention.urdf_joints.size();
  require_at_least("joints of a convention", count, 1);
  require_count("controller joints of a convention", convention.controller_joints.size(), count);
  require_count("rows of a convention's matrix", convention.matrix.rows(), count);
  require_count("columns of a convention's matrix", convention.matrix.cols(), count);
  require_count("offsets of a convention", convention.offset.size(), count);
  require_finite("a convention", convention.matrix.allFinite() && convention.offset.allFinite());
  require_count("as rank of a convention's matrix", convention.matrix.fullPivLu().rank(), count);
}

}  // namespace

JointConvention parse_joint_convention(std::string_view json, const std::string& source) {
  const PlainJson document = parse_convention(json, source);
  check_convention_keys(document, source);
  JointConvention convention;
  convention.name = source;
  convention.controller_joints = convention_names(document, "controller_joints", source);
  convention.urdf_joints = convention_names(document, "urdf_joints", source);
  const std::size_t count = convention.controller_joints.size();
  if (convention.urdf_joints.size() != count) {
    fail(source, fmt::format("key 'urdf_joints' has {} names: expected {} as in 'controller_joints'",
                             convention.urdf_joints.size(), count));
  }
  const PlainJson& rows = document.at("matrix");
  if (!rows.is_array() || rows.size() != count) {
    fail(source, fmt::format("key 'matrix' has {} rows: expected {}, one per joint",
                             rows.is_array() ? std::to_string(rows.size()) : "no", count));
  }
  const auto size = static_cast<Eigen::Index>(count);
  convention.matrix.resize(size, size);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string where = fmt::format("key 'matrix', row {}", i + 1);
    convention.matrix.row(static_cast<Eigen::Index>(i)) = convention_numbers(rows[i], count, where, source);
  }
  const Eigen::Index rank = convention.matrix.fullPivLu().rank();
  if (rank < size) {
    fail(source, fmt::format("key 'matrix' is singular: its rank is {}, expected {}", rank, count));
  }
  convention.offset = document.contains("offset")
                          ? convention_numbers(document.at("offset"), count, "key 'offset'", source)
                          : Eigen::VectorXd::Zero(size);
  return convention;
}

JointConvention read_joint_convention(const std::filesystem::path& file) {
  return parse_joint_convention(read_text_file(file), file.string());
}

JointConvention matched_convention(const JointConvention& convention, const std::vector<std::string>& urdf_joints) {
  require_whole(convention);
  const std::vector<std::string>& own = convention.urdf_joints;
  if (!std::is_permutation(own.begin(), own.end(), urdf_joints.begin(), urdf_joints.end())) {
    fail(convention.name, "key 'urdf_joints' names " + comma_separated(own) +
                              ": expected the moving joints of the chain " + comma_separated(urdf_joints));
  }
  JointConvention matched = convention;
  matched.urdf_joints = urdf_joints;
  for (std::size_t i = 0; i < urdf_joints.size(); ++i) {
    const Eigen::Index row = std::find(own.begin(), own.end(), urdf_joints[i]) - own.begin();
    matched.matrix.row(static_cast<Eigen::Index>(i)) = convention.matrix.row(row);
    matched.offset[static_cast<Eigen::Index>(i)] = convention.offset[row];
  }
  return matched;
}

}  // namespace kdl_calibration
