#pragma once

// Tails and critical values of distributions, by Boost.Math. Not installed.

namespace kdl_calibration {

/// log |Gamma(x)|. std::lgamma writes the sign to a variable that all threads share.
double log_gamma(double x);

/// P(F > f) of the F distribution with a and b degrees of freedom; 1 where f is not above 0.
double f_upper_tail(double f, double a, double b);

/// The value that an F with a and b degrees of freedom exceeds with probability `tail`; b may be infinite.
double f_critical(double tail, double a, double b);

/// P(X / freedom > ratio) of a chi-squared X with that many degrees of freedom.
double reduced_chi_squared_tail(double ratio, double freedom);

/// The value whose size a Student's t with that many degrees of freedom exceeds with probability 0.05.
double t_critical_95(double degrees_of_freedom);

/// Probability that the norm of `axes` standard normal values exceeds t, and the norm that is exceeded with probability
/// `tail`.
double norm_tail(double t, int axes);
double norm_critical(double tail, int axes);

}  // namespace kdl_calibration
