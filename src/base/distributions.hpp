#pragma once

#include <span>

// Tails and critical values of distributions, by Boost.Math.

namespace kdl_calibration {

/// log |Gamma(x)|. Not std::lgamma, which writes the sign to a global variable.
double log_gamma(double x);

/// P(F > f) of the F distribution with a and b degrees of freedom; 1 if f <= 0.
double f_upper_tail(double f, double a, double b);

/// P(X >= least) of `trials` independent trials that succeed with this probability.
double binomial_upper_tail(int least, int trials, double probability);

/// The non-centrality with which an F test of this level has this power: with a degrees of freedom above, and b below,
/// infinite for a chi-squared test. The denominator counts as constant beyond its limit.
double non_centrality(double level, double power, double a, double b);

/// P that values of one distribution differ as far in rank, the first ones above the second (Mann and Whitney 1947):
/// the normal approximation, for values that are all different.
double rank_sum_upper_tail(std::span<const double> first, std::span<const double> second);

/// Upper `tail` quantile of the F distribution with a and b degrees of freedom; b may be infinite.
double f_critical(double tail, double a, double b);

/// P(X / freedom > ratio) of a chi-squared X with that many degrees of freedom.
double reduced_chi_squared_tail(double ratio, double freedom);

/// Two-sided 95 % quantile of Student's t.
double t_critical_95(double degrees_of_freedom);

/// The coverage factor k of an expanded uncertainty k u: the two-sided 95.45 % quantile of Student's t, which is 2 for
/// infinitely many degrees of freedom (GUM G.6.4).
double coverage_factor(double degrees_of_freedom);

/// The norm of `axes` standard normal values that is exceeded with probability `tail`.
double norm_critical(double tail, int axes);

}  // namespace kdl_calibration
