#include "model/reduction.hpp"

#include <fmt/core.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "calibration/calibrate.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"
#include "results/calibrated_urdf.hpp"
#include "two_step/identification_jacobian.hpp"
#include "urdf_text.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::reduction_test {
namespace {

using ::testing::ElementsAre;
using ::testing::ElementsAreArray;
using testing::fanuc;
using ::testing::UnorderedElementsAre;
using testing::VirtualExperiment;

std::vector<std::string> geometric(const Reduction& reduction) {
  std::vector<std::string> names;
  for (const std::string& name : reduction.kept) {
    if (name.find('.') == std::string::npos) {
      names.push_back(name);
    }
  }
  return names;
}

const std::vector<std::string> kPublished = {"dq2", "dq3", "dq4", "dq5", "Tx1", "Ty1", "Ry1", "Tz2", "Rz2",
                                             "Ry2", "Tz3", "Ty3", "Rz3", "Tz4", "Tx4", "Rz4", "Tz5", "Rz5"};

TEST(Reduction, ReducesToThePublishedIrreducibleModelWithThreeTargets) {
  const Reduction reduction = reduced_model(complete_model(fanuc()), generic_targets(3));
  EXPECT_THAT(geometric(reduction), ElementsAreArray(kPublished));
  EXPECT_THAT(testing::names_of(reduction.gauge), ElementsAre("dq1", "dq6"));
  EXPECT_THAT(reduction.gauge[0].tied_to, ElementsAre("base.Rz"));
  EXPECT_EQ(reduction.rank, 33);
  EXPECT_EQ(reduction.kept.size(), 33U);
  EXPECT_EQ(reduction.candidates,
            static_cast<int>(reduction.kept.size() + reduction.gauge.size() + reduction.dropped.size()));
}

TEST(Reduction, AdaptsToOneAndTwoTargets) {
  // 6 for the base, 18 of the geometry and three for each target: one target still sees every joint.
  for (const int targets : {1, 2}) {
    const Reduction reduction = reduced_model(complete_model(fanuc()), generic_targets(targets));
    EXPECT_EQ(reduction.rank, 24 + 3 * targets);
    EXPECT_THAT(geometric(reduction), ElementsAreArray(kPublished));
    EXPECT_THAT(testing::names_of(reduction.gauge), ElementsAre("dq1", "dq6"));
  }
}

// Between the parallel axes 2 and 3 a link askew by 80 degrees. If it is 1 mm longer, no kept length may be off by much
// more than that.
TEST(Reduction, KeepsTheLongerCoordinateOfALinkBetweenParallelAxes) {
  const auto arm = [](double along_x, double along_z) {
    return fmt::format(R"(<robot name="askew"><link name="base"/><link name="l1"/><link name="l2"/><link name="l3"/>
  <link name="tool0"/>
  <joint name="pan" type="revolute"><parent link="base"/><child link="l1"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="lift" type="revolute"><parent link="l1"/><child link="l2"/><origin xyz="0.1 0 0.2"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="elbow" type="revolute"><parent link="l2"/><child link="l3"/><origin xyz="{} 0 {}"/><axis xyz="0 1 0"/>
    <limit lower="-3" upper="3" velocity="2" effort="1"/></joint>
  <joint name="flange" type="fixed"><parent link="l3"/><child link="tool0"/><origin xyz="0.3 0 0.1"/></joint>
</robot>)",
                       along_x, along_z);
  };
  for (const auto& [x, z, kept, dropped] : {std::tuple(0.1, 0.6, "Tz2", "Tx2"), std::tuple(0.6, 0.1, "Tx2", "Tz2")}) {
    const ErrorModel model = complete_model(parse_robot(arm(x, z)));
    const Reduction reduction = reduced_model(model, generic_targets(3, 1));
    EXPECT_THAT(reduction.kept, ::testing::Contains(kept));
    const auto found = std::find_if(reduction.dropped.begin(), reduction.dropped.end(),
                                    [&, name = dropped](const auto& parameter) { return parameter.name == name; });
    ASSERT_NE(found, reduction.dropped.end()) << dropped;
    EXPECT_LT(std::abs(found->replaced_by.at(kept)), 0.5);
  }
}

TEST(Reduction, AJointThatMovesNoTargetIsGauge) {
  TargetFrame on_last_axis{.name = "A"};
  on_last_axis.X_FT.translation() = Eigen::Vector3d(0.0, 0.1, 0.0);
  const Reduction reduction = reduced_model(complete_model(fanuc()), {on_last_axis});
  EXPECT_EQ(reduction.rank, 25);  // nor do Tz5 and Rz5 do anything that the target's coordinates do not
  EXPECT_THAT(testing::names_of(reduction.gauge), ElementsAre("dq1", "dq6"));
}

TEST(Reduction, NamesWhatReplacesADroppedParameter) {
  const Reduction reduction = reduced_model(complete_model(fanuc()), generic_targets(3));
  using Combination = std::map<std::string, double>;
  std::map<std::string, Combination> dropped;
  for (const DroppedParameter& parameter : reduction.dropped) {
    dropped[parameter.name] = parameter.replaced_by;
  }
  EXPECT_EQ(dropped.at("Rx1"), (Combination{{"dq2", 1.0}}));
  EXPECT_EQ(dropped.at("Ry3"), (Combination{{"dq4", 1.0}}));
  EXPECT_EQ(dropped.at("Ry5"), (Combination{{"dq6", 1.0}}));
  EXPECT_EQ(dropped.at("Tz0"), (Combination{{"base.Tz", 1.0}}));
  EXPECT_EQ(dropped.at("Tz6"), (Combination{{"A.z", 1.0}, {"B.z", 1.0}, {"C.z", 1.0}}));
  for (const auto& [name, replacement] : dropped) {
    EXPECT_FALSE(replacement.empty()) << name;
  }
}

/// What replacing a dropped parameter leaves of the motion of the targets, and that motion [m per unit, RMS].
std::pair<double, double> left_and_moved(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                                         const Reduction& reduction, const DroppedParameter& dropped) {
  std::vector<std::string> names = reduction.kept;
  names.push_back(dropped.name);
  const Estimate estimate{.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size())),
                          .frames = {.targets = targets},
                          .effects = {}};
  const Unknowns all(model, estimate.frames.targets, names);
  Random random(9);
  double left = 0.0;
  double moved = 0.0;
  constexpr int kCount = 50;
  for (int i = 0; i < kCount; ++i) {
    const Eigen::MatrixXd J = identification_jacobian(model, estimate, all, testing::random_joints(model, random));
    const Eigen::VectorXd own = J.col(*all.column(dropped.name));
    Eigen::VectorXd rest = own;
    for (const auto& [name, coefficient] : dropped.replaced_by) {
      rest -= coefficient * J.col(*all.column(name));
    }
    left += rest.squaredNorm() / (kCount * static_cast<double>(own.size()));
    moved += own.squaredNorm() / (kCount * static_cast<double>(own.size()));
  }
  return {std::sqrt(left), std::sqrt(moved)};
}

// By Jacobians that are compared with KDL elsewhere: the replacement moves the targets as the parameter would.
TEST(Reduction, ReplacementsMoveTheTargetsAsWhatTheyReplace) {
  const ErrorModel model = complete_model(fanuc());
  const Reduction reduction = reduced_model(model, generic_targets(3));
  for (const DroppedParameter& dropped : reduction.dropped) {
    if (std::all_of(dropped.replaced_by.begin(), dropped.replaced_by.end(), [&](const auto& entry) {
          return std::count(reduction.kept.begin(), reduction.kept.end(), entry.first) > 0;
        })) {
      const auto [left, moved] = left_and_moved(model, generic_targets(3), reduction, dropped);
      EXPECT_LT(left, 1e-6 * moved) << dropped.name;
    }
  }
}

// A target a millimetre beside the last axis, 0.415 m in front of the wrist: noise hides the millimetre. On the axis
// the fifth joint turns the target as Tz5 moves it, and Tx4 moves it as Rz5 turns it.
TEST(Reduction, NamesWhatReplacesAParameterThatNoiseHides) {
  const ErrorModel model = complete_model(fanuc());
  const std::vector<TargetFrame> targets = testing::targets_at({{0.0, 0.2, 1e-3}});
  const Reduction exact = reduced_model(model, targets, {.noise = 1e-6});
  EXPECT_THAT(exact.replaceable, UnorderedElementsAre("Tz5", "Rz5"));
  const Reduction noisy = reduced_model(model, targets, {.noise = 1e-4});
  EXPECT_EQ(noisy.rank, exact.rank - 2);
  std::map<std::string, std::map<std::string, double>> hidden;
  for (const DroppedParameter& dropped : noisy.dropped) {
    if (dropped.name == "Tz5" || dropped.name == "Rz5") {
      hidden[dropped.name] = dropped.replaced_by;
      const auto [left, moved] = left_and_moved(model, targets, noisy, dropped);
      EXPECT_LT(left, 0.02 * moved) << dropped.name << " is replaced by nothing like it";
    }
  }
  ASSERT_EQ(hidden["Tz5"].count("dq5"), 1U);
  EXPECT_NEAR(hidden["Tz5"]["dq5"], 1.0 / 0.415, 0.05);
  ASSERT_EQ(hidden["Rz5"].count("Tx4"), 1U);
  EXPECT_NEAR(hidden["Rz5"]["Tx4"], -0.415, 0.01);
}

TEST(Reduction, WithAKnownBaseAndKnownTargetsTheirLinksBecomeIdentifiable) {
  const ErrorModel model = complete_model(fanuc());
  ReductionOptions options{.fixed = base_parameter_names()};
  for (const TargetFrame& target : generic_targets(3)) {
    for (const std::string& name : target_parameter_names(target)) {
      options.fixed.push_back(name);
    }
  }
  const Reduction known = reduced_model(model, generic_targets(3), options);
  // Nothing but geometry is left: 4 per revolute joint and 6 for the frames at both ends.
  EXPECT_EQ(known.rank, 4 * 6 + 6);
  EXPECT_TRUE(known.gauge.empty());
}

TEST(Reduction, TargetsTenNanometresBesideALineAreOnTheLine) {
  const ErrorModel model = complete_model(fanuc());
  const auto reduced = [&](const Eigen::Vector3d& start, const Eigen::Vector3d& along, const Eigen::Vector3d& aside) {
    std::vector<TargetFrame> targets = generic_targets(3);
    ReductionOptions options{.fixed = base_parameter_names()};
    for (std::size_t k = 0; k < targets.size(); ++k) {
      targets[k].X_FT.translation() = start + static_cast<double>(k) * along + (k == 1 ? -1.0 : 1.0) * aside;
      const std::vector<std::string> names = target_parameter_names(targets[k]);
      options.fixed.insert(options.fixed.end(), names.begin(), names.end());
    }
    return reduced_model(model, targets, options);
  };
  const Eigen::Vector3d zero = Eigen::Vector3d::Zero();
  const Eigen::Vector3d x(0.1, 0.0, 0.0);
  const Eigen::Vector3d y(0.0, 0.1, 0.0);  // the last joint's axis
  const Eigen::Vector3d z(0.0, 0.0, 0.1);
  const Eigen::Vector3d left = z - x;
  for (const auto& [start, along, aside] : {std::tuple{y, y, x}, std::tuple{z, z, y}, std::tuple{left, x, y}}) {
    const Reduction on_line = reduced(start, along, zero);
    EXPECT_EQ(on_line.rank, 29);
    for (const double offset : {1e-9, 1e-8}) {
      const Reduction beside = reduced(start, along, offset / 0.1 * aside);
      EXPECT_EQ(beside.kept, on_line.kept) << along.transpose() << ", " << offset;
      EXPECT_EQ(testing::names_of(beside.gauge), testing::names_of(on_line.gauge));
    }
  }
}

// Six for the frames at both ends, which a measured pose has as well.
TEST(Reduction, AMeasuredPoseHasNoTriangleOfTargets) {
  TargetFrame pose{.name = "P", .with_orientation = true};
  EXPECT_EQ(reduced_model(complete_model(parse_robot(testing::kOddArm)), {pose}).rank, 4 * 4 + 2 + 6);
}

// ---- whole calibrations of other arms ------------------------------------------------------------------------------

const std::string kRight = "1.5707963267948966";

std::string arm_of(const std::vector<testing::urdf::JointAt>& joints) {
  return testing::urdf::serial_of(joints, "revolute", "-1.5:1.5");
}

/// Seven revolute joints with the rotated frames of Denavit and Hartenberg.
std::string seven_joint_arm() {
  const std::string up = kRight + " 0 0";
  const std::string down = "-" + kRight + " 0 0";
  return arm_of({{"0 0 0.34"},
                 {"0 0 0", down},
                 {"0 -0.4 0", up},
                 {"0.05 0 0", up},
                 {"-0.05 0.4 0", down},
                 {"0 0 0", down},
                 {"0 -0.13 0", up},
                 {"0 0 0.1", "0.1 0.2 0.3", "1 0 0", "fixed"}});
}

/// Three revolute joints and a wrist on a linear axis that is askew.
std::string arm_on_a_linear_axis() {
  return arm_of({{"0.2 0.1 0.3", "0 0 0.4", "1 0 0", "prismatic"},
                 {"0 0.1 0.2", "0.2 0 0", "1 0 0", "fixed"},
                 {"0 0 0.4"},
                 {"0.2 0 0.3", kRight + " 0 0"},
                 {"0.6 0 0", "0 0 0.5"},
                 {"0.1 -0.1 0", kRight + " 0 0"},
                 {"0 0 0.5", "-" + kRight + " 0 0"},
                 {"0 0.1 0", "0 0 0", "1 0 0", "fixed"}});
}

/// Two parallel revolute joints, a vertical slide and a turning flange.
std::string scara() {
  return arm_of({{"0 0 0.4", "0 0 0.3"},
                 {"0.35 0 0.05", "0 0 -0.2"},
                 {"0.3 0 0", "3.141592653589793 0 0", "0 0 1", "prismatic"},
                 {"0 0 0.1"}});
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
  const Eigen::Isometry3d X_WB =
      Eigen::Translation3d(3.0, -4.0, 0.5) * Eigen::AngleAxisd(2.3, Eigen::Vector3d(0.5, -2.0, 1.0).normalized());
  VirtualExperiment experiment(
      {.model = model, .targets = generic_targets(3), .sizes = {.length = 0.001, .angle = 0.005}, .X_WB = X_WB});
  for (int trial = 0; trial < 3; ++trial, experiment.draw_robot()) {
    const Measurements train = experiment.measure(60);
    const Measurements test = experiment.measure(100, {}, Split::test);
    const CalibrationResult found = calibrate(model, joined(train, test));
    ASSERT_TRUE(found.trusted()) << found.fit.identification.message;
    ASSERT_LE(found.accuracy.test->after.rms, 1e-12);
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
                                           Case{"Scara", scara(), 3, 1}, Case{"OddArm", testing::kOddArm, 4, 1}),
                         [](const auto& test) { return test.param.name; });

TEST(Reduction, MissingTargetsAndManyTargetsAreNormal) {
  VirtualExperiment experiment({.targets = generic_targets(12), .random = Random(2)});
  const Measurements all = experiment.measure(30);
  const Measurements some = subset(all, [](const Observation& o) { return (o.configuration + 3 * o.target) % 4 != 0; });
  const CalibrationResult found = calibrate(experiment.model, some);
  ASSERT_TRUE(found.trusted()) << found.fit.identification.message;
  EXPECT_EQ(found.uncertainty.identifiability.rank, 24 + 36);
  EXPECT_LE(found.accuracy.train.after.max, 1e-12);
}
TEST(ReductionOnRealData, TheRosIndustrialDescriptionHasTheSameCountWithItsOwnLetters) {
  const Robot robot = load_robot(std::string(SHARED_DATA_DIR) + "/ros_industrial/fanuc_r2000ic165f.urdf");
  const Reduction reduction = reduced_model(complete_model(robot), generic_targets(3));
  EXPECT_EQ(reduction.rank, 33);
  EXPECT_THAT(geometric(reduction),
              UnorderedElementsAre("dq2", "dq3", "dq4", "dq5", "Tx1", "Ty1", "Rx1", "Tz2", "Rz2", "Rx2", "Tx3", "Tz3",
                                   "Rz3", "Tz4", "Ty4", "Rz4", "Tz5", "Rz5"));
}
}  // namespace
}  // namespace kdl_calibration::reduction_test
