#include "robot/mimic.hpp"
#include "diagnosis/convention_trial.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/reduction.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <Eigen/SVD>
#include <fstream>

#include "better_reading.hpp"
#include "calibration/calibrate.hpp"
#include "model/kinematics.hpp"
#include "planning/measuring_plan.hpp"
#include "planning/simulation.hpp"
#include "planning/workspace.hpp"
#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "urdf_text.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::mimic_test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::AllOf;
using testing::better_convention;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::VirtualExperiment;
using testing::urdf::joint;
using testing::urdf::limit;
using testing::urdf::links;
using testing::urdf::robot_of;

constexpr double kDegree = testing::kDegree;

struct Follows {
  std::string forearm = R"(<mimic joint="elbow" multiplier="-0.5" offset="0.2"/>)";
  std::string hand = R"(<mimic joint="forearm" multiplier="2" offset="0.1"/>)";
};

/// turn, forearm (follows elbow, which stands behind it), slide, elbow, roll, hand (follows forearm), tool.
std::string mimic_urdf(const Follows& follows = {}, const std::string& forearm_limit = "-2.9:2.9") {
  return robot_of(
      links({"base", "l1", "l2", "l3", "l4", "l5", "l6", "tool"}) +
      joint("turn", "revolute", "base", "l1", "<origin xyz='0 0 0.5'/><axis xyz='0 0 1'/>" + limit("-3:3")) +
      joint("forearm", "revolute", "l1", "l2",
            "<origin xyz='0.3 0 0.2' rpy='0.1 0 0.2'/><axis xyz='0 1 0'/>" + limit(forearm_limit) + follows.forearm) +
      joint("slide", "prismatic", "l2", "l3", "<origin xyz='0 0.1 0.6'/><axis xyz='0 0 1'/>" + limit("-0.2:0.3")) +
      joint("elbow", "revolute", "l3", "l4", "<origin xyz='0.4 0 0.1'/><axis xyz='0 1 0.2'/>" + limit("-2.5:2.5")) +
      joint("roll", "continuous", "l4", "l5", "<origin xyz='0.3 0 0'/><axis xyz='1 0 0'/>") +
      joint("hand", "continuous", "l5", "l6", "<origin xyz='0.2 0.05 0'/><axis xyz='0 1 0'/>" + follows.hand) +
      joint("mount", "fixed", "l6", "tool", "<origin xyz='0.1 0 0.05'/>"));
}

Robot mimic_robot() { return parse_robot(mimic_urdf()); }

/// What the URDF says, by hand: forearm = -0.5 elbow + 0.2, hand = 2 forearm + 0.1.
VectorXd expanded(double turn, double slide, double elbow, double roll) {
  const double forearm = -0.5 * elbow + 0.2;
  VectorXd q(6);
  q << turn, forearm, slide, elbow, roll, 2.0 * forearm + 0.1;
  return q;
}

std::string refusal(const std::string& urdf, const RobotOptions& options = {}) {
  return testing::refusal([&] { parse_robot(urdf, options, "r.urdf"); });
}

TEST(Mimic, ResolvesALeaderBehindTheFollowerAndAChainOfFollowers) {
  const Robot robot = mimic_robot();
  EXPECT_THAT(joint_names(robot), ElementsAre("turn", "forearm", "slide", "elbow", "roll", "hand"));
  EXPECT_THAT(independent_joint_names(robot.joints), ElementsAre("turn", "slide", "elbow", "roll"));
  ASSERT_TRUE(robot.joints[1].mimic && robot.joints[5].mimic);
  EXPECT_EQ(robot.joints[1].mimic->leader, 3U);
  EXPECT_EQ(robot.joints[5].mimic->leader, 3U);
  EXPECT_DOUBLE_EQ(robot.joints[5].mimic->multiplier, -1.0);
  EXPECT_DOUBLE_EQ(robot.joints[5].mimic->offset, 0.5);
  const MatrixXd all = all_joint_values(robot.joints, Eigen::Vector4d(0.3, 0.1, -0.7, 1.2));
  EXPECT_LT((all - expanded(0.3, 0.1, -0.7, 1.2)).cwiseAbs().maxCoeff(), 1e-15) << all.transpose();
  EXPECT_EQ(independent_joint_values(robot.joints, all), Eigen::Vector4d(0.3, 0.1, -0.7, 1.2));
}

TEST(Mimic, DefaultsToTheLeadersOwnValue) {
  const Robot robot = parse_robot(mimic_urdf({.forearm = "<mimic joint='elbow'/>", .hand = ""}));
  ASSERT_TRUE(robot.joints[1].mimic);
  EXPECT_EQ(robot.joints[1].mimic->multiplier, 1.0);
  EXPECT_EQ(robot.joints[1].mimic->offset, 0.0);
  EXPECT_FALSE(robot.joints[5].mimic);
}

/// Limits of the leader that turns without any, or within these, with a follower of these limits.
std::pair<double, double> narrowed(const std::string& mimic, const std::string& follower,
                                   const std::string& leader = "-1e12:1e12") {
  const Robot robot = parse_robot(testing::urdf::serial(
      {{"revolute", limit(leader)}, {"revolute", limit(follower) + "<mimic joint='j1' " + mimic + "/>"}}));
  return {robot.joints[0].lower.value(), robot.joints[0].upper.value()};
}

TEST(Mimic, LimitsOfALeaderAreTheNarrowerOfBoth) {
  using Limits = std::pair<double, double>;
  EXPECT_EQ(narrowed("multiplier='2' offset='1'", "-3:5"), Limits(-2.0, 2.0));
  EXPECT_EQ(narrowed("multiplier='-2' offset='1'", "-3:9"), Limits(-4.0, 2.0));
  EXPECT_EQ(narrowed("multiplier='2' offset='1'", "-3:5", "-1:9"), Limits(-1.0, 2.0));
  EXPECT_EQ(narrowed("multiplier='2' offset='1'", "-3:5", "-9:1"), Limits(-2.0, 1.0));
  EXPECT_EQ(narrowed("multiplier='0.5'", "1:2", "-9:2"), Limits(2.0, 2.0));
  EXPECT_EQ(narrowed("multiplier='1e-12'", "-3:5", "-7:7"), Limits(-7.0, 7.0));
  EXPECT_EQ(narrowed("multiplier='0' offset='1'", "1:2", "-7:7"), Limits(-7.0, 7.0));
  EXPECT_EQ(narrowed("multiplier='0' offset='2'", "1:2", "-7:7"), Limits(-7.0, 7.0));
  const auto refused = [](const std::string& mimic, const std::string& follower, const std::string& leader) {
    return testing::refusal([&] { narrowed(mimic, follower, leader); });
  };
  EXPECT_THAT(refused("multiplier='0' offset='0.9'", "1:2", "-7:7"), HasSubstr("the value 0.9 that its mimic gives"));
  EXPECT_THAT(refused("multiplier='0' offset='2.1'", "1:2", "-7:7"), HasSubstr("the value 2.1 that its mimic gives"));
  EXPECT_THAT(refused("multiplier='0.5'", "1:2", "-9:1.9"),
              HasSubstr("no value of joint 'j1', which it mimics, keeps both within their limits"));
  // Ranges without an end stay so.
  const Robot continuous = parse_robot(testing::urdf::serial(
      {{"continuous", ""}, {"revolute", limit("-3:5") + "<mimic joint='j1' multiplier='1e-12'/>"}}));
  EXPECT_FALSE(continuous.joints[0].lower || continuous.joints[0].upper);
  EXPECT_THAT(refused("multiplier='1.01e12'", "-3:5", "-7:7"), HasSubstr("out of range"));
  EXPECT_THAT(refused("offset='-1.01e12'", "-3:5", "-7:7"), HasSubstr("out of range"));
}

TEST(MimicBadInput, LeadersThatCannotLeadAreNamed) {
  EXPECT_THAT(refusal(mimic_urdf({.forearm = "<mimic joint='nobody'/>"})),
              AllOf(HasSubstr("joint 'forearm' mimics joint 'nobody'"), HasSubstr("expected a moving joint")));
  EXPECT_THAT(refusal(mimic_urdf({.forearm = "<mimic joint='mount'/>"})), HasSubstr("mimics joint 'mount'"));
  EXPECT_THAT(refusal(mimic_urdf({.forearm = "<mimic joint='forearm'/>"})), HasSubstr("loop"));
  EXPECT_THAT(refusal(mimic_urdf({.forearm = "<mimic joint='hand'/>"})), HasSubstr("loop"));
  EXPECT_THAT(refusal(mimic_urdf({.forearm = "<mimic joint='elbow' multiplier='1e200'/>"})), HasSubstr("range"));
}

/// A drive on a branch of its own, a spindle beside it, and two stages that follow the drive.
std::string lift_urdf(const std::string& first = "multiplier='0.5' offset='0.01'") {
  const std::string upwards = "<axis xyz='0 0 1'/>";
  return robot_of(
      links({"base", "drive", "nut", "l1", "l2", "tool"}) +
      joint("lift", "prismatic", "base", "drive", upwards + limit("0:1.2")) +
      joint("spindle", "continuous", "base", "nut", upwards) +
      joint("stage_1", "prismatic", "base", "l1",
            "<origin xyz='0.1 0 0.5'/>" + upwards + limit("0:0.5") + "<mimic joint='lift' " + first + "/>") +
      joint("stage_2", "prismatic", "l1", "l2",
            upwards + limit("-1:1") + "<mimic joint='lift' multiplier='-0.25' offset='0.2'/>") +
      joint("turn", "revolute", "l2", "tool", "<origin xyz='0 0 0.2'/>" + upwards + limit("-3:3")));
}

TEST(Mimic, ADriveBesideTheChainIsTheJointThatPeopleGive) {
  const Robot robot = parse_robot(lift_urdf(), {.base = "", .tip = "tool"});
  EXPECT_THAT(independent_joint_names(robot.joints), ElementsAre("lift", "turn"));
  Eigen::Matrix2Xd given(2, 3);
  given << 0.0, 0.4, 1.0, 0.3, -1.0, 2.0;
  const MatrixXd all = all_joint_values(robot.joints, given);
  for (Eigen::Index c = 0; c < given.cols(); ++c) {
    EXPECT_NEAR(all(0, c), 0.5 * given(0, c) + 0.01, 1e-15);
    EXPECT_NEAR(all(1, c), -0.25 * given(0, c) + 0.2, 1e-15);
    EXPECT_EQ(all(2, c), given(1, c));
  }
  EXPECT_LT((independent_joint_values(robot.joints, all) - given).cwiseAbs().maxCoeff(), 1e-15);
  // lift in [0, 1.2], stage_1 = lift / 2 + 0.01 in [0, 0.5]
  EXPECT_NEAR(robot.joints[0].lower.value(), 0.01, 1e-15);
  EXPECT_NEAR(robot.joints[0].upper.value(), 0.5, 1e-15);
  EXPECT_THAT(refusal(lift_urdf("multiplier='0'"), {.base = "", .tip = "tool"}), HasSubstr("multiplier of 0"));
  std::string turning = lift_urdf();
  turning.replace(turning.find("<mimic joint='lift'"), 19, "<mimic joint='spindle'");
  EXPECT_THAT(refusal(turning, {.base = "", .tip = "tool"}), HasSubstr("only one of them turns"));
}

TEST(Mimic, MeasurementsNameADriveBesideTheChainOrTheJointThatItMoves) {
  const Robot robot = parse_robot(lift_urdf(), {.base = "", .tip = "tool"});
  const auto stage = [&](const std::string& columns, const std::string& values) {
    const std::string file = ::testing::TempDir() + "drive.csv";
    std::ofstream(file) << "configuration,target," + columns + ",x,y,z\n1,A," + values + ",0,0,0\n";
    return read_measurements(robot, file).joint_values;
  };
  const Eigen::Vector3d expected(0.21, 0.1, 0.3);
  EXPECT_LT((stage("lift[mm],turn", "400,0.3") - expected).norm(), 1e-15);
  EXPECT_LT((stage("stage_1[m],turn", "0.21,0.3") - expected).norm(), 1e-15);
  EXPECT_LT((stage("lift,stage_1,stage_2,turn", "0.4,0.21,0.1,0.3") - expected).norm(), 1e-15);
  EXPECT_REFUSED_WITH(AllOf(HasSubstr("stage_1"), HasSubstr("mimics 'lift'"), HasSubstr("expected 0.21")),
                      stage("lift,stage_1,turn", "0.4,0.22,0.3"));
}

TEST(Mimic, PosesOfTheModelAreThoseOfKdlAtExpandedValues) {
  const Robot robot = mimic_robot();
  const ErrorModel model = complete_model(robot);
  Random random(1);
  for (int i = 0; i < 20; ++i) {
    const VectorXd errors = testing::random_errors(model, random, 0.002, 0.01);
    const Eigen::Vector4d given{random.uniform(-3, 3), random.uniform(-0.2, 0.3), random.uniform(-2.5, 2.5),
                                random.uniform(-3, 3)};
    const KDL::Frame expected =
        testing::kdl_pose(error_chain(model, errors), expanded(given[0], given[1], given[2], given[3]));
    const KDL::Frame found = to_kdl(flange_pose(folded(model, errors), all_joint_values(robot.joints, given).col(0)));
    EXPECT_LT(testing::difference(expected, found), 1e-12);
  }
}

TEST(Mimic, EveryDrawnConfigurationObeysIt) {
  const Robot robot = mimic_robot();
  const ErrorModel model = complete_model(robot);
  Random random(2);
  MatrixXd drawn = random_configurations(model.joints, limits_of(model.joints), 50, random);
  const auto expect_obeyed = [](const MatrixXd& q, const char* what) {
    for (const auto& column : q.colwise()) {
      ASSERT_LT((column - expanded(column[0], column[2], column[3], column[4])).cwiseAbs().maxCoeff(), 1e-12) << what;
    }
  };
  expect_obeyed(drawn, "random configurations");
  Cell cell;
  cell.ranges = limits_of(model.joints);
  const Candidates chosen = candidates(robot, published_targets(), cell,
                                       {.count = 50, .seed = 3, .threads = 1, .angle_step = 1e-3 * kDegree});
  expect_obeyed(chosen.joint_values, "candidates of a plan");
}

// The oracle: central differences of target positions from KDL, at configurations that the robot can take.
TEST(Mimic, TheReductionKeepsAsManyParametersAsTheReachableConfigurationsTell) {
  const Robot robot = mimic_robot();
  const ErrorModel model = complete_model(robot);
  const std::vector<TargetFrame> targets = published_targets();
  const VectorXd none = testing::errors_of(model);
  Random random(4);
  const auto generic = static_cast<Eigen::Index>(targets.size() * 3);
  MatrixXd stacked(40 * generic, 6 + generic + none.size());
  for (Eigen::Index c = 0; c < 40; ++c) {
    const Eigen::Vector4d given{random.uniform(-3, 3), random.uniform(-1, 1), random.uniform(-3, 3),
                                random.uniform(-3, 3)};
    const VectorXd q = expanded(given[0], given[1], given[2], given[3]);
    const auto points = [&](const VectorXd& errors) {
      const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(error_chain(model, errors), q));
      VectorXd result(generic);
      for (std::size_t t = 0; t < targets.size(); ++t) {
        result.segment<3>(3 * static_cast<Eigen::Index>(t)) = X_BF * targets[t].X_FT.translation();
      }
      return result;
    };
    auto rows = stacked.middleRows(c * generic, generic);
    const VectorXd at = points(none);
    const Eigen::Matrix3d R_BF = to_eigen(testing::kdl_pose(robot.chain, q)).linear();
    rows.leftCols(6 + generic).setZero();
    for (Eigen::Index t = 0; t < generic / 3; ++t) {
      for (int axis = 0; axis < 3; ++axis) {
        rows.block<3, 1>(3 * t, axis) = Eigen::Vector3d::Unit(axis);
        rows.block<3, 1>(3 * t, 3 + axis) = Eigen::Vector3d::Unit(axis).cross(Eigen::Vector3d(at.segment<3>(3 * t)));
        rows.block<3, 1>(3 * t, 6 + 3 * t + axis) = R_BF.col(axis);
      }
    }
    rows.rightCols(none.size()) = testing::central_differences(none.size(), 1e-5, points);
  }
  const Eigen::JacobiSVD<MatrixXd> svd(stacked);
  const VectorXd& s = svd.singularValues();
  const auto rank = (s.array() > 1e-6 * s[0]).count();
  const Reduction reduction = reduced_model(model, targets);
  EXPECT_EQ(reduction.rank, rank) << s.transpose();
  EXPECT_EQ(static_cast<Eigen::Index>(reduction.kept.size()), rank);
}

TEST(Mimic, CalibratesAndExportsARobotThatStillMimics) {
  const Robot robot = mimic_robot();
  const ErrorModel model = complete_model(robot);
  VirtualExperiment arm({.model = model, .sizes = {.length = 0.001, .angle = 0.005}, .random = Random(5)});
  const Measurements measured = arm.measure(40);
  const CalibrationResult found = calibrate(model, measured);
  EXPECT_EQ(found.fit.identification.termination, Termination::converged) << found.fit.identification.message;
  const MatrixXd fresh = arm.configurations(100);
  const Measurements held_out = arm.measure(fresh);
  EXPECT_LT(error_statistics(position_errors(model, found.fit.identification.estimate, held_out)).max, 1e-9);

  const Robot exported = parse_robot(calibrated_urdf(robot, model, found.fit.identification.estimate.errors));
  ASSERT_TRUE(exported.joints[5].mimic);
  const FoldedChain chain = folded(model, found.fit.identification.estimate.errors);
  for (const auto& q : fresh.colwise()) {
    const VectorXd own = all_joint_values(exported.joints, independent_joint_values(robot.joints, q));
    EXPECT_LT(testing::difference(testing::kdl_pose(exported.chain, own), to_kdl(flange_pose(chain, q))), 1e-12);
  }
}

const std::string kRow = ",1,2,3\n";

std::string csv_of(const std::string& joints, const std::string& values) {
  return "configuration,target," + joints + ",x,y,z\nc,A," + values + kRow;
}

std::string reading_fault(const std::string& csv, const JointConvention* convention = nullptr) {
  return testing::refusal([&] { parse_measurements(mimic_robot(), csv, convention, "m.csv"); });
}

TEST(Mimic, MeasurementsNeedTheIndependentJointsAlone) {
  const Measurements m =
      parse_measurements(mimic_robot(), csv_of("turn[deg],slide[mm],elbow[deg],roll", "10,100,-30,0.5"));
  EXPECT_THAT(m.joints, ElementsAre("turn", "forearm", "slide", "elbow", "roll", "hand"));
  EXPECT_LT((m.joint_values.col(0) - expanded(10 * kDegree, 0.1, -30 * kDegree, 0.5)).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_THAT(m.joint_units, ElementsAre(JointUnit::radian, JointUnit::unstated, JointUnit::metre, JointUnit::radian,
                                         JointUnit::unstated, JointUnit::unstated));
}

TEST(Mimic, AFollowersColumnIsCheckedAndMayBeRounded) {
  const double forearm = (-0.5 * -30.0 * kDegree + 0.2) / kDegree;
  const auto csv = [&](double value) {
    return csv_of("hand,turn[deg],forearm[deg],slide[mm],elbow[deg],roll",
                  std::to_string((2.0 * forearm * kDegree) + 0.1) + ",10," + std::to_string(value) + ",100,-30,0.5");
  };
  const VectorXd expected = expanded(10 * kDegree, 0.1, -30 * kDegree, 0.5);
  for (const double rounding : {0.0, 0.0005, -0.0005}) {
    const Measurements m = parse_measurements(mimic_robot(), csv(forearm + rounding));
    EXPECT_LT((m.joint_values.col(0) - expected).cwiseAbs().maxCoeff(), 1e-15) << "the leader's value counts";
  }
  const std::string fault = reading_fault(csv(forearm + 0.01));
  EXPECT_THAT(fault, AllOf(HasSubstr("m.csv:2: forearm[deg] '26.46"), HasSubstr("mimics 'elbow'"),
                           HasSubstr("expected 26.459"), HasSubstr("-0.5 times")));
  EXPECT_THAT(reading_fault(csv_of("turn,slide,elbow,roll,hand", "0,0,0,0,-0.1")),
              AllOf(HasSubstr("hand '-0.1'"), HasSubstr("expected 0.5")));
}

TEST(Mimic, TheFirstJointOfTheChainMayFollow) {
  const Robot robot =
      parse_robot(testing::urdf::serial({{"continuous", "<axis xyz='0 0 1'/><mimic joint='j2' multiplier='2'/>"},
                                         {"continuous", "<axis xyz='0 1 0'/>"}}));
  const Measurements m = parse_measurements(robot, csv_of("j1,j2", "0.5,0.25"));
  EXPECT_EQ(m.joint_values.col(0), Eigen::Vector2d(0.5, 0.25));
  EXPECT_REFUSED_WITH(AllOf(HasSubstr("j1 '0.25'"), HasSubstr("expected 0.5")),
                      parse_measurements(robot, csv_of("j1,j2", "0.25,0.25")));
}

TEST(Mimic, AMissingLeaderIsMissedAndFollowersAreOffered) {
  EXPECT_THAT(reading_fault(csv_of("turn,slide,forearm,roll", "0,0,0,0")),
              AllOf(HasSubstr("missing column elbow"), HasSubstr("mimic others: forearm, hand")));
  EXPECT_THAT(reading_fault(csv_of("turn,slide,elbow,roll,forearm,forearm[rad]", "0,0,0,0,0.2,0.2")),
              HasSubstr("repeats"));
}

TEST(Mimic, AConventionIsOneOfTheIndependentJoints) {
  JointConvention convention{.name = "c.json",
                             .controller_joints = {"J1", "J2", "J3", "J4"},
                             .urdf_joints = {"elbow", "turn", "slide", "roll"},
                             .matrix = MatrixXd::Identity(4, 4),
                             .offset = VectorXd::Zero(4)};
  convention.matrix(0, 0) = -1.0;  // elbow = -J1 + 0.1
  convention.offset[0] = 0.1;
  const VectorXd expected = expanded(0.3, 0.05, -0.4, 0.2);
  const std::string row = "0.5,0.3,0.05,0.2";
  const Measurements m = parse_measurements(mimic_robot(), csv_of("J1,J2,J3,J4", row), &convention);
  EXPECT_LT((m.joint_values.col(0) - expected).cwiseAbs().maxCoeff(), 1e-15) << m.joint_values.transpose();
  EXPECT_EQ(reading_fault(csv_of("J1,J2,J3,J4,forearm", row + ",0.4"), &convention), "nothing was refused");
  EXPECT_THAT(reading_fault(csv_of("J1,J2,J3,J4,forearm", row + ",0.5"), &convention), HasSubstr("expected 0.4"));
  convention.urdf_joints[1] = "forearm";
  EXPECT_THAT(reading_fault(csv_of("J1,J2,J3,J4", row), &convention), HasSubstr("urdf_joints"));
}

TEST(Mimic, WrittenMeasurementsAndPlansAreReadBack) {
  const Robot robot = mimic_robot();
  const Measurements m = VirtualExperiment({.model = complete_model(robot), .random = Random(6)}).measure(5);
  const Measurements read = parse_measurements(robot, measurements_csv(m));
  EXPECT_EQ(read.joint_values, m.joint_values);

  const MeasuringPlan plan{
      .configurations = {"1", "2", "3", "4", "5"}, .joint_values = m.joint_values, .targets = {"A"}, .notes = {}};
  const std::string csv = plan_csv(plan, robot.joints);
  EXPECT_THAT(csv, AllOf(HasSubstr("configuration,target,turn[deg],slide[mm],elbow[deg],roll[deg],x[m]")));
  const std::string file = ::testing::TempDir() + "mimic_plan.csv";
  std::ofstream(file) << csv;
  EXPECT_LT((read_configurations(robot, file).joint_values - m.joint_values).cwiseAbs().maxCoeff(), 1e-8);
}

TEST(Mimic, TheOppositeSignOfALeaderMovesItsFollowersToo) {
  const Robot robot = mimic_robot();
  VirtualExperiment arm(
      {.model = complete_model(robot), .with_errors = std::vector<std::size_t>{}, .random = Random(7)});
  const Measurements right = arm.measure(30);
  Measurements wrong = right;
  wrong.joint_values.row(3) *= -1.0;
  follow(robot.joints, wrong.joint_values);
  const auto better = better_convention(try_conventions(arm.model, wrong, arm.free));
  ASSERT_TRUE(better);
  EXPECT_EQ(better->description, "elbow with the opposite sign");
  EXPECT_LT((better->joint_values - right.joint_values).cwiseAbs().maxCoeff(), 1e-15);
}

}  // namespace
}  // namespace kdl_calibration::mimic_test
