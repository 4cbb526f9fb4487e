#include "estimation/prediction.hpp"

#include <gtest/gtest.h>

#include "measurements/readings.hpp"
#include "model/kinematics.hpp"
#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::prediction_test {
namespace {

TEST(Prediction, JacobianIsTheCentralDifference) {
  testing::VirtualExperiment experiment = testing::VirtualExperiment({.ranges = published_ranges, .random = Random(7)});
  const VirtualRobot& robot = experiment.robot;
  const Eigen::VectorXd q = experiment.configurations(1).col(0);
  const Measurements measured = experiment.measure(q);
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free);
  const Matrix3Xd jacobian = PositionPredictor(experiment.model, robot.truth, experiment.free).jacobians(q)[2];
  const auto point = [&](const Eigen::VectorXd& step) {
    const Estimate moved = problem.unknowns().moved(robot.truth, step);
    return Eigen::Vector3d(moved.frames.base() *
                           (flange_poses(experiment.model, moved, q)[0] * moved.frames.targets[2].X_FT.translation()));
  };
  const Eigen::MatrixXd expected = testing::central_differences(problem.columns(), 1e-6, point);
  for (Eigen::Index c = 0; c < problem.columns(); ++c) {
    EXPECT_LT((jacobian.col(c) - expected.col(c)).norm(), 1e-8) << c;
  }
}

// The target is measured off by a step in W and turned by a vector in its own frame.
TEST(Prediction, ResidualsOfPosesAloneHaveARotation) {
  Eigen::Isometry3d X_WT(Eigen::Translation3d(0.4, -0.8, 1.3));
  X_WT.linear() = rotation_exp({0.3, -1.1, 0.7});
  const Eigen::Vector3d step(1e-3, -2e-3, 3e-3);
  const Eigen::Vector3d turn(0.02, -0.03, 0.01);
  const Eigen::Vector3d position = X_WT.translation() + step;
  const Eigen::Quaterniond turned(Eigen::Matrix3d(X_WT.linear() * rotation_exp(turn)));
  const Residual of_pose = residual(Pose{position, turned}, X_WT);
  EXPECT_LT((of_pose.position - step).norm(), 1e-15);
  EXPECT_EQ(of_pose.directions, Eigen::Matrix3d::Identity());
  ASSERT_TRUE(of_pose.rotation);
  EXPECT_LT((*of_pose.rotation - turn).norm(), 1e-14);
  const Residual opposite = residual(Pose{position, Orientation(-turned.coeffs())}, X_WT);
  ASSERT_TRUE(opposite.rotation);
  EXPECT_LT((*opposite.rotation - turn).norm(), 1e-14);
  for (const Observation& row : testing::one_of_each().observations) {
    const Residual found = residual(row.reading, X_WT);
    EXPECT_EQ(found.position, measured_minus_predicted(row.reading, X_WT.translation())) << row.reading.index();
    EXPECT_EQ(found.directions, directions(row.reading, X_WT.translation())) << row.reading.index();
    EXPECT_EQ(found.rotation.has_value(), has_orientation(row)) << row.reading.index();
  }
}

}  // namespace
}  // namespace kdl_calibration::prediction_test
