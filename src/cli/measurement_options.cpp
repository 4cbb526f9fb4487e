#include "cli/measurement_options.hpp"

#include <algorithm>
#include <filesystem>
#include <set>

#include "base/text.hpp"
#include "cli/data_dir.hpp"
#include "cli/frames.hpp"
#include "cli/joined_files.hpp"
#include "cli/options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/same_poses.hpp"

namespace kdl_calibration::cli {

namespace fs = std::filesystem;

void add_measurement_options(CLI::App& app, MeasurementArguments& arguments) {
  add_file(app, "--measurements", arguments.measurements, "Measured points or poses (CSV)")->required();
  CLI::Option* joints = add_file(app, "--joints-file", arguments.joints_file,
                                 "The joint values of the configurations, where --measurements has points alone (CSV)");
  app.add_option("--point-names", arguments.point_names,
                 "How those points are named, such as C{configuration}_{target}")
      ->type_name("PATTERN")
      ->needs(joints);
  add_list(app, "--exclude", arguments.exclude, "Configurations, or points of them, that are left out")
      ->type_name("CONFIGURATION[:TARGET],...");
  add_file(app, "--joint-convention", arguments.joint_convention,
           "How the controller's joint values become the URDF's (JSON)");
  add_file(app, "--known-base", arguments.known_base,
           "The base in the measuring device's frame, from a result or {\"position\", \"quaternion_wxyz\"}");
  add_file(app, "--known-targets", arguments.known_targets,
           "Targets in the flange frame, from a result or {\"targets\": [{\"name\", \"position\"}]}");
}

FileRoles files_of(const MeasurementArguments& arguments) {
  return {{"measurements", arguments.measurements},
          {"joints-file", arguments.joints_file},
          {"joint-convention", arguments.joint_convention},
          {"known-base", arguments.known_base},
          {"known-targets", arguments.known_targets}};
}

Measurements read(const MeasurementArguments& arguments, const Robot& robot) {
  const std::optional<JointConvention> convention = convention_of(arguments.joint_convention);
  const JointConvention* used = convention ? &*convention : nullptr;
  const Measurements measurements = arguments.joints_file.empty()
                                        ? read_measurements(robot, arguments.measurements, used)
                                        : read_joined(robot,
                                                      {.points = arguments.measurements,
                                                       .joint_values = arguments.joints_file,
                                                       .names = arguments.point_names},
                                                      used);
  return with_poses_joined(arguments.exclude.empty() ? measurements : without_rows(measurements, arguments.exclude));
}

void add_tracker_noise(CLI::App& app, std::vector<double>& values) {
  add_list(app, "--noise-tracker", values,
           "A tracker's own 1 sigma: range [m], its growth [m/m], transverse [m], its growth [m/m]",
           number_from(0.0, "a number, 0 or more"))
      ->type_name("A,B,C,D");
}

std::optional<TrackerNoise> tracker_noise(const std::vector<double>& values) {
  if (values.empty()) {
    return std::nullopt;
  }
  if (values.size() != 4) {
    throw InputError("--noise-tracker: has " + std::to_string(values.size()) +
                     " values, expected 4: range, range per metre, transverse, transverse per metre");
  }
  if (values[0] <= 0.0 || values[2] <= 0.0) {
    throw InputError("--noise-tracker: the constants of range and transverse error must be above 0");
  }
  return TrackerNoise{
      .range = values[0], .range_per_metre = values[1], .transverse = values[2], .transverse_per_metre = values[3]};
}

RegistrationOptions known_frames(const MeasurementArguments& arguments, const Measurements& measurements) {
  RegistrationOptions options;
  if (!arguments.known_base.empty()) {
    options.known_base = read_base(arguments.known_base);
  }
  if (!arguments.known_targets.empty()) {
    for (TargetFrame& target : read_targets(arguments.known_targets)) {
      const auto& names = measurements.targets;
      if (std::find(names.begin(), names.end(), target.name) != names.end()) {
        options.known_targets.push_back(target);
      }
    }
    if (options.known_targets.empty()) {
      throw InputError(arguments.known_targets + ": targets: none was measured, expected some of " +
                       comma_separated(measurements.targets));
    }
  }
  return options;
}

std::vector<JointConvention> conventions_at_hand(const MeasurementArguments& arguments) {
  const fs::path given = arguments.joint_convention;
  std::vector<fs::path> directories;
  if (!given.empty()) {
    directories.push_back(fs::absolute(given).parent_path());
  }
  try {
    directories.push_back(urdf_dir());
  } catch (const InputError&) {  // no bundled robots: only files beside the given one are tried
  }
  std::set<fs::path> files;
  for (const fs::path& directory : directories) {
    std::error_code error;
    for (const fs::directory_entry& entry : fs::directory_iterator(directory, error)) {
      if (entry.path().extension() == ".json") {
        files.insert(entry.path());
      }
    }
  }
  std::vector<JointConvention> conventions;
  for (const fs::path& file : files) {
    try {
      conventions.push_back(read_joint_convention(file));
    } catch (const InputError&) {  // not a joint convention
    }
  }
  return conventions;
}

}  // namespace kdl_calibration::cli
