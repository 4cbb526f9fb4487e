#include "kdl_calibration/deflection.hpp"
#include "kdl_calibration/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <kdl/chaindynparam.hpp>
#include <numeric>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "support.hpp"

namespace kdl_calibration {
namespace {

using testing::fanuc;

TEST(Deflection, GravityBendsTheSecondAndThirdJointOfTheR2000iC) {
  // The first axis is vertical; the wrist's levers are small beside the arm's.
  const std::vector<Deflection> found = gravity_deflections(complete_model(fanuc()));
  std::vector<std::string> names;
  for (const Deflection& deflection : found) {
    names.push_back(deflection.name);
  }
  EXPECT_THAT(names, ::testing::ElementsAre("gravity2_3", "gravity2_4", "gravity3_4"));
}

TEST(Deflection, BasisIsTheHorizontalLeverOverItsLargest) {
  ErrorModel model = complete_model(fanuc());
  model.deflections = gravity_deflections(model);
  Random random(1);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 50, random);
  const Eigen::MatrixXd basis = deflection_basis(model, q);
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    // Upper arm of 1.075 m along z, turned by q2 about x: horizontal lever 1.075 sin q2.
    EXPECT_NEAR(std::abs(basis(0, c)) * model.deflections[0].largest, 1.075 * std::abs(std::sin(q(1, c))), 1e-12);
  }
  EXPECT_LE(basis.cwiseAbs().maxCoeff(), 1.05);
}

TEST(Deflection, WithLinkMassesTheTorqueIsThatOfTheKdlSolver) {
  std::string urdf = fanuc().urdf;
  const auto add_mass = [&](const std::string& link, const std::string& inertial) {
    const std::string tag = "<link name=\"" + link + "\">";
    const auto at = urdf.find(tag);
    ASSERT_NE(at, std::string::npos) << link;
    urdf.insert(at + tag.size(), inertial);
  };
  add_mass("link_2",
           "<inertial><origin xyz='0 0.1 0.5'/><mass value='200'/><inertia ixx='1' iyy='1' izz='1' ixy='0' "
           "ixz='0' iyz='0'/></inertial>");
  add_mass("link_3",
           "<inertial><origin xyz='0.05 0.6 0.1'/><mass value='150'/><inertia ixx='1' iyy='1' izz='1' "
           "ixy='0' ixz='0' iyz='0'/></inertial>");
  const Robot robot = parse_robot(urdf);
  ErrorModel model = complete_model(robot);
  model.deflections = gravity_deflections(model);
  ASSERT_EQ(model.deflections.size(), 2U);
  KDL::ChainDynParam solver(robot.chain, KDL::Vector(0.0, 0.0, -1.0));
  Random random(2);
  for (int i = 0; i < 50; ++i) {
    const Eigen::VectorXd q = random_configurations(limits_of(model.joints), 1, random).col(0);
    KDL::JntArray joints(6);
    KDL::JntArray torque(6);
    joints.data = q;
    solver.JntToGravity(joints, torque);
    const Eigen::MatrixXd basis = deflection_basis(model, q);
    for (std::size_t d = 0; d < 2; ++d) {
      // KDL gives the torque that holds the arm against gravity.
      EXPECT_NEAR(basis(static_cast<Eigen::Index>(d), 0) * model.deflections[d].largest,
                  -torque(static_cast<unsigned>(model.deflections[d].index)), 1e-9);
    }
  }
}

// The odd arm with masses on every link, on those behind fixed joints as well.
Robot heavy_odd_arm() {
  std::string urdf = testing::kOddArm;
  urdf.insert(urdf.find("<joint"),  // and on one behind two of them
              "<link name=\"gripper\"/>"
              "<joint name=\"adapter\" type=\"fixed\"><parent link=\"tool\"/><child link=\"gripper\"/>"
              "<origin xyz=\"0.1 0.2 -0.3\" rpy=\"0.4 -0.5 0.6\"/></joint>");
  double mass = 3.0;
  for (const std::string link : {"world", "a", "b", "bracket", "c", "d", "e", "tool", "gripper"}) {
    const std::string tag = "<link name=\"" + link + "\"/>";
    const auto at = urdf.find(tag);
    const std::string inertial = "<inertial><origin xyz='0.1 " + std::to_string(0.02 * mass) + " -0.05' rpy='0 0 0'/>" +
                                 "<mass value='" + std::to_string(mass) +
                                 "'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>";
    urdf.replace(at, tag.size(), "<link name=\"" + link + "\">" + inertial + "</link>");
    mass += 2.0;
  }
  return parse_robot(urdf);
}

TEST(Deflection, MassesBehindFixedJointsPullAsTheKdlSolverSays) {
  const Robot robot = heavy_odd_arm();
  ErrorModel model = complete_model(robot);
  ASSERT_EQ(model.link_masses.size(), 8U);  // all but the base link's
  for (const Eigen::Vector3d& down : {Eigen::Vector3d(0.0, 0.0, -1.0), Eigen::Vector3d(0.48, -0.6, -0.64)}) {
    model.gravity = KDL::Vector(down.x(), down.y(), down.z());
    model.deflections = gravity_deflections(model);
    std::vector<int> joints;
    for (const Deflection& deflection : model.deflections) {
      joints.push_back(deflection.index);
    }
    EXPECT_THAT(joints, ::testing::IsSupersetOf({0, 2, 3}));
    KDL::ChainDynParam solver(robot.chain, model.gravity);
    Random random(4);
    for (int i = 0; i < 50; ++i) {
      const Eigen::VectorXd q = testing::random_joints(model, random);
      KDL::JntArray values(5);
      KDL::JntArray torque(5);
      values.data = q;
      ASSERT_EQ(solver.JntToGravity(values, torque), 0);
      const Eigen::MatrixXd basis = deflection_basis(model, q);
      for (std::size_t d = 0; d < model.deflections.size(); ++d) {
        const int joint = model.deflections[d].index;
        EXPECT_NEAR(basis(static_cast<Eigen::Index>(d), 0) * model.deflections[d].largest,
                    -torque(static_cast<unsigned>(joint)), 1e-9)
            << model.deflections[d].name;
      }
      // What bends the joints: each by its value times its basis, and only its own.
      Eigen::VectorXd values_of = Eigen::VectorXd::LinSpaced(static_cast<Eigen::Index>(joints.size()), 0.001, 0.004);
      Eigen::VectorXd expected = q;
      for (std::size_t d = 0; d < joints.size(); ++d) {
        expected[joints[d]] += values_of[static_cast<Eigen::Index>(d)] * basis(static_cast<Eigen::Index>(d), 0);
      }
      EXPECT_LT((deflected(model, values_of, q) - expected).norm(), 1e-15);
    }
  }
}

TEST(Deflection, IsIdentifiedFromMeasurements) {
  ErrorModel model = complete_model(fanuc());
  model.deflections = gravity_deflections(model);
  for (const Deflection& gain : gain_deflections(model)) {
    model.deflections.push_back(gain);
  }
  Random random(3);
  const std::vector<TargetFrame> targets = published_targets();
  const Unknowns rigid(model, targets, reduced_model(model, targets).kept);
  VirtualRobot robot = virtual_robot(model, rigid.geometric(), targets, {.length = 0.001, .angle = 0.001}, random);
  robot.truth.deflections = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.deflections.size()));
  robot.truth.deflections.head<4>() << 0.001, -0.0005, 0.0008, 0.0002;
  const Measurements measured = measure(robot, random_configurations(limits_of(model.joints), 60, random), {}, random);
  std::vector<std::size_t> deflections(model.deflections.size());
  std::iota(deflections.begin(), deflections.end(), 0U);
  const Unknowns free = rigid.with(model, UnknownGroup::deflections, deflections);
  const Identification found = identify_jointly(model, measured, nominal_start(model, measured), free);
  ASSERT_EQ(found.termination, Termination::converged) << found.message;
  EXPECT_LT((found.estimate.deflections - robot.truth.deflections).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_LT(found.rms, 1e-11);
}

}  // namespace
}  // namespace kdl_calibration
