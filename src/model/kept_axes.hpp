#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

const char* to_string(KeptAxes kept);

/// Neighbouring axes from joint `first` on.
struct AxisRun {
  std::size_t first = 0;
  std::size_t count = 0;

  bool operator==(const AxisRun&) const = default;
  std::size_t last() const { return first + count - 1; }
};

/// How the axes of the nominal robot stand to each other, as far as it is kept.
struct AxisRelations {
  std::vector<AxisRun> parallel;
  std::vector<AxisRun> meeting;  ///< in a point
};

/// Throws OptionError where axes are only nearly parallel or nearly meet, and where there are none to keep.
AxisRelations axis_relations(const std::vector<MovingJoint>& joints, KeptAxes kept);

/// The names of their joints.
std::vector<std::vector<std::string>> joint_names(const std::vector<AxisRun>& runs,
                                                  const std::vector<MovingJoint>& joints);

/// Which errors a link may have, in the frame of the joint at its far end.
struct LinkErrors {
  bool translations = true;      ///< but along the link's own axis
  bool own_translation = false;  ///< along that axis, where it is one of the frame's
  bool rotations = true;
  KDL::Vector pivot;  ///< about which they act, on the axis of the frame's joint
};

/// The model with the errors that part its kept axes as well, about the same points, and all errors in it: those are 0.
struct FreeAxesModel {
  ErrorModel model;
  Eigen::VectorXd errors;
};
FreeAxesModel with_free_axes(const ErrorModel& model, const Eigen::VectorXd& errors);

/// One for each link from the base to the last. The axes keep their relations for finite values of the errors that
/// remain, which are as many as the relations leave:
/// - A rotation of a link between parallel axes would tilt them. About their direction it is an offset of either joint.
/// - Between axes that meet in the pivot, rotations about it keep that point on both. It moves along the first axis of
///   the run by errors of the links before, and along the last one by `own_translation` of the link behind.
std::vector<LinkErrors> link_errors(const std::vector<MovingJoint>& joints, KeptAxes kept);

}  // namespace kdl_calibration
