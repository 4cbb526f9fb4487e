#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <string>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "base/wrapped_text.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/report_pages.hpp"
#include "cli/requirements.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/result_file.hpp"
#include "kdl_calibration/validation.hpp"
#include "results/result_blocks.hpp"
#include "results/result_table.hpp"

namespace kdl_calibration::cli {
namespace {

struct CompareArguments {
  RobotArguments robot;
  std::string before;
  std::string after;
  std::vector<std::string> requirements;
  std::string report;
  bool force = false;
  bool json = false;
};

bool is_geometric(const ParameterChange& parameter) { return !parameter.unit.empty(); }

Json json(const Comparison& comparison) {
  Json parameters = Json::array();
  for (const ParameterChange& parameter : comparison.parameters) {
    parameters.push_back({{"name", parameter.name},
                          {"before", parameter.before},
                          {"change", parameter.change},
                          {"std", parameter.std},
                          {"unit", is_geometric(parameter) ? Json(parameter.unit) : Json()},
                          {"explained", parameter.explained}});
  }
  Json flange = statistics_json(comparison.flange);
  flange["sigma"] = comparison.flange_sigma;
  return {{"changed", comparison.has_changed()},
          {"p_value", comparison.p_value},
          {"chi_square", comparison.chi_square},
          {"degrees_of_freedom", comparison.degrees_of_freedom},
          {"noise_degrees_of_freedom", comparison.noise_degrees_of_freedom},
          {"flange", flange},
          {"parameters", parameters},
          {"not_compared", comparison.not_compared}};
}

std::string verdict(const Comparison& comparison) {
  constexpr double kLikely = 0.05;
  return comparison.has_changed()       ? "the robot has changed"
         : comparison.p_value < kLikely ? "the robot may have changed: measure again, or more configurations"
                                        : "no change found";
}

// The geometric errors whose change exceeds its sigma most.
std::string changes(const Comparison& comparison) {
  constexpr std::size_t kShown = 8;
  std::vector<ParameterChange> order;
  std::copy_if(comparison.parameters.begin(), comparison.parameters.end(), std::back_inserter(order), is_geometric);
  const auto excess = [](const ParameterChange& parameter) { return std::abs(parameter.change) / parameter.std; };
  std::sort(order.begin(), order.end(), [&](const auto& a, const auto& b) { return excess(a) > excess(b); });
  order.resize(std::min(order.size(), kShown));
  std::string text = "largest changes by their 1 sigma   before      change       sigma  explains alone\n";
  for (const ParameterChange& parameter : order) {
    const bool length = parameter.unit == "m";
    const double unit = length ? 1e3 : 1.0 / kDegree;
    text += padded("  " + parameter.name + (parameter.joint.empty() ? "" : ", " + parameter.joint), 24) +
            (length ? " mm " : " deg");
    for (const double value : {parameter.before, parameter.change, parameter.std}) {
      text += fmt::format("{:>12}", fixed(value * unit, length ? 4 : 5));
    }
    text += fmt::format("{:>14.0f} %\n", parameter.explained * 100.0);
  }
  return text;
}

std::string table(const Comparison& comparison) {
  std::string text = fmt::format("{} (p = {:.2g}; chi-squared {:.1f} of {:.0f} directions)\n", verdict(comparison),
                                 comparison.p_value, comparison.chi_square, comparison.degrees_of_freedom);
  text += statistics_heading("change of the flange [mm]", "poses") +
          statistics_row("base and tool aligned", comparison.flange);
  text += fmt::format("of an unchanged robot: {:.3f} mm rms\n", comparison.flange_sigma * 1e3);
  text += changes(comparison);
  if (!comparison.not_compared.empty()) {
    text +=
        wrapped("not compared, as only one of the results has them: " + comma_separated(comparison.not_compared), 0, 2);
  }
  return text;
}

ExitStatus run(const CompareArguments& arguments) {
  const std::vector<Requirement> requirements = parse_requirements(arguments.requirements);
  std::vector<OutputFile> files = given_outputs({{"--report", arguments.report}});
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const Calibration before = load_calibration(arguments.before, robot);
  const Comparison comparison = compare(before, load_calibration(arguments.after, robot));
  const Json result = json(comparison);
  const std::vector<Judged> outcomes = outcomes_of(requirements, result);
  for (OutputFile& file : files) {
    file.text = page_of_result(
        "comparison",
        with_files(result, arguments.robot, robot, {{"before", arguments.before}, {"after", arguments.after}}),
        {{"requirements", judged_json(outcomes)}});
  }
  write_whole(files, arguments.force, arguments.json ? json_text(result) : table(comparison) + outcome_lines(outcomes));
  const std::vector<std::string> missed = unfulfilled(outcomes);
  std::for_each(missed.begin(), missed.end(), print_requirement);
  return missed.empty() ? done : not_to_be_trusted;
}

}  // namespace

Subcommand add_compare(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand(
      "compare",
      "Has the robot changed between two results?\n"
      "Compares what two independent calibrations say of the arm. Base and targets may be others. A p-value below "
      "0.001 means that the robot has changed.");
  const auto arguments = std::make_shared<CompareArguments>();
  add_file(*app, "before", arguments->before, "The earlier result that calibrate wrote (JSON)")->required();
  add_file(*app, "after", arguments->after, "The later one")->required();
  add_robot_options(*app, arguments->robot);
  add_require(*app, arguments->requirements);
  add_report_file(*app, arguments->report);
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_json_flag(*app, arguments->json);
  add_example(*app,
              "kdlcal compare old.json new.json\n"
              "  kdlcal compare old.json new.json --require 'p_value>=0.001'");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
