#include "cli/requirements.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "base/degree.hpp"
#include "base/text.hpp"
#include "cli/help.hpp"
#include "cli/options.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

[[noreturn]] void refuse(const std::string& text, const std::string& expected) {
  throw InputError("--require: " + shown(text) + " is not accepted, expected " + expected);
}

// Names of the result's numbers that have no unit, or not all the same one: these are in SI units.
const std::set<std::string> kNumbers = {"rank",
                                        "estimate",
                                        "scale_sigma",
                                        "condition",
                                        "iterations",
                                        "count",
                                        "folds",
                                        "configurations",
                                        "outside",
                                        "candidates",
                                        "observations",
                                        "variance_factor",
                                        "F",
                                        "p_value",
                                        "chi_square",
                                        "explained",
                                        "noise_degrees_of_freedom",
                                        "misfit_factor",
                                        "shifts",
                                        "convergence_factor",
                                        "O1",
                                        "O2",
                                        "O3",
                                        "O4",
                                        "O5",
                                        "radius_factor",
                                        "leverage",
                                        "leverage_limit",
                                        "cook",
                                        "cook_limit",
                                        "evidence",
                                        "point_cook_limit",
                                        "weights",
                                        "singular_values",
                                        "repeat",
                                        "explained_by_joint",
                                        "degrees_of_freedom",
                                        "degrees_of_freedom_of_point",
                                        "coverage_factor",
                                        "repeat_degrees_of_freedom",
                                        "coefficient",
                                        "scale",
                                        "link",
                                        "number",
                                        "times",
                                        "mass",
                                        "play",
                                        "quaternion_wxyz",
                                        "matrix",
                                        "lower_triangle",
                                        "directions",
                                        "largest_variance",
                                        "gravity_direction",
                                        "temperature",
                                        "link_temperatures",
                                        "payload",
                                        "tracker",
                                        "estimate_sigma",
                                        "columns",
                                        "factor",
                                        "orientation_factor",
                                        "factor_x",
                                        "factor_y",
                                        "factor_z",
                                        "out_of",
                                        "noise_ratio",
                                        "prior_ratio"};

// Names of its lengths and angles.
const std::set<std::string> kQuantities = {"rms",         "mean",        "p95",           "max",
                                           "std",         "sigma",       "misfit",        "target_misfit",
                                           "error",       "value",       "nominal",       "length",
                                           "angle",       "radius_95",   "rms_corrected", "difference_to_kdl",
                                           "position",    "common",      "residual",      "distance",
                                           "total",       "interval_95", "held_out_rms",  "orientation_length",
                                           "history",     "centre",      "cell",          "position_measured_frame",
                                           "independent", "orientation", "amount",        "lower",
                                           "upper",       "withheld",    "add",           "position_nominal",
                                           "valid_range", "joints",      "of_parameters", "length_sigma",
                                           "of_point",    "of_repeat",   "of_misfit",     "add_if_only_these",
                                           "change",      "size",        "rms_upper_95",  "of_assumptions",
                                           "moves",       "expanded",    "moved_points",  "misfit_without",
                                           "turn",        "radius",      "moved_flange",  "geometry_alone",
                                           "compensated", "of_one",      "urdf_alone",    "reach",
                                           "test_rms",    "uncertainty", "turn_sigma",    "unproved"};

// Names that lead to these.
const std::set<std::string> kGroups = {"position_error",
                                       "kept_axes",
                                       "without",
                                       "new_point",
                                       "left_out",
                                       "train",
                                       "test",
                                       "all",
                                       "leave_one_out",
                                       "nested_leave_one_out",
                                       "k_fold",
                                       "before",
                                       "after",
                                       "held_out",
                                       "exported_urdf",
                                       "means",
                                       "joint_offsets",
                                       "if_only_these",
                                       "test_at_fitted_poses",
                                       "test_at_new_poses",
                                       "iso_9283",
                                       "accuracy",
                                       "repeatability",
                                       "predicted_accuracy",
                                       "unseen",
                                       "assumed",
                                       "detectable",
                                       "distance_zero",
                                       "budget",
                                       "measured",
                                       "workspace",
                                       "asked",
                                       "cells",
                                       "region",
                                       "tested",
                                       "noise",
                                       "repeats",
                                       "observability",
                                       "lack_of_fit",
                                       "influence",
                                       "points",
                                       "input",
                                       "model",
                                       "parameters",
                                       "priors",
                                       "residuals",
                                       "rows",
                                       "largest",
                                       "statistics",
                                       "targets",
                                       "tried",
                                       "base",
                                       "held_out_points",
                                       "effects",
                                       "circumstances",
                                       "terms",
                                       "function",
                                       "findings",
                                       "covariance",
                                       "undetermined",
                                       "prior_result",
                                       "changes",
                                       "flange",
                                       "doubts",
                                       "reservation",
                                       "remarks",
                                       "figures"};

bool is_index(const std::string& key) { return parsed_number(key).has_value(); }

// Whether the number at the path has no unit.
bool is_number_alone(const std::string& text, const std::vector<std::string>& path) {
  const std::vector<std::string> all = names_in_paths();
  std::string last;
  std::string before;
  for (const std::string& key : path) {
    // Which have names of their own.
    const bool is_entry = is_index(key) || before == "parameters" || before == "link_temperatures";
    before = key;
    if (is_entry) {
      continue;
    }
    if (std::find(all.begin(), all.end(), key) == all.end()) {
      const std::string near = nearest(key, all);
      refuse(text, "names of a result, and " + shown(key) + " is none" + (near.empty() ? "" : ", such as " + near));
    }
    last = key;
  }
  if (kGroups.count(last) > 0) {
    refuse(text, "a number, such as " + last + ".rms");
  }
  return kNumbers.count(last) > 0;
}

// SI value of the unit.
double unit_of(const std::string& text, const std::string& unit) {
  const std::map<std::string, double> units = {{"", 1.0},    {"m", 1.0},     {"mm", 1e-3},    {"um", 1e-6},
                                               {"rad", 1.0}, {"mrad", 1e-3}, {"deg", kDegree}};
  const auto found = units.find(unit);
  if (found == units.end()) {
    refuse(text, "a number alone or with the unit m, mm, um, rad, mrad or deg");
  }
  return found->second;
}

std::vector<std::string> keys_of(const std::string& text, std::string path) {
  std::vector<std::string> keys;
  for (;;) {
    const std::size_t end = path.find('.');
    keys.push_back(path.substr(0, end));
    if (keys.back().empty()) {
      refuse(text, "PATH OP VALUE such as 'leave_one_out.rms<=0.25mm'");
    }
    if (end == std::string::npos) {
      return keys;
    }
    path.erase(0, end + 1);
  }
}

const Json* entry_of(const Json& json, const std::string& key) {
  if (json.is_object() && json.contains(key)) {
    return &json.at(key);
  }
  if (key == "left_out") {  // as the table calls it
    return entry_of(json, "leave_one_out");
  }
  if (json.is_array()) {  // "parameters.dq2.error"
    const auto named = std::find_if(json.begin(), json.end(), [&](const Json& entry) {
      return entry.is_object() && entry.contains("name") && entry["name"] == key;
    });
    if (named != json.end()) {
      return &*named;
    }
  }
  const std::optional<double> index = json.is_array() ? parsed_number(key) : std::nullopt;
  return index && *index >= 0.0 && *index < static_cast<double>(json.size()) ? &json[static_cast<std::size_t>(*index)]
                                                                             : nullptr;
}

// The value at the path; nullptr if there is none.
const Json* found_at(const Json& json, const std::vector<std::string>& path) {
  const Json* here = &json;
  for (const std::string& key : path) {
    const Json* next = entry_of(*here, key);
    for (const char* between : {"after", "position_error"}) {
      if (next == nullptr && entry_of(*here, between) != nullptr) {
        next = entry_of(*entry_of(*here, between), key);
      }
    }
    if (next == nullptr) {
      return nullptr;
    }
    here = next;
  }
  return here;
}

// Where deeper in the result this path begins: "predicted_accuracy." for budget.total. Empty if nowhere.
std::string beginning_of(const Json& json, const std::vector<std::string>& path) {
  if (!json.is_object()) {
    return {};
  }
  for (const auto& [key, value] : json.items()) {
    if (const Json* found = found_at(value, path); found != nullptr && found->is_number()) {
      return key + ".";
    }
    if (const std::string deeper = beginning_of(value, path); !deeper.empty()) {
      return key + "." + deeper;
    }
  }
  return {};
}

// The object that holds the number at the path.
const Json* holder_of(const Json& json, std::vector<std::string> path) {
  path.pop_back();
  return path.empty() ? &json : found_at(json, path);
}

double number_at(const Json& json, const std::vector<std::string>& path, double otherwise) {
  const Json* found = found_at(json, path);
  return found != nullptr && found->is_number() ? found->get<double>() : otherwise;
}

// Of points of one configuration each other's errors tell little: a configuration counts once.
double independent_errors(const Json& json, const Json& statistics) {
  const Json* targets = found_at(json, {"targets"});
  const double points = number_at(statistics, {"count"}, 1.0);
  const double of_each = targets != nullptr && targets->is_array() ? static_cast<double>(targets->size()) : 1.0;
  return std::max(1.0, std::min(points / std::max(1.0, of_each), number_at(json, {"input", "configurations"}, points)));
}

double standard_uncertainty(const Requirement& requirement, const Json& json, double value) {
  const std::string& name = requirement.path.back();
  const std::string& group = requirement.path.front();
  const Json* holder = holder_of(json, requirement.path);
  if (requirement.comparison == "==") {
    refuse(requirement.text, "a limit, as --guard is given");
  }
  // Without more words found_at leads from train to train.after.
  const Json* statistics = holder != nullptr && holder->contains("after") ? &holder->at("after") : holder;
  if (name == "rms" && statistics != nullptr && statistics->contains("count")) {
    const double assumed = number_at(json, {"predicted_accuracy", "budget", "of_assumptions"}, 0.0);
    return std::hypot(value / std::sqrt(2.0 * independent_errors(json, *statistics)), assumed);
  }
  if (group == "new_point") {
    return value / std::sqrt(2.0 * std::max(1.0, number_at(json, {"new_point", "configurations"}, 1.0)));
  }
  if (holder != nullptr && holder->contains("coverage_factor")) {  // the budget
    const double freedom = number_at(*holder, {"degrees_of_freedom"}, std::numeric_limits<double>::infinity());
    return value / std::sqrt(2.0 * std::max(1.0, freedom));
  }
  if (holder != nullptr && (name == "error" || name == "value" || name == "add")) {
    const Json* std = found_at(*holder, {"std"});
    if (std != nullptr && std->is_number()) {
      return std->get<double>();
    }
  }
  refuse(requirement.text,
         "an RMS, new_point, the budget, or the error of a parameter, as --guard needs the uncertainty of the number");
}

bool holds(double left, const std::string& comparison, double right) {
  return comparison == "<"    ? left < right
         : comparison == "<=" ? left <= right
         : comparison == ">"  ? left > right
         : comparison == ">=" ? left >= right
                              : left == right;
}

}  // namespace

std::vector<std::string> names_in_paths() {
  std::vector<std::string> names(kGroups.begin(), kGroups.end());
  names.insert(names.end(), kNumbers.begin(), kNumbers.end());
  names.insert(names.end(), kQuantities.begin(), kQuantities.end());
  return names;
}

Requirement parse_requirement(const std::string& text) {
  if (!is_utf8(text)) {
    refuse(text, "UTF-8");
  }
  const std::size_t begin = text.find_first_of("<>=");
  if (begin == std::string::npos) {
    refuse(text, "PATH OP VALUE such as 'leave_one_out.rms<=0.25mm'");
  }
  const std::size_t end = std::min(text.find_first_not_of("<>=", begin), text.size());
  Requirement result{.text = text, .comparison = text.substr(begin, end - begin)};
  const std::array<std::string, 5> comparisons = {"<", "<=", ">", ">=", "=="};
  if (std::find(comparisons.begin(), comparisons.end(), result.comparison) == comparisons.end()) {
    refuse(text, "one of < <= > >= ==");
  }
  result.path = keys_of(text, std::string(trimmed(text.substr(0, begin))));
  const std::string right(trimmed(text.substr(end)));
  const std::size_t unit = right.find_last_of("0123456789.") + 1;  // 0 if there is no number
  const std::optional<double> number = parsed_number(right.substr(0, unit));
  if (!number) {
    refuse(text, "a number behind " + result.comparison);
  }
  result.unit = trimmed(right.substr(unit));
  result.value = *number * unit_of(text, result.unit);
  const bool alone = is_number_alone(text, result.path);
  if (alone && !result.unit.empty()) {
    refuse(text, "no unit, as this is a number");
  }
  if (!alone && result.unit.empty() && *number != 0.0) {
    refuse(text, "a unit behind the number: m, mm, um, rad, mrad or deg");
  }
  return result;
}

std::vector<Judged> outcomes_of(const std::vector<Requirement>& requirements, const Json& json, double guard) {
  std::vector<Judged> result;
  for (const Requirement& requirement : requirements) {
    const Json* value = found_at(json, requirement.path);
    if (const std::string beginning = value == nullptr ? beginning_of(json, requirement.path) : "";
        !beginning.empty()) {
      refuse(requirement.text, "the whole path, which begins with " + beginning);
    }
    Judged& outcome = result.emplace_back(Judged{.text = requirement.text, .value = "not determined"});
    if (value == nullptr && requirement.path.front() == "test") {
      outcome.value += ", as no rows are marked as test";
    }
    if (value != nullptr && value->is_number()) {
      const double found = value->get<double>();
      const double in_unit = found / unit_of(requirement.text, requirement.unit);
      outcome.value = fmt::format("{:.6g}", in_unit) + (requirement.unit.empty() ? "" : " " + requirement.unit);
      if (guard > 0.0 && !is_number_alone(requirement.text, requirement.path)) {
        outcome.uncertainty = standard_uncertainty(requirement, json, found);
        outcome.value +=
            fmt::format(", with {:g} times its standard uncertainty {:.3g} {}", guard,
                        outcome.uncertainty / unit_of(requirement.text, requirement.unit), requirement.unit);
      }
      const double band = guard * outcome.uncertainty;
      outcome.is_met = holds(requirement.comparison.front() == '<' ? found + band : found - band,
                             requirement.comparison, requirement.value);
    }
  }
  return result;
}

std::string Judged::message() const { return is_met ? "" : "'" + text + "' is not fulfilled: the value is " + value; }

std::string outcome_lines(const std::vector<Judged>& outcomes) {
  std::string lines = outcomes.empty() ? "" : "\n";
  for (const Judged& outcome : outcomes) {
    lines += "required " + outcome.text + ": " + outcome.value + (outcome.is_met ? ", met\n" : ", NOT met\n");
  }
  return lines;
}

std::vector<std::string> unfulfilled(const std::vector<Judged>& outcomes) {
  std::vector<std::string> result;
  for (const Judged& requirement : outcomes) {
    if (!requirement.is_met) {
      result.push_back(requirement.message());
    }
  }
  return result;
}

Json judged_json(const std::vector<Judged>& outcomes) {
  Json result = Json::array();
  for (const Judged& requirement : outcomes) {
    result.push_back({{"text", requirement.text},
                      {"value", requirement.value},
                      {"fulfilled", requirement.is_met},
                      {"message", requirement.is_met ? Json(nullptr) : Json(requirement.message())}});
    if (requirement.uncertainty > 0.0) {
      result.back()["uncertainty"] = requirement.uncertainty;
    }
  }
  return result;
}

void add_guard(CLI::App& app, double& guard) {
  app.add_option("--guard", guard,
                 "Keep the limits of --require by so many standard uncertainties of the number (ISO 14253-1)")
      ->type_name("K")
      ->check(number_between(0.0, 10.0, "a number from 0 to 10"))
      ->capture_default_str();
}

void add_require(CLI::App& app, std::vector<std::string>& texts) {
  add_list(app, "--require", texts,
           "What a number of the JSON must be, else the exit status is 1: PATH OP VALUE, with < <= > >= or == and mm, "
           "um, m, mrad, rad or deg")
      ->type_name("TEXT,...");
}

std::vector<Requirement> parse_requirements(const std::vector<std::string>& texts) {
  std::vector<Requirement> result;
  std::transform(texts.begin(), texts.end(), std::back_inserter(result), parse_requirement);
  return result;
}

}  // namespace kdl_calibration::cli
