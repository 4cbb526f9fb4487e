#include "calibration/new_point.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "base/distributions.hpp"

namespace kdl_calibration {

NewPoint new_point(const PointPrediction& prediction, const NoiseReport& noise) {
  const NoiseModel own{.independent = noise.independent, .tracker = noise.tracker};
  const double factor = (noise.parts ? 1.0 : noise.variance_factor) / prediction.repeats;
  Eigen::Matrix3d sum = prediction.covariance + factor * point_covariance(own, {.position = prediction.place});
  sum.diagonal() += factor * noise.common.cwiseAbs2();
  sum.diagonal().array() += noise.misfit * noise.misfit + noise.target_misfit * noise.target_misfit;
  NewPoint result{.radius_95 = std::numeric_limits<double>::infinity(),
                  .degrees_of_freedom = noise.freedom_of_covariance()};
  const double s2 = sum.trace();
  if (!std::isfinite(s2)) {
    return result;
  }
  if (noise.parts) {
    result.degrees_of_freedom = noise.parts->freedom_of_point();
  }
  const double k = s2 > 0.0 ? s2 * s2 / sum.cwiseAbs2().sum() : 3.0;
  result.radius_95 = std::sqrt(s2 * f_critical(0.05, k, std::max(result.degrees_of_freedom, 1.0)));
  return result;
}

bool MeasuredRegion::holds(const Eigen::VectorXd& q, const Eigen::Matrix3d& of_parameters) const {
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const double value = q[static_cast<Eigen::Index>(i)];
    if (!(joints[i].first <= value && value <= joints[i].second)) {
      return false;
    }
  }
  return of_parameters.trace() <= largest_variance;
}

MeasuredRegion measured_region(const Measurements& measurements, const std::vector<HeldOutPoint>& held_out,
                               const NoiseReport& noise, double optimism) {
  constexpr double kBeyond = 0.05;  // of the range
  constexpr std::size_t kFewest = 40;
  MeasuredRegion region;
  std::map<std::int32_t, std::vector<double>> ratios;
  for (const HeldOutPoint& point : held_out) {
    const double radius =
        new_point({.covariance = point.covariance, .place = point.measured, .repeats = point.repeats}, noise).radius_95;
    ratios[point.configuration].push_back(point.residual.norm() / radius);
    if (std::isfinite(point.covariance.trace())) {
      region.largest_variance = std::max(region.largest_variance, point.covariance.trace());
    }
  }
  if (ratios.empty()) {
    region.largest_variance = std::numeric_limits<double>::infinity();
  }
  region.joints = trained_ranges(measurements);
  for (auto& [lower, upper] : region.joints) {
    const double beyond = kBeyond * (upper - lower);
    lower -= beyond;
    upper += beyond;
  }
  std::vector<std::pair<double, double>> shares;  // ratio, share of its configuration
  for (const auto& [configuration, of_configuration] : ratios) {
    for (const double ratio : of_configuration) {
      shares.emplace_back(ratio, 1.0 / static_cast<double>(of_configuration.size()));
    }
  }
  if (ratios.size() < kFewest) {
    region.radius_factor = optimism;
    return region;
  }
  std::sort(shares.begin(), shares.end());
  const double wanted = 0.95 * (static_cast<double>(ratios.size()) + 1.0);
  double inside = 0.0;
  for (const auto& [ratio, share] : shares) {
    inside += share;
    if (inside >= wanted * (1.0 - 1e-12)) {
      region.radius_factor = ratio;
      break;
    }
  }
  return region;
}

}  // namespace kdl_calibration
