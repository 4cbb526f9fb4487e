#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"

namespace kdl_calibration {

/// Something that would explain the measurements much better than what they were taken for.
struct AlternativeReading {
  Cause cause = Cause::joint_convention;
  std::string message;  ///< one line for people, with the figures
  bool doubt = true;    ///< whether the answer is not to be trusted; else a remark
};

struct ReadingOptions {
  RegistrationOptions registration;
  const JointConvention* used = nullptr;  ///< that made the joint values the URDF's
  std::vector<JointConvention> others;
  double least_misfit = 0.0;  ///< [m] below it only scales and copied rows are looked for
  std::string remark;         ///< added behind the misfit in messages
  int threads = 1;
};

/// What is wrong with data that read well, tried at any size of the misfit: other readings of the joint values (see
/// try_conventions), of the points (a unit, a mirror, coordinates of the tool, targets exchanged from some
/// configuration on), and a base that moved or drifted against the measuring device. `fit` is the answer, in which
/// `free` was estimated. A reading is named where it leaves less than a third of what the answer leaves and of what the
/// same fit to the present reading does, by more than chance (F distribution of as many degrees of freedom as the
/// distinct points leave). Scales are told by the nominal geometry and by length errors that agree as a share of their
/// links, gains of joints beyond 1 % are wrong units even where the fit has gains. Of poses the points are tried first,
/// then the orientations beside those of the arm (their inverses, components in another order, single ones), then as
/// points beside the measured ones. Only train rows are looked at, of up to 300 configurations spread over
/// the file (75 of poses as points). Nothing is changed.
std::vector<AlternativeReading> alternative_readings(const ErrorModel& model, const Measurements& measurements,
                                                     const Estimate& fit, const Unknowns& free,
                                                     const ReadingOptions& options = {});

/// The same checks for a robot that was not calibrated. The geometry is fitted for the comparison, so that ordinary
/// geometric errors are not taken for another reading. With too few points only base and targets are fitted, and other
/// readings are tried only if the misfit exceeds 1 % of the arm's length. `registered`: the robot with its registered
/// base and targets.
std::vector<AlternativeReading> alternative_readings_of_nominal(const ErrorModel& model,
                                                                const Measurements& measurements,
                                                                const Estimate& registered,
                                                                ReadingOptions options = {});

}  // namespace kdl_calibration
