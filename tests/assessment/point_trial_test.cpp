#include "assessment/point_trial.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>

#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/random.hpp"
#include "support.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

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
    measured.joint_values = MatrixXd::Zero(1, configurations);
    for (int c = 0; c < configurations; ++c) {
      Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
      pose.linear() = rotation_exp(drawn(random));
      pose.translation() = drawn(random);
      X_BF.push_back(pose);
      measured.configurations.push_back(std::to_string(c + 1));
      for (int k = 0; k < target_count; ++k) {
        measured.observations.push_back(
            {.position = X_WB * (pose * targets[static_cast<std::size_t>(k)]) + noise * drawn(random),
             .configuration = c,
             .target = k});
      }
    }
  }
};

// ---- other points --------------------------------------------------------------------------------------------------

TEST(PointTrial, MirroredPointsHaveTheOtherSignOfXAlone) {
  Poses poses(3, 2, 0.0, 1);
  poses.measured.orientations.assign(6, Eigen::Quaterniond::Identity());
  const Measurements other = mirrored(poses.measured);
  EXPECT_TRUE(other.orientations.empty());
  for (std::size_t i = 0; i < 6; ++i) {
    const Vector3d& was = poses.measured.observations[i].position;
    EXPECT_EQ(other.observations[i].position, Vector3d(-was.x(), was.y(), was.z()));
  }
}

TEST(PointTrial, PointsAreDividedCoordinateByCoordinate) {
  const Poses poses(3, 2, 0.0, 2);
  const Measurements other = divided(poses.measured, {2.0, 4.0, 8.0});
  for (std::size_t i = 0; i < 6; ++i) {
    const Vector3d& was = poses.measured.observations[i].position;
    EXPECT_EQ(other.observations[i].position, Vector3d(was.x() / 2.0, was.y() / 4.0, was.z() / 8.0));
  }
}

// ---- scales --------------------------------------------------------------------------------------------------------

/// Every equation A z - c - X_BF t = 0 by itself, solved by its QR factorisation.
Vector3d dense_scales(const Poses& poses) {
  const auto rows = static_cast<Index>(3 * poses.measured.observations.size());
  MatrixXd M = MatrixXd::Zero(rows, static_cast<Index>(12 + 3 * poses.targets.size()));
  VectorXd right(rows);
  Index row = 0;
  for (const Observation& o : poses.measured.observations) {
    const Eigen::Isometry3d& pose = poses.X_BF[static_cast<std::size_t>(o.configuration)];
    for (Index i = 0; i < 3; ++i, ++row) {
      for (Index axis = 0; axis < 3; ++axis) {
        M(row, 3 * axis + i) = o.position[axis];
        M(row, 12 + 3 * o.target + axis) = -pose.linear()(i, axis);
      }
      M(row, 9 + i) = -1.0;
      right[row] = pose.translation()[i];
    }
  }
  const VectorXd scale = M.colwise().norm().cwiseInverse();
  const VectorXd x = scale.asDiagonal() * (M * scale.asDiagonal()).colPivHouseholderQr().solve(right);
  return {1.0 / x.segment<3>(0).norm(), 1.0 / x.segment<3>(3).norm(), 1.0 / x.segment<3>(6).norm()};
}

TEST(PointTrial, ScalesOfCoordinatesAreThoseOfLeastSquaresWrittenOut) {
  for (const Vector3d& factors : {Vector3d(1.0, 1.0, 1.0), Vector3d(1000.0, 1.0, 0.02), Vector3d(0.3, 40.0, 7.0)}) {
    for (const int targets : {1, 3}) {
      Poses poses(12, targets, 0.01, 3);
      for (Observation& o : poses.measured.observations) {
        o.position = o.position.cwiseProduct(factors);
      }
      const std::optional<Vector3d> found = coordinate_scales(poses.X_BF, poses.measured);
      ASSERT_TRUE(found);
      const Vector3d expected = dense_scales(poses);
      EXPECT_LT((found->cwiseQuotient(expected) - Vector3d::Ones()).norm(), 1e-7) << found->transpose();
      EXPECT_LT((found->cwiseQuotient(factors) - Vector3d::Ones()).norm(), 0.03) << found->transpose();
      poses.measured.targets.emplace_back("not measured");
      const std::optional<Vector3d> with_another = coordinate_scales(poses.X_BF, poses.measured);
      ASSERT_TRUE(with_another);
      EXPECT_LT((with_another->cwiseQuotient(*found) - Vector3d::Ones()).norm(), 1e-7);
    }
  }
}

TEST(PointTrial, ThereAreNoScalesWhereACoordinateNeverChanges) {
  Poses poses(12, 2, 0.0, 4);
  for (Observation& o : poses.measured.observations) {
    o.position.y() = 0.5;
  }
  EXPECT_FALSE(coordinate_scales(poses.X_BF, poses.measured));
  poses.measured.observations.clear();
  EXPECT_FALSE(coordinate_scales(poses.X_BF, poses.measured));
}

TEST(PointTrial, AFactorBetweenUnitsIsOneWithinThreePerCent) {
  const std::vector<std::pair<double, std::string>> expected = {
      {1e3, "millimetres read as metres"},           {1e2, "centimetres read as metres"},
      {39.37007874, "inches read as metres"},        {3.280839895, "feet read as metres"},
      {1e-3, "metres read as millimetres"},          {1e-1, "centimetres read as millimetres"},
      {0.03937007874, "inches read as millimetres"}, {0.003280839895, "feet read as millimetres"}};
  for (const auto& [factor, words] : expected) {
    EXPECT_EQ(units_of_factor(factor), words);
    EXPECT_EQ(units_of_factor(1.029 * factor), words);
    EXPECT_EQ(units_of_factor(0.971 * factor), words);
    EXPECT_EQ(units_of_factor(1.031 * factor), "") << words;
    EXPECT_EQ(units_of_factor(0.969 * factor), "") << words;
  }
  EXPECT_EQ(units_of_factor(1.0), "");
}

TEST(PointTrial, RelativeMotionIsTheSpreadOfThePointsOverThatOfTheFlange) {
  Poses poses(9, 3, 0.01, 5);
  poses.measured.observations.erase(poses.measured.observations.begin() + 4, poses.measured.observations.begin() + 11);
  double points = 0.0;
  double flanges = 0.0;
  for (int k = 0; k < 3; ++k) {
    MatrixXd p(3, 0);
    MatrixXd f(3, 0);
    for (const Observation& o : poses.measured.observations) {
      if (o.target == k) {
        p.conservativeResize(3, p.cols() + 1);
        f.conservativeResize(3, p.cols());
        p.rightCols<1>() = o.position;
        f.rightCols<1>() = poses.X_BF[static_cast<std::size_t>(o.configuration)].translation();
      }
    }
    points += (p.colwise() - p.rowwise().mean()).squaredNorm();
    flanges += (f.colwise() - f.rowwise().mean()).squaredNorm();
  }
  EXPECT_NEAR(relative_motion(poses.X_BF, poses.measured), std::sqrt(points / flanges), 1e-12);
  const Poses one(1, 3, 0.01, 6);
  EXPECT_EQ(relative_motion(one.X_BF, one.measured), 1.0);
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

TEST(PointTrial, ExchangedTargetsNeedTwelveConfigurationsAndTwoTargets) {
  for (const int configurations : {11, 12}) {
    for (const int targets : {1, 2}) {
      const Poses poses(configurations, targets, 1e-4, 8);
      Measurements wrong = poses.measured;
      exchange(wrong, 0, 1, [&](int c) { return targets == 2 && c >= 6; });
      EXPECT_EQ(exchanged_targets(poses.X_BF, wrong, {}).has_value(), configurations == 12 && targets == 2);
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
  poses.measured.order.resize(poses.measured.observations.size());
  poses.measured.orientations.assign(poses.measured.observations.size(), point_alone());
  exchange(poses.measured, 0, 1, [](int c) { return c >= 9; });
  EXPECT_TRUE(exchanged_targets(poses.X_BF, poses.measured, {}));
  const Eigen::Isometry3d elsewhere = poses.X_WB * Eigen::AngleAxisd(std::numbers::pi, Vector3d::UnitX());
  EXPECT_FALSE(exchanged_targets(poses.X_BF, poses.measured,
                                 {.known_base = elsewhere, .known_targets = testing::targets_at(poses.targets)}));
}

}  // namespace
}  // namespace kdl_calibration
