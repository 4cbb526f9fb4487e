#include "results/mastering.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/json_tree.hpp"
#include "base/sha256.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "effects/arm_kinematics.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/result_json.hpp"
#include "results/saved_calibration.hpp"
#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::mastering_test {
namespace {

using Eigen::VectorXd;
using ::testing::HasSubstr;
using Json = tree::Json;

JointConvention pendant() { return read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json"); }

const Robot& robot() {
  static const Robot result = fanuc();
  return result;
}

/// A calibrated FANUC whose joints are those of its pendant.
const std::string& result_of_fanuc() {
  static const std::string result = [] {
    VirtualExperiment experiment({.model = complete_model(robot()),
                                  .targets = published_targets(3),
                                  .with_errors = all_parameters(complete_model(robot())),
                                  .random = Random(5)});
    const Measurements measurements = experiment.measure(25, {.sigma = 3e-5});
    CalibrationSettings options{.diagnosis = {.try_readings = false}};
    options.diagnosis.convention = pendant();
    return result_json(robot(), measurements, calibrate(complete_model(robot()), measurements, options));
  }();
  return result;
}

/// The same with large effects of functions of single joint values.
std::string with_effects() {
  Json json = Json::parse(result_of_fanuc());
  json["effects"]["terms"] = Json::parse(R"([
    {"name": "gain.2", "joint": "joint_2", "group": "gain", "about": "own", "function": {}, "mean": 0.1, "scale": 0.5,
     "sigma": 1.0, "coefficient": 0.002},
    {"name": "ripple.3.sin200", "joint": "joint_3", "group": "ripple", "about": "own",
     "function": {"of": "sin", "times": 200}, "mean": 0.2, "scale": 0.7, "sigma": 1.0, "coefficient": 0.0003},
    {"name": "ripple.3.cos200", "joint": "joint_3", "group": "ripple", "about": "own",
     "function": {"of": "cos", "times": 200}, "mean": -0.1, "scale": 0.4, "sigma": 1.0, "coefficient": -0.0002},
    {"name": "tables.4.1", "joint": "joint_4", "group": "tables", "about": "own",
     "function": {"number": 3, "length": 0.4, "lower": -1.5, "upper": 1.5, "withheld": [[-0.2, 0.1]]}, "mean": 0.1,
     "scale": 1.0, "sigma": 1.0, "coefficient": 0.001},
    {"name": "coupling.6.4", "joint": "joint_6", "group": "coupling", "about": "own", "function": {"joint": 4},
     "mean": 0.3, "scale": 0.6, "sigma": 1.0, "coefficient": 0.004},
    {"name": "coupling.5.4.sin1", "joint": "joint_5", "group": "coupling", "about": "own",
     "function": {"joint": 4, "of": "sin", "times": 1}, "mean": 0.2, "scale": 0.7, "sigma": 1.0, "coefficient": 0.003},
    {"name": "coupling.5.4.cos1", "joint": "joint_5", "group": "coupling", "about": "own",
     "function": {"joint": 4, "of": "cos", "times": 1}, "mean": 0.1, "scale": 0.3, "sigma": 1.0,
     "coefficient": -0.002}])");
  json["hashes"] = tree::hashes(json);
  return json.dump();
}

const std::vector<EnteredOffset> kEntered = {{.joint = "J2", .added = 0.004},
                                             {.joint = "J3", .added = -0.003},
                                             {.joint = "J4", .added = 0.002},
                                             {.joint = "J6", .added = 0.005}};

/// q2 = -J2, q3 = J3 + J2, q4 = -J4, q5 = J5, q6 = -J6: by these the URDF's values grow.
VectorXd grown() { return VectorXd{{0.0, -0.004, 0.001, -0.002, 0.0, -0.005}}; }

MasteredResult mastered(const std::string& result, const std::vector<EnteredOffset>& entered = kEntered) {
  return mastered_result(result, "r.json", robot(), pendant(), entered);
}

double distance(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) { return (a.matrix() - b.matrix()).norm(); }

// The motors do not move when offsets are entered: the same arm stands where it stood, at joint values that have grown.
TEST(Mastering, DescribesTheSameArmAtTheJointValuesAfterTheEntry) {
  for (const std::string& result : {result_of_fanuc(), with_effects()}) {
    const MasteredResult after = mastered(result);
    const CalibrationParts before = parse_calibration(result, robot());
    const CalibrationParts parts = parse_calibration(after.json, robot());
    const ArmKinematics old_arm(before.model, before.estimate.errors, before.estimate.effects);
    const ArmKinematics new_arm(parts.model, parts.estimate.errors, parts.estimate.effects);
    Random random(3);
    const Eigen::MatrixXd q = random_configurations(limits_of(robot().joints), 200, random);
    double stale = 0.0;
    for (const auto& column : q.colwise()) {
      const VectorXd later = column + grown();
      EXPECT_LT(distance(old_arm.flange_pose(column), new_arm.flange_pose(later)), 1e-12);
      stale = std::max(stale, distance(old_arm.flange_pose(column), old_arm.flange_pose(later)));
    }
    EXPECT_GT(stale, 5e-3);
    EXPECT_LT(after.moved, 1e-12);
  }
}

TEST(Mastering, LeavesTheRestOfARoundedEntry) {
  const Json before = Json::parse(result_of_fanuc());
  const Json after = Json::parse(mastered(result_of_fanuc()).json);
  for (std::size_t j = 0; j < 6; ++j) {
    const Json& old_joint = before["joint_offsets"]["joints"][j];
    const Json& joint = after["joint_offsets"]["joints"][j];
    const auto entered = std::find_if(kEntered.begin(), kEntered.end(),
                                      [&](const EnteredOffset& offset) { return offset.joint == joint["joint"]; });
    if (joint["measurable"] && entered != kEntered.end()) {
      EXPECT_NEAR(joint["add"].get<double>(), old_joint["add"].get<double>() - entered->added, 1e-15) << j;
      EXPECT_EQ(joint["std"], old_joint["std"]);
    }
  }
  const VectorXd difference = parse_calibration(after.dump(), robot()).estimate.errors -
                              parse_calibration(before.dump(), robot()).estimate.errors;
  EXPECT_LT((difference.head<6>() + grown()).norm(), 1e-15);
  EXPECT_EQ(difference.tail(difference.size() - 6).norm(), 0.0);
}

TEST(Mastering, MovesTheUrdfAndTheMeasuredRegion) {
  const CalibrationParts before = parse_calibration(result_of_fanuc(), robot());
  const std::string text = mastered(result_of_fanuc()).json;
  const CalibrationParts after = parse_calibration(text, robot());
  const std::string urdf = calibrated_urdf(robot(), after.model, after.urdf_errors);
  EXPECT_EQ(Json::parse(text)["exported_urdf"]["sha256"], sha256(urdf));
  const KDL::Chain old_chain = parse_robot(calibrated_urdf(robot(), before.model, before.urdf_errors)).chain;
  const KDL::Chain new_chain = parse_robot(urdf).chain;
  const VectorXd q{{0.3, -0.2, 0.4, -0.5, 0.6, -0.7}};
  EXPECT_LT(difference(kdl_pose(old_chain, q), kdl_pose(new_chain, q + grown())), 1e-9);
  for (std::size_t j = 0; j < 6; ++j) {
    EXPECT_NEAR(after.region.joints[j].first - before.region.joints[j].first, grown()[static_cast<int>(j)], 1e-15);
  }
}

TEST(Mastering, IsUndoneByTheOppositeEntry) {
  std::vector<EnteredOffset> back = kEntered;
  std::for_each(back.begin(), back.end(), [](EnteredOffset& offset) { offset.added *= -1.0; });
  const std::string start = with_effects();
  const Json twice = Json::parse(mastered(mastered(start).json, back).json);
  const Json once = Json::parse(start);
  for (std::size_t i = 0; i < once["effects"]["terms"].size(); ++i) {
    for (const char* key : {"coefficient", "mean"}) {
      EXPECT_NEAR(twice["effects"]["terms"][i][key].get<double>(), once["effects"]["terms"][i][key].get<double>(),
                  1e-15);
    }
  }
  EXPECT_EQ(twice["mastering_entered"]["earlier"]["sha256_of_earlier_result"], sha256(start));
}

TEST(Mastering, RefusesWhatWouldBeWrongWithoutAWord) {
  EXPECT_THAT(refusal([] { mastered(result_of_fanuc(), {{.joint = "J2", .added = 0.001, .is_length = true}}); }),
              HasSubstr("'J2' is a length, expected deg or rad"));
  Json doubted = Json::parse(result_of_fanuc());
  doubted["trusted"] = false;
  doubted["hashes"] = tree::hashes(doubted);
  EXPECT_THAT(refusal([&] { mastered(doubted.dump()); }), HasSubstr("r.json: is not to be trusted"));
  Json changed = Json::parse(result_of_fanuc());
  changed["parameters"][0]["error"] = 0.0;
  EXPECT_THROW(mastered(changed.dump()), InputError);
}

}  // namespace
}  // namespace kdl_calibration::testing::mastering_test
