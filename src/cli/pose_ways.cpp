#include "cli/pose_ways.hpp"

#include <fmt/core.h>
#include <algorithm>

#include "base/text.hpp"

namespace kdl_calibration::cli {

CompensatedPoint PoseWays::solve(const Eigen::Isometry3d& X_BF, const CompensatedJoints& near,
                                 const std::function<std::string()>& label) {
  constexpr double kTold = 1e-4;  // [m]
  ++points_;
  if (!ways_.are_known()) {
    return compensator_.solve(X_BF, near);
  }
  const std::vector<SixJoints> ways = ways_.all(X_BF, near);
  CompensatedPoint point = compensator_.solve(X_BF, ways.empty() ? near : CompensatedJoints(ways.front()));
  std::vector<CompensatedJoints> others;
  for (const SixJoints& other : other_ways(ways, near, point.joint_values - point.change, kAboutAsNear)) {
    others.emplace_back(other);
  }
  const double spread = spread_of_commands(compensator_, X_BF, point, others);
  if (spread > kTold && close_++ == 0) {
    first_ = label();
  }
  most_ = std::max(most_, spread);
  return point;
}

std::vector<std::string> PoseWays::warnings() const {
  if (close_ > 0) {
    return {fmt::format(
        "at {} of {} poses, first {}, another way (shoulder, elbow, wrist, turns) is about as near to the joint values "
        "before as the one that is compensated, and its command is up to {:.2f} mm away: add joint columns",
        close_, points_, shown(first_), most_ * 1e3)};
  }
  if (points_ > 0 && !ways_.are_known()) {
    return {
        "whether another way to a pose is about as near as the one that is compensated is not known for an arm of this "
        "build: add joint columns"};
  }
  return {};
}

}  // namespace kdl_calibration::cli
