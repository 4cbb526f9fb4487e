#include "results/joint_offsets.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "model/parameters.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;

// The joint that a convention names, by its drive where it has one.
const MovingJoint* joint_named(const ErrorModel& model, const std::string& name) {
  const auto found = std::find_if(model.joints.begin(), model.joints.end(), [&](const MovingJoint& joint) {
    return !joint.mimic && drive_of(joint).name == name;
  });
  return found == model.joints.end() ? nullptr : &*found;
}

const ParameterEstimate* offset_of(const CalibrationResult& calibration, const std::string& joint) {
  for (const ParameterEstimate& parameter : calibration.uncertainty.parameters) {
    if (parameter.kind == ParameterKind::joint_offset && parameter.joint == joint) {
      return &parameter;
    }
  }
  return nullptr;
}

}  // namespace

// A controller's offset is a sum of the URDF's, by the inverse of the convention's matrix.
std::vector<JointOffset> joint_offsets(const CalibrationResult& calibration, const JointConvention& convention) {
  constexpr double kRounding = 1e-9;
  const Eigen::MatrixXd to_controller = convention.matrix.inverse();
  const Eigen::MatrixXd& covariance = calibration.uncertainty.covariance;
  std::vector<JointOffset> offsets;
  for (std::size_t i = 0; i < convention.controller_joints.size(); ++i) {
    JointOffset offset{.joint = convention.controller_joints[i],
                       .measurable = true,
                       .degrees_of_freedom = std::numeric_limits<double>::infinity()};
    Eigen::VectorXd weights = Eigen::VectorXd::Zero(covariance.cols());
    for (std::size_t k = 0; k < convention.urdf_joints.size(); ++k) {
      const MovingJoint* joint = joint_named(calibration.model, convention.urdf_joints[k]);
      const ParameterEstimate* parameter = joint != nullptr ? offset_of(calibration, joint->name) : nullptr;
      const double share = to_controller(static_cast<Index>(i), static_cast<Index>(k));
      if (std::abs(share) <= kRounding || parameter == nullptr) {
        continue;
      }
      const double weight = share / drive_of(*joint).multiplier;
      offset.slides = offset.slides || joint->type == JointType::prismatic;
      offset.measurable = offset.measurable && !parameter->gauge;
      offset.add += weight * parameter->error;
      if (calibration.offsets_alone) {
        const std::size_t index = parameter_index(calibration.model, parameter->name);
        offset.add_alone += weight * calibration.offsets_alone->errors[static_cast<Index>(index)];
      }
      if (const std::optional<Index> column = calibration.fit.free.column(parameter->name)) {
        weights[*column] = weight;
        offset.degrees_of_freedom = std::min(offset.degrees_of_freedom, parameter->degrees_of_freedom);
      }
    }
    const double variance = weights.dot(covariance * weights);
    offset.std = variance >= 0.0 ? std::sqrt(variance) : std::numeric_limits<double>::infinity();
    offsets.push_back(offset);
  }
  return offsets;
}

}  // namespace kdl_calibration
