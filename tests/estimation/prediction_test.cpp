#include "estimation/prediction.hpp"

#include <gtest/gtest.h>

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
    return Eigen::Vector3d(moved.X_WB *
                           (flange_poses(experiment.model, moved, q)[0] * moved.targets[2].X_FT.translation()));
  };
  const Eigen::MatrixXd expected = testing::central_differences(problem.columns(), 1e-6, point);
  for (Eigen::Index c = 0; c < problem.columns(); ++c) {
    EXPECT_LT((jacobian.col(c) - expected.col(c)).norm(), 1e-8) << c;
  }
}
}  // namespace
}  // namespace kdl_calibration::prediction_test
