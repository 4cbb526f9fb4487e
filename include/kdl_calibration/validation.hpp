#pragma once

// How well a geometry explains measurements, and whether these are to be trusted: base and targets are registered,
// nothing else is fitted. What remains after a fit, row by row. And whether a robot has changed between two
// calibrations.
//
//     const PositionErrors errors = validate(load_robot("calibrated.urdf"), measurements);
//     std::cout << errors.all.rms << " m\n";
//     for (const Doubt& doubt : errors.doubts) std::cerr << doubt.message << "\n";
//     if (compare(before, after).has_changed()) std::cout << "measure this robot again\n";

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/accuracy.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

struct PositionErrors {
  ErrorStatistics all;
  ErrorStatistics train;
  ErrorStatistics test;  ///< predicted only; if there are no other rows, base and targets are registered to them
  /// The same of the means of repeats, where there are repeats.
  std::optional<ErrorStatistics> all_means;
  std::optional<ErrorStatistics> train_means;
  std::optional<ErrorStatistics> test_means;
  Iso9283 iso_9283;       ///< over all rows
  Frames frames;          ///< of the measurements' stations and targets, in their order
  std::string ambiguity;  ///< why another base would fit about as well; empty if none would
  /// The frames that were not known: "base and targets", "base", "targets", or empty.
  std::string registered;
  int coordinates = 0;  ///< of the distinct points to which they were registered
  int unknowns = 0;     ///< of the registration; `coordinates` minus `unknowns` are the degrees of freedom
  /// [m] By so much all measured distances are too long: the zero of their instrument, found with base and targets.
  double distance_zero = 0.0;
  /// [m] RMS of the registered points, corrected for the unknowns: times sqrt(coordinates / degrees of freedom).
  double rms_corrected = 0.0;
  /// The upper 95 % limit of the true errors is so many times the errors of the registered rows, and of test rows that
  /// only were predicted. Few configurations show little: the targets of one share its error. Infinite if base and
  /// targets may hide all.
  double upper_95_factor = 1.0;
  double upper_95_factor_of_test = 1.0;
  std::vector<std::string> warnings;
  /// Why the figures are not to be trusted: another reading of the data fits much better, or geometric errors cannot
  /// explain the misfit. Other readings are not tried for several stations and single coordinates.
  std::vector<Doubt> doubts;
};

/// The robot as its URDF says. `diagnosis` states the joint conventions that other readings of the data try;
/// without `try_readings` none is tried. Trying them takes most of the time, and calls `progress` meanwhile. Throws
/// InputError: a convention of other joints, measurements of another robot, known frames that were not measured, fewer
/// coordinates than base and targets take.
PositionErrors validate(const Robot& robot, const Measurements& measurements, const KnownFrames& known = {},
                        const DiagnosisOptions& diagnosis = {}, const ProgressFunction& progress = {});
/// The calibrated arm, effects included. Also throws InputError without measured torques that an effect needs.
PositionErrors validate(const Calibration& calibration, const Measurements& measurements, const KnownFrames& known = {},
                        const DiagnosisOptions& diagnosis = {}, const ProgressFunction& progress = {});

/// What remains of one row after the fit.
struct RowResidual {
  Eigen::Vector3d position;  ///< [m] measured minus predicted in W of the row's station, along the measured directions
  /// The same divided by the root of the covariance of one such row (noise and misfit, without those of the
  /// parameters): 1 sigma of each measured direction is 1. Rows of one configuration stay correlated.
  Eigen::Vector3d whitened;
  Eigen::Vector3d rotation;  ///< [rad] of a measured orientation, in the target's frame; zero without one
};

/// Of each row, test rows included, in the order of the measurements. Distances count from the zero that was found.
/// Throws InputError as write_result does.
std::vector<RowResidual> residuals(const Robot& robot, const Measurements& measurements,
                                   const Calibration& calibration);

/// Derivatives of the predicted positions of all rows (along the measured directions, in W of the row's station) by the
/// parameters in the order of Calibration::estimated(): 3M x parameters [m per m, rad or unit of an effect]. Throws
/// InputError as write_result does.
Eigen::MatrixXd position_jacobian(const Robot& robot, const Measurements& measurements, const Calibration& calibration);

/// Change of a parameter of the earlier calibration, in its gauge. SI units.
struct ParameterChange {
  std::string name;
  std::string joint;  ///< URDF joint whose origin includes it; empty for effects, and if no origin does
  std::string unit;   ///< "m" or "rad"; empty for effects
  double before = 0.0;
  double change = 0.0;
  double std = 0.0;        ///< 1 sigma of the change
  double explained = 0.0;  ///< share of chi_square that a change of this parameter alone explains
};

/// The difference of two calibrations of one robot, in the joint ranges that both measured.
struct Comparison {
  double chi_square = 0.0;
  double degrees_of_freedom = 0.0;               ///< number of compared directions
  double noise_degrees_of_freedom = 0.0;         ///< of the noise and misfit in both, by groups of configurations
  double misfit_factor = 1.0;                    ///< expectation of chi_square / degrees_of_freedom, by the misfit
  double p_value = 1.0;                          ///< of an unchanged robot
  std::vector<ParameterChange> parameters = {};  ///< geometric errors and effects of the earlier calibration
  /// Joints whose zero may have changed without a trace: the first, unless both calibrations hold the same base, and
  /// the last, unless both hold the same targets.
  std::vector<std::string> unseen_zeros = {};
  std::vector<std::string> not_compared = {};  ///< parameters that only one of the calibrations determines
  bool same_measurements = false;              ///< both are of the same rows: they show no change
  ErrorStatistics flange = {};                 ///< [m] change of the flange's position, base and tool aligned
  double flange_sigma = 0.0;                   ///< [m] RMS 3D 1 sigma of this change

  static constexpr double kCertain = 1e-3;
  bool has_changed() const { return p_value < kCertain; }
};

/// Compares what two independent calibrations say of the arm, whatever their gauges. Base and targets are not part of
/// it, and may have moved, unless both calibrations hold them at the same place. The misfit is not taken for white
/// noise: each configuration has its own. Throws InputError: calibrations of different robots, one that is not trusted,
/// one without covariance, a second one that continues an earlier result, effects of gravity in different directions.
Comparison compare(const Calibration& before, const Calibration& after);

}  // namespace kdl_calibration
