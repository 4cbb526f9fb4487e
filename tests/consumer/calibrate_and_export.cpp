// Calibrates robot.urdf with measurements.csv. Writes the result, the page for people and the corrected URDF.
#include <iostream>
#include <kdl_calibration/kdl_calibration.hpp>

int main() try {
  using namespace kdl_calibration;
  const Robot robot = load_robot("robot.urdf");
  const Measurements measurements = read_measurements(robot, "measurements.csv");
  const Calibration found = calibrate(robot, measurements);
  for (const Doubt& doubt : found.doubts()) {
    std::cerr << to_string(doubt.cause) << ": " << doubt.message << "\n";
  }
  write_result("result.json", robot, measurements, found);
  write_report("report.html", robot, measurements, found);
  write_urdf("calibrated.urdf", robot, found);
  if (const BeforeAfter* unseen = found.accuracy().held_out()) {
    std::cout << "RMS at unseen configurations: " << unseen->before.rms * 1e3 << " mm nominal, "
              << unseen->after.rms * 1e3 << " mm calibrated\n";
  }
  return found.trusted() ? 0 : 1;
} catch (const kdl_calibration::InputError& error) {
  std::cerr << error.what() << "\n";
  return 2;
}
