#include "validation/validation.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

#include "measurements/readings.hpp"
#include "model/kinematics.hpp"
#include "planning/simulation.hpp"
#include "validation/folds.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::validation_test {
namespace {

TEST(Validation, StatisticsAreTheTextbookOnes) {
  const ErrorStatistics s = error_statistics({4.0, 1.0, 3.0, 2.0});
  EXPECT_EQ(s.count, 4);
  EXPECT_DOUBLE_EQ(s.mean, 2.5);
  EXPECT_DOUBLE_EQ(s.rms, std::sqrt(7.5));
  EXPECT_DOUBLE_EQ(s.max, 4.0);
  EXPECT_DOUBLE_EQ(s.p95, 3.85);  // between the third and the fourth at 0.95 * 3 = 2.85
  EXPECT_DOUBLE_EQ(s.std, std::sqrt(5.0 / 3.0));
  std::vector<double> numbers(101);  // 0 to 100: percentiles are themselves
  std::iota(numbers.begin(), numbers.end(), 0.0);
  EXPECT_DOUBLE_EQ(error_statistics(numbers).p95, 95.0);
  EXPECT_DOUBLE_EQ(error_statistics(numbers).std, std::sqrt(101.0 * 102.0 / 12.0));
  EXPECT_EQ(error_statistics({}).count, 0);
  EXPECT_EQ(error_statistics({1.0}).std, 0.0);
  EXPECT_EQ(error_statistics({1.0}).p95, 1.0);
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
  f.measured.observations[7].position() += Eigen::Vector3d(0.0, 0.003, 0.004);
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
  const KDL::Chain chain = error_chain(f.model, f.robot.truth.errors);
  for (const Observation& point : exact) {
    const Eigen::Vector3d predicted =
        testing::kdl_point(chain, f.robot.truth, measured.joint_values.col(point.configuration), 0);
    int repeat = 0;
    for (const double x : {-0.003, 0.0, 0.006}) {  // mean 0.001; distances from it 0.004, 0.001, 0.005
      Observation& o = measured.observations.emplace_back(point);
      o.position() = predicted + Eigen::Vector3d(x, 0.002, 0.0);
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
  for (Observation& o : measured.observations) {
    o.split = o.configuration == 1 ? Split::test : Split::train;
  }
  EXPECT_NEAR(iso_9283(f.model, f.robot.truth, measured, Rows::test).accuracy.max, std::hypot(0.003, 0.002), 1e-12);
  EXPECT_EQ(iso_9283(f.model, f.robot.truth, measured, Rows::test).repeatability.count, 0);
  EXPECT_NEAR(iso_9283(f.model, f.robot.truth, measured, Rows::train).accuracy.max, std::hypot(0.001, 0.002), 1e-12);
}

TEST(Validation, LeaveOneOutIsARefitWithoutThatConfiguration) {
  const Fixture f(2);
  const FitProblem problem{
      .model = f.model, .measurements = f.measured, .start = nominal_start(f.model, f.measured), .free = f.free};
  const HoldOut found = cross_validate(problem, make_folds(f.measured, 0));
  EXPECT_EQ(found.refits, 20);
  EXPECT_EQ(found.not_converged, 0);
  ASSERT_EQ(found.distances.size(), 60U);
  for (const std::size_t c : {0U, 4U, 19U}) {
    const RefittedFold refit = refit_without(problem, {static_cast<Eigen::Index>(c)});
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_NEAR(found.distances[3 * c + k], refit.residuals[k].norm(), 1e-10) << c;
    }
  }
}

TEST(Validation, RegisteredIsThatGeometryWithTheFramesThatAreNotKnown) {
  Fixture f;
  const Eigen::VectorXd& errors = f.robot.truth.errors;
  for (const bool known_base : {false, true}) {
    RegistrationOptions known;
    if (known_base) {
      known.known.bases = {{.X_WB = f.robot.truth.frames.base() * Eigen::Translation3d(1e-3, 0.0, 0.0)}};
    }
    const Estimate found = registered(f.model, errors, f.measured, known);
    EXPECT_EQ(found.errors, errors);
    const Eigen::Isometry3d base = known_base ? known.known.bases.front().X_WB : f.robot.truth.frames.base();
    EXPECT_LT((found.frames.base().translation() - base.translation()).norm(), known_base ? 1e-12 : 1e-4);
    EXPECT_LT((found.frames.targets[1].X_FT.translation() - f.robot.truth.frames.targets[1].X_FT.translation()).norm(),
              2e-3);
    EXPECT_EQ(found.effects.size(), 0);
  }
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
  for (const int count : {-1, 0, 1, 3, 15, 16, 100}) {
    for (const std::uint64_t seed : {1U, 8U}) {
      const auto folds = make_folds(measured, count, seed);
      EXPECT_EQ(folds.size(), count < 1 || count > 16 ? 16U : static_cast<std::size_t>(count))
          << "16 places are trained";
      std::map<Eigen::Index, std::size_t> fold_of;
      std::vector<std::size_t> places;
      for (std::size_t i = 0; i < folds.size(); ++i) {
        places.push_back(folds[i].size());
        for (const Eigen::Index c : folds[i]) {
          EXPECT_TRUE(fold_of.emplace(c, i).second) << c << " is in two folds";
          places.back() -= c == 5 || c == 12 ? 1 : 0;  // at the joint values of configuration 2
        }
      }
      EXPECT_EQ(fold_of.size(), 18U);
      EXPECT_EQ(fold_of.count(0) + fold_of.count(16), 0U) << "test rows";
      EXPECT_EQ(fold_of.at(5), fold_of.at(2));
      EXPECT_EQ(fold_of.at(12), fold_of.at(2));
      const auto [least, most] = std::minmax_element(places.begin(), places.end());
      EXPECT_LE(*most - *least, 1U);
      EXPECT_EQ(make_folds(measured, count, seed), folds);
    }
  }
  EXPECT_NE(make_folds(measured, 3, 1), make_folds(measured, 3, 8));
  EXPECT_EQ(make_folds(measured, 3), make_folds(measured, 3, 1));
}

TEST(Validation, FoldsDependOnTheJointValuesAndNotOnTheirOrder) {
  testing::VirtualExperiment experiment;
  const Measurements measured = experiment.measure(30);
  Measurements reversed = measured;
  reversed.joint_values = measured.joint_values.rowwise().reverse();
  std::reverse(reversed.configurations.begin(), reversed.configurations.end());
  for (Observation& o : reversed.observations) {
    o.configuration = 29 - o.configuration;
  }
  auto folds = make_folds(reversed, 7);
  for (std::vector<Eigen::Index>& fold : folds) {
    for (Eigen::Index& c : fold) {
      c = 29 - c;
    }
  }
  EXPECT_EQ(make_folds(measured, 7), folds);
}

TEST(Validation, FoldsCanBeLeftOutWhereAsManyEquationsAsUnknownsStay) {
  testing::VirtualExperiment experiment({.targets = testing::as_frames(published_targets(2))});
  Measurements measured =
      subset(experiment.measure(6), [](const Observation& o) { return !(o.configuration == 5 && o.target == 1); });
  for (Observation& o : measured.observations) {
    o.split = o.configuration == 4 ? Split::test : Split::train;
    if (o.target == 1 && o.configuration < 3) {
      testing::remove_orientation(o);
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
  measured = without_orientations(std::move(measured));
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
  const KDL::Chain chain = error_chain(f.model, refit.errors);
  const Measurements means = averaged(f.measured);
  for (std::size_t i = 0; i < 6; ++i) {
    const Observation& o = means.observations[3 * static_cast<std::size_t>(found.configurations[i]) +
                                              static_cast<std::size_t>(found.targets[i])];
    const Eigen::Vector3d predicted =
        testing::kdl_point(chain, refit, f.measured.joint_values.col(o.configuration), o.target);
    EXPECT_LT((found.residuals[i] - (o.position() - predicted)).norm(), 1e-9);
  }
  problem.options.joint.max_iterations = 1;
  EXPECT_FALSE(refit_without(problem, {9, 4}).converged);
}

TEST(Validation, AgreesWithTheKdlSolver) {
  Random random(3);
  for (const ErrorModel& model : {complete_model(testing::fanuc()), complete_model(parse_robot(testing::kOddArm))}) {
    const Eigen::VectorXd errors = testing::random_errors(model, random, 0.0025, 3.0 * testing::kDegree);
    const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 1000, random);
    EXPECT_LT(difference_to_kdl(model, errors, q), 1e-12);
  }
}

}  // namespace
}  // namespace kdl_calibration::validation_test
