#include "noise/noise_components.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "estimation/identification.hpp"
#include "model/kinematics.hpp"
#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"
#include "whitened_systems.hpp"

namespace kdl_calibration::noise_components_test {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using testing::summarised;
using testing::VirtualExperiment;

/// Of a few configurations, without some targets and repeats. What points of a repeat share differs by axis.
Measurements irregular(unsigned seed, const Vector3d& common, double orientation = 0.0) {
  Random random(17, seed);
  Measurements measured;
  const int configurations = 6;
  measured.joints = {"one"};
  measured.targets = {"A", "B", "C"};
  measured.joint_values = Eigen::RowVectorXd::LinSpaced(configurations, -1.0, 1.0);
  const auto normal = [&] { return Vector3d{random.normal(), random.normal(), random.normal()}; };
  for (int c = 0; c < configurations; ++c) {
    measured.configurations.push_back(std::to_string(c));
    std::map<int, Vector3d> shared;
    for (int t = 0; t < 3; ++t) {
      const Vector3d place = normal();
      const Matrix3d turn = rotation_exp(normal());
      for (int r = 1; r <= (c == 5 ? 1 : 4); ++r) {
        if (random.uniform(0.0, 1.0) < 0.2) {
          continue;
        }
        const Vector3d together = shared.try_emplace(r, common.cwiseProduct(normal())).first->second;
        measured.observations.push_back(
            {.reading = Point{place + together + 1e-2 * normal()}, .configuration = c, .target = t, .repeat = r});
        if (orientation > 0.0) {
          const bool alone = random.uniform(0.0, 1.0) < 0.2;
          if (!alone) {
            testing::set_orientation(measured.observations.back(),
                                     Eigen::Quaterniond(Matrix3d(turn * rotation_exp(orientation * normal()))));
          }
        }
      }
    }
  }
  return measured;
}

TEST(NoiseComponents, OfRepeatsAreBothComponentsOfTheNoise) {
  VirtualExperiment experiment = VirtualExperiment({.ranges = published_ranges, .random = Random(6)});
  const Eigen::Vector3d common(0.00006, 0.00005, 0.00003);
  const Measurements measured = experiment.measure(40, {.sigma = 0.00001, .repeats = 20, .common = common});
  const RepeatNoise noise = noise_from_repeats(measured);
  EXPECT_TRUE(noise.separable);
  EXPECT_EQ(noise.degrees_of_freedom, 40 * 3 * 19);
  for (int axis = 0; axis < 3; ++axis) {
    EXPECT_NEAR(noise.common[axis], common[axis], 0.1 * common[axis]);
    EXPECT_NEAR(noise.independent[axis], 0.00001, 0.000001);
  }
  const Measurements single = subset(measured, [](const Observation& o) { return o.repeat == 1; });
  EXPECT_EQ(noise_from_repeats(single).degrees_of_freedom, 0.0);
}

// Where rows are missing at random the estimates are unbiased as well.
TEST(NoiseComponents, OfIrregularRepeatsAreTheTrueOnesOnAverage) {
  constexpr int kRuns = 400;
  const Vector3d common(0.02, 0.0, 0.03);
  Vector3d total = Vector3d::Zero();
  double orientation = 0.0;
  for (unsigned seed = 0; seed < kRuns; ++seed) {
    const RepeatNoise found = noise_from_repeats(irregular(seed, common, 1e-4));
    EXPECT_TRUE(found.separable) << seed;
    total += found.total.cwiseAbs2() / kRuns;
    orientation += found.orientation * found.orientation / kRuns;
    EXPECT_LT((found.common.cwiseAbs2() + found.independent.cwiseAbs2() - found.total.cwiseAbs2()).norm(),
              1e-12 * found.total.squaredNorm());
  }
  const Vector3d expected = common.cwiseAbs2() + Vector3d::Constant(1e-4);
  EXPECT_LT((total - expected).cwiseQuotient(expected).cwiseAbs().maxCoeff(), 0.06) << total.transpose();
  EXPECT_NEAR(orientation, 1e-8, 0.05 * 1e-8);
}

TEST(NoiseComponents, OfOneTargetAreAllItsOwn) {
  const Measurements measured = subset(irregular(1, Vector3d(0.1, 0.1, 0.1)),
                                       [](const Observation& o) { return o.target == o.configuration % 3; });
  const RepeatNoise found = noise_from_repeats(measured);
  EXPECT_FALSE(found.separable);
  EXPECT_TRUE(found.common.isZero(0.0));
  EXPECT_EQ(found.independent, found.total);
  EXPECT_GT(found.total.minCoeff(), 0.05);
}

TEST(NoiseComponents, OfTargetsThatShareOneRepeatAreAllTheirOwn) {
  Measurements one_shared = irregular(1, Vector3d(0.1, 0.1, 0.1));
  one_shared.observations.clear();
  for (const auto& [target, repeat] : std::vector<std::pair<int, int>>{{0, 1}, {0, 2}, {1, 2}, {1, 3}}) {
    one_shared.observations.push_back({.reading = Point{Vector3d(target + repeat * repeat, repeat, -repeat)},
                                       .configuration = 0,
                                       .target = target,
                                       .repeat = repeat});
  }
  const RepeatNoise found = noise_from_repeats(one_shared);
  EXPECT_EQ(found.degrees_of_freedom, 2.0);
  EXPECT_FALSE(found.separable);
  EXPECT_EQ(found.independent, found.total);
}

TEST(NoiseComponents, WithoutRepeatsAreNone) {
  const auto none = [](const RepeatNoise& found) {
    return found.degrees_of_freedom == 0.0 && found.total.isZero(0.0) && found.independent.isZero(0.0) &&
           found.common.isZero(0.0) && !found.separable;
  };
  Measurements measured = irregular(2, Vector3d::Constant(0.1));
  EXPECT_TRUE(none(noise_from_repeats(subset(measured, [](const Observation& o) { return o.repeat == 2; }))));
  EXPECT_TRUE(none(noise_from_repeats(subset(measured, [](const Observation& o) { return o.repeat == o.target + 1; }))))
      << "repeats of other targets";
  for (Observation& o : measured.observations) {
    o.split = o.repeat == 1 ? Split::train : Split::test;
  }
  EXPECT_TRUE(none(noise_from_repeats(measured))) << "repeats of the other split";
}

TEST(NoiseComponents, OfOrientationsNeedTwoOfOneTarget) {
  Measurements measured = irregular(4, Vector3d::Constant(0.1), 1e-4);
  std::set<std::pair<int, int>> seen;
  for (Observation& o : measured.observations) {
    if (!seen.insert({o.configuration, o.target}).second) {
      testing::remove_orientation(o);
    }
  }
  const RepeatNoise found = noise_from_repeats(measured);
  EXPECT_GT(found.degrees_of_freedom, 0.0);
  EXPECT_EQ(found.orientation_degrees_of_freedom, 0.0);
  EXPECT_EQ(found.orientation, 0.0);
}

// 3 configurations of two points, whitened by 1 / sigma^2 = 4.
ResidualNoise of_residuals(double shared, double own, int rank) {
  Eigen::VectorXd e(18);
  for (Index i = 0; i < 18; ++i) {
    e[i] =
        (i % 2 == 0 ? 1.0 : -1.0) * shared * std::floor(1.0 + static_cast<double>(i) / 6.0) + (i % 6 < 3 ? own : -own);
  }
  for (Index i = 0; i < 18; ++i) {  // what is shared is the same of both points
    e[i] = i % 6 < 3 ? e[i] : e[i - 3] - 2.0 * own;
  }
  return noise_from_residuals(
      summarised({.jacobian = Eigen::MatrixXd::Zero(18, 1), .residual = e, .blocks = {0, 6, 12, 18}}), rank, 4.0);
}

TEST(NoiseComponents, OfResidualsAreWhatPointsOfAConfigurationShare) {
  // Squares of what is shared are 1, 4 and 9 times, three coordinates each: a mean of 14/3; mean products of the two
  // points are that less the square of their own.
  for (const int rank : {0, 6}) {
    const double lost = 18.0 / (18.0 - rank) / 4.0;
    const ResidualNoise both = of_residuals(0.3, 0.2, rank);
    EXPECT_EQ(both.degrees_of_freedom, 18.0 - rank);
    const double shared = 14.0 / 3.0 * 0.09;
    EXPECT_NEAR(both.common, std::sqrt((shared - 0.04) * lost), 1e-12) << rank;
    EXPECT_NEAR(both.independent, std::sqrt(2.0 * 0.04 * lost), 1e-12) << rank;
    EXPECT_NEAR(both.total(), std::sqrt((shared + 0.04) * lost), 1e-12) << rank;
    const ResidualNoise opposite = of_residuals(0.0, 0.2, rank);
    EXPECT_EQ(opposite.common, 0.0) << rank;
    EXPECT_NEAR(opposite.independent, std::sqrt(0.04 * lost), 1e-12) << rank;
    const ResidualNoise together = of_residuals(0.3, 0.0, rank);
    EXPECT_NEAR(together.common, std::sqrt(shared * lost), 1e-12) << rank;
    EXPECT_NEAR(together.independent, 0.0, 1e-7) << rank;
  }
  const ResidualNoise none = of_residuals(0.3, 0.2, 18);
  EXPECT_EQ(none.degrees_of_freedom, 0.0);
  EXPECT_EQ(none.total(), 0.0);
  EXPECT_EQ(of_residuals(0.3, 0.2, 20).degrees_of_freedom, -2.0);
  EXPECT_GT(of_residuals(0.3, 0.2, 17).total(), 0.0);
}

TEST(NoiseComponents, OfResidualsOfSinglePointsAreTheirOwn) {
  const WhitenedSystem system{
      .jacobian = Eigen::MatrixXd::Zero(6, 1), .residual = Eigen::VectorXd::Constant(6, 0.5), .blocks = {0, 3, 6}};
  const ResidualNoise found = noise_from_residuals(summarised(system), 2, 1.0);
  EXPECT_EQ(found.common, 0.0);
  EXPECT_NEAR(found.independent, 0.5 * std::sqrt(1.5), 1e-12);
}

}  // namespace
}  // namespace kdl_calibration::noise_components_test
