// Calibrations that keep axes parallel and meeting, of robots with kinematics written out here.

#include <gmock/gmock.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/random.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/kdl_calibration.hpp"
#include "kept_axes_support.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::kept_axes_test {
namespace {

using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Translation3d;
using Eigen::Vector3d;
using testing::AxisLine;
using ::testing::HasSubstr;

// An R-2000iC whose axes 2 and 3 are parallel and whose wrist axes meet. Between the others there is any rotation.
class WristedArm {
public:
  WristedArm(double length, double angle, std::uint64_t seed) : random_(seed) {
    for (Isometry3d& link : links_) {
      link = shift(length) * turn(angle);
    }
    for (double& zero : zeros_) {
      zero = angle * random_.normal();
    }
    links_[1].linear().setIdentity();   // 2 to 3
    links_[3].translation().setZero();  // 4 to 5
    links_[4].translation().setZero();  // 5 to 6
    for (Vector3d& target : targets_) {
      target = Vector3d(0.1, 0.3, 0.1) + 0.2 * any();
    }
    X_WB_ = Translation3d(3.0, -1.0, 0.2) * AngleAxisd(2.1, any().normalized());
  }

  // Of a target in the measuring frame.
  Vector3d measured(const Eigen::VectorXd& q, std::size_t target) const {
    const auto joint = [&](Eigen::Index i, const Vector3d& axis) {
      return AngleAxisd(q[i] + zeros_[static_cast<std::size_t>(i)], axis);
    };
    const Vector3d x = Vector3d::UnitX();
    const Vector3d y = Vector3d::UnitY();
    const Isometry3d X_BF = Translation3d(0, 0, 0.67) * joint(0, Vector3d::UnitZ()) * Translation3d(0, 0.312, 0) *
                            links_[0] * joint(1, x) * Translation3d(0, 0, 1.075) * links_[1] * joint(2, x) *
                            Translation3d(0, 1.28, 0.225) * links_[2] * joint(3, y) * links_[3] * joint(4, x) *
                            links_[4] * joint(5, y) * Translation3d(0, 0.215, 0);
    return X_WB_ * (X_BF * targets_[target]);
  }

  Measurements measurements(int configurations, double noise = 0.0) {
    Measurements result;
    result.source = "virtual.csv";
    result.joints = {"joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"};
    result.targets = {"A", "B", "C"};
    result.stations = {"W"};
    result.joint_values.resize(6, configurations);
    for (int c = 0; c < configurations; ++c) {
      result.configurations.push_back(std::to_string(c));
      result.joint_values.col(c) = somewhere();
      for (int target = 0; target < 3; ++target) {
        const Vector3d point = measured(result.joint_values.col(c), static_cast<std::size_t>(target)) + noise * any();
        result.observations.push_back({.reading = Point{point}, .configuration = c, .target = target});
      }
    }
    return result;
  }

  Eigen::VectorXd somewhere() {
    return Eigen::VectorXd::NullaryExpr(
        6, [&](Eigen::Index i) { return i < 4 ? random_.uniform(-1.5, 1.5) : random_.uniform(-2.5, 2.5); });
  }

private:
  Vector3d any() {
    return Vector3d::NullaryExpr([&] { return random_.normal(); });
  }
  Isometry3d shift(double size) { return Isometry3d(Translation3d(size * any())); }
  Isometry3d turn(double size) { return Isometry3d(AngleAxisd(size * random_.normal(), any().normalized())); }

  Random random_;
  std::array<Isometry3d, 5> links_;  // behind joints 1 to 5, after the nominal offsets
  std::array<double, 6> zeros_{};
  std::array<Vector3d, 3> targets_;
  Isometry3d X_WB_;
};

CalibrationOptions plain(KeptAxes kept) {
  CalibrationOptions options{.validation = {.held_out = false}, .diagnosis = {.try_readings = false}};
  options.parameters.keep_axes = kept;
  options.priors.automatic = false;
  options.effects.automatic = false;
  options.noise.weights = Weights::equal;
  return options;
}

void expect_kept(const Robot& robot) {
  const Eigen::VectorXd q = (Eigen::VectorXd(6) << 0.3, -0.2, 0.4, -0.5, 0.6, -0.7).finished();
  const std::vector<AxisLine> lines = testing::axis_lines(robot.chain, q);
  EXPECT_LT(testing::tilt(lines[1], lines[2]), 1e-12);
  EXPECT_LT(testing::missed_point({lines[3], lines[4], lines[5]}), 1e-12);
}

double largest_error(const CalibratedArm& arm, WristedArm& truth) {
  double largest = 0.0;
  for (int i = 0; i < 100; ++i) {
    const Eigen::VectorXd q = truth.somewhere();
    for (std::size_t target = 0; target < 3; ++target) {
      const std::string name(1, static_cast<char>('A' + target));
      const Vector3d predicted = arm.predict(q, name, PredictionFrame::measuring).position;
      largest = std::max(largest, (predicted - truth.measured(q, target)).norm());
    }
  }
  return largest;
}

TEST(CalibrationWithKeptAxes, FindsARobotOfTheFamilyExactly) {
  const Robot robot = testing::fanuc();
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    WristedArm truth(0.0025, 0.03, seed);
    const Calibration found = calibrate(robot, truth.measurements(30), plain(KeptAxes::closed_form));
    EXPECT_LT(largest_error(found.arm(), truth), 1e-9) << seed;
    expect_kept(parse_robot(calibrated_urdf(robot, found)));
  }
}

TEST(CalibrationWithKeptAxes, KeepsThemInTheUrdfOfARobotThatDoesNotAndSaysWhatThatCosts) {
  const Robot robot = testing::fanuc();
  const SimulatedExperiment experiment = simulate(robot, {.noise = 3e-5, .length_error = 1e-3, .angle_error = 1e-3});
  CalibrationOptions options{.diagnosis = {.try_readings = false}};
  const Calibration free = calibrate(robot, experiment.measurements, options);
  options.parameters.keep_axes = KeptAxes::closed_form;
  const Calibration kept = calibrate(robot, experiment.measurements, options);
  expect_kept(parse_robot(calibrated_urdf(robot, kept)));
  EXPECT_GT(kept.accuracy().train.after.rms, 2.0 * free.accuracy().train.after.rms);

  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / ("kept_axes_test_" + std::to_string(::getpid()) + ".json");
  write_result(file, robot, experiment.measurements, kept);
  const nlohmann::json json = nlohmann::json::parse(read_text_file(file));
  const Calibration again = load_calibration(file, robot);
  std::filesystem::remove(file);
  const nlohmann::json& block = json.at("kept_axes");
  EXPECT_EQ(block.at("parallel"), nlohmann::json::parse(R"([["joint_2", "joint_3"]])"));
  EXPECT_EQ(block.at("meeting"), nlohmann::json::parse(R"([["joint_4", "joint_5", "joint_6"]])"));
  EXPECT_EQ(block.at("without").at("train").at("after").at("rms"), free.accuracy().train.after.rms);
  EXPECT_EQ(block.at("without").at("held_out").at("after").at("rms"), free.accuracy().held_out()->after.rms);
  EXPECT_TRUE(block.at("without").at("not_computed").is_null());
  const Eigen::VectorXd q = (Eigen::VectorXd(6) << 0.3, -0.2, 0.4, -0.5, 0.6, -0.7).finished();
  EXPECT_EQ(again.arm().flange_pose(q).matrix(), kept.arm().flange_pose(q).matrix());
}

// 27 coordinates are enough for 24 unknowns, but not for the 33 with free axes.
TEST(CalibrationWithKeptAxes, SaysWhyTheCostIsNotKnown) {
  const Robot robot = testing::fanuc();
  WristedArm truth(0.001, 0.001, 4);
  const Measurements measurements = truth.measurements(3, 3e-5);
  CalibrationOptions options = plain(KeptAxes::angles);
  const Calibration found = calibrate(robot, measurements, options);
  const std::filesystem::path file =
      std::filesystem::temp_directory_path() / ("kept_axes_cost_" + std::to_string(::getpid()) + ".json");
  write_result(file, robot, measurements, found);
  const nlohmann::json json = nlohmann::json::parse(read_text_file(file));
  std::filesystem::remove(file);
  const nlohmann::json& without = json.at("kept_axes").at("without");
  EXPECT_THAT(without.at("not_computed").get<std::string>(), HasSubstr("unknowns"));
  EXPECT_TRUE(without.at("train").is_null());
}

}  // namespace
}  // namespace kdl_calibration::kept_axes_test
