// Leverages and Cook's distances from the rows of the whitened system: each point and configuration left out in turn.

#include "kdl_calibration/influence.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "kdl_calibration/identification.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::refusal;
using testing::VirtualExperiment;

/// Poses and points of 70 configurations, some of them held out, of any weight; at the optimum.
struct Trial {
  VirtualExperiment experiment;
  Measurements measured;
  Unknowns free;
  ResidualOptions options;
  Estimate estimate;

  explicit Trial(int configurations = 70)
      : experiment({.targets = testing::as_frames(published_targets())}),
        measured(experiment.measure(configurations, {.sigma = 1e-4, .orientation_sigma = 2e-4, .repeats = 2})),
        options{.priors = {.length = 5e-5, .angle = 5e-5}, .orientation_length = 0.5} {
    std::vector<std::string> names = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz", "A.x",
                                      "A.y",     "A.z",     "B.x",     "B.y",     "B.z",     "B.Rx",    "B.Ry",
                                      "B.Rz",    "C.x",     "C.y",     "C.z",     "C.Rx"};
    const std::vector<std::string> all = experiment.free.names();
    names.insert(names.end(), all.begin() + 8, all.begin() + 12);
    free = Unknowns(experiment.model, experiment.targets, names);
    measured = subset(testing::without_sigmas(measured),
                      [](const Observation& o) { return o.configuration % 9 != 4 || o.target != 1; });
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      Observation& o = measured.observations[row];
      o.split = o.configuration % 11 == 3 ? Split::test : Split::train;
      if (o.target == 0 || (o.configuration % 4 == 1 && o.repeat == 1) || o.configuration % 6 == 2) {
        measured.orientations[row] = point_alone();
      }
      options.row_weights.push_back(row == 30 ? 40.0 : row % 5 == 2 ? 0.3 : 1.0);
    }
    estimate = identify_jointly(experiment.model, measured, experiment.robot.truth, free,
                                {.step_tolerance = 1e-14, .residuals = options})
                   .estimate;
  }

  LeastSquaresProblem problem() const { return {experiment.model, measured, free, options}; }
  Influence found() const {
    return influence(problem(), measured, options, estimate, problem().whitened_summary(estimate).triangle);
  }

  // Of a configuration's points whether their orientations were measured.
  std::vector<std::pair<int, bool>> points(int configuration) const {
    std::vector<std::pair<int, bool>> result;
    for (int target = 0; target < 3; ++target) {
      bool there = false;
      bool turned = false;
      for (std::size_t row = 0; row < measured.observations.size(); ++row) {
        const Observation& o = measured.observations[row];
        if (o.configuration == configuration && o.target == target && o.split == Split::train) {
          there = true;
          turned = turned || !is_point(measured.orientations[row]);
        }
      }
      if (there) {
        result.emplace_back(target, turned);
      }
    }
    return result;
  }
};

/// The whole of the linear problem, and what is left without some rows.
struct Linear {
  MatrixXd J;
  VectorXd e;
  MatrixXd A;
  double decided = 0.0;
  double mean_square = 0.0;

  Linear(const WhitenedSystem& system, Index measured_rows) : J(system.jacobian), e(system.residual) {
    A = J.transpose() * J;
    const MatrixXd rows = J.topRows(measured_rows);
    decided = (rows * A.inverse() * rows.transpose()).trace();
    mean_square = e.head(measured_rows).squaredNorm() / (static_cast<double>(measured_rows) - decided);
  }

  double leverage(const std::vector<Index>& rows) const {
    const MatrixXd own = J(rows, Eigen::all);
    return (own * A.inverse() * own.transpose()).trace();
  }
  double cook(const std::vector<Index>& rows) const {
    const MatrixXd own = J(rows, Eigen::all);
    const VectorXd moment = J.transpose() * e - own.transpose() * e(rows);
    const VectorXd x = A.inverse() * VectorXd(J.transpose() * e);
    const VectorXd without = (A - own.transpose() * own).inverse() * moment;
    return (x - without).dot(A * (x - without)) / (decided * mean_square);
  }
};

// NOLINTNEXTLINE(readability-function-cognitive-complexity): the rule written out
TEST(Influence, OfPosesAndPointsIsThatOfTheirRowsLeftOut) {
  const Trial trial;
  const WhitenedSystem system = trial.problem().whitened(trial.estimate);
  const Index measured_rows = system.blocks.back();
  const Linear linear(system, measured_rows);
  ASSERT_GT(system.jacobian.rows(), measured_rows) << "priors";
  const Influence found = trial.found();
  ASSERT_EQ(found.configurations.size() + 1, system.blocks.size());
  std::vector<int> trained;
  for (int c = 0; c < 70; ++c) {
    if (c % 11 != 3) {
      trained.push_back(c);
    }
  }
  ASSERT_EQ(found.configurations.size(), trained.size());
  double points = 0.0;
  int flags[4] = {};
  for (std::size_t c = 0; c < found.configurations.size(); ++c) {
    const ConfigurationInfluence& entry = found.configurations[c];
    const std::string what = "configuration " + std::to_string(entry.configuration);
    EXPECT_EQ(entry.configuration, trained[c]) << what;
    const auto expected = trial.points(entry.configuration);
    ASSERT_EQ(entry.points.size(), expected.size()) << what;
    std::vector<Index> all;
    for (Index row = system.blocks[c]; row < system.blocks[c + 1]; ++row) {
      all.push_back(row);
    }
    EXPECT_EQ(entry.coordinates, static_cast<int>(all.size())) << what;
    EXPECT_NEAR(entry.leverage, linear.leverage(all), 1e-8) << what;
    EXPECT_NEAR(entry.cook / linear.cook(all), 1.0, 1e-4) << what;
    Index position = system.blocks[c];
    Index orientation = position + 3 * static_cast<Index>(expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) {
      const PointInfluence& point = entry.points[i];
      std::vector<Index> own;
      for (int axis = 0; axis < 3; ++axis) {
        own.push_back(position++);
      }
      for (int axis = 0; axis < (expected[i].second ? 3 : 0); ++axis) {
        own.push_back(orientation++);
      }
      EXPECT_EQ(point.target, expected[i].first) << what;
      EXPECT_EQ(point.coordinates, static_cast<int>(own.size())) << what;
      EXPECT_NEAR(point.leverage, linear.leverage(own), 1e-8) << what << ", point " << i;
      EXPECT_NEAR(point.cook / linear.cook(own), 1.0, 1e-4) << what << ", point " << i;
      EXPECT_EQ(point.high_leverage, point.leverage > point.coordinates * found.leverage_limit) << what;
      EXPECT_EQ(point.influential, point.cook > found.point_cook_limit) << what;
      flags[2] += point.high_leverage ? 1 : 0;
      flags[3] += point.influential ? 1 : 0;
      points += 1.0;
    }
    EXPECT_EQ(entry.high_leverage, entry.leverage > entry.coordinates * found.leverage_limit) << what;
    EXPECT_EQ(entry.influential, entry.cook > found.cook_limit) << what;
    flags[0] += entry.high_leverage ? 1 : 0;
    flags[1] += entry.influential ? 1 : 0;
  }
  EXPECT_NEAR(found.leverage_limit, 2.0 * linear.decided / static_cast<double>(measured_rows), 1e-10);
  EXPECT_LT(linear.decided, 22.99) << "priors decide some";
  EXPECT_NEAR(found.cook_limit, 4.0 / static_cast<double>(found.configurations.size()), 1e-15);
  EXPECT_NEAR(found.point_cook_limit, 4.0 / points, 1e-15);
  EXPECT_GT(flags[1], 0);
  EXPECT_GT(flags[2], 0);
  EXPECT_GT(flags[3], 0);
  EXPECT_LT(flags[0] + flags[1], 70);
}

/// The third target in two configurations, in the second with this weight: all that decides its place.
Influence of_a_target_seen_twice(double weight) {
  VirtualExperiment experiment;
  Measurements measured = testing::without_sigmas(experiment.measure(6, {.sigma = 1e-4}));
  measured = subset(measured, [](const Observation& o) { return o.target != 2 || o.configuration < 2; });
  ResidualOptions options;
  for (const Observation& o : measured.observations) {
    options.row_weights.push_back(o.target == 2 && o.configuration == 1 ? weight : 1.0);
  }
  const Unknowns free(experiment.model, experiment.targets, {"C.x", "C.y", "C.z"});
  const Estimate estimate =
      identify_jointly(experiment.model, measured, experiment.robot.truth, free, {.residuals = options}).estimate;
  const LeastSquaresProblem problem(experiment.model, measured, free, options);
  return influence(problem, measured, options, estimate, problem.whitened_summary(estimate).triangle);
}

TEST(Influence, IsInfiniteWhereTheRestDoesNotDetermineAll) {
  const Influence finite = of_a_target_seen_twice(2e-9);
  ASSERT_EQ(finite.configurations.size(), 6U);
  EXPECT_TRUE(std::isfinite(finite.configurations[0].cook));
  EXPECT_GT(finite.configurations[0].cook, 0.0);
  EXPECT_TRUE(std::isfinite(finite.configurations[0].points[2].cook));
  const Influence infinite = of_a_target_seen_twice(5e-10);
  EXPECT_TRUE(std::isinf(infinite.configurations[0].cook));
  EXPECT_TRUE(std::isinf(infinite.configurations[0].points[2].cook));
  EXPECT_TRUE(infinite.configurations[0].influential);
  EXPECT_TRUE(infinite.configurations[0].points[2].influential);
  EXPECT_TRUE(infinite.configurations[0].points[2].high_leverage);
  for (const std::size_t target : {0U, 1U}) {
    EXPECT_EQ(infinite.configurations[0].points[target].cook, 0.0) << "tells nothing of it";
    EXPECT_FALSE(infinite.configurations[0].points[target].high_leverage);
  }
  EXPECT_EQ(infinite.configurations[4].cook, 0.0);
}

// One configuration of three targets of which one is free: nothing is left to judge by.
TEST(Influence, IsNoneWhereNothingIsLeftOver) {
  VirtualExperiment experiment;
  const Measurements measured = testing::without_sigmas(
      subset(experiment.measure(1, {.sigma = 1e-4}), [](const Observation& o) { return o.target == 2; }));
  const Unknowns free(experiment.model, experiment.targets, {"C.x", "C.y", "C.z"});
  const LeastSquaresProblem problem(experiment.model, measured, free);
  const Influence found = influence(problem, measured, {}, experiment.robot.truth,
                                    problem.whitened_summary(experiment.robot.truth).triangle);
  ASSERT_EQ(found.configurations.size(), 1U);
  EXPECT_NEAR(found.configurations[0].leverage, 3.0, 1e-12);
  EXPECT_EQ(found.configurations[0].cook, 0.0);
  EXPECT_FALSE(found.configurations[0].influential);
}

TEST(Influence, IsEmptyWhereTheTriangleDoesNotDetermineAllColumns) {
  VirtualExperiment experiment;
  const Measurements measured = testing::without_sigmas(experiment.measure(6, {.sigma = 1e-4}));
  const Unknowns free(experiment.model, experiment.targets, {"C.x", "C.y"});
  const LeastSquaresProblem problem(experiment.model, measured, free);
  const auto entries = [&](const MatrixXd& triangle) {
    return influence(problem, measured, {}, experiment.robot.truth, triangle).configurations.size();
  };
  const auto parallel = [](double sine) { return (MatrixXd(2, 2) << 1e3, 1.0, 0.0, sine).finished(); };
  EXPECT_EQ(entries(parallel(2e-9)), 6U);
  EXPECT_EQ(entries(parallel(5e-10)), 0U);
  EXPECT_EQ(entries(parallel(-2e-9)), 6U) << "of either sign";
  EXPECT_EQ(entries(MatrixXd::Identity(1, 2)), 0U);
  EXPECT_EQ(entries((MatrixXd(3, 2) << 1.0, 1.0, 1.0, -1.0, 1.0, 1.0).finished()), 6U);
  const Unknowns none(experiment.model, experiment.targets, {});
  const LeastSquaresProblem fixed(experiment.model, measured, none);
  EXPECT_TRUE(influence(fixed, measured, {}, experiment.robot.truth, MatrixXd(3, 0)).configurations.empty());
}

TEST(Influence, RefusesWhatDoesNotHoldTogether) {
  const Trial trial(8);
  const LeastSquaresProblem problem = trial.problem();
  const MatrixXd triangle = problem.whitened_summary(trial.estimate).triangle;
  Measurements measured = trial.measured;
  measured.joints[0] = "another";
  EXPECT_NE(refusal([&] { influence(problem, measured, trial.options, trial.estimate, triangle); }).find("another"),
            std::string::npos);
  Estimate estimate = trial.estimate;
  estimate.errors.conservativeResize(3);
  EXPECT_NE(refusal([&] { influence(problem, trial.measured, trial.options, estimate, triangle); }).find("3 errors"),
            std::string::npos);
  ResidualOptions options = trial.options;
  options.row_weights[1] = -1.0;
  EXPECT_NE(refusal([&] { influence(problem, trial.measured, options, trial.estimate, triangle); }).find("weight"),
            std::string::npos);
  EXPECT_EQ(refusal([&] { influence(problem, trial.measured, trial.options, trial.estimate, triangle.leftCols(5)); }),
            "5 columns of a triangle, expected 23");
}

}  // namespace
}  // namespace kdl_calibration
