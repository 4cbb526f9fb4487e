#pragma once

namespace kdl_calibration::testing {

/// The size from which on `found(size)` is true, between `lower`, where it is not, and `upper`, where it is; to
/// 2^-halvings of what lies between.
template <class Found>
double onset(double lower, double upper, const Found& found, int halvings = 26) {
  for (int i = 0; i < halvings; ++i) {
    const double middle = 0.5 * (lower + upper);
    (found(middle) ? upper : lower) = middle;
  }
  return 0.5 * (lower + upper);
}

}  // namespace kdl_calibration::testing
