#include "diagnosis/convention_trial.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "base/name_pattern.hpp"
#include "better_reading.hpp"
#include "mistake_table.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::convention_trial_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using testing::better_convention;
using ::testing::Contains;
using testing::kDegree;
using testing::large_arm;
using testing::Measured;
using testing::measured;

/// The controller's second and third joint count against each other, and its zero is elsewhere.
JointConvention coupled_convention(const std::vector<std::string>& urdf_joints) {
  JointConvention convention{.name = "coupled.json",
                             .controller_joints = {"J1", "J2", "J3", "J4", "J5", "J6"},
                             .urdf_joints = urdf_joints,
                             .matrix = MatrixXd::Identity(6, 6),
                             .offset = VectorXd::LinSpaced(6, -0.3, 0.4)};
  convention.matrix(2, 1) = -1.0;
  convention.matrix(4, 4) = -1.0;
  return convention;
}

struct Mistake {
  std::string right;  // description of the reading that undoes it
  std::string cause;
  std::function<void(MatrixXd&)> make;
};

// The simulated truth decides: the first reading must be that with which the robot was measured.
TEST(ConventionTrial, TheReadingThatUndoesAMistakeIsTheFirst) {
  const std::vector<Mistake> mistakes = {
      {"joint_4 with the opposite sign", "joint_sign", [](MatrixXd& q) { q.row(3) *= -1.0; }},
      {"joint_2 in degrees, read as radians", "joint_unit", [](MatrixXd& q) { q.row(1) /= kDegree; }},
      {"all joint angles in radians, read as degrees", "joint_unit", [](MatrixXd& q) { q *= kDegree; }},
      {"joint_3 + joint_2 for joint_3", "joint_convention", [](MatrixXd& q) { q.row(2) -= q.row(1); }},
      {"joint_2 and joint_5 exchanged", "joint_columns", [](MatrixXd& q) { q.row(1).swap(q.row(4)); }},
      {"the joints in reversed order", "joint_columns", [](MatrixXd& q) { q = q.colwise().reverse().eval(); }}};
  const Measured m = measured(large_arm(), 1, {.configurations = 20});
  for (const Mistake& mistake : mistakes) {
    Measurements wrong = m.data;
    mistake.make(wrong.joint_values);
    const std::vector<ConventionTrial> trials = try_conventions(m.model, wrong, m.free);
    ASSERT_FALSE(trials.empty());
    EXPECT_EQ(trials.front().description, mistake.right);
    EXPECT_EQ(trials.front().cause, cause_named(mistake.cause)) << mistake.right;
    EXPECT_LT((trials.front().joint_values - m.data.joint_values).cwiseAbs().maxCoeff(), 1e-10) << mistake.right;
    ASSERT_TRUE(better_convention(trials)) << mistake.right;
    EXPECT_TRUE(
        std::is_sorted(trials.begin(), trials.end(), [](const auto& a, const auto& b) { return a.rms < b.rms; }));
    EXPECT_EQ(std::count_if(trials.begin(), trials.end(), [](const auto& trial) { return trial.present; }), 1);
    std::set<std::string> descriptions;
    for (const ConventionTrial& trial : trials) {
      descriptions.insert(trial.description);
    }
    EXPECT_EQ(descriptions.size(), trials.size()) << "no reading is tried twice";
  }
}

TEST(ConventionTrial, TheFilesColumnsAreThoseOfTheConventionInUse) {
  const Measured m = measured(large_arm(), 1, {.configurations = 6, .targets = 1});
  const JointConvention used = coupled_convention(m.data.joints);
  JointConvention other = used;  // the same controller, its joints in another order
  other.name = "folder/other.json";
  std::reverse(other.controller_joints.begin(), other.controller_joints.end());
  other.matrix = MatrixXd::Random(6, 6);
  other.offset[3] = 1.5;
  const MatrixXd u = used.matrix.inverse() * (m.data.joint_values.colwise() - used.offset);
  const MatrixXd expected = (other.matrix * u.colwise().reverse()).colwise() + other.offset;
  const auto found = [&](const JointConvention& one) {
    const std::vector<ConventionTrial> trials =
        try_conventions(m.model, m.data, Unknowns(), {.used = &used, .others = {one}});
    const auto named = std::find_if(trials.begin(), trials.end(),
                                    [](const auto& trial) { return trial.description == "the convention other.json"; });
    return named == trials.end() ? std::nullopt : std::optional(*named);
  };
  const std::optional<ConventionTrial> trial = found(other);
  ASSERT_TRUE(trial);
  EXPECT_EQ(trial->cause, Cause::joint_convention);
  EXPECT_LT((trial->joint_values - expected).cwiseAbs().maxCoeff(), 1e-10);
  JointConvention strange = other;
  strange.controller_joints[2] = "E1";
  EXPECT_FALSE(found(strange)) << "a controller with other joints";
  strange = other;
  strange.urdf_joints.pop_back();
  EXPECT_FALSE(found(strange)) << "for less joints";
}

// ---- joints that belong together -----------------------------------------------------------------------------------

std::vector<std::string> descriptions(const ErrorModel& model) {
  Random random(2);
  const std::size_t independent = independent_joints(model.joints).size();
  MatrixXd q(static_cast<Index>(independent), 6);
  for (double& value : q.reshaped()) {
    value = random.uniform(-1.0, 1.0);
  }
  Estimate truth;
  truth.errors = VectorXd::Zero(static_cast<Index>(model.parameters.size()));
  truth.frames.targets = testing::targets_at({{0.1, 0.05, 0.0}});
  const Measurements data =
      measure({.model = model, .truth = truth}, all_joint_values(model.joints, q), {.sigma = 1e-5}, random);
  std::vector<std::string> result;
  for (const ConventionTrial& trial : try_conventions(model, data, Unknowns())) {
    result.push_back(trial.description);
  }
  return result;
}

TEST(ConventionTrial, JointsAreCoupledWhoseAxesAreParallelToAMilliradian) {
  for (const double tilt : {0.0009, 0.0011}) {
    ErrorModel model = large_arm();
    model.joints[2].origin.M = model.joints[2].origin.M * KDL::Rotation::RotZ(tilt);
    const std::vector<std::string> found = descriptions(model);
    for (const char* coupling : {"joint_3 + joint_2 for joint_3", "joint_3 - joint_2 for joint_3"}) {
      if (tilt < 0.001) {
        EXPECT_THAT(found, Contains(coupling));
      } else {
        EXPECT_THAT(found, ::testing::Not(Contains(coupling)));
      }
    }
  }
}

/// Parallel axes: "b" follows "a", "s" slides along its own.
ErrorModel arm_with_a_follower() {
  ErrorModel model;
  Robot robot;
  for (const char* name : {"a", "b", "c", "d", "s", "e"}) {
    MovingJoint joint;
    joint.name = name;
    joint.axis = KDL::Vector(0.0, 0.0, 1.0);
    joint.origin = KDL::Frame(KDL::Vector(0.4, 0.1, 0.0));
    robot.joints.push_back(joint);
  }
  robot.joints[1].mimic = Mimic{.leader = 0, .multiplier = -0.5, .offset = 0.1};
  robot.joints[4].type = JointType::prismatic;
  robot.tip_origin = KDL::Frame(KDL::Vector(0.05, 0.02, 0.15));
  return complete_model(robot);
}

TEST(ConventionTrial, FollowersAndSlidesAreCoupledWithNothing) {
  const std::vector<std::string> all = descriptions(arm_with_a_follower());
  const auto like = [&](const std::string& pattern) {
    std::vector<std::string> result = all;
    std::erase_if(result, [&](const std::string& text) { return !matches_pattern(pattern, text); });
    return result;
  };
  EXPECT_THAT(like("* for *"), ::testing::UnorderedElementsAre("d + c for d", "d - c for d"));
  EXPECT_THAT(like("s in *"), ::testing::UnorderedElementsAre(
                                  "s in millimetres, read as metres", "s in metres, read as millimetres",
                                  "s in centimetres, read as metres", "s in centimetres, read as millimetres",
                                  "s in inches, read as metres", "s in inches, read as millimetres"));
  EXPECT_THAT(like("b *"), ::testing::IsEmpty());
}

}  // namespace
}  // namespace kdl_calibration::convention_trial_test
