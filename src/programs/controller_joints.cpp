#include "programs/controller_joints.hpp"

#include <fmt/core.h>
#include <Eigen/LU>
#include <algorithm>
#include <string>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {

using Eigen::Index;

namespace {

JointConvention convention_for(const Robot& arm, const JointConvention* convention, const ProgramLanguage& language) {
  const std::vector<std::string> names = joint_names(arm);
  if (names.size() != language.joint_names.size()) {
    throw InputError(fmt::format("{}: the arm has {} joints, expected six for programs", arm.source, names.size()));
  }
  if (convention != nullptr) {
    return matched_convention(*convention, names);
  }
  const auto size = static_cast<Index>(names.size());
  return {.name = arm.source,
          .controller_joints = {language.joint_names.begin(), language.joint_names.end()},
          .urdf_joints = names,
          .matrix = Eigen::MatrixXd::Identity(size, size),
          .offset = Eigen::VectorXd::Zero(size)};
}

}  // namespace

ControllerJoints::ControllerJoints(const Robot& arm, const JointConvention* convention, const ProgramLanguage& language)
    : convention_(convention_for(arm, convention, language)) {
  const auto& names = convention_.controller_joints;
  for (std::size_t i = 0; i < place_.size(); ++i) {
    const auto found = std::find(names.begin(), names.end(), language.joint_names[i]);
    if (found == names.end()) {
      throw InputError(fmt::format("{}: names other joints, expected {} to {} of the controller", convention_.name,
                                   language.joint_names.front(), language.joint_names.back()));
    }
    place_[i] = found - names.begin();
  }
  inverse_ = convention_.matrix.inverse();
}

SixJoints ControllerJoints::urdf(const SixJoints& values) const {
  SixJoints placed;
  for (std::size_t i = 0; i < place_.size(); ++i) {
    placed[place_[i]] = values[static_cast<Index>(i)];
  }
  return convention_.matrix * placed + convention_.offset;
}

SixJoints ControllerJoints::controller(const SixJoints& q) const {
  const SixJoints placed = inverse_ * (q - convention_.offset);
  SixJoints values;
  for (std::size_t i = 0; i < place_.size(); ++i) {
    values[static_cast<Index>(i)] = placed[place_[i]];
  }
  return values;
}

}  // namespace kdl_calibration
