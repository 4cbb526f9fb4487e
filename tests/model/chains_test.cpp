// Whole calibrations of arms that are not the R-2000iC: what theory says of their rank, and recovery to rounding.

#include <gmock/gmock.h>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using testing::VirtualExperiment;

struct JointText {
  std::string name;
  std::string type;
  std::string parent;
  std::string child;
  std::string xyz;
  std::string rpy;
  std::string axis;
};

std::string text_of(const JointText& joint) {
  const std::string limit = joint.type == "fixed" ? "" : R"(<limit lower="-1.5" upper="1.5" velocity="1" effort="1"/>)";
  return "<joint name=\"" + joint.name + "\" type=\"" + joint.type + "\"><parent link=\"" + joint.parent +
         "\"/><child link=\"" + joint.child + "\"/><origin xyz=\"" + joint.xyz + "\" rpy=\"" + joint.rpy +
         "\"/><axis xyz=\"" + joint.axis + "\"/>" + limit + "</joint>";
}

std::string robot_of(const std::vector<std::string>& links, const std::vector<JointText>& joints) {
  std::string text = "<robot name=\"arm\">";
  for (const std::string& link : links) {
    text += "<link name=\"" + link + "\"/>";
  }
  for (const JointText& joint : joints) {
    text += text_of(joint);
  }
  return text + "</robot>";
}

const std::string kRight = "1.5707963267948966";

/// Seven revolute joints with the rotated frames of Denavit and Hartenberg.
std::string seven_joint_arm() {
  const std::string m = "-" + kRight;
  return robot_of({"base", "l1", "l2", "l3", "l4", "l5", "l6", "l7", "tool"},
                  {{"a1", "revolute", "base", "l1", "0 0 0.34", "0 0 0", "0 0 1"},
                   {"a2", "revolute", "l1", "l2", "0 0 0", m + " 0 0", "0 0 1"},
                   {"a3", "revolute", "l2", "l3", "0 -0.4 0", kRight + " 0 0", "0 0 1"},
                   {"a4", "revolute", "l3", "l4", "0.05 0 0", kRight + " 0 0", "0 0 1"},
                   {"a5", "revolute", "l4", "l5", "-0.05 0.4 0", m + " 0 0", "0 0 1"},
                   {"a6", "revolute", "l5", "l6", "0 0 0", m + " 0 0", "0 0 1"},
                   {"a7", "revolute", "l6", "l7", "0 -0.13 0", kRight + " 0 0", "0 0 1"},
                   {"mount", "fixed", "l7", "tool", "0 0 0.1", "0.1 0.2 0.3", "1 0 0"}});
}

/// Three revolute joints and a wrist on a linear axis that is askew.
std::string arm_on_a_linear_axis() {
  return robot_of({"floor", "cart", "plate", "l1", "l2", "l3", "l4", "l5", "tool"},
                  {{"rail", "prismatic", "floor", "cart", "0.2 0.1 0.3", "0 0 0.4", "1 0 0"},
                   {"bolt", "fixed", "cart", "plate", "0 0.1 0.2", "0.2 0 0", "1 0 0"},
                   {"j1", "revolute", "plate", "l1", "0 0 0.4", "0 0 0", "0 0 1"},
                   {"j2", "revolute", "l1", "l2", "0.2 0 0.3", kRight + " 0 0", "0 0 1"},
                   {"j3", "revolute", "l2", "l3", "0.6 0 0", "0 0 0.5", "0 0 1"},
                   {"j4", "revolute", "l3", "l4", "0.1 -0.1 0", kRight + " 0 0", "0 0 1"},
                   {"j5", "revolute", "l4", "l5", "0 0 0.5", "-" + kRight + " 0 0", "0 0 1"},
                   {"mount", "fixed", "l5", "tool", "0 0.1 0", "0 0 0", "1 0 0"}});
}

/// Two parallel revolute joints, a vertical slide and a turning flange.
std::string scara() {
  return robot_of({"base", "upper", "fore", "slide", "flange"},
                  {{"shoulder", "revolute", "base", "upper", "0 0 0.4", "0 0 0.3", "0 0 1"},
                   {"elbow", "revolute", "upper", "fore", "0.35 0 0.05", "0 0 -0.2", "0 0 1"},
                   {"lift", "prismatic", "fore", "slide", "0.3 0 0", "3.141592653589793 0 0", "0 0 1"},
                   {"turn", "revolute", "slide", "flange", "0 0 0.1", "0 0 0", "0 0 1"}});
}

struct Case {
  std::string name;
  std::string urdf;
  int revolute;
  int prismatic;
};

class AnyChain : public ::testing::TestWithParam<Case> {};

TEST_P(AnyChain, RankIsWhatTheorySays) {
  // Four parameters per revolute joint, two per prismatic one, six for the frames at both ends, three for a triangle.
  const ErrorModel model = complete_model(parse_robot(GetParam().urdf));
  EXPECT_EQ(reduced_model(model, generic_targets(3)).rank, 4 * GetParam().revolute + 2 * GetParam().prismatic + 6 + 3);
}

TEST_P(AnyChain, IsRecoveredToRounding) {
  const Robot robot = parse_robot(GetParam().urdf);
  const ErrorModel model = complete_model(robot);
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
  X_WB.linear() = rotation_exp(Eigen::Vector3d(0.5, -2.0, 1.0));
  X_WB.translation() = Eigen::Vector3d(3.0, -4.0, 0.5);
  VirtualExperiment experiment(
      {.model = model, .targets = generic_targets(3), .sizes = {.length = 0.001, .angle = 0.005}, .X_WB = X_WB});
  for (int trial = 0; trial < 3; ++trial, experiment.draw_robot()) {
    const Measurements train = experiment.measure(60);
    const Measurements test = experiment.measure(100, {}, Split::test);
    const Calibration found = calibrate(model, joined(train, test));
    ASSERT_TRUE(found.trusted()) << found.identification.message;
    ASSERT_LE(found.test->after.rms, 1e-12);
    ASSERT_LE(found.difference_to_kdl, 1e-12);
    const Robot exported = parse_robot(calibrated_urdf(robot, model, found.exported.estimate.errors));
    const Eigen::VectorXd q = experiment.configurations(1).col(0);
    ASSERT_LT(testing::difference(testing::kdl_pose(exported.chain, q),
                                  testing::kdl_pose(error_chain(model, found.exported.estimate.errors), q)),
              1e-12);
  }
}

INSTANTIATE_TEST_SUITE_P(Chains, AnyChain,
                         ::testing::Values(Case{"SevenJoints", seven_joint_arm(), 7, 0},
                                           Case{"LinearAxis", arm_on_a_linear_axis(), 5, 1},
                                           Case{"Scara", scara(), 3, 1}),
                         [](const auto& test) { return test.param.name; });

TEST(Chains, ErrorsOfATenMillionthAreExported) {
  const Robot robot = testing::fanuc();
  const ErrorModel model = complete_model(robot);
  const Eigen::VectorXd errors = Eigen::VectorXd::Constant(static_cast<Eigen::Index>(model.parameters.size()), 1e-7);
  const Robot exported = parse_robot(calibrated_urdf(robot, model, errors));
  const Eigen::VectorXd q = Eigen::VectorXd::LinSpaced(6, 0.1, 0.6);
  const KDL::Frame expected = testing::kdl_pose(error_chain(model, errors), q);
  EXPECT_LT(testing::difference(testing::kdl_pose(exported.chain, q), expected), 1e-13);
  EXPECT_GT(testing::difference(testing::kdl_pose(robot.chain, q), expected), 1e-7);
}

TEST(Chains, ATipInTheMiddleOfATreeLeavesTheRestUntouched) {
  const Robot robot = parse_robot(seven_joint_arm(), {.base = "base", .tip = "l5"});
  ASSERT_EQ(robot.joints.size(), 5U);
  const ErrorModel model = complete_model(robot);
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  errors[static_cast<Eigen::Index>(parameter_index(model, "dq2"))] = 0.01;
  const std::string exported = calibrated_urdf(robot, model, errors);
  const std::size_t behind = robot.urdf.find("<joint name=\"a3\"");
  EXPECT_EQ(exported.substr(exported.find("<joint name=\"a3\"")), robot.urdf.substr(behind));
  EXPECT_NE(exported, robot.urdf);
}

TEST(Chains, MissingTargetsAndManyTargetsAreNormal) {
  VirtualExperiment experiment({.targets = generic_targets(12), .random = Random(2)});
  const Measurements all = experiment.measure(30);
  const Measurements some = subset(all, [](const Observation& o) { return (o.configuration + 3 * o.target) % 4 != 0; });
  const Calibration found = calibrate(experiment.model, some);
  ASSERT_TRUE(found.trusted()) << found.identification.message;
  EXPECT_EQ(found.identifiability.rank, 24 + 36);
  EXPECT_LE(found.train.after.max, 1e-12);
}

TEST(Chains, ATrackersOwnNoiseIsWhitenedAlongAndAcrossTheLineOfSight) {
  // Range 10 um, transverse 20 um + 15 um/m: at 8 m the transverse error is fourteen times the other. Knowing that
  // must predict better than ignoring it.
  const TrackerNoise tracker{.range = 1e-5, .transverse = 2e-5, .transverse_per_metre = 1.5e-5};
  VirtualExperiment experiment({.X_WB = Eigen::Isometry3d(Eigen::Translation3d(8.0, 0.0, 0.0))});
  const ErrorModel& model = experiment.model;
  const Unknowns& free = experiment.free;
  double with = 0.0;
  double without = 0.0;
  double chi_square = 0.0;
  const int runs = 40;
  for (int run = 0; run < runs; ++run) {
    experiment.restart(Random(9, static_cast<std::uint64_t>(run)));
    Random& random = experiment.random;
    const Estimate& truth = experiment.robot.truth;
    Measurements measured = experiment.measure(30);
    for (Observation& o : measured.observations) {
      const double distance = o.position.norm();
      const Eigen::Vector3d line = o.position / distance;
      const Eigen::Vector3d n{random.normal(), random.normal(), random.normal()};
      const double across = tracker.transverse + tracker.transverse_per_metre * distance;
      o.position += tracker.range * line.dot(n) * line + across * (n - line.dot(n) * line);
    }
    const Estimate start = nominal_start(model, measured);
    JointOptions whitened;
    whitened.residuals.noise.tracker = tracker;
    const Eigen::MatrixXd fresh = experiment.configurations(50);
    const auto held_out = [&](const Estimate& estimate) {
      const auto ours = flange_poses(model, estimate, fresh);
      const auto real = flange_poses(model, truth, fresh);
      double sum = 0.0;
      for (std::size_t c = 0; c < ours.size(); ++c) {
        sum += (estimate.X_WB * (ours[c] * estimate.targets[0].X_FT.translation()) -
                truth.X_WB * (real[c] * truth.targets[0].X_FT.translation()))
                   .squaredNorm();
      }
      return sum;
    };
    const Identification aware = identify_jointly(model, measured, start, free, whitened);
    with += held_out(aware.estimate);
    without += held_out(identify_jointly(model, measured, start, free).estimate);
    chi_square += LeastSquaresProblem(model, measured, free, whitened.residuals).linearise(aware.estimate).cost / runs;
  }
  EXPECT_LT(with, 0.9 * without);
  EXPECT_NEAR(chi_square, 270.0 - 33.0, 4.0 * std::sqrt(2.0 * 237.0 / runs));
}

}  // namespace
}  // namespace kdl_calibration
