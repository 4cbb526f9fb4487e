// The distances between targets, which a rigid tool keeps.

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "base/random.hpp"
#include "model/kinematics.hpp"
#include "screening/data_quality.hpp"
#include "screening/messages.hpp"

namespace kdl_calibration::distance_check_test {
namespace {

using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::messages;

/// A tool with these points in places and orientations at random, and what is needed to move one of the points in its
/// own frame.
struct Tool {
  std::vector<Vector3d> points;
  std::vector<Eigen::Matrix3d> turns;  // by configuration
  Measurements measured;

  Tool(std::vector<Vector3d> at, int configurations, int repeats, double noise, Random random) : points(std::move(at)) {
    for (std::size_t k = 0; k < points.size(); ++k) {
      measured.targets.emplace_back(1, static_cast<char>('A' + k));
    }
    measured.joint_values = Eigen::MatrixXd::Zero(1, configurations);
    for (int c = 0; c < configurations; ++c) {
      measured.configurations.push_back(std::to_string(c + 1));
      turns.push_back(rotation_exp({random.normal(), random.normal(), random.normal()}));
      const Vector3d place{random.normal(), random.normal(), random.normal()};
      for (int repeat = 1; repeat <= repeats; ++repeat) {
        for (std::size_t k = 0; k < points.size(); ++k) {
          const Vector3d error = noise * Vector3d{random.normal(), random.normal(), random.normal()};
          measured.observations.push_back({.reading = Point{place + turns.back() * points[k] + error},
                                           .configuration = c,
                                           .target = static_cast<int>(k),
                                           .repeat = repeat});
        }
      }
    }
  }

  void move(int configuration, int target, const Vector3d& step) {
    for (Observation& o : measured.observations) {
      if (o.configuration == configuration && o.target == target) {
        o.position() += turns[static_cast<std::size_t>(configuration)] * step;
      }
    }
  }
  void slip(int from, int target, const Vector3d& step) {
    for (int c = from; c < measured.joint_values.cols(); ++c) {
      move(c, target, step);
    }
  }
  void swap(int configuration, int a, int b) {
    for (Observation& o : measured.observations) {
      if (o.configuration == configuration && (o.target == a || o.target == b)) {
        o.target = o.target == a ? b : a;
      }
    }
  }
};

const std::vector<Vector3d> kTriangle = {{0.0, 0.0, 0.0}, {0.1, 0.0, 0.0}, {0.02, 0.13, 0.0}};
const std::vector<Vector3d> kSix = {{0.0, 0.0, 0.0},   {0.1, 0.0, 0.0},  {0.02, 0.13, 0.0},
                                    {0.0, 0.05, 0.17}, {0.1, 0.1, 0.08}, {-0.07, 0.02, 0.1}};

// ---- whose blame it is ---------------------------------------------------------------------------------------------

// With a false alarm in a million sets allowed, two hundred clean sets have none.
TEST(DistanceCheck, FindsNothingInCleanSetsAndADisplacementOfTwoMillimetres) {
  int found = 0;
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    Tool tool(seed % 2 == 0 ? kTriangle : kSix, 12, seed % 3 == 0 ? 2 : 1, 2e-5, Random(seed));
    ASSERT_THAT(messages(check_distances(tool.measured)), IsEmpty()) << seed;
    tool.move(3, 1, {0.0016, -0.0012, 0.0});
    found += check_distances(tool.measured).size() == 1 ? 1 : 0;
  }
  EXPECT_GE(found, 195) << "of 200";
}

TEST(DistanceCheck, BlamesTheTargetOfWhichMostDistancesChanged) {
  Tool tool(kSix, 12, 1, 1e-5, Random(1));
  const Vector3d step(0.0011, -0.0007, 0.0016);
  tool.move(4, 2, step);
  double amount = 0.0;
  for (std::size_t k = 0; k < kSix.size(); ++k) {
    if (k != 2) {
      amount = std::max(amount, std::abs((kSix[2] + step - kSix[k]).norm() - (kSix[2] - kSix[k]).norm()));
    }
  }
  const std::vector<QualityFinding> found = check_distances(tool.measured);
  ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
  EXPECT_EQ(found[0].kind, QualityKind::displaced_point);
  EXPECT_EQ(found[0].configuration, "5");
  EXPECT_EQ(found[0].repeat, 1);
  EXPECT_THAT(found[0].targets, ElementsAre("C"));
  EXPECT_NEAR(found[0].amount, amount, 5e-5);
  EXPECT_EQ(found[0].offset, Vector3d::Zero());
  EXPECT_THAT(found[0].message, HasSubstr("is off by at least 2.0 mm"));
}

TEST(DistanceCheck, BlamesOneTargetAfterTheOther) {
  for (const double second : {0.001, -0.004}) {
    Tool tool(kSix, 40, 1, 1e-5, Random(2));
    tool.move(4, 5, {0.0, 0.002, 0.0});
    tool.move(4, 1, {0.0, second, 0.0});
    const std::vector<QualityFinding> found = check_distances(tool.measured);
    ASSERT_EQ(found.size(), 2U) << ::testing::PrintToString(messages(found));
    EXPECT_THAT(found[0].targets, ElementsAre("B"));
    EXPECT_THAT(found[1].targets, ElementsAre("F"));
  }
}

// B moves away from A, across the lines to all others.
TEST(DistanceCheck, BlamesBothTargetsOfADistanceThatAloneChanged) {
  Tool tool({{0.0, 0.0, 0.0}, {0.1, 0.0, 0.0}, {0.1, 0.1, 0.0}, {0.1, 0.0, 0.12}}, 12, 2, 1e-5, Random(3));
  tool.move(6, 1, {-0.001, 0.0, 0.0});
  const std::vector<QualityFinding> found = check_distances(tool.measured);
  EXPECT_THAT(messages(found),
              ElementsAre("target A or B in configuration 7 is off by at least 1.0 mm in every repeat"));
  ASSERT_FALSE(found.empty());
  EXPECT_NEAR(found[0].amount, 0.001, 3e-5);
}

TEST(DistanceCheck, BlamesATargetForASlipByTheLargestChangeOfItsDistances) {
  Tool tool(kTriangle, 24, 1, 1e-5, Random(4));
  const Vector3d step(0.0008, 0.0, 0.0);
  tool.slip(10, 1, step);
  const std::vector<QualityFinding> found = check_distances(tool.measured);
  EXPECT_THAT(messages(found), ElementsAre("target B slipped by at least 0.81 mm after configuration 10"));
  ASSERT_FALSE(found.empty());
  EXPECT_NEAR(found[0].amount, 0.0008, 1e-5);
  EXPECT_EQ(found[0].offset, Vector3d::Zero());
}

// ---- swaps ---------------------------------------------------------------------------------------------------------

TEST(DistanceCheck, ASwapIsAsFarAsItsTargetsAreApart) {
  Tool tool(kSix, 12, 1, 1e-5, Random(7));
  tool.swap(8, 1, 4);
  const std::vector<QualityFinding> found = check_distances(tool.measured);
  EXPECT_THAT(messages(found), ElementsAre("targets B and E are swapped in configuration 9"));
  ASSERT_FALSE(found.empty());
  EXPECT_NEAR(found[0].amount, (kSix[1] - kSix[4]).norm(), 5e-5);
}

}  // namespace
}  // namespace kdl_calibration::distance_check_test
