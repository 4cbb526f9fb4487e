#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// A way to read the joint values, and how well the model then fits.
struct ConventionTrial {
  std::optional<Cause> cause;  ///< none for the present one
  std::string description;     ///< "the convention fanuc_r2000ic_165f_pendant.json", "joint_3 with the opposite sign"
  bool present = false;        ///< the way the measurements were read
  /// [m] 3D, of the train rows with the nominal geometry, base and targets registered; where that leaves more than
  /// twice what the present reading does, it may be a bound that lies between (least_misfit).
  double registered = 0.0;
  double rms = 0.0;  ///< [m] the same after the fit, which a goal may end early; as registered where one is in vain
  Eigen::MatrixXd joint_values;  ///< the measurements' joint values read that way
};

struct ConventionOptions {
  const JointConvention* used = nullptr;  ///< that made the joint values the URDF's; none: taken as they are
  std::vector<JointConvention> others;
  RegistrationOptions registration;
  JointOptions joint;
  int threads = 0;  ///< 0: one per core
};

/// Tries other readings of the joint values, which were converted with `used`: with the convention (M, o) another one
/// (M', o') gives q' = M' M^-1 (q - o) + o'. Tried are `others`, no convention where one was used; the opposite sign of
/// each single joint, of the URDF's and, where `used` couples joints, of the controller's; degrees and radians
/// exchanged for one joint or for all of them (millimetres and metres of a slide); two joints exchanged and all of them
/// in reversed order; and, of joints with parallel axes, the sum or the difference of a joint and the one in front of
/// it. Conventions for other joints than the measurements' are left out, and so are readings that are equal to another
/// one. Each is registered from the nominal geometry, and fitted with `free` where that leaves less than twice what the
/// present reading does; a fit with errors beyond any robot's (50 mm, 0.35 rad) counts with its registration alone.
/// Best first, the present reading among them. Nothing is changed.
/// Throws InputError as identify_jointly does, and where `used` does not match the joints.
std::vector<ConventionTrial> try_conventions(const ErrorModel& model, const Measurements& measurements,
                                             const Unknowns& free, const ConventionOptions& options = {});

/// The best of the trials where its RMS is below `factor` times that of the present reading.
std::optional<ConventionTrial> better_convention(const std::vector<ConventionTrial>& trials, double factor = 0.2);

}  // namespace kdl_calibration
