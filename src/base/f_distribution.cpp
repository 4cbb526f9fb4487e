#include "base/f_distribution.hpp"

#include <algorithm>
#include <cmath>

namespace kdl_calibration {

double log_gamma(double x) {
  int sign = 0;
  return ::lgamma_r(x, &sign);
}

namespace {

// P(F > f) and its slope by log f with the sign changed.
struct Tail {
  double probability = 0.0;
  double slope = 0.0;
};

class FDistribution {
public:
  FDistribution(double a, double b)
      : a_(a), b_(b), log_beta_(log_gamma(a / 2.0) + log_gamma(b / 2.0) - log_gamma((a + b) / 2.0)) {}

  // P(F > f) = I_x(b/2, a/2) with x = b / (b + a f).
  Tail beyond(double f) const {
    const double x = b_ / (b_ + a_ * f);
    const double rest = a_ * f / (b_ + a_ * f);
    const double log_x = x < rest ? std::log(x) : std::log1p(-rest);
    const double log_rest = x < rest ? std::log1p(-x) : std::log(rest);
    const double front = std::exp(b_ / 2.0 * log_x + a_ / 2.0 * log_rest - log_beta_);
    const bool swap = x > (b_ / 2.0 + 1.0) / ((a_ + b_) / 2.0 + 2.0);
    const double part = swap ? fraction(a_ / 2.0, b_ / 2.0, rest) : fraction(b_ / 2.0, a_ / 2.0, x);
    return {.probability = swap ? 1.0 - front * part : front * part, .slope = front};
  }

private:
  // Of the incomplete beta function, by Lentz's method.
  static double fraction(double p, double q, double x) {
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
    return value / p;
  }

  double a_;
  double b_;
  double log_beta_;
};

}  // namespace

double f_upper_tail(double f, double a, double b) { return f > 0.0 ? FDistribution(a, b).beyond(f).probability : 1.0; }

double reduced_chi_squared_tail(double ratio, double freedom) {
  constexpr double kKnown = 1e9;  // degrees of freedom of a denominator that does not scatter
  return f_upper_tail(ratio, freedom, kKnown);
}

double f_critical(double tail, double a, double b) {
  constexpr double kAsGoodAsInfinite = 1e7;
  constexpr double kSettled = 1e-13;  // of the tail
  constexpr int kMostSteps = 200;
  const FDistribution distribution(a, std::min(b, kAsGoodAsInfinite));
  double below = -40.0;  // logarithms
  double above = 40.0;
  double x = 1.0;
  for (int step = 0; step < kMostSteps && above - below > kSettled; ++step) {
    const Tail there = distribution.beyond(std::exp(x));
    if (std::abs(there.probability - tail) <= kSettled * tail) {
      break;
    }
    (there.probability > tail ? below : above) = x;
    // Newton's step of the logarithm of the tail, as long as it stays between.
    const double next = x + std::log(there.probability / tail) * there.probability / there.slope;
    x = below < next && next < above ? next : 0.5 * (below + above);
  }
  return std::exp(x);
}

double t_critical_95(double degrees_of_freedom) { return std::sqrt(f_critical(0.05, 1.0, degrees_of_freedom)); }

}  // namespace kdl_calibration
