#include "kdl_calibration/accuracy.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace kdl_calibration {
namespace {

constexpr std::array<std::pair<Cause, const char*>, 34> kNames = {{
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
}};

}  // namespace

const char* to_string(Cause cause) {
  const auto found =
      std::find_if(kNames.begin(), kNames.end(), [&](const auto& named) { return named.first == cause; });
  return found != kNames.end() ? found->second : "unknown";
}

std::optional<Cause> cause_named(std::string_view name) {
  const auto found =
      std::find_if(kNames.begin(), kNames.end(), [&](const auto& named) { return named.second == name; });
  return found != kNames.end() ? std::optional(found->first) : std::nullopt;
}

}  // namespace kdl_calibration
