#include "calibration/prior_check.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/distributions.hpp"
#include "planning/simulation.hpp"
#include "support.hpp"

namespace kdl_calibration::prior_check_test {
namespace {

// Of three parameters, two lengths and an angle, and a base that has no prior.
CalibrationResult with_errors(double length, double second_length, double angle) {
  CalibrationResult found;
  found.model = complete_model(testing::fanuc());
  found.fit.identification.estimate.errors =
      testing::errors_of(found.model, {{"Tx1", length}, {"Ty1", second_length}, {"Rz2", angle}});
  found.fit.identification.estimate.frames.targets = published_targets();
  found.fit.free = Unknowns(found.model, published_targets(), {"base.Tx", "Tx1", "Ty1", "Rz2"});
  found.fit.identification.estimate.frames.base().translation().x() = 5.0;
  found.selection.priors = {.length = 1e-3, .angle = 2e-3};
  found.uncertainty.covariance = Eigen::MatrixXd::Zero(4, 4);
  found.uncertainty.covariance.diagonal() << 1e-8, 1e-7, 4e-7, 1e-6;
  return found;
}

// Columns: base.Tx, Tx1, Ty1, Rz2; of the prior variances the measurements leave a tenth, four tenths and a quarter.
constexpr double kExpected = 0.9 + 0.6 + 0.75;

TEST(PriorCheck, EstimatesAreAsManyTimesTooLargeAsTheirSquaresSay) {
  const double squares = 9.0 + 16.0 + 25.0;
  EXPECT_NEAR(excess_over_priors(with_errors(3e-3, -4e-3, 10e-3)), std::sqrt(squares / kExpected), 1e-12);
}

TEST(PriorCheck, ContradictsFromAChanceOfOneInAThousandOn) {
  double below = 1.0;
  double above = 100.0;
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (below + above);
    (reduced_chi_squared_tail(middle, kExpected) > 1e-3 ? below : above) = middle;
  }
  const double length = 1e-3 * std::sqrt(above * kExpected / 3.0);
  for (const double factor : {0.99, 1.01}) {
    const CalibrationResult found = with_errors(factor * length, factor * length, 2.0 * factor * length);
    const double expected = factor > 1.0 ? factor * std::sqrt(above) : 1.0;
    EXPECT_NEAR(excess_over_priors(found), expected, 1e-9) << factor;
  }
}

TEST(PriorCheck, SmallEstimatesAndNoneContradictNothing) {
  EXPECT_EQ(excess_over_priors(with_errors(1e-9, 0.0, 0.0)), 1.0);
  CalibrationResult without = with_errors(1.0, 1.0, 1.0);
  without.selection.priors = {};
  EXPECT_EQ(excess_over_priors(without), 1.0);
}

TEST(PriorCheck, WhatIsNotDeterminedOrTellsNothingBeyondItsPriorDoesNotCount) {
  CalibrationResult found = with_errors(8e-3, 1.0, 0.0);
  found.uncertainty.covariance(2, 2) = std::numeric_limits<double>::infinity();
  EXPECT_NEAR(excess_over_priors(found), std::sqrt(64.0 / (0.9 + 0.75)), 1e-12);
  found = with_errors(8e-3, 0.0, 0.0);
  found.uncertainty.covariance(3, 3) = 5e-6;  // more than its prior says
  EXPECT_NEAR(excess_over_priors(found), std::sqrt(64.0 / (0.9 + 0.6)), 1e-12);
}

}  // namespace
}  // namespace kdl_calibration::prior_check_test
