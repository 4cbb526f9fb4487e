#pragma once

#include <vector>

#include "estimation/identification.hpp"

namespace kdl_calibration {

/// Pseudo-values (Huber 1981, chapter 7): training rows whose least squares fit equals the robust fit and its
/// uncertainty. A residual e becomes w e / B, with w the row's weight and B the mean derivative of w(r) r.
struct PseudoValues {
  Measurements measurements;
  std::vector<double> row_weights;  ///< 1; nearly 0 for rows without robust weight
  double rows = 0.0;                ///< number of rows with weight
};

/// `weights`: robust weights of all rows at `estimate`.
PseudoValues pseudo_values(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                           Loss loss, const std::vector<double>& weights);

}  // namespace kdl_calibration
