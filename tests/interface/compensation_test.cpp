#include "kdl_calibration/compensation.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <kdl/chainiksolverpos_lma.hpp>
#include <limits>
#include <map>
#include <memory>
#include <regex>
#include <string>
#include <utility>
#include <vector>

#include "counted_allocations.hpp"
#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/simulation.hpp"
#include "record.hpp"
#include "refusal.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::compensation_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::kDegree;
using testing::random_errors;
using enum CompensationStatus;

constexpr double kExact = 1e-10;
constexpr double kUnbounded = std::numeric_limits<double>::infinity();

// A trusted calibration that found these errors and effects.
Calibration calibration_of(const ErrorModel& model, const VectorXd& errors, const VectorXd& effects = {}) {
  CalibrationParts parts;
  parts.model = model;
  parts.estimate.errors = parts.urdf_errors = errors;
  parts.estimate.effects = effects;
  parts.verdict = Verdict::trusted;
  return Calibration(std::make_shared<CalibrationParts>(std::move(parts)));
}

Calibration bent(const Robot& robot, double size, std::uint64_t seed = 3) {
  const ErrorModel model = complete_model(robot);
  Random random(seed);
  return calibration_of(model, random_errors(model, random, size, size));
}

const Robot& fanuc() {
  static const Robot robot = testing::fanuc();
  return robot;
}

// The same without limits of the joints.
const Robot& unlimited() {
  static const Robot robot =
      parse_robot(std::regex_replace(std::regex_replace(fanuc().urdf, std::regex("lower=\"[^\"]*\""), "lower=\"-99\""),
                                     std::regex("upper=\"[^\"]*\""), "upper=\"99\""));
  return robot;
}

// Over the limits; of a third of them the fifth joint is within 5 degrees of the wrist's singularity.
MatrixXd anywhere(int count) {
  Random random(1);
  MatrixXd q = random_configurations(limits_of(fanuc().joints), count, random);
  for (Index c = 0; c < count; c += 3) {
    q(4, c) = random.uniform(-5.0, 5.0) * kDegree;
  }
  return q;
}

struct Distance {
  double position;
  double orientation;
};
Distance distance(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return {.position = (a.translation() - b.translation()).norm(),
          .orientation = Eigen::AngleAxisd(a.linear().transpose() * b.linear()).angle()};
}

// By KDL: of the calibrated arm at `found` from the nominal one at `q`.
Distance missed_by(const KDL::Chain& calibrated, const VectorXd& found, const VectorXd& q) {
  return distance(to_eigen(testing::kdl_pose(calibrated, found)), to_eigen(testing::kdl_pose(fanuc().chain, q)));
}

// Whether the nominal arm is within 8 degrees of a straight or folded elbow or a straight wrist, or the wrist's centre
// within 8 degrees of the first axis, seen from the shoulder.
bool is_near_singularity(const VectorXd& q) {
  constexpr double kNear = 8.0 * kDegree;
  const double straight = std::atan2(1280.0, 225.0);
  const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(fanuc().chain, q));
  const Eigen::Vector3d centre = X_BF * Eigen::Vector3d(0.0, -0.215, 0.0);
  const double height = centre.z() - 0.670;
  return std::abs(std::remainder(q[2] - straight, std::numbers::pi)) < kNear ||
         std::abs(std::remainder(q[4], std::numbers::pi)) < kNear ||
         std::atan2(centre.head<2>().norm(), std::abs(height)) < kNear || centre.head<2>().norm() < 0.2;
}

// ---- Solutions -----------------------------------------------------------------------------------------------------

TEST(Compensation, SolvesAllPosesButThoseNearSingularities) {
  constexpr int kPoints = 20000;
  const Calibration found = bent(unlimited(), 5e-4);
  const Compensator compensator(found, {.most_change = kUnbounded});
  const KDL::Chain chain = found.urdf_chain();
  const MatrixXd q = anywhere(kPoints);
  int exactly = 0;
  for (Index c = 0; c < kPoints; ++c) {
    const CompensatedPoint point = compensator.solve(q.col(c));
    const Distance missed = missed_by(chain, point.joint_values, q.col(c));
    EXPECT_NEAR(missed.position, point.position_error, 1e-12);
    EXPECT_NEAR(missed.orientation, point.orientation_error, 1e-12);
    if (point.status == exact) {
      ++exactly;
      EXPECT_LE(missed.position, kExact + 1e-12);
      EXPECT_LE(missed.orientation, kExact + 1e-12);
    } else {
      EXPECT_TRUE(is_near_singularity(q.col(c))) << q.col(c).transpose();
    }
  }
  EXPECT_GE(exactly, 0.985 * kPoints);
}

TEST(Compensation, MovesNoJointFurtherThanAllowedNorBeyondItsLimits) {
  const Calibration found = bent(fanuc(), 5e-4);
  const KDL::Chain chain = found.urdf_chain();
  const Compensator compensator(found);
  const JointRanges limits = limits_of(fanuc().joints);
  const MatrixXd q = anywhere(6000);
  std::map<CompensationStatus, int> counts;
  for (Index c = 0; c < q.cols(); ++c) {
    const CompensatedPoint point = compensator.solve(q.col(c));
    ++counts[point.status];
    EXPECT_LE((point.joint_values - q.col(c)).cwiseAbs().maxCoeff(), 5.0 * kDegree + 1e-15);
    for (Index j = 0; j < 6; ++j) {
      EXPECT_GE(point.joint_values[j], limits[static_cast<std::size_t>(j)].first);
      EXPECT_LE(point.joint_values[j], limits[static_cast<std::size_t>(j)].second);
    }
    const Distance missed = missed_by(chain, point.joint_values, q.col(c));
    EXPECT_NEAR(missed.orientation, point.orientation_error, 1e-12);
    if (point.status == exact || point.status == position_only) {
      EXPECT_LE(missed.position, kExact + 1e-12);
    }
    if (point.status == position_only) {
      EXPECT_LT(std::abs(std::sin(q(4, c))), 0.3);
      EXPECT_GT(missed.orientation, kExact);
      EXPECT_LT(missed.orientation, 0.03);
    } else if (point.status != out_of_limits && point.status != exact) {
      EXPECT_TRUE(is_near_singularity(q.col(c))) << q.col(c).transpose();
    }
  }
  EXPECT_GT(counts[exact], 5200);
  EXPECT_GT(counts[position_only], 200);
  EXPECT_GT(counts[out_of_limits], 5);
  EXPECT_GT(counts[unreachable], 5);
}

// KDL takes rotations by less than 1e-6 for none.
TEST(Compensation, IsThatOfTheSolverOfKdl) {
  for (const double size : {5e-4, 1e-2}) {
    const Calibration found = bent(unlimited(), size);
    const KDL::Chain chain = found.urdf_chain();
    const Compensator compensator(found, {.most_change = kUnbounded});
    KDL::ChainIkSolverPos_LMA solver(chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-12);
    const MatrixXd q = anywhere(600);
    int compared = 0;
    for (Index c = 0; c < q.cols(); ++c) {
      if (is_near_singularity(q.col(c))) {
        continue;
      }
      KDL::JntArray start(6);
      start.data = q.col(c);
      KDL::JntArray expected(6);
      solver.CartToJnt(start, testing::kdl_pose(fanuc().chain, q.col(c)), expected);
      if (missed_by(chain, expected.data, q.col(c)).position < 1e-11) {
        ++compared;
        EXPECT_LT((compensator.solve(q.col(c)).joint_values - expected.data).cwiseAbs().maxCoeff(), 1e-5) << c;
      }
    }
    EXPECT_GT(compared, 250) << size;
  }
}

TEST(Compensation, OfAPoseIsThatOfTheNominalJointValuesThere) {
  const Calibration found = bent(fanuc(), 5e-4);
  const Compensator compensator(found);
  const MatrixXd q = anywhere(300);
  int compared = 0;
  for (Index c = 0; c < q.cols(); ++c) {
    const CompensatedPoint expected = compensator.solve(q.col(c));
    if (expected.status == exact && !is_near_singularity(q.col(c))) {
      ++compared;
      const CompensatedPoint point =
          compensator.solve(to_eigen(testing::kdl_pose(fanuc().chain, q.col(c))), 0.99 * q.col(c));
      EXPECT_EQ(point.status, exact);
      EXPECT_LT((point.joint_values - expected.joint_values).cwiseAbs().maxCoeff(), 1e-8);
    }
  }
  EXPECT_GT(compared, 120);
}

// From the pose alone; one of the ways to reach it, so only the pose is compared.
TEST(Compensation, OfAPoseNeedsNoSeed) {
  const Calibration found = bent(fanuc(), 5e-4);
  const Compensator compensator(found);
  const MatrixXd q = anywhere(300);
  int reached = 0;
  for (Index c = 0; c < q.cols(); ++c) {
    const Eigen::Isometry3d asked = to_eigen(testing::kdl_pose(fanuc().chain, q.col(c)));
    const CompensatedPoint point = compensator.solve(asked);
    if (point.status == exact) {
      ++reached;
      EXPECT_LE(distance(found.arm().flange_pose(point.joint_values), asked).position, kExact + 1e-12);
      const VectorXd nominal = point.joint_values - point.change;
      EXPECT_LE(distance(compensator.nominal_pose(nominal), asked).position, kExact + 1e-12);
    }
    EXPECT_LE(point.change.cwiseAbs().maxCoeff(), 5.0 * kDegree + 1e-15);
  }
  EXPECT_GT(reached, 250);
}

TEST(Compensation, PrefersThePositionWhereAsked) {
  const Calibration found = bent(fanuc(), 5e-4);
  const CompensationOptions bounded{.most_change = 2e-3};
  const Compensator least_squares(found, bounded);
  const Compensator position_first(found, {.most_change = bounded.most_change, .position_first = true});
  const MatrixXd q = anywhere(600);
  int preferred = 0;
  for (Index c = 0; c < q.cols(); ++c) {
    const CompensatedPoint plain = least_squares.solve(q.col(c));
    const CompensatedPoint point = position_first.solve(q.col(c));
    EXPECT_LE((point.joint_values - q.col(c)).cwiseAbs().maxCoeff(), bounded.most_change + 1e-15);
    if (plain.status != position_only && point.status == position_only) {
      ++preferred;
      EXPECT_LE(point.position_error, kExact);
      EXPECT_GT(plain.position_error, kExact);
      EXPECT_GE(point.orientation_error, plain.orientation_error);
    } else {
      EXPECT_EQ(point.joint_values, plain.joint_values);
    }
  }
  EXPECT_GT(preferred, 20);
}

TEST(Compensation, SaysWhatIsInTheWay) {
  const Calibration found = bent(fanuc(), 2e-3);
  const Compensator compensator(found);
  const double straight = std::atan2(1280.0, 225.0);
  const double limit = *fanuc().joints[3].upper;
  const auto at = [](double q3, double q4, double q5) { return VectorXd{{0.3, 0.2, q3, q4, q5, 0.1}}; };
  std::map<CompensationStatus, int> near_straight;
  for (const double distance : {-0.03, -0.02, -0.01, -0.003, 0.0, 0.003, 0.01, 0.02, 0.03}) {
    ++near_straight[compensator.solve(at(straight + distance, 0.4, 0.9)).status];
  }
  EXPECT_EQ(near_straight[position_only] + near_straight[out_of_limits], 0);
  EXPECT_GT(near_straight[unreachable] + near_straight[branch_changed], 0);
  EXPECT_EQ(compensator.solve(at(0.3, 0.4, 0.9)).status, exact);
  EXPECT_EQ(compensator.solve(at(0.3, 0.4, 1e-3)).status, position_only);
  int beyond = 0;
  for (const double end : {-limit, limit}) {
    beyond += compensator.solve(at(0.3, end, 0.9)).status == out_of_limits ? 1 : 0;
  }
  EXPECT_EQ(beyond, 1);
  EXPECT_EQ(compensator.solve(at(0.3, limit + 0.1, 0.9)).status, out_of_limits);
  EXPECT_STREQ(to_string(exact), "exact");
  EXPECT_STREQ(to_string(branch_changed), "branch_changed");
}

// ---- Other arms ----------------------------------------------------------------------------------------------------

// Through a straight wrist joints 4 and 6 would turn against each other by up to twice `most_change` at once.
TEST(Compensation, OnAPathLetsNoCorrectionJump) {
  const Compensator compensator(bent(unlimited(), 0.002));
  const CompensationOptions defaults;
  const KDL::Chain calibrated = bent(unlimited(), 0.002).urdf_chain();
  VectorXd q{{0.2, 0.3, -0.4, 0.5, -0.2, 0.7}};
  CompensatedPoint before = compensator.solve(q);
  VectorXd alone_before = before.change;
  double largest_jump_alone = 0.0;
  int limited = 0;
  for (int i = 0; i <= 800; ++i) {
    q[4] = -0.2 + 0.0005 * i;
    const CompensatedPoint point = compensator.solve(q, before);
    const CompensatedPoint alone = compensator.solve(q);
    largest_jump_alone = std::max(largest_jump_alone, (alone.change - alone_before).cwiseAbs().maxCoeff());
    alone_before = alone.change;
    ASSERT_LE((point.change - before.change).cwiseAbs().maxCoeff(), defaults.most_step + 1e-12) << i;
    ASSERT_LE(point.change.cwiseAbs().maxCoeff(), defaults.most_change + 1e-12) << i;
    const Distance missed = missed_by(calibrated, point.joint_values, q);
    EXPECT_NEAR(missed.position, point.position_error, 1e-9);
    EXPECT_NEAR(missed.orientation, point.orientation_error, 1e-7);
    EXPECT_LT(missed.position, 1e-6) << i;  // the position is kept
    if (point.status == step_limited) {
      ++limited;
      EXPECT_GT((alone.change - before.change).cwiseAbs().maxCoeff(), defaults.most_step) << i;
    } else {
      EXPECT_EQ(point.joint_values, alone.joint_values) << i;
    }
    before = point;
  }
  EXPECT_GT(largest_jump_alone, 5.0 * kDegree);
  EXPECT_GT(limited, 10);
  EXPECT_EQ(before.status, exact) << "far from the singularity it has caught up";
  EXPECT_STREQ(to_string(step_limited), "step_limited");
}

TEST(Compensation, OnAPathRefusesThePointOfAnotherArm) {
  const Compensator compensator(bent(fanuc(), 0.001));
  const VectorXd q = VectorXd::Constant(6, 0.3);
  EXPECT_THROW(compensator.solve(q, CompensatedPoint{}), InputError);
  CompensatedPoint unknown = compensator.solve(q);
  unknown.change[2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(compensator.solve(q, unknown), InputError);
  EXPECT_THROW(Compensator(bent(fanuc(), 0.001), {.most_step = 0.0}), InputError);
}

TEST(Compensation, IncludesTheEffects) {
  ErrorModel model = complete_model(unlimited());
  Random random(5);
  const VectorXd errors = random_errors(model, random, 1e-3, 1e-3);
  const MatrixXd q = anywhere(200);
  for (const EffectGroup group :
       {EffectGroup::gain, EffectGroup::gravity, EffectGroup::transverse, EffectGroup::tables}) {
    const std::vector<EffectTerm> terms = effect_terms(model, group, q);
    model.effects.insert(model.effects.end(), terms.begin(), terms.end());
  }
  const VectorXd effects = VectorXd::Constant(static_cast<Index>(model.effects.size()), 1e-4);
  const Calibration found = calibration_of(model, errors, effects);
  const Compensator compensator(found);
  const Compensator rigid(calibration_of(model, errors));
  int compared = 0;
  for (Index c = 0; c < q.cols(); ++c) {
    const CompensatedPoint point = compensator.solve(q.col(c));
    if (point.status == exact) {
      ++compared;
      const Distance missed =
          distance(found.arm().flange_pose(point.joint_values), to_eigen(testing::kdl_pose(fanuc().chain, q.col(c))));
      EXPECT_LE(missed.position, kExact + 1e-12);
      EXPECT_LE(missed.orientation, kExact + 1e-12);
      EXPECT_GT((point.joint_values - rigid.solve(q.col(c)).joint_values).norm(), 1e-5);
    }
  }
  EXPECT_GT(compared, 120);
}

const std::string kFollowsTheSecond = "<mimic joint='j2' multiplier='-2' offset='0.1'/>";

// Joints about z, y, z, … at distances of 0.3 m; `mimic` stands in the last one.
Robot snake(int joints, const std::string& mimic = {}) {
  std::vector<testing::urdf::Part> parts;
  for (int j = 1; j <= joints; ++j) {
    const std::string axis = j % 2 == 1 ? "<axis xyz='0 0 1'/>" : "<axis xyz='0 1 0'/>";
    parts.push_back({"revolute", "<origin xyz='0.02 0 0.3'/>" + axis + testing::urdf::limit("-3:3")});
  }
  parts.back().content += mimic;
  parts.push_back({"fixed", "<origin xyz='0.05 0.02 0.1'/>"});
  return parse_robot(testing::urdf::serial(parts));
}

TEST(Compensation, HoldsJoints) {
  const Robot robot = snake(7);
  const Calibration found = bent(robot, 1e-3);
  const KDL::Chain chain = found.urdf_chain();
  const VectorXd q{{0.3, 0.8, -0.4, 1.1, 0.5, -0.9, 0.2}};
  const Eigen::Isometry3d asked = to_eigen(testing::kdl_pose(robot.chain, q));
  for (Index held = 0; held < q.size(); ++held) {
    const Compensator compensator(found, {.held = {robot.joints[static_cast<std::size_t>(held)].name}});
    for (const CompensatedPoint& point : {compensator.solve(q), compensator.solve(asked, q)}) {
      EXPECT_EQ(point.status, exact) << held;
      EXPECT_EQ(point.joint_values[held], q[held]);
      const Distance missed = distance(to_eigen(testing::kdl_pose(chain, point.joint_values)), asked);
      EXPECT_LE(missed.position, kExact + 1e-12);
      EXPECT_LE(missed.orientation, kExact + 1e-12);
      EXPECT_GT((point.joint_values - q).norm(), 1e-4);
    }
  }
  // Five joints cannot reach every pose, and a follower keeps its value with its leader.
  const CompensatedPoint with_five = Compensator(found, {.held = {"j2", "j5"}}).solve(q);
  EXPECT_NE(with_five.status, exact);
  EXPECT_EQ(with_five.joint_values[1], q[1]);
  EXPECT_EQ(with_five.joint_values[4], q[4]);
  const Calibration of_follower = bent(snake(8, kFollowsTheSecond), 1e-3);
  const VectorXd following{{0.3, 0.8, -0.4, 1.1, 0.5, -0.9, 0.2, 0.1 - 2.0 * 0.8}};
  const CompensatedPoint point = Compensator(of_follower, {.held = {"j2"}}).solve(following);
  EXPECT_EQ(point.status, exact);
  EXPECT_EQ(point.joint_values[1], following[1]);
  EXPECT_NEAR(point.joint_values[7], following[7], 1e-15);
  EXPECT_REFUSED("no independent joint 'j8' to hold", Compensator(of_follower, {.held = {"j8"}}));
}

TEST(Compensation, OfSevenJointsChangesThemAsLittleAsPossible) {
  const Calibration found = bent(snake(7), 1e-3);
  const Compensator compensator(found);
  const VectorXd q{{0.3, 0.8, -0.4, 1.1, 0.5, -0.9, 0.2}};
  const CompensatedPoint point = compensator.solve(q);
  ASSERT_EQ(point.status, exact);
  Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian;
  found.arm().flange_pose(point.joint_values, jacobian);
  const VectorXd idle = Eigen::FullPivLU<MatrixXd>(jacobian).kernel().col(0).normalized();
  const VectorXd change = point.joint_values - q;
  EXPECT_GT(change.norm(), 1e-4);
  EXPECT_LT(std::abs(idle.dot(change)), 0.02 * change.norm());
}

TEST(Compensation, LetsMimicJointsFollow) {
  const Robot robot = snake(7, kFollowsTheSecond);
  const Calibration found = bent(robot, 1e-3);
  VectorXd q{{0.3, 0.8, -0.4, 1.1, 0.5, -0.9, -1.5}};
  const CompensatedPoint point = Compensator(found).solve(q);
  ASSERT_EQ(point.status, exact);
  EXPECT_NEAR(point.joint_values[6], -2.0 * point.joint_values[1] + 0.1, 1e-14);
  const Distance missed =
      distance(found.arm().flange_pose(point.joint_values), to_eigen(testing::kdl_pose(robot.chain, q)));
  EXPECT_LE(missed.position, kExact + 1e-12);
  const VectorXd change = point.joint_values - q;
  constexpr double kLess = 1e-4;
  ASSERT_GT(std::abs(change[6]), kLess);
  const CompensatedPoint bounded = Compensator(found, {.most_change = kLess}).solve(q);
  EXPECT_NE(bounded.status, exact);
  EXPECT_LE((bounded.joint_values - q).cwiseAbs().maxCoeff(), kLess + 1e-15);
}

TEST(Compensation, OfFewJointsIsThatOfThePosition) {
  const Robot robot = snake(4);
  const Calibration found = bent(robot, 1e-3);
  const VectorXd q{{0.3, 0.8, -0.4, 1.1}};
  const CompensatedPoint point = Compensator(found).solve(q);
  EXPECT_EQ(point.status, position_only);
  const Distance missed =
      distance(found.arm().flange_pose(point.joint_values), to_eigen(testing::kdl_pose(robot.chain, q)));
  EXPECT_LE(missed.position, kExact + 1e-12);
  EXPECT_NEAR(missed.orientation, point.orientation_error, 1e-12);
}

// ---- The true robot ------------------------------------------------------------------------------------------------

TEST(Compensation, BringsTheTrueRobotWhereItsUncertaintySays) {
  constexpr int kRobots = 40;
  constexpr int kPoints = 50;
  const CalibrationOptions plain{.priors = {.automatic = false},
                                 .effects = {.automatic = false},
                                 .noise = {.scale_sigma = 0.0},
                                 .validation = {.held_out = false},
                                 .diagnosis = {.try_readings = false}};
  double before = 0.0;
  double ratio = 0.0;
  int within = 0;
  int count = 0;
  for (std::uint64_t seed = 1; seed <= kRobots; ++seed) {
    const SimulatedExperiment experiment = simulate(
        fanuc(),
        {.test_configurations = kPoints, .noise = 3e-5, .length_error = 1e-3, .angle_error = 1e-3, .seed = seed});
    const Calibration found = calibrate(fanuc(), experiment.measurements, plain);
    const CalibratedArm arm = found.arm();
    const Compensator compensator(found);
    const Estimate& estimate = found.parts().estimate;
    for (const auto& q : experiment.measurements.joint_values.rightCols(kPoints).colwise()) {
      const CompensatedPoint point = compensator.solve(q);
      if (point.status != exact) {
        continue;
      }
      const Eigen::Vector3d asked = estimate.frames.base() * to_eigen(testing::kdl_pose(fanuc().chain, q)) *
                                    estimate.frames.targets.front().X_FT.translation();
      const auto error = [&](const VectorXd& commanded) {
        return (experiment.truth.predict(commanded, "A", PredictionFrame::measuring).position - asked).norm();
      };
      const PredictedPoint predicted = arm.predict(point.joint_values, "A", PredictionFrame::measuring);
      const double after = error(point.joint_values);
      before += error(q);
      ratio += after * after / predicted.covariance.trace();
      within += after < predicted.radius_95 ? 1 : 0;
      ++count;
    }
  }
  EXPECT_GT(count, 0.9 * kRobots * kPoints);
  EXPECT_GT(before / count, 1e-3);
  EXPECT_NEAR(ratio / count, 1.0, 0.1);
  EXPECT_GE(within, 0.95 * count);
}

// Commands by a calibration on half of the poses, where the calibration on the other half puts the target.
TEST(CompensationOnRealDataLongRun, RemovesMostOfTheErrorOfAUr10) {
  const std::string folder = std::string(SHARED_DATA_DIR) + "/ur10_tracker_poses";
  const Robot robot = load_robot(folder + "/ur10.urdf", {.base = "base_link", .tip = "tool0"});
  const Measurements all = read_measurements(robot, folder + "/measurements.csv");
  const CalibrationOptions quick{.validation = {.held_out = false}, .diagnosis = {.try_readings = false}};
  const auto half = [&](int odd) {
    return calibrate(robot, subset(all, [&](const Observation& o) { return o.configuration % 2 == odd; }), quick);
  };
  const Calibration ours = half(0);
  const Calibration other = half(1);
  ASSERT_TRUE(ours.trusted());
  const Compensator compensator(ours);
  const Estimate& estimate = ours.parts().estimate;
  double squares = 0.0;
  int count = 0;
  for (const auto& q : all.joint_values.colwise()) {
    const CompensatedPoint point = compensator.solve(q);
    if (point.status == exact) {
      const Eigen::Vector3d asked =
          estimate.frames.base() * compensator.nominal_pose(q) * estimate.frames.targets.front().X_FT.translation();
      const PredictedPoint reached =
          other.arm().predict(point.joint_values, estimate.frames.targets.front().name, PredictionFrame::measuring);
      squares += (reached.position - asked).squaredNorm();
      ++count;
    }
  }
  const double before = other.accuracy().train.before.rms;
  const double after = std::sqrt(squares / count);
  testing::record("before [m]", before);
  testing::record("after [m]", after);
  EXPECT_GT(count, 0.95 * static_cast<double>(all.joint_values.cols()));
  EXPECT_GT(before, 0.9e-3);
  EXPECT_LT(after, 0.2 * before);
}

// ---- Promises ------------------------------------------------------------------------------------------------------

#ifdef KDL_CALIBRATION_COUNTS_ALLOCATIONS

long allocations_of(const Compensator& compensator, const MatrixXd& q) {
  const long before = allocations;
  for (Index c = 0; c < q.cols(); ++c) {
    compensator.solve(q.col(c));
  }
  return allocations - before;
}

TEST(Compensation, AllocatesNothing) {
  EXPECT_EQ(allocations_of(Compensator(bent(fanuc(), 2e-3)), anywhere(300)), 0);
  EXPECT_EQ(allocations_of(Compensator(bent(snake(32), 1e-4)), MatrixXd::Constant(32, 1, 0.1)), 0);
}

#endif

TEST(Compensation, RefusesWhatDoesNotFit) {
  const Calibration found = bent(fanuc(), 5e-4);
  const Compensator compensator(found);
  CalibrationParts doubted = found.parts();
  doubted.verdict = Verdict::not_trusted;
  doubted.doubts = {{.cause = Cause::large_misfit, .message = "the misfit is 20 mm"}};
  ErrorModel torques = complete_model(fanuc());
  torques.effects = {{.name = "torque.2", .joint = "joint_2", .index = 1, .function = MeasuredTorque{}}};
  const VectorXd errors = VectorXd::Zero(static_cast<Index>(torques.parameters.size()));
  VectorXd nan = VectorXd::Zero(6);
  nan[2] = std::numeric_limits<double>::quiet_NaN();
  const VectorXd q = VectorXd::Zero(6);
  const Robot follower = snake(7, kFollowsTheSecond);
  Eigen::Isometry3d mirrored = Eigen::Isometry3d::Identity();
  mirrored.linear()(0, 0) = -1.0;
  Eigen::Isometry3d sheared = Eigen::Isometry3d::Identity();
  sheared.linear()(0, 1) = 0.01;
  Eigen::Isometry3d unknown = Eigen::Isometry3d::Identity();
  unknown.translation().setConstant(nan[2]);
  struct Case {
    const char* name;
    std::function<void()> call;
    const char* words;
  };
  const std::vector<Case> cases = {
      {"doubted", [&] { Compensator(Calibration(std::make_shared<CalibrationParts>(doubted))); },
       "not to be trusted: the misfit is 20 mm"},
      {"torques", [&] { Compensator(calibration_of(torques, errors, VectorXd::Ones(1))); }, "measured torques"},
      {"no change", [&] { Compensator(found, {.most_change = 0.0}); }, "largest change of a joint"},
      {"unknown change", [&] { Compensator(found, {.most_change = nan[2]}); }, "largest change of a joint"},
      {"many joints", [] { Compensator(bent(snake(33), 1e-3)); }, "33 moving joints, expected at most 32"},
      {"count", [&] { compensator.solve(q.head(5)); }, "5 joint values, expected 6"},
      {"numbers", [&] { compensator.solve(nan); }, "finite"},
      {"a follower astray", [&] { Compensator(bent(follower, 1e-3)).solve(VectorXd::Ones(7)); }, "joint 'j7'"},
      {"count of a seed", [&] { compensator.solve(Eigen::Isometry3d::Identity(), q.head(5)); }, "5 joint values"},
      {"numbers of a seed", [&] { compensator.solve(Eigen::Isometry3d::Identity(), nan); }, "finite"},
      {"mirrored", [&] { compensator.solve(mirrored, q); }, "a rotation and a translation"},
      {"sheared", [&] { compensator.solve(sheared, q); }, "a rotation and a translation"},
      {"numbers of a pose", [&] { compensator.solve(unknown, q); }, "finite"},
  };
  for (const Case& each : cases) {
    EXPECT_THAT(testing::refusal(each.call), ::testing::HasSubstr(each.words)) << each.name;
  }
}

}  // namespace
}  // namespace kdl_calibration::compensation_test
