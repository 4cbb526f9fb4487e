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
  constexpr double kFarthest = 40.0;
  constexpr double kSettled = 1e-13;  // of the tail
  constexpr int kMostSteps = 100;
  b = std::min(b, kAsGoodAsInfinite);
  const auto missing = [&](double logarithm) { return f_upper_tail(std::exp(logarithm), a, b) - tail; };
  double below = 0.0;
  double above = 1.0;
  for (double step = 1.0; below > -kFarthest && missing(below) < 0.0; step *= 2.0) {
    below -= step;
  }
  for (double step = 1.0; above < kFarthest && missing(above) > 0.0; step *= 2.0) {
    above += step;
  }
  // Chords between both ends, where one that stays counts half (Illinois; Dowell and Jarratt 1971).
  double at_below = missing(below);
  double at_above = missing(above);
  int stayed = 0;
  double between = at_below > 0.0 ? above : below;
  for (int step = 0; step < kMostSteps && at_below > 0.0 && at_above < 0.0; ++step) {
    between = (below * at_above - above * at_below) / (at_above - at_below);
    const double there = missing(between);
    if (std::abs(there) <= kSettled * tail) {
      break;
    }
    if (there > 0.0) {
      below = between;
      at_below = there;
      at_above *= stayed == 1 ? 0.5 : 1.0;
      stayed = 1;
    } else {
      above = between;
      at_above = there;
      at_below *= stayed == -1 ? 0.5 : 1.0;
      stayed = -1;
    }
  }
  return std::exp(between);
}

double t_critical_95(double degrees_of_freedom) { return std::sqrt(f_critical(0.05, 1.0, degrees_of_freedom)); }

}  // namespace kdl_calibration
