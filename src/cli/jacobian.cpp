#include <fmt/core.h>
#include <memory>
#include <optional>
#include <utility>

#include "base/number_text.hpp"
#include "cli/frames.hpp"
#include "cli/identification_csv.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/kinematics.hpp"
#include "model/reduction.hpp"
#include "planning/simulation.hpp"
#include "results/saved_calibration.hpp"
#include "two_step/matrix_derivatives.hpp"

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
  std::vector<std::size_t> widths;
  std::string text = robot.tip + " in " + robot.base + ", per rad (or m) of each joint; m/rad above, rad/rad below\n" +
                     std::string(10, ' ');
  for (const MovingJoint& joint : robot.joints) {
    widths.push_back(std::max<std::size_t>(12, joint.name.size() + 2));
    text += std::string(widths.back() - joint.name.size(), ' ') + joint.name;
  }
  text += "\n";
  const std::vector<std::string> labels = {"v_x", "v_y", "v_z", "omega_x", "omega_y", "omega_z"};
  for (std::size_t r = 0; r < labels.size(); ++r) {
    text += fmt::format("{:<10}", labels[r]);
    for (std::size_t c = 0; c < widths.size(); ++c) {
      text += fmt::format("{:>{}}", fixed(jacobians.kdl(static_cast<Eigen::Index>(r), static_cast<Eigen::Index>(c)), 7),
                          widths[c]);
    }
    text += "\n";
  }
  return text + "largest difference between KDL's solver, matrix derivatives and cross products: " +
         Json(jacobians.largest_difference).dump() + "\n";
}

struct JacobianArguments {
  ArmAtJoints arm;
  bool identification = false;
  std::string configuration_file;
  int targets = 3;
  std::string target_file;
  std::string model = "irreducible";
  std::string output;
  bool force = false;
};

// The nominal geometry, or that of the result.
struct Geometry {
  ErrorModel model;
  Eigen::VectorXd errors;
};

Geometry geometry(const JacobianArguments& arguments, const Robot& robot) {
  if (!arguments.arm.result.empty()) {
    CalibrationParts found = read_result(arguments.arm.result, robot);
    return {.model = complete_model(robot, found.model.kept_axes), .errors = std::move(found.estimate.errors)};
  }
  Geometry nominal{.model = complete_model(robot), .errors = {}};
  nominal.errors.setZero(static_cast<Eigen::Index>(nominal.model.parameters.size()));
  return nominal;
}

// Base and targets of the result; without one W is the base frame, with the published targets.
Estimate estimate_at(const JacobianArguments& arguments, Eigen::VectorXd errors) {
  Estimate estimate{
      .errors = std::move(errors), .frames = {.targets = published_targets(arguments.targets)}, .effects = {}};
  if (!arguments.arm.result.empty()) {
    estimate.frames.base() = read_base(arguments.arm.result);
    estimate.frames.targets = read_targets(arguments.arm.result);
  }
  if (!arguments.target_file.empty()) {
    estimate.frames.targets = read_targets(arguments.target_file);
  }
  for (TargetFrame& target : estimate.frames.targets) {
    target.with_orientation = false;  // the published matrices are for points
  }
  return estimate;
}

Unknowns free_at(const JacobianArguments& arguments, const ErrorModel& model, const std::vector<TargetFrame>& targets) {
  std::vector<std::string> names = reduced_model(model, targets).kept;
  if (arguments.model == "complete") {
    for (const ErrorParameter& parameter : model.parameters) {
      names.push_back(parameter.name);
    }
  }
  return {model, targets, names};
}

void take_configurations(const JacobianArguments& arguments, const Robot& robot, IdentificationAt& at) {
  if (arguments.configuration_file.empty()) {
    at.configurations = {"1"};
    at.joint_values = joint_values(robot, arguments.arm.joints);
    return;
  }
  const Measurements read =
      configurations_of(robot, arguments.configuration_file, arguments.arm.joints.joint_convention);
  at.configurations = read.configurations;
  at.joint_values = read.joint_values;
}

ExitStatus run_identification(const JacobianArguments& arguments) {
  std::vector<OutputFile> files = given_outputs({{"--output", arguments.output}});
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.arm.robot);
  const Geometry found = geometry(arguments, robot);
  IdentificationAt at{.model = found.model};
  at.estimate = estimate_at(arguments, found.errors);
  at.free = free_at(arguments, at.model, at.estimate.frames.targets);
  take_configurations(arguments, robot, at);
  const std::string csv = identification_csv(at);
  for (OutputFile& file : files) {
    file.text = csv;
  }
  std::string text = csv;
  if (arguments.arm.json) {
    text = json_text(identification_json(at));
  } else if (!files.empty()) {
    const std::size_t targets = at.estimate.frames.targets.size();
    text = fmt::format("{} configurations, in each the identification Jacobian, {} x {}, and A, {} x {}\n",
                       at.configurations.size(), 3 * targets, at.free.size(), 3 * targets, 6 + 3 * targets);
  }
  write_whole(files, arguments.force, text);
  return done;
}

void require_sound(const JacobianArguments& arguments) {
  const bool joints = !arguments.arm.joints.joints.empty();
  if (!arguments.identification && (!arguments.configuration_file.empty() || !arguments.output.empty())) {
    throw InputError(std::string("jacobian: ") + (arguments.output.empty() ? "--configuration-file" : "--output") +
                     " needs --identification");
  }
  if (joints == !arguments.configuration_file.empty()) {
    throw InputError(std::string("jacobian: --joints is required") +
                     (arguments.identification ? ", or --configuration-file, one of the two" : "") +
                     ", see kdlcal jacobian --help");
  }
}

ExitStatus run(const JacobianArguments& arguments) {
  require_sound(arguments);
  if (arguments.identification) {
    return run_identification(arguments);
  }
  const Robot robot = load(arguments.arm.robot);
  const auto [model, errors] = geometry(arguments, robot);
  const ManipulatorJacobians jacobians =
      manipulator_jacobians(model, errors, joint_values(robot, arguments.arm.joints));
  print(arguments.arm.json ? json(jacobians) : table(robot, jacobians));
  return done;
}

}  // namespace

Subcommand add_jacobian(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("jacobian", "The manipulator Jacobian at joint values, by three routes");
  const auto arguments = std::make_shared<JacobianArguments>();
  add_arm_at_joints(*app, arguments->arm);
  app->get_option("--joints")->required(false);
  app->add_flag("--identification", arguments->identification,
                "The identification Jacobian and the matrix A of the two-step procedure instead (CSV)");
  add_file(*app, "--configuration-file", arguments->configuration_file,
           "With it: at these configurations (CSV like a plan or measurements) instead of --joints");
  add_count(*app, "--targets", arguments->targets, {1, 100}, "With it: published targets on the tool");
  add_file(*app, "--target-file", arguments->target_file,
           "With it: targets in the flange frame {\"targets\": [{\"name\", \"position\"}]} [those of --result]");
  add_word(*app, "--model", arguments->model, {"irreducible", "complete"},
           "With it: parameters, irreducible or complete");
  add_file(*app, "--output", arguments->output, "With it: write the CSV [standard output]");
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_example(*app,
              "kdlcal jacobian --joints 0,10,-20,0,45,0 --degrees\n"
              "  kdlcal jacobian --identification --configuration-file plan.csv --output matrices.csv");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
