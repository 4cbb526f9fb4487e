#pragma once

#include <vector>

#include "kdl_calibration/identification.hpp"

namespace kdl_calibration {

/// Training rows whose plain least squares fit is the robust one, and as uncertain (Huber 1981, chapter 7): where a
/// point was off by e it is off by w e / B, with w the weight of its row and B the mean derivative of w(r) r.
struct PseudoValues {
  Measurements measurements;
  std::vector<double> row_weights;  ///< 1, next to none where a row has no weight
  double rows = 0.0;                ///< those with weight
};

/// `weights`: of all rows by this loss, at `estimate`.
PseudoValues pseudo_values(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                           Loss loss, const std::vector<double>& weights);

}  // namespace kdl_calibration
