#pragma once

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

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
inline void expect_same(const Observation& a, const Observation& b, bool orientations_to_the_last_bit = true) {
  ASSERT_TRUE(same_bits(a.position(), b.position()) && same_bits(a.sigma, b.sigma));
  ASSERT_TRUE(a.configuration == b.configuration && a.target == b.target);
  ASSERT_TRUE(a.repeat == b.repeat && a.split == b.split && a.station == b.station);
  ASSERT_EQ(a.order, b.order);
  ASSERT_EQ(a.reading.index(), b.reading.index());
  if (const Orientation* const orientation = a.orientation()) {
    const Orientation& other = *b.orientation();
    if (orientations_to_the_last_bit) {
      ASSERT_TRUE(same_bits(orientation->coeffs(), other.coeffs()));
    } else {
      EXPECT_NEAR(orientation->norm(), 1.0, 1e-15);
      EXPECT_NEAR(std::abs(orientation->dot(other)), 1.0, 1e-15);
      EXPECT_LT((orientation->toRotationMatrix() - other.toRotationMatrix()).norm(), 1e-14);
    }
  }
  if (const auto* const some = std::get_if<Coordinates>(&a.reading)) {
    const auto& other = std::get<Coordinates>(b.reading);
    ASSERT_TRUE(same_bits(some->normal, other.normal) && some->count == other.count);
  }
  if (const auto* const distance = std::get_if<Distance>(&a.reading)) {
    ASSERT_TRUE(same_bits(distance->length, std::get<Distance>(b.reading).length));
  }
}

/// The same for each row.
inline void expect_same(const std::vector<Observation>& a, const std::vector<Observation>& b,
                        bool orientations_to_the_last_bit = true) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    SCOPED_TRACE("row " + std::to_string(i));
    expect_same(a[i], b[i], orientations_to_the_last_bit);
    if (::testing::Test::HasFatalFailure()) {
      return;
    }
  }
}

inline void expect_same(const Measurements& a, const Measurements& b, bool orientations_to_the_last_bit = true) {
  EXPECT_EQ(a.joints, b.joints);
  EXPECT_EQ(a.configurations, b.configurations);
  EXPECT_EQ(a.targets, b.targets);
  EXPECT_EQ(a.stations, b.stations);
  EXPECT_EQ(a.joint_units, b.joint_units);
  EXPECT_TRUE(same_bits(a.joint_values, b.joint_values));
  EXPECT_TRUE(same_bits(a.signals.torques, b.signals.torques));
  expect_same(a.observations, b.observations, orientations_to_the_last_bit);
}

}  // namespace kdl_calibration::testing
