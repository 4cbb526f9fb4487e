#include "kdl_calibration/mimic.hpp"

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

std::vector<std::string> independent_joint_names(const std::vector<MovingJoint>& joints) {
  std::vector<std::string> names;
  for (const std::size_t i : independent_joints(joints)) {
    names.push_back(joints[i].name);
  }
  return names;
}

void follow(const std::vector<MovingJoint>& joints, Eigen::Ref<Eigen::MatrixXd> q) {
  for (std::size_t i = 0; i < joints.size(); ++i) {
    if (const std::optional<Mimic>& mimic = joints[i].mimic) {
      q.row(static_cast<Eigen::Index>(i)) =
          (mimic->multiplier * q.row(static_cast<Eigen::Index>(mimic->leader))).array() + mimic->offset;
    }
  }
}

Eigen::MatrixXd all_joint_values(const std::vector<MovingJoint>& joints,
                                 const Eigen::Ref<const Eigen::MatrixXd>& independent) {
  Eigen::MatrixXd all(static_cast<Eigen::Index>(joints.size()), independent.cols());
  Eigen::Index row = 0;
  for (const std::size_t i : independent_joints(joints)) {
    all.row(static_cast<Eigen::Index>(i)) = independent.row(row++);
  }
  follow(joints, all);
  return all;
}

Eigen::MatrixXd independent_joint_values(const std::vector<MovingJoint>& joints,
                                         const Eigen::Ref<const Eigen::MatrixXd>& all) {
  return all(independent_joints(joints), Eigen::all);
}

}  // namespace kdl_calibration
