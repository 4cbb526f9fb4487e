#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "base/wrapped_text.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_command.hpp"
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
  std::string joint_convention;
  std::vector<std::string> requirements;
  std::string report;
  bool force = false;
  bool json = false;
};

constexpr double kLikely = 0.05;

bool is_geometric(const ParameterChange& parameter) { return !parameter.unit.empty(); }

// The controller's joint that moves as this joint of the URDF alone does; the URDF's name without one.
std::string known_name(const std::string& joint, const std::optional<JointConvention>& convention) {
  if (!convention) {
    return joint;
  }
  const auto& names = convention->urdf_joints;
  const auto row = std::find(names.begin(), names.end(), joint) - names.begin();
  std::string known;
  for (Eigen::Index c = 0; row < convention->matrix.rows() && c < convention->matrix.cols(); ++c) {
    if (convention->matrix(row, c) != 0.0) {
      known += (known.empty() ? "" : " and ") + convention->controller_joints[static_cast<std::size_t>(c)];
    }
  }
  return known.empty() ? joint : known;
}

// The notes of a result, such as its serial number.
Json notes_of_result(const std::string& file) {
  const Json result = json_of(read_text_file(file), file);
  const bool has_notes = result.contains("provenance") && result["provenance"].contains("notes");
  return has_notes ? result["provenance"]["notes"] : Json::object();
}

std::string in_words(const Json& notes) {
  std::string text;
  for (const auto& [key, value] : notes.items()) {
    text += (text.empty() ? "" : ", ") + key + " " + (value.is_string() ? one_line(value.get<std::string>()) : "");
  }
  return text.empty() ? "no notes" : text;
}

// Notes that both results have and that should be the same.
std::vector<std::string> other_conditions(const Json& before, const Json& after) {
  std::vector<std::string> differences;
  for (const char* key : {"serial", "payload"}) {
    if (text_at(before, key) != text_at(after, key) && before.contains(key) && after.contains(key)) {
      differences.push_back(
          fmt::format("{} was {}, and is {}", key, shown(text_at(before, key)), shown(text_at(after, key))));
    }
  }
  return differences;
}

std::string advice(const Comparison& comparison) {
  return comparison.has_changed()
             ? "Find out what happened (collision, exchanged motor or gear, mastering, other base or load). Programs "
               "and "
               "URDFs of the earlier result are not valid: calibrate, with few configurations and --prior-result"
         : comparison.p_value < kLikely ? "Measure again, or more configurations, before anything is changed"
                                        : "Keep using the earlier result";
}

Json json(const Comparison& comparison, const std::optional<JointConvention>& convention) {
  Json parameters = Json::array();
  for (const ParameterChange& parameter : comparison.parameters) {
    parameters.push_back({{"name", parameter.name},
                          {"joint", known_name(parameter.joint, convention)},
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
          {"advice", advice(comparison)},
          {"not_compared", comparison.not_compared},
          {"same_measurements", comparison.same_measurements}};
}

std::string verdict(const Comparison& comparison) {
  return comparison.has_changed()       ? "the robot has changed"
         : comparison.p_value < kLikely ? "the robot may have changed"
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
std::string changes(const Comparison& comparison, const std::optional<JointConvention>& convention) {
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
    text +=
        padded("  " + parameter.name + (parameter.joint.empty() ? "" : ", " + known_name(parameter.joint, convention)),
               24) +
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

std::string table(const Comparison& comparison, const std::optional<JointConvention>& convention) {
  std::string text = fmt::format("{} (p = {:.2g}; chi-squared {:.1f} of {:.0f} directions)\n", verdict(comparison),
                                 comparison.p_value, comparison.chi_square, comparison.degrees_of_freedom);
  text += statistics_heading("change of the flange [mm]", "poses") +
          statistics_row("base and tool aligned", comparison.flange);
  text += fmt::format("of an unchanged robot: {:.3f} mm rms\n", comparison.flange_sigma * 1e3);
  text += changes(comparison, convention);
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
  return text + wrapped("What to do: " + advice(comparison) + ".", 0, 2);
}

// A result after its mastering was entered is of the same arm, whose controller counts in another way.
void require_two_calibrations(const CompareArguments& arguments) {
  for (const auto& [one, other] : {std::pair{arguments.before, arguments.after}, {arguments.after, arguments.before}}) {
    const Json result = read_json(one);
    const Json entry = result.is_object() ? result.value("mastering_entered", Json()) : Json();
    if (text_at(entry, "sha256_of_earlier_result") == sha256_of_file(other)) {
      throw InputError(one + ": is " + other +
                       " after its mastering was entered, expected results of two calibrations");
    }
  }
}

ExitStatus run(const CompareArguments& arguments) {
  const std::vector<Requirement> requirements = parse_requirements(arguments.requirements);
  std::vector<OutputFile> files = given_outputs({{"--report", arguments.report}});
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  require_two_calibrations(arguments);
  const Calibration before = load_calibration(arguments.before, robot);
  const Comparison comparison = compare(before, load_calibration(arguments.after, robot));
  const std::optional<JointConvention> convention = convention_of(arguments.joint_convention, robot);
  Json result = json(comparison, convention);
  const Json notes_before = notes_of_result(arguments.before);
  const Json notes_after = notes_of_result(arguments.after);
  result["notes"] = {{"before", notes_before}, {"after", notes_after}};
  const std::vector<Judged> outcomes = outcomes_of(requirements, result);
  for (OutputFile& file : files) {
    file.text = page_of_result(
        "comparison",
        with_files(result, arguments.robot, robot, {{"before", arguments.before}, {"after", arguments.after}}),
        {{"requirements", judged_json(outcomes)}});
  }
  write_whole(files, arguments.force,
              arguments.json ? json_text(result)
                             : "before: " + in_words(notes_before) + "\nafter: " + in_words(notes_after) + "\n" +
                                   table(comparison, convention) + outcome_lines(outcomes));
  for (const std::string& difference : other_conditions(notes_before, notes_after)) {
    warn(difference + ": the results may be of other robots or conditions");
  }
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
  add_file(*app, "--joint-convention", arguments->joint_convention, "Names of the controller's joints (JSON)");
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
