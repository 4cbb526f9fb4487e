#pragma once

// A calibration: what was found, how far to trust it, and the robot that results.
//
//     const Calibration found = calibrate(robot, measurements);
//     std::cout << found.accuracy().train.after.rms << " m, Tx1 " << found.error("Tx1") << " ± " << found.std("Tx1");
//     KDL::Chain chain = found.urdf_chain();

#include <Eigen/Core>
#include <kdl/chain.hpp>
#include <memory>
#include <string>
#include <vector>

#include "kdl_calibration/accuracy.hpp"
#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

struct CalibrationParts;

/// One line of the result: a geometric, base or target parameter, or an effect. SI units.
struct ParameterEstimate {
  std::string name;
  std::string joint;  ///< URDF joint whose origin includes it; empty for base and targets
  ParameterKind kind = ParameterKind::translation;
  std::string axis;  ///< "x", "y", "z"; empty for the axis of a skewed joint
  double nominal = 0.0;
  double value = 0.0;  ///< nominal + error
  double error = 0.0;
  double std = 0.0;                 ///< 1 sigma; 0 where fixed, infinite where not determined
  double degrees_of_freedom = 0.0;  ///< of Student's t for the confidence interval
  bool identifiable = false;
  bool gauge = false;  ///< held fixed: not determined by any measurement, or by these
};

/// Made by calibrate() or load_calibration(). Cheap to copy.
class Calibration {
public:
  explicit Calibration(std::shared_ptr<const CalibrationParts> parts);
  // Moving copies, so that there is no empty one.
  Calibration(const Calibration&) = default;
  Calibration& operator=(const Calibration&) = default;
  ~Calibration() = default;

  Verdict verdict() const;
  /// Whether the result may be used, at least where it was measured.
  bool trusted() const { return verdict() != Verdict::not_trusted; }
  /// Why it is not to be trusted; if it is trusted where it was measured, what is not known elsewhere.
  const std::vector<Doubt>& doubts() const;
  const std::vector<std::string>& warnings() const;
  /// The warnings with their causes, in the same order. Empty if the calibration was read from a file that states no
  /// causes, such as one of version 0.1.
  const std::vector<Remark>& remarks() const;

  /// Of the full model. `rigid` says what the exported URDF alone does.
  const Accuracy& accuracy() const;

  /// Base, targets, geometric errors and effects: those that were estimated, and those held by the gauge.
  const std::vector<ParameterEstimate>& parameters() const;
  /// The parameter "Tx1", "base.Rz", "A.x", "gravity.2.3x". Throws InputError for an unknown name.
  const ParameterEstimate& parameter(const std::string& name) const;
  double error(const std::string& name) const { return parameter(name).error; }
  double std(const std::string& name) const { return parameter(name).std; }

  /// Names of the estimated parameters, and their covariance in that order; SI units, infinite where not determined.
  /// Here the base's errors are a small motion in the base's own frame, X_WB · motion; `parameters()` and `std` have
  /// its origin along the axes of W.
  std::vector<std::string> estimated() const;
  const Eigen::MatrixXd& covariance() const;

  /// The calibration at this temperature and payload instead of the means of the measurements: arm(), Compensator and
  /// others then predict for them. The temperature is that of all links, less those that `link_temperatures` names.
  /// Uncertainties grow with the distance from what was measured. The exported URDF stays that of the means. Throws
  /// InputError where no effect depends on what is stated.
  Calibration at(const Circumstances& circumstances) const;

  /// The arm with all effects: where it really goes. Throws InputError as CalibratedArm does.
  CalibratedArm arm() const;

  /// The rigid chain of the exported URDF, for KDL's solvers: where effects were found, it is fitted without them;
  /// where the calibration does not improve on the nominal robot, it is the nominal one. Throws InputError for errors
  /// behind the last joint that no fixed joint can carry.
  KDL::Chain urdf_chain() const;

  /// For the functions of this library that write it.
  const CalibrationParts& parts() const { return *parts_; }

private:
  std::shared_ptr<const CalibrationParts> parts_;
};

}  // namespace kdl_calibration
