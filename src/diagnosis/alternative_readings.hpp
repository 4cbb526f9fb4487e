#pragma once

#include <span>
#include <string>
#include <vector>

#include "estimation/identification.hpp"
#include "estimation/registration.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Another interpretation of the input that would explain the measurements much better than the present one.
struct AlternativeReading {
  Cause cause = Cause::joint_convention;
  std::vector<Subject> subjects = {};
  std::vector<NamedFigure> figures = {};
  std::string message;  ///< one line for the user, with the figures
  bool doubt = true;    ///< whether the result must not be trusted; false: a remark only

  /// The doubt, or the remark.
  Doubt as_doubt() const { return {cause, subjects, figures, message}; }
};

/// The smallest mistake of a kind that the measurements would have shown with 80 % power, and what it does to
/// predictions if it is smaller and stays hidden.
struct DetectableMistake {
  Cause cause = Cause::scale;
  std::string subject;
  double estimate = 0.0;  ///< in SI units, if it is a single number
  const char* unit = "";  ///< to show it in: "mm", "mrad" or "%"; empty if it is not one number
  double size = 0.0;      ///< [m] RMS over the measured points
  double moves = 0.0;     ///< [m] RMS error of predictions in the measured ranges
};

struct ReadingOptions {
  RegistrationOptions registration;
  const JointConvention* used = nullptr;  ///< the convention that converted the joint values to the URDF's
  std::vector<JointConvention> others;
  double least_misfit = 0.0;          ///< [m] below this misfit only scales and copied rows are searched
  std::string remark;                 ///< text after the misfit in messages
  std::vector<std::string> fix = {};  ///< see FitToDoubt
  double uncertainty = 0.0;           ///< [m] see FitToDoubt
  NoiseModel stated = {};             ///< noise of the measurements
  double scale_sigma = 0.0;           ///< see FitToDoubt
  std::span<const OwnAlternative> alternatives = {};
  int threads = 1;
  ProgressFunction progress = {};
};

struct ReadingSearch {
  std::vector<AlternativeReading> readings;
  std::vector<DetectableMistake> detectable;  ///< see MistakeSearch; empty if another reading explains the measurements
};

/// Searches well-formed data for input mistakes, however small the misfit is. Tried are other readings of the joint
/// values (see try_conventions), of the points (unit, mirror image, tool coordinates, targets exchanged from some
/// configuration on), and the mistakes of likely_mistake(). `fit` is the result, in which `free` was estimated. A
/// reading is reported if its misfit is below a third of the result's misfit and of that of the same fit to the present
/// reading. The difference must also be significant (F test). For poses, points are tried first, then orientations
/// (inverses, reordered components, single ones), then points derived from the orientations. Uses train rows of up to
/// 300 configurations spread over the file (75 for that last trial).
ReadingSearch search_readings(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                              const Unknowns& free, const ReadingOptions& options = {});
/// Its readings alone.
std::vector<AlternativeReading> alternative_readings(const ErrorModel& model, const Measurements& measurements,
                                                     const Estimate& fit, const Unknowns& free,
                                                     const ReadingOptions& options = {});

/// Whether all lengths are a thousand times too long or too short for the nominal arm, for any number of stations and
/// any kind of row.
std::vector<AlternativeReading> readings_of_unit(const ErrorModel& model, const Measurements& measurements);

/// The checks of alternative_readings() for a robot that was not calibrated. The geometry is fitted for the comparison,
/// so that ordinary geometric errors are not reported as another reading. With too few points only base and targets are
/// fitted, and readings are tried only if the misfit exceeds 1 % of the arm's length. `registered`: the robot with its
/// registered base and targets.
std::vector<AlternativeReading> alternative_readings_of_nominal(const ErrorModel& model,
                                                                const Measurements& measurements,
                                                                const Estimate& registered,
                                                                ReadingOptions options = {});

}  // namespace kdl_calibration
