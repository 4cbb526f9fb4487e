// Joint values with which the calibrated arm reaches the pose that the nominal arm has at q, by KDL's solver.
#include <iostream>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <kdl_calibration/kdl_calibration.hpp>

int main() {
  using namespace kdl_calibration;
  const Robot robot = load_robot("robot.urdf");
  const Calibration found = load_calibration("result.json", robot);
  const KDL::Chain chain = found.urdf_chain();

  KDL::JntArray q(chain.getNrOfJoints());
  q.data << 0.3, -0.2, 0.4, -0.5, 0.6, -0.7;
  KDL::Frame goal;
  KDL::ChainFkSolverPos_recursive(robot.chain).JntToCart(q, goal);

  KDL::JntArray corrected(chain.getNrOfJoints());
  const int status = KDL::ChainIkSolverPos_LMA(chain).CartToJnt(q, goal, corrected);
  KDL::Frame reached;
  KDL::ChainFkSolverPos_recursive(chain).JntToCart(corrected, reached);
  std::cout << "corrections of the joints [mrad]: " << (corrected.data - q.data).transpose() * 1e3 << "\n"
            << "distance to the goal: " << (reached.p - goal.p).Norm() * 1e3 << " mm\n";
  return status == 0 && (reached.p - goal.p).Norm() < 1e-4 ? 0 : 1;
}
