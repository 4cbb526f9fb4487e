#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration::testing {

inline bool same_bits(double a, double b) {
  return std::bit_cast<std::uint64_t>(a) == std::bit_cast<std::uint64_t>(b) || (std::isnan(a) && std::isnan(b));
}

template <class A, class B>
bool same_bits(const Eigen::MatrixBase<A>& a, const Eigen::MatrixBase<B>& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() && a.binaryExpr(b, [](double x, double y) {
                                                            return same_bits(x, y) ? 1.0 : 0.0;
                                                          }).sum() == static_cast<double>(a.size());
}

/// To the last bit, but for orientations that were stated in another form: of those the rotation, to 1e-14.
inline void expect_same(const Measurements& a, const Measurements& b, bool orientations_to_the_last_bit = true) {
  EXPECT_EQ(a.joints, b.joints);
  EXPECT_EQ(a.configurations, b.configurations);
  EXPECT_EQ(a.targets, b.targets);
  EXPECT_EQ(a.joint_units, b.joint_units);
  EXPECT_EQ(a.order, b.order);
  EXPECT_TRUE(same_bits(a.joint_values, b.joint_values));
  EXPECT_TRUE(same_bits(a.signals.torques, b.signals.torques));
  ASSERT_EQ(a.observations.size(), b.observations.size());
  for (std::size_t i = 0; i < a.observations.size(); ++i) {
    const Observation& p = a.observations[i];
    const Observation& q = b.observations[i];
    ASSERT_TRUE(same_bits(p.position, q.position) && same_bits(p.sigma, q.sigma)) << "row " << i;
    ASSERT_TRUE(p.configuration == q.configuration && p.target == q.target) << "row " << i;
    ASSERT_TRUE(p.repeat == q.repeat && p.split == q.split) << "row " << i;
  }
  ASSERT_EQ(a.orientations.size(), b.orientations.size());
  for (std::size_t i = 0; i < a.orientations.size(); ++i) {
    ASSERT_EQ(is_point(a.orientations[i]), is_point(b.orientations[i])) << "row " << i;
    if (orientations_to_the_last_bit) {
      ASSERT_TRUE(same_bits(a.orientations[i].coeffs(), b.orientations[i].coeffs())) << "row " << i;
    } else if (!is_point(a.orientations[i])) {
      EXPECT_NEAR(a.orientations[i].norm(), 1.0, 1e-15);
      EXPECT_NEAR(std::abs(a.orientations[i].dot(b.orientations[i])), 1.0, 1e-15) << "row " << i;
      EXPECT_LT((a.orientations[i].toRotationMatrix() - b.orientations[i].toRotationMatrix()).norm(), 1e-14);
    }
  }
}

}  // namespace kdl_calibration::testing
