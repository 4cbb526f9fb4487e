#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <sstream>
#include <utility>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "cli/cell_options.hpp"
#include "cli/frames.hpp"
#include "cli/measurement_options.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_arguments.hpp"
#include "cli/plan_command.hpp"
#include "cli/plan_summary.hpp"
#include "cli/planned_cell.hpp"
#include "cli/progress.hpp"
#include "cli/report_pages.hpp"
#include "cli/robot_controller.hpp"
#include "cli/simulated_places.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/measuring_plan.hpp"
#include "planning/measuring_plan.hpp"
#include "planning/places_plan.hpp"
#include "planning/planner.hpp"
#include "programs/measuring_program.hpp"
#include "programs/program_language.hpp"
#include "results/saved_calibration.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

using Eigen::Index;

constexpr int kMostForAccuracy = 500;

// Targets from a file, else from the result, else registered to the measured file on the nominal robot.
FacingTargets targets(const PlanArguments& arguments, const ErrorModel& model, const PlanRequest& request) {
  if (!arguments.target_file.empty()) {
    return read_facing_targets(arguments.target_file);
  }
  if (request.calibrated && !request.calibrated->estimate.frames.targets.empty()) {
    return {.targets = request.calibrated->estimate.frames.targets, .facing = {}};
  }
  if (request.measured) {
    return {.targets = nominal_start(model, *request.measured).frames.targets, .facing = {}};
  }
  return {.targets = published_targets(arguments.targets), .facing = {}};
}

Eigen::VectorXd home(const PlanArguments& arguments, const PlanSetting& setting) {
  const std::vector<MovingJoint>& joints = setting.request.robot.joints;
  const std::vector<std::size_t> independent = independent_joints(joints);
  const std::size_t count = independent.size();
  Eigen::VectorXd values = Eigen::VectorXd::Zero(static_cast<Index>(count));
  if (arguments.home.empty()) {
    return all_joint_values(joints, values);
  }
  const std::vector<double> given =
      numbers("--home", arguments.home, count, fmt::format("{} joint values in degrees (mm for lengths)", count));
  for (std::size_t i = 0; i < count; ++i) {
    const bool length = value_is_length(setting.request.robot, setting.joint_convention(), static_cast<Index>(i));
    values[static_cast<Index>(i)] = given[i] * (length ? 1e-3 : kDegree);
  }
  if (setting.convention) {
    values = (setting.convention->matrix * values + setting.convention->offset).eval();
  }
  return all_joint_values(joints, values);
}

PointNoise noise(const PlanArguments& arguments, const Cell& cell) {
  PointNoise noise = arguments.noise;
  noise.tracker = tracker_noise(arguments.tracker_noise);
  if (noise.tracker) {
    if (!cell.tracker) {
      throw InputError("--noise-tracker: depends on where the tracker stands, expected --tracker x,y,z beside it");
    }
    noise.tracker_position = cell.tracker->position;
  }
  return noise;
}

Criterion criterion(const std::string& name) {
  return name == "D" ? Criterion::d_optimal : name == "G" ? Criterion::g_optimal : Criterion::i_optimal;
}

Figure figure(const std::string& name) {
  return name == "mean" ? Figure::mean : name == "p95" ? Figure::p95 : Figure::max;
}

// The URDF's joints of a controller's, each once: those that its zero turns. Names of the URDF stay.
std::vector<std::string> suspects(const std::vector<std::string>& named, const JointConvention* convention) {
  if (convention == nullptr) {
    return named;
  }
  std::vector<std::string> joints;
  const auto add = [&](const std::string& joint) {
    if (std::find(joints.begin(), joints.end(), joint) == joints.end()) {
      joints.push_back(joint);
    }
  };
  const std::vector<std::string>& of_controller = convention->controller_joints;
  for (const std::string& name : named) {
    const auto found = std::find(of_controller.begin(), of_controller.end(), name);
    if (found == of_controller.end()) {
      add(name);
      continue;
    }
    const auto column = convention->matrix.col(std::distance(of_controller.begin(), found));
    for (Index row = 0; row < column.size(); ++row) {
      if (column[row] != 0.0) {
        add(convention->urdf_joints[static_cast<std::size_t>(row)]);
      }
    }
  }
  return joints;
}

// The first words, "--clearance", of these options.
std::set<std::string> options_in(const std::string& cell) {
  std::set<std::string> options;
  std::istringstream words(cell);
  for (std::string word; words >> word;) {
    if (word.starts_with("--") && word != "--frame") {
      options.insert(word);
    }
  }
  return options;
}

void warn_of_planned_cell(const PlanArguments& arguments, const std::string& file, const std::string& cell) {
  const std::set<std::string> planned = options_in(cell);
  const std::set<std::string> stated = options_in(cell_note(arguments.cell));
  if (!std::includes(stated.begin(), stated.end(), planned.begin(), planned.end())) {
    warn(file + " was planned with " + cell + ", which limits this plan only if it is stated again");
  }
}

// Where this plan is in another cell than that of the result in this file, or counts joints in another way.
void warn_of_other_plan(const PlanArguments& arguments, const std::string& file) {
  const Json result = read_json(file);
  warn_of_planned_cell(arguments, file, planned_cell_of(result));
  if (!arguments.joint_convention.empty()) {
    warn_of_other_convention(result, file, arguments.joint_convention);
  } else if (hash_of_input(result, "joint-convention")) {
    warn(file + " was made with --joint-convention; without it joint values and places of this plan are the URDF's");
  }
}

PlanSetting setting(const PlanArguments& arguments) {
  PlanSetting result;
  PlanRequest& request = result.request;
  request.robot = load(arguments.robot);
  const ErrorModel model = complete_model(request.robot);
  result.convention = convention_of(arguments.joint_convention, request.robot);
  const JointConvention* convention = result.joint_convention();
  if (!arguments.measured.measurements.empty()) {
    MeasurementArguments measured = arguments.measured;
    measured.joint_convention = arguments.joint_convention;
    request.measured = read(measured, request.robot);
    if (request.measured->stations.size() > 1) {
      throw InputError(fmt::format("--measured: {} is of {} stations, expected one; --stations plans anew for several",
                                   measured.measurements, request.measured->stations.size()));
    }
    warn_of_planned_cell(arguments, measured.measurements, planned_cell_of(measured));
  }
  for (const std::string& file : {arguments.result, arguments.after}) {
    if (!file.empty()) {
      request.calibrated = read_result(file, request.robot);
      warn_of_other_plan(arguments, file);
    }
  }
  if (!arguments.after.empty()) {
    request.suspects = suspects(arguments.suspects, convention);
  }
  const FacingTargets facing = targets(arguments, model, request);
  request.targets = facing.targets;
  if (arguments.cell.frame.empty() ? convention != nullptr : arguments.cell.frame == "world") {
    result.X_BW = controller_of_robot(request.robot).X_BW;
    result.is_world = true;
  }
  request.cell = cell(arguments.cell, request.robot, facing, convention, result.X_BW);
  request.noise = noise(arguments, request.cell);
  request.priors = arguments.priors;
  request.effects = effect_groups(arguments.effects, {"none"});
  const int usual = arguments.accuracy_mm      ? kMostForAccuracy
                    : !arguments.after.empty() ? kConfigurationsAfter
                                               : kConfigurationsToPlan;
  request.count = arguments.add.value_or(arguments.configurations.value_or(usual));
  if (arguments.accuracy_mm) {
    request.accuracy = *arguments.accuracy_mm * 1e-3;
  }
  request.accuracy_of = figure(arguments.accuracy_of);
  request.criterion = criterion(arguments.criterion);
  request.starts = arguments.starts;
  request.candidates = arguments.candidates;
  if (!arguments.tasks.empty()) {
    request.tasks = read_configurations(request.robot, arguments.tasks, convention).joint_values;
  }
  request.workspace = arguments.workspace;
  request.home = home(arguments, result);
  request.monte_carlo = arguments.monte_carlo;
  request.seed = arguments.seed;
  request.threads = arguments.threads;
  return result;
}

void require_sound(const PlanArguments& arguments) {
  if (arguments.monte_carlo > 0 && arguments.effects != std::vector<std::string>{"none"}) {
    throw InputError("--monte-carlo: tries the plan on rigid arms, expected it without --effects");
  }
  if (arguments.add && arguments.measured.measurements.empty() && arguments.result.empty()) {
    throw InputError("--add: adds to configurations that were measured, expected --measured FILE or --result FILE");
  }
  if (!arguments.measured.measurements.empty() && !arguments.result.empty()) {
    throw InputError("--result: --measured says what was measured, expected one of the two");
  }
  if (arguments.monte_carlo > 0 && !(arguments.result.empty() && arguments.after.empty())) {
    throw InputError(
        fmt::format("--monte-carlo: repeats the measurements themselves, expected --measured FILE instead of {}",
                    arguments.result.empty() ? "--after" : "--result"));
  }
  if (arguments.add && arguments.configurations) {
    throw InputError("--configurations: --add says how many to choose, expected one of the two");
  }
}

// ---- Several stations, single coordinates, distances, touches ------------------------------------------------------

// Options of a plan for whole points from one station.
void require_no_others(const PlanArguments& arguments) {
  const std::vector<std::pair<const char*, bool>> others = {
      {"--measured", !arguments.measured.measurements.empty()},
      {"--result", !arguments.result.empty()},
      {"--after", !arguments.after.empty()},
      {"--accuracy", arguments.accuracy_mm.has_value()},
      {"--criterion", arguments.criterion != "D"},
      {"--effects", arguments.effects != std::vector<std::string>{"none"}},
      {"--noise-tracker", !arguments.tracker_noise.empty()},
      {"--configuration-noise", arguments.noise.configuration_sigma > 0.0},
      {"--prior-length", arguments.priors.length > 0.0},
      {"--prior-angle", arguments.priors.angle > 0.0},
      {"--tracker", !arguments.cell.tracker.empty()},
      {"--monte-carlo", arguments.monte_carlo > 0},
      {"--report", !arguments.report.empty()}};
  for (const auto& [option, is_given] : others) {
    if (is_given) {
      throw InputError(
          std::string(option) +
          ": is for whole points from one station, expected none with --stations, --sockets, --directions");
    }
  }
}

// The language of --program. A FANUC controller counts joints in its own way.
const ProgramLanguage* program_language_of(const PlanArguments& arguments) {
  if (arguments.program.empty()) {
    return nullptr;
  }
  const ProgramLanguage& language = language_of_file(arguments.program);
  if (language.needs_description && arguments.joint_convention.empty()) {
    throw InputError(
        fmt::format("--program: {} counts joints in its own way, expected --joint-convention FILE", language.name));
  }
  return &language;
}

std::string program_of(const PlanArguments& arguments, const PlanSetting& setting, const MeasuringPlan& sheet,
                       const ProgramLanguage& language) {
  return measuring_program(setting.request.robot, sheet, setting.joint_convention(), language,
                           std::filesystem::path(arguments.program).stem().string());
}

std::string sheet_csv(const PlanArguments& arguments, const PlanSetting& set, const MeasuringPlan& sheet) {
  const std::string csv = plan_csv(sheet, set.request.robot.joints, set.joint_convention());
  return arguments.decimal_comma ? with_decimal_commas(csv) : csv;
}

void warn_of_narrowed(const Robot& robot, const std::vector<NarrowedRange>& ranges) {
  for (const NarrowedRange& range : ranges) {
    const MovingJoint& joint = robot.joints[range.joint];
    const bool length = joint.type == JointType::prismatic;
    std::string parts;
    for (const auto& [lower, upper] : range.left_out) {
      const double unit = length ? 1e-3 : kDegree;
      parts += fmt::format("{}{} to {}", parts.empty() ? "" : " and ", fixed(lower / unit, 0), fixed(upper / unit, 0));
    }
    warn(
        fmt::format("joint {}: the plan uses {:.0f} % of its range, and leaves out {} {}; most configurations there "
                    "are refused by {}{}",
                    shown(joint.name), 100.0 * range.share, parts, length ? "mm" : "deg", range.cause.constraint,
                    range.cause.links.empty() ? "" : ", mostly between " + range.cause.links));
  }
}

// For the command that plans further configurations of the same cell.
void add_cell_note(const PlanArguments& arguments, const PlanSetting& set, MeasuringPlan& sheet) {
  CellArguments cell = arguments.cell;
  if (has_places(cell)) {
    cell.frame = set.is_world ? "world" : "base";
  }
  if (const std::string note = cell_note(cell); !note.empty()) {
    sheet.notes.push_back(note);
  }
}

ExitStatus run_at_places(const PlanArguments& arguments, Places places) {
  require_no_others(arguments);
  std::vector<OutputFile> files = given_outputs({{"--output", arguments.output}, {"--program", arguments.program}});
  require_writable(files, arguments.force);
  const ProgramLanguage* language = program_language_of(arguments);
  PlanSetting set = setting(arguments);
  require_one_ball(arguments.places, set.request.targets.size());
  places.lowest += set.X_BW.translation().z();
  places.highest += set.X_BW.translation().z();
  Progress choosing("choosing");
  set.request.choosing = [&](double share) { choosing(share); };
  PlacesPlan plan = plan_at_places(set.request, places);
  warn_of_narrowed(set.request.robot, plan.narrowed);
  add_cell_note(arguments, set, plan.sheet);
  plan.sheet.notes.push_back(places_note(arguments.places));
  for (OutputFile& file : files) {
    file.text = file.option == "--program" ? program_of(arguments, set, plan.sheet, *language)
                                           : sheet_csv(arguments, set, plan.sheet);
  }
  write_whole(files, arguments.force,
              arguments.json ? json_of_plan(arguments, set, plan) : table_of_plan(arguments, set, plan));
  return done;
}

std::string page_of(const PlanArguments& arguments, const PlanSetting& set, const Plan& plan) {
  const std::string noise = plan.experiment.noise.tracker
                                ? "of the tracker"
                                : fixed(arguments.noise.sigma * 1e3, 4) + " mm of a coordinate, 1 sigma";
  return plan_page(json_of(json_of_plan(arguments, set, plan), "the plan"),
                   {.request = set.request,
                    .plan = plan,
                    .setup = {{"noise", noise}, {"seed", std::to_string(arguments.seed)}},
                    .convention = set.joint_convention(),
                    .frame = set.is_world ? "world" : set.request.robot.base,
                    .X_BW = set.X_BW});
}

ExitStatus run(const PlanArguments& arguments) {
  require_sound(arguments);
  require_directions(arguments.places);
  if (const Places places = places_of(arguments.places); are_special(places)) {
    return run_at_places(arguments, places);
  }
  std::vector<OutputFile> files =
      given_outputs({{"--output", arguments.output}, {"--program", arguments.program}, {"--report", arguments.report}});
  require_writable(files, arguments.force);
  const ProgramLanguage* language = program_language_of(arguments);
  PlanSetting set = setting(arguments);
  Progress choosing("choosing");
  set.request.choosing = [&](double share) { choosing(share); };
  Progress trying("Monte Carlo");
  set.request.trying = [&](double share) { trying(share); };
  Plan result = make_plan(set.request);
  warn_of_narrowed(set.request.robot, result.narrowed);
  for (const std::string& warning : result.sheet.warnings) {
    warn("--suspect: " + warning);
  }
  add_cell_note(arguments, set, result.sheet);
  if (!arguments.after.empty()) {
    result.sheet.notes.push_back("Filled in, it is for kdlcal calibrate --prior-result " + arguments.after + ".");
  }
  for (OutputFile& file : files) {
    file.text = file.option == "--program"  ? program_of(arguments, set, result.sheet, *language)
                : file.option == "--output" ? sheet_csv(arguments, set, result.sheet)
                                            : page_of(arguments, set, result);
  }
  write_whole(files, arguments.force,
              arguments.json ? json_of_plan(arguments, set, result) : table_of_plan(arguments, set, result));
  return done;
}

void add_counts(CLI::App& app, PlanArguments& arguments) {
  limit_count(
      app.add_option("--configurations", arguments.configurations,
                     "Configurations to choose [30, with --after 8]; with --accuracy the most that may be [500]"),
      {1, kMostPlanned});
  add_file(app, "--measured", arguments.measured.measurements, "Plan on top of these measurements (CSV)");
  add_reading_options(app, "--measured", arguments.measured);
  for (const char* name : {"--joints-file", "--exclude", "--orientation"}) {
    app.get_option(name)->needs("--measured");
  }
  add_file(app, "--result", arguments.result, "Plan on top of what this calibration knows, at its geometry (JSON)");
  add_file(app, "--after", arguments.after,
           "Tell what has changed since this calibration, with base and targets anew, and mend it (JSON): [8] "
           "configurations for calibrate --prior-result")
      ->excludes("--measured", "--result");
  add_list(app, "--suspect", arguments.suspects, "Joints that may have changed [all]")
      ->type_name("JOINT,...")
      ->needs("--after");
  limit_count(app.add_option("--add", arguments.add, "With --measured or --result: configurations to add"),
              {1, kMostPlanned});
  app.add_option("--accuracy", arguments.accuracy_mm, "As few configurations as promise this 1 sigma, mm")
      ->type_name("MM")
      ->check(number_between(1e-6, 1e6, "millimetres from 1e-6 to 1e6"));
  add_word(app, "--accuracy-of", arguments.accuracy_of, {"mean", "p95", "max"},
           "Which figure --accuracy means: mean, p95 or max");
  add_count(app, "--candidates", arguments.candidates, {1, 1'000'000}, "Configurations to choose from");
  add_count(app, "--workspace", arguments.workspace, {1, 100'000}, "Other configurations at which to predict");
  add_file(app, "--tasks", arguments.tasks, "Predict at these configurations instead (CSV like a plan)");
  add_word(app, "--criterion", arguments.criterion, {"D", "G", "I"},
           "D: smallest confidence ellipsoid, G: smallest worst variance, I: smallest mean variance");
  add_count(app, "--starts", arguments.starts, {1, 1'000}, "Random designs to start from");
}

void add_experiment(CLI::App& app, PlanArguments& arguments) {
  CLI::Option* file = add_file(app, "--target-file", arguments.target_file,
                               "Targets in the flange frame {\"targets\": [{\"name\", \"position\"[, \"facing\"]}]}");
  add_place_options(app, arguments.places);
  add_plate_options(app, arguments.places);
  add_count(app, "--targets", arguments.targets, {1, 100}, "Targets on the tool, the published ones")
      ->excludes(file, app.get_option("--measured"), app.get_option("--result"), app.get_option("--after"));
  app.add_option("--noise", arguments.noise.sigma, "1 sigma of every measured coordinate, m")
      ->type_name("M")
      ->check(number_between(1e-12, 1.0, "metres from 1e-12 to 1"))
      ->capture_default_str();
  app.add_option("--configuration-noise", arguments.noise.configuration_sigma,
                 "1 sigma that all targets of a configuration share, m")
      ->type_name("M")
      ->check(number_from(0.0, "a length in metres, 0 or more"))
      ->capture_default_str();
  add_tracker_noise(app, arguments.tracker_noise);
  add_list(app, "--effects", arguments.effects,
           "Effects to learn as well, as found by --result where it is given: " +
               comma_separated(effect_group_names()) + "; none: geometry alone")
      ->type_name("LIST")
      ->default_str("none");
  app.add_option("--prior-length", arguments.priors.length, "1 sigma of length errors beforehand, m; 0: none")
      ->type_name("M")
      ->check(number_from(0.0, "a length in metres, 0 or more"))
      ->capture_default_str();
  app.add_option("--prior-angle", arguments.priors.angle, "1 sigma of angle errors beforehand, rad; 0: none")
      ->type_name("RAD")
      ->check(number_from(0.0, "an angle in radians, 0 or more"))
      ->capture_default_str();
}

}  // namespace

Subcommand add_plan(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("plan", "Chooses the configurations to measure and says what they will give");
  const auto arguments = std::make_shared<PlanArguments>();
  add_robot_options(*app, arguments->robot);
  add_counts(*app, *arguments);
  add_experiment(*app, *arguments);
  add_cell_options(*app, arguments->cell);
  add_file(*app, "--joint-convention", arguments->joint_convention,
           "Joint values in files and options are the controller's (JSON)");
  app->add_option("--home", arguments->home, "Where the way starts, joint values in deg or mm [all zero]")
      ->type_name("q1,…,qn");
  add_count(*app, "--monte-carlo", arguments->monte_carlo, {0, 100'000}, "Try the plan on this many virtual robots");
  add_seed(*app, arguments->seed);
  add_count(*app, "--threads", arguments->threads, {0, 1'024}, "Threads; 0: one per core. The plan is the same");
  add_file(*app, "--output", arguments->output, "Write the plan (CSV) that calibrate reads once it is filled in");
  app->add_flag("--decimal-comma", arguments->decimal_comma,
                "With decimal commas and semicolons, for spreadsheets of such a language")
      ->needs("--output");
  add_file(
      *app, "--program", arguments->program,
      "Write the plan as a robot program that drives slowly and stops at each configuration: .LS, .script, .mod or "
      ".src; check the way for collisions first");
  add_report_file(*app, arguments->report);
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_json_flag(*app, arguments->json);
  add_example(*app, "kdlcal plan --configurations 30 --least-height 0.2 --least-radius 0.7 --output plan.csv");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
