#include "robot/mimic.hpp"

#include <cmath>

#include "base/preconditions.hpp"

namespace kdl_calibration {

std::vector<std::size_t> independent_joints(const std::vector<MovingJoint>& joints) {
  std::vector<std::size_t> result;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    if (!joints[i].mimic) {
      result.push_back(i);
    }
  }
  return result;
}

Drive drive_of(const MovingJoint& joint) { return joint.drive.value_or(Drive{.name = joint.name}); }

std::vector<std::string> independent_joint_names(const std::vector<MovingJoint>& joints) {
  std::vector<std::string> names;
  for (const std::size_t i : independent_joints(joints)) {
    names.push_back(drive_of(joints[i]).name);
  }
  return names;
}

void follow(const std::vector<MovingJoint>& joints, Eigen::Ref<Eigen::MatrixXd> q) {
  require_count("joint values", q.rows(), joints.size());
  for (std::size_t i = 0; i < joints.size(); ++i) {
    if (const std::optional<Mimic>& mimic = joints[i].mimic) {
      require_index("the leader", mimic->leader, joints.size());
      q.row(static_cast<Eigen::Index>(i)) =
          (mimic->multiplier * q.row(static_cast<Eigen::Index>(mimic->leader))).array() + mimic->offset;
    }
  }
}

double follower_tolerance(double multiplier) {
  constexpr double kRoundedJointValue = 1e-5;
  return kRoundedJointValue * (1.0 + std::abs(multiplier));
}

std::optional<std::size_t> follower_astray(const std::vector<MovingJoint>& joints,
                                           const Eigen::Ref<const Eigen::VectorXd>& q) {
  for (std::size_t i = 0; i < joints.size(); ++i) {
    if (const std::optional<Mimic>& mimic = joints[i].mimic) {
      const double led = mimic->multiplier * q[static_cast<Eigen::Index>(mimic->leader)] + mimic->offset;
      if (!(std::abs(q[static_cast<Eigen::Index>(i)] - led) <= follower_tolerance(mimic->multiplier))) {
        return i;
      }
    }
  }
  return std::nullopt;
}

Eigen::MatrixXd all_joint_values(const std::vector<MovingJoint>& joints,
                                 const Eigen::Ref<const Eigen::MatrixXd>& independent) {
  const std::vector<std::size_t> rows = independent_joints(joints);
  require_count("values of independent joints", independent.rows(), rows.size());
  Eigen::MatrixXd all(static_cast<Eigen::Index>(joints.size()), independent.cols());
  Eigen::Index row = 0;
  for (const std::size_t i : rows) {
    const Drive drive = drive_of(joints[i]);
    all.row(static_cast<Eigen::Index>(i)) = (drive.multiplier * independent.row(row++)).array() + drive.offset;
  }
  follow(joints, all);
  return all;
}

Eigen::MatrixXd independent_joint_values(const std::vector<MovingJoint>& joints,
                                         const Eigen::Ref<const Eigen::MatrixXd>& all) {
  require_count("joint values", all.rows(), joints.size());
  const std::vector<std::size_t> rows = independent_joints(joints);
  Eigen::MatrixXd result = all(rows, Eigen::all);
  for (std::size_t row = 0; row < rows.size(); ++row) {
    const Drive drive = drive_of(joints[rows[row]]);
    auto values = result.row(static_cast<Eigen::Index>(row)).array();
    values = (values - drive.offset) / drive.multiplier;
  }
  return result;
}

}  // namespace kdl_calibration
