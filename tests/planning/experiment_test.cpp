#include "planning/experiment.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>

#include "effects/effect_terms.hpp"
#include "estimation/prediction.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/kinematics.hpp"
#include "planning/point_rows.hpp"
#include "planning/simulation.hpp"
#include "support.hpp"
#include "two_step/matrix_derivatives.hpp"
#include "uncertainty/covariance.hpp"
#include "uncertainty/observability.hpp"

namespace kdl_calibration::experiment_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

std::vector<TargetFrame> two_targets() { return testing::targets_at({{0.1, 0.2, 0.03}, {-0.05, 0.15, 0.1}}); }

struct Fixture {
  ErrorModel model = complete_model(testing::fanuc());
  Experiment experiment = nominal_experiment(model, two_targets(), {.sigma = 5e-5});
  Random random{4};

  MatrixXd configurations(int count) { return random_configurations(published_ranges(model.joints), count, random); }

  Measurements measured(const MatrixXd& q, double sigma) {
    VirtualRobot robot{.model = model, .truth = nominal()};
    return measure(robot, q, {.sigma = sigma}, random);
  }
  Estimate nominal() const {
    return {.errors = experiment.errors, .frames = {.targets = experiment.targets}, .effects = {}};
  }
};

// Motion of the targets' points per unit of each free parameter, in the flange frame.
MatrixXd point_jacobian(const Experiment& experiment, const Eigen::VectorXd& q) {
  const PointRows rows(experiment);
  return rows.rows(rows.points(), q);
}

// The points' Jacobian in the tracker's frame by products of 4x4 matrices.
MatrixXd jacobian_by_matrices(const Experiment& experiment, const Eigen::VectorXd& q) {
  const KDL::Frame flange = testing::kdl_pose(testing::fanuc().chain, q);
  MatrixXd J = MatrixXd::Zero(6, columns(experiment));
  for (Index t = 0; t < 2; ++t) {
    const Eigen::Vector3d point = experiment.targets[static_cast<std::size_t>(t)].X_FT.translation();
    const Eigen::Vector3d p = to_eigen(flange) * point;
    const auto geometric = static_cast<Index>(experiment.free.geometric().size());
    auto rows = J.middleRows(3 * t, 3);
    rows.leftCols(3).setIdentity();
    rows.middleCols(3, 3) = -skew(p);
    const std::vector<ChainFactor> factors = chain_factors(experiment.model);
    rows.middleCols(6, geometric) =
        point_columns(factors, matrix_product(factors, experiment.errors, q), experiment.free.geometric(), point);
    rows.middleCols(6 + geometric + 3 * t, 3) = to_eigen(flange).linear();
  }
  return J;
}

TEST(Experiment, LinearisesAsProductsOfMatricesDo) {
  Fixture f;
  ASSERT_EQ(columns(f.experiment), 30);  // 6 base, 18 geometric, 6 of targets
  const MatrixXd q = f.configurations(5);
  for (Index c = 0; c < q.cols(); ++c) {
    const MatrixXd expected = jacobian_by_matrices(f.experiment, q.col(c));
    // Ours are in the flange frame: the same inner products.
    const MatrixXd ours = point_jacobian(f.experiment, q.col(c));
    EXPECT_LT((ours.transpose() * ours - expected.transpose() * expected).cwiseAbs().maxCoeff(), 1e-10);
  }
}

TEST(Experiment, EffectsMoveThePointsAsTheirMotionsOfTheJointsDo) {
  Fixture f;
  const MatrixXd q = f.configurations(60);
  for (const EffectGroup group : {EffectGroup::gravity, EffectGroup::transverse, EffectGroup::harmonics}) {
    const std::vector<EffectTerm> terms = effect_terms(f.model, group, q);
    f.experiment.model.effects.insert(f.experiment.model.effects.end(), terms.begin(), terms.end());
  }
  f.experiment.free = f.experiment.free.with_group(f.experiment.model, UnknownGroup::effects);
  const auto terms = static_cast<Index>(f.experiment.model.effects.size());
  ASSERT_GT(terms, 50);
  for (const Index c : {Index{0}, Index{7}}) {
    const MatrixXd differences = testing::central_differences(terms, 1e-5, [&](const Eigen::VectorXd& step) {
      Estimate moved = f.nominal();
      moved.effects = step;
      const Eigen::Isometry3d X_BF = flange_poses(f.experiment.model, moved, q.col(c)).front();
      Eigen::VectorXd points(6);
      points << X_BF * moved.frames.targets[0].X_FT.translation(), X_BF * moved.frames.targets[1].X_FT.translation();
      return points;
    });
    // Ours are in the flange frame.
    const Eigen::Matrix3d R = to_eigen(testing::kdl_pose(testing::fanuc().chain, q.col(c))).linear();
    const MatrixXd ours =
        point_jacobian(f.experiment, q.col(c)).middleCols(f.experiment.free.range(UnknownGroup::effects).first, terms);
    EXPECT_LT((R * ours.topRows(3) - differences.topRows(3)).cwiseAbs().maxCoeff(), 1e-8);
    EXPECT_LT((R * ours.bottomRows(3) - differences.bottomRows(3)).cwiseAbs().maxCoeff(), 1e-8);
  }
}

TEST(Experiment, HasTheInformationOfTheLeastSquaresProblem) {
  Fixture f;
  f.experiment.priors = {.length = 1e-3, .angle = 2e-3};
  const MatrixXd q = f.configurations(8);
  const Measurements measurements = f.measured(q, 5e-5);
  const LeastSquaresProblem problem(f.model, measurements, f.experiment.free, {.priors = f.experiment.priors});
  const MatrixXd expected = problem.linearise(f.nominal()).hessian;
  const MatrixXd from_design = prior_information(f.experiment) + information(f.experiment, q);
  const MatrixXd from_file = prior_information(f.experiment) + information(f.experiment, measurements);
  EXPECT_LT((from_design - expected).norm(), 1e-9 * expected.norm());
  EXPECT_LT((from_file - expected).norm(), 1e-9 * expected.norm());
}

TEST(Experiment, CountsOnlyWhatWasMeasuredToTrain) {
  Fixture f;
  const MatrixXd q = f.configurations(6);
  Measurements measurements = f.measured(q, 0.0);  // states no sigma: the experiment's counts
  measurements.observations[0].split = Split::test;
  measurements.observations.erase(measurements.observations.begin() + 5);
  measurements.observations.push_back(measurements.observations[3]);
  measurements.observations.back().repeat = 2;
  Measurements stated = measurements;
  for (Observation& observation : stated.observations) {
    observation.sigma = f.experiment.noise.sigma;
  }
  const LeastSquaresProblem problem(f.model, stated, f.experiment.free);
  const MatrixXd expected = problem.linearise(f.nominal()).hessian;
  EXPECT_LT((information(f.experiment, measurements) - expected).norm(), 1e-9 * expected.norm());
  measurements.targets[1] = "Z";
  EXPECT_THAT([&] { information(f.experiment, measurements); },
              ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("target 'Z' is not a target")));
}

TEST(Experiment, WhitensNoiseThatTargetsShare) {
  Fixture f;
  f.experiment.noise.configuration_sigma = 8e-5;
  const MatrixXd q = f.configurations(3);
  MatrixXd covariance = MatrixXd::Identity(6, 6) * 25e-10;
  for (Index i = 0; i < 6; ++i) {
    for (Index j = 0; j < 6; ++j) {
      covariance(i, j) += i % 3 == j % 3 ? 64e-10 : 0.0;
    }
  }
  MatrixXd expected = MatrixXd::Zero(30, 30);
  for (Index c = 0; c < 3; ++c) {
    const MatrixXd J = point_jacobian(f.experiment, q.col(c));
    expected += J.transpose() * covariance.inverse() * J;
  }
  EXPECT_LT((information(f.experiment, q) - expected).norm(), 1e-9 * expected.norm());
  const Measurements measurements = f.measured(q, 0.0);
  EXPECT_LT((information(f.experiment, measurements) - expected).norm(), 1e-9 * expected.norm());
}

// A tracker whose noise depends on direction and distance.
TEST(Experiment, KnowsATrackersNoiseFromWhereItStands) {
  Fixture f;
  f.experiment.noise = {
      .configuration_sigma = 2e-5,
      .tracker = TrackerNoise{.range = 1e-5, .range_per_metre = 1e-6, .transverse = 4e-5, .transverse_per_metre = 8e-6},
      .tracker_position = {4.0, -1.0, 0.5}};
  const TrackerNoise& tracker = *f.experiment.noise.tracker;
  const MatrixXd q = f.configurations(8);
  MatrixXd expected = MatrixXd::Zero(30, 30);
  for (Index c = 0; c < q.cols(); ++c) {
    const MatrixXd J = jacobian_by_matrices(f.experiment, q.col(c));  // along the axes of the base
    MatrixXd covariance(6, 6);
    for (Index t = 0; t < 2; ++t) {
      const Eigen::Vector3d point = to_eigen(testing::kdl_pose(testing::fanuc().chain, q.col(c))) *
                                    f.experiment.targets[static_cast<std::size_t>(t)].X_FT.translation();
      const Eigen::Vector3d sight = point - f.experiment.noise.tracker_position;
      const Eigen::Matrix3d along = sight * sight.transpose() / sight.squaredNorm();
      const double range = tracker.range + tracker.range_per_metre * sight.norm();
      const double transverse = tracker.transverse + tracker.transverse_per_metre * sight.norm();
      for (Index other = 0; other < 2; ++other) {
        covariance.block<3, 3>(3 * t, 3 * other) = 4e-10 * Eigen::Matrix3d::Identity();
      }
      covariance.block<3, 3>(3 * t, 3 * t) +=
          range * range * along + transverse * transverse * (Eigen::Matrix3d::Identity() - along);
    }
    expected += J.transpose() * covariance.inverse() * J;
  }
  EXPECT_LT((information(f.experiment, q) - expected).norm(), 1e-9 * expected.norm());

  // In a file the tracker may stand anywhere: it is found.
  VirtualRobot robot{.model = f.model, .truth = f.nominal()};
  robot.truth.frames.base() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()) *
                              Eigen::Translation3d(-f.experiment.noise.tracker_position);
  const Measurements measurements = measure(robot, q, {}, f.random);
  EXPECT_LT((information(f.experiment, measurements) - expected).norm(), 1e-6 * expected.norm());
}

TEST(Experiment, PredictsWhatTheCovarianceOfAFitSays) {
  Fixture f;
  const MatrixXd q = f.configurations(12);
  const MatrixXd elsewhere = f.configurations(70);
  const LeastSquaresProblem problem(f.model, f.measured(q, 5e-5), f.experiment.free);
  const MatrixXd C = covariance(problem.whitened(f.nominal()).jacobian, 1.0);
  std::vector<double> sigmas;
  double worst = 0.0;
  for (Index c = 0; c < elsewhere.cols(); ++c) {
    const MatrixXd J = jacobian_by_matrices(f.experiment, elsewhere.col(c));
    const Eigen::VectorXd variances = (J * C * J.transpose()).diagonal();
    sigmas.push_back(std::sqrt(variances.head(3).sum()));
    sigmas.push_back(std::sqrt(variances.tail(3).sum()));
    worst = std::max(worst, std::sqrt(variances.sum() / 2.0));
  }
  const ErrorStatistics expected = error_statistics(sigmas);
  const Prediction ours = predicted(f.experiment, information(f.experiment, q), elsewhere);
  EXPECT_EQ(ours.sigma.count, 140);
  EXPECT_NEAR(ours.sigma.mean / expected.mean, 1.0, 1e-6);
  EXPECT_NEAR(ours.sigma.rms / expected.rms, 1.0, 1e-6);
  EXPECT_NEAR(ours.sigma.p95 / expected.p95, 1.0, 1e-6);
  EXPECT_NEAR(ours.sigma.max / expected.max, 1.0, 1e-6);
  EXPECT_NEAR(ours.worst_configuration / worst, 1.0, 1e-6);
}

TEST(Experiment, PromisesNothingWhereParametersAreNotDetermined) {
  Fixture f;
  const MatrixXd few = information(f.experiment, f.configurations(4));
  const MatrixXd enough = information(f.experiment, f.configurations(12));
  const std::vector<Prediction> both = predicted(f.experiment, std::vector<MatrixXd>{few, enough}, f.configurations(3));
  for (const double none : {both[0].sigma.mean, both[0].sigma.rms, both[0].sigma.p95, both[0].sigma.max}) {
    EXPECT_TRUE(std::isinf(none));
  }
  EXPECT_TRUE(std::isinf(both[0].worst_configuration));
  EXPECT_TRUE(std::isfinite(both[1].sigma.max));
  EXPECT_GT(both[1].sigma.mean, 0.0);
}

TEST(Experiment, StatesTheFloorOfTheEquivalenceTheorem) {
  const ErrorModel model = complete_model(testing::fanuc());
  const Experiment experiment = nominal_experiment(model, generic_targets(3), {.sigma = 3e-5});
  EXPECT_EQ(columns(experiment), 33);
  EXPECT_NEAR(floor_of_worst_configuration(experiment, 30), 0.0182e-3, 0.00005e-3);
}

TEST(Experiment, ComputesTheFiveObservabilityIndices) {
  Fixture f;
  const MatrixXd q = f.configurations(9);
  MatrixXd stacked(9 * 6, 30);
  for (Index c = 0; c < 9; ++c) {
    stacked.middleRows(6 * c, 6) = jacobian_by_matrices(f.experiment, q.col(c));
  }
  const Eigen::VectorXd s = Eigen::JacobiSVD<MatrixXd>(stacked).singularValues();
  const ObservabilityIndices o = observability_indices(f.experiment, q);
  EXPECT_NEAR(o.O1, std::pow(s.prod(), 1.0 / 30.0) / 3.0, 1e-9);
  EXPECT_NEAR(o.O2, s[29] / s[0], 1e-10);
  EXPECT_NEAR(o.O3, s[29], 1e-10);
  EXPECT_NEAR(o.O4, s[29] * s[29] / s[0], 1e-10);
  EXPECT_NEAR(o.O5, 1.0 / (1.0 / s.array()).sum(), 1e-10);
}

TEST(Experiment, MatchesTheTargetsOfAFileByName) {
  Fixture f;
  const MatrixXd q = f.configurations(8);
  Measurements measurements = f.measured(q, 5e-5);
  const MatrixXd expected = information(f.experiment, measurements);
  std::swap(measurements.targets[0], measurements.targets[1]);
  for (Observation& observation : measurements.observations) {
    observation.target = 1 - observation.target;
  }
  // Orientations are not what is planned for.
  testing::set_orientations(measurements, Orientation(0.6, 0.8, 0.0, 0.0));
  EXPECT_LT((information(f.experiment, measurements) - expected).norm(), 1e-9 * expected.norm());
}

TEST(Experiment, IsOfPointsAlone) {
  const ErrorModel model = complete_model(testing::fanuc());
  std::vector<TargetFrame> targets = two_targets();
  targets[0].with_orientation = true;
  const Experiment experiment = nominal_experiment(model, targets);
  EXPECT_TRUE(experiment.free.column("base.Ty") && experiment.free.column("A.x"));
  EXPECT_FALSE(experiment.free.column("A.Rx"));
  EXPECT_FALSE(experiment.targets[0].with_orientation);
}

TEST(Experiment, RefusesNoTargetsAndNoNoise) {
  const ErrorModel model = complete_model(testing::fanuc());
  EXPECT_THROW(nominal_experiment(model, {}), InputError);
  EXPECT_THROW(nominal_experiment(model, two_targets(), {.sigma = 0.0}), InputError);
  EXPECT_THROW(nominal_experiment(model, two_targets(), {.configuration_sigma = -1e-9}), InputError);
  EXPECT_EQ(nominal_experiment(model, two_targets(), {.configuration_sigma = 0.0}).targets.size(), 2U);
}

TEST(Experiment, RefusesWhatDoesNotHoldTogetherWhereverItIsUsed) {
  const Experiment good = nominal_experiment(complete_model(testing::fanuc()), two_targets());
  const Eigen::MatrixXd q = Eigen::MatrixXd::Constant(6, 4, 0.3);
  EXPECT_NO_THROW(information(good, q));
  Experiment priors = good;
  priors.priors.angle = -1e-3;
  EXPECT_THROW(information(priors, q), InputError);
  Experiment noise = good;
  noise.noise.sigma = std::nan("");
  EXPECT_THROW(information(noise, q), InputError);
  Experiment errors = good;
  errors.errors.conservativeResize(3);
  EXPECT_THROW(information(errors, q), InputError);
  Experiment model = good;
  model.model.parameters.front().frame = 8;
  EXPECT_THROW(information(model, q), InputError);
}

}  // namespace
}  // namespace kdl_calibration::experiment_test
