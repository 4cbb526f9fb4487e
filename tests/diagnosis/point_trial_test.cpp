#include "diagnosis/point_trial.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <functional>
#include <numbers>

#include "base/random.hpp"
#include "model/kinematics.hpp"
#include "support.hpp"

namespace kdl_calibration::point_trial_test {
namespace {

using Eigen::Vector3d;

Vector3d drawn(Random& random) { return {random.normal(), random.normal(), random.normal()}; }

/// Flange poses at random and the targets that a tracker saw in them.
struct Poses {
  std::vector<Eigen::Isometry3d> X_BF;
  std::vector<Vector3d> targets;
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
  Measurements measured;

  Poses(int configurations, int target_count, double noise, std::uint64_t seed) {
    Random random(seed);
    X_WB.linear() = rotation_exp(drawn(random));
    X_WB.translation() = 3.0 * drawn(random);
    for (int k = 0; k < target_count; ++k) {
      targets.emplace_back(0.2 * drawn(random));
      measured.targets.emplace_back(1, static_cast<char>('A' + k));
    }
    measured.joint_values = Eigen::MatrixXd::Zero(1, configurations);
    for (int c = 0; c < configurations; ++c) {
      Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
      pose.linear() = rotation_exp(drawn(random));
      pose.translation() = drawn(random);
      X_BF.push_back(pose);
      measured.configurations.push_back(std::to_string(c + 1));
      for (int k = 0; k < target_count; ++k) {
        measured.observations.push_back(
            {.reading = Point{X_WB * (pose * targets[static_cast<std::size_t>(k)]) + noise * drawn(random)},
             .configuration = c,
             .target = k});
      }
    }
  }
};

// ---- rounding
// ----------------------------------------------------------------------------------------------------------

TEST(PointTrial, RoundingIsTheLargestStepOfWhichAllCoordinatesAreMultiples) {
  Poses poses(10, 3, 0.0, 1);
  EXPECT_EQ(rounding_of(poses.measured), 0.0);
  for (const double step : {1e-6, 1e-5, 1e-4}) {
    Measurements rounded = poses.measured;
    for (Observation& o : rounded.observations) {
      o.position() = (o.position() / step).array().round() * step;
    }
    EXPECT_EQ(rounding_of(rounded), step);
    rounded.observations[7].position().z() += 0.013 * step;
    EXPECT_EQ(rounding_of(rounded), 0.0);
  }
}

// ---- scales --------------------------------------------------------------------------------------------------------

TEST(PointTrial, ScalesOfCoordinatesAreFoundExactlyWithoutNoiseAndNearlyWithIt) {
  for (const Vector3d& factors : {Vector3d(1.0, 1.0, 1.0), Vector3d(1000.0, 1.0, 0.02), Vector3d(0.3, 40.0, 7.0)}) {
    for (const int targets : {1, 3}) {
      for (const double noise : {0.0, 0.01}) {
        Poses poses(12, targets, noise, 3);
        for (Observation& o : poses.measured.observations) {
          o.position() = o.position().cwiseProduct(factors);
        }
        poses.measured.targets.emplace_back("not measured");
        const std::optional<Vector3d> found = coordinate_scales(poses.X_BF, poses.measured);
        ASSERT_TRUE(found);
        EXPECT_LT((found->cwiseQuotient(factors) - Vector3d::Ones()).norm(), noise > 0.0 ? 0.03 : 1e-7);
      }
    }
  }
}

TEST(PointTrial, ThereAreNoScalesWhereACoordinateNeverChanges) {
  Poses poses(12, 2, 0.0, 4);
  for (Observation& o : poses.measured.observations) {
    o.position().y() = 0.5;
  }
  EXPECT_FALSE(coordinate_scales(poses.X_BF, poses.measured));
  poses.measured.observations.clear();
  EXPECT_FALSE(coordinate_scales(poses.X_BF, poses.measured));
}

TEST(PointTrial, RelativeMotionIsOneAtTheFlangeAndGrowsWithTheScale) {
  Poses poses(9, 1, 0.0, 5);
  for (const double factor : {1.0, 0.3, 1000.0}) {
    for (Observation& o : poses.measured.observations) {
      o.position() = factor * (poses.X_WB * poses.X_BF[static_cast<std::size_t>(o.configuration)]).translation();
    }
    EXPECT_NEAR(motion(poses.X_BF, poses.measured).share() / factor, 1.0, 1e-12);
  }
  const Poses one(1, 3, 0.01, 6);
  EXPECT_EQ(motion(one.X_BF, one.measured).share(), 1.0);
}

// ---- exchanged targets ---------------------------------------------------------------------------------------------

void exchange(Measurements& measured, int first, int second, const std::function<bool(int)>& where) {
  for (Observation& o : measured.observations) {
    if (where(o.configuration) && (o.target == first || o.target == second)) {
      o.target = o.target == first ? second : first;
    }
  }
}

TEST(PointTrial, ExchangedTargetsAreFoundFromTheThirdConfigurationToTheThirdLast) {
  for (const int configurations : {12, 19}) {
    for (int from = 0; from <= configurations; ++from) {
      const Poses poses(configurations, 3, 1e-4, 7);
      const int first = from % 2;
      Measurements wrong = poses.measured;
      exchange(wrong, first, 2, [&](int c) { return c >= from; });
      const std::optional<Exchange> found = exchanged_targets(poses.X_BF, wrong, {});
      ASSERT_EQ(found.has_value(), from >= 3 && from <= configurations - 3) << from << " of " << configurations;
      if (found) {
        EXPECT_EQ(found->from, from) << "of " << configurations;
        EXPECT_EQ(found->first, first) << from;
        EXPECT_EQ(found->second, 2) << from;
        for (std::size_t i = 0; i < wrong.observations.size(); ++i) {
          EXPECT_EQ(found->repaired.observations[i].target, poses.measured.observations[i].target) << i;
        }
      }
    }
  }
}

TEST(PointTrial, ExchangedTargetsAreSoInNineOfTenConfigurations) {
  for (int otherwise = 0; otherwise <= 4; ++otherwise) {
    const Poses poses(20, 3, 1e-4, 9);
    Measurements wrong = poses.measured;
    // From the eighth on, but for a few in between.
    exchange(wrong, 0, 1, [&](int c) { return c >= 8 && (c % 2 == 0 || c < 10 || c >= 10 + 2 * otherwise); });
    const std::optional<Exchange> found = exchanged_targets(poses.X_BF, wrong, {});
    ASSERT_EQ(found.has_value(), otherwise <= 2) << otherwise;
    EXPECT_EQ(found ? found->from : 8, 8);
  }
}

TEST(PointTrial, ExchangedTargetsAreSeenFromTheFramesThatAreKnown) {
  Poses poses(20, 3, 1e-4, 10);
  for (Observation& o : poses.measured.observations) {
    o.order = 0;
    if (o.target == 2) {
      testing::set_orientation(o, Orientation::Identity());
    }
  }
  exchange(poses.measured, 0, 1, [](int c) { return c >= 9; });
  EXPECT_TRUE(exchanged_targets(poses.X_BF, poses.measured, {}));
  const Eigen::Isometry3d elsewhere = poses.X_WB * Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX());
  EXPECT_FALSE(
      exchanged_targets(poses.X_BF, poses.measured,
                        {.known = {.bases = {{.X_WB = elsewhere}}, .targets = testing::targets_at(poses.targets)}}));
}

}  // namespace
}  // namespace kdl_calibration::point_trial_test
