#pragma once

#include <Eigen/Core>
#include <array>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/program.hpp"

namespace kdl_calibration {

/// Joint values of the URDF from those of a controller, in the order of the language's names.
class ControllerJoints {
public:
  /// `convention`: none if the controller counts joints as the URDF, in the order of the chain. Throws InputError for
  /// an arm without six joints and for a convention of other joints.
  ControllerJoints(const Robot& arm, const JointConvention* convention, const ProgramLanguage& language);

  SixJoints urdf(const SixJoints& values) const;
  SixJoints controller(const SixJoints& q) const;

private:
  JointConvention convention_;
  std::array<Eigen::Index, 6> place_{};
  Eigen::Matrix<double, 6, 6> inverse_;
};

}  // namespace kdl_calibration
