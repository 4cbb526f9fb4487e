#include "kdl_calibration/result_file.hpp"

#include <memory>
#include <string>
#include <utility>

#include "base/text_file.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/report_page.hpp"
#include "kdl_calibration/urdf_export.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/report_page.hpp"
#include "results/result_json.hpp"
#include "results/saved_calibration.hpp"

namespace kdl_calibration {
namespace {

std::string result_of(const Robot& robot, const Measurements& measurements, const Calibration& calibration) {
  const FittedCalibration& fitted = fitted_calibration(robot, measurements, calibration);
  return result_json(robot, measurements, fitted.settings, fitted.result);
}

}  // namespace

void write_result(const std::filesystem::path& file, const Robot& robot, const Measurements& measurements,
                  const Calibration& calibration) {
  replace_file(file, result_of(robot, measurements, calibration), robot.source);
}

void write_report(const std::filesystem::path& file, const Robot& robot, const Measurements& measurements,
                  const Calibration& calibration) {
  const std::string result = result_of(robot, measurements, calibration);
  const FittedCalibration& fitted = *calibration.parts().fitted;
  replace_file(file,
               calibration_page({.result = result,
                                 .source = "the result",
                                 .robot = &robot,
                                 .measurements = &measurements,
                                 .known = known_frames(fitted.settings.parameters),
                                 .plan_command = {}}),
               robot.source);
}

std::string calibrated_urdf(const Robot& robot, const Calibration& calibration) {
  require_same_robot(robot, calibration);
  return calibrated_urdf(robot, calibration.parts().basis.model, calibration.parts().urdf_errors);
}

void write_urdf(const std::filesystem::path& file, const Robot& robot, const Calibration& calibration) {
  replace_file(file, calibrated_urdf(robot, calibration), robot.source);
}

Calibration load_calibration(const std::filesystem::path& file, const Robot& robot) {
  SavedCalibration saved = read_calibration(file, robot);
  return Calibration(
      std::make_shared<CalibrationParts>(CalibrationParts{.robot = hash_of(robot),
                                                          .verdict = saved.verdict,
                                                          .doubts = std::move(saved.doubts),
                                                          .warnings = std::move(saved.warnings),
                                                          .accuracy = saved.accuracy,
                                                          .parameters = std::move(saved.parameters),
                                                          .basis = {.model = std::move(saved.model),
                                                                    .estimate = std::move(saved.estimate),
                                                                    .free = std::move(saved.free),
                                                                    .covariance = std::move(saved.covariance),
                                                                    .candidates = std::move(saved.candidates),
                                                                    .undetermined = std::move(saved.undetermined),
                                                                    .noise = saved.noise,
                                                                    .region = std::move(saved.region)},
                                                          .urdf_errors = std::move(saved.urdf_errors),
                                                          .fitted = {}}));
}

}  // namespace kdl_calibration
