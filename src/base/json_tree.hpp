#pragma once

// Values inside a JSON file, with their path for messages.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration::tree {

using Json = nlohmann::ordered_json;

struct Node {
  const Json& json;
  std::string where;
};

/// Throws InputError: "where: expected …".
[[noreturn]] void fail(const Node& node, const std::string& expected);

bool has(const Node& object, const std::string& key);
/// Each throws InputError if the value is of another type.
Node member(const Node& object, const std::string& key);
std::vector<Node> elements(const Node& node);  ///< at least one
double number(const Node& node);               ///< finite, of at most 1e12
std::string name(const Node& node);            ///< text, not empty
bool truth(const Node& node);

template <int kSize>
Eigen::Matrix<double, kSize, 1> numbers(const Node& node) {
  if (!node.json.is_array() || node.json.size() != kSize) {
    fail(node, "an array of " + std::to_string(kSize) + " numbers");
  }
  Eigen::Matrix<double, kSize, 1> result;
  const std::vector<Node> nodes = elements(node);
  for (int i = 0; i < kSize; ++i) {
    result[i] = number(nodes[static_cast<std::size_t>(i)]);
  }
  return result;
}

/// A unit quaternion.
Eigen::Quaterniond quaternion(const Node& node);
/// {"position", "quaternion_wxyz"}
Eigen::Isometry3d pose(const Node& node);

/// SHA-256 of each member's value, except `provenance`, which users may edit, and `hashes`. That name stands for the
/// SHA-256 of this list, so that no member is added or removed. It depends on values only, as editors and jq may print
/// them differently, such as 1 for 1.0.
Json hashes(const Json& object);

/// JSON text; `source` names it in messages. Throws InputError with the line if it is not JSON, with the member if its
/// hash differs from that in `hashes`, and for a result without hashes unless version 0.1.0 wrote it. Such a result
/// is given as not trusted.
Json parsed(std::string_view text, const std::string& source);

}  // namespace kdl_calibration::tree
