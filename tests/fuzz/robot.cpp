#include <kdl/chainfksolverpos_recursive.hpp>
#include "calibration/calibrate.hpp"
#include "results/calibrated_urdf.hpp"

#include "promise.hpp"
#include "targets.hpp"

namespace kdl_calibration::fuzzing {
namespace {

KDL::Frame pose(const KDL::Chain& chain) {
  KDL::JntArray q(chain.getNrOfJoints());
  for (unsigned i = 0; i < q.rows(); ++i) {
    q(i) = 0.3 - 0.2 * i;
  }
  KDL::Frame result;
  KDL::ChainFkSolverPos_recursive(chain).JntToCart(q, result);
  return result;
}

double largest_length(const Robot& robot) {
  double largest = robot.tip_origin.p.Norm();
  for (const MovingJoint& joint : robot.joints) {
    largest = std::max(largest, joint.origin.p.Norm());
  }
  return largest;
}

void check_export(const Robot& robot) {
  const ErrorModel model = complete_model(robot);
  const auto count = static_cast<Eigen::Index>(model.parameters.size());
  promise(calibrated_urdf(robot, model, Eigen::VectorXd::Zero(count)) == robot.urdf, "no error, no change");
  Eigen::VectorXd errors = Eigen::VectorXd::LinSpaced(count, -0.01, 0.02);
  for (Eigen::Index p = 0; p < count; ++p) {
    if (model.parameters[static_cast<std::size_t>(p)].joint.empty()) {
      errors[p] = 0.0;
    }
  }
  const std::string text = calibrated_urdf(robot, model, errors);
  const Robot again = parse_robot(text, {.base = robot.base, .tip = robot.tip}, "export");
  promise(joint_names(again) == joint_names(robot), "the same joints");
  const double length = largest_length(robot);
  if (length < 1e6) {
    const KDL::Frame expected = pose(error_chain(model, errors));
    const KDL::Frame actual = pose(again.chain);
    const double tolerance = 1e-9 * (1.0 + length);
    promise(KDL::Equal(expected, actual, tolerance), "the export is the calibrated robot");
  }
}

}  // namespace

void urdf(std::string_view bytes) {
  let_input_errors_pass([&] {
    const Robot robot = parse_robot(bytes);
    for (const MovingJoint& joint : robot.joints) {
      promise(std::isfinite(joint.origin.p.Norm()) && std::abs(joint.axis.Norm() - 1.0) < 1e-12, "a sound joint");
    }
    if (robot.joints.size() <= 8) {
      check_export(robot);
    }
  });
}

}  // namespace kdl_calibration::fuzzing
