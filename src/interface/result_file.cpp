#include "kdl_calibration/result_file.hpp"

#include <memory>
#include <string>
#include <utility>

#include "base/whole_files.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/kinematic_export.hpp"
#include "kdl_calibration/report_page.hpp"
#include "results/report_page.hpp"
#include "results/result_json.hpp"
#include "results/saved_calibration.hpp"

namespace kdl_calibration {
namespace {

// Replaces the file, but none of those that were read.
void write_file(const std::filesystem::path& file, const std::string& text, const Robot& robot,
                const std::string& measurements = {}) {
  write_whole(
      {{.option = {}, .path = file.string(), .text = text}},
      {{.option = "this calibration", .path = robot.source}, {.option = "this calibration", .path = measurements}},
      true);
}

std::string result_of(const Robot& robot, const Measurements& measurements, const Calibration& calibration) {
  return result_json(robot, measurements, fit_of(robot, measurements, calibration));
}

// Functions of the caller's own, also of an earlier result that this one continues.
std::vector<OwnEffect> own_effects(const ErrorModel& model) {
  std::vector<OwnEffect> effects;
  for (const EffectTerm& term : model.effects) {
    const auto* const own = std::get_if<OwnFunction>(&term.function);
    if (own != nullptr && (effects.empty() || effects.back().name != own->effect)) {
      effects.push_back({.name = own->effect, .joint = term.joint, .axis = term.axis, .columns = own->columns});
    }
  }
  return effects;
}

}  // namespace

void write_result(const std::filesystem::path& file, const Robot& robot, const Measurements& measurements,
                  const Calibration& calibration) {
  write_file(file, result_of(robot, measurements, calibration), robot, measurements.source);
}

void write_report(const std::filesystem::path& file, const Robot& robot, const Measurements& measurements,
                  const Calibration& calibration) {
  const std::string result = result_of(robot, measurements, calibration);
  const CalibrationSettings& settings = calibration.parts().fitted->settings;
  write_file(file,
             calibration_page({.result = result,
                               .source = "the result",
                               .robot = &robot,
                               .measurements = &measurements,
                               .known = settings.parameters.known,
                               .convention = settings.diagnosis.convention,
                               .plan_command = {},
                               .own = own_effects(calibration.parts().model)}),
             robot, measurements.source);
}

void write_urdf(const std::filesystem::path& file, const Robot& robot, const Calibration& calibration) {
  write_file(file, calibrated_urdf(robot, calibration), robot);
}

Calibration load_calibration(const std::filesystem::path& file, const Robot& robot, const std::vector<OwnEffect>& own) {
  require_as_parsed(robot);
  return Calibration(std::make_shared<CalibrationParts>(read_calibration(file, robot, own)));
}

}  // namespace kdl_calibration
