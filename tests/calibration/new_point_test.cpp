#include "calibration/new_point.hpp"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "base/distributions.hpp"
#include "base/random.hpp"
#include "estimation/prediction.hpp"
#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::new_point_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Matrix3d some_covariance() {
  Matrix3d root;
  root << 3e-5, 1e-5, -2e-5, 0.0, 5e-5, 1e-5, 0.0, 0.0, 2e-5;
  return root * root.transpose();
}

NoiseReport some_noise() {
  NoiseReport noise;
  noise.source = NoiseSource::residuals;
  noise.independent = Vector3d(2e-5, 3e-5, 4e-5);
  noise.common = Vector3d(5e-5, 1e-5, 6e-5);
  noise.misfit = 7e-5;
  noise.target_misfit = 3e-5;
  noise.degrees_of_freedom = 17.0;
  noise.variance_factor = 2.5;
  return noise;
}

// s sqrt(F_0.95(k, nu)) with s^2 = tr Sigma and k = s^4 / tr Sigma^2.
double radius_of(const Matrix3d& sigma, double freedom) {
  const double k = sigma.trace() * sigma.trace() / (sigma * sigma).trace();
  return std::sqrt(sigma.trace() * f_critical(0.05, k, freedom));
}

Matrix3d diagonal(const Vector3d& sigmas) { return sigmas.cwiseAbs2().asDiagonal(); }

TEST(NewPoint, HasTheRadiusOfParametersNoiseAndMisfitTogether) {
  for (const double repeats : {1.0, 4.0}) {
    NoiseReport noise = some_noise();
    const PointPrediction there{.covariance = some_covariance(), .place = Vector3d(1.0, 2.0, 3.0), .repeats = repeats};
    const Matrix3d misfit = (7e-5 * 7e-5 + 3e-5 * 3e-5) * Matrix3d::Identity();
    const Matrix3d point = diagonal({2e-5, 3e-5, 4e-5}) + diagonal({5e-5, 1e-5, 6e-5});
    const NewPoint by_residuals = new_point(there, new_point_noise(noise));
    EXPECT_EQ(by_residuals.degrees_of_freedom, noise.freedom_of_covariance());
    const double expected =
        radius_of(some_covariance() + 2.5 / repeats * point + misfit, noise.freedom_of_covariance());
    EXPECT_NEAR(by_residuals.radius_95 / expected, 1.0, 1e-12);

    NoiseParts parts;
    parts.variances << 1e-9, 2e-9, 3e-9, 1e-9, 2e-9, 4e-10, 5e-10, 6e-10, 0.0;
    parts.covariance.diagonal().setConstant(1e-20);
    noise.parts = parts;
    const NewPoint by_parts = new_point(there, new_point_noise(noise));
    EXPECT_EQ(by_parts.degrees_of_freedom, parts.freedom_of_point());
    EXPECT_NEAR(by_parts.radius_95 / radius_of(some_covariance() + point / repeats + misfit, parts.freedom_of_point()),
                1.0, 1e-12);
  }
}

TEST(NewPoint, IsMeasuredByTheTrackerAtItsPlace) {
  NoiseReport noise = some_noise();
  noise.tracker = TrackerNoise{.range = 1e-5, .transverse_per_metre = 1e-4};
  noise.variance_factor = 1.0;
  const Matrix3d near = diagonal({1e-5, 1e-4, 1e-4});
  const Matrix3d far = diagonal({5e-4, 1e-5, 5e-4});
  const Matrix3d rest = diagonal({5e-5, 1e-5, 6e-5}) + (7e-5 * 7e-5 + 3e-5 * 3e-5) * Matrix3d::Identity();
  const double freedom = noise.freedom_of_covariance();
  const auto radius_at = [&](const Vector3d& place) {
    return new_point({.covariance = Matrix3d::Zero(), .place = place}, new_point_noise(noise)).radius_95;
  };
  EXPECT_NEAR(radius_at({1.0, 0.0, 0.0}) / radius_of(near + rest, freedom), 1.0, 1e-12);
  EXPECT_NEAR(radius_at({0.0, 5.0, 0.0}) / radius_of(far + rest, freedom), 1.0, 1e-12);
}

TEST(NewPoint, HasNoRadiusWhereItIsNotDeterminedAndNoneWithoutNoise) {
  const Matrix3d infinite = Vector3d::Constant(kInfinity).asDiagonal();
  const NewPoint unknown =
      new_point({.covariance = infinite, .place = Vector3d::Zero()}, new_point_noise(some_noise()));
  EXPECT_EQ(unknown.radius_95, kInfinity);
  EXPECT_EQ(unknown.degrees_of_freedom, some_noise().freedom_of_covariance());
  NoiseReport none;
  none.source = NoiseSource::residuals;
  none.degrees_of_freedom = 5.0;
  EXPECT_EQ(new_point({.covariance = Matrix3d::Zero(), .place = Vector3d::Zero()}, new_point_noise(none)).radius_95,
            0.0);
}

TEST(NewPoint, RestsOnOneDegreeOfFreedomAtLeast) {
  NoiseReport noise = some_noise();
  noise.degrees_of_freedom = 0.3;
  const PointPrediction there{.covariance = some_covariance(), .place = Vector3d::Zero()};
  const double radius = new_point(there, new_point_noise(noise)).radius_95;
  noise.degrees_of_freedom = 1.0;
  EXPECT_EQ(radius, new_point(there, new_point_noise(noise)).radius_95);
  noise.degrees_of_freedom = 1.2;
  EXPECT_GT(radius, new_point(there, new_point_noise(noise)).radius_95);
}

// Configurations whose held-out points lie at these shares of their radius, one list for each.
std::vector<HeldOutPoint> held_out(const std::vector<std::vector<double>>& ratios, const NoiseReport& noise) {
  std::vector<HeldOutPoint> result;
  for (std::size_t c = 0; c < ratios.size(); ++c) {
    for (std::size_t k = 0; k < ratios[c].size(); ++k) {
      HeldOutPoint point{.configuration = static_cast<std::int32_t>(c), .target = static_cast<std::int32_t>(k)};
      point.covariance = (1.0 + 0.1 * static_cast<double>((7 * c) % 11)) * some_covariance();
      point.repeats = 1.0 + static_cast<double>(c % 3);
      point.measured = Vector3d(1.0, static_cast<double>(c), 0.0);
      const double radius =
          new_point({.covariance = point.covariance, .place = point.measured, .repeats = point.repeats},
                    new_point_noise(noise))
              .radius_95;
      point.residual = ratios[c][k] * radius * Vector3d(0.6, 0.0, -0.8);
      result.push_back(point);
    }
  }
  return result;
}

Measurements measured_at(const Eigen::MatrixXd& joint_values) {
  Measurements measurements;
  measurements.joint_values = joint_values;
  measurements.targets = {"A"};
  for (Eigen::Index c = 0; c < joint_values.cols(); ++c) {
    measurements.configurations.push_back(std::to_string(c));
    measurements.observations.push_back(
        {.reading = Point{Vector3d::Zero()}, .configuration = static_cast<std::int32_t>(c)});
  }
  return measurements;
}

double factor_of(const std::vector<std::vector<double>>& ratios, double optimism = 1.23) {
  const Measurements none = measured_at(Eigen::MatrixXd::Zero(1, 1));
  return measured_region(none, held_out(ratios, some_noise()), some_noise(), optimism).radius_factor;
}

// The smallest ratio that leaves 95 % of n + 1 configurations inside.
TEST(MeasuredRegion, WidensRadiiUntilNineteenOfTwentyConfigurationsAreInside) {
  for (const std::size_t count : {40U, 59U, 60U, 100U}) {
    std::vector<std::vector<double>> ratios;
    for (std::size_t c = 0; c < count; ++c) {
      ratios.push_back({0.01 * static_cast<double>((c * 37) % count + 1)});  // each rank once, unsorted
    }
    const double inside = std::ceil(0.95 * static_cast<double>(count + 1) - 1e-9);
    EXPECT_NEAR(factor_of(ratios), 0.01 * inside, 1e-9) << count;
  }
}

TEST(MeasuredRegion, CountsEachTargetAsItsShareOfTheConfiguration) {
  std::vector<std::vector<double>> ratios(50, {0.1, 0.1});
  ratios[20] = {1.0, 1.1, 1.2, 1.3};
  ratios[30] = {2.0};
  // 48 configurations below; 48.45 of 51 are wanted, which is the second quarter of the 49th.
  EXPECT_NEAR(factor_of(ratios), 1.1, 1e-9);
}

TEST(MeasuredRegion, OfFewConfigurationsPaysForTheOptimismOfSelection) {
  const std::vector<std::vector<double>> few(39, {0.2, 0.3});
  const std::vector<std::vector<double>> enough(40, {0.5, 0.7});
  EXPECT_EQ(factor_of(few), 1.23);
  EXPECT_NEAR(factor_of(enough), 0.7, 1e-9);
  EXPECT_EQ(factor_of({}), 1.23);
}

// And for errors of left-out points that are larger than predicted: the root of the mean square of their ratio to 1
// sigma, each configuration with the same weight. Smaller errors narrow nothing.
TEST(MeasuredRegion, OfFewConfigurationsIsNotContradictedByLeftOutErrors) {
  const Matrix3d point = diagonal({2e-5, 3e-5, 4e-5}) + diagonal({5e-5, 1e-5, 6e-5});
  const Matrix3d misfit = (7e-5 * 7e-5 + 3e-5 * 3e-5) * Matrix3d::Identity();
  const std::vector<std::vector<double>> times = {{1.0, 3.0}, {2.0}, {0.0, 0.0, 0.0}};  // mean square 3
  for (const double size : {1.0, 0.5}) {
    std::vector<HeldOutPoint> points;
    for (std::int32_t c = 0; c < 39; ++c) {
      for (const double sigmas : times[static_cast<std::size_t>(c % 3)]) {
        HeldOutPoint& one = points.emplace_back();
        one.configuration = c;
        one.covariance = (1.0 + c) * some_covariance();
        one.repeats = 2.0;
        const double sigma = std::sqrt((one.covariance + 2.5 / 2.0 * point + misfit).trace());
        one.residual = size * sigmas * sigma * Vector3d(0.0, 0.6, 0.8);
      }
    }
    const MeasuredRegion region = measured_region(measured_at(Eigen::MatrixXd::Zero(1, 1)), points, some_noise(), 1.1);
    EXPECT_NEAR(region.radius_factor, 1.1 * std::max(size * std::sqrt(3.0), 1.0), 1e-12) << size;
  }
}

TEST(MeasuredRegion, ReachesFivePercentBeyondTheJointValuesAndAsFarAsTheParametersAreKnown) {
  Eigen::MatrixXd q(2, 4);
  q << 0.0, 2.0, 1.0, 5.0, -1.0, 0.5, 0.7, 9.0;
  Measurements measurements = measured_at(q);
  measurements.observations.back().split = Split::test;
  std::vector<HeldOutPoint> predicted = held_out(std::vector<std::vector<double>>(12, {0.5}), some_noise());
  predicted[3].covariance.setConstant(kInfinity);  // tells nothing of how far
  double largest = 0.0;
  for (std::size_t i = 0; i < predicted.size(); ++i) {
    largest = std::max(largest, i == 3 ? 0.0 : predicted[i].covariance.trace());
  }
  const MeasuredRegion region = measured_region(measurements, predicted, some_noise(), 1.0);
  EXPECT_EQ(region.largest_variance, largest);
  ASSERT_EQ(region.joints.size(), 2U);
  EXPECT_NEAR(region.joints[0].first, -0.1, 1e-12);
  EXPECT_NEAR(region.joints[0].second, 2.1, 1e-12);
  EXPECT_NEAR(region.joints[1].first, -1.085, 1e-12);
  EXPECT_NEAR(region.joints[1].second, 0.785, 1e-12);
  const Matrix3d known = largest * Vector3d(0.5, 0.3, 0.199).asDiagonal();
  const Matrix3d unknown = largest * Vector3d(0.5, 0.3, 0.201).asDiagonal();
  EXPECT_TRUE(region.holds(Eigen::Vector2d(0.5, 0.5), known));
  EXPECT_FALSE(region.holds(Eigen::Vector2d(0.5, 0.5), unknown));
  for (const auto& [value, inside] : {std::pair(-0.101, false), {-0.099, true}, {2.099, true}, {2.101, false}}) {
    EXPECT_EQ(region.holds(Eigen::Vector2d(value, 0.5), known), inside) << value;
  }
  for (const auto& [value, inside] : {std::pair(-1.086, false), {-1.084, true}, {0.784, true}, {0.786, false}}) {
    EXPECT_EQ(region.holds(Eigen::Vector2d(0.5, value), known), inside) << value;
  }
  EXPECT_FALSE(region.holds(Eigen::Vector2d(0.5, std::nan("")), known));
}

TEST(MeasuredRegion, WithoutHeldOutPointsDoesNotEndWhereParametersAreLessKnown) {
  const Eigen::MatrixXd q = Eigen::RowVector2d(0.0, 1.0);
  const MeasuredRegion region = measured_region(measured_at(q), {}, some_noise(), 1.0);
  EXPECT_TRUE(region.holds(Eigen::VectorXd::Constant(1, 0.5), 1e6 * Matrix3d::Identity()));
  EXPECT_FALSE(region.holds(Eigen::VectorXd::Constant(1, 1.5), Matrix3d::Zero()));
}

TEST(MeasuredRegion, OnItsBoundaryHolds) {
  MeasuredRegion region{.radius_factor = 1.0, .largest_variance = 3.0, .joints = {{-1.0, 2.0}}};
  EXPECT_TRUE(region.holds(Eigen::VectorXd::Constant(1, -1.0), Matrix3d::Identity()));
  EXPECT_TRUE(region.holds(Eigen::VectorXd::Constant(1, 2.0), Matrix3d::Identity()));
}

// By hand, with k of the GUM for 5 left-out configurations (2.649) and for 2 test configurations (4.527).
TEST(NewPoint, StatesTheErrorsOfAllRobotsInTheSameWay) {
  Measurements measurements;
  measurements.joint_values = Eigen::MatrixXd::Zero(1, 7);
  measurements.targets = {"A"};
  for (std::int32_t c = 0; c < 7; ++c) {
    measurements.configurations.push_back(std::to_string(c));
    for (int repeat = 0; repeat < 3; ++repeat) {
      measurements.observations.push_back({.reading = Point{Vector3d::Zero()},
                                           .configuration = c,
                                           .repeat = repeat,
                                           .split = c < 5 ? Split::train : Split::test});
    }
  }
  const auto errors = [](double before, double after) {
    return BeforeAfter{.before = {.count = 5, .rms = before}, .after = {.count = 5, .rms = after}, .rigid = {}};
  };
  CalibrationResult found;
  found.uncertainty.predicted.of_assumptions = 3e-5;
  found.selection.optimism = 2.0;
  found.accuracy.train = errors(9e-4, 1e-5);
  const NewPointErrors fitted = new_point_errors(found, measurements);
  EXPECT_EQ(fitted.rows, NewPointErrors::Rows::fitted);
  EXPECT_NEAR(fitted.compensated, 2.649 * std::hypot(1e-5, 3e-5), 1e-7);
  EXPECT_EQ(fitted.urdf_alone, fitted.compensated) << "without effects it is the same robot";

  found.accuracy.test = errors(8e-4, 4e-5);
  const NewPointErrors tested = new_point_errors(found, measurements);
  EXPECT_EQ(tested.rows, NewPointErrors::Rows::test);
  EXPECT_EQ(tested.configurations, 2);
  EXPECT_NEAR(tested.compensated, 4.527 * 5e-5, 1e-7);

  found.accuracy.leave_one_out = errors(7e-4, 2e-5);
  found.accuracy.leave_one_out->rigid = {.count = 5, .rms = 4e-5};
  NewPointErrors left_out = new_point_errors(found, measurements);
  EXPECT_EQ(left_out.rows, NewPointErrors::Rows::left_out);
  EXPECT_EQ(left_out.configurations, 5);
  EXPECT_NEAR(left_out.coverage_factor, 2.649, 5e-4);
  EXPECT_NEAR(left_out.compensated, 2.649 * 5e-5, 1e-7) << "twice the error: they have chosen the model";
  EXPECT_NEAR(left_out.urdf_alone, 2.649 * 5e-5, 1e-7);
  EXPECT_NEAR(left_out.nominal, 2.649 * std::hypot(7e-4, 3e-5), 1e-6);

  // The means of three repeats were left out: a single point has two thirds of its variance besides.
  found.noise.independent = Vector3d(1e-5, 2e-5, 3e-5);
  found.noise.common = Vector3d(2e-5, 0.0, 0.0);
  found.noise.misfit = 1e-3;  // of the configuration, in every repeat
  left_out = new_point_errors(found, measurements);
  const double of_one = 18e-10 * 2.0 / 3.0;
  EXPECT_NEAR(left_out.compensated, 2.649 * std::sqrt(25e-10 + of_one), 1e-7);
  EXPECT_NEAR(left_out.urdf_alone, left_out.compensated, 1e-12);
  EXPECT_NEAR(left_out.of_one, std::sqrt(of_one), 1e-12);
  Measurements once = measurements;
  std::erase_if(once.observations, [](const Observation& o) { return o.repeat > 0; });
  EXPECT_NEAR(new_point_errors(found, once).compensated, 2.649 * 5e-5, 1e-7);
  found.noise = {};

  found.accuracy.nested_leave_one_out = ErrorStatistics{.count = 5, .rms = 4e-4};
  EXPECT_NEAR(new_point_errors(found, measurements).compensated, 2.649 * std::hypot(4e-4, 3e-5), 1e-6);
}

// Monte Carlo: the same configurations are measured once more. Fitted rows follow their noise, new ones do not.
TEST(NewPoint, OfFittedRowsIsAsFarOffAsANewMeasurementOfThem) {
  double measured = 0.0;
  double stated = 0.0;
  double fitted = 0.0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    testing::VirtualExperiment experiment({.random = Random(seed)});
    const Eigen::MatrixXd q = experiment.configurations(8);
    const Measurements rows = testing::without_sigmas(experiment.measure(q, {.sigma = 5e-5}));
    const Measurements again = testing::without_sigmas(experiment.measure(q, {.sigma = 5e-5}));
    const Calibration found = calibrate(testing::bundled_robot(), rows, testing::geometry_alone());
    const CalibrationParts& parts = found.parts();
    const NewPointErrors errors = new_point_errors(*parts.fitted, rows);
    ASSERT_EQ(errors.rows, NewPointErrors::Rows::fitted);
    measured += std::pow(error_statistics(position_errors(parts.model, parts.estimate, again)).rms, 2);
    stated += std::pow(errors.compensated / errors.coverage_factor, 2);
    fitted += std::pow(parts.fitted->accuracy.train.after.rms, 2);
  }
  EXPECT_NEAR(std::sqrt(stated / measured), 1.0, 0.06);  // 3 sigma of 40 robots
  EXPECT_LT(std::sqrt(fitted / measured), 0.75);
}

}  // namespace
}  // namespace kdl_calibration::new_point_test
