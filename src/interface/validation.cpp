#include "kdl_calibration/validation.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "calibration/distance_zero.hpp"
#include "diagnosis/alternative_readings.hpp"
#include "diagnosis/own_alternatives.hpp"
#include "estimation/input_check.hpp"
#include "estimation/prediction.hpp"
#include "estimation/residual_options.hpp"
#include "interface/calibration_parts.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/parameters.hpp"
#include "selection/parameter_selection.hpp"
#include "validation/registered_errors.hpp"

namespace kdl_calibration {
namespace {

// See PositionErrors::registered.
std::string registered(const KnownFrames& known, const Frames& frames) {
  const bool targets = known.targets.size() < frames.targets.size();
  const bool base = known.bases.size() == frames.bases.size();
  return base ? (targets ? "targets" : "") : targets ? "base and targets" : "base";
}

// Warnings about the registration of base and targets.
std::vector<std::string> warnings_of(const Measurements& measurements, const Registration& registration,
                                     const PositionErrors& errors) {
  constexpr int kPlenty = 4;  // coordinates per unknown
  std::vector<std::string> warnings;
  if (!measurements.remark.empty()) {
    warnings.push_back("measurements: " + measurements.remark);
  }
  if (has_only_test_rows(measurements) && !errors.registered.empty()) {
    warnings.push_back(measurements.source + ": no train rows, the test rows place " + errors.registered);
  }
  if (errors.distance_zero != 0.0) {
    warnings.push_back(fmt::format("all distances are taken {} by {:.3f} mm, the zero of their instrument",
                                   errors.distance_zero > 0.0 ? "shorter" : "longer",
                                   std::abs(errors.distance_zero) * 1e3));
  }
  if (registration.ambiguous) {
    warnings.push_back("registration: " + registration.message);
  }
  if (errors.unknowns > 0 && errors.coordinates < kPlenty * errors.unknowns) {
    warnings.push_back(fmt::format("{} took {} of {} coordinates: corrected for that, the rms is {:.4f} mm",
                                   errors.registered, errors.unknowns, errors.coordinates, errors.rms_corrected * 1e3));
  }
  return warnings;
}

// Adds the doubts and warnings by other readings of the registered rows.
void try_readings(ErrorModel model, const Measurements& rows, const Estimate& estimate, const ReadingOptions& options,
                  PositionErrors& errors) {
  const auto add = [&](const AlternativeReading& reading) {
    if (reading.doubt) {
      errors.doubts.push_back(reading.as_doubt());
    } else {
      errors.warnings.push_back(reading.message);
    }
  };
  if (!are_points_of_one_station(rows)) {
    errors.warnings.push_back(std::string("other readings of the data were not tried (") +
                              (has_single_coordinates(rows) ? "single coordinates)" : "several stations)"));
    return;
  }
  model.has_undetermined_bases = false;  // a rotation that the points do not determine stays as registered
  const std::vector<AlternativeReading> all = alternative_readings_of_nominal(model, rows, estimate, options);
  for (const AlternativeReading& reading : all) {
    if (reading.cause != Cause::joint_function) {  // normal for a robot that is not calibrated
      add(reading);
    }
  }
  const std::vector<AlternativeReading> left = untried(options.alternatives, all);
  std::for_each(left.begin(), left.end(), add);
}

// The zero of an instrument for distances, beside base and targets.
double distance_zero(const ErrorModel& model, const Estimate& registered, const Measurements& rows,
                     const KnownFrames& known) {
  if (std::none_of(rows.observations.begin(), rows.observations.end(), is_distance)) {
    return 0.0;
  }
  const std::vector<TargetFrame>& targets = registered.frames.targets;
  const Unknowns free = Unknowns(model, targets, select_parameters(model, targets, {.known = known}).free)
                            .without(UnknownGroup::geometric)
                            .without(UnknownGroup::effects);
  const std::optional<DistanceZero> zero =
      zero_of_distances({.model = model, .measurements = rows, .start = registered, .free = free});
  return zero ? zero->length : 0.0;
}

PositionErrors errors_of(const PredictionBasis& arm, const Measurements& measurements, const KnownFrames& known,
                         const DiagnosisOptions& diagnosis, const ProgressFunction& progress) {
  constexpr double kAbsurd = 0.1;  // of the arm's length: 3 degrees in every joint leave half of that
  require_conventions(diagnosis, arm.model.joints);
  require_one_split(measurements);
  const Measurements all_rows = rows_to_register(measurements);
  const TrainingRows train(all_rows);
  const ErrorModel model = model_at_stations(*train, arm.model);
  check(measurements, model);
  check(known, measurements);
  require_alternatives(diagnosis, model, measurements);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, arm.estimate, measurements);
  RegisteredErrors found = registered_errors(X_BF, measurements, all_rows, known);
  const double zero = distance_zero(
      model, {.errors = arm.estimate.errors, .frames = found.registration.frames, .effects = arm.estimate.effects},
      *train, known);
  const FromZero shorter(all_rows, zero);
  const Measurements& rows = *shorter;
  if (zero != 0.0) {
    found = registered_errors(X_BF, from_zero(measurements, zero), rows, known);
    ++found.freedom.unknowns;
  }
  const Registration& registration = found.registration;
  PositionErrors errors{.all = found.all,
                        .train = found.train,
                        .test = found.test,
                        .all_means = found.all_means,
                        .train_means = found.train_means,
                        .test_means = found.test_means,
                        .iso_9283 = found.iso,
                        .frames = registration.frames,
                        .ambiguity = registration.message,
                        .registered = registered(known, registration.frames),
                        .coordinates = found.freedom.coordinates,
                        .unknowns = found.freedom.spent(),
                        .distance_zero = zero,
                        .rms_corrected = registration.rms * found.freedom.correction(),
                        .upper_95_factor = found.freedom.upper_95(),
                        .upper_95_factor_of_test = found.of_test.upper_95()};
  errors.warnings = warnings_of(measurements, registration, errors);
  if (diagnosis.try_readings) {
    const Estimate estimate{
        .errors = arm.estimate.errors, .frames = registration.frames, .effects = arm.estimate.effects};
    try_readings(model, rows, estimate,
                 {.registration = {.known = known},
                  .used = diagnosis.convention ? &*diagnosis.convention : nullptr,
                  .others = diagnosis.other_conventions,
                  .alternatives = diagnosis.alternatives,
                  .progress = progress},
                 errors);
  }
  if (errors.doubts.empty() && registration.rms > kAbsurd * arm_length(model)) {
    errors.doubts.push_back(
        {.cause = Cause::large_misfit,
         .figures = {{"misfit", registration.rms}, {"reach", arm_length(model)}},
         .message = fmt::format("a misfit of {:.1f} mm is more than geometric errors explain; are units, signs and "
                                "order of the joints right?",
                                registration.rms * 1e3)});
  }
  return errors;
}

}  // namespace

PositionErrors validate(const Robot& robot, const Measurements& measurements, const KnownFrames& known,
                        const DiagnosisOptions& diagnosis, const ProgressFunction& progress) {
  return errors_of(nominal_basis(robot), measurements, known, diagnosis, progress);
}

PositionErrors validate(const Calibration& calibration, const Measurements& measurements, const KnownFrames& known,
                        const DiagnosisOptions& diagnosis, const ProgressFunction& progress) {
  require_circumstances(measurements, calibration.parts().model);
  return errors_of(calibration.parts(), measurements, known, diagnosis, progress);
}

namespace {

// Covariance [m^2] of one measured row about its prediction by the true parameters.
Eigen::Matrix3d covariance_of(const Observation& observation, const Eigen::Vector3d& predicted,
                              const NewPointNoise& noise) {
  const NoiseModel& model = noise.model;
  Eigen::Matrix3d sum = point_covariance(
      model, {.reading = Point{predicted}, .sigma = observation.sigma, .noise = noise.at(station_of(observation))});
  sum.diagonal() += model.common.cwiseAbs2();
  sum *= noise.variance_factor;
  sum.diagonal().array() += model.misfit * model.misfit + model.target_misfit * model.target_misfit;
  return sum;
}

// The symmetric root of the pseudo-inverse.
Eigen::Matrix3d inverse_root(const Eigen::Matrix3d& covariance) {
  constexpr double kNothing = 1e-12;  // of the largest variance
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance);
  const double least = kNothing * solver.eigenvalues().maxCoeff();
  const Eigen::Vector3d roots =
      solver.eigenvalues().unaryExpr([&](double value) { return value > least ? 1.0 / std::sqrt(value) : 0.0; });
  return solver.eigenvectors() * roots.asDiagonal() * solver.eigenvectors().transpose();
}

// The rows of a fit, their distances from the zero that was found, and the poses of target frames in W.
class FittedRows {
public:
  FittedRows(const Measurements& measurements, const CalibrationResult& fitted)
      : rows_(measurements, fitted.distance_zero ? fitted.distance_zero->length : 0.0),
        estimate_(fitted.fit.identification.estimate),
        X_BF_(flange_poses(fitted.model, estimate_, measurements)) {}

  const std::vector<Observation>& rows() const { return (*rows_).observations; }
  Eigen::Isometry3d target(const Observation& observation) const {
    return estimate_.frames.base(station_of(observation)) * X_BF_[static_cast<std::size_t>(observation.configuration)] *
           estimate_.frames.targets[static_cast<std::size_t>(observation.target)].X_FT;
  }

private:
  FromZero rows_;
  const Estimate& estimate_;
  std::vector<Eigen::Isometry3d> X_BF_;
};

}  // namespace

std::vector<RowResidual> residuals(const Robot& robot, const Measurements& measurements,
                                   const Calibration& calibration) {
  const FittedRows fitted(measurements, fit_of(robot, measurements, calibration));
  const NewPointNoise& noise = calibration.parts().noise;
  std::vector<RowResidual> result;
  result.reserve(fitted.rows().size());
  for (const Observation& observation : fitted.rows()) {
    const Eigen::Isometry3d X_WT = fitted.target(observation);
    const Residual rest = residual(observation.reading, X_WT);
    const Eigen::Matrix3d covariance = covariance_of(observation, X_WT.translation(), noise);
    result.push_back({.position = rest.position,
                      .whitened = inverse_root(rest.directions * covariance * rest.directions) * rest.position,
                      .rotation = rest.rotation.value_or(Eigen::Vector3d::Zero())});
  }
  return result;
}

Eigen::MatrixXd position_jacobian(const Robot& robot, const Measurements& measurements,
                                  const Calibration& calibration) {
  const CalibrationResult& result = fit_of(robot, measurements, calibration);
  const FittedRows fitted(measurements, result);
  const PositionPredictor predictor(result.model, result.fit.identification.estimate, result.fit.free);
  Eigen::MatrixXd jacobian(3 * static_cast<Eigen::Index>(fitted.rows().size()), result.fit.free.size());
  std::vector<Matrix3Xd> of_targets;
  std::optional<std::int32_t> configuration;
  Eigen::Index row = 0;
  for (const Observation& observation : fitted.rows()) {
    if (configuration != observation.configuration) {
      configuration = observation.configuration;
      of_targets = predictor.jacobians(measurements, observation.configuration, station_of(observation));
    }
    jacobian.middleRows<3>(row) = directions(observation.reading, fitted.target(observation).translation()) *
                                  of_targets[static_cast<std::size_t>(observation.target)];
    row += 3;
  }
  return jacobian;
}

}  // namespace kdl_calibration
