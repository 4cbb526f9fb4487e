#include "calibration/predicted_accuracy.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <string>

#include "calibration/new_point.hpp"
#include "estimation/prediction.hpp"
#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "planning/simulation.hpp"
#include "uncertainty/covariance.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::predicted_accuracy_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The truth as an estimate whose covariance is made up.
struct Uncertain : testing::VirtualExperiment {
  DeterminedFit fit;
  MatrixXd covariance;
  MatrixXd sqrt_information;  // of the candidates
  NoiseReport noise;
  std::vector<HeldOutPoint> held_out;
  double optimism = 1.0;
  MatrixXd assumed;
  std::vector<PlausibleModel> plausible;
  Configurations asked;

  explicit Uncertain(int count_of_targets)
      : VirtualExperiment({.targets = published_targets(count_of_targets), .random = Random(4)}) {
    fit.identification.estimate = robot.truth;
    fit.free = free;
    fit.candidates = free;
    Random numbers(5);
    const MatrixXd root = MatrixXd::NullaryExpr(free.size(), free.size(), [&] { return 1e-5 * numbers.normal(); });
    covariance = root * root.transpose();
    assumed = MatrixXd(free.size(), 0);
    sqrt_information = MatrixXd::Identity(free.size(), free.size());
    noise.source = NoiseSource::residuals;
    noise.degrees_of_freedom = 20.0;
    noise.independent.setConstant(3e-5);
    noise.misfit = 2e-5;
  }

  PredictedAccuracy predicted(const Measurements& measured) const {
    return predicted_accuracy({.model = model,
                               .fit = fit,
                               .covariance = covariance,
                               .candidate_sqrt_information = sqrt_information,
                               .noise = noise,
                               .held_out = held_out,
                               .optimism = optimism,
                               .assumed = assumed,
                               .plausible = plausible},
                              TrainingRows(measured), asked);
  }

  void ask(const MatrixXd& q) {
    asked.joint_values = q;
    for (Index c = 0; c < q.cols(); ++c) {
      asked.names.push_back("asked " + std::to_string(c));
    }
  }
};

TEST(PredictedAccuracy, OfAskedPointsIsThatOfTheirColumnsAndOfANewPoint) {
  Uncertain u(3);
  u.optimism = 1.4;
  const Measurements measured = u.measure(12);
  MatrixXd asked(6, 3);
  asked << measured.joint_values.leftCols(2), measured.joint_values.col(2);
  asked(3, 2) = 20.0;  // nowhere near
  u.ask(asked);
  const PredictedAccuracy found = u.predicted(measured);
  EXPECT_EQ(found.region.radius_factor, 1.4);
  ASSERT_EQ(found.asked.size(), 9U);
  const Estimate& truth = u.robot.truth;
  const PositionPredictor predictor(u.model, truth, u.free);
  const KDL::Chain chain = error_chain(u.model, truth.errors);
  for (std::size_t i = 0; i < 9; ++i) {
    const AskedPoint& point = found.asked[i];
    const auto c = static_cast<Index>(i / 3);
    SCOPED_TRACE(point.configuration + " " + point.target);
    EXPECT_EQ(point.configuration, "asked " + std::to_string(c));
    EXPECT_EQ(point.target, truth.frames.targets[i % 3].name);
    const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(chain, asked.col(c)));
    const Vector3d place = X_BF * truth.frames.targets[i % 3].X_FT.translation();
    EXPECT_LT((point.position - place).norm(), 1e-12);
    EXPECT_LT((point.position_W - truth.frames.base() * place).norm(), 1e-12);
    const KDL::Chain nominal = error_chain(u.model, Eigen::VectorXd::Zero(truth.errors.size()));
    EXPECT_LT((point.nominal -
               to_eigen(testing::kdl_pose(nominal, asked.col(c))) * truth.frames.targets[i % 3].X_FT.translation())
                  .norm(),
              1e-12);
    const Matrix3Xd J = predictor.jacobians(asked.col(c))[i % 3];
    const Eigen::Matrix3d P = J * u.covariance * J.transpose();
    EXPECT_LT((point.std - P.diagonal().cwiseSqrt()).norm(), 1e-9 * point.std.norm());
    EXPECT_NEAR(point.sigma, std::sqrt(P.trace()), 1e-9 * point.sigma);
    const NewPoint fresh = new_point({.covariance = P, .place = truth.frames.base() * place}, new_point_noise(u.noise));
    EXPECT_NEAR(point.radius_95, 1.4 * fresh.radius_95, 1e-9 * point.radius_95);
    EXPECT_EQ(point.degrees_of_freedom, fresh.degrees_of_freedom);
    EXPECT_EQ(point.outside, c == 2);
  }
}

// Models whose points are all moved by the same length, three times and half as likely as the chosen one.
TEST(PredictedAccuracy, RadiiHoldModelsThatMayBeTrue) {
  Uncertain u(2);
  const Measurements measured = u.measure(12);
  u.ask(measured.joint_values);
  const PredictedAccuracy before = u.predicted(measured);
  EXPECT_EQ(before.region.unproved, 0.0);
  const auto moved = [&](double length, double odds) {
    Estimate estimate = u.robot.truth;
    estimate.frames.base().translation() += length * Vector3d(2.0, -1.0, 2.0) / 3.0;
    return PlausibleModel{.model = u.model, .estimate = estimate, .odds = odds};
  };
  u.plausible = {moved(0.0, 1.0), moved(1e-4, 3.0), moved(2e-4, 0.5)};
  const PredictedAccuracy found = u.predicted(measured);
  const double expected = std::sqrt((3.0 * 1e-8 + 0.5 * 4e-8) / 4.5);
  EXPECT_NEAR(found.region.unproved, expected, 1e-12);
  const PositionPredictor predictor(u.model, u.robot.truth, u.free);
  for (std::size_t i = 0; i < found.asked.size(); ++i) {
    const Matrix3Xd J = predictor.jacobians(u.asked.joint_values.col(static_cast<Index>(i / 2)))[i % 2];
    const Eigen::Matrix3d sum =
        J * u.covariance * J.transpose() + expected * expected / 3.0 * Eigen::Matrix3d::Identity();
    const NewPoint fresh = new_point({.covariance = sum, .place = found.asked[i].position_W}, new_point_noise(u.noise));
    EXPECT_NEAR(found.asked[i].radius_95, fresh.radius_95, 1e-9 * fresh.radius_95);
    EXPECT_GT(found.asked[i].radius_95, before.asked[i].radius_95);
    EXPECT_EQ(found.asked[i].sigma, before.asked[i].sigma) << "of the parameters alone";
  }
}

// What moves only where radii do not hold is not counted.
TEST(PredictedAccuracy, OtherModelsCountWhereRadiiHold) {
  Uncertain u(1);
  const Measurements measured = u.measure(12);
  Estimate other = u.robot.truth;
  other.errors[0] += 1e-3;
  u.plausible = {{.model = u.model, .estimate = u.robot.truth, .odds = 1.0},
                 {.model = u.model, .estimate = other, .odds = 1.0}};
  const double everywhere = u.predicted(measured).region.unproved;
  Measurements near = measured;
  for (Index c = 0; c < near.joint_values.cols(); ++c) {
    near.joint_values.col(c) = measured.joint_values.col(0) + 1e-6 * measured.joint_values.col(c);
  }
  const double there = u.predicted(near).region.unproved;
  const auto distance = [&](const VectorXd& q) {
    const auto point = [&](const Estimate& estimate) {
      return testing::kdl_point(error_chain(u.model, estimate.errors), estimate, q, 0);
    };
    return (point(other) - point(u.robot.truth)).norm();
  };
  EXPECT_NEAR(there, distance(near.joint_values.col(0)) / std::sqrt(2.0), 1e-5 * there);
  EXPECT_NE(everywhere, there);
}

// Test rows are seen from several places: each is compared with its point there.
TEST(PredictedAccuracy, ComparesTestRowsWithThePointsOfTheirStation) {
  testing::Tracker tracker;
  Measurements rows = tracker.measured(60, testing::kNoise);
  for (Observation& row : rows.observations) {
    row.split = row.configuration % 3 == 1 ? Split::test : Split::train;
  }
  const Calibration found = calibrate(testing::bundled_robot(), rows, testing::geometry_alone());
  const TestedRadius& tested = found.parts().fitted->uncertainty.predicted.tested;
  EXPECT_GE(tested.configurations, 10);
  EXPECT_LE(tested.outside, 3);
  EXPECT_GT(tested.p_value, 0.01);
}

// Test rows are moved by a share of the radius of their point.
TEST(PredictedAccuracy, CountsTheTestConfigurationsOutsideTheirRadius) {
  Uncertain u(3);
  Measurements measured = u.measure(60);
  u.ask(measured.joint_values);
  const std::vector<AskedPoint> points = u.predicted(measured).asked;
  for (Observation& o : measured.observations) {
    if (o.configuration < 4) {
      continue;
    }
    const auto at = static_cast<std::size_t>(o.configuration) * 3 + static_cast<std::size_t>(o.target);
    const double share = o.configuration < 8 ? 1.01 : o.configuration == 8 ? 5.0 : 0.99;
    o.split = o.configuration < 12 ? Split::test : Split::train;
    o.position() = points[at].position_W + share * points[at].radius_95 * Eigen::Vector3d(0.6, 0.0, -0.8);
  }
  const TestedRadius tested = u.predicted(measured).tested;
  EXPECT_EQ(tested.outside, 5);
  EXPECT_EQ(tested.configurations, 8);
  EXPECT_NEAR(tested.p_value, 0.0029, 5e-5);  // 5 or more of 8 at 15 %
  EXPECT_EQ(u.predicted(u.measure(12)).tested.configurations, 0);
}

// Left-out configurations are within a third of their radius, test rows within 0.9 of it: none is outside, all are
// worse.
TEST(PredictedAccuracy, TestRowsThatAreWorseThanLeftOutOnesAreSo) {
  Uncertain u(3);
  Measurements measured = u.measure(60);
  u.ask(measured.joint_values);
  const std::vector<AskedPoint> points = u.predicted(measured).asked;
  const auto with_shares = [&](double of_test) {
    u.held_out.clear();
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      Observation& o = measured.observations[row];
      const auto at = static_cast<std::size_t>(o.configuration) * 3 + static_cast<std::size_t>(o.target);
      const double grows = 1.0 + 0.01 * o.configuration;  // no two are alike
      o.split = o.configuration < 12 ? Split::test : Split::train;
      o.position() = points[at].position_W + of_test * grows * points[at].radius_95 * Vector3d(0.6, 0.0, -0.8);
      if (o.split == Split::train && o.configuration < 40) {
        const Matrix3Xd J = PositionPredictor(u.model, u.robot.truth, u.free)
                                .jacobians(measured.joint_values.col(o.configuration))[at % 3];
        u.held_out.push_back({.configuration = o.configuration,
                              .target = o.target,
                              .measured = points[at].position_W,
                              .residual = 0.3 * grows * points[at].radius_95 * Vector3d(0.6, 0.0, -0.8),
                              .covariance = J * u.covariance * J.transpose()});
      }
    }
    return u.predicted(measured).tested;
  };
  const TestedRadius worse = with_shares(0.8);
  EXPECT_EQ(worse.outside, 0);
  EXPECT_LT(worse.p_value, 1e-4);
  EXPECT_EQ(with_shares(0.3).p_value, 1.0);
}

// What the measurements take as true is said by itself, and makes the region larger.
TEST(PredictedAccuracy, SaysThePartOfWhatIsTakenAsTrue) {
  Uncertain u(2);
  const Measurements measured = u.measure(12);
  u.held_out = {{.measured = Eigen::Vector3d::Ones(), .covariance = Eigen::Vector3d(1e-10, 4e-10, 4e-10).asDiagonal()}};
  EXPECT_EQ(u.predicted(measured).of_assumptions, 0.0);
  EXPECT_NEAR(u.predicted(measured).unseen.rms, 3e-5, 1e-15);
  EXPECT_NEAR(u.predicted(measured).region.largest_variance, 9e-10, 1e-20);
  u.assumed = MatrixXd::Constant(u.free.size(), 1, 2e-5);
  const PredictedAccuracy found = u.predicted(measured);
  u.covariance = u.assumed * u.assumed.transpose();
  EXPECT_NEAR(u.predicted(measured).measured.rms, found.of_assumptions, 1e-9 * found.of_assumptions);
  EXPECT_NEAR(found.region.largest_variance, 9e-10 + std::pow(u.predicted(measured).measured.max, 2), 1e-12);
  u.held_out.clear();
  EXPECT_EQ(u.predicted(measured).unseen.rms, u.predicted(measured).measured.rms);
}

TEST(PredictedAccuracy, WhereItWasMeasuredIsThatOfTheFirstThousandConfigurations) {
  Uncertain u(2);
  Measurements measured = u.measure(1003);
  const PredictedAccuracy found = u.predicted(measured);
  const PositionPredictor predictor(u.model, u.robot.truth, u.free);
  std::vector<double> sigmas;
  for (Index c = 0; c < 1000; ++c) {
    for (std::size_t k = 0; k < 2; ++k) {
      const Matrix3Xd J = predictor.jacobians(measured.joint_values.col(c))[k];
      sigmas.push_back(std::sqrt((J * u.covariance * J.transpose()).trace()));
    }
  }
  const ErrorStatistics expected = error_statistics(sigmas);
  EXPECT_EQ(found.measured.count, 2000);
  EXPECT_NEAR(found.measured.rms, expected.rms, 1e-9 * expected.rms);
  EXPECT_NEAR(found.measured.max, expected.max, 1e-9 * expected.max);
  EXPECT_EQ(found.workspace.count, 2000);
  EXPECT_TRUE(found.asked.empty());
  int cells = 0;
  for (const WorkspaceCell& cell : found.cells) {
    cells += cell.count;
  }
  EXPECT_EQ(cells, 1000);
}

TEST(PredictedAccuracy, OfColumnsThatAreNotDeterminedIsOfAskedPointsAlone) {
  Uncertain u(1);
  const Measurements measured = u.measure(5);
  u.ask(measured.joint_values.leftCols(1));
  u.covariance(3, 3) = kInfinity;
  const PredictedAccuracy found = u.predicted(measured);
  EXPECT_EQ(found.asked.size(), 1U);
  EXPECT_EQ(found.measured.count, 0);
  EXPECT_EQ(found.workspace.count, 0);
}

// Base and first joint turn the arm alike: what is open between them moves no point, and a shift beside it moves all.
TEST(PredictedAccuracy, IsInfiniteWhereWhatIsOpenMovesThePointByAMillionth) {
  Uncertain u(1);
  const Measurements measured = u.measure(5);
  u.ask(measured.joint_values.leftCols(1));
  std::vector<std::string> names = u.free.names();
  names.emplace_back("dq1");
  u.fit.candidates = Unknowns(u.model, u.targets, names);
  const Unknowns& candidates = u.fit.candidates;
  const MatrixXd J = PositionPredictor(u.model, u.robot.truth, candidates).jacobians(measured.joint_values.col(0))[0];
  VectorXd open = VectorXd::Zero(candidates.size());
  open[*candidates.column("base.Rz")] = -1.0;
  open[*candidates.column("dq1")] = 1.0;
  // What the base's turn leaves of the joint's is made up for by shifts, so that nothing moves.
  const Vector3d left = J * open;
  for (int axis = 0; axis < 3; ++axis) {
    const Index shift = *candidates.column(std::string("base.T") + "xyz"[axis]);
    open[shift] -= (u.robot.truth.frames.base().linear().transpose() * left)[axis];
  }
  ASSERT_LT((J * open).norm(), 1e-12);
  const double sizes = (J.cwiseAbs() * open.cwiseAbs()).sum();
  for (const double share : {0.0, 0.9e-6, 1.1e-6}) {
    VectorXd moving = open;
    moving[*candidates.column("base.Tx")] += share * sizes;
    moving.normalize();
    u.sqrt_information = MatrixXd::Identity(candidates.size(), candidates.size()) - moving * moving.transpose();
    ASSERT_EQ(undetermined_directions(u.sqrt_information).cols(), 1);
    const PredictedAccuracy found = u.predicted(measured);
    ASSERT_EQ(found.asked.size(), 1U);
    EXPECT_EQ(std::isinf(found.asked[0].sigma), share > 1e-6) << share;
    EXPECT_EQ(std::isinf(found.asked[0].radius_95), share > 1e-6) << share;
  }
}

}  // namespace
}  // namespace kdl_calibration::predicted_accuracy_test
