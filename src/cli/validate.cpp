#include <fmt/core.h>
#include <algorithm>
#include <memory>
#include <utility>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "cli/frames.hpp"
#include "cli/measurement_options.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/report_pages.hpp"
#include "cli/requirements.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "cli/truth_report.hpp"
#include "diagnosis/alternative_readings.hpp"
#include "estimation/prediction.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/readings.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"
#include "planning/truth_comparison.hpp"
#include "results/result_blocks.hpp"
#include "results/result_table.hpp"
#include "results/saved_calibration.hpp"
#include "robot/joint_ranges.hpp"
#include "validation/registered_errors.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr int kConfigurationsOfTruth = 1000;

struct ValidateArguments {
  RobotArguments robot;
  MeasurementArguments measurements;
  std::string result;
  std::string truth;
  std::vector<std::string> requirements;
  std::uint64_t seed = 1;
  std::string report;
  bool force = false;
  bool json = false;
};

constexpr int kPlenty = 4;  // coordinates per unknown

// Whether the misfit exceeds 10 % of the arm's length: 3 degrees in every joint leave half of that.
bool absurd(const ErrorModel& model, double misfit) {
  constexpr double kShare = 0.1;
  double reach = model.tip_origin.p.Norm();
  for (const MovingJoint& joint : model.joints) {
    reach += joint.origin.p.Norm();
  }
  return misfit > kShare * reach;
}

std::string json(const RegisteredErrors& errors, const Measurements& measurements) {
  const Registration& registration = errors.registration;
  Json targets = Json::array();
  for (const TargetFrame& target : registration.frames.targets) {
    targets.push_back(target_json(target));
  }
  const auto with_means = [](const ErrorStatistics& points, const std::optional<ErrorStatistics>& means) {
    Json block = statistics_json(points);
    if (means) {
      block["means"] = statistics_json(*means);
    }
    return block;
  };
  Json result = {{"position_error",
                  {{"all", with_means(errors.all, errors.all_means)},
                   {"train", with_means(errors.train, errors.train_means)},
                   {"test", with_means(errors.test, errors.test_means)}}},
                 {"iso_9283",
                  {{"accuracy", statistics_json(errors.iso.accuracy)},
                   {"repeatability", statistics_json(errors.iso.repeatability)}}},
                 {"registered_to", errors.train.count > 0 ? "train" : "test"},
                 {"degrees_of_freedom", errors.freedom.left()},
                 {"rms_corrected", registration.rms * errors.freedom.correction()},
                 {"base", frame_json(registration.frames.base())},
                 {"targets", targets}};
  for (std::size_t s = 0; measurements.stations.size() > 1 && s < measurements.stations.size(); ++s) {
    result["stations"].push_back({{"name", measurements.stations[s]}});
    result["stations"].back().update(frame_json(registration.frames.base(s)));
  }
  return json_text(result);
}

std::string line(const std::string& label, const ErrorStatistics& statistics) {
  return statistics.count == 0 ? std::string() : statistics_row(label, statistics);
}

std::string point(const std::string& label, const Eigen::Vector3d& position) {
  std::string text = padded(label, 24);
  for (const double value : position) {
    text += fmt::format("{:>12}", fixed(value * 1e3, 3));
  }
  return text + "\n";
}

// The frames that are registered because they are not known.
std::string registered(const KnownFrames& known, const Frames& frames) {
  const bool targets = known.targets.size() < frames.targets.size();
  const bool base = known.bases.size() == frames.bases.size();
  return base ? (targets ? "targets" : "") : targets ? "base and targets" : "base";
}

std::string table(const ValidateArguments& arguments, const Measurements& measurements, const Robot& robot,
                  const RegisteredErrors& errors, const std::string& placed) {
  const Registration& registration = errors.registration;
  std::string text =
      "position error of " + (arguments.result.empty() ? robot.source : arguments.result) + ", " +
      (placed.empty() ? "base and targets as given"
                      : placed + " registered to the " + (errors.train.count > 0 ? "train" : "test") + " rows") +
      "\n" + statistics_heading("rows [mm]");
  for (const auto& [name, points, means] :
       {std::tuple{"all", &errors.all, &errors.all_means}, std::tuple{"train", &errors.train, &errors.train_means},
        std::tuple{"test", &errors.test, &errors.test_means}}) {
    text += line(name, *points) + (*means ? line(std::string(name) + ", means of repeats", **means) : "");
  }
  if (errors.freedom.spent() > 0) {
    text += fmt::format("{} took {} of {} coordinates: corrected rms {:.3f} mm\n", placed, errors.freedom.spent(),
                        errors.freedom.coordinates, registration.rms * errors.freedom.correction() * 1e3);
  }
  for (std::size_t s = 0; s < registration.frames.bases.size(); ++s) {
    text +=
        point(registration.frames.bases.size() == 1 ? "base, measured [mm]" : "base from " + measurements.stations[s],
              registration.frames.base(s).translation());
  }
  for (const TargetFrame& target : registration.frames.targets) {
    text += point("target " + target.name, target.X_FT.translation());
  }
  return text;
}

// The arm of a result or a truth, with effects, base and targets, and its file.
struct ReadArm {
  CalibrationParts arm;
  Json json;
};
ReadArm read_arm(const std::string& file, const Robot& robot, const ErrorModel& nominal) {
  const std::string text = read_text_file(file);
  Json json = json_of(text, file);
  require_same_nominal(json, file, nominal);
  base_of(json, file);  // throws if absent: both are compared
  targets_of(json, file);
  return {.arm = parse_calibration(text, robot, file), .json = std::move(json)};
}

// Joint ranges of the truth's measurements, or the limits.
JointRanges ranges_to_compare_in(const Json& truth, const std::string& source, const ErrorModel& model) {
  JointRanges ranges = limits_of(model.joints);
  const auto given = ranges_of(truth, source, model);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    ranges[i] = given[i].value_or(ranges[i]);
  }
  return ranges;
}

ExitStatus run_against_truth(const ValidateArguments& arguments) {
  if (arguments.result.empty()) {
    throw InputError("validate: --truth alone, expected --result beside it");
  }
  if (!arguments.report.empty()) {
    throw InputError("validate: --report shows measurements, expected it without --truth");
  }
  if (!arguments.measurements.measurements.empty()) {
    throw InputError("validate: --measurements beside --result and --truth, expected one of the two");
  }
  const Robot robot = load(arguments.robot);
  const ErrorModel nominal = complete_model(robot);
  const CalibrationParts found = read_arm(arguments.result, robot, nominal).arm;
  const auto [drawn, truth_as_read] = read_arm(arguments.truth, robot, nominal);
  Random random(arguments.seed);
  const Eigen::MatrixXd joint_values = random_configurations(
      nominal.joints, ranges_to_compare_in(truth_as_read, arguments.truth, nominal), kConfigurationsOfTruth, random);
  const auto [model, estimate, truth] = without_stations(
      as_one_model(found.model, found.estimate, {.model = drawn.model, .truth = drawn.estimate}), joint_values);
  const TruthComparison comparison = compare_with_truth(model, estimate, truth, joint_values);
  if (arguments.json) {
    Json json = truth_json(model, estimate, truth, comparison);
    json.update({{"position_error", {{"all", statistics_json(comparison.points)}}},
                 {"configurations", joint_values.cols()},
                 {"seed", arguments.seed}});
    print(json_text(json));
  } else {
    print(fmt::format("distance of predicted from true points at {} configurations\n{}{}\n{}", joint_values.cols(),
                      statistics_heading("targets [mm]"), line("all", comparison.points),
                      truth_table(model, estimate, comparison)));
  }
  if (!comparison.comparable()) {
    warn(
        fmt::format("the parameters that can be told apart here cannot say what the truth is ({:.1e} mm remain): "
                    "compare points, not parameters",
                    comparison.gauge_misfit * 1e3));
  }
  return comparison.comparable() ? done : not_to_be_trusted;
}

// The arm of the URDF or, with the full model, of a result.
CalibrationParts arm_of(const Robot& robot, const std::string& result) {
  if (!result.empty()) {
    return read_calibration(result, robot);
  }
  CalibrationParts nominal;
  nominal.model = complete_model(robot);
  nominal.estimate.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(nominal.model.parameters.size()));
  return nominal;
}

// Doubts and warnings of a validation.
struct Words {
  std::vector<std::string> warnings;
  std::vector<std::string> doubts;  // reasons not to trust the result
};

// Doubts: other readings of the measurements, and an implausibly large misfit.
Words judged(const ValidateArguments& arguments, const ErrorModel& model, const Measurements& fitted,
             const Estimate& estimate, const KnownFrames& known) {
  const std::optional<JointConvention> convention = convention_of(arguments.measurements.joint_convention);
  Words words;
  if (model.has_open_bases) {
    words.warnings.push_back(std::string("other readings of the data were not tried (") +
                             (has_single_coordinates(fitted) ? "single coordinates)" : "several stations)"));
    return words;
  }
  for (const AlternativeReading& reading :
       alternative_readings_of_nominal(model, fitted, estimate,
                                       {.registration = {.known = known},
                                       .used = convention ? &*convention : nullptr,
                                       .others = conventions_at_hand(arguments.measurements)})) {
    if (reading.cause != Cause::joint_function) {  // normal for a robot that is not calibrated
      (reading.doubt ? words.doubts : words.warnings).push_back(reading.message);
    }
  }
  return words;
}

// Warnings about the registration of base and targets.
std::vector<std::string> warnings_of(const Measurements& measurements, const Registration& registration,
                                     const Freedom& freedom, const std::string& placed) {
  std::vector<std::string> warnings;
  if (!measurements.remark.empty()) {
    warnings.push_back("measurements: " + measurements.remark);
  }
  if (has_only_test_rows(measurements) && !placed.empty()) {
    warnings.push_back(measurements.source + ": no train rows, the test rows place " + placed);
  }
  if (registration.ambiguous) {
    warnings.push_back("registration: " + registration.message);
  }
  if (freedom.spent() > 0 && freedom.coordinates < kPlenty * freedom.spent()) {
    warnings.push_back(fmt::format("{} took {} of {} coordinates: corrected for that, the rms is {:.4f} mm", placed,
                                   freedom.spent(), freedom.coordinates,
                                   registration.rms * freedom.correction() * 1e3));
  }
  return warnings;
}

// Adds to the printed numbers their provenance, for the page.
Json with_provenance(const ValidateArguments& arguments, const Robot& robot, const Measurements& measurements,
                     Json result) {
  result["input"] = {{"configurations", measurements.joint_values.cols()},
                     {"observations", measurements.observations.size()}};
  FileRoles files = files_of(arguments.measurements);
  files.emplace_back("result", arguments.result);
  return with_files(std::move(result), arguments.robot, robot, files);
}

ExitStatus run_against_measurements(const ValidateArguments& arguments) {
  if (arguments.measurements.measurements.empty()) {
    throw InputError("validate: --measurements is required, or --result and --truth, see kdlcal validate --help");
  }
  const std::vector<Requirement> requirements = parse_requirements(arguments.requirements);
  std::vector<OutputFile> files = given_outputs({{"--report", arguments.report}});
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const CalibrationParts arm = arm_of(robot, arguments.result);
  const Measurements measurements = read(arguments.measurements, robot);
  const ErrorModel model = at_stations_of(measurements, arm.model);
  const KnownFrames known = known_frames(arguments.measurements, measurements);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(arm.model, arm.estimate, measurements);
  const Measurements to_register = rows_to_register(measurements);
  const RegisteredErrors errors = registered_errors(X_BF, measurements, to_register, known);
  const Registration& registration = errors.registration;
  const Estimate estimate{
      .errors = arm.estimate.errors, .frames = registration.frames, .effects = arm.estimate.effects};
  const std::string result = json(errors, measurements);
  Words words = judged(arguments, model, to_register, estimate, known);
  if (words.doubts.empty() && absurd(model, registration.rms)) {
    words.doubts.push_back(fmt::format(
        "a misfit of {:.1f} mm is more than geometric errors explain; are units, signs and order of the joints right?",
        registration.rms * 1e3));
  }
  const std::string placed = registered(known, registration.frames);
  const std::vector<std::string> before = warnings_of(measurements, registration, errors.freedom, placed);
  words.warnings.insert(words.warnings.begin(), before.begin(), before.end());
  const std::vector<Judged> outcomes = outcomes_of(requirements, json_of(result, "the result"));
  const std::vector<std::string> missed = unfulfilled(outcomes);
  for (OutputFile& file : files) {
    file.text =
        validation_page({.result = with_provenance(arguments, robot, measurements, json_of(result, "the result")),
                         .robot = robot,
                         .reported = {.model = model,
                                      .estimate = estimate,
                                      .measurements = measurements,
                                      .convention = convention_of(arguments.measurements.joint_convention, robot)},
                         .warnings = words.warnings,
                         .requirements = judged_json(outcomes),
                         .doubts = words.doubts});
  }
  write_whole(
      files, arguments.force,
      arguments.json ? result : table(arguments, measurements, robot, errors, placed) + outcome_lines(outcomes));
  for (const std::vector<std::string>& messages : {words.warnings, words.doubts}) {
    for (const std::string& message : messages) {
      warn(message);
    }
  }
  std::for_each(missed.begin(), missed.end(), print_requirement);
  return missed.empty() && words.doubts.empty() ? done : not_to_be_trusted;
}

ExitStatus run(const ValidateArguments& arguments) {
  return arguments.truth.empty() ? run_against_measurements(arguments) : run_against_truth(arguments);
}

}  // namespace

Subcommand add_validate(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand(
      "validate", "The position error of a URDF against measurements, or of a result against the truth");
  const auto arguments = std::make_shared<ValidateArguments>();
  add_robot_options(*app, arguments->robot);
  add_measurement_options(*app, arguments->measurements);
  app->get_option("--measurements")->required(false);
  add_file(*app, "--result", arguments->result, "The arm with the full model of this result of calibrate");
  add_file(*app, "--truth", arguments->truth,
           "Compare --result with the true errors, base and targets that simulate wrote (JSON)");
  add_require(*app, arguments->requirements);
  add_report_file(*app, arguments->report);
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_seed(*app, arguments->seed);
  add_json_flag(*app, arguments->json);
  add_example(*app,
              "kdlcal validate --urdf calibrated.urdf --measurements other.csv\n"
              "  kdlcal validate --result result.json --truth truth.json");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
