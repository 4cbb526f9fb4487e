#include "base/json_tree.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/json_reading.hpp"
#include "base/number_range.hpp"
#include "base/sha256.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::tree {

void fail(const Node& node, const std::string& expected) { throw InputError(node.where + ": expected " + expected); }

bool has(const Node& object, const std::string& key) { return object.json.is_object() && object.json.contains(key); }

Node member(const Node& object, const std::string& key) {
  if (!object.json.is_object()) {
    fail(object, "an object with the key \"" + key + "\"");
  }
  if (!object.json.contains(key)) {
    throw InputError(object.where + ": the key \"" + key + "\" is missing");
  }
  return {.json = object.json.at(key), .where = object.where + ": " + key};
}

std::vector<Node> elements(const Node& node) {
  if (!node.json.is_array() || node.json.empty()) {
    fail(node, "an array that is not empty");
  }
  std::vector<Node> result;
  for (std::size_t i = 0; i < node.json.size(); ++i) {
    result.push_back({.json = node.json[i], .where = node.where + "[" + std::to_string(i) + "]"});
  }
  return result;
}

double number(const Node& node) {
  if (!node.json.is_number() || !(std::abs(node.json.get<double>()) <= kLargestNumber)) {
    fail(node, "a finite number of at most 1e12");
  }
  return node.json.get<double>();
}

std::string name(const Node& node) {
  if (!node.json.is_string() || node.json.get<std::string>().empty()) {
    fail(node, "a name");
  }
  return node.json.get<std::string>();
}

bool truth(const Node& node) {
  if (!node.json.is_boolean()) {
    fail(node, "true or false");
  }
  return node.json.get<bool>();
}

Eigen::Quaterniond quaternion(const Node& node) {
  constexpr double kTolerance = 1e-3;
  const Eigen::Vector4d wxyz = numbers<4>(node);
  if (!(std::abs(wxyz.norm() - 1.0) <= kTolerance)) {
    fail(node, "a quaternion of norm 1");
  }
  return Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]).normalized();
}

Eigen::Isometry3d pose(const Node& node) {
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.translation() = numbers<3>(member(node, "position"));
  result.linear() = quaternion(member(node, "quaternion_wxyz")).toRotationMatrix();
  return result;
}

namespace {

void turn_numbers_into_doubles(nlohmann::json& value) {
  if (value.is_structured()) {
    std::for_each(value.begin(), value.end(), turn_numbers_into_doubles);
  } else if (value.is_number()) {
    value = value.get<double>() + 0.0;  // -0.0 becomes 0.0
  }
}

std::string hash_of(nlohmann::json value) {  // this type sorts the keys
  turn_numbers_into_doubles(value);
  return sha256(value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
}

void require_unchanged(const Json& json, const std::string& source) {
  const Json& written = json["hashes"];
  if (!written.is_object()) {
    fail({.json = written, .where = source + ": hashes"}, "an object");
  }
  const Json found = hashes(json);
  const auto require_same = [&](const std::string& key) {
    if (found.value(key, Json()) != written.value(key, Json())) {
      throw InputError(source + ": " + key + ": was changed after calibrate wrote the file, expected the original " +
                       "(only provenance may be edited)");
    }
  };
  for (const Json* keys : {&written, &found}) {
    for (const auto& entry : keys->items()) {
      if (entry.key() != "hashes") {
        require_same(entry.key());
      }
    }
  }
  require_same("hashes");  // last, as it changes with every other
}

// The members of a result of version 0.1.0, which wrote no hashes.
constexpr std::array kMembersOfFirstVersion = {"software",
                                               "input",
                                               "termination",
                                               "message",
                                               "trusted",
                                               "doubts",
                                               "iterations",
                                               "history",
                                               "rank",
                                               "condition",
                                               "reservation",
                                               "parameters",
                                               "effects",
                                               "model",
                                               "base",
                                               "targets",
                                               "position_error",
                                               "exported_urdf",
                                               "noise",
                                               "convergence_factor",
                                               "priors",
                                               "tried",
                                               "not_tried",
                                               "observability",
                                               "singular_values",
                                               "tied",
                                               "fixed_by_gauge",
                                               "minimum_norm",
                                               "weak",
                                               "findings",
                                               "iso_9283",
                                               "lack_of_fit",
                                               "influence",
                                               "weights",
                                               "predicted_accuracy",
                                               "covariance",
                                               "residuals",
                                               "warnings",
                                               "provenance",
                                               "held_out_points",
                                               "requirements",
                                               "difference_to_kdl"};

bool is_result(const Node& top) {
  const auto states = [&](const char* key) { return has(top, key); };
  return has(top, "parameters") && (states("trusted") || states("doubts") || states("reservation") ||
                                    (states("software") && has(member(top, "software"), "version")));
}

// Others than results need no hashes, such as a truth. Of a result, only one of version 0.1.0 may lack them. Such a
// file could be edited without a trace, so that it is read but never trusted. Members of later versions show that the
// version was edited.
void accept_without_hashes(Json& json, const std::string& source) {
  const Node top{.json = json, .where = source};
  if (!is_result(top)) {
    return;
  }
  const bool has_version = has(top, "software") && has(member(top, "software"), "version");
  if (!has_version || json["software"]["version"] != "0.1.0") {
    throw InputError(source + ": the key \"hashes\" is missing, expected the file as calibrate wrote it");
  }
  for (const auto& entry : json.items()) {
    if (std::find(kMembersOfFirstVersion.begin(), kMembersOfFirstVersion.end(), entry.key()) ==
        kMembersOfFirstVersion.end()) {
      throw InputError(source + ": " + entry.key() +
                       ": was not written by version 0.1.0, expected the file as calibrate wrote it");
    }
  }
  if (json.value("trusted", Json()) == true) {
    if (has(top, "doubts") && !json["doubts"].empty()) {
      fail(member(top, "trusted"), "false, as there are doubts");
    }
    json["trusted"] = false;
    Json& warnings = json["warnings"];
    if (warnings.is_null() || warnings.is_array()) {
      warnings.push_back(
          "version 0.1.0 wrote no hashes, so nothing shows whether the file was edited; calibrate again");
    }
  }
}

// The files that a result was made from are no outputs, as its hashes are of them. Their paths are those of another
// run, which may have stood in another folder: the hash tells them too.
void note_files_read(const Json& json, const std::string& source) {
  const Json none = Json::array();
  const Json& provenance = json.is_object() && json.contains("provenance") ? json["provenance"] : none;
  for (const Json& file : has({provenance, source}, "files_read") ? provenance["files_read"] : none) {
    if (file.is_object() && file.contains("path") && file["path"].is_string()) {
      const bool has_hash = file.contains("sha256") && file["sha256"].is_string();
      note_input(file["path"].get<std::string>(), source + " was made from",
                 has_hash ? file["sha256"].get<std::string>() : std::string());
    }
  }
}

}  // namespace

Json hashes(const Json& object) {
  Json result = Json::object();
  for (const auto& entry : object.items()) {
    if (entry.key() != "hashes" && entry.key() != "provenance") {
      result[entry.key()] = hash_of(entry.value());
    }
  }
  result["hashes"] = hash_of(result);
  return result;
}

Json parsed(std::string_view text, const std::string& source) {
  Json json = parse_json<Json>(text, source, [](int, Json::parse_event_t, const Json&) {});
  if (json.is_object() && json.contains("hashes")) {
    require_unchanged(json, source);
  } else {
    accept_without_hashes(json, source);
  }
  note_files_read(json, source);
  return json;
}

}  // namespace kdl_calibration::tree
