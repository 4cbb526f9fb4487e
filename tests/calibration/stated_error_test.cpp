// The error that leave-one-out states for new poses, beside the error at new poses. The joints of these arms follow
// functions that the model can only approximate, and some poses are repeated or have close neighbours.

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <vector>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "measurements/same_poses.hpp"
#include "mistake_table.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration::testing::stated_error_test {
namespace {

using Eigen::MatrixXd;

constexpr double kPointNoise = 2e-5;   // [m]
constexpr double kCommonNoise = 4e-5;  // [m], shared by the points of a configuration

/// q + a sin(q + p) + a/2 sin(2 (q + p)) + r sin(n q + p) for each joint.
struct JointError {
  double a;  // [rad]
  double p;
  double r;  // [rad] of a ripple, in every third arm
  double n;
  double operator()(double q) const {
    return q + a * std::sin(q + p) + 0.5 * a * std::sin(2.0 * (q + p)) + r * std::sin(n * q + p);
  }
};

struct Arm {
  ErrorModel model;
  Estimate truth;
  JointRanges ranges;
  std::vector<JointError> joints;
  Random random;

  explicit Arm(std::uint64_t seed) : model(seed % 2 == 1 ? large_arm() : light_arm()), random(seed, 9) {
    truth = measured(model, seed, {.configurations = 1}).truth;
    truth.effects.resize(0);
    for (const auto& [lower, upper] : limits_of(model.joints)) {
      ranges.emplace_back(std::max(lower, -2.5), std::min(upper, 2.5));
      JointError& joint = joints.emplace_back();
      joint.a = random.uniform(0.0, 4e-4);
      joint.p = random.uniform(0.0, 6.0);
      joint.r = seed % 3 == 0 ? random.uniform(0.0, 2e-4) : 0.0;
      joint.n = std::round(random.uniform(8.0, 40.0));
    }
  }

  MatrixXd poses(int count) { return random_configurations(model.joints, ranges, count, random); }

  Measurements measure(const MatrixXd& q) {
    MatrixXd moved = q;
    for (Eigen::Index j = 0; j < q.rows(); ++j) {
      moved.row(j) = q.row(j).unaryExpr([&](double value) { return joints[static_cast<std::size_t>(j)](value); });
    }
    const MeasuringNoise noise{.sigma = kPointNoise, .common = Eigen::Vector3d::Constant(kCommonNoise)};
    Measurements result =
        without_sigmas(kdl_calibration::measure({.model = model, .truth = truth}, moved, noise, random));
    result.joint_values = q;
    return result;
  }
};

/// 36 poses: each on its own, or pairs that differ by `spread` [rad] in every joint.
MatrixXd poses_of(Arm& arm, double spread) {
  if (spread == 0.0) {
    return arm.poses(36);
  }
  const MatrixXd q = arm.poses(18);
  MatrixXd twice(q.rows(), 2 * q.cols());
  twice << q, q + spread * MatrixXd::NullaryExpr(q.rows(), q.cols(), [&] { return arm.random.normal(); });
  return twice;
}

/// RMS that leave-one-out states over the RMS at 200 new measured poses.
double stated_over_true(std::uint64_t seed, double spread) {
  Arm arm(seed);
  CalibrationSettings options;
  options.selection.automatic_priors = true;
  options.selection.effects.automatic = true;
  const CalibrationResult found = calibrate(arm.model, with_poses_joined(arm.measure(poses_of(arm, spread))), options);
  const Measurements fresh = arm.measure(arm.poses(200));
  const ErrorStatistics at_new =
      error_statistics(position_errors(flange_poses(found.model, found.fit.identification.estimate, fresh),
                                       found.fit.identification.estimate, fresh, Rows::all));
  return found.accuracy.held_out()->after.rms / at_new.rms;
}

void expect_stated_errors_hold(std::uint64_t arms) {
  for (const auto& [name, spread] :
       {std::pair{"single poses", 0.0}, std::pair{"read back twice", 1e-6}, std::pair{"half a degree apart", 0.009}}) {
    double logs = 0.0;
    int low = 0;
    for (std::uint64_t seed = 1; seed <= arms; ++seed) {
      const double ratio = stated_over_true(seed, spread);
      logs += std::log(ratio);
      low += ratio < 0.7 ? 1 : 0;
    }
    const auto count = static_cast<double>(arms);
    const double mean = std::exp(logs / count);
    std::printf("%-20s stated over true %.3f on average, below 0.7 in %d of %d\n", name, mean, low,
                static_cast<int>(arms));
    EXPECT_GT(mean, 0.9) << name;
    EXPECT_LT(mean, 1.15) << name;
    // 2 % of 36 poses, 5 % of eighteen places, and two standard deviations of the binomial distribution.
    const double expected = (spread == 0.0 ? 0.02 : 0.05) * count;
    EXPECT_LE(low, expected + 2.0 * std::sqrt(expected)) << name;
  }
}

TEST(StatedErrorLongRun, HoldsAtNewPoses) { expect_stated_errors_hold(30); }
TEST(StatedErrorCampaign, HoldsAtNewPosesOfHundredArmsInEachWay) { expect_stated_errors_hold(100); }

}  // namespace
}  // namespace kdl_calibration::testing::stated_error_test
