#pragma once

// Not installed.

namespace kdl_calibration {

/// P(F > f) of the F distribution with a and b degrees of freedom (regularised incomplete beta function by its
/// continued fraction, Abramowitz and Stegun 26.5.8 and 26.6.2).
double f_upper_tail(double f, double a, double b);

}  // namespace kdl_calibration
