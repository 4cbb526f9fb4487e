#pragma once

// Values inside a JSON file, with the way to them for messages. Not installed.

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
/// Each throws InputError where the value is not of that sort.
Node member(const Node& object, const std::string& key);
std::vector<Node> elements(const Node& node);  ///< at least one
double number(const Node& node);               ///< finite, of at most 1e12
std::string name(const Node& node);            ///< text that is not empty
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

/// Of norm 1.
Eigen::Quaterniond quaternion(const Node& node);

/// The SHA-256 of each member's value, but of `provenance`, which people may edit, and of `hashes` itself. It depends
/// on values alone: editors and jq print the same value in other words, such as 1 for 1.0.
Json hashes(const Json& object);

/// JSON text; `source` names it in messages. Throws InputError: with the line where it is no JSON, with the member
/// where that is not the one whose hash is in `hashes`.
Json parsed(std::string_view text, const std::string& source);

}  // namespace kdl_calibration::tree
