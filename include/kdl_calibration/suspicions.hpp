#pragma once

#include <string>
#include <vector>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"

namespace kdl_calibration {

/// Something that would explain the measurements much better than what they were taken for.
struct Suspicion {
  /// joint_convention, joint_sign, joint_unit, joint_gain, joint_columns, length_unit, scale, mirrored, tool_frame,
  /// exchanged_targets, moved_base or drift; as remarks joint_function, same_configuration or copied_rows.
  std::string cause;
  std::string message;  ///< one line for people, with the figures
  bool doubt = true;    ///< whether the answer is not to be trusted; else a remark
};

struct SuspicionOptions {
  RegistrationOptions registration;
  const JointConvention* used = nullptr;  ///< that made the joint values the URDF's
  std::vector<JointConvention> others;
  int threads = 1;
};

/// What is wrong with data that read well, tried at any size of the misfit: other readings of the joint values (see
/// try_conventions), of the points (a unit, a mirror, coordinates of the tool, targets exchanged from some
/// configuration on), and a base that moved or drifted against the measuring device. `fit` is the answer, in which
/// `free` was estimated. A reading is named where it leaves less than a third of what the answer leaves and of what the
/// same fit to the present reading does, by more than chance (F distribution of as many degrees of freedom as the
/// distinct points leave). Scales are told by the nominal geometry and by length errors that agree as a share of their
/// links, gains of joints beyond 1 % are wrong units even where the fit has gains. Of poses the points are tried first,
/// then the orientations as points beside them. Only train rows are looked at, of up to 300 configurations spread over
/// the file (75 of poses as points). Nothing is changed.
std::vector<Suspicion> suspicions(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                                  const Unknowns& free, const SuspicionOptions& options = {});

}  // namespace kdl_calibration
