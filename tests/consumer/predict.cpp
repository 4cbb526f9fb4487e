// Predicts where target A really is, from a saved result: no measurements and no fit are needed.
#include <iostream>
#include <kdl_calibration/kdl_calibration.hpp>

int main() {
  using namespace kdl_calibration;
  const Robot robot = load_robot("robot.urdf");
  const CalibratedArm arm = load_calibration("result.json", robot).arm();
  const Eigen::VectorXd q{{0.3, -0.2, 0.4, -0.5, 0.6, -0.7}};
  const PredictedPoint in_base = arm.predict(q, "A");
  const PredictedPoint at_tracker = arm.predict(q, "A", PredictionFrame::measuring);
  std::cout << "A is at " << in_base.position.transpose() * 1e3 << " mm in the base frame,\n"
            << "and at " << at_tracker.position.transpose() * 1e3 << " mm in the tracker's frame.\n"
            << "A new measurement lies within " << in_base.radius_95 * 1e3 << " mm of it with 95 %.\n";
  if (in_base.outside) {
    std::cout << "These joint values are outside the measured region: the radius does not hold.\n";
  }
  return in_base.outside ? 1 : 0;
}
