#pragma once

#include <cstdint>

namespace kdl_calibration {

/// Seeded random numbers, identical on every platform (unlike the distributions of <random>).
/// Generator: splitmix64 (Steele, Lea and Flood 2014). `stream` gives independent sequences of one seed, so that
/// work spread over threads draws the same numbers in any order.
class Random {
public:
  explicit Random(std::uint64_t seed, std::uint64_t stream = 0);

  std::uint64_t bits();
  /// Uniform in [lower, upper).
  double uniform(double lower = 0.0, double upper = 1.0);
  /// Standard normal (Marsaglia's polar method).
  double normal();

private:
  std::uint64_t state_;
  double spare_ = 0.0;
  bool has_spare_ = false;
};

}  // namespace kdl_calibration
