#include "kdl_calibration/calibrated_arm.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cstddef>
#include <optional>
#include <utility>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "calibration/point_predictor.hpp"
#include "effects/arm_kinematics.hpp"
#include "interface/calibration_parts.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {

void require_joint_values(const Eigen::Ref<const Eigen::VectorXd>& q, const std::vector<MovingJoint>& joints) {
  require_count("joint values", q.size(), joints.size());
  require_finite("a joint value", q.allFinite());
  if (const std::optional<std::size_t> follower = follower_astray(joints, q)) {
    const Mimic& mimic = *joints[*follower].mimic;
    refuse_input("the value of joint " + shown(joints[*follower].name) + " is not that of a follower",
                 fmt::format("{} * {}'s + {}", mimic.multiplier, joints[mimic.leader].name, mimic.offset));
  }
}

struct CalibratedArm::Parts {
  explicit Parts(std::shared_ptr<const PredictionBasis> of)
      : basis(std::move(of)),
        kinematics(basis->model, basis->estimate.errors, basis->estimate.effects),
        predictor(*basis) {}

  std::shared_ptr<const PredictionBasis> basis;
  ArmKinematics kinematics;
  PointPredictor predictor;
};

CalibratedArm::CalibratedArm(std::shared_ptr<const PredictionBasis> basis) {
  if (!basis) {
    refuse_input("an arm of nothing", "that of a calibration");
  }
  parts_ = std::make_shared<const Parts>(std::move(basis));
}

std::vector<std::string> CalibratedArm::joints() const {
  std::vector<std::string> names;
  for (const MovingJoint& joint : parts_->basis->model.joints) {
    names.push_back(joint.name);
  }
  return names;
}

std::vector<std::string> CalibratedArm::targets() const {
  std::vector<std::string> names;
  for (const TargetFrame& target : parts_->basis->estimate.frames.targets) {
    names.push_back(target.name);
  }
  return names;
}

Eigen::Isometry3d CalibratedArm::flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q) const {
  require_joint_values(q, parts_->basis->model.joints);
  return parts_->kinematics.flange_pose(q);
}

Eigen::Isometry3d CalibratedArm::flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q, Matrix6Xd& jacobian) const {
  require_joint_values(q, parts_->basis->model.joints);
  return parts_->kinematics.flange_pose(q, jacobian);
}

namespace {

// The index of the named station; none if the model has one station or no name is given.
std::optional<std::size_t> station_named(const ErrorModel& model, const std::string& name) {
  if (name.empty()) {
    return std::nullopt;
  }
  const auto found = std::find(model.stations.begin(), model.stations.end(), name);
  if (!model.has_undetermined_bases && model.stations == std::vector{name}) {
    return std::nullopt;  // the only one, by its name
  }
  if (!model.has_undetermined_bases || found == model.stations.end()) {
    refuse_input("station " + shown(name) + " was not measured", model.has_undetermined_bases
                                                                     ? "one of " + comma_separated(model.stations)
                                                                     : "none, as all was measured from one place");
  }
  return static_cast<std::size_t>(found - model.stations.begin());
}

std::optional<std::size_t> measuring_station(const ErrorModel& model, const std::string& name) {
  if (model.has_undetermined_bases && model.stations.size() == 1 && name.empty()) {
    return 0;
  }
  if (model.has_undetermined_bases && name.empty()) {
    refuse_input("the measuring frame without its station", "one of " + comma_separated(model.stations));
  }
  return station_named(model, name);
}

}  // namespace

std::vector<std::string> CalibratedArm::stations() const {
  const ErrorModel& model = parts_->basis->model;
  return model.has_undetermined_bases ? model.stations : std::vector<std::string>();
}

PredictedPoint CalibratedArm::predict(const Eigen::Ref<const Eigen::VectorXd>& q, const std::string& target,
                                      PredictionFrame frame, const std::string& station) const {
  const PredictionBasis& basis = *parts_->basis;
  require_joint_values(q, basis.model.joints);
  const std::vector<std::string> names = targets();
  const auto place = std::find(names.begin(), names.end(), target);
  if (place == names.end()) {
    refuse_input("target " + shown(target) + " was not calibrated", "one of " + comma_separated(names));
  }
  if (basis.covariance.rows() != basis.free.size() || basis.region.joints.empty()) {
    refuse_input("the result lacks what the uncertainty of a prediction needs",
                 "one of version 0.2 or later with at most 300 parameters");
  }
  const std::optional<std::size_t> from = frame == PredictionFrame::measuring ? measuring_station(basis.model, station)
                                                                              : station_named(basis.model, station);
  const PointWithCovariance point =
      parts_->predictor.points(q, {}, from)[static_cast<std::size_t>(place - names.begin())];
  PredictedPoint result{.position = point.position_W,
                        .covariance = point.covariance,
                        .radius_95 = point.new_point.radius_95,
                        .outside = point.outside,
                        .degrees_of_freedom = point.new_point.degrees_of_freedom};
  if (frame == PredictionFrame::base) {
    result.position = point.position;
    if (point.covariance.allFinite()) {
      const Eigen::Matrix3d R_BW = basis.estimate.frames.base(from.value_or(0)).linear().transpose();
      result.covariance = R_BW * point.covariance * R_BW.transpose();
    }
  }
  return result;
}

const JointRanges& CalibratedArm::measured_ranges() const { return parts_->basis->region.joints; }

double CalibratedArm::undetermined_motion(const Eigen::Ref<const Eigen::VectorXd>& q) const {
  require_joint_values(q, parts_->basis->model.joints);
  return parts_->predictor.undetermined_motion(q);
}

Eigen::Isometry3d CalibratedArm::base(const std::string& station) const {
  const PredictionBasis& basis = *parts_->basis;
  return basis.estimate.frames.base(measuring_station(basis.model, station).value_or(0));
}

}  // namespace kdl_calibration
