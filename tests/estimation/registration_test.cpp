#include "estimation/point_registration.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "measurements/readings.hpp"
#include "model/kinematics.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::registration_test {
namespace {

using testing::fanuc;

Eigen::Isometry3d random_placement(Random& random) {
  Eigen::Quaterniond rotation{random.normal(), random.normal(), random.normal(), random.normal()};
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
  X_WB.linear() = rotation.normalized().toRotationMatrix();
  X_WB.translation() = Eigen::Vector3d{random.uniform(-8, 8), random.uniform(-8, 8), random.uniform(-3, 3)};
  return X_WB;
}

std::vector<TargetFrame> random_targets(int count, Random& random) {
  std::vector<TargetFrame> targets = generic_targets(count, random.bits());
  for (TargetFrame& target : targets) {
    target.X_FT.translation() *= 4.0;  // up to 0.8 m off the flange in each direction
  }
  return targets;
}

constexpr ErrorSizes kNoErrors{.length = 0.0, .angle = 0.0, .base_position = 0.0, .target_length = 0.0};

VirtualRobot exact_robot(const ErrorModel& model, int targets, Random& random) {
  const Eigen::Isometry3d X_WB = random_placement(random);
  return placed(virtual_robot(model, {}, random_targets(targets, random), kNoErrors, random), X_WB);
}

/// A robot in random configurations and what is measured of it there.
struct Scene {
  Scene(const VirtualRobot& of, int configurations, Random& random, const MeasuringNoise& noise = {})
      : robot(of),
        q(random_configurations(limits_of(of.model.joints), configurations, random)),
        X_BF(flange_poses(folded(of.model, of.truth.errors), q)),
        measured(measure(of, q, noise, random)) {}

  Registration registered(const RegistrationOptions& options = {}) const {
    return register_base_and_targets(X_BF, measured, options);
  }
  double base_off(const Registration& found) const {
    return (found.frames.base().matrix() - robot.truth.frames.base().matrix()).cwiseAbs().maxCoeff();
  }
  double target_off(const Registration& found, std::size_t k) const {
    return (found.frames.targets[k].X_FT.translation() - robot.truth.frames.targets[k].X_FT.translation()).norm();
  }
  double targets_off(const Registration& found) const {
    double sum = 0.0;
    for (std::size_t k = 0; k < robot.truth.frames.targets.size(); ++k) {
      sum += target_off(found, k);
    }
    return sum;
  }

  VirtualRobot robot;
  Eigen::MatrixXd q;
  std::vector<Eigen::Isometry3d> X_BF;
  Measurements measured;
};

TEST(Registration, FindsBaseAndTargetsExactlyWhereverTheyAre) {
  const ErrorModel model = complete_model(fanuc());
  Random random(1);
  for (int trial = 0; trial < 1000; ++trial) {
    const Scene scene(exact_robot(model, 1 + trial % 4, random), 12, random);
    const Registration found = scene.registered();
    ASSERT_FALSE(found.ambiguous) << trial << ": " << found.message;
    ASSERT_LT(scene.base_off(found), 1e-9) << trial;
    ASSERT_LT(scene.targets_off(found), 1e-9) << trial;
  }
}

// A tracker's frame may be that of a plant: coordinates of ten kilometres have a rounding of two picometres.
TEST(Registration, LosesNothingFarFromTheOrigin) {
  const ErrorModel model = complete_model(fanuc());
  Random random(2);
  for (int trial = 0; trial < 20; ++trial) {
    VirtualRobot robot = exact_robot(model, 3, random);
    robot.truth.frames.base().translation() += Eigen::Vector3d(8e3, -6e3, 40.0);
    const Scene scene(robot, 12, random);
    const Registration found = scene.registered();
    EXPECT_LT((found.frames.base().linear() - robot.truth.frames.base().linear()).cwiseAbs().maxCoeff(), 1e-10)
        << trial;
    EXPECT_LT(scene.targets_off(found), 1e-10) << trial;
  }
}

TEST(Registration, StaysInTheRightBasinWithErrorsOfThePublishedSize) {
  const ErrorModel model = complete_model(fanuc());
  const FoldedChain nominal = folded(model, testing::errors_of(model));
  std::vector<std::size_t> all(model.parameters.size());
  for (std::size_t p = 0; p < all.size(); ++p) {
    all[p] = model.parameters[p].name.back() == '0' ? 0 : p;  // the errors of link 0 would move the base
  }
  Random random(2);
  for (int trial = 0; trial < 1000; ++trial) {
    const Eigen::Isometry3d X_WB = random_placement(random);
    const Scene scene(placed(virtual_robot(model, all, random_targets(3, random), {}, random), X_WB), 30, random);
    const Registration found = register_base_and_targets(flange_poses(nominal, scene.q), scene.measured);
    const Eigen::AngleAxisd off(
        Eigen::Matrix3d(found.frames.base().linear().transpose() * scene.robot.truth.frames.base().linear()));
    ASSERT_LT(off.angle(), 0.6) << trial;
  }
}

/// Flange poses anywhere whose orientations differ by about `spread` [rad], and what is measured with 1 mm of noise of
/// targets A, of which the orientation is measured as well, B, and C.
struct LooseTool {
  LooseTool(double spread, std::uint64_t seed) {
    Random random(seed);
    const auto vector = [&](double size) {
      return Eigen::Vector3d{size * random.normal(), size * random.normal(), size * random.normal()};
    };
    const std::vector<TargetFrame> targets = testing::targets_at({{0.1, 0.2, -0.1}, {-0.2, 0.1, 0.3}, {0.2, 0.0, 0.1}});
    for (const TargetFrame& target : targets) {
      measured.targets.push_back(target.name);
    }
    measured.joint_values = Eigen::MatrixXd::Zero(1, 30);
    for (int c = 0; c < 30; ++c) {
      measured.configurations.push_back(std::to_string(c));
      Eigen::Isometry3d& pose = X_BF.emplace_back(Eigen::Translation3d(vector(1.0)));
      pose.linear() = rotation_exp(vector(spread));
      for (int k = 0; k < 3; ++k) {
        const Eigen::Isometry3d X_WT = X_WB * pose * targets[static_cast<std::size_t>(k)].X_FT;
        measured.observations.push_back(
            {.reading = Point{X_WT.translation() + vector(1e-3)}, .configuration = c, .target = k});
        if (k == 0) {
          testing::set_orientation(measured.observations.back(),
                                   Eigen::Quaterniond(X_WT.linear() * rotation_exp(vector(1e-2))));
        }
      }
    }
  }

  /// What is minimised, with the best orientation of A, no rotation, put in.
  double cost(const Eigen::Isometry3d& base, const std::vector<TargetFrame>& targets, double length,
              double ridge) const {
    const auto weight = [](const Observation& o) { return o.sigma > 0.0 ? 1.0 / (o.sigma * o.sigma) : 1.0; };
    double sum = 0.0;
    std::vector<std::pair<double, Eigen::Matrix3d>> turned;  // weight, and A as the flange and the base state it
    for (const Observation& o : measured.observations) {
      const Eigen::Isometry3d X_WF = base * X_BF[static_cast<std::size_t>(o.configuration)];
      const Eigen::Vector3d& in_flange = targets[static_cast<std::size_t>(o.target)].X_FT.translation();
      sum += weight(o) * (o.position() - X_WF * in_flange).squaredNorm();
      if (length > 0.0 && o.target == 0) {
        turned.emplace_back(weight(o), X_WF.linear().transpose() * o.orientation()->toRotationMatrix());
      }
    }
    Eigen::Matrix3d mean = Eigen::Matrix3d::Zero();
    double weights = 0.0;
    for (const auto& [of_row, R] : turned) {
      mean += of_row * R;
      weights += of_row;
    }
    for (const auto& [of_row, R] : turned) {
      sum += length * length * of_row * (R - mean / weights).squaredNorm();
    }
    for (const TargetFrame& target : targets) {
      sum += ridge * target.X_FT.translation().squaredNorm();
    }
    return sum;
  }

  /// How far base and targets are from the minimum, each coordinate by itself [m] or [rad].
  double off(const Registration& found, double length, double ridge, int free_targets = 3) const {
    double largest = 0.0;
    for (int i = 0; i < 6 + 3 * free_targets; ++i) {
      const auto moved = [&](double step) {
        Eigen::Isometry3d base = found.frames.base();
        std::vector<TargetFrame> targets = found.frames.targets;
        const Eigen::Vector3d along = step * Eigen::Vector3d::Unit(i % 3);
        if (i < 3) {
          base.translation() += along;
        } else if (i < 6) {
          base.linear() = base.linear() * rotation_exp(along);
        } else {
          targets[static_cast<std::size_t>(i / 3 - 2)].X_FT.translation() += along;
        }
        return cost(base, targets, length, ridge);
      };
      const double size = 1e-3;
      const double curvature = moved(size) - 2.0 * moved(0.0) + moved(-size);
      largest = std::max(largest, std::abs(0.5 * size * (moved(size) - moved(-size)) / curvature));
    }
    return largest;
  }

  Eigen::Isometry3d X_WB =
      Eigen::Translation3d(3.0, -2.0, 0.5) * Eigen::AngleAxisd(1.1, Eigen::Vector3d(0.6, 0.0, 0.8));
  std::vector<Eigen::Isometry3d> X_BF;
  Measurements measured;
};

TEST(Registration, WeighsOrientationsByTheirLengthBesidePositions) {
  LooseTool arm(0.8, 21);
  for (const double length : {0.05, 0.3, 2.0}) {
    const Registration found = register_base_and_targets(arm.X_BF, arm.measured, {.orientation_length = length});
    EXPECT_LT(arm.off(found, length, 0.0), 1e-9) << length;
    EXPECT_GT(arm.off(found, 2.0 * length, 0.0), 1e-7) << length;
  }
  for (Observation& o : arm.measured.observations) {
    o.sigma = o.configuration % 3 == 0 ? 0.002 : 0.001;
  }
  EXPECT_LT(arm.off(register_base_and_targets(arm.X_BF, arm.measured), 0.3, 0.0), 1e-9);
  const std::vector<TargetFrame> known = testing::targets_at({{9, 9, 9}, {9, 9, 9}, {0.21, 0.01, 0.1}});
  const Registration found = register_base_and_targets(arm.X_BF, arm.measured, {.known = {.targets = {known[2]}}});
  EXPECT_EQ(found.frames.targets[2].X_FT.translation(), known[2].X_FT.translation());
  EXPECT_LT(arm.off(found, 0.3, 0.0, 2), 1e-9);
}

TEST(Registration, KeepsTargetsNearTheFlangeWhereTheToolHardlyTurns) {
  // Loose where nine times the misfit, 1e-6 m^2, exceeds the information about the place of the base, times (0.1 m)^2.
  for (const double spread : {0.2, 0.05, 0.02, 0.002}) {
    LooseTool arm(spread, 22);
    arm.measured = without_orientations(std::move(arm.measured));
    const Registration found = register_base_and_targets(arm.X_BF, arm.measured);
    const double misfit = found.rms * found.rms / 3.0;
    EXPECT_NEAR(misfit, 1e-6, 0.5e-6) << spread;
    const bool firm = spread > 0.1;
    EXPECT_EQ(found.ambiguous, spread < 0.01) << spread << ": " << found.message;
    EXPECT_EQ(found.message.find("the tool hardly turns") == 0, spread < 0.01) << found.message;
    for (const TargetFrame& target : found.frames.targets) {
      EXPECT_LT(target.X_FT.translation().norm(), 0.7) << spread;
    }
    if (firm) {
      EXPECT_LT(arm.off(found, 0.0, 0.0), 1e-9);
    } else {
      EXPECT_LT(arm.off(found, 0.0, misfit / 0.01), 1e-7) << spread;
      EXPECT_GT(arm.off(found, 0.0, 0.0), 3e-7) << spread;
    }
  }
}

TEST(Registration, FindsMeasuredFrames) {
  const ErrorModel model = complete_model(fanuc());
  Random random(4);
  for (int trial = 0; trial < 50; ++trial) {
    std::vector<TargetFrame> targets = random_targets(1, random);
    targets[0].with_orientation = true;
    targets[0].X_FT.linear() = random_placement(random).linear();
    const Eigen::Isometry3d X_WB = random_placement(random);
    const Scene scene(placed(virtual_robot(model, {}, targets, kNoErrors, random), X_WB), 5, random);
    const Registration found = scene.registered();
    ASSERT_TRUE(found.frames.targets[0].with_orientation);
    ASSERT_LT(scene.base_off(found), 1e-9);
    ASSERT_LT((found.frames.targets[0].X_FT.matrix() - targets[0].X_FT.matrix()).cwiseAbs().maxCoeff(), 1e-9);
  }
}

TEST(Registration, TakesWhatIsKnown) {
  const ErrorModel model = complete_model(fanuc());
  Random random(5);
  const Scene scene(exact_robot(model, 3, random), 2, random);
  const Registration with_base = scene.registered({.known = {.bases = {{.X_WB = scene.robot.truth.frames.base()}}}});
  EXPECT_EQ(scene.base_off(with_base), 0.0);
  EXPECT_LT(scene.target_off(with_base, 1), 1e-12);
  EXPECT_LT(scene.base_off(scene.registered({.known = {.targets = scene.robot.truth.frames.targets}})), 1e-9);
}

TEST(Registration, SaysWhenTheConfigurationsLeaveTheBaseOpen) {
  const ErrorModel model = complete_model(fanuc());
  Random random(6);
  const VirtualRobot robot = exact_robot(model, 1, random);
  Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 1, random).replicate(1, 8);
  q.row(0).setLinSpaced(-1.0, 1.0);  // one joint alone: the target moves on a circle
  const Registration found =
      register_base_and_targets(flange_poses(folded(model, robot.truth.errors), q), measure(robot, q, {}, random));
  EXPECT_TRUE(found.ambiguous);
  EXPECT_FALSE(found.message.empty());
  EXPECT_LT(found.rms, 1e-6);
}

// A tip that is held at one place, to within the arm's errors: nothing tells how the base is turned about it.
TEST(Registration, CountsTheDirectionsThatAreOpen) {
  Random random(8);
  const ErrorModel model = complete_model(fanuc());
  Scene scene(exact_robot(model, 1, random), 9, random);
  EXPECT_EQ(scene.registered().undetermined, 0);
  EXPECT_EQ(scene.registered({.known = {.bases = {{.X_WB = scene.robot.truth.frames.base()}}}}).undetermined, 0);
  for (const double error : {0.0, 1e-6, 1e-3}) {
    for (std::size_t i = 0; i < scene.X_BF.size(); ++i) {
      const Eigen::Vector3d off = error * Eigen::Vector3d{random.normal(), random.normal(), random.normal()};
      scene.X_BF[i].translation() =
          -(scene.X_BF[i].linear() * scene.robot.truth.frames.targets[0].X_FT.translation()) + off;
      scene.measured.observations[i].position() = Eigen::Vector3d(1.0, 2.0, 3.0) - 0.1 * off;
    }
    const Registration found = scene.registered();
    EXPECT_EQ(found.undetermined, 3) << error;
    EXPECT_THAT(found.message, ::testing::HasSubstr("hardly move")) << error;
    EXPECT_LT(scene.targets_off(found), 3.0 * error + 1e-9);
  }
}

TEST(Registration, IgnoresHeldOutRows) {
  const ErrorModel model = complete_model(fanuc());
  Random random(7);
  Scene scene(exact_robot(model, 2, random), 10, random);
  for (Observation& observation : scene.measured.observations) {
    if (observation.configuration == 3) {
      observation.split = Split::test;
      observation.position().x() += 1.0;
    }
  }
  EXPECT_LT(scene.base_off(scene.registered()), 1e-9);
}

/// Configurations and measurements that have nothing to do with each other.
Scene unrelated(const ErrorModel& model, Random& random) {
  Scene scene(exact_robot(model, 1, random), 30, random);
  for (Observation& observation : scene.measured.observations) {
    observation.position() = Eigen::Vector3d{random.normal(), random.normal(), random.normal()};
  }
  return scene;
}

/// What is left with a rotation of the base, as |L (1, vec(R_WB^T))|: all else by one dense factorisation.
class Left {
public:
  explicit Left(const Scene& data) {
    // In the base frame: R_WB^T z - c - R_BF t - p_BF, with c and t free.
    const auto count = static_cast<Eigen::Index>(data.measured.observations.size());
    Eigen::MatrixXd J(3 * count, 16);
    for (Eigen::Index i = 0; i < count; ++i) {
      const Observation& observation = data.measured.observations[static_cast<std::size_t>(i)];
      const Eigen::Isometry3d& X = data.X_BF[static_cast<std::size_t>(observation.configuration)];
      const Eigen::Vector3d& z = observation.position();
      const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
      J.middleRows<3>(3 * i) << I, X.linear(), -X.translation(), z.x() * I, z.y() * I, z.z() * I;
    }
    const Eigen::MatrixXd R = J.householderQr().matrixQR().triangularView<Eigen::Upper>();
    L_ = R.block<10, 10>(6, 6);
  }

  double at(const Eigen::Matrix3d& R_WB) const {
    const Eigen::Matrix3d A = R_WB.transpose();
    Eigen::Matrix<double, 10, 1> values;
    values << 1.0, A.reshaped();
    return (L_ * values).norm();
  }

  /// Turned about single axes by less and less, as long as it becomes less.
  Eigen::Matrix3d downhill(Eigen::Matrix3d R_WB) const {
    double least = at(R_WB);
    for (double angle = 0.2; angle > 1e-3;) {
      bool moved = false;
      for (int side = 0; side < 6; ++side) {
        const Eigen::AngleAxisd turn(side < 3 ? angle : -angle, Eigen::Vector3d::Unit(side % 3));
        const Eigen::Matrix3d turned = R_WB * turn;
        const double value = at(turned);
        if (value < least) {
          R_WB = turned;
          least = value;
          moved = true;
        }
      }
      angle = moved ? angle : 0.5 * angle;
    }
    return R_WB;
  }

private:
  Eigen::Matrix<double, 10, 10> L_;
};

TEST(Registration, LeavesTheLeastMisfitOfWhatFitsNoRobot) {
  const ErrorModel model = complete_model(fanuc());
  Random random(13);
  for (int trial = 0; trial < 40; ++trial) {
    const Scene data = unrelated(model, random);
    const Left left(data);
    const Registration found = data.registered();
    const Eigen::Matrix3d R_WB = found.frames.base().linear();
    const double least = left.at(R_WB);
    ASSERT_NEAR(least / std::sqrt(30.0), found.rms, 1e-12) << trial;
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      for (const double angle : {1e-6, -1e-6}) {
        const Eigen::AngleAxisd turn(angle, Eigen::Vector3d::Unit(axis));
        ASSERT_GT(left.at(R_WB * turn), least) << trial << ", " << axis << " by " << angle;
      }
    }
    for (int other = 0; other < 20; ++other) {
      ASSERT_GT(left.at(random_placement(random).linear()), least) << trial << ", " << other;
    }
  }
}

/// [m] 3D RMS of A z - c - R_BF t - p_BF with any A, c and t of each target, by dense least squares.
double left_with_any_matrix(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measured) {
  const auto count = static_cast<Eigen::Index>(measured.observations.size());
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(3 * count, 12 + 3 * static_cast<Eigen::Index>(measured.targets.size()));
  Eigen::VectorXd y(3 * count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Observation& observation = measured.observations[static_cast<std::size_t>(i)];
    const Eigen::Isometry3d& X = X_BF[static_cast<std::size_t>(observation.configuration)];
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      J.block<1, 3>(3 * i + axis, 3 * axis) = observation.position().transpose();
    }
    J.block<3, 3>(3 * i, 9) = Eigen::Matrix3d::Identity();
    J.block<3, 3>(3 * i, 12 + 3 * observation.target) = X.linear();
    y.segment<3>(3 * i) = X.translation();
  }
  return (y - J * J.colPivHouseholderQr().solve(y)).norm() / std::sqrt(static_cast<double>(count));
}

TEST(Registration, LeavesNoLessThanTheBoundOfAnyMatrix) {
  const ErrorModel model = complete_model(fanuc());
  Random random(14);
  for (int trial = 0; trial < 40; ++trial) {
    Scene scene(exact_robot(model, 1 + trial % 3, random), trial % 2 == 0 ? 6 : 20, random, {.sigma = 1e-4});
    scene.q.row(trial % 6) *= -1.0;
    const Measurements& measured = scene.measured;
    const std::vector<Eigen::Isometry3d> X_BF = flange_poses(folded(model, scene.robot.truth.errors), scene.q);
    const double least = least_misfit(X_BF, measured);
    EXPECT_NEAR(least, left_with_any_matrix(X_BF, measured), 1e-3 * least + 1e-5) << trial;
    EXPECT_LE(least, register_base_and_targets(X_BF, measured).rms) << trial;
    Measurements with_others = measured;  // what is stated of rows and rows of another split change nothing
    for (Observation& observation : with_others.observations) {
      observation.sigma = random.uniform(1e-5, 1e-3);
    }
    with_others.observations.push_back(measured.observations.front());
    with_others.observations.back().split = Split::test;
    with_others.observations.back().position().x() += 10.0;
    EXPECT_NEAR(least_misfit(X_BF, with_others), least, 1e-9) << trial;
  }
}

TEST(Registration, BoundIsNothingWhereAllIsExact) {
  const ErrorModel model = complete_model(fanuc());
  Random random(15);
  for (const int configurations : {1, 4, 30}) {
    const Scene scene(exact_robot(model, 2, random), configurations, random);
    EXPECT_EQ(least_misfit(scene.X_BF, scene.measured), 0.0) << configurations;
  }
}

/// The least that is left in a valley that is not the deepest one's, over what is left there.
double second_over_least(const Scene& data, Random& random) {
  const Left left(data);
  std::vector<Eigen::Matrix3d> found;
  for (int start = 0; start < 40; ++start) {
    found.push_back(left.downhill(random_placement(random).linear()));
  }
  const auto by_left = [&](const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) { return left.at(a) < left.at(b); };
  const Eigen::Matrix3d best = *std::min_element(found.begin(), found.end(), by_left);
  double second = std::numeric_limits<double>::infinity();
  for (const Eigen::Matrix3d& R_WB : found) {
    if ((R_WB - best).norm() > 0.2) {
      second = std::min(second, left.at(R_WB) / left.at(best));
    }
  }
  return second;
}

TEST(Registration, SaysWhereSeveralPosesOfTheBaseAreAsGood) {
  constexpr double kAsGood = 1.5;  // in RMS
  const ErrorModel model = complete_model(fanuc());
  Random random(11);
  int several = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const Scene data = unrelated(model, random);
    const Registration found = data.registered();
    const bool told = found.ambiguous && found.message.find("two poses of the base") != std::string::npos;
    const double second = second_over_least(data, random);
    EXPECT_EQ(told, second < kAsGood) << trial << ": the second pose leaves " << second << " times the least";
    several += told ? 1 : 0;
  }
  EXPECT_GT(several, 0);
  EXPECT_LT(several, 20);
}

TEST(Registration, GivesARotationWhereAReflectionWouldFitAsWell) {
  // All of a planar arm's points lie in one plane: mirrored at it they are the same.
  const testing::urdf::Part joint{"continuous", "<origin xyz='0.5 0 0'/><axis xyz='0 0 1'/>"};
  const ErrorModel model =
      complete_model(parse_robot(testing::urdf::serial({joint, joint, joint, {"fixed", "<origin xyz='0.1 0 0'/>"}})));
  Random random(12);
  for (int trial = 0; trial < 100; ++trial) {
    const Eigen::Isometry3d X_WB = random_placement(random);
    const VirtualRobot truth =
        placed(virtual_robot(model, {}, generic_targets(1, random.bits()), kNoErrors, random), X_WB);
    const Eigen::MatrixXd q = random_configurations(JointRanges(3, {-2.0, 2.0}), 15, random);
    const Measurements measured = measure(truth, q, {.sigma = 0.001}, random);
    const Registration found = register_base_and_targets(flange_poses(folded(model, truth.truth.errors), q), measured);
    ASSERT_NEAR(found.frames.base().linear().determinant(), 1.0, 1e-12) << trial;
    ASSERT_LT(found.rms, 0.004) << trial;
  }
}

}  // namespace
}  // namespace kdl_calibration::registration_test
