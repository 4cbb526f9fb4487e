#pragma once

#include <CLI/App.hpp>
#include <string>
#include <vector>

#include "cli/frames.hpp"

namespace kdl_calibration::cli {

/// A condition on a number of the result: "leave_one_out.rms<=0.25mm".
struct Requirement {
  std::string text;               ///< as given
  std::vector<std::string> path;  ///< keys, or indices into arrays, from 0
  std::string comparison;         ///< "<", "<=", ">", ">=", "=="
  double value = 0.0;             ///< SI
  std::string unit;               ///< of `value` as given; empty for a number without one
};

/// The names that a path may consist of, beside indices.
std::vector<std::string> names_in_paths();

/// Throws InputError if the text is not a requirement: another form, a name that no number of a result has, a length or
/// angle without unit, a number with one.
Requirement parse_requirement(const std::string& text);

/// Outcome of a requirement. `position_error.` before a path and `.after` in it may be omitted; null or absent values
/// fulfil nothing.
struct Judged {
  std::string text;   ///< the requirement
  std::string value;  ///< that was found, in the requirement's unit; with a guard band and its width
  bool is_met = false;
  double uncertainty = 0.0;  ///< [SI] standard uncertainty of the value; 0 without a guard band

  /// A sentence if it is not met, else empty.
  std::string message() const;
};
/// With a guard band (ISO 14253-1) a length or an angle must keep its limit by `guard` times its standard uncertainty
/// u. Of an RMS error of n configurations u^2 = rms^2 / (2 n) + of_assumptions^2, of the budget and the expanded errors
/// of a new point u = value / sqrt(2 n), of a parameter its std. Throws InputError for a length or angle whose
/// uncertainty is not known, and for ==. Numbers without unit have no guard band.
std::vector<Judged> outcomes_of(const std::vector<Requirement>& requirements, const Json& json, double guard = 0.0);

/// One line for each, for the terminal; empty without any.
std::string outcome_lines(const std::vector<Judged>& outcomes);

/// Messages of the requirements that are not met.
std::vector<std::string> unfulfilled(const std::vector<Judged>& outcomes);

/// [{text, fulfilled, message}], the value of "requirements" in a result.
Json judged_json(const std::vector<Judged>& outcomes);

/// --guard
void add_guard(CLI::App& app, double& guard);
/// --require
void add_require(CLI::App& app, std::vector<std::string>& texts);
std::vector<Requirement> parse_requirements(const std::vector<std::string>& texts);

}  // namespace kdl_calibration::cli
