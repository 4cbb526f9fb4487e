#include "calibration/new_point.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "base/distributions.hpp"
#include "calibration/predicted_accuracy.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "measurements/training_rows.hpp"

namespace kdl_calibration {

NewPointNoise new_point_noise(const NoiseReport& noise) {
  return {.model = {.independent = noise.independent,
                    .tracker = noise.tracker,
                    .common = noise.common,
                    .misfit = noise.misfit,
                    .target_misfit = noise.target_misfit},
          .variance_factor = noise.parts ? 1.0 : noise.variance_factor,
          .degrees_of_freedom = noise.parts ? noise.parts->freedom_of_point() : noise.freedom_of_covariance(),
          .stations = noise.stations};
}

NewPoint new_point(const PointPrediction& prediction, const NewPointNoise& noise) {
  const NoiseModel& model = noise.model;
  const double factor = noise.variance_factor / prediction.repeats;
  const Observation measured{.reading = Point{prediction.place}, .noise = prediction.noise};
  Eigen::Matrix3d sum = prediction.covariance + factor * point_covariance(model, measured);
  sum.diagonal() += factor * model.common.cwiseAbs2();
  sum.diagonal().array() += model.misfit * model.misfit + model.target_misfit * model.target_misfit;
  const double s2 = sum.trace();
  if (!std::isfinite(s2)) {
    return {.sigma = std::numeric_limits<double>::infinity(),
            .radius_95 = std::numeric_limits<double>::infinity(),
            .degrees_of_freedom = noise.degrees_of_freedom};
  }
  const double k = s2 > 0.0 ? s2 * s2 / sum.cwiseAbs2().sum() : 3.0;
  return {.sigma = std::sqrt(s2),
          .radius_95 = std::sqrt(s2 * f_critical(0.05, k, std::max(noise.degrees_of_freedom, 1.0))),
          .degrees_of_freedom = noise.degrees_of_freedom};
}

namespace {

NewPoint left_out_point(const HeldOutPoint& point, const NewPointNoise& noise) {
  return new_point(
      {.covariance = point.covariance, .place = point.measured, .repeats = point.repeats, .noise = point.noise}, noise);
}

// The errors of left-out points over their predicted 1 sigma, RMS over the configurations.
double left_out_scatter(const std::vector<HeldOutPoint>& held_out, const NewPointNoise& noise) {
  std::map<std::int32_t, std::pair<double, double>> sums;  // of squares, and how many
  for (const HeldOutPoint& point : held_out) {
    const double sigma = left_out_point(point, noise).sigma;
    auto& [squares, count] = sums[point.configuration];
    squares += sigma > 0.0 ? point.residual.squaredNorm() / (sigma * sigma) : 0.0;
    count += 1.0;
  }
  double sum = 0.0;
  for (const auto& [configuration, own] : sums) {
    sum += own.first / own.second;
  }
  return sums.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(sums.size()));
}

}  // namespace

std::map<std::int32_t, std::vector<double>> left_out_ratios(const std::vector<HeldOutPoint>& held_out,
                                                            const NewPointNoise& noise) {
  std::map<std::int32_t, std::vector<double>> ratios;
  for (const HeldOutPoint& point : held_out) {
    ratios[point.configuration].push_back(point.residual.norm() / left_out_point(point, noise).radius_95);
  }
  return ratios;
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
  MeasuredRegion region;
  const std::map<std::int32_t, std::vector<double>> ratios = left_out_ratios(held_out, new_point_noise(noise));
  for (const HeldOutPoint& point : held_out) {
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
  if (ratios.size() < kEnoughForRadii) {
    region.radius_factor = optimism * std::max(left_out_scatter(held_out, new_point_noise(noise)), 1.0);
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

namespace {

// [m^2] by which one row scatters more than the mean of its repeats, on average over the targets of configurations.
double scatter_of_one(const CalibrationResult& calibration, const Measurements& measurements) {
  const std::vector<Observation>& all = measurements.observations;
  if (std::all_of(all.begin(), all.end(), [&](const Observation& o) { return o.repeat == all.front().repeat; })) {
    return 0.0;  // nothing is repeated
  }
  const NewPointNoise noise = new_point_noise(calibration.noise);
  struct Rows {
    double count = 0.0;
    double variance = 0.0;  // of one, in all its directions
  };
  std::map<std::array<int, 3>, Rows> groups;
  for (const Observation& o : all) {
    if (o.split == Split::train) {
      Rows& rows = groups[{o.configuration, o.target, o.station}];
      rows.count += 1.0;
      const bool is_distance = std::holds_alternative<Distance>(o.reading);
      const Observation one{.reading = Point{is_distance ? Eigen::Vector3d(Eigen::Vector3d::Zero()) : o.position()},
                            .noise = noise.at(static_cast<std::size_t>(o.station))};
      const double of_point = point_covariance(noise.model, one).trace() + noise.model.common.squaredNorm();
      rows.variance = noise.variance_factor * of_point * dimension(o.reading) / 3.0;
    }
  }
  double sum = 0.0;
  for (const auto& [place, rows] : groups) {
    sum += rows.variance * (1.0 - 1.0 / rows.count);
  }
  return groups.empty() ? 0.0 : sum / static_cast<double>(groups.size());
}

}  // namespace

NewPointErrors new_point_errors(const CalibrationResult& calibration, const Measurements& measurements) {
  const Accuracy& accuracy = calibration.accuracy;
  const BeforeAfter* left_out = accuracy.held_out();
  NewPointErrors result{.rows = left_out != nullptr ? NewPointErrors::Rows::left_out
                                : accuracy.test     ? NewPointErrors::Rows::test
                                                    : NewPointErrors::Rows::fitted,
                        .of_coordinates = has_single_coordinates(measurements)};
  const BeforeAfter& errors = left_out != nullptr ? *left_out : accuracy.test ? *accuracy.test : accuracy.train;
  const std::vector<bool> has_errors =
      configurations_with(result.rows == NewPointErrors::Rows::test ? Split::test : Split::train, measurements);
  result.configurations = static_cast<int>(std::count(has_errors.begin(), has_errors.end(), true));
  result.coverage_factor = coverage_factor(std::max(1, result.configurations));
  result.of_one = left_out != nullptr ? std::sqrt(scatter_of_one(calibration, measurements)) : 0.0;
  const auto expanded = [&](double rms) {
    return result.coverage_factor * std::hypot(rms, calibration.uncertainty.predicted.of_assumptions, result.of_one);
  };
  // Fitted rows follow the fit: a new one is off by their error and twice the variance of the prediction (Mallows
  // 1973).
  const PredictedAccuracy& predicted = calibration.uncertainty.predicted;
  const bool follow = result.rows == NewPointErrors::Rows::fitted && predicted.measured.count > 0;
  const double of_fit = follow ? 2.0 * variance_of_fit(predicted) : 0.0;
  const double chosen = left_out == nullptr             ? std::sqrt(std::pow(errors.after.rms, 2) + of_fit)
                        : accuracy.nested_leave_one_out ? accuracy.nested_leave_one_out->rms
                                                        : errors.after.rms * calibration.selection.optimism;
  result.compensated = expanded(chosen);
  result.urdf_alone = errors.rigid ? expanded(errors.rigid->rms) : result.compensated;
  result.nominal = expanded(errors.before.rms);
  return result;
}

}  // namespace kdl_calibration
