#include "kdl_calibration/doubt.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <utility>

namespace kdl_calibration {
namespace {

constexpr std::array<std::pair<Cause, const char*>, 61> kCauses = {{
    {Cause::joint_convention, "joint_convention"},
    {Cause::joint_sign, "joint_sign"},
    {Cause::joint_unit, "joint_unit"},
    {Cause::joint_at_rest, "joint_at_rest"},
    {Cause::joint_gain, "joint_gain"},
    {Cause::joint_columns, "joint_columns"},
    {Cause::known_base, "known_base"},
    {Cause::known_target, "known_target"},
    {Cause::length_unit, "length_unit"},
    {Cause::scale, "scale"},
    {Cause::distance_zero, "distance_zero"},
    {Cause::mirrored, "mirrored"},
    {Cause::tool_frame, "tool_frame"},
    {Cause::displayed_positions, "displayed_positions"},
    {Cause::exchanged_targets, "exchanged_targets"},
    {Cause::moved_base, "moved_base"},
    {Cause::drift, "drift"},
    {Cause::moved_target, "moved_target"},
    {Cause::joint_zero_changed, "joint_zero_changed"},
    {Cause::payload_changed, "payload_changed"},
    {Cause::own_alternative, "own_alternative"},
    {Cause::orientations, "orientations"},
    {Cause::joint_function, "joint_function"},
    {Cause::same_configuration, "same_configuration"},
    {Cause::copied_rows, "copied_rows"},
    {Cause::gross_rows, "gross_rows"},
    {Cause::not_converged, "not_converged"},
    {Cause::not_determined, "not_determined"},
    {Cause::worse_than_nominal, "worse_than_nominal"},
    {Cause::nominal_kept, "nominal_kept"},
    {Cause::test_rows_differ, "test_rows_differ"},
    {Cause::large_misfit, "large_misfit"},
    {Cause::unknown_length, "unknown_length"},
    {Cause::large_error, "large_error"},
    {Cause::another_robot, "another_robot"},
    {Cause::file_interpreted, "file_interpreted"},
    {Cause::lonely_name, "lonely_name"},
    {Cause::single_coordinates, "single_coordinates"},
    {Cause::wrong_rows, "wrong_rows"},
    {Cause::outside_joint_limits, "outside_joint_limits"},
    {Cause::ambiguous_registration, "ambiguous_registration"},
    {Cause::points_not_compared, "points_not_compared"},
    {Cause::neighbours_left_out, "neighbours_left_out"},
    {Cause::nothing_left_out, "nothing_left_out"},
    {Cause::points_not_counted, "points_not_counted"},
    {Cause::folds_not_converged, "folds_not_converged"},
    {Cause::not_told_apart, "not_told_apart"},
    {Cause::smallest_errors, "smallest_errors"},
    {Cause::held_as_registered, "held_as_registered"},
    {Cause::held_by_gauge, "held_by_gauge"},
    {Cause::beyond_stated_noise, "beyond_stated_noise"},
    {Cause::few_data, "few_data"},
    {Cause::priors_too_narrow, "priors_too_narrow"},
    {Cause::distances_corrected, "distances_corrected"},
    {Cause::unlike_stations, "unlike_stations"},
    {Cause::lack_of_fit, "lack_of_fit"},
    {Cause::nominal_is_exact, "nominal_is_exact"},
    {Cause::robot_changed, "robot_changed"},
    {Cause::harmful_effects, "harmful_effects"},
    {Cause::urdf_without_effects, "urdf_without_effects"},
    {Cause::uncertain_elsewhere, "uncertain_elsewhere"},
}};

constexpr std::array<std::pair<SubjectKind, const char*>, 8> kSubjectKinds = {
    {{SubjectKind::configuration, "configuration"},
     {SubjectKind::target, "target"},
     {SubjectKind::station, "station"},
     {SubjectKind::joint, "joint"},
     {SubjectKind::parameter, "parameter"},
     {SubjectKind::effect, "effect"},
     {SubjectKind::coordinate, "coordinate"},
     {SubjectKind::alternative, "alternative"}}};

template <class Names, class Value>
const char* name_in(const Names& names, Value value) {
  const auto found = std::find_if(names.begin(), names.end(), [&](const auto& named) { return named.first == value; });
  return found != names.end() ? found->second : "unknown";
}

template <class Value, std::size_t N>
std::optional<Value> value_in(const std::array<std::pair<Value, const char*>, N>& names, std::string_view name) {
  const auto found = std::find_if(names.begin(), names.end(), [&](const auto& named) { return named.second == name; });
  return found != names.end() ? std::optional(found->first) : std::nullopt;
}

}  // namespace

const char* to_string(Cause cause) { return name_in(kCauses, cause); }
std::optional<Cause> cause_named(std::string_view name) { return value_in(kCauses, name); }

const char* to_string(SubjectKind kind) { return name_in(kSubjectKinds, kind); }
std::optional<SubjectKind> subject_kind_named(std::string_view name) { return value_in(kSubjectKinds, name); }

std::vector<Subject> subjects_named(SubjectKind kind, const std::vector<std::string>& names) {
  std::vector<Subject> result;
  std::transform(names.begin(), names.end(), std::back_inserter(result),
                 [&](const std::string& name) { return Subject{.kind = kind, .name = name}; });
  return result;
}

std::vector<std::string> Doubt::names(SubjectKind kind) const {
  std::vector<std::string> result;
  for (const Subject& subject : subjects) {
    if (subject.kind == kind) {
      result.push_back(subject.name);
    }
  }
  return result;
}

std::optional<double> Doubt::figure(std::string_view name) const {
  const auto found =
      std::find_if(figures.begin(), figures.end(), [&](const NamedFigure& one) { return one.name == name; });
  return found != figures.end() ? std::optional(found->value) : std::nullopt;
}

std::vector<std::string> messages_of(const std::vector<Doubt>& doubts) {
  std::vector<std::string> result;
  std::transform(doubts.begin(), doubts.end(), std::back_inserter(result),
                 [](const Doubt& doubt) { return doubt.message; });
  return result;
}

}  // namespace kdl_calibration
