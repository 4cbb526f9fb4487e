#pragma once

#include <CLI/App.hpp>
#include <limits>
#include <optional>
#include <string>

#include "kdl_calibration/convention_trial.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration::cli {

/// --measurements, --joint-convention, --known-base, --known-targets
struct MeasurementArguments {
  std::string measurements;
  std::string joint_convention;
  std::string known_base;
  std::string known_targets;
};
void add_measurement_options(CLI::App& app, MeasurementArguments& arguments);

Measurements read(const MeasurementArguments& arguments, const Robot& robot);

/// --noise-tracker: nothing where it is not given. Throws InputError where it is not four numbers.
void add_tracker_noise(CLI::App& app, std::vector<double>& values);
std::optional<TrackerNoise> tracker_noise(const std::vector<double>& values);

/// What is known of base and targets. Throws InputError where none of the known targets was measured.
RegistrationOptions known_frames(const MeasurementArguments& arguments, const Measurements& measurements);

/// For measurements whose misfit is absurd: a sentence that names the joint convention (beside the one given, or beside
/// the robots that come with kdlcal) or the joint with the opposite sign that fits. Empty where none does, and where
/// `fitted` [m], the RMS of a calibration with the reading at hand, is better.
std::string better_convention(const MeasurementArguments& arguments, const ErrorModel& model,
                              const Measurements& measurements, const Unknowns& free,
                              double fitted = std::numeric_limits<double>::infinity());

}  // namespace kdl_calibration::cli
