#include "diagnosis/trial_fit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "estimation/prediction.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::VectorXd;

bool plausible(const ErrorModel& model, const VectorXd& errors) {
  constexpr double kLargestAngle = 0.35;   // [rad]
  constexpr double kLargestShare = 0.005;  // of the length of an arm of more than ten metres
  const double largest_length = std::max(0.05, kLargestShare * arm_length(model));
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const double limit = is_length(model, model.parameters[p]) ? largest_length : kLargestAngle;
    if (!(std::abs(errors[static_cast<Index>(p)]) < limit)) {
      return false;
    }
  }
  return true;
}

double rms_of(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements);
  double sum = 0.0;
  double count = 0.0;
  for (const Observation& observation : measurements.observations) {
    sum += (observation.position() - predicted_point(estimate, X_BF, observation)).squaredNorm();
    count += 1.0;
  }
  const double rms = std::sqrt(sum / count);
  return std::isfinite(rms) ? rms : std::numeric_limits<double>::infinity();
}

double fitted_rms(const TrialFit& fit, const Measurements& measurements, const Estimate& start) {
  const double registered = rms_of(fit.model, measurements, start);
  const Unknowns rigid = fit.free.without(UnknownGroup::effects);
  const Identification found = identify_jointly(fit.model, measurements, start, rigid, fit.joint);
  return plausible(fit.model, found.estimate.errors)
             ? std::min(registered, rms_of(fit.model, measurements, found.estimate))
             : registered;
}

}  // namespace kdl_calibration
