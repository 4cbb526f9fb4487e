#pragma once

// Whether a result is to be trusted, and why not.
//
//     for (const Doubt& doubt : found.doubts()) std::cerr << doubt.message << "\n";

#include <optional>
#include <string>
#include <string_view>

namespace kdl_calibration {

/// How far a result may be used.
enum class Verdict {
  trusted,
  trusted_where_measured,  ///< predictions hold in the measured region; some parameters are not determined
  not_trusted
};

/// Causes of doubt. The first group are other readings of the data, the second remarks about readings, the third
/// concern the result itself.
enum class Cause {
  joint_convention,
  joint_sign,
  joint_unit,
  joint_at_rest,
  joint_gain,
  joint_columns,
  known_base,
  length_unit,
  scale,
  mirrored,
  tool_frame,
  exchanged_targets,
  moved_base,
  drift,
  orientations,

  joint_function,
  same_configuration,
  copied_rows,

  gross_rows,
  not_converged,
  not_determined,
  worse_than_nominal,
  nominal_kept,
  test_rows_differ,
  large_misfit,
  unknown_length,
  large_error
};

/// The name of the enumerator, as in the result file.
const char* to_string(Cause cause);
/// Empty where no cause has this name.
std::optional<Cause> cause_named(std::string_view name);

/// A reason not to trust the result.
struct Doubt {
  Cause cause = Cause::not_converged;
  std::string message;  ///< what was found and what to do, in words
};

}  // namespace kdl_calibration
