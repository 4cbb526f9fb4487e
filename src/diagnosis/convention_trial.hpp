#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "estimation/identification.hpp"
#include "estimation/registration.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// An interpretation of the joint values, and the misfit that it leaves.
struct ConventionTrial {
  std::optional<Cause> cause;  ///< none for the present interpretation
  std::string description;     ///< "the convention fanuc_r2000ic_165f_pendant.json", "joint_3 with the opposite sign"
  std::vector<Subject> joints = {};  ///< that are read differently: the URDF's, or the controller's if it names those
  bool present = false;              ///< whether it is the present interpretation
  /// [m] 3D RMS of the train rows with nominal geometry, base and targets registered. If above twice that of the
  /// present reading, it may be a lower bound (least_misfit).
  double registered = 0.0;
  double rms = 0.0;              ///< [m] after the fit, which a goal may end early; as `registered` if not fitted
  Eigen::MatrixXd joint_values;  ///< joint values under this interpretation
};

struct ConventionOptions {
  const JointConvention* used = nullptr;  ///< the convention used to convert the joint values; none: unconverted
  std::vector<JointConvention> others;
  RegistrationOptions registration;
  JointOptions joint;
  int threads = 0;  ///< 0: one per core
  ProgressFunction progress = {};
};

/// Tries other readings of the joint values, which were converted with `used`: after the convention (M, o), another one
/// (M', o') gives q' = M' M^-1 (q - o) + o'. Tried are: `others`; no convention if one was used; the opposite sign of
/// each URDF joint and, if `used` couples joints, of each controller joint; degrees and radians exchanged for one joint
/// or all (millimetres and metres for prismatic joints); two joints exchanged; all joints reversed; and for parallel
/// axes the sum or difference of a joint and its predecessor. Conventions for other joints and duplicates are skipped.
/// Each reading is registered with the nominal geometry, and fitted with `free` if its misfit is below twice that of
/// the present reading. A fit with implausible errors (50 mm, 0.35 rad) counts with its registration only. Sorted best
/// first, the present reading included.
/// Throws InputError as identify_jointly does, and where `used` does not match the joints.
std::vector<ConventionTrial> try_conventions(const ErrorModel& model, const Measurements& measurements,
                                             const Unknowns& free, const ConventionOptions& options = {});

}  // namespace kdl_calibration
