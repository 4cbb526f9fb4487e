#include "planning/simulation.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

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
    base += robot.truth.X_WB.translation().squaredNorm() / 3.0;
    tools += std::pow(robot.truth.targets[0].X_FT.translation().norm() - 0.1, 2);
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
    add_effects(robot, {EffectGroup::gain, EffectGroup::harmonics}, q, 2e-4, random);
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
      const TargetFrame& target = robot.truth.targets[static_cast<std::size_t>(o.target)];
      EXPECT_LT((o.position - robot.truth.X_WB * (X_BF * target.X_FT.translation())).norm(), 1e-12);
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

TEST(Simulation, MeasuresWhatTheKdlSolverSays) {
  const ErrorModel model = complete_model(fanuc());
  Random random(2);
  const VirtualRobot robot = virtual_robot(model, all_parameters(model), published_targets(), {}, random);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 20, random);
  const Measurements measured = measure(robot, q, {}, random);
  ASSERT_EQ(measured.observations.size(), 60U);
  const KDL::Chain chain = error_chain(model, robot.truth.errors);
  for (const Observation& observation : measured.observations) {
    const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(chain, q.col(observation.configuration)));
    const Eigen::Vector3d expected =
        robot.truth.X_WB * X_BF * robot.truth.targets[static_cast<std::size_t>(observation.target)].X_FT.translation();
    EXPECT_LT((observation.position - expected).norm(), 1e-12);
  }
}

TEST(Simulation, NoiseHasTheStatedSigmaAndRepeatsDiffer) {
  const ErrorModel model = complete_model(fanuc());
  Random random(3);
  const VirtualRobot robot = virtual_robot(model, {}, published_targets(), {}, random);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 50, random);
  const Measurements exact = measure(robot, q, {.repeats = 20}, random);
  const Measurements noisy = measure(robot, q, {.sigma = 0.001, .repeats = 20}, random);
  ASSERT_EQ(noisy.observations.size(), 3000U);
  double sum = 0.0;
  for (std::size_t row = 0; row < noisy.observations.size(); ++row) {
    sum += (noisy.observations[row].position - exact.observations[row].position).squaredNorm();
    EXPECT_EQ(noisy.observations[row].sigma, 0.001);
  }
  EXPECT_NEAR(std::sqrt(sum / 9000.0), 0.001, 0.00003);
  EXPECT_EQ(noisy.observations[59].repeat, 20);
}

Eigen::Vector3d three(Random& random) {
  const double x = random.normal();
  const double y = random.normal();
  return {x, y, random.normal()};
}

// Drift, noise along and across the line of sight, turns in the target's own frame: number by number.
TEST(Simulation, MeasuresWithEveryPartOfTheNoise) {
  const ErrorModel model = complete_model(fanuc());
  Random random(12);
  std::vector<TargetFrame> targets = published_targets(2);
  targets[1].with_orientation = true;
  targets[1].X_FT.linear() = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  VirtualRobot robot = virtual_robot(model, all_parameters(model), targets, {}, random);
  robot = placed(robot, Eigen::Translation3d(1.0, 2.0, 3.0) * Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()));
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 3, random);
  const TrackerNoise tracker{.range = 1e-3, .range_per_metre = 2e-3, .transverse = 4e-3, .transverse_per_metre = 5e-3};
  for (const bool by_tracker : {false, true}) {
    MeasuringNoise noise{.sigma = 1e-3, .orientation_sigma = 0.01, .repeats = 2, .common = {1e-3, 2e-3, 3e-3}};
    if (by_tracker) {
      noise.tracker = tracker;
    }
    Random ours(3);
    Random theirs(3);
    const Measurements measured = measure(robot, q, noise, theirs, Split::test);
    ASSERT_EQ(measured.observations.size(), 12U);
    ASSERT_EQ(measured.orientations.size(), 12U);
    EXPECT_EQ(measured.configurations, (std::vector<std::string>{"1", "2", "3"}));
    EXPECT_EQ(measured.source, "simulation");
    const KDL::Chain chain = error_chain(model, robot.truth.errors);
    std::size_t row = 0;
    for (int c = 0; c < 3; ++c) {
      const Eigen::Isometry3d X_WF = robot.truth.X_WB * to_eigen(testing::kdl_pose(chain, q.col(c)));
      for (int repeat = 1; repeat <= 2; ++repeat) {
        const Eigen::Vector3d drift = noise.common.cwiseProduct(three(ours));
        for (int t = 0; t < 2; ++t, ++row) {
          const Eigen::Isometry3d X_WT = X_WF * robot.truth.targets[static_cast<std::size_t>(t)].X_FT;
          const Eigen::Vector3d normal = three(ours);
          Eigen::Vector3d own = 1e-3 * normal;
          if (by_tracker) {
            const double distance = X_WT.translation().norm();
            const Eigen::Matrix3d along = X_WT.translation() * X_WT.translation().transpose() / (distance * distance);
            own =
                ((1e-3 + 2e-3 * distance) * along + (4e-3 + 5e-3 * distance) * (Eigen::Matrix3d::Identity() - along)) *
                normal;
          }
          const Observation& o = measured.observations[row];
          EXPECT_LT((o.position - X_WT.translation() - drift - own).norm(), 1e-12) << row;
          EXPECT_EQ(o.sigma, by_tracker ? 0.0 : 1e-3);
          EXPECT_EQ(o.configuration, c);
          EXPECT_EQ(o.target, t);
          EXPECT_EQ(o.repeat, repeat);
          EXPECT_EQ(o.split, Split::test);
          const Eigen::Vector3d turn = 0.01 * three(ours);
          const Eigen::AngleAxisd rotation(turn.norm(), turn.normalized());
          EXPECT_LT((measured.orientations[row].toRotationMatrix() - X_WT.linear() * rotation).norm(), 1e-12) << row;
        }
      }
    }
    EXPECT_EQ(ours.normal(), theirs.normal()) << "numbers drawn";
  }
}

TEST(Simulation, DrivesTellWhereTheyCameFromAndTheTorquesOfTenKilograms) {
  const ErrorModel model = complete_model(fanuc());
  Random random(3);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 30, random);
  const Eigen::MatrixXd stops = q.rightCols(20);
  const Eigen::MatrixXd before = q.leftCols(10);
  const DrivenConfigurations untold = simulated_signals(model, stops, before, {});
  EXPECT_EQ(untold.joint_values, stops);
  EXPECT_EQ(untold.signals.approach.size() + untold.signals.torques.size(), 0);

  const DrivenConfigurations told =
      simulated_signals(model, stops, before, {.approach = true, .torques = true, .seed = 7});
  for (Eigen::Index j = 0; j < 6; ++j) {
    for (Eigen::Index c = 0; c < 20; ++c) {
      EXPECT_EQ(told.signals.approach(j, c), stops(j, c) > q(j, c + 9) ? 1.0 : -1.0) << j << " " << c;
    }
  }
  EXPECT_TRUE(std::isnan(simulated_signals(model, stops, {}, {.approach = true}).signals.approach(0, 0)));
  const Eigen::MatrixXd gravity = 10.0 * 9.81 * gravity_torques(model, stops);
  Random noise(7 + 10, 2);
  for (Eigen::Index j = 0; j < 6; ++j) {
    const double scatter = std::max(0.1 * gravity.row(j).cwiseAbs().mean(), 1.0);
    for (Eigen::Index c = 0; c < 20; ++c) {
      EXPECT_NEAR(told.signals.torques(j, c), gravity(j, c) + scatter * noise.normal(), 1e-10) << j << " " << c;
    }
  }
  EXPECT_LT(gravity.row(0).cwiseAbs().maxCoeff(), 1e-9) << "the first axis is upright: at least 1 Nm of scatter";
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
  std::vector<std::string> kept;
  std::vector<std::string> behind_the_base;
  for (const ErrorParameter& parameter : model.parameters) {
    const bool is_kept =
        std::find(reduction.kept.begin(), reduction.kept.end(), parameter.name) != reduction.kept.end() ||
        parameter.name == "dq1" || parameter.name == "dq6";
    const bool of_base = parameter.name.size() == 3 && parameter.name[2] == '0';
    if (is_kept) {
      kept.push_back(parameter.name);
    }
    if (!of_base) {
      behind_the_base.push_back(parameter.name);
    }
  }
  EXPECT_EQ(names(false), kept);
  EXPECT_EQ(names(true), behind_the_base);
  EXPECT_EQ(kept.size(), 20U);
  EXPECT_LT(behind_the_base.size(), model.parameters.size());
}

TEST(Simulation, KeepsTheJointLimits) {
  const ErrorModel model = complete_model(fanuc());
  const JointRanges limits = limits_of(model.joints);
  Random random(4);
  const Eigen::MatrixXd q = random_configurations(limits, 2000, random);
  for (Eigen::Index i = 0; i < q.rows(); ++i) {
    const MovingJoint& joint = model.joints[static_cast<std::size_t>(i)];
    EXPECT_GE(q.row(i).minCoeff(), *joint.lower);
    EXPECT_LE(q.row(i).maxCoeff(), *joint.upper);
    EXPECT_GT(q.row(i).maxCoeff() - q.row(i).minCoeff(), 0.98 * (*joint.upper - *joint.lower));
  }
  EXPECT_EQ(published_ranges(model.joints)[3].second, std::numbers::pi / 2.0);
  EXPECT_EQ(published_ranges(model.joints)[4].first, -std::numbers::pi);
}

TEST(Simulation, TheSameSeedGivesTheSameNumbers) {
  const ErrorModel model = complete_model(fanuc());
  const auto run = [&](std::uint64_t seed) {
    Random random(seed);
    const VirtualRobot robot = virtual_robot(model, {2, 8}, published_targets(), {}, random);
    return measure(robot, random_configurations(limits_of(model.joints), 3, random), {.sigma = 0.0001}, random)
        .observations.back()
        .position;
  };
  EXPECT_EQ(run(7), run(7));
  EXPECT_NE(run(7), run(8));
}

TEST(Simulation, JoinsTrainingAndHeldOutMeasurements) {
  const ErrorModel model = complete_model(fanuc());
  Random random(5);
  const VirtualRobot robot = virtual_robot(model, {}, published_targets(2), {}, random);
  const Measurements train = measure(robot, random_configurations(limits_of(model.joints), 4, random), {}, random);
  const Measurements test =
      measure(robot, random_configurations(limits_of(model.joints), 3, random), {}, random, Split::test);
  const Measurements both = joined(train, test);
  EXPECT_EQ(both.joint_values.cols(), 7);
  EXPECT_EQ(both.observations.size(), 14U);
  EXPECT_EQ(both.observations[8].configuration, 4);
  EXPECT_EQ(both.observations[8].split, Split::test);
  EXPECT_EQ(both.joint_values.col(5), test.joint_values.col(1));
}

}  // namespace
}  // namespace kdl_calibration::simulation_test
