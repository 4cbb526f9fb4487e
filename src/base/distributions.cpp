#include "base/distributions.hpp"

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/non_central_chi_squared.hpp>
#include <boost/math/policies/policy.hpp>
#include <boost/math/special_functions/erf.hpp>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace kdl_calibration {
namespace {

namespace math = boost::math;
namespace policies = boost::math::policies;

// Errors return NaN or infinity instead of throwing; no promotion to long double.
using Policy =
    policies::policy<policies::domain_error<policies::ignore_error>, policies::pole_error<policies::ignore_error>,
                     policies::overflow_error<policies::ignore_error>,
                     policies::evaluation_error<policies::ignore_error>, policies::promote_double<false>>;
using FisherF = math::fisher_f_distribution<double, Policy>;
using ChiSquared = math::chi_squared_distribution<double, Policy>;

// Above these degrees of freedom the denominator is constant within rounding.
constexpr double kAsGoodAsInfinite = 1e15;

double chi_squared_tail(double value, double freedom) {
  if (!(value > 0.0)) {
    return 1.0;
  }
  return std::isinf(value) ? 0.0 : math::cdf(math::complement(ChiSquared(freedom), value));
}

}  // namespace

double log_gamma(double x) {
  int sign = 0;
  return ::lgamma_r(x, &sign);
}

double f_upper_tail(double f, double a, double b) {
  if (b > kAsGoodAsInfinite || !(f > 0.0)) {
    return chi_squared_tail(a * f, a);
  }
  return std::isinf(f) ? 0.0 : math::cdf(math::complement(FisherF(a, b), f));
}

// By the F distribution, of which the tail is not lost beside one.
double binomial_upper_tail(int least, int trials, double probability) {
  if (least <= 0) {
    return 1.0;
  }
  const double a = 2.0 * least;
  const double b = 2.0 * (trials - least + 1);
  return least > trials ? 0.0 : f_upper_tail(a / b * (1.0 - probability) / probability, b, a);
}

// Far beyond its degrees of freedom the root of a non-central value is normal about the root of its centre.
double non_centrality(double level, double power, double a, double b) {
  constexpr double kFar = 1e4;
  using NonCentral = math::non_central_chi_squared_distribution<double, Policy>;
  const double limit = a * f_critical(level, a, b);
  if (limit > kFar) {
    const double beyond = std::sqrt(2.0) * math::erf_inv(2.0 * power - 1.0, Policy());
    return std::pow(std::sqrt(limit) + beyond, 2);
  }
  return NonCentral::find_non_centrality(a, limit, 1.0 - power);
}

double rank_sum_upper_tail(std::span<const double> first, std::span<const double> second) {
  std::vector<double> sorted(second.begin(), second.end());
  std::sort(sorted.begin(), sorted.end());
  double pairs = 0.0;  // in which the first value is larger
  for (const double value : first) {
    pairs += static_cast<double>(std::lower_bound(sorted.begin(), sorted.end(), value) - sorted.begin());
  }
  const auto m = static_cast<double>(first.size());
  const auto n = static_cast<double>(second.size());
  const double variance = m * n * (m + n + 1.0) / 12.0;
  return variance > 0.0 ? 0.5 * std::erfc((pairs - 0.5 * m * n) / std::sqrt(2.0 * variance)) : 1.0;
}

double f_critical(double tail, double a, double b) {
  return b > kAsGoodAsInfinite ? math::quantile(math::complement(ChiSquared(a), tail)) / a
                               : math::quantile(math::complement(FisherF(a, b), tail));
}

double reduced_chi_squared_tail(double ratio, double freedom) { return chi_squared_tail(ratio * freedom, freedom); }

double t_critical_95(double degrees_of_freedom) { return std::sqrt(f_critical(0.05, 1.0, degrees_of_freedom)); }

double coverage_factor(double degrees_of_freedom) {
  static const double tails = std::erfc(std::numbers::sqrt2);  // beyond 2 sigma of a normal distribution
  return std::sqrt(f_critical(tails, 1.0, degrees_of_freedom));
}

double norm_critical(double tail, int axes) {
  return std::sqrt(math::quantile(math::complement(ChiSquared(axes), tail)));
}

}  // namespace kdl_calibration
