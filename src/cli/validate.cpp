#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <memory>
#include <string_view>
#include <utility>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "cli/frames.hpp"
#include "cli/measurement_options.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_command.hpp"
#include "cli/report_pages.hpp"
#include "cli/requirements.hpp"
#include "cli/robot_controller.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "cli/truth_report.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/validation.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"
#include "planning/truth_comparison.hpp"
#include "results/result_blocks.hpp"
#include "results/result_table.hpp"
#include "results/saved_calibration.hpp"
#include "robot/joint_ranges.hpp"

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

// The upper 95 % limit of an error of `name` rows ("all", "train", "test") is so many times the error.
double upper_95_factor(const PositionErrors& errors, std::string_view name) {
  return name == "test" ? errors.upper_95_factor_of_test : errors.upper_95_factor;
}

Json json(const PositionErrors& errors, const Measurements& measurements) {
  Json targets = Json::array();
  for (const TargetFrame& target : errors.frames.targets) {
    targets.push_back(target_json(target));
  }
  const auto with_means = [&](const char* name, const ErrorStatistics& points,
                              const std::optional<ErrorStatistics>& means) {
    Json block = statistics_json(points);
    if (block.is_object()) {
      block["rms_upper_95"] = finite_or_null(points.rms * upper_95_factor(errors, name));
    }
    if (means) {
      block["means"] = statistics_json(*means);
    }
    return block;
  };
  Json result = {{"position_error",
                  {{"all", with_means("all", errors.all, errors.all_means)},
                   {"train", with_means("train", errors.train, errors.train_means)},
                   {"test", with_means("test", errors.test, errors.test_means)}}},
                 {"iso_9283",
                  {{"accuracy", statistics_json(errors.iso_9283.accuracy)},
                   {"repeatability", statistics_json(errors.iso_9283.repeatability)}}},
                 {"registered_to", errors.train.count > 0 ? "train" : "test"},
                 {"degrees_of_freedom", errors.coordinates - errors.unknowns},
                 {"rms_corrected", errors.rms_corrected},
                 {"base", frame_json(errors.frames.base())},
                 {"targets", targets}};
  if (errors.distance_zero != 0.0) {
    result["distance_zero"] = {{"length", errors.distance_zero}};
  }
  for (std::size_t s = 0; measurements.stations.size() > 1 && s < measurements.stations.size(); ++s) {
    result["stations"].push_back({{"name", measurements.stations[s]}});
    result["stations"].back().update(frame_json(errors.frames.base(s)));
  }
  return result;
}

// The same with upper 95 % limits instead of errors: a requirement is met if the true errors are below it.
Json with_limits(const PositionErrors& errors, Json result) {
  for (auto& [name, block] : result["position_error"].items()) {
    const double factor = upper_95_factor(errors, name);
    const auto enlarge = [&](Json& statistics) {
      for (const char* key : {"mean", "rms", "p95", "max"}) {
        statistics[key] = finite_or_null(statistics[key].get<double>() * factor);
      }
    };
    if (block.is_object()) {
      enlarge(block);
      if (block.contains("means")) {
        enlarge(block["means"]);
      }
    }
  }
  result["rms_corrected"] = result["position_error"][result["registered_to"].get<std::string>()]["rms"];
  return result;
}

// Judged by those limits; where that is another number than the one printed, the value says so.
std::vector<Judged> judged(const std::vector<Requirement>& requirements, const PositionErrors& errors,
                           const Json& result) {
  const std::vector<Judged> as_printed = outcomes_of(requirements, result);
  std::vector<Judged> outcomes = outcomes_of(requirements, with_limits(errors, result));
  for (std::size_t i = 0; i < outcomes.size(); ++i) {
    outcomes[i].value += outcomes[i].value == as_printed[i].value ? "" : " (upper 95 % limit)";
  }
  return outcomes;
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

std::string table(const ValidateArguments& arguments, const Measurements& measurements, const Robot& robot,
                  const PositionErrors& errors) {
  std::string text = "position error of " + (arguments.result.empty() ? robot.source : arguments.result) + ", " +
                     (errors.registered.empty() ? "base and targets as given"
                                                : errors.registered + " registered to the " +
                                                      (errors.train.count > 0 ? "train" : "test") + " rows") +
                     "\n" + statistics_heading("rows [mm]");
  for (const auto& [name, points, means] :
       {std::tuple{"all", &errors.all, &errors.all_means}, std::tuple{"train", &errors.train, &errors.train_means},
        std::tuple{"test", &errors.test, &errors.test_means}}) {
    text += line(name, *points) + (*means ? line(std::string(name) + ", means of repeats", **means) : "");
  }
  if (errors.unknowns > 0) {
    text += fmt::format("{} took {} of {} coordinates: corrected rms {:.3f} mm\n", errors.registered, errors.unknowns,
                        errors.coordinates, errors.rms_corrected * 1e3);
  }
  text += std::isfinite(errors.upper_95_factor)
              ? fmt::format("true errors are with 95 % at most {:.3g} times as large\n", errors.upper_95_factor)
              : "so few configurations do not limit the true errors: base and targets may hide them\n";
  for (std::size_t s = 0; s < errors.frames.bases.size(); ++s) {
    text += point(errors.frames.bases.size() == 1 ? "base, measured [mm]" : "base from " + measurements.stations[s],
                  errors.frames.base(s).translation());
  }
  for (const TargetFrame& target : errors.frames.targets) {
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
  if (found.model.kept_axes != KeptAxes::none) {
    throw InputError(arguments.result +
                     ": has kept axes, and its parameters are not those of the truth; expected --measurements instead");
  }
  auto [drawn, truth_as_read] = read_arm(arguments.truth, robot, nominal);
  drawn.model.circumstances = found.model.circumstances;
  Random random(arguments.seed);
  const Eigen::MatrixXd joint_values = random_configurations(
      nominal.joints, ranges_to_compare_in(truth_as_read, arguments.truth, nominal), kConfigurationsOfTruth, random);
  const auto [model, estimate, truth] = without_stations(
      arm_and_truth(found.model, found.estimate, {.model = drawn.model, .truth = drawn.estimate}), joint_values);
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
  return result.empty() ? CalibrationParts{nominal_basis(robot)} : read_result(result, robot);
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
  if (!arguments.result.empty()) {
    const Json result = read_json(arguments.result);
    require_after_entry(result, arguments.result, arguments.measurements.measurements);
    if (!arguments.measurements.joint_convention.empty()) {
      warn_of_other_convention(result, arguments.result, arguments.measurements.joint_convention);
    }
  }
  const auto arm = std::make_shared<const CalibrationParts>(arm_of(robot, arguments.result));
  const Measurements measurements = read(arguments.measurements, robot);
  const PositionErrors errors =
      validate(Calibration(arm), measurements, known_frames(arguments.measurements, measurements),
               {.convention = convention_of(arguments.measurements.joint_convention),
                .other_conventions = conventions_at_hand(arguments.measurements)});
  std::vector<std::string> doubts;
  for (const Doubt& doubt : errors.doubts) {
    doubts.push_back(doubt.message);
  }
  const Json result = json(errors, measurements);
  const std::vector<Judged> outcomes = judged(requirements, errors, result);
  const std::vector<std::string> missed = unfulfilled(outcomes);
  const std::optional<JointConvention> convention = convention_of(arguments.measurements.joint_convention, robot);
  for (OutputFile& file : files) {
    const ErrorModel model = model_at_stations(measurements, arm->model);
    const Estimate estimate{.errors = arm->estimate.errors, .frames = errors.frames, .effects = arm->estimate.effects};
    file.text = validation_page({.result = with_provenance(arguments, robot, measurements, result),
                                 .robot = robot,
                                 .reported = {.model = model,
                                              .estimate = estimate,
                                              .measurements = measurements,
                                              .convention = convention,
                                              .X_BK = world_of(robot, convention)},
                                 .warnings = errors.warnings,
                                 .requirements = judged_json(outcomes),
                                 .doubts = doubts});
  }
  write_whole(
      files, arguments.force,
      arguments.json ? json_text(result) : table(arguments, measurements, robot, errors) + outcome_lines(outcomes));
  for (const std::vector<std::string>& messages : {errors.warnings, doubts}) {
    for (const std::string& message : messages) {
      warn(message);
    }
  }
  std::for_each(missed.begin(), missed.end(), print_requirement);
  return missed.empty() && doubts.empty() ? done : not_to_be_trusted;
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
