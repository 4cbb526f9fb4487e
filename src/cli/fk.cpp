#include <fmt/core.h>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <memory>
#include <numbers>
#include <utility>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/input_error.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/saved_calibration.hpp"

namespace kdl_calibration::cli {
namespace {

struct FkArguments {
  ArmAtJoints arm;
  Circumstances circumstances;
  bool frames = false;
};

struct NamedFrame {
  std::string name;
  KDL::Frame X_BL;
};

// Frames of all links after the base, the tip last.
std::vector<NamedFrame> link_frames(const Robot& robot, const Eigen::VectorXd& q) {
  KDL::ChainFkSolverPos_recursive solver(robot.chain);
  KDL::JntArray joints(static_cast<unsigned>(q.size()));
  joints.data = q;
  std::vector<NamedFrame> frames;
  for (unsigned segment = 0; segment < robot.chain.getNrOfSegments(); ++segment) {
    KDL::Frame frame;
    solver.JntToCart(joints, frame, static_cast<int>(segment) + 1);
    frames.push_back({.name = robot.chain.getSegment(segment).getName(), .X_BL = frame});
  }
  return frames;
}

// The calibrated robot and its effective joint values.
struct ArmKinematics {
  Robot robot;
  Eigen::VectorXd joint_values;
};

ArmKinematics calibrated(const Robot& robot, const FkArguments& arguments, const Eigen::VectorXd& q) {
  const std::string& result = arguments.arm.result;
  const Calibration found = Calibration(std::make_shared<CalibrationParts>(read_result(result, robot)));
  const Calibration there = found.at(arguments.circumstances);
  const CalibrationParts& saved = there.parts();
  const std::string urdf = calibrated_urdf(robot, saved.model, saved.estimate.errors);
  const Eigen::VectorXd moved = effective_joint_values(saved.model, saved.estimate.effects, q);
  ArmKinematics arm{.robot = parse_robot(urdf, {.base = robot.base, .tip = robot.tip}, result),
                    .joint_values = moved.head(q.size())};
  if (moved.size() > 3 * q.size()) {
    arm.robot.chain = stretched_chain(saved.model, arm.robot.chain, moved.tail(q.size()));
  }
  if (moved.size() > q.size()) {
    arm.robot.chain = tilted_chain(arm.robot.chain, moved.segment(q.size(), 2 * q.size()));
  }
  return arm;
}

std::string json(const std::vector<NamedFrame>& frames) {
  Json list = Json::array();
  for (const NamedFrame& frame : frames) {
    Json entry = {{"name", frame.name}};
    entry.update(frame_json(to_eigen(frame.X_BL)));
    list.push_back(entry);
  }
  return json_text({{"frames", list}});
}

std::string table(const Robot& robot, const std::vector<NamedFrame>& frames) {
  std::size_t name_column = robot.base.size() + 5;
  for (const NamedFrame& frame : frames) {
    name_column = std::max(name_column, frame.name.size() + 2);
  }
  std::string text = padded("in " + robot.base, name_column) +
                     "       x[mm]       y[mm]       z[mm]   roll[deg]  pitch[deg]    yaw[deg]\n";
  for (const NamedFrame& frame : frames) {
    double roll = 0.0;
    double pitch = 0.0;
    double yaw = 0.0;
    frame.X_BL.M.GetRPY(roll, pitch, yaw);
    text += padded(frame.name, name_column);
    for (const double metres : {frame.X_BL.p.x(), frame.X_BL.p.y(), frame.X_BL.p.z()}) {
      text += fmt::format("{:>12}", fixed(metres * 1e3, 4));
    }
    for (const double angle : {roll, pitch, yaw}) {
      text += fmt::format("{:>12}", fixed(angle * 180.0 / std::numbers::pi, 5));
    }
    text += "\n";
  }
  return text;
}

ExitStatus run(const FkArguments& arguments) {
  const auto& [robot_arguments, joints, result, as_json] = arguments.arm;
  Robot robot = load(robot_arguments);
  Eigen::VectorXd q = joint_values(robot, joints);
  if (result.empty() && states_any(arguments.circumstances)) {
    throw InputError("--temperature and --payload are of a calibrated arm, expected --result beside them");
  }
  if (!result.empty()) {
    ArmKinematics arm = calibrated(robot, arguments, q);
    robot = std::move(arm.robot);
    q = std::move(arm.joint_values);
  }
  std::vector<NamedFrame> frames = link_frames(robot, q);
  if (!as_json && !arguments.frames) {
    frames.erase(frames.begin(), frames.end() - 1);
  }
  print(as_json ? json(frames) : table(robot, frames));
  return done;
}

}  // namespace

Subcommand add_fk(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("fk", "Forward kinematics at joint values, nominal or calibrated");
  const auto arguments = std::make_shared<FkArguments>();
  add_arm_at_joints(*app, arguments->arm);
  app->add_flag("--frames", arguments->frames, "Show the frame of every link, not the tip's alone (JSON always does)");
  add_circumstances(*app, arguments->circumstances);
  add_example(*app, "kdlcal fk --joints 0,10,-20,0,45,0 --degrees --frames");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
