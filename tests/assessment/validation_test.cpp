#include "kdl_calibration/validation.hpp"
#include "kdl_calibration/joint_ranges.hpp"

#include <gmock/gmock.h>

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

  explicit Fixture(int repeats = 1) : measured(measure(20, {.sigma = 0.00003, .repeats = repeats})) {}
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
