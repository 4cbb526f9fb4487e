#include "kdl_calibration/validation.hpp"

#include <fmt/core.h>
#include <utility>

#include "diagnosis/alternative_readings.hpp"
#include "estimation/input_check.hpp"
#include "estimation/prediction.hpp"
#include "interface/calibration_parts.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/parameters.hpp"
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
  if (!are_points_of_one_station(rows)) {
    errors.warnings.push_back(std::string("other readings of the data were not tried (") +
                              (has_single_coordinates(rows) ? "single coordinates)" : "several stations)"));
    return;
  }
  model.has_undetermined_bases = false;  // a rotation that the points do not determine stays as registered
  for (const AlternativeReading& reading : alternative_readings_of_nominal(model, rows, estimate, options)) {
    if (reading.cause == Cause::joint_function) {  // normal for a robot that is not calibrated
      continue;
    }
    if (reading.doubt) {
      errors.doubts.push_back(reading.as_doubt());
    } else {
      errors.warnings.push_back(reading.message);
    }
  }
}

PositionErrors errors_of(const PredictionBasis& arm, const Measurements& measurements, const KnownFrames& known,
                         const DiagnosisOptions& diagnosis) {
  constexpr double kAbsurd = 0.1;  // of the arm's length: 3 degrees in every joint leave half of that
  require_conventions(diagnosis, arm.model.joints);
  const Measurements rows = rows_to_register(measurements);
  const ErrorModel model = model_at_stations(*TrainingRows(rows), arm.model);
  check(measurements, model);
  check(known, measurements);
  const RegisteredErrors found =
      registered_errors(flange_poses(model, arm.estimate, measurements), measurements, rows, known);
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
                  .others = diagnosis.other_conventions},
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
                        const DiagnosisOptions& diagnosis) {
  return errors_of(nominal_basis(robot), measurements, known, diagnosis);
}

PositionErrors validate(const Calibration& calibration, const Measurements& measurements, const KnownFrames& known,
                        const DiagnosisOptions& diagnosis) {
  return errors_of(calibration.parts(), measurements, known, diagnosis);
}

}  // namespace kdl_calibration
