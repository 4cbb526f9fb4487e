#pragma once

// Whether normal equations and sums are those of whitened rows.

#include <gtest/gtest.h>

#include <Eigen/Core>

#include "estimation/linear_system.hpp"

namespace kdl_calibration::testing {

/// The sums of whitened rows.
inline WhitenedSummary summarised(const WhitenedSystem& system) {
  RowSummary summary(system.jacobian.cols());
  for (std::size_t b = 0; b + 1 < system.blocks.size(); ++b) {
    const Eigen::Index first = system.blocks[b];
    const Eigen::Index count = system.blocks[b + 1] - first;
    summary.add_configuration(system.jacobian.middleRows(first, count), system.residual.segment(first, count));
  }
  summary.add_priors(system.jacobian.bottomRows(system.jacobian.rows() - system.blocks.back()));
  return summary.finish();
}

/// Hessian J^T J and gradient J^T e, to these shares of their norms.
inline void expect_equations_of(const WhitenedSystem& rows, const NormalEquations& found, double of_hessian,
                                double of_gradient) {
  const Eigen::MatrixXd hessian = rows.jacobian.transpose() * rows.jacobian;
  const Eigen::VectorXd gradient = rows.jacobian.transpose() * rows.residual;
  EXPECT_LT((found.hessian - hessian).norm(), of_hessian * hessian.norm());
  EXPECT_LT((found.gradient - gradient).norm(), of_gradient * gradient.norm());
}

/// Sums to this share of their norms. Of the triangle the information counts.
inline void expect_same_summary(const WhitenedSummary& found, const WhitenedSummary& expected, double share) {
  EXPECT_EQ(found.rows, expected.rows);
  EXPECT_EQ(found.measured_rows, expected.measured_rows);
  EXPECT_EQ(found.pairs, expected.pairs);
  EXPECT_NEAR(found.squares, expected.squares, share * expected.squares);
  EXPECT_NEAR(found.squares_of_sums, expected.squares_of_sums, share * expected.squares_of_sums);
  EXPECT_LE((found.priors - expected.priors).norm(), share * expected.priors.norm());
  EXPECT_LT((found.sums - expected.sums).norm(), share * expected.sums.norm());
  EXPECT_TRUE(found.sqrt_information.isUpperTriangular(0.0));
  const Eigen::MatrixXd information = expected.sqrt_information.transpose() * expected.sqrt_information;
  EXPECT_LT((found.sqrt_information.transpose() * found.sqrt_information - information).norm(),
            share * information.norm());
}

}  // namespace kdl_calibration::testing
