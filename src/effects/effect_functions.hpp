#pragma once

// Raw values of the effects at joint values, before mean and scale are applied.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <memory_resource>
#include <set>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "measurements/drive_signals.hpp"

namespace kdl_calibration {

/// Joint frames of the nominal robot in the base frame. Per joint: the axes across it and its own as columns, before
/// its motion, and the frame after its motion; the tip's frame last.
struct JointFrames {
  std::pmr::vector<Eigen::Matrix3d> axes;
  std::pmr::vector<Eigen::Isometry3d> moved;

  Eigen::Vector3d axis(std::size_t joint, EffectAxis axis = EffectAxis::own) const;
};
JointFrames joint_frames(const ErrorModel& model, const Eigen::Ref<const Eigen::VectorXd>& q,
                         std::pmr::memory_resource* memory = std::pmr::get_default_resource());
/// Frames for every column of `joint_values` (joints x N).
std::vector<JointFrames> joint_frames_of_all(const ErrorModel& model, const Eigen::MatrixXd& joint_values);

/// Torque about the joint's axis (force along it for a prismatic joint) of equal masses at all later joint frames and
/// the tip, with g = 1.
double load_torque(const ErrorModel& model, std::size_t joint, double mass, const JointFrames& frames);

/// One configuration: joint values, joint frames of the nominal arm, and the column of the signals.
struct Stop {
  Eigen::Ref<const Eigen::VectorXd> q;
  const JointFrames& frames;
  const DriveSignals& signals;
  Eigen::Index column = 0;
};
/// The function of the term at a configuration; NaN if it needs an unknown direction of approach. Throws InputError if
/// it needs an unknown torque.
double raw_value(const ErrorModel& model, const EffectTerm& term, const Stop& stop);

/// N configurations, with `q` joints x N.
struct Stops {
  const Eigen::MatrixXd& q;
  const DriveSignals& signals;
  std::vector<JointFrames> frames;
};
Eigen::VectorXd raw_values(const ErrorModel& model, const EffectTerm& term, const Stops& stops);

/// All columns of the caller's own function: N x K for joint values joints x N. Throws InputError for another number of
/// rows, no column, and values that are not finite.
Eigen::MatrixXd own_columns(const std::string& effect, const OwnColumns& columns, const Eigen::MatrixXd& joint_values);
/// The same of any function; `what` names it in messages: "effects.own: droop".
Eigen::MatrixXd checked_columns(const std::string& what, const OwnColumns& columns,
                                const Eigen::MatrixXd& joint_values);
/// The same. Throws InputError if a row depends on the others, such as on their mean: it would be another one in every
/// prediction.
Eigen::MatrixXd columns_by_row(const std::string& what, const OwnColumns& function,
                               const Eigen::MatrixXd& joint_values);
/// The joint that a function of the caller's own moves. Throws InputError if the robot has none of this name.
std::size_t joint_moved_by(const std::string& what, const std::string& joint, const ErrorModel& model);
/// Throws OptionError for a name that is no word or among `others`, to which it is added, and for a missing function.
void require_named(const char* option, const std::string& name, const OwnColumns& function,
                   std::set<std::string>& others);
/// The function's own column of them.
Eigen::VectorXd own_values(const OwnFunction& own, const Eigen::MatrixXd& columns);

constexpr double kTableBeyond = 2.5;  ///< extent of a table beyond each end of the measured range, in lengths

}  // namespace kdl_calibration
