// Calibrates a virtual robot. Compares predictions with the true robot at 100 configurations that were not fitted.
#include <iostream>
#include <kdl_calibration/kdl_calibration.hpp>

int main() {
  using namespace kdl_calibration;
  const Robot robot = load_robot("robot.urdf");
  SimulationOptions options;
  options.test_configurations = 100;
  options.noise = 3e-5;         // [m] of every measured coordinate
  options.length_error = 1e-3;  // [m] 1 sigma of the true errors
  options.angle_error = 1e-3;   // [rad]
  const SimulatedExperiment experiment = simulate(robot, options);
  const CalibratedArm arm = calibrate(robot, experiment.measurements).arm();
  int within = 0;
  for (const auto& q : experiment.measurements.joint_values.rightCols(100).colwise()) {
    // In the tracker's frame: the base frame itself is known only up to a rotation about the first joint.
    const PredictedPoint predicted = arm.predict(q, "A", PredictionFrame::measuring);
    const PredictedPoint truth = experiment.truth.predict(q, "A", PredictionFrame::measuring);
    within += (predicted.position - truth.position).norm() < predicted.radius_95 ? 1 : 0;
  }
  std::cout << within << " of 100 true points lie within the predicted radius\n";
  return within >= 95 ? 0 : 1;
}
