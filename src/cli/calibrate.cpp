#include "kdl_calibration/joint_convention.hpp"
#include "results/calibrated_urdf.hpp"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "base/json_tree.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/wrapped_text.hpp"
#include "cli/cures.hpp"
#include "cli/frames.hpp"
#include "cli/help.hpp"
#include "cli/measurement_options.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_command.hpp"
#include "cli/planned_cell.hpp"
#include "cli/progress.hpp"
#include "cli/requirements.hpp"
#include "cli/robot_controller.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/residual_options.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "kdl_calibration/result_file.hpp"
#include "results/report_page.hpp"
#include "results/result_blocks.hpp"
#include "results/result_json.hpp"
#include "results/result_table.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

struct CalibrateArguments {
  RobotArguments robot;
  MeasurementArguments measurements;
  std::string output;
  std::string result;
  std::string residuals;
  std::string covariance;
  std::string report;
  std::vector<std::string> notes;
  std::vector<std::string> requirements;
  double guard = 0.0;
  std::string method = "joint";
  std::string model = "irreducible";
  std::string keep_axes;
  CalibrationOptions options;
  std::string prior;  // empty: not stated
  std::string prior_result;
  std::vector<std::string> effects;  // empty: not stated
  std::vector<double> gravity_direction = {0.0, 0.0, -1.0};
  std::vector<std::string> payload_centre = {"0", "0", "0"};
  std::string loss = "none";
  std::string noise = "auto";
  std::vector<double> noise_independent;
  std::vector<double> noise_common;
  std::vector<double> tracker;
  std::string predict_at;
  std::string config;  // the option file, if any
  bool force = false;
  bool json = false;
  bool details = false;
};

std::vector<OutputFile> outputs(const CalibrateArguments& arguments) {
  return given_outputs({{"--output", arguments.output},
                        {"--result", arguments.result},
                        {"--residuals", arguments.residuals},
                        {"--covariance", arguments.covariance},
                        {"--report", arguments.report}});
}

// All input files.
std::vector<HashedFile> files_read(const CalibrateArguments& arguments, const Robot& robot) {
  FileRoles files = files_of(arguments.measurements);
  files.insert(
      files.end(),
      {{"predict-at", arguments.predict_at}, {"prior-result", arguments.prior_result}, {"config", arguments.config}});
  return hashed_files(arguments.robot, robot, files);
}

// One value for all axes, or one per axis.
Eigen::Vector3d axis_values(const std::vector<double>& values, const std::string& option) {
  if (values.empty()) {
    return Eigen::Vector3d::Zero();
  }
  if (values.size() != 1 && values.size() != 3) {
    throw InputError(fmt::format("{}: has {} values, expected 1 or 3 (x,y,z)", option, values.size()));
  }
  return values.size() == 1 ? Eigen::Vector3d::Constant(values[0]) : Eigen::Vector3d(values[0], values[1], values[2]);
}

NoiseModel noise_model(const CalibrateArguments& arguments) {
  NoiseModel noise = arguments.options.noise.stated;
  noise.independent = axis_values(arguments.noise_independent, "--noise-independent");
  if (!noise.independent.isZero(0.0) && noise.independent.minCoeff() == 0.0) {
    throw InputError("--noise-independent: is 0 along one axis and not along another, expected above 0 along each");
  }
  noise.common = axis_values(arguments.noise_common, "--noise-common");
  noise.tracker = tracker_noise(arguments.tracker);
  if (!noise.common.isZero(0.0) && noise.independent.isZero(0.0) && !noise.tracker) {
    throw InputError("--noise-common: needs --noise-independent or --noise-tracker beside it");
  }
  return noise;
}

Eigen::Vector3d vector_of(const std::vector<double>& numbers, const char* option) {
  if (numbers.size() != 3) {
    throw InputError(std::string(option) + ": has " + std::to_string(numbers.size()) + " values, expected 3 (x,y,z)");
  }
  return {numbers[0], numbers[1], numbers[2]};
}

// x,y,z of all payloads, or MASS=x,y,z of each.
void take_payload_centres(const std::vector<std::string>& words, EffectOptions& effects) {
  const std::string text = comma_separated(words);
  const auto number = [&](std::string_view part) {
    const std::optional<double> value = parsed_number(part);
    if (!value || std::abs(*value) > 1e5) {
      throw InputError("--payload-centre: '" + text + "', expected x,y,z or MASS=x,y,z for each payload, in m and kg");
    }
    return *value;
  };
  std::vector<std::pair<std::optional<double>, std::vector<double>>> payloads;  // mass, centre
  for (const std::string& word : words) {
    const std::size_t equals = word.find('=');
    if (equals != std::string::npos || payloads.empty()) {
      payloads.emplace_back(equals == std::string::npos ? std::nullopt : std::optional(number(word.substr(0, equals))),
                            std::vector<double>());
    }
    payloads.back().second.push_back(number(word.substr(equals == std::string::npos ? 0 : equals + 1)));
  }
  for (const auto& [mass, centre] : payloads) {
    const Eigen::Vector3d place = vector_of(centre, "--payload-centre");
    if (!mass) {
      effects.payload_centre = place;
    } else if (!effects.payload_centres.emplace(*mass, place).second) {
      throw InputError(fmt::format("--payload-centre: {:g} kg is there twice, expected each mass once", *mass));
    }
  }
  if (payloads.size() > 1 && !payloads.front().first) {
    throw InputError("--payload-centre: '" + text + "', expected a mass before each centre");
  }
}

// What an option that may be left out says of a choice: to leave it to the data, or not; nothing if other words follow.
std::optional<bool> automatic(const std::vector<std::string>& words) {
  return words == std::vector<std::string>{"auto"}   ? std::optional(true)
         : words == std::vector<std::string>{"none"} ? std::optional(false)
                                                     : std::nullopt;
}

CalibrationOptions calibration_options(const CalibrateArguments& arguments, const Robot& robot,
                                       const Measurements& measurements) {
  CalibrationOptions options = arguments.options;
  options.estimator.method = arguments.method == "joint" ? Method::joint : Method::two_step;
  options.parameters.model = arguments.model == "irreducible" ? ModelChoice::irreducible : ModelChoice::complete;
  options.parameters.keep_axes = arguments.keep_axes == "closed-form" ? KeptAxes::closed_form
                                 : arguments.keep_axes == "angles"    ? KeptAxes::angles
                                                                      : KeptAxes::none;
  options.estimator.loss = arguments.loss == "huber"   ? Loss::huber
                           : arguments.loss == "tukey" ? Loss::tukey
                                                       : Loss::none;
  options.priors.automatic = automatic({arguments.prior});
  options.effects = {.groups = effect_groups(arguments.effects, {"auto", "none"}),
                     .automatic = automatic(arguments.effects),
                     .gravity_direction = vector_of(arguments.gravity_direction, "--gravity-direction")};
  take_payload_centres(arguments.payload_centre, options.effects);
  options.noise.stated = noise_model(arguments);
  options.noise.weights = arguments.noise == "repeats" ? Weights::repeats
                          : arguments.noise == "equal" ? Weights::equal
                                                       : Weights::automatic;
  options.parameters.known = known_frames(arguments.measurements, measurements);
  options.diagnosis.convention = convention_of(arguments.measurements.joint_convention);
  options.diagnosis.other_conventions = conventions_at_hand(arguments.measurements);
  if (!arguments.predict_at.empty()) {
    const Measurements asked = configurations_of(robot, arguments.predict_at, arguments.measurements.joint_convention);
    options.predict_at = {.names = asked.configurations, .joint_values = asked.joint_values, .signals = asked.signals};
  }
  return options;
}

// --exclude with all gross rows: "12,14:B"
std::string excluded(const GrossRows& gross) {
  std::string list;
  for (const GrossRow& row : gross.rows) {
    list += (list.empty() ? "" : ",") + row.configuration + (row.target.empty() ? "" : ":" + row.target);
  }
  return "--exclude '" + list + "'";
}

// Completes the messages that say what to do by how kdlcal does it.
void name_ways(Diagnosis& diagnosis) {
  const std::map<Cause, std::string> ways = {{Cause::gross_rows, " with " + excluded(diagnosis.gross_rows)},
                                             {Cause::harmful_effects, ", or let --effects auto choose those that help"},
                                             {Cause::urdf_without_effects, " (kdlcal compensate)"}};
  for (std::vector<Doubt>* all : {&diagnosis.doubts, &diagnosis.remarks}) {
    for (Doubt& doubt : *all) {
      const auto found = ways.find(doubt.cause);
      doubt.message += found != ways.end() ? found->second : "";
    }
  }
}

// Adds options of kdlcal that help against the doubt. The result does not state them.
void name_options(Doubt& doubt, const std::map<Cause, std::string>& help) {
  const auto found = help.find(doubt.cause);
  doubt.message += found != help.end() ? " (" + found->second + ")" : "";
}

// The command that judges the result by other measurements.
std::string next_step(const CalibrateArguments& arguments) {
  if (arguments.output.empty() && arguments.result.empty()) {
    return "--output FILE writes the calibrated URDF, --details shows every parameter";
  }
  std::string command = "kdlcal validate";
  const auto add = [&](const char* option, const std::string& value) {
    command += value.empty() ? "" : std::string(" ") + option + " " + shell_word(value);
  };
  if (arguments.result.empty()) {
    add("--urdf", arguments.output);
  } else {
    add("--result", arguments.result);
    add("--urdf", arguments.robot.urdf);
    add("--dh", arguments.robot.dh);
  }
  add("--base", arguments.robot.base);
  add("--tip", arguments.robot.tip);
  add("--measurements", "NEW.csv");
  add("--joint-convention", arguments.measurements.joint_convention);
  add("--orientation", arguments.measurements.orientation);
  return command + ", with points of other days and places";
}

std::string table(const CalibrateArguments& arguments, const Robot& robot, const Measurements& measurements,
                  const CalibrationResult& calibration) {
  TableOptions options{.fixed = "fixed by --fix"};
  for (const OutputFile& file : outputs(arguments)) {
    options.written.push_back(file.path);
  }
  const std::optional<JointConvention> convention = convention_of(arguments.measurements.joint_convention, robot);
  if (convention) {
    options.convention = &*convention;
  }
  options.details = arguments.details;
  std::string text = result_table(measurements, calibration, options);
  if (calibration.trusted() && !arguments.details) {
    text += wrapped("Next: " + next_step(arguments), 0, 6);
  }
  return text;
}

// Prints doubts on standard error, unless the table has just shown them on the same terminal.
void say_what_is_doubted(const CalibrateArguments& arguments, const CalibrationResult& calibration) {
  const bool just_said = !arguments.json && ::isatty(STDOUT_FILENO) == 1 && ::isatty(STDERR_FILENO) == 1;
  if (!just_said) {
    for (const Doubt& doubt : calibration.diagnosis.doubts) {
      print_doubt(doubt.message);
    }
    if (calibration.diagnosis.reservation) {
      warn("trusted where it was measured: " + calibration.diagnosis.reservation->message);
    }
  }
  for (const Remark& remark : calibration.diagnosis.remarks) {
    is_information(remark.cause) ? inform(remark.message) : warn(remark.message);
  }
  if (is_uncertain_elsewhere(calibration)) {
    warn(plan_to_add(calibration.model.has_undetermined_bases) + " chooses configurations that help there");
  }
  if (!calibration.trusted() && !arguments.output.empty()) {
    warn(arguments.output + " comes from an answer that is not to be trusted; the file itself does not say so");
  }
}

// `file`: where the result is written to; may be empty.
std::string page_of(const std::string& result, const std::string& file, const Robot& robot,
                    const Measurements& measurements, const CalibrationSettings& settings) {
  const std::optional<JointConvention>& convention = settings.diagnosis.convention;
  const Json json = json_of(result, "the result");
  return calibration_page({.result = result,
                           .source = "the result",
                           .robot = &robot,
                           .measurements = &measurements,
                           .known = settings.parameters.known,
                           .convention = convention,
                           .X_BK = world_of(robot, convention),
                           .plan_command = plan_command(json),
                           .apply_command = apply_command(json, file),
                           .cures = cures(json.contains("stations"))});
}

// The result as JSON, with the outcome of every --require.
struct JudgedResult {
  std::string text;
  std::vector<Judged> outcomes;
};
JudgedResult judged_result(std::string text, const std::vector<Requirement>& requirements, double guard) {
  if (requirements.empty()) {
    return {.text = std::move(text), .outcomes = {}};
  }
  Json json = json_of(text, "the result");
  std::vector<Judged> outcomes = outcomes_of(requirements, json, guard);
  json["requirements"] = judged_json(outcomes);
  json["hashes"] = tree::hashes(json);
  return {.text = json_text(json), .outcomes = std::move(outcomes)};
}

bool shows_the_result(const OutputFile& file) { return file.option == "--result" || file.option == "--report"; }

// Fills the other output files and returns their hashes for the result.
Provenance filled_beside_result(const CalibrateArguments& arguments, const Robot& robot,
                                const Measurements& measurements, const CalibrationResult& calibration,
                                std::vector<OutputFile>& files) {
  Provenance provenance{.notes = notes_of(arguments.notes),
                        .options = reading_options(arguments.measurements),
                        .planned_cell = planned_cell_of(arguments.measurements),
                        .files_read = files_read(arguments, robot)};
  for (OutputFile& file : files) {
    if (shows_the_result(file)) {
      continue;
    }
    file.text = file.option == "--output"      ? calibrated_urdf(robot, calibration)
                : file.option == "--residuals" ? residuals_csv(measurements, calibration)
                                               : covariance_csv(calibration);
    provenance.files_written.push_back({.role = file.option.substr(2), .path = file.path, .sha256 = sha256(file.text)});
  }
  return provenance;
}

ExitStatus run(const CalibrateArguments& arguments) {
  const std::vector<Requirement> requirements = parse_requirements(arguments.requirements);  // invalid ones are refused
                                                                                             // before the work
  notes_of(arguments.notes);                                                                 // as are these
  std::vector<OutputFile> files = outputs(arguments);
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const Measurements measurements = read(arguments.measurements, robot);
  CalibrationOptions options = calibration_options(arguments, robot, measurements);
  std::optional<Calibration> earlier;
  if (!arguments.prior_result.empty()) {
    earlier = load_calibration(arguments.prior_result, robot);
    options.priors.earlier = &*earlier;
  }
  CalibrationResult calibration = [&] {
    Progress progress;
    options.progress = [&](const std::string& what, std::size_t done, std::size_t of) { progress(what, done, of); };
    return fit(robot, measurements, options);
  }();
  name_ways(calibration.diagnosis);
  const Provenance provenance = filled_beside_result(arguments, robot, measurements, calibration, files);
  const JudgedResult result =
      judged_result(result_json(robot, measurements, calibration, provenance), requirements, arguments.guard);
  for (OutputFile& file : files) {
    if (shows_the_result(file)) {
      file.text = file.option == "--result"
                      ? result.text
                      : page_of(result.text, arguments.result, robot, measurements, calibration.settings);
    }
  }
  const std::map<Cause, std::string> help = cures(calibration.model.has_undetermined_bases);
  for (Doubt& doubt : calibration.diagnosis.doubts) {
    name_options(doubt, help);
  }
  if (calibration.diagnosis.reservation) {
    name_options(*calibration.diagnosis.reservation, help);
  }
  write_whole(files, arguments.force,
              arguments.json ? result.text
                             : table(arguments, robot, measurements, calibration) + outcome_lines(result.outcomes));
  say_what_is_doubted(arguments, calibration);
  const std::vector<std::string> missed = unfulfilled(result.outcomes);
  std::for_each(missed.begin(), missed.end(), print_requirement);
  return calibration.trusted() && missed.empty() ? done : not_to_be_trusted;
}

// Refuses renamed options, stating the new name.
void refuse_old_names(CLI::App& app) {
  for (const auto& [old_name, instead] :
       {std::pair{"--gravity", "--effects gravity"}, std::pair{"--joint-gain", "--effects gain"},
        std::pair{"--extras", "--effects auto"},
        std::pair{"--prior-deflection", "--effects, whose sizes are estimated"}}) {
    app.add_option_function<std::vector<std::string>>(
           old_name,
           [old = std::string(old_name), next = std::string(instead)](const std::vector<std::string>&) {
             throw InputError(old + ": no longer an option, expected " + next);
           })
        ->expected(0, 1)
        ->group("");
  }
}

void add_fit_options(CLI::App& app, CalibrateArguments& arguments) {
  add_word(app, "--method", arguments.method, {"joint", "two-step"}, "Estimator: joint or two-step");
  limit_count(app.add_option("--iterations", arguments.options.estimator.iterations,
                             fmt::format("Limit [{}, or {} rounds of two-step]", kJointIterations, kTwoStepRounds)),
              {1, kMostIterations});
  add_word(app, "--model", arguments.model, {"irreducible", "complete"}, "Parameters: irreducible or complete");
  add_list(app, "--fix", arguments.options.parameters.fix,
           "Parameters not to estimate, names or patterns such as *4, base.*")
      ->type_name("NAME,...");
  add_list(app, "--free", arguments.options.parameters.free, "Parameters to estimate in addition")
      ->type_name("NAME,...");
  app.add_flag("--keep-axes{closed-form}", arguments.keep_axes,
               "Keep axes parallel and through one point exactly, for inverse kinematics in closed form (MoveIt, "
               "ikfast); =angles: keep all angles between neighbouring axes as well (OPW, Universal Robots)")
      ->check(one_of({"closed-form", "angles"}));
  app.add_option("--prior-length", arguments.options.priors.stated.length,
                 "1 sigma of length errors beforehand, m; 0: none")
      ->type_name("M")
      ->check(number_from(0.0, "a length in metres, 0 or more"))
      ->capture_default_str();
  app.add_option("--prior-angle", arguments.options.priors.stated.angle,
                 "1 sigma of angle errors beforehand, rad; 0: none")
      ->type_name("RAD")
      ->check(number_from(0.0, "an angle in radians, 0 or more"))
      ->capture_default_str();
  app.add_option(
         "--prior", arguments.prior,
         "Sizes of the priors: by evidence where that predicts better (auto), or as stated (none) [auto, unless "
         "stated, two-step, complete or with a loss]")
      ->type_name("NAME")
      ->check(one_of({"auto", "none"}));
  add_file(app, "--prior-result", arguments.prior_result,
           "Start from this earlier result of the robot (JSON): few new configurations tell what has changed");
  std::vector<std::string> effect_words = {"none", "auto"};
  const std::vector<std::string> groups = effect_group_names();
  effect_words.insert(effect_words.end(), groups.begin(), groups.end());
  add_list(app, "--effects", arguments.effects,
           "Beyond geometry: none, auto (what cross-validation accepts), or groups: " + comma_separated(groups) +
               " [auto, unless two-step, complete or with a loss]",
           one_of(effect_words))
      ->type_name("NAME,...");
  add_list(app, "--gravity-direction", arguments.gravity_direction, "Direction of gravity in the base frame, x,y,z",
           number_between(-1e6, 1e6, "a number from -1e6 to 1e6"))
      ->type_name("X,Y,Z")
      ->default_str("0,0,-1");
  add_list(app, "--payload-centre", arguments.payload_centre,
           "Centre of mass of the column payload in the flange frame [m]; of several payloads one for each mass [kg], "
           "12=0,0,0.1,40=0.1,0,0.25")
      ->type_name("X,Y,Z")
      ->default_str("0,0,0");
  refuse_old_names(app);
}

void add_noise_options(CLI::App& app, CalibrateArguments& arguments) {
  add_word(app, "--loss", arguments.loss, {"none", "huber", "tukey"}, "Down-weight outliers: none, huber or tukey");
  add_word(app, "--noise", arguments.noise, {"auto", "equal", "repeats"},
           "Weights: by the parts of the noise, stated or estimated (auto), the same with repeats demanded "
           "(repeats), or equal");
  const CLI::Validator length = number_from(0.0, "a length in metres, 0 or more");
  add_list(app, "--noise-independent", arguments.noise_independent, "1 sigma of a point by itself, m; one or x,y,z",
           length)
      ->type_name("M,...");
  add_list(app, "--noise-common", arguments.noise_common, "1 sigma shared by the points of a repeat, m; one or x,y,z",
           length)
      ->type_name("M,...");
  add_tracker_noise(app, arguments.tracker);
  app.add_option(
         "--orientation-sigma", arguments.options.noise.stated.orientation,
         fmt::format("1 sigma of a component of measured orientations, rad [from the repeats, or as {} m of lever]",
                     kOrientationLength))
      ->type_name("RAD")
      ->check(number_from(0.0, "an angle in radians, 0 or more"));
  NoiseOptions& noise = arguments.options.noise;
  app.add_option("--scale-sigma", noise.scale_sigma, "1 sigma of a factor on all measured lengths")
      ->type_name("M/M")
      ->check(number_between(0.0, 0.1, "a number from 0 to 0.1"))
      ->capture_default_str();
  app.add_option("--length-sigma", noise.length_sigma,
                 "1 sigma of stated distances, m: between sockets of a plate or anchors, of a bar")
      ->type_name("M")
      ->check(length)
      ->capture_default_str();
  app.add_flag("--leave-one-out", arguments.options.validation.leave_one_out,
               "Predict each configuration from all the others as well");
  app.add_flag("--nested", arguments.options.validation.nested,
               "Leave-one-out, with automatic choices made anew without each configuration as well");
  limit_count(app.add_option("--k-fold", arguments.options.validation.k_fold,
                             "Predict each of K groups of configurations from the others"),
              {2, 1000})
      ->type_name("K");
  limit_count(app.add_option("--threads", arguments.options.threads,
                             "Threads for refits and for passes over many configurations; 0: all"),
              {0, 1024});
}

void add_groups(CLI::App& app) {
  add_group(app, "Input",
            {"--measurements", "--joints-file", "--point-names", "--urdf", "--dh", "--base", "--tip", "--orientation",
             "--joint-convention", "--known-base", "--known-targets", "--predict-at"});
  add_group(
      app, "Output",
      {"--output", "--result", "--residuals", "--covariance", "--report", "--note", "--details", "--json", "--force"});
  add_group(app, "Model",
            {"--method", "--iterations", "--model", "--fix", "--free", "--keep-axes", "--prior", "--prior-length",
             "--prior-angle", "--prior-result", "--effects", "--gravity-direction", "--payload-centre"});
  add_group(app, "Noise",
            {"--loss", "--noise", "--noise-independent", "--noise-common", "--noise-tracker", "--orientation-sigma",
             "--scale-sigma", "--length-sigma"});
  add_group(app, "Validation", {"--leave-one-out", "--nested", "--k-fold", "--require", "--guard", "--threads"});
}

}  // namespace

Subcommand add_calibrate(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("calibrate", "Finds the geometric errors that explain measurements");
  const auto arguments = std::make_shared<CalibrateArguments>();
  add_robot_options(*app, arguments->robot);
  add_measurement_options(*app, arguments->measurements);
  add_file(*app, "--output", arguments->output, "Write the calibrated URDF");
  add_file(*app, "--result", arguments->result, "Write the result (JSON)");
  add_file(*app, "--predict-at", arguments->predict_at,
           "Predict the targets and their uncertainty at these configurations (CSV as measurements, no coordinates)");
  add_file(*app, "--residuals", arguments->residuals, "Write measured minus predicted point of every row (CSV)");
  add_file(*app, "--covariance", arguments->covariance, "Write the covariance of all estimated parameters (CSV)");
  add_report_file(*app, arguments->report);
  app->add_option("--note", arguments->notes, "Put key=value into the result, such as serial=R1234; repeatable")
      ->type_name("KEY=VALUE")
      ->allow_extra_args(false);
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  app->add_flag("--details", arguments->details, "Print every parameter, effect, frame and statistic as well");
  add_fit_options(*app, *arguments);
  add_noise_options(*app, *arguments);
  add_require(*app, arguments->requirements);
  add_guard(*app, arguments->guard);
  add_json_flag(*app, arguments->json);
  add_groups(*app);
  add_example(*app, "kdlcal calibrate --measurements measurements.csv --output calibrated.urdf --result result.json");
  const auto take_part = [arguments, &parser] {
    const CLI::Option* config = parser.get_config_ptr();
    arguments->config = config->count() > 0 ? config->as<std::string>() : "";
    return run(*arguments);
  };
  return {.app = app, .run = take_part};
}

}  // namespace kdl_calibration::cli
