#include "calibration/prior_check.hpp"

#include <algorithm>
#include <cmath>

#include "base/distributions.hpp"
#include "calibration/noise_report.hpp"

namespace kdl_calibration {

double excess_over_priors(const CalibrationResult& found) {
  const Eigen::VectorXd information = found.fit.free.prior_information(found.selection.priors);
  double squares = 0.0;
  double expected = 0.0;
  for (Eigen::Index c = 0; c < information.size(); ++c) {
    if (information[c] > 0.0 && std::isfinite(found.uncertainty.covariance(c, c))) {
      const double value =
          Unknowns::value(found.fit.identification.estimate, found.fit.free.columns()[static_cast<std::size_t>(c)]);
      squares += information[c] * value * value;
      expected += std::max(1.0 - information[c] * found.uncertainty.covariance(c, c), 0.0);
    }
  }
  const double ratio = expected > 0.0 ? squares / expected : 1.0;
  const bool contradicted = ratio > 1.0 && reduced_chi_squared_tail(ratio, expected) < kMisfitCertain;
  return contradicted ? std::sqrt(ratio) : 1.0;
}

}  // namespace kdl_calibration
