#include "base/degree.hpp"
#include "kdl_calibration/measurements.hpp"
#include "planning/plate.hpp"
#include "planning/simulation.hpp"
#include "results/result_blocks.hpp"
#include "results/result_table.hpp"
#include "robot/joint_ranges.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "cli/frames.hpp"
#include "cli/joint_range_option.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/planned_cell.hpp"
#include "cli/progress.hpp"
#include "cli/report_pages.hpp"
#include "cli/simulate_arguments.hpp"
#include "cli/simulated_places.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "cli/truth_report.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/stations.hpp"
#include "model/reduction.hpp"
#include "planning/measuring_plan.hpp"
#include "planning/monte_carlo.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr int kTestsOfMonteCarlo = 100;  // configurations
constexpr int kHeldOutOfTwoStep = 1000;

Json ranges_json(const ErrorModel& model, const JointRanges& ranges) {
  Json list = Json::array();
  for (const std::size_t i : independent_joints(model.joints)) {
    list.push_back({{"joint", model.joints[i].name}, {"lower", ranges[i].first}, {"upper", ranges[i].second}});
  }
  return list;
}

struct Simulation {
  VirtualRobot robot;
  Measurements measurements;
  Json truth;
};

// Input of the simulation.
struct Setup {
  ErrorModel model;
  JointRanges ranges;
  std::vector<TargetFrame> targets;
  Reduction reduction;
  std::vector<std::size_t> with_errors;
  std::vector<EffectGroup> effects;
  std::optional<Measurements> plan;  ///< if given: configurations to fit, and their stations
  Eigen::Index configurations = 0;   ///< to fit
};

void require_few_rows(const SimulateArguments& arguments, std::size_t targets) {
  const double rows = static_cast<double>(arguments.configurations + arguments.test_configurations) *
                      static_cast<double>(arguments.noise.repeats) * static_cast<double>(targets);
  if (rows > kMostSimulatedRows) {
    throw InputError(fmt::format("--configurations, --test-configurations, --repeats: {:.0f} rows, expected at most {}",
                                 rows, kMostSimulatedRows));
  }
}

// A plan says itself from which station it measures.
void require_one_source(const SimulateArguments& arguments, const Measurements& plan) {
  if (plan.stations.size() < 2) {
    return;
  }
  if (arguments.places.stations > 1) {
    throw InputError(fmt::format("--stations: {} has {} stations, expected this option with other plans",
                                 arguments.plan, plan.stations.size()));
  }
  if (arguments.two_step > 0 || arguments.monte_carlo > 0) {
    throw InputError(fmt::format("--plan: {} has {} stations, expected one with --two-step, --monte-carlo",
                                 arguments.plan, plan.stations.size()));
  }
}

Setup setup(const Robot& robot, const SimulateArguments& arguments) {
  Setup result;
  result.model = complete_model(robot);
  result.ranges = joint_ranges(result.model, arguments.joint_ranges);
  result.targets =
      arguments.target_file.empty() ? published_targets(arguments.targets) : read_targets(arguments.target_file);
  for (TargetFrame& target : result.targets) {
    target.with_orientation = arguments.poses;
  }
  require_few_rows(arguments, result.targets.size());
  result.reduction = reduced_model(result.model, result.targets);
  result.with_errors = with_true_errors(result.model, result.reduction, arguments.model == "complete");
  result.effects = effect_groups(arguments.effects, {"none"});
  if (!arguments.plan.empty()) {
    result.plan = configurations_of(robot, arguments.plan, arguments.joint_convention);
    require_one_source(arguments, *result.plan);
  }
  result.configurations = result.plan ? result.plan->joint_values.cols() : arguments.configurations;
  if (arguments.places.stations > result.configurations) {
    throw InputError(fmt::format("--stations: {} of {} configurations, expected at least one for each station",
                                 arguments.places.stations, result.configurations));
  }
  require_one_ball(arguments.places, result.targets.size());
  if (arguments.touches_of_plan && result.targets.size() != 1) {
    throw InputError(fmt::format("--plan: {} touches the sockets of a plate, expected one target, a ball, and not {}",
                                 arguments.plan, result.targets.size()));
  }
  return result;
}

Eigen::MatrixXd to_fit(const SimulateArguments& arguments, const Setup& set, Random& random) {
  return set.plan ? set.plan->joint_values
                  : random_configurations(set.model.joints, set.ranges, arguments.configurations, random);
}

DrivenConfigurations driven(const SimulateArguments& arguments, const Setup& set, const Eigen::MatrixXd& stops,
                            const Eigen::MatrixXd& before = {}) {
  const bool torques = std::find(set.effects.begin(), set.effects.end(), EffectGroup::torque) != set.effects.end();
  return simulated_signals(set.model, stops, before,
                           {.approach = arguments.order,
                            .torques = torques,
                            .circumstances = std::any_of(set.effects.begin(), set.effects.end(), needed_circumstance),
                            .seed = arguments.seed});
}

// Adds the requested effects, drawn from a separate stream, so that all other random values stay the same.
void add_effects(const SimulateArguments& arguments, const Setup& set, VirtualRobot& robot) {
  constexpr int kToTellApart = 500;  // configurations
  constexpr std::uint64_t kStream = 1;
  if (set.effects.empty() || arguments.effect_sigma == 0.0) {
    return;
  }
  Random random(arguments.seed, kStream);
  const Eigen::MatrixXd q = random_configurations(set.model.joints, set.ranges, kToTellApart, random);
  kdl_calibration::add_effects(robot, set.effects, driven(arguments, set, q), arguments.effect_sigma, random);
}

// The truth file: the virtual robot and the drawn values of one set of measurements.
Json truth_of(const Robot& robot, const SimulateArguments& arguments, const Setup& set,
              const VirtualRobot& virtual_one) {
  Json truth = {{"seed", arguments.seed},
                {"urdf", robot.source},
                {"base_link", robot.base},
                {"tip_link", robot.tip},
                {"configurations", set.configurations},
                {"test_configurations", arguments.test_configurations},
                {"repeats", arguments.noise.repeats},
                {"noise", arguments.noise.sigma},
                {"orientation_noise", arguments.noise.orientation_sigma},
                {"joint_ranges", ranges_json(set.model, set.ranges)}};
  truth.update(drawn_json(virtual_one, set.with_errors, set.reduction));
  return truth;
}

bool has_own_stations(const Setup& set) { return set.plan && set.plan->stations.size() > 1; }

// Moves the robot's tracker to the stations of the plan, or as many as asked for, drawn from a stream of their own.
VirtualRobot at_places(VirtualRobot robot, const Setup& set, const SimulateArguments& arguments) {
  constexpr std::uint64_t kStream = 3;
  const int stations = has_own_stations(set) ? static_cast<int>(set.plan->stations.size()) : arguments.places.stations;
  if (stations < 2) {
    return robot;
  }
  Random random(arguments.seed, kStream);
  robot = robot_at_stations(std::move(robot), stations, random);
  if (has_own_stations(set)) {
    robot.model.stations = set.plan->stations;
  }
  return robot;
}

Simulation simulation(const Robot& robot, const SimulateArguments& arguments) {
  const Setup set = setup(robot, arguments);
  Random random(arguments.seed);
  Simulation result;
  result.robot = virtual_robot(set.model, set.with_errors, set.targets, arguments.sizes, random);
  add_effects(arguments, set, result.robot);
  if (arguments.touches_of_plan) {
    result.measurements = touch_as_planned(*set.plan, set.targets.front(), arguments.noise.sigma, random, result.robot);
    result.truth = truth_of(robot, arguments, set, result.robot);
    return result;
  }
  if (!arguments.places.sockets.empty()) {
    Plate plate = plate_of(places_of(arguments.places));
    plate.sigma = arguments.noise.sigma;
    result.measurements = touch(plate, set.ranges, set.configurations, random, result.robot);
    result.truth = truth_of(robot, arguments, set, result.robot);
    return result;
  }
  result.robot = at_places(std::move(result.robot), set, arguments);
  const Eigen::MatrixXd train = to_fit(arguments, set, random);
  DrivenConfigurations fitted = driven(arguments, set, train);
  if (has_own_stations(set)) {
    fitted.stations = stations_of_configurations(*set.plan);
  }
  result.measurements = measure(result.robot, fitted, arguments.noise, random);
  if (arguments.test_configurations > 0) {
    const Eigen::MatrixXd test =
        random_configurations(set.model.joints, set.ranges, arguments.test_configurations, random);
    result.measurements = joined(result.measurements, measure(result.robot, driven(arguments, set, test, train),
                                                              arguments.noise, random, Split::test));
  }
  result.measurements = along_directions(std::move(result.measurements), arguments.places.directions);
  if (arguments.order) {
    std::int64_t order = 0;
    for (Observation& observation : result.measurements.observations) {
      observation.order = ++order;
    }
  }
  result.truth = truth_of(robot, arguments, set, result.robot);
  return result;
}

std::string summary(const SimulateArguments& arguments, const Simulation& simulation) {
  const std::size_t terms = simulation.robot.model.effects.size();
  const std::string test =
      arguments.test_configurations > 0 ? fmt::format(" and {} to test", arguments.test_configurations) : "";
  return fmt::format(
      "{} configurations to fit{}, {}{}{} rows\n"
      "noise {} mm; {} true errors, lengths {} mm, angles {} deg (1 sigma); {}seed {}\n",
      simulation.truth["configurations"].dump(), test, simulation.measurements.targets.size(),
      arguments.poses ? " poses, " : " targets, ", simulation.measurements.observations.size(),
      fixed(arguments.noise.sigma * 1e3, 4), simulation.truth["parameters"].size(),
      fixed(arguments.sizes.length * 1e3, 3), fixed(arguments.sizes.angle / kDegree, 4),
      terms > 0 ? fmt::format("{} effects, {} mrad; ", terms, fixed(arguments.effect_sigma * 1e3, 3)) : "",
      arguments.seed);
}

// Settings of the simulation, for a page.
PageFacts in_words(const SimulateArguments& arguments, const Robot& robot, const Setup& set) {
  return {{"robot", robot.name},
          {"configurations", std::to_string(set.configurations)},
          {"targets", std::to_string(set.targets.size())},
          {"noise", fmt::format("{} mm of a coordinate, 1 sigma", fixed(arguments.noise.sigma * 1e3, 4))},
          {"true errors", fmt::format("lengths {} mm, angles {} deg, 1 sigma", fixed(arguments.sizes.length * 1e3, 3),
                                      fixed(arguments.sizes.angle / kDegree, 4))},
          {"seed", std::to_string(arguments.seed)}};
}

Json monte_carlo_json(const MonteCarloResult& result) {
  return {{"runs", result.runs},
          {"not_trusted", result.not_trusted},
          {"held_out_error",
           {{"all", statistics_json(result.all)},
            {"mean_of_run", statistics_json(result.means)},
            {"max_of_run", statistics_json(result.maxima)}}}};
}

// Refuses effects, which the calibrations of the runs do not support.
void require_no_effects(const SimulateArguments& arguments, const char* option) {
  if (!effect_groups(arguments.effects, {"none"}).empty()) {
    throw InputError("--effects: are of measurements that are written, expected none with " + std::string(option));
  }
}

// First and last of the runs to do, from 1.
std::pair<int, int> runs_to_do(const SimulateArguments& arguments) {
  const std::string& text = arguments.run_range;
  if (text.empty()) {
    return {1, arguments.monte_carlo};
  }
  const std::size_t colon = text.find(':');
  const std::optional<double> first = parsed_number(text.substr(0, colon));
  const std::optional<double> last = colon != std::string::npos ? parsed_number(text.substr(colon + 1)) : std::nullopt;
  const auto is_whole = [](const std::optional<double>& number) { return number && *number == std::floor(*number); };
  if (!is_whole(first) || !is_whole(last) || *first < 1.0 || *last < *first || *last > arguments.monte_carlo) {
    throw InputError("--run-range: " + shown(text) + ", expected FIRST:LAST with whole numbers from 1 to " +
                     std::to_string(arguments.monte_carlo));
  }
  return {static_cast<int>(*first), static_cast<int>(*last)};
}

// A row a run. Only the part with the first run has the heading, so that parts can be put behind each other.
std::string runs_csv(int first, const MonteCarloResult& result) {
  std::string csv = first == 1 ? "run,mean[m],rms[m],p95[m],max[m],trusted\n" : "";
  for (std::size_t r = 0; r < result.each.size(); ++r) {
    const ErrorStatistics& run = result.each[r];
    csv += fmt::format("{},{},{},{},{},{}\n", static_cast<std::size_t>(first) + r, shortest(run.mean),
                       shortest(run.rms), shortest(run.p95), shortest(run.max), result.trusted[r] ? 1 : 0);
  }
  return csv;
}

ExitStatus run_many(const SimulateArguments& arguments) {
  require_no_effects(arguments, "--monte-carlo");
  if (!arguments.output.empty() || !arguments.truth.empty()) {
    throw InputError("--monte-carlo: writes no measurements, expected it without --output and --truth");
  }
  const auto [first, last] = runs_to_do(arguments);
  std::vector<OutputFile> files = given_outputs({{"--runs", arguments.runs}, {"--report", arguments.report}});
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const Setup set = setup(robot, arguments);
  const int test = arguments.test_configurations > 0 ? arguments.test_configurations : kTestsOfMonteCarlo;
  Progress progress("simulating");
  const MonteCarlo experiment{
      .model = set.model,
      .with_errors = set.with_errors,
      .targets = set.targets,
      .sizes = arguments.sizes,
      .noise = arguments.noise,
      .train = [&](Random& random) { return to_fit(arguments, set, random); },
      .test = [&](Random& random) { return random_configurations(set.model.joints, set.ranges, test, random); },
      .calibration = {},
      .runs = last - first + 1,
      .first = first - 1,
      .seed = arguments.seed,
      .threads = arguments.threads,
      .progress = [&](double share) { progress(share); }};
  const MonteCarloResult result = run_monte_carlo(experiment);
  for (OutputFile& file : files) {
    file.text = file.option == "--runs"
                    ? runs_csv(first, result)
                    : monte_carlo_page(monte_carlo_json(result), experiment, result, in_words(arguments, robot, set));
  }
  write_whole(files, arguments.force,
              arguments.json
                  ? json_text(monte_carlo_json(result))
                  : fmt::format("{} runs, {} of them not to be trusted\n{}{}{}{}", result.runs, result.not_trusted,
                                statistics_heading("held-out error [mm]"), statistics_row("all points", result.all),
                                statistics_row("mean of a run", result.means),
                                statistics_row("largest of a run", result.maxima)));
  return done;
}

void require_two_step(const SimulateArguments& arguments) {
  require_no_effects(arguments, "--two-step");
  if (arguments.monte_carlo > 0) {
    throw InputError("--two-step: is one robot, expected it without --monte-carlo");
  }
  if (arguments.poses) {
    throw InputError("--two-step: estimates from points, expected it without --poses");
  }
  if (!arguments.output.empty()) {
    throw InputError("--two-step: measures anew in every round, expected it without --output");
  }
}

std::string two_step_heading(const SimulateArguments& arguments, const Setup& set, Eigen::Index held_out) {
  const std::string count = std::to_string(set.configurations);
  return fmt::format(
      "the two-step procedure against a virtual robot: in every round {} configurations, {} targets, noise {} mm; held "
      "out {} configurations; seed {}\n",
      arguments.recorded ? "the same " + count : count + " fresh", set.targets.size(),
      fixed(arguments.noise.sigma * 1e3, 4), held_out, arguments.seed);
}

// Rounds of the same robot with the other kind of measurements, recorded or fresh.
Json measured_the_other_way(const SimulateArguments& arguments, const Setup& set, TwoStepTrial trial) {
  Random random(arguments.seed);
  trial.robot = virtual_robot(set.model, set.with_errors, set.targets, arguments.sizes, random);
  trial.recorded = !arguments.recorded;
  trial.progress = {};
  return rounds_json(run_two_step_trial(trial, random));
}

ExitStatus run_two_step(const SimulateArguments& arguments) {
  require_two_step(arguments);
  std::vector<OutputFile> files = given_outputs({{"--truth", arguments.truth}, {"--report", arguments.report}});
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const Setup set = setup(robot, arguments);
  Random random(arguments.seed);
  Random elsewhere(arguments.seed, 1);
  Progress progress("rounds");
  const int held_out = arguments.test_configurations > 0 ? arguments.test_configurations : kHeldOutOfTwoStep;
  const TwoStepTrial trial{.robot = virtual_robot(set.model, set.with_errors, set.targets, arguments.sizes, random),
                           .configurations = [&](Random& numbers) { return to_fit(arguments, set, numbers); },
                           .noise = arguments.noise,
                           .rounds = arguments.two_step,
                           .recorded = arguments.recorded,
                           .held_out = random_configurations(set.model.joints, set.ranges, held_out, elsewhere),
                           .progress = std::ref(progress)};
  const TwoStepTrialResult result = run_two_step_trial(trial, random);
  const Estimate& estimate = result.identification.estimate;
  Json json = rounds_json(result);
  json.update({{"recorded", arguments.recorded}, {"seed", arguments.seed}});
  json.update(truth_json(set.model, estimate, trial.robot.truth, result.truth));
  for (OutputFile& file : files) {
    file.text = file.option == "--truth" ? json_text(truth_of(robot, arguments, set, trial.robot))
                                         : two_step_page(json, measured_the_other_way(arguments, set, trial),
                                                         in_words(arguments, robot, set));
  }
  std::string text;
  if (arguments.json) {
    text = json_text(json);
  } else {
    text = two_step_heading(arguments, set, trial.held_out.cols()) + rounds_table(result) + "\n" +
           truth_table(set.model, estimate, result.truth);
  }
  write_whole(files, arguments.force, text);
  return result.settled && result.truth.comparable() ? done : not_to_be_trusted;
}

// A plan says what is measured of its points.
void take_places_of_plan(SimulateArguments& arguments) {
  constexpr const char* kAll = "xyz";
  const std::string places = std::filesystem::exists(arguments.plan) ? planned_places(arguments.plan) : std::string();
  if (places == kTouches) {
    arguments.touches_of_plan = true;
    arguments.targets = arguments.target_file.empty() ? 1 : arguments.targets;
  } else if (!places.empty() && arguments.places.directions == kAll) {
    arguments.places.directions = places;
  }
}

ExitStatus run(SimulateArguments arguments) {
  if (arguments.angle_sigma_deg) {
    arguments.sizes.angle = *arguments.angle_sigma_deg * kDegree;
  }
  take_places_of_plan(arguments);
  require_places(arguments);
  if (arguments.two_step > 0) {
    return run_two_step(arguments);
  }
  if (arguments.recorded) {
    throw InputError("--recorded: says how --two-step measures, expected --two-step ROUNDS beside it");
  }
  if (arguments.monte_carlo > 0) {
    return run_many(arguments);
  }
  if (!arguments.runs.empty() || !arguments.run_range.empty()) {
    throw InputError("--runs, --run-range: are of --monte-carlo, expected it beside them");
  }
  if (!arguments.report.empty()) {
    throw InputError("--report: shows what --monte-carlo or --two-step found, expected one of them beside it");
  }
  if (arguments.output.empty() && arguments.json) {
    throw InputError("--json without --output: both would go to standard output, expected --output");
  }
  std::vector<OutputFile> files = given_outputs({{"--output", arguments.output}, {"--truth", arguments.truth}});
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const Simulation result = simulation(robot, arguments);
  const std::optional<JointConvention> convention = convention_of(arguments.joint_convention, robot);
  const std::string csv =
      convention ? measurements_csv(robot, result.measurements, *convention) : measurements_csv(result.measurements);
  const std::string truth = json_text(result.truth);
  for (OutputFile& file : files) {
    file.text = file.option == "--output" ? csv : truth;
  }
  write_whole(files, arguments.force,
              arguments.output.empty() ? csv
              : arguments.json         ? truth
                                       : summary(arguments, result));
  return done;
}

template <class Value>
CLI::Option* add_size(CLI::App& app, const std::string& name, Value& value, const std::string& unit,
                      const std::string& help) {
  return app.add_option(name, value, help)
      ->type_name(unit)
      ->check(number_from(0.0, "a number of " + unit + ", 0 or more"));
}

void add_sizes(CLI::App& app, SimulateArguments& arguments) {
  add_size(app, "--noise", arguments.noise.sigma, "metres", "1 sigma of every measured coordinate [0]");
  add_size(app, "--orientation-noise", arguments.noise.orientation_sigma, "radians",
           "1 sigma of every component of a measured orientation [0]");
  add_size(app, "--length-sigma", arguments.sizes.length, "metres", "1 sigma of the true length errors [0.0025]");
  CLI::Option* radians = add_size(app, "--angle-sigma", arguments.sizes.angle, "radians",
                                  "1 sigma of the true angle errors and joint offsets [3 degrees]");
  add_size(app, "--angle-sigma-deg", arguments.angle_sigma_deg, "degrees", "The same in degrees")->excludes(radians);
  add_size(app, "--base-sigma", arguments.sizes.base_position, "metres", "1 sigma of the base's displacement [0.002]");
  add_size(app, "--target-sigma", arguments.sizes.target_length, "metres",
           "1 sigma of the length of each tool [0.0025]");
}

}  // namespace

Subcommand add_simulate(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("simulate", "A virtual robot: draws true errors and measures them");
  const auto arguments = std::make_shared<SimulateArguments>();
  add_robot_options(*app, arguments->robot);
  add_count(*app, "--configurations", arguments->configurations, {1, 100'000}, "Configurations to fit");
  add_count(*app, "--test-configurations", arguments->test_configurations, {0, 100'000},
            "Further ones, marked as test");
  add_file(*app, "--plan", arguments->plan, "Fit the configurations of this plan (CSV) instead of random ones");
  add_file(*app, "--joint-convention", arguments->joint_convention,
           "Joints are the controller's (JSON), in the plan and in the measurements");
  add_count(*app, "--targets", arguments->targets, {1, 100}, "Targets on the tool")
      ->excludes(add_file(*app, "--target-file", arguments->target_file,
                          "Targets in the flange frame {\"targets\": [{\"name\", \"position\"}]} instead"));
  add_count(*app, "--repeats", arguments->noise.repeats, {1, 1'000}, "Times that each target is measured");
  add_place_options(*app, arguments->places);
  add_plate_options(*app, arguments->places);
  app->add_flag("--poses", arguments->poses, "Measure the targets' orientation as well");
  add_sizes(*app, *arguments);
  add_list(*app, "--effects", arguments->effects,
           "What moves the arm besides its geometry: " + comma_separated(effect_group_names()) + "; none")
      ->type_name("LIST")
      ->default_str("none");
  app->add_flag("--order", arguments->order,
                "Number the rows in the order of driving: backlash then has a part by the direction of approach");
  add_size(*app, "--effect-sigma", arguments->effect_sigma, "radians",
           "1 sigma of their coefficients, metres where a joint slides [0.0003]");
  add_word(*app, "--model", arguments->model, {"irreducible", "complete"},
           "Parameters with true errors: irreducible or complete");
  add_list(*app, "--joint-ranges", arguments->joint_ranges,
           "limits, published, or lower:upper of every joint in deg (mm for a prismatic one)")
      ->type_name("RANGES")
      ->default_str("limits");
  add_count(*app, "--monte-carlo", arguments->monte_carlo, {0, 1'000'000},
            "Draw, measure and calibrate this many robots and state the held-out errors");
  app->add_option("--run-range", arguments->run_range, "Do these runs alone, for several machines")
      ->type_name("FIRST:LAST");
  add_file(*app, "--runs", arguments->runs, "Write a row a run (CSV); parts put behind each other are the whole file");
  add_count(*app, "--threads", arguments->threads, {0, 1'024}, "Threads for that; 0: one per core");
  add_count(*app, "--two-step", arguments->two_step, {0, 100'000},
            "Run the published procedure for up to this many rounds, measuring fresh configurations in each");
  app->add_flag("--recorded", arguments->recorded, "With --two-step: the same measurements in every round");
  add_seed(*app, arguments->seed);
  add_file(*app, "--output", arguments->output, "Write the measurements (CSV) [standard output]");
  add_file(*app, "--truth", arguments->truth, "Write the true errors, base and targets (JSON)");
  add_file(*app, "--report", arguments->report,
           "With --monte-carlo or --two-step: write a page for people that opens in any browser (HTML)");
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_json_flag(*app, arguments->json);
  add_example(*app,
              "kdlcal simulate --configurations 30 --targets 3 --noise 0.00003 --seed 1 --output measurements.csv"
              " --truth truth.json\n"
              "  kdlcal simulate --joint-ranges published --two-step 10");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
