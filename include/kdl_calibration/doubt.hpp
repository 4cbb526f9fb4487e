#pragma once

// What is doubted, or remarked, of a calibration: the cause, the things that it concerns and the numbers found. A
// program can act on these; the message says the same to people.
//
//     for (const Doubt& doubt : found.doubts()) {
//       std::cerr << to_string(doubt.cause) << ": " << doubt.message << "\n";
//       for (const Subject& subject : doubt.subjects) std::cerr << "  " << subject.name << "\n";
//     }

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Causes of doubts and remarks. The first group are other readings of the data, the second remarks about readings. The
/// third concern the result itself. The fourth are remarks about the measurements, the fit and its predictions.
enum class Cause {
  joint_convention,
  joint_sign,
  joint_unit,
  joint_at_rest,
  joint_gain,
  joint_columns,
  known_base,
  known_target,
  length_unit,
  scale,
  distance_zero,
  mirrored,
  tool_frame,
  displayed_positions,
  exchanged_targets,
  moved_base,
  drift,
  moved_target,
  joint_zero_changed,
  payload_changed,
  own_alternative,
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
  large_error,
  another_robot,

  file_interpreted,
  lonely_name,
  single_coordinates,
  wrong_rows,
  outside_joint_limits,
  ambiguous_registration,
  points_not_compared,
  neighbours_left_out,
  nothing_left_out,
  points_not_counted,
  folds_not_converged,
  not_told_apart,
  smallest_errors,
  held_as_registered,
  held_by_gauge,
  beyond_stated_noise,
  few_data,
  priors_too_narrow,
  distances_corrected,
  unlike_stations,
  lack_of_fit,
  nominal_is_exact,
  robot_changed,
  harmful_effects,
  urdf_without_effects,
  uncertain_elsewhere
};

/// The name of the enumerator, as in the result file.
const char* to_string(Cause cause);
/// Empty where no cause has this name.
std::optional<Cause> cause_named(std::string_view name);

enum class SubjectKind {
  configuration,
  target,
  station,
  joint,
  parameter,
  effect,
  coordinate,  ///< "x", "y" or "z" of the measured points
  alternative  ///< OwnAlternative::name
};

/// The name of the enumerator, as in the result file.
const char* to_string(SubjectKind kind);
/// Empty where no kind has this name.
std::optional<SubjectKind> subject_kind_named(std::string_view name);

/// Something that a doubt concerns, by its name in the measurements, the URDF or the result.
struct Subject {
  SubjectKind kind = SubjectKind::configuration;
  std::string name;

  bool operator==(const Subject&) const = default;
};

/// Subjects of one kind, in the order of their names.
std::vector<Subject> subjects_named(SubjectKind kind, const std::vector<std::string>& names);

/// A number that was found, in SI units; infinite if it is not determined. src/cli/README.md explains the names.
struct NamedFigure {
  std::string name;
  double value = 0.0;

  bool operator==(const NamedFigure&) const = default;
};

/// A reason not to trust the result.
struct Doubt {
  Cause cause = Cause::not_converged;
  std::vector<Subject> subjects = {};
  std::vector<NamedFigure> figures = {};  ///< each name once
  std::string message;                    ///< what was found and what to do, in words

  /// The names of the subjects of one kind.
  std::vector<std::string> names(SubjectKind kind) const;
  /// Empty where no figure has this name.
  std::optional<double> figure(std::string_view name) const;
};

/// Something worth knowing that is no reason to distrust the result.
using Remark = Doubt;

/// The messages alone, in the same order.
std::vector<std::string> messages_of(const std::vector<Doubt>& doubts);

}  // namespace kdl_calibration
