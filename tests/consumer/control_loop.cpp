// Sends compensated joint values along a path of the nominal robot, through a straight wrist.
#include <algorithm>
#include <cmath>
#include <iostream>
#include <kdl_calibration/kdl_calibration.hpp>

int main() {
  using namespace kdl_calibration;
  const Robot robot = load_robot("robot.urdf");
  CompensationOptions options;
  options.most_change = 1.0;  // [rad] of a joint; the default of 5 degrees is enough for a robot of ordinary errors
  options.most_step = 1e-3;   // [rad] of a correction between two points: the largest joint speed times the cycle
  const Compensator compensator(load_calibration("result.json", robot), options);

  Eigen::VectorXd q{{0.3, -0.2, 0.4, 0.5, -0.1, -0.7}};
  CompensatedPoint point = compensator.solve(q);  // once, before the motion
  double largest_step = 0.0;
  double largest_error = 0.0;  // [m]
  for (; q[4] < 0.1; q[4] += 1e-3) {
    const CompensatedPoint next = compensator.solve(q, point);
    largest_step = std::max(largest_step, (next.change - point.change).cwiseAbs().maxCoeff());
    largest_error = std::max(largest_error, next.position_error);
    point = next;  // here a controller would receive point.joint_values
  }
  std::cout << "The corrections changed by at most " << largest_step * 1e3 << " mrad a point,\n"
            << "and the position is off by at most " << largest_error * 1e6 << " micrometres.\n";
  return largest_step <= 1.0001e-3 && largest_error < 1e-5 ? 0 : 1;
}
