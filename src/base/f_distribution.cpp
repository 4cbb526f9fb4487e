#include "base/f_distribution.hpp"

#include <algorithm>
#include <cmath>

namespace kdl_calibration {
namespace {

// std::lgamma writes the sign to a variable that all threads share.
double log_gamma(double x) {
  int sign = 0;
  return ::lgamma_r(x, &sign);
}

}  // namespace

double f_upper_tail(double f, double a, double b) {
  if (!(f > 0.0)) {
    return 1.0;
  }
  // P(F > f) = I_x(b/2, a/2) with x = b / (b + a f).
  double p = b / 2.0;
  double q = a / 2.0;
  double x = b / (b + a * f);
  const bool swap = x > (p + 1.0) / (p + q + 2.0);
  if (swap) {
    std::swap(p, q);
    x = 1.0 - x;
  }
  // Lentz's method.
  const double tiny = 1e-300;
  double c = 1.0;
  double d = 1.0 / std::max(std::abs(1.0 - (p + q) * x / (p + 1.0)), tiny);
  double value = d;
  for (int m = 1; m < 10000; ++m) {
    const double even = m * (q - m) * x / ((p + 2.0 * m - 1.0) * (p + 2.0 * m));
    const double odd = -(p + m) * (p + q + m) * x / ((p + 2.0 * m) * (p + 2.0 * m + 1.0));
    double change = 1.0;
    for (const double term : {even, odd}) {
      d = 1.0 + term * d;
      d = 1.0 / (std::abs(d) < tiny ? tiny : d);
      c = 1.0 + term / c;
      c = std::abs(c) < tiny ? tiny : c;
      change = c * d;
      value *= change;
    }
    if (std::abs(change - 1.0) < 1e-15) {
      break;
    }
  }
  const double log_front = log_gamma(p + q) - log_gamma(p) - log_gamma(q) + p * std::log(x) + q * std::log1p(-x);
  const double tail = std::exp(log_front) * value / p;
  return swap ? 1.0 - tail : tail;
}

double f_critical(double tail, double a, double b) {
  constexpr double kAsGoodAsInfinite = 1e7;
  constexpr int kHalvings = 80;
  b = std::min(b, kAsGoodAsInfinite);
  double below = -40.0;  // logarithms
  double above = 40.0;
  for (int halving = 0; halving < kHalvings; ++halving) {
    const double middle = 0.5 * (below + above);
    (f_upper_tail(std::exp(middle), a, b) > tail ? below : above) = middle;
  }
  return std::exp(0.5 * (below + above));
}

double t_critical_95(double degrees_of_freedom) { return std::sqrt(f_critical(0.05, 1.0, degrees_of_freedom)); }

}  // namespace kdl_calibration
