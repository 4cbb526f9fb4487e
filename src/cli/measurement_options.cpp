#include "cli/measurement_options.hpp"

#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>

#include "base/text.hpp"
#include "cli/data_dir.hpp"
#include "cli/frames.hpp"
#include "cli/joined_files.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_command.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "kdl_calibration/orientation_reading.hpp"
#include "measurements/same_poses.hpp"
#include "measurements/stations.hpp"

namespace kdl_calibration::cli {

namespace fs = std::filesystem;

void add_reading_options(CLI::App& app, const std::string& option, MeasurementArguments& arguments) {
  CLI::Option* joints = add_file(app, "--joints-file", arguments.joints_file,
                                 "The joint values of the configurations, where " + option + " has points alone (CSV)");
  app.add_option("--point-names", arguments.point_names,
                 "How those points are named, such as C{configuration}_{target}")
      ->type_name("PATTERN")
      ->needs(joints);
  add_list(app, "--exclude", arguments.exclude, "Configurations, or points of them, that are left out")
      ->type_name("CONFIGURATION[:TARGET],...");
  add_orientation(app, arguments.orientation);
}

std::vector<std::pair<std::string, std::string>> reading_options(const MeasurementArguments& arguments) {
  std::vector<std::pair<std::string, std::string>> options;
  for (const auto& [name, value] :
       {std::pair{"--point-names", arguments.point_names}, std::pair{"--exclude", comma_separated(arguments.exclude)},
        std::pair{"--orientation", arguments.orientation}}) {
    if (!value.empty()) {
      options.emplace_back(name, value);
    }
  }
  return options;
}

void add_measurement_options(CLI::App& app, MeasurementArguments& arguments) {
  add_file(app, "--measurements", arguments.measurements, "Measured points or poses (CSV)")->required();
  add_reading_options(app, "--measurements", arguments);
  add_file(app, "--joint-convention", arguments.joint_convention,
           "How the controller's joint values become the URDF's (JSON)");
  app.add_option("--known-base", arguments.known_bases,
                 "The base in the measuring device's frame, from a result or {\"position\", \"quaternion_wxyz\"}; of "
                 "several stations A=FILE for each that is known")
      ->type_name("[STATION=]FILE")
      ->allow_extra_args(false);
  add_file(app, "--known-targets", arguments.known_targets,
           "Targets in the flange frame, from a result or {\"targets\": [{\"name\", \"position\"}]}");
}

namespace {

struct KnownBase {
  std::string station;  // empty: the only one
  std::string file;
};

std::vector<KnownBase> known_bases(const MeasurementArguments& arguments) {
  std::vector<KnownBase> result;
  for (const std::string& text : arguments.known_bases) {
    const std::size_t sign = fs::exists(text) ? std::string::npos : text.find('=');
    const bool is_named = sign != std::string::npos;
    result.push_back(
        {.station = is_named ? text.substr(0, sign) : "", .file = is_named ? text.substr(sign + 1) : text});
    const auto is_same = [&](const KnownBase& other) { return other.station == result.back().station; };
    if (std::any_of(result.begin(), result.end() - 1, is_same)) {
      throw InputError("--known-base: " + (is_named ? "station " + shown(result.back().station) : "the base") +
                       " is there twice, expected each once");
    }
  }
  return result;
}

// Of a result with several stations the base at this one.
Eigen::Isometry3d base_at(const std::string& station, const std::string& file) {
  const Json json = read_json(file);
  if (!json.is_object() || !json.contains("stations")) {
    return base_of(json, file);
  }
  for (const Json& entry : json["stations"]) {
    if (text_at(entry, "name") == station || (station.empty() && json["stations"].size() == 1)) {
      return base_of(entry, file);
    }
  }
  throw InputError(file + ": stations: none is " + shown(station) + ", expected that station or a file of one base");
}

}  // namespace

FileRoles files_of(const MeasurementArguments& arguments) {
  FileRoles files = {{"measurements", arguments.measurements},
                     {"joints-file", arguments.joints_file},
                     {"joint-convention", arguments.joint_convention}};
  for (const KnownBase& known : known_bases(arguments)) {
    files.emplace_back(known.station.empty() ? "known-base" : "known-base " + known.station, known.file);
  }
  files.emplace_back("known-targets", arguments.known_targets);
  return files;
}

Measurements read(const MeasurementArguments& arguments, const Robot& robot) {
  const std::optional<JointConvention> convention = convention_of(arguments.joint_convention);
  const JointConvention* used = convention ? &*convention : nullptr;
  const OrientationReading orientation = orientation_reading(arguments.orientation);
  Measurements measurements = arguments.joints_file.empty()
                                  ? read_measurements(robot, arguments.measurements, used, orientation)
                                  : read_joined(robot,
                                                {.points = arguments.measurements,
                                                 .joint_values = arguments.joints_file,
                                                 .names = arguments.point_names,
                                                 .orientation = orientation},
                                                used);
  return with_poses_joined(arguments.exclude.empty() ? std::move(measurements)
                                                     : without_rows(measurements, arguments.exclude));
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

KnownFrames known_frames(const MeasurementArguments& arguments, const Measurements& measurements) {
  KnownFrames known;
  const std::vector<std::string>& stations = measurements.stations;
  for (const KnownBase& given : known_bases(arguments)) {
    if ((stations.size() == 1 && given.station.empty()) ||
        std::find(stations.begin(), stations.end(), given.station) != stations.end()) {
      known.bases.push_back({.station = given.station, .X_WB = base_at(given.station, given.file)});
    } else {
      throw InputError("--known-base: " + (given.station.empty() ? "no station" : "station " + shown(given.station)) +
                       ", expected " +
                       (names_stations(measurements) ? "STATION=FILE with one of " + comma_separated(stations)
                                                     : "a file alone, as the measurements have no column station"));
    }
  }
  if (!arguments.known_targets.empty()) {
    for (TargetFrame& target : read_targets(arguments.known_targets)) {
      const auto& names = measurements.targets;
      if (std::find(names.begin(), names.end(), target.name) != names.end()) {
        known.targets.push_back(target);
      }
    }
    if (known.targets.empty()) {
      throw InputError(arguments.known_targets + ": targets: none was measured, expected some of " +
                       comma_separated(measurements.targets));
    }
  }
  return known;
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
    read_on_trial([&] { conventions.push_back(read_joint_convention(file)); });
  }
  return conventions;
}

}  // namespace kdl_calibration::cli
