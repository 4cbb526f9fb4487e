// The distances between targets, which a rigid tool keeps.

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "assessment/heavy_tails.hpp"
#include "base/robust_statistics.hpp"
#include "kdl_calibration/data_quality.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/random.hpp"
#include "onset.hpp"
#include "refusal.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::onset;
using testing::refusal;

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
          measured.observations.push_back({.position = place + turns.back() * points[k] + error,
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
        o.position += turns[static_cast<std::size_t>(configuration)] * step;
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

std::vector<std::string> messages(const std::vector<QualityFinding>& findings) {
  std::vector<std::string> result;
  for (const QualityFinding& finding : findings) {
    result.push_back(finding.message);
  }
  return result;
}

// ---- where a finding begins ----------------------------------------------------------------------------------------

/// Of a set in which nothing slipped: how far the worst distance is off, in units of what the rule allows.
double worst_of(const Measurements& measured, const QualityOptions& options) {
  std::vector<double> sigmas;
  for (const Observation& o : measured.observations) {
    sigmas.push_back(o.sigma);
  }
  const double typical = median(sigmas);
  struct Length {
    double value = 0.0;
    double sigma = 1.0;
  };
  std::map<std::pair<int, int>, std::map<int, std::vector<Length>>> pairs;  // by targets and configuration
  for (const Observation& a : measured.observations) {
    for (const Observation& b : measured.observations) {
      if (a.configuration == b.configuration && a.repeat == b.repeat && a.target < b.target) {
        const double variance = typical > 0.0 ? (a.sigma * a.sigma + b.sigma * b.sigma) / (2.0 * typical * typical) : 1;
        pairs[{a.target, b.target}][a.configuration].push_back({(a.position - b.position).norm(), std::sqrt(variance)});
      }
    }
  }
  std::vector<double> deviations;
  for (const auto& [pair, by_configuration] : pairs) {
    std::vector<double> middles;
    for (const auto& [configuration, lengths] : by_configuration) {
      std::vector<double> values;
      std::transform(lengths.begin(), lengths.end(), std::back_inserter(values), [](auto& one) { return one.value; });
      middles.push_back(median(values));
    }
    for (const auto& [configuration, lengths] : by_configuration) {
      for (const Length& length : lengths) {
        deviations.push_back((length.value - median(middles)) / length.sigma);
      }
    }
  }
  const auto count = static_cast<double>(pairs.size());
  const double shape = std::max(3.0 * static_cast<double>(measured.targets.size()) - 6.0, 1.0);
  const Scatter scatter = scatter_of(deviations, count, options.noise_floor);
  double limit = scatter.sigma * threshold(options.false_alarm, static_cast<double>(deviations.size()), 1,
                                           std::min(shape / count, 1.0) * scatter.freedom);
  double worst = 0.0;
  for (double& deviation : deviations) {
    deviation = std::abs(deviation);
    worst = std::max(worst, deviation);
  }
  limit = std::max(limit, limit_of_heavy_tails(deviations));
  return worst / limit;
}

struct Case {
  const char* name;
  Tool tool;
  QualityOptions options = {};
};

std::vector<Case> cases() {
  const std::vector<Vector3d> two = {kTriangle[0], kTriangle[1]};
  std::vector<Case> all = {{"two targets", Tool(two, 12, 1, 2e-5, Random(1))},
                           {"three targets", Tool(kTriangle, 30, 1, 2e-5, Random(2))},
                           {"six targets", Tool(kSix, 40, 1, 2e-5, Random(3)), {.false_alarm = 1e-14}},
                           {"repeats", Tool(kTriangle, 12, 3, 2e-5, Random(4)), {.false_alarm = 1e-3}},
                           {"few", Tool(kTriangle, 4, 1, 2e-5, Random(5))},
                           {"a floor", Tool(kTriangle, 12, 1, 2e-5, Random(6)), {.noise_floor = 1e-3}},
                           {"stated sigmas", Tool(kTriangle, 20, 1, 0.0, Random(7))},
                           {"heavy tails", Tool(kTriangle, 20, 1, 0.0, Random(8))}};
  Random random(9);
  for (Observation& o : all[6].tool.measured.observations) {
    o.sigma = std::exp(random.uniform(-12.0, -9.0));
    o.position += o.sigma * Vector3d{random.normal(), random.normal(), random.normal()};
  }
  for (Observation& o : all[7].tool.measured.observations) {
    const double size = 1e-5 * std::exp(1.2 * random.normal());
    o.position += size * Vector3d{random.normal(), random.normal(), random.normal()};
  }
  return all;
}

TEST(DistanceCheck, AFindingBeginsWhereADistanceIsBeyondTheLimitOfTheRule) {
  for (const Case& one : cases()) {
    const auto displaced = [&](double size) {
      Tool tool = one.tool;
      tool.move(3, 1, size * Vector3d(0.6, -0.8, 0.0));
      return tool.measured;
    };
    const double size = onset(
        0.0, 0.02, [&](double s) { return !check_distances(displaced(s), one.options).empty(); }, 22);
    // The limit itself may fall there: what was a heavy tail is a defect.
    EXPECT_LE(worst_of(displaced(size * (1.0 - 1e-5)), one.options), 1.001) << one.name << ", " << size << " m";
    EXPECT_GE(worst_of(displaced(size * (1.0 + 1e-5)), one.options), 0.999) << one.name << ", " << size << " m";
  }
}

// ---- whose blame it is ---------------------------------------------------------------------------------------------

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

// The distances to A and to C, which stand at right angles as seen from B, change one configuration or two apart.
TEST(DistanceCheck, ChangesOneConfigurationApartAreOneSlipAndTwoApartAreNot) {
  for (const int apart : {1, 2}) {
    for (const bool larger_first : {true, false}) {
      Tool tool({{0.0, 0.0, 0.0}, {0.1, 0.0, 0.0}, {0.1, 0.1, 0.0}}, 24, 1, 5e-6, Random(5));
      tool.slip(12, 1, {larger_first ? 0.001 : 0.0006, 0.0, 0.0});
      tool.slip(12 + apart, 1, {0.0, larger_first ? -0.0006 : -0.001, 0.0});
      const std::vector<QualityFinding> found = check_distances(tool.measured);
      ASSERT_EQ(found.size(), static_cast<std::size_t>(apart)) << ::testing::PrintToString(messages(found));
      EXPECT_EQ(found[0].configuration, std::to_string(12 + (larger_first ? 0 : apart)));
      EXPECT_NEAR(found[0].amount, 0.001, 2e-5);
      if (apart == 1) {
        EXPECT_THAT(found[0].targets, ElementsAre("B"));
        continue;
      }
      const std::vector<std::string> first_two = {"A", "B"};
      const std::vector<std::string> last_two = {"B", "C"};
      EXPECT_EQ(found[0].targets, larger_first ? first_two : last_two);
      EXPECT_EQ(found[1].targets, larger_first ? last_two : first_two);
      EXPECT_EQ(found[1].configuration, std::to_string(12 + (larger_first ? apart : 0)));
      EXPECT_NEAR(found[1].amount, 0.0006, 2e-5);
    }
  }
}

TEST(DistanceCheck, DistancesAreJudgedBesideTheLevelOfTheirConfiguration) {
  Tool tool(kTriangle, 24, 1, 1e-5, Random(6));
  tool.slip(14, 2, {0.0, 0.004, 0.0});
  tool.move(18, 2, {0.0, -0.004, 0.0});  // back where it was, and so no longer where it should be
  const std::vector<QualityFinding> found = check_distances(tool.measured);
  ASSERT_EQ(found.size(), 2U) << ::testing::PrintToString(messages(found));
  EXPECT_EQ(found[0].kind, QualityKind::slipped_target);
  EXPECT_EQ(found[0].configuration, "14");
  EXPECT_NEAR(found[0].amount, 0.004, 1e-4);
  EXPECT_EQ(found[1].kind, QualityKind::displaced_point);
  EXPECT_EQ(found[1].configuration, "19");
  EXPECT_THAT(found[1].targets, ElementsAre("C"));
  EXPECT_NEAR(found[1].amount, 0.004, 1e-4);
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

// A trapezoid that exchanging A with B and C with D at once leaves nearly as it is: either swap alone explains the
// distances within their limit, one better than the other.
TEST(DistanceCheck, OfTwoSwapsTheOneThatExplainsTheDistancesBetterIsNamed) {
  const std::vector<Vector3d> trapezoid = {{-0.1, 0.0, 0.0}, {0.10003, 0.0, 0.0}, {-0.06, 0.1, 0.0}, {0.06, 0.1, 0.0}};
  for (const int first : {0, 2}) {
    Tool tool(trapezoid, 20, 1, 8e-6, Random(8));
    tool.swap(8, first, first + 1);
    EXPECT_THAT(messages(check_distances(tool.measured)),
                ElementsAre(first == 0 ? "targets A and B are swapped in configuration 9"
                                       : "targets C and D are swapped in configuration 9"));
  }
}

TEST(DistanceCheck, RefusesWhatDoesNotHoldTogether) {
  Tool tool(kTriangle, 4, 1, 1e-5, Random(9));
  EXPECT_THAT(messages(check_distances(tool.measured)), IsEmpty());
  EXPECT_THAT(refusal([&] { check_distances(tool.measured, {.smallest_slip = -1.0}); }), HasSubstr("smallest slip"));
  tool.measured.observations[2].position.y() = std::nan("");
  EXPECT_THAT(refusal([&] { check_distances(tool.measured); }), HasSubstr("observation 2"));
}

}  // namespace
}  // namespace kdl_calibration
