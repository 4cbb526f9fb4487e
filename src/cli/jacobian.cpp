#include <memory>

#include "frames.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "options.hpp"
#include "subcommands.hpp"
#include "text.hpp"

namespace kdl_calibration::cli {
namespace {

Json rows(const Matrix6Xd& matrix) {
  Json result = Json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    Json row = Json::array();
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) {
      row.push_back(matrix(r, c));
    }
    result.push_back(row);
  }
  return result;
}

std::string json(const ManipulatorJacobians& jacobians) {
  return json_text({{"kdl", rows(jacobians.kdl)},
                    {"matrix_derivative", rows(jacobians.matrix_derivative)},
                    {"cross_product", rows(jacobians.cross_product)},
                    {"largest_difference", jacobians.largest_difference}});
}

std::string table(const Robot& robot, const ManipulatorJacobians& jacobians) {
  constexpr int kLabel = 10;
  std::vector<int> widths;
  std::string text = robot.tip + " in " + robot.base + ", per rad (or m) of each joint; m/rad above, rad/rad below\n" +
                     padded("", -kLabel);
  for (const MovingJoint& joint : robot.joints) {
    widths.push_back(std::max(12, static_cast<int>(joint.name.size()) + 2));
    text += padded(joint.name, widths.back());
  }
  text += "\n";
  const std::vector<std::string> labels = {"v_x", "v_y", "v_z", "omega_x", "omega_y", "omega_z"};
  for (std::size_t r = 0; r < labels.size(); ++r) {
    text += padded(labels[r], -kLabel);
    for (std::size_t c = 0; c < widths.size(); ++c) {
      text += padded(fixed(jacobians.kdl(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)), 7), widths[c]);
    }
    text += "\n";
  }
  return text + "largest difference between KDL's solver, matrix derivatives and cross products: " +
         Json(jacobians.largest_difference).dump() + "\n";
}

ExitStatus run(const ArmAtJoints& arguments) {
  const Robot robot = load(arguments.robot);
  const ErrorModel model = complete_model(robot);
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  if (!arguments.result.empty()) {
    errors = read_errors(arguments.result, model);
  }
  const ManipulatorJacobians jacobians = manipulator_jacobians(model, errors, joint_values(robot, arguments.joints));
  print(arguments.json ? json(jacobians) : table(robot, jacobians));
  return done;
}

}  // namespace

Subcommand add_jacobian(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("jacobian", "The manipulator Jacobian at joint values, by three routes");
  const auto arguments = std::make_shared<ArmAtJoints>();
  add_arm_at_joints(*app, *arguments);
  add_example(*app, "kdlcal jacobian --joints 0,10,-20,0,45,0 --degrees");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
