#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <string>
#include <utility>
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
          {"misfit_factor", comparison.misfit_factor},
          {"flange", flange},
          {"parameters", parameters},
          {"unseen_zeros", comparison.unseen_zeros},
          {"not_compared", comparison.not_compared},
          {"same_measurements", comparison.same_measurements}};
}

std::string verdict(const Comparison& comparison) {
  constexpr double kLikely = 0.05;
  return comparison.has_changed()       ? "the robot has changed"
         : comparison.p_value < kLikely ? "the robot may have changed: measure again, or more configurations"
                                        : "no change found";
}

// Unit and decimals in which a parameter is printed.
std::pair<double, int> scale_of(const ParameterChange& parameter) {
  return parameter.unit == "m" ? std::pair(1e3, 4) : std::pair(1.0 / kDegree, 5);
}

bool is_printed_as_zero(const ParameterChange& parameter) {
  const auto [unit, decimals] = scale_of(parameter);
  return std::abs(parameter.change) * unit < 0.5 * std::pow(10.0, -decimals);
}

// The geometric errors whose change exceeds its sigma most; none that did not change.
std::string changes(const Comparison& comparison) {
  constexpr std::size_t kShown = 8;
  std::vector<ParameterChange> order;
  std::copy_if(comparison.parameters.begin(), comparison.parameters.end(), std::back_inserter(order),
               [](const auto& parameter) { return is_geometric(parameter) && !is_printed_as_zero(parameter); });
  if (order.empty()) {
    return {};
  }
  const auto excess = [](const ParameterChange& parameter) { return std::abs(parameter.change) / parameter.std; };
  std::sort(order.begin(), order.end(), [&](const auto& a, const auto& b) { return excess(a) > excess(b); });
  order.resize(std::min(order.size(), kShown));
  std::string text = "largest changes by their 1 sigma   before      change       sigma  explains alone\n";
  for (const ParameterChange& parameter : order) {
    const auto [unit, decimals] = scale_of(parameter);
    text += padded("  " + parameter.name + (parameter.joint.empty() ? "" : ", " + parameter.joint), 24) +
            (parameter.unit == "m" ? " mm " : " deg");
    for (const double value : {parameter.before, parameter.change, parameter.std}) {
      text += fmt::format("{:>12}", fixed(value * unit, decimals));
    }
    text += fmt::format("{:>14.0f} %\n", parameter.explained * 100.0);
  }
  return text;
}

// "ripple.2.*" for ripple.2.sin20.55 and so on, each once.
std::vector<std::string> patterns_of(const std::vector<std::string>& names) {
  std::vector<std::string> result;
  for (const std::string& name : names) {
    const std::size_t end = name.find('.', name.find('.') + 1);
    const std::string pattern = end == std::string::npos ? name : name.substr(0, end) + ".*";
    if (std::find(result.begin(), result.end(), pattern) == result.end()) {
      result.push_back(pattern);
    }
  }
  return result;
}

std::string table(const Comparison& comparison) {
  std::string text = fmt::format("{} (p = {:.2g}; chi-squared {:.1f} of {:.0f} directions)\n", verdict(comparison),
                                 comparison.p_value, comparison.chi_square, comparison.degrees_of_freedom);
  text += statistics_heading("change of the flange [mm]", "poses") +
          statistics_row("base and tool aligned", comparison.flange);
  text += fmt::format("of an unchanged robot: {:.3f} mm rms\n", comparison.flange_sigma * 1e3);
  text += changes(comparison);
  if (!comparison.unseen_zeros.empty()) {
    text += wrapped("a changed zero does not show in " + comma_separated(comparison.unseen_zeros) +
                        ": a moved base or tool would look the same; calibrate both times with the same --known-base "
                        "and --known-targets",
                    0, 2);
  }
  if (!comparison.not_compared.empty()) {
    text += wrapped(
        "not compared, as only one of the results has them: " + comma_separated(patterns_of(comparison.not_compared)),
        0, 2);
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
  if (comparison.same_measurements) {
    warn("both results are of the same measurements, which cannot show whether the robot has changed");
  }
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
