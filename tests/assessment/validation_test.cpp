#include "kdl_calibration/validation.hpp"
#include "kdl_calibration/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "assessment/folds.hpp"
#include "kdl_calibration/fold_sums.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using testing::fanuc;

TEST(Validation, StatisticsAreTheTextbookOnes) {
  const ErrorStatistics s = error_statistics({4.0, 1.0, 3.0, 2.0});
  EXPECT_EQ(s.count, 4);
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.rms, std::sqrt(7.5));
  EXPECT_DOUBLE_EQ(s.max, 4.0);
  EXPECT_DOUBLE_EQ(s.p95, 3.85);  // between the third and the fourth at 0.95 * 3 = 2.85
  EXPECT_DOUBLE_EQ(s.std, std::sqrt(5.0 / 3.0));
  EXPECT_EQ(error_statistics({}).count, 0);
  EXPECT_EQ(error_statistics({1.0}).std, 0.0);
}

struct Fixture : testing::VirtualExperiment {
  Measurements measured;

  explicit Fixture(int repeats = 1)
      : VirtualExperiment(arm()), measured(measure(20, {.sigma = 0.00003, .repeats = repeats})) {}

private:
  static const VirtualExperiment& arm() {
    static const VirtualExperiment experiment;
    return experiment;
  }
};

TEST(Validation, PositionErrorsAreTheDistancesToThePrediction) {
  Fixture f;
  f.measured.observations[7].position += Eigen::Vector3d(0.0, 0.003, 0.004);
  f.measured.observations[8].split = Split::test;
  const std::vector<double> all = position_errors(f.model, f.robot.truth, f.measured);
  ASSERT_EQ(all.size(), 60U);
  EXPECT_NEAR(all[7], 0.005, 0.0002);
  EXPECT_LT(all[6], 0.0002);
  EXPECT_EQ(position_errors(f.model, f.robot.truth, f.measured, Rows::train).size(), 59U);
  EXPECT_EQ(position_errors(f.model, f.robot.truth, f.measured, Rows::test).size(), 1U);
}

TEST(Validation, FiguresOfIso9283AreTheStandardsFormulas) {
  Fixture f;
  Measurements measured = subset(f.measured, [](const Observation& o) { return o.configuration < 2 && o.target == 0; });
  const std::vector<Observation> exact = measured.observations;
  measured.observations.clear();
  for (const Observation& point : exact) {
    const Eigen::Vector3d predicted =
        f.robot.truth.X_WB *
        (flange_poses(f.model, f.robot.truth, measured.joint_values)[static_cast<std::size_t>(point.configuration)] *
         f.robot.truth.targets[0].X_FT.translation());
    int repeat = 0;
    for (const double x : {-0.003, 0.0, 0.006}) {  // mean 0.001; distances from it 0.004, 0.001, 0.005
      Observation& o = measured.observations.emplace_back(point);
      o.position = predicted + Eigen::Vector3d(x, 0.002, 0.0);
      o.repeat = ++repeat;
    }
    if (point.configuration == 1) {
      measured.observations.resize(4);  // a point without repeats has no repeatability
    }
  }
  const Iso9283 iso = iso_9283(f.model, f.robot.truth, measured);
  EXPECT_EQ(iso.accuracy.count, 2);
  EXPECT_NEAR(iso.accuracy.max, std::hypot(0.003, 0.002), 1e-12);  // of the single point
  EXPECT_NEAR(iso.accuracy.mean, 0.5 * (std::hypot(0.003, 0.002) + std::hypot(0.001, 0.002)), 1e-12);
  EXPECT_EQ(iso.repeatability.count, 1);
  const double l = (0.004 + 0.001 + 0.005) / 3.0;
  const double s = std::sqrt((std::pow(0.004 - l, 2) + std::pow(0.001 - l, 2) + std::pow(0.005 - l, 2)) / 2.0);
  EXPECT_NEAR(iso.repeatability.mean, l + 3.0 * s, 1e-12);
}

TEST(Validation, LeaveOneOutIsARefitWithoutThatConfiguration) {
  const Fixture f(2);
  const Estimate start = nominal_start(f.model, f.measured);
  const HoldOut found =
      leave_one_configuration_out({.model = f.model, .measurements = f.measured, .start = start, .free = f.free});
  EXPECT_EQ(found.refits, 20);
  EXPECT_EQ(found.not_converged, 0);
  ASSERT_EQ(found.distances.size(), 60U);
  // By hand for the fifth configuration: fit the others, predict the mean of the two repeats of its second target.
  const Measurements others = subset(f.measured, [](const Observation& o) { return o.configuration != 4; });
  const Estimate refit = identify_jointly(f.model, others, start, f.free).estimate;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Observation& o : f.measured.observations) {
    if (o.configuration == 4 && o.target == 1) {
      mean += 0.5 * o.position;
    }
  }
  const Eigen::Vector3d predicted = refit.X_WB *
                                    flange_pose(folded(f.model, refit.errors), f.measured.joint_values.col(4)) *
                                    refit.targets[1].X_FT.translation();
  EXPECT_NEAR(found.distances[4 * 3 + 1], (mean - predicted).norm(), 1e-10);
}

TEST(Validation, FoldsPredictedFromSumsAreThoseOfRefits) {
  const Fixture f(2);
  const auto folds = make_folds(f.measured, 4);
  std::vector<FitOptions> ways(3);
  ways[1].joint.residuals.priors = {.length = 1e-3, .angle = 1e-3};
  ways[2].joint.residuals.noise = {.independent = Eigen::Vector3d(1e-5, 2e-5, 3e-5),
                                   .common = Eigen::Vector3d::Constant(2e-5)};
  for (const FitOptions& way : ways) {
    FitProblem problem{.model = f.model,
                       .measurements = f.measured,
                       .start = nominal_start(f.model, f.measured),
                       .free = f.free,
                       .options = way};
    problem.start = fit(problem).estimate;
    const HoldOut refitted = cross_validate(problem, folds, 1);
    const HoldOut summed = cross_validate_by_sums(problem, folds, 3e-5, 2);
    EXPECT_EQ(summed.refits, 4);
    EXPECT_EQ(summed.not_converged, 0);
    ASSERT_EQ(summed.distances.size(), refitted.distances.size());
    for (std::size_t i = 0; i < summed.distances.size(); ++i) {
      EXPECT_NEAR(summed.distances[i], refitted.distances[i], 1e-9);
    }
    const std::vector<double> fitted = position_errors(f.model, problem.start, averaged(f.measured));
    EXPECT_GT(error_statistics(summed.distances).rms, 1.2 * error_statistics(fitted).rms);
  }
}

TEST(Validation, LeaveOneOutOfTheNominalRobotShowsItsErrors) {
  const Fixture f;
  const HoldOut nominal = leave_one_configuration_out_nominal(f.model, f.measured);
  const HoldOut fitted = leave_one_configuration_out(
      {.model = f.model, .measurements = f.measured, .start = nominal_start(f.model, f.measured), .free = f.free});
  EXPECT_GT(error_statistics(nominal.distances).rms, 5.0 * error_statistics(fitted.distances).rms);
}

// ---- against what the definitions say, written out -----------------------------------------------------------------

TEST(Validation, StatisticsOfAnyNumberOfErrorsAreThoseOfTheSortedOnes) {
  Random random(5);
  for (int count = 1; count <= 45; ++count) {
    std::vector<double> errors;
    for (int i = 0; i < count; ++i) {
      errors.push_back(random.uniform(0.5, 2.0));
    }
    const ErrorStatistics found = error_statistics(errors);
    std::sort(errors.begin(), errors.end());
    const double n = count;
    const double mean = std::accumulate(errors.begin(), errors.end(), 0.0) / n;
    double squares = 0.0;
    double deviations = 0.0;
    for (const double error : errors) {
      squares += error * error / n;
      deviations += std::pow(error - mean, 2);
    }
    const double place = 0.95 * (n - 1.0);
    const auto below = static_cast<std::size_t>(place);
    const std::size_t above = std::min(below + 1, errors.size() - 1);
    SCOPED_TRACE(count);
    EXPECT_EQ(found.count, count);
    EXPECT_NEAR(found.mean, mean, 1e-14);
    EXPECT_NEAR(found.rms, std::sqrt(squares), 1e-14);
    EXPECT_EQ(found.max, errors.back());
    EXPECT_NEAR(found.std, count > 1 ? std::sqrt(deviations / (n - 1.0)) : 0.0, 1e-14);
    EXPECT_NEAR(found.p95, errors[below] + (place - static_cast<double>(below)) * (errors[above] - errors[below]),
                1e-14);
  }
}

Eigen::Vector3d expected_at(const ErrorModel& model, const Estimate& estimate, const Measurements& measured,
                            const Observation& o) {
  const KDL::Chain chain = error_chain(model, estimate.errors);
  const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(chain, measured.joint_values.col(o.configuration)));
  return estimate.X_WB * (X_BF * estimate.targets[static_cast<std::size_t>(o.target)].X_FT.translation());
}

bool is_of(const Observation& o, Rows rows) {
  return rows == Rows::all || (rows == Rows::test) == (o.split == Split::test);
}

TEST(Validation, FiguresOfIso9283AreThoseOfALoopOverTheRowsThatAreAskedFor) {
  Fixture f(3);
  Measurements measured = subset(f.measured, [](const Observation& o) {
    return o.configuration < 8 && !(o.configuration == 3 && o.repeat > 1) && !(o.target == 1 && o.repeat == 3);
  });
  for (Observation& o : measured.observations) {
    o.split = o.configuration % 3 == 1 ? Split::test : Split::train;
  }
  const Estimate& truth = f.robot.truth;
  for (const Rows rows : {Rows::all, Rows::train, Rows::test}) {
    std::map<std::pair<int, int>, std::vector<Observation>> cells;
    std::vector<double> singly;
    for (const Observation& o : measured.observations) {
      if (is_of(o, rows)) {
        cells[{o.configuration, o.target}].push_back(o);
        singly.push_back((o.position - expected_at(f.model, truth, measured, o)).norm());
      }
    }
    std::vector<double> accuracies;
    std::vector<double> repeatabilities;
    for (const auto& [cell, repeats] : cells) {
      Eigen::Vector3d mean = Eigen::Vector3d::Zero();
      for (const Observation& o : repeats) {
        mean += o.position / static_cast<double>(repeats.size());
      }
      accuracies.push_back((mean - expected_at(f.model, truth, measured, repeats.front())).norm());
      std::vector<double> distances;
      for (const Observation& o : repeats) {
        distances.push_back((o.position - mean).norm());
      }
      if (repeats.size() > 1) {
        repeatabilities.push_back(error_statistics(distances).mean + 3.0 * error_statistics(distances).std);
      }
    }
    SCOPED_TRACE(static_cast<int>(rows));
    const Iso9283 found = iso_9283(f.model, truth, measured, rows);
    EXPECT_EQ(found.accuracy.count, static_cast<long>(accuracies.size()));
    EXPECT_NEAR(found.accuracy.rms, error_statistics(accuracies).rms, 1e-12);
    EXPECT_NEAR(found.accuracy.max, error_statistics(accuracies).max, 1e-12);
    EXPECT_EQ(found.repeatability.count, static_cast<long>(repeatabilities.size()));
    EXPECT_NEAR(found.repeatability.rms, error_statistics(repeatabilities).rms, 1e-12);
    EXPECT_NEAR(found.repeatability.max, error_statistics(repeatabilities).max, 1e-12);
    const std::vector<double> errors = position_errors(f.model, truth, measured, rows);
    ASSERT_EQ(errors.size(), singly.size());
    for (std::size_t i = 0; i < singly.size(); ++i) {
      EXPECT_NEAR(errors[i], singly[i], 1e-12) << i;
    }
  }
}

TEST(Validation, RegisteredIsThatGeometryWithTheFramesThatAreNotKnown) {
  Fixture f;
  const Eigen::VectorXd& errors = f.robot.truth.errors;
  for (const bool known_base : {false, true}) {
    RegistrationOptions known;
    if (known_base) {
      known.known_base = f.robot.truth.X_WB * Eigen::Translation3d(1e-3, 0.0, 0.0);
    }
    const Estimate found = registered(f.model, errors, f.measured, known);
    EXPECT_EQ(found.errors, errors);
    const Eigen::Isometry3d base = known_base ? *known.known_base : f.robot.truth.X_WB;
    EXPECT_LT((found.X_WB.translation() - base.translation()).norm(), known_base ? 1e-12 : 1e-4);
    EXPECT_LT((found.targets[1].X_FT.translation() - f.robot.truth.targets[1].X_FT.translation()).norm(), 2e-3);
    EXPECT_EQ(found.effects.size(), 0);
  }
}

// Configurations that stand for themselves and those at the same joint values, in their order.
std::vector<std::vector<Eigen::Index>> groups_of(const Measurements& measured) {
  std::vector<std::vector<Eigen::Index>> groups;
  for (Eigen::Index c = 0; c < measured.joint_values.cols(); ++c) {
    const bool trained = std::any_of(measured.observations.begin(), measured.observations.end(),
                                     [&](const auto& o) { return o.configuration == c && o.split == Split::train; });
    const auto same = std::find_if(groups.begin(), groups.end(), [&](const auto& group) {
      return measured.joint_values.col(group.front()) == measured.joint_values.col(c);
    });
    if (trained && same == groups.end()) {
      groups.push_back({c});
    } else if (trained) {
      same->push_back(c);
    }
  }
  return groups;
}

TEST(Validation, FoldsAreDealtOutOfTrainedConfigurationsAtDifferentJointValues) {
  Fixture f;
  Measurements measured = f.measured;
  measured.joint_values.col(5) = measured.joint_values.col(2);
  measured.joint_values.col(12) = measured.joint_values.col(2);
  measured.joint_values.col(17) = measured.joint_values.col(16);
  for (Observation& o : measured.observations) {
    o.split = o.configuration == 0 || o.configuration == 16 ? Split::test : Split::train;
  }
  const auto groups = groups_of(measured);
  ASSERT_EQ(groups.size(), 16U);
  for (const int folds : {0, -1, 16, 17, 100}) {
    EXPECT_EQ(make_folds(measured, folds), groups) << folds;
  }
  for (const std::uint64_t seed : {1U, 8U}) {
    for (const int folds : {1, 3, 15}) {
      auto dealt = groups;  // Fisher and Yates, Durstenfeld's way
      Random random(seed);
      for (std::size_t left = dealt.size(); left > 1; --left) {
        std::swap(dealt[left - 1], dealt[random.bits() % left]);
      }
      std::vector<std::vector<Eigen::Index>> expected(static_cast<std::size_t>(folds));
      for (std::size_t i = 0; i < dealt.size(); ++i) {
        for (const Eigen::Index c : dealt[i]) {
          expected[i % expected.size()].push_back(c);
        }
      }
      EXPECT_EQ(make_folds(measured, folds, seed), expected) << folds << ", " << seed;
    }
  }
  EXPECT_EQ(make_folds(measured, 3), make_folds(measured, 3, 1));
}

TEST(Validation, FoldsCanBeLeftOutWhereAsManyEquationsAsUnknownsStay) {
  testing::VirtualExperiment experiment({.targets = testing::as_frames(published_targets(2))});
  Measurements measured =
      subset(experiment.measure(6), [](const Observation& o) { return !(o.configuration == 5 && o.target == 1); });
  for (std::size_t row = 0; row < measured.observations.size(); ++row) {
    Observation& o = measured.observations[row];
    o.split = o.configuration == 4 ? Split::test : Split::train;
    if (o.target == 1 && o.configuration < 3) {
      measured.orientations[row] = point_alone();
    }
  }
  // Equations: three configurations of 6 + 3, one of 12, one of test rows, one of 6.
  const std::vector<std::vector<Eigen::Index>> singly = {{0}, {1}, {2}, {3}, {5}};
  EXPECT_TRUE(can_be_left_out(measured, singly, 33));
  EXPECT_FALSE(can_be_left_out(measured, singly, 34)) << "without the fourth there are 33";
  EXPECT_TRUE(can_be_left_out(measured, {{0}, {1, 5}}, 30));
  EXPECT_FALSE(can_be_left_out(measured, {{0}, {1, 5}}, 31));
  EXPECT_TRUE(can_be_left_out(measured, {{5}, {4}}, 39));
  EXPECT_FALSE(can_be_left_out(measured, {{5}, {4}}, 40));
  EXPECT_FALSE(can_be_left_out(measured, {{0}}, 1)) << "a single fold leaves nobody to predict it by";
  EXPECT_FALSE(can_be_left_out(measured, {}, 1));
  measured.orientations.clear();
  EXPECT_TRUE(can_be_left_out(measured, singly, 21));
  EXPECT_FALSE(can_be_left_out(measured, singly, 22));
}

TEST(Validation, CrossValidationCountsTheFoldsThatDoNotConverge) {
  Fixture f;
  for (Observation& o : f.measured.observations) {
    o.split = o.configuration == 6 ? Split::test : Split::train;
  }
  FitProblem problem{.model = f.model,
                     .measurements = f.measured,
                     .start = nominal_start(f.model, f.measured),
                     .free = f.free,
                     .options = {.joint = {.max_iterations = 1}}};
  const HoldOut found = cross_validate(problem, make_folds(f.measured, 4), 1);
  EXPECT_EQ(found.refits, 4);
  EXPECT_EQ(found.not_converged, 4);
  EXPECT_EQ(found.distances.size(), 57U) << "of training rows";
  problem.options.joint.max_iterations = 50;
  EXPECT_EQ(cross_validate(problem, make_folds(f.measured, 4), 1).not_converged, 0);
}

TEST(Validation, TheNominalRobotIsRegisteredAnewWithoutEachFold) {
  Fixture f(2);
  RegistrationOptions known;
  known.known_base = f.robot.truth.X_WB * Eigen::Translation3d(0.0, 5e-3, 0.0);
  for (const RegistrationOptions& options : {RegistrationOptions{}, known}) {
    const auto folds = make_folds(f.measured, 3);
    std::vector<double> expected;
    for (const auto& fold : folds) {
      const auto in_fold = [&](const Observation& o) {
        return std::find(fold.begin(), fold.end(), o.configuration) != fold.end();
      };
      const Estimate start =
          nominal_start(f.model, subset(f.measured, [&](const Observation& o) { return !in_fold(o); }), options);
      const auto own = position_errors(f.model, start, averaged(subset(f.measured, in_fold)));
      expected.insert(expected.end(), own.begin(), own.end());
    }
    const HoldOut found = cross_validate_nominal(f.model, f.measured, folds, options, 2);
    EXPECT_EQ(found.refits, 3);
    EXPECT_EQ(found.not_converged, 0);
    ASSERT_EQ(found.distances.size(), expected.size());
    for (std::size_t i = 0; i < expected.size(); ++i) {
      EXPECT_NEAR(found.distances[i], expected[i], 1e-9) << i;
    }
    EXPECT_EQ(leave_one_configuration_out_nominal(f.model, f.measured, options).refits, 20);
    EXPECT_EQ(leave_one_configuration_out_nominal(f.model, f.measured, options).distances,
              cross_validate_nominal(f.model, f.measured, make_folds(f.measured, 0), options).distances);
  }
}

TEST(Validation, ARefittedFoldIsPredictedPointByPoint) {
  const Fixture f(2);
  FitProblem problem{
      .model = f.model, .measurements = f.measured, .start = nominal_start(f.model, f.measured), .free = f.free};
  const RefittedFold found = refit_without(problem, {9, 4});
  EXPECT_TRUE(found.converged);
  EXPECT_EQ(found.configurations, (std::vector<std::int32_t>{4, 4, 4, 9, 9, 9}));
  EXPECT_EQ(found.targets, (std::vector<std::int32_t>{0, 1, 2, 0, 1, 2}));
  const Measurements others =
      subset(f.measured, [](const Observation& o) { return o.configuration != 4 && o.configuration != 9; });
  const Estimate refit = identify_jointly(f.model, others, problem.start, f.free).estimate;
  const Measurements means = averaged(f.measured);
  for (std::size_t i = 0; i < 6; ++i) {
    const Observation& o = means.observations[3 * static_cast<std::size_t>(found.configurations[i]) +
                                              static_cast<std::size_t>(found.targets[i])];
    EXPECT_LT((found.residuals[i] - (o.position - expected_at(f.model, refit, f.measured, o))).norm(), 1e-9);
  }
  problem.options.joint.max_iterations = 1;
  EXPECT_FALSE(refit_without(problem, {9, 4}).converged);
}

// A slide that is driven for a million kilometres shows by its rounding which configurations are looked at.
TEST(Validation, ThousandConfigurationsAreComparedWithKdlEvenlySpaced) {
  const ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  Random random(4);
  const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 0.01);
  const auto found = [&](Eigen::Index count, Eigen::Index far) {
    Random same(6);
    Eigen::MatrixXd q = random_configurations(limits_of(model.joints), static_cast<int>(count), same);
    q(1, far) = 1e9;
    return difference_to_kdl(model, errors, q);
  };
  for (const auto& [count, far, compared] :
       {std::tuple(1, 0, true), std::tuple(7, 6, true), std::tuple(1000, 0, true), std::tuple(1000, 999, true),
        std::tuple(1000, 500, true), std::tuple(1001, 999, true), std::tuple(1001, 1000, false),
        std::tuple(2500, 2, true), std::tuple(2500, 1, false), std::tuple(2500, 2497, true),
        std::tuple(2500, 2498, false), std::tuple(2500, 2499, false)}) {
    EXPECT_EQ(found(count, far) > 1e-10, compared) << count << ", " << far;
    EXPECT_LT(found(count, far), 1e-4);
  }
}

TEST(Validation, AgreesWithTheKdlSolver) {
  Random random(3);
  for (const ErrorModel& model : {complete_model(fanuc()), complete_model(parse_robot(testing::kOddArm))}) {
    const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * testing::kDegree);
    const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 1000, random);
    EXPECT_LT(difference_to_kdl(model, errors, q), 1e-12);
  }
}

}  // namespace
}  // namespace kdl_calibration
