#include "assessment/same_joint_values.hpp"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace kdl_calibration {

using Eigen::Index;

std::vector<Index> first_at_same_values(const Eigen::MatrixXd& joint_values) {
  const auto values = [&](Index c) { return joint_values.col(c); };
  std::vector<std::pair<double, Index>> order;  // the first joint mostly decides
  for (Index c = 0; c < joint_values.cols(); ++c) {
    order.emplace_back(joint_values.rows() > 0 ? joint_values(0, c) : 0.0, c);
  }
  std::sort(order.begin(), order.end(), [&](const auto& a, const auto& b) {
    if (a.first != b.first) {
      return a.first < b.first;
    }
    const auto of_a = values(a.second);
    const auto of_b = values(b.second);
    const auto [in_a, in_b] = std::mismatch(of_a.begin(), of_a.end(), of_b.begin());
    return in_a == of_a.end() ? a.second < b.second : *in_a < *in_b;
  });
  std::vector<Index> first(order.size());
  for (std::size_t k = 0; k < order.size(); ++k) {
    const Index c = order[k].second;
    const bool again = k > 0 && values(order[k - 1].second) == values(c);
    first[static_cast<std::size_t>(c)] = again ? first[static_cast<std::size_t>(order[k - 1].second)] : c;
  }
  return first;
}

}  // namespace kdl_calibration
