#pragma once

#include <vector>

#include "validation/validation.hpp"

namespace kdl_calibration {

/// The result of cross_validate for least squares without a loss and a few large folds, in a few passes over the data.
/// The normal equations without a fold are the sums of those of the others. `problem.start`: the optimum of all data.
/// Gauss-Newton steps are made until the predicted points move by less than a thousandth of `noise` [m].
HoldOut cross_validate_by_sums(const FitProblem& problem, const std::vector<std::vector<Eigen::Index>>& folds,
                               double noise, int threads = 0);

}  // namespace kdl_calibration
