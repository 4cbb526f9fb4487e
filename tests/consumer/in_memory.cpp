// Calibrates with points that a tracker's interface delivers, without a file. Here a virtual robot delivers them.
#include <iostream>
#include <kdl_calibration/kdl_calibration.hpp>
#include <string>

int main() {
  using namespace kdl_calibration;
  const Robot robot = load_robot("robot.urdf");
  SimulationOptions experiment;
  experiment.configurations = 40;
  experiment.noise = 3e-5;         // [m] of every measured coordinate
  experiment.length_error = 1e-3;  // [m] 1 sigma of the true errors
  experiment.angle_error = 1e-3;   // [rad]
  const Measurements measured = simulate(robot, experiment).measurements;

  Measurements m;
  for (const MovingJoint& joint : robot.joints) {
    m.joints.push_back(joint.name);
  }
  m.targets = {"A", "B", "C"};
  m.joint_values = measured.joint_values;  // joints x configurations [rad]
  for (int c = 0; c < m.joint_values.cols(); ++c) {
    m.configurations.push_back(std::to_string(c + 1));
  }
  for (const Observation& delivered : measured.observations) {
    Observation& row = m.observations.emplace_back();
    row.reading = Point{delivered.position()};  // [m] in the tracker's frame
    row.configuration = delivered.configuration;
    row.target = delivered.target;
    row.split = row.configuration % 4 == 3 ? Split::test : Split::train;  // every fourth one only tests the result
  }
  const Calibration found = calibrate(robot, m);
  const BeforeAfter& test = *found.accuracy().test;
  std::cout << "RMS at test points: " << test.before.rms * 1e3 << " mm nominal, " << test.after.rms * 1e3
            << " mm calibrated\n";
  return found.trusted() && test.after.rms < 2e-4 ? 0 : 1;
}
