#include "kdl_calibration/validation.hpp"

#include <utility>

#include "estimation/input_check.hpp"
#include "estimation/prediction.hpp"
#include "interface/calibration_parts.hpp"
#include "model/parameters.hpp"
#include "validation/registered_errors.hpp"

namespace kdl_calibration {
namespace {

PositionErrors errors_of(const ErrorModel& arm, const Estimate& geometry, const Measurements& measurements,
                         const KnownFrames& known) {
  const ErrorModel model = at_stations_of(measurements, arm);
  check(measurements, model);
  check(known, measurements);
  RegisteredErrors errors =
      registered_errors(flange_poses(model, geometry, measurements.joint_values, measurements.signals), measurements,
                        rows_to_register(measurements), known);
  return {.all = errors.all,
          .train = errors.train,
          .test = errors.test,
          .all_means = errors.all_means,
          .train_means = errors.train_means,
          .test_means = errors.test_means,
          .iso_9283 = errors.iso,
          .frames = std::move(errors.registration.frames),
          .ambiguity = std::move(errors.registration.message)};
}

}  // namespace

PositionErrors validate(const Robot& robot, const Measurements& measurements, const KnownFrames& known) {
  const ErrorModel model = complete_model(robot);
  const Eigen::VectorXd nominal = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  return errors_of(model, {.errors = nominal, .frames = {}, .effects = {}}, measurements, known);
}

PositionErrors validate(const Calibration& calibration, const Measurements& measurements, const KnownFrames& known) {
  return errors_of(calibration.parts().model, calibration.parts().estimate, measurements, known);
}

}  // namespace kdl_calibration
