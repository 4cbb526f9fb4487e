#include "planning/simulation.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>

#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/drive_signals.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::simulation_test {
namespace {

using testing::all_parameters;
using testing::fanuc;

TEST(Simulation, DrawsErrorsOfTheStatedSizes) {
  const ErrorModel model = complete_model(fanuc());
  Random random(1);
  double lengths = 0.0;
  double angles = 0.0;
  double base = 0.0;
  double tools = 0.0;
  int length_count = 0;
  int angle_count = 0;
  const int draws = 400;
  for (int i = 0; i < draws; ++i) {
    const VirtualRobot robot = virtual_robot(model, all_parameters(model), published_targets(), {}, random);
    for (std::size_t p = 0; p < model.parameters.size(); ++p) {
      const double error = robot.truth.errors[static_cast<Eigen::Index>(p)];
      (is_length(model, model.parameters[p]) ? lengths : angles) += error * error;
      ++(is_length(model, model.parameters[p]) ? length_count : angle_count);
    }
    base += robot.truth.frames.base().translation().squaredNorm() / 3.0;
    tools += std::pow(robot.truth.frames.targets[0].X_FT.translation().norm() - 0.1, 2);
  }
  EXPECT_NEAR(std::sqrt(lengths / length_count), 0.0025, 0.0025 * 0.03);
  EXPECT_NEAR(std::sqrt(angles / angle_count), 3.0 * testing::kDegree, 3.0 * testing::kDegree * 0.03);
  EXPECT_NEAR(std::sqrt(base / draws), 0.002, 0.002 * 0.07);
  EXPECT_NEAR(std::sqrt(tools / draws), 0.0025, 0.0025 * 0.12);
}

TEST(Simulation, DrawsEffectsOfTheStatedSizeAndMeasuresWithThem) {
  const ErrorModel model = complete_model(fanuc());
  Random random(2);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 100, random);
  double squares = 0.0;
  double count = 0.0;
  for (int i = 0; i < 60; ++i) {
    VirtualRobot robot = virtual_robot(model, all_parameters(model), published_targets(), {}, random);
    add_effects(robot, {EffectGroup::gain, EffectGroup::harmonics}, {.joint_values = q}, 2e-4, random);
    ASSERT_EQ(robot.model.effects.size(), static_cast<std::size_t>(robot.truth.effects.size()));
    squares += robot.truth.effects.squaredNorm();
    count += static_cast<double>(robot.truth.effects.size());
    if (i > 0) {
      continue;
    }
    const auto is_of = [&](EffectGroup group) {
      return std::count_if(robot.model.effects.begin(), robot.model.effects.end(),
                           [&](const EffectTerm& term) { return term.group() == group && term.sigma == 2e-4; });
    };
    EXPECT_EQ(is_of(EffectGroup::gain), 6);
    EXPECT_EQ(is_of(EffectGroup::harmonics), 24);
    const Measurements measured = measure(robot, q, {}, random);
    const KDL::Chain chain = error_chain(model, robot.truth.errors);
    const Eigen::MatrixXd moved = effective_joint_values(robot.model, robot.truth.effects, q);
    EXPECT_GT((moved - q).cwiseAbs().maxCoeff(), 1e-4);
    for (const Observation& o : measured.observations) {
      const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(chain, moved.col(o.configuration)));
      const TargetFrame& target = robot.truth.frames.targets[static_cast<std::size_t>(o.target)];
      EXPECT_LT((o.position() - robot.truth.frames.base() * (X_BF * target.X_FT.translation())).norm(), 1e-12);
    }
    EXPECT_EQ(measured.joint_values, q) << "the controller's values do not know of it";
  }
  EXPECT_NEAR(std::sqrt(squares / count), 2e-4, 2e-4 * 0.06);  // of 1,800
}

TEST(Simulation, PublishedToolsAreThoseOfThePublication) {
  const auto targets = published_targets();
  ASSERT_EQ(targets.size(), 3U);
  EXPECT_EQ(targets[0].X_FT.translation(), Eigen::Vector3d(0.1, 0.0, 0.0));
  EXPECT_EQ(targets[1].X_FT.translation(), Eigen::Vector3d(0.0, 0.0, 0.1));
  EXPECT_EQ(targets[2].X_FT.translation(), Eigen::Vector3d(0.0707, 0.0, 0.0707));
  EXPECT_NEAR(published_targets(5)[4].X_FT.translation().norm(), 0.1, 1e-12);
}

// A drift that the points of a repeat share, noise along and across the line of sight, and turns about the true
// orientation, which KDL gives: their joint covariance over many repeats.
TEST(Simulation, RepeatsScatterWithTheCovarianceOfTheirParts) {
  constexpr int kRepeats = 40'000;
  const ErrorModel model = complete_model(fanuc());
  Random random(12);
  std::vector<TargetFrame> targets = published_targets(2);
  targets[1].with_orientation = true;
  targets[1].X_FT.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  VirtualRobot robot = virtual_robot(model, all_parameters(model), targets, {}, random);
  robot = placed(robot, Eigen::Translation3d(1.0, 2.0, 3.0) * Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()));
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 1, random);
  const KDL::Frame flange = testing::kdl_pose(error_chain(model, robot.truth.errors), q.col(0));
  std::vector<Eigen::Isometry3d> X_WT;
  for (const TargetFrame& target : robot.truth.frames.targets) {
    X_WT.push_back(robot.truth.frames.base() * to_eigen(flange) * target.X_FT);
  }
  const TrackerNoise tracker{.range = 1e-3, .range_per_metre = 2e-3, .transverse = 4e-3, .transverse_per_metre = 5e-3};
  for (const bool by_tracker : {false, true}) {
    MeasuringNoise noise{.sigma = 1e-3, .orientation_sigma = 0.01, .repeats = kRepeats, .common = {1e-3, 2e-3, 3e-3}};
    Eigen::MatrixXd expected = Eigen::MatrixXd::Identity(12, 12) * 1e-4;  // two points, then two orientations
    const Eigen::Matrix3d drift = Eigen::Vector3d(1e-6, 4e-6, 9e-6).asDiagonal();
    expected.topLeftCorner(6, 6) = drift.replicate(2, 2);
    for (Eigen::Index t = 0; t < 2; ++t) {
      const Eigen::Vector3d sight = X_WT[static_cast<std::size_t>(t)].translation();
      const Eigen::Matrix3d along = sight * sight.transpose() / sight.squaredNorm();
      const double range = by_tracker ? 1e-3 + 2e-3 * sight.norm() : 1e-3;
      const double transverse = by_tracker ? 4e-3 + 5e-3 * sight.norm() : 1e-3;
      expected.block<3, 3>(3 * t, 3 * t) +=
          range * range * along + transverse * transverse * (Eigen::Matrix3d::Identity() - along);
    }
    if (by_tracker) {
      noise.tracker = tracker;
    }
    const Measurements measured = measure(robot, q, noise, random, Split::test);
    ASSERT_EQ(measured.observations.size(), 2U * kRepeats);
    Eigen::MatrixXd off = Eigen::MatrixXd::Constant(12, kRepeats, std::nan(""));
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      const Observation& o = measured.observations[row];
      const Eigen::Isometry3d& exact = X_WT[static_cast<std::size_t>(o.target)];
      const Eigen::AngleAxisd turn(Eigen::Quaterniond(exact.linear()).conjugate() * testing::orientation_of(o));
      off.col(o.repeat - 1).segment<3>(3 * o.target) = o.position() - exact.translation();
      off.col(o.repeat - 1).segment<3>(6 + 3 * o.target) = turn.angle() * turn.axis();
      ASSERT_TRUE(o.split == Split::test && o.sigma == (by_tracker ? 0.0 : 1e-3)) << row;
    }
    const Eigen::MatrixXd white = expected.llt().matrixL().solve(off);
    const Eigen::MatrixXd scatter = white * white.transpose() / kRepeats;
    // Five times the 1 sigma of an element.
    EXPECT_LT((scatter - Eigen::MatrixXd::Identity(12, 12)).cwiseAbs().maxCoeff(), 5.0 * std::sqrt(2.0 / kRepeats));
    EXPECT_LT(white.rowwise().mean().cwiseAbs().maxCoeff(), 5.0 / std::sqrt(kRepeats));
  }
}

// The scatter of torques is a tenth of their mean, but at least 1 Nm: the first axis is upright.
TEST(Simulation, DrivesTellWhereTheyCameFromAndTheTorquesOfTenKilograms) {
  const ErrorModel model = complete_model(fanuc());
  Random random(3);
  const Eigen::MatrixXd before = random_configurations(limits_of(model.joints), 10, random);
  const Eigen::MatrixXd stops = random_configurations(limits_of(model.joints), 2000, random);
  const DrivenConfigurations untold = simulated_signals(model, stops, before, {});
  EXPECT_EQ(untold.joint_values, stops);
  EXPECT_EQ(untold.signals.approach.size() + untold.signals.torques.size(), 0);

  const DrivenConfigurations told =
      simulated_signals(model, stops, before, {.approach = true, .torques = true, .seed = 7});
  Eigen::MatrixXd from(6, 2000);
  from << before.col(9), stops.leftCols(1999);
  EXPECT_EQ(told.signals.approach, (stops - from).cwiseSign());
  EXPECT_TRUE(std::isnan(simulated_signals(model, stops, {}, {.approach = true}).signals.approach(0, 0)));
  const Eigen::MatrixXd gravity = 10.0 * 9.81 * gravity_torques(model, stops);
  for (Eigen::Index j = 0; j < 6; ++j) {
    const double sigma = std::max(0.1 * gravity.row(j).cwiseAbs().mean(), 1.0);
    const double scatter = (told.signals.torques - gravity).row(j).norm() / std::sqrt(2000.0);
    EXPECT_NEAR(scatter / sigma, 1.0, 5.0 / std::sqrt(2.0 * 2000.0)) << j;
  }
  EXPECT_LT(gravity.row(0).cwiseAbs().maxCoeff(), 1e-9);
}

TEST(Simulation, FurtherToolsLieOnASphereOfATenthOfAMetre) {
  const std::vector<TargetFrame> generic = generic_targets(5);
  const std::vector<TargetFrame> published = published_targets(5);
  for (std::size_t k = 3; k < 5; ++k) {
    const Eigen::Vector3d direction = generic[k].X_FT.translation().normalized();
    EXPECT_LT((published[k].X_FT.translation() - 0.1 * direction).norm(), 1e-15) << k;
    EXPECT_EQ(published[k].name, generic[k].name);
  }
}

TEST(Simulation, TrueErrorsAreOfWhatIsKeptAndTheGaugeOrOfAllButTheBaseLink) {
  const ErrorModel model = complete_model(fanuc());
  const Reduction reduction = reduced_model(model, published_targets());
  const auto names = [&](bool complete) {
    std::vector<std::string> result;
    for (const std::size_t p : with_true_errors(model, reduction, complete)) {
      result.push_back(model.parameters[p].name);
    }
    return result;
  };
  std::set<std::string> kept = {"dq1", "dq6"};
  std::copy_if(reduction.kept.begin(), reduction.kept.end(), std::inserter(kept, kept.end()),
               [](const std::string& name) { return name.find('.') == std::string::npos; });
  EXPECT_EQ(kept.size(), 20U);
  EXPECT_THAT(names(false), ::testing::UnorderedElementsAreArray(kept));
  EXPECT_EQ(names(true).size(), 30U);
  EXPECT_THAT(names(true), ::testing::Each(::testing::Not(::testing::EndsWith("0"))));
}

TEST(Simulation, TheSameSeedGivesTheSameNumbers) {
  const ErrorModel model = complete_model(fanuc());
  const auto run = [&](std::uint64_t seed) {
    Random random(seed);
    const VirtualRobot robot = virtual_robot(model, {2, 8}, published_targets(), {}, random);
    return measure(robot, random_configurations(limits_of(model.joints), 3, random), {.sigma = 0.0001}, random)
        .observations.back()
        .position();
  };
  EXPECT_EQ(run(7), run(7));
  EXPECT_NE(run(7), run(8));
}

}  // namespace
}  // namespace kdl_calibration::simulation_test
