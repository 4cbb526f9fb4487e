#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "validation/validation.hpp"

namespace kdl_calibration {

/// A fold of training rows predicted by a fit to all others. Points are ordered by configuration and target.
struct RefittedFold {
  std::vector<Eigen::Vector3d> residuals;    ///< [m] of the means of the repeats, along W
  std::vector<std::int32_t> configurations;  ///< configuration of each residual
  std::vector<std::int32_t> targets;
  bool converged = true;
};
RefittedFold refit_without(const FitProblem& problem, const std::vector<Eigen::Index>& fold);

}  // namespace kdl_calibration
