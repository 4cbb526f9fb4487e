#pragma once

// Where the calibrated arm really goes, effects included, and how well that is known.
//
//     const CalibratedArm arm = load_calibration("result.json", robot).arm();
//     const PredictedPoint p = arm.predict(q, "A");
//     std::cout << p.position.transpose() << " m, within " << p.radius_95 << " m\n";

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <string>
#include <vector>

#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

struct PredictionBasis;

/// B: the robot's base. W: the frame of the measuring device, in which the measurements are.
enum class PredictionFrame { base, measuring };

/// Predicted position of a target and its uncertainty, in the frame that was asked for.
struct PredictedPoint {
  Eigen::Vector3d position;         ///< [m]
  Eigen::Matrix3d covariance;       ///< [m^2] by the parameters alone; infinite where they are not determined
  double radius_95 = 0.0;           ///< [m] of the sphere that holds a new measured point with 95 %
  bool outside = false;             ///< outside the measured region: the radius does not hold there
  double degrees_of_freedom = 0.0;  ///< of the radius
};

/// Cheap to copy. Its functions may be called from several threads. Each throws InputError for another number of joint
/// values, values that are not finite, a mimic joint that does not follow its leader, and an unknown target. Joint
/// values are those of measurements: one per moving joint of the chain, mimic joints included, in the URDF's convention
/// [rad or m].
class CalibratedArm {
public:
  /// Throws InputError for effects of measured torques, as the pose then depends on more than the joint values.
  explicit CalibratedArm(std::shared_ptr<const PredictionBasis> basis);
  // Moving copies, so that there is no empty one.
  CalibratedArm(const CalibratedArm&) = default;
  CalibratedArm& operator=(const CalibratedArm&) = default;
  ~CalibratedArm() = default;

  std::vector<std::string> joints() const;
  std::vector<std::string> targets() const;

  /// X_BF, the flange in the base frame. With up to 32 joints it allocates nothing, except to resize `jacobian`.
  Eigen::Isometry3d flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q) const;
  /// The same; fills `jacobian` (6 x joints) with the flange's twist in the base frame per unit of each joint value:
  /// linear velocity of the flange's origin, then angular velocity. Effects included (error below 1e-8).
  Eigen::Isometry3d flange_pose(const Eigen::Ref<const Eigen::VectorXd>& q,
                                Eigen::Matrix<double, 6, Eigen::Dynamic>& jacobian) const;

  /// If the measurements had several stations, the measuring frame is that of the named `station`. In the base frame
  /// the uncertainty is that of the arm alone, or contains that of the base at a named station. Also throws InputError
  /// for an unknown station, for the measuring frame without its station, and where the result file holds no
  /// covariance: of version 0.1, or with more than 300 parameters.
  PredictedPoint predict(const Eigen::Ref<const Eigen::VectorXd>& q, const std::string& target,
                         PredictionFrame frame = PredictionFrame::base, const std::string& station = {}) const;

  /// The region of the measurements: least and largest value of each joint, and 5 % beyond [rad or m]. Empty if the
  /// result does not state it (version 0.1).
  const JointRanges& measured_ranges() const;
  /// The largest motion [m] of a target at `q` by parameters that the measurements do not determine, if none of them
  /// changes by more than 1 mm or 1 mrad. 0 if all are determined, or if the result does not state them (no
  /// covariance).
  double undetermined_motion(const Eigen::Ref<const Eigen::VectorXd>& q) const;

  /// Names of the stations if there are several, single coordinates, or points that are all on one line; otherwise
  /// empty.
  std::vector<std::string> stations() const;
  /// X_WB, the base in the frame of the measuring device, of several stations at the named one. Throws InputError as
  /// `predict` does.
  Eigen::Isometry3d base(const std::string& station = {}) const;

private:
  struct Parts;
  std::shared_ptr<const Parts> parts_;
};

}  // namespace kdl_calibration
