// Chooses 30 configurations to measure and writes them to plan.csv.
#include <fstream>
#include <iostream>
#include <kdl_calibration/kdl_calibration.hpp>

int main() {
  using namespace kdl_calibration;
  const Robot robot = load_robot("robot.urdf");
  PlanOptions options;
  options.count = 30;
  options.least_height = 0.2;  // [m] of every target above the base's x-y plane
  options.least_radius = 0.7;  // [m] from the first joint's axis
  const MeasuringPlan plan = plan_measurements(robot, options);
  std::ofstream file("plan.csv");
  file << plan_csv(plan, robot.joints);
  std::cout << plan.configurations.size()
            << " configurations. Expected 1 sigma of a predicted point: " << plan.predicted_mean * 1e3
            << " mm on average, " << plan.predicted_max * 1e3 << " mm at most\n";
  return file ? 0 : 1;
}
