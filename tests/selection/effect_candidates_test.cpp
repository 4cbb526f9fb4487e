// Linear rows against sums over observations by central differences, and which columns share a size.

#include "selection/effect_candidates.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "effects/effect_terms.hpp"
#include "estimation/prediction.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::effect_candidates_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// The odd arm, points of which each states a sigma of its own, and an estimate beside the truth.
struct Setting : testing::VirtualExperiment {
  Measurements measured;
  std::vector<EffectTerm> terms;
  Estimate optimum;

  Setting()
      : VirtualExperiment({.model = complete_model(parse_robot(testing::kOddArm)),
                           .X_WB = Eigen::Isometry3d(Eigen::Translation3d(2.0, -1.0, 0.3)),
                           .random = Random(3)}) {
    const MatrixXd q = configurations(12);
    measured = measure(q, {.sigma = 1e-4});
    for (Observation& o : measured.observations) {
      o.sigma = random.uniform(5e-5, 2e-4);
    }
    for (const EffectGroup group : {EffectGroup::gravity, EffectGroup::gain, EffectGroup::tables}) {
      const std::vector<EffectTerm> more = effect_terms(model, group, q);
      terms.insert(terms.end(), more.begin(), more.end());
    }
    optimum = robot.truth;
    for (double& error : optimum.errors) {
      error += 3e-4 * random.normal();  // also of parameters that are not free
    }
    optimum.effects = VectorXd::Constant(3, 5.0);  // of another model
  }
};

const Setting& setting() {
  static const Setting one;
  return one;
}

/// Measured minus predicted of one observation, over its sigma.
VectorXd residual(const ErrorModel& model, const Estimate& estimate, const Measurements& measured,
                  const Observation& o) {
  const MatrixXd q = measured.joint_values.col(o.configuration);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, q);
  Observation only = o;
  only.configuration = 0;
  return (o.position() - predicted_point(estimate, X_BF, only)) / o.sigma;
}

TEST(EffectCandidates, RowsAreThoseOfThePredictionAtNoErrorsAndNoEffects) {
  const Setting& s = setting();
  const Candidate candidate = with_terms(s.model, s.free, s.terms, true);
  EXPECT_TRUE(candidate.sized);
  ASSERT_EQ(candidate.free.effects().size(), s.terms.size());
  const LinearRows rows = linear_rows(candidate, s.measured, s.optimum, 0.3);
  ASSERT_EQ(rows.first.size(), 13U);
  Estimate start = s.optimum;
  start.effects = VectorXd::Zero(static_cast<Index>(s.terms.size()));
  VectorXd errors = VectorXd::Zero(candidate.free.size());
  for (const std::size_t p : candidate.free.geometric()) {
    errors[*candidate.free.column(UnknownGroup::geometric, p)] = s.optimum.errors[static_cast<Index>(p)];
  }
  double weights = 0.0;
  for (Index c = 0; c < 12; ++c) {
    LinearSums expected{.information = MatrixXd::Zero(errors.size(), errors.size()),
                        .moment = VectorXd::Zero(errors.size())};
    for (const Observation& o : s.measured.observations) {
      if (o.configuration != c) {
        continue;
      }
      const MatrixXd J = -testing::central_differences(errors.size(), 1e-5, [&](const VectorXd& step) {
        return residual(candidate.model, candidate.free.moved(start, step), s.measured, o);
      });
      const VectorXd y = residual(candidate.model, start, s.measured, o) + J * errors;
      expected.information += J.transpose() * J;
      expected.moment += J.transpose() * y;
      expected.squares += y.squaredNorm();
      expected.equations += 3.0;
      weights += 1.0 / (o.sigma * o.sigma);
    }
    const LinearSums sums = sums_of(rows, {c});
    EXPECT_LT((sums.information - expected.information).norm(), 1e-6 * expected.information.norm()) << c;
    EXPECT_LT((sums.moment - expected.moment).norm(), 1e-6 * expected.moment.norm()) << c;
    EXPECT_NEAR(sums.squares, expected.squares, 1e-6 * expected.squares) << c;
    EXPECT_EQ(sums.equations, expected.equations) << c;
  }
  EXPECT_NEAR(rows.unit, 1.0 / std::sqrt(weights / 36.0), 1e-12);
}

TEST(EffectCandidates, SumsOfSeveralConfigurationsAreTheirSums) {
  const Setting& s = setting();
  const LinearRows rows = linear_rows(with_terms(s.model, s.free, {}, false), s.measured, s.optimum, 0.3);
  LinearSums left = sums_of(rows, {1, 4, 7});
  EXPECT_TRUE(left.information.isApprox(left.information.transpose(), 1e-14));
  for (const Index c : {7, 1, 4}) {
    LinearSums rest = sums_of(rows, {c});
    rest.subtract_from(left);
    left = rest;
  }
  EXPECT_LT(left.information.norm() + left.moment.norm() + std::abs(left.squares), 1e-6);
  EXPECT_EQ(left.equations, 0.0);
  EXPECT_TRUE(sums_of(rows, {}).information.isZero(0.0));
}

TEST(EffectCandidates, OrientationsCountByTheirLength) {
  testing::VirtualExperiment s({.targets = testing::as_frames(published_targets(2)), .random = Random(5)});
  Measurements measured = testing::without_sigmas(s.measure(4, {.sigma = 1e-4, .orientation_sigma = 1e-3}));
  const Estimate start = nominal_start(s.model, measured);
  const auto squares = [&](double length) {
    const LinearRows rows = linear_rows(with_terms(s.model, s.free, {}, false), measured, start, length);
    EXPECT_NEAR(rows.unit, 1.0, 1e-12);
    return sums_of(rows, {0, 1, 2, 3}).squares;
  };
  const double of_points = squares(1e-9);
  const double of_orientations = squares(1.0) - of_points;
  EXPECT_GT(of_orientations, 0.0);
  EXPECT_NEAR(squares(0.5) - of_points, 0.25 * of_orientations, 1e-9 * of_orientations);
}

TEST(EffectCandidates, JointRowsAreMotionsOfTheJointsThemselves) {
  const Setting& s = setting();
  const Unknowns offsets = joint_offsets(s.model, s.targets);
  EXPECT_THAT(offsets.names(), ::testing::ElementsAre("dq1", "dq2", "dq3", "dq4", "dq5"));
  const LinearRows rows = joint_rows(s.model, s.measured, s.optimum, 0.3);
  ASSERT_EQ(rows.columns(), 5);
  Estimate start = s.optimum;
  start.effects.resize(0);
  for (Index c = 0; c < 12; ++c) {
    MatrixXd information = MatrixXd::Zero(5, 5);
    for (const Observation& o : s.measured.observations) {
      if (o.configuration == c) {
        const MatrixXd J = testing::central_differences(5, 1e-5, [&](const VectorXd& step) {
          Measurements moved = s.measured;
          moved.joint_values.col(c) += step;
          return residual(s.model, start, moved, o);
        });
        information += J.transpose() * J;
      }
    }
    EXPECT_LT((sums_of(rows, {c}).information - information).norm(), 1e-6 * information.norm()) << c;
  }
}

TEST(EffectCandidates, GroupsAreLengthsAnglesAndEffects) {
  const Setting& s = setting();
  const auto names = [&](bool sized, const Priors& stated) {
    return groups_of(with_terms(s.model, s.free, s.terms, sized), stated).names;
  };
  const std::vector<std::string> effects = {"gain",     "gravity",  "tables.1", "tables.2",
                                            "tables.3", "tables.4", "tables.5"};
  const auto expected = [&](std::vector<std::string> with) {
    with.insert(with.end(), effects.begin(), effects.end());
    return with;
  };
  EXPECT_THAT(names(true, {}), ::testing::UnorderedElementsAreArray(expected({"length", "angle"})));
  EXPECT_THAT(names(false, {}), ::testing::UnorderedElementsAreArray(effects));
  EXPECT_THAT(names(false, {.length = 2e-3}), ::testing::UnorderedElementsAreArray(expected({"length"})));
  EXPECT_THAT(names(false, {.angle = 3e-3}), ::testing::UnorderedElementsAreArray(expected({"angle"})));

  // Every column of an effect is in one group, every geometric one where errors are sized.
  const Candidate candidate = with_terms(s.model, s.free, s.terms, true);
  const Groups groups = groups_of(candidate, {});
  std::vector<Index> columns;
  for (std::size_t g = 0; g < groups.names.size(); ++g) {
    columns.insert(columns.end(), groups.columns[g].begin(), groups.columns[g].end());
    const std::string unknown = candidate.free.columns().at(static_cast<std::size_t>(groups.columns[g].front())).name;
    if (groups.names[g].starts_with("tables")) {
      EXPECT_THAT(unknown, ::testing::StartsWith(groups.names[g] + "."));
      EXPECT_LT(groups.limits.most[g], 0.01) << "tables are small";
    }
    EXPECT_EQ(groups.limits.held[g], 0.0) << "all are sized";
  }
  std::sort(columns.begin(), columns.end());
  EXPECT_EQ(std::adjacent_find(columns.begin(), columns.end()), columns.end()) << "in two groups";
  EXPECT_EQ(columns.size(), candidate.free.geometric().size() + s.terms.size());
}

}  // namespace
}  // namespace kdl_calibration::effect_candidates_test
