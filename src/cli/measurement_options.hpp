#pragma once

#include <CLI/App.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cli/options.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration::cli {

/// --measurements, --joints-file, --point-names, --exclude, --orientation, --joint-convention, --known-base,
/// --known-targets
struct MeasurementArguments {
  std::string measurements;
  std::string joints_file;
  std::string point_names;
  std::vector<std::string> exclude;
  std::string orientation;
  std::string joint_convention;
  std::vector<std::string> known_bases;  // FILE or STATION=FILE
  std::string known_targets;
};
void add_measurement_options(CLI::App& app, MeasurementArguments& arguments);
/// Of these --joints-file, --point-names, --exclude and --orientation, beside measurements that `option` names.
void add_reading_options(CLI::App& app, const std::string& option, MeasurementArguments& arguments);
/// The options beside the files that say how measurements are read, with their values.
std::vector<std::pair<std::string, std::string>> reading_options(const MeasurementArguments& arguments);
FileRoles files_of(const MeasurementArguments& arguments);

Measurements read(const MeasurementArguments& arguments, const Robot& robot);

/// --noise-tracker: empty if not given. Throws InputError unless it has four numbers.
void add_tracker_noise(CLI::App& app, std::vector<double>& values);
std::optional<TrackerNoise> tracker_noise(const std::vector<double>& values);

/// Known base and targets. Throws InputError if none of the known targets was measured.
KnownFrames known_frames(const MeasurementArguments& arguments, const Measurements& measurements);

/// Other conventions that the user may have meant: files beside the given one and beside the bundled robots.
std::vector<JointConvention> conventions_at_hand(const MeasurementArguments& arguments);

}  // namespace kdl_calibration::cli
