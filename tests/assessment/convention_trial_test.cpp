#include "kdl_calibration/convention_trial.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "assessment/trial_fit.hpp"
#include "kdl_calibration/mimic.hpp"
#include "mistake_table.hpp"
#include "refusal.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::Contains;
using ::testing::HasSubstr;
using testing::kDegree;
using testing::large_arm;
using testing::light_arm;
using testing::Measured;
using testing::measured;
using ::testing::Not;
using testing::refusal;
using testing::VirtualExperiment;

// ---- the readings written out --------------------------------------------------------------------------------------

struct Reading {
  std::string cause;
  std::string description;
  MatrixXd joint_values;
};

/// Those that are tried, each joint a turning one: q = M u + o with the controller's values u.
class Written {
public:
  Written(std::vector<std::string> names, const JointConvention* used, MatrixXd joint_values)
      : names_(std::move(names)), used_(used), count_(static_cast<Index>(names_.size())) {
    M_ = used != nullptr ? used->matrix : MatrixXd::Identity(count_, count_);
    o_ = used != nullptr ? VectorXd(used->offset) : VectorXd::Zero(count_);
    u_ = M_.inverse() * (joint_values.colwise() - o_);
    add("", used != nullptr ? "the convention " + used->name : "the joint values as they are", M_, o_);
  }

  void add(const std::string& cause, const std::string& description, const MatrixXd& M, const VectorXd& o) {
    const MatrixXd values = (M * u_).colwise() + o;
    if (std::none_of(all_.begin(), all_.end(), [&](const Reading& other) {
          return (other.joint_values - values).cwiseAbs().maxCoeff() < 1e-12;
        })) {
      all_.push_back({cause, description, values});
    }
  }
  /// Of the URDF's joints and, behind a convention, of the controller's.
  void add_change(const std::string& cause, const MatrixXd& change, const std::string& urdf, const std::string& own) {
    add(cause, urdf, change * M_, o_);
    if (used_ != nullptr) {
      add(cause, "the controller's " + own, M_ * change, o_);
    }
  }

  std::vector<Reading> all(const std::vector<std::pair<Index, Index>>& parallel) {
    if (used_ != nullptr) {
      add("joint_convention", "the joint values as they are", MatrixXd::Identity(count_, count_),
          VectorXd::Zero(count_));
    }
    const MatrixXd one = MatrixXd::Identity(count_, count_);
    for (Index j = 0; j < count_; ++j) {
      MatrixXd change = one;
      change(j, j) = -1.0;
      add_change("joint_sign", change, name(j) + " with the opposite sign", own(j) + " with the opposite sign");
    }
    const double pi = std::numbers::pi;
    const std::vector<std::pair<double, std::string>> units = {
        {pi / 180.0, " in degrees, read as radians"}, {180.0 / pi, " in radians, read as degrees"},
        {0.9, " in gradians, read as degrees"},       {pi / 200.0, " in gradians, read as radians"},
        {0.001, " in milliradians, read as radians"}, {2.0 * pi, " in turns, read as radians"},
        {360.0, " in turns, read as degrees"}};
    for (const auto& [factor, words] : units) {
      for (Index j = 0; j < count_; ++j) {
        MatrixXd change = one;
        change(j, j) = factor;
        add_change("joint_unit", change, name(j) + words, own(j) + words);
      }
      add("joint_unit", "all joint angles" + words, factor * M_, o_);
    }
    for (const auto& [first, second] : parallel) {
      for (const double sign : {1.0, -1.0}) {
        MatrixXd change = one;
        change(second, first) = sign;
        add("joint_convention", name(second) + (sign > 0.0 ? " + " : " - ") + name(first) + " for " + name(second),
            change * M_, o_);
      }
    }
    for (Index j = 0; j < count_; ++j) {
      for (Index k = j + 1; k < count_; ++k) {
        MatrixXd change = one;
        std::swap(change(j, j), change(k, j));
        std::swap(change(j, k), change(k, k));
        add_change("joint_columns", change, name(j) + " and " + name(k) + " exchanged",
                   own(j) + " and " + own(k) + " exchanged");
      }
    }
    const MatrixXd reversed = one.colwise().reverse();
    add_change("joint_columns", reversed, "the joints in reversed order", "joints in reversed order");
    return all_;
  }

private:
  std::string name(Index j) const { return names_[static_cast<std::size_t>(j)]; }
  std::string own(Index j) const {
    return used_ != nullptr ? used_->controller_joints[static_cast<std::size_t>(j)] : std::string();
  }

  std::vector<std::string> names_;
  const JointConvention* used_;
  Index count_;
  MatrixXd M_;
  VectorXd o_;
  MatrixXd u_;
  std::vector<Reading> all_;
};

void expect_readings(const std::vector<ConventionTrial>& trials, const std::vector<Reading>& expected) {
  std::map<std::string, const ConventionTrial*> found;
  for (const ConventionTrial& trial : trials) {
    found[trial.description] = &trial;
    EXPECT_EQ(trial.present, trial.cause.empty()) << trial.description;
  }
  EXPECT_EQ(trials.size(), expected.size());
  for (const Reading& reading : expected) {
    ASSERT_EQ(found.count(reading.description), 1U) << reading.description;
    const ConventionTrial& trial = *found[reading.description];
    EXPECT_EQ(trial.cause, reading.cause) << reading.description;
    EXPECT_LT((trial.joint_values - reading.joint_values).cwiseAbs().maxCoeff(), 1e-10) << reading.description;
  }
}

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

TEST(ConventionTrial, TriesEveryReadingOnce) {
  const Measured m = measured(large_arm(), 1, {.configurations = 6, .targets = 1});
  const std::vector<std::pair<Index, Index>> parallel = {{1, 2}};  // of the FANUC the second and the third joint
  expect_readings(try_conventions(m.model, m.data, Unknowns()),
                  Written(m.data.joints, nullptr, m.data.joint_values).all(parallel));
  const JointConvention used = coupled_convention(m.data.joints);
  expect_readings(try_conventions(m.model, m.data, Unknowns(), {.used = &used, .others = {used}}),
                  Written(m.data.joints, &used, m.data.joint_values).all(parallel));
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
  EXPECT_EQ(trial->cause, "joint_convention");
  EXPECT_LT((trial->joint_values - expected).cwiseAbs().maxCoeff(), 1e-10);
  JointConvention strange = other;
  strange.controller_joints[2] = "E1";
  EXPECT_FALSE(found(strange)) << "a controller with other joints";
  strange = other;
  strange.urdf_joints.pop_back();
  EXPECT_FALSE(found(strange)) << "for less joints";
}

TEST(ConventionTrial, ReadingsThatAreTheSameToOneInABillionthAreOne) {
  for (const auto& [value, expected] : {std::pair(4e-13, 0), std::pair(1e-12, 1)}) {
    Measured m = measured(large_arm(), 1, {.configurations = 6, .targets = 1});
    m.data.joint_values.row(4).setConstant(value);
    const std::vector<ConventionTrial> trials = try_conventions(m.model, m.data, Unknowns());
    EXPECT_EQ(std::count_if(trials.begin(), trials.end(),
                            [](const auto& trial) { return trial.description == "joint_5 with the opposite sign"; }),
              expected)
        << value;
  }
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
  truth.targets = testing::targets_at({{0.1, 0.05, 0.0}});
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
        EXPECT_THAT(found, Not(Contains(coupling)));
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
  const ErrorModel model = arm_with_a_follower();
  std::vector<std::string> couplings;
  std::vector<std::string> slides;
  std::vector<std::string> followers;
  for (const std::string& text : descriptions(model)) {
    if (text.find(" for ") != std::string::npos) {
      couplings.push_back(text);
    }
    if (text.rfind("s in ", 0) == 0) {
      slides.push_back(text);
    }
    if (text.rfind("b ", 0) == 0) {
      followers.push_back(text);
    }
  }
  EXPECT_THAT(couplings, ::testing::UnorderedElementsAre("d + c for d", "d - c for d"));
  EXPECT_THAT(slides, ::testing::UnorderedElementsAre(
                          "s in millimetres, read as metres", "s in metres, read as millimetres",
                          "s in centimetres, read as metres", "s in centimetres, read as millimetres",
                          "s in inches, read as metres", "s in inches, read as millimetres"));
  EXPECT_THAT(followers, ::testing::IsEmpty());
}

TEST(ConventionTrial, PairsOfUpToTenJointsAreExchanged) {
  for (const std::size_t joints : {10U, 11U}) {
    Robot robot;
    for (std::size_t j = 0; j < joints; ++j) {
      MovingJoint joint;
      joint.name = "j" + std::to_string(j);
      joint.axis = KDL::Vector(j % 3 == 0 ? 1.0 : 0.0, j % 3 == 1 ? 1.0 : 0.0, j % 3 == 2 ? 1.0 : 0.0);
      joint.origin = KDL::Frame(KDL::Vector(0.2, 0.1, 0.1));
      robot.joints.push_back(joint);
    }
    const std::vector<std::string> found = descriptions(complete_model(robot));
    const auto exchanged = std::count_if(found.begin(), found.end(), [](const std::string& text) {
      return text.find("exchanged") != std::string::npos;
    });
    EXPECT_EQ(exchanged, joints == 10 ? 45 : 0);
    EXPECT_THAT(found, Contains("the joints in reversed order"));
  }
}

// ---- how they are judged -------------------------------------------------------------------------------------------

/// Whether readings stood on either side of a limit, near it.
struct Sides {
  int below = 0;
  int above = 0;
};

// NOLINTNEXTLINE(readability-function-cognitive-complexity): the rule written out
TEST(ConventionTrial, ReadingsThatAreRegisteredAboutAsWellAreFitted) {
  Sides of_present;
  Sides of_nearest;
  int bounds = 0;
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    Measured m = measured(light_arm(), seed, {.configurations = 16, .lever = 0.02, .angle = seed == 4 ? 0.0005 : 0.03});
    m.data.joint_values.row(seed == 2 ? 1 : 5) *= seed == 3 ? 1.0 : -1.0;
    for (Observation& o : m.data.observations) {
      o.split = o.configuration == 3 ? Split::test : Split::train;
      o.position.x() += o.split == Split::test ? 1.0 : 0.0;
    }
    const TrainingRows training(m.data);
    const std::vector<ConventionTrial> trials = try_conventions(m.model, m.data, m.free, {.threads = 1});
    EXPECT_TRUE(
        std::is_sorted(trials.begin(), trials.end(), [](const auto& a, const auto& b) { return a.rms < b.rms; }));
    double present = 0.0;
    double nearest = 1e9;
    for (const ConventionTrial& trial : trials) {
      present = trial.present ? trial.registered : present;
      nearest = std::min(nearest, trial.registered);
    }
    for (const ConventionTrial& trial : trials) {
      Measurements reading = *training;
      reading.joint_values = trial.joint_values;
      const Estimate start = nominal_start(m.model, reading);
      const double registered = rms_of(m.model, reading, start);
      if (trial.registered < 2.0 * present) {
        EXPECT_NEAR(trial.registered, registered, 1e-9) << trial.description;
      } else {
        EXPECT_LT(trial.registered, registered + 1e-9) << trial.description;
        bounds += trial.registered < 0.999 * registered ? 1 : 0;
      }
      const double beside_present = registered / present;
      const double beside_nearest = registered / nearest;
      const bool worth = trial.present || (beside_present < 2.0 && beside_nearest < 5.0);
      if (!worth && (beside_present > 5.0 || beside_nearest > 12.0)) {
        EXPECT_EQ(trial.rms, trial.registered) << trial.description;
        continue;
      }
      const TrialFit fit{.model = m.model, .free = m.free, .registration = {}, .joint = {}};
      const double fitted = fitted_rms(fit, reading, start);
      EXPECT_NEAR(trial.rms, worth ? fitted : trial.registered, 1e-9) << trial.description << " " << beside_present;
      if (trial.present || fitted > 0.999 * trial.registered) {
        continue;  // it makes no difference
      }
      if (beside_nearest < 5.0) {
        (beside_present < 2.0 ? of_present.below : of_present.above) += 1;
      }
      if (beside_present < 2.0) {
        (beside_nearest < 5.0 ? of_nearest.below : of_nearest.above) += 1;
      }
    }
  }
  EXPECT_GT(bounds, 100) << "readings that nothing registers were registered";
  EXPECT_TRUE(of_present.below > 0 && of_present.above > 0) << of_present.below << " " << of_present.above;
  EXPECT_TRUE(of_nearest.below > 0 && of_nearest.above > 0) << of_nearest.below << " " << of_nearest.above;
}

TEST(ConventionTrial, ABetterConventionLeavesAFifthOfThePresentOnesMisfit) {
  const auto with = [](double best, bool present_first) {
    ConventionTrial present;
    present.present = true;
    present.rms = 1.0;
    ConventionTrial other;
    other.rms = best;
    other.description = "other";
    return present_first ? std::vector{present, other} : std::vector{other, present};
  };
  ASSERT_TRUE(better_convention(with(0.199, false)));
  EXPECT_EQ(better_convention(with(0.199, false))->description, "other");
  EXPECT_FALSE(better_convention(with(0.201, false)));
  EXPECT_TRUE(better_convention(with(0.499, false), 0.5));
  EXPECT_FALSE(better_convention(with(0.501, false), 0.5));
  EXPECT_FALSE(better_convention(with(0.1, true), 20.0)) << "the present one is the best";
  EXPECT_FALSE(better_convention({}));
  EXPECT_FALSE(better_convention({with(0.1, false).front()})) << "nothing to compare with";
}

TEST(ConventionTrial, RefusesWhatDoesNotHoldTogether) {
  Measured m = measured(large_arm(), 1, {.configurations = 6, .targets = 1});
  const Measured other = measured(light_arm(), 1, {.configurations = 6, .targets = 3});
  EXPECT_THAT(refusal([&] { try_conventions(m.model, m.data, other.free); }), HasSubstr("coordinate of targets"));
  m.data.joint_values(0, 0) = std::nan("");
  EXPECT_THAT(refusal([&] { try_conventions(m.model, m.data, m.free); }), HasSubstr("a joint value is not finite"));
}

}  // namespace
}  // namespace kdl_calibration
