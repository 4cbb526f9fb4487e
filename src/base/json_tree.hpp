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

/// JSON text; `source` names it in messages. Throws InputError naming source and line where it is no JSON.
Json parsed(std::string_view text, const std::string& source);

}  // namespace kdl_calibration::tree
