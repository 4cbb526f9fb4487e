#include "kdl_calibration/error_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>

#include "base/preconditions.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

constexpr std::array<char, 3> kAxisOrder = {'z', 'x', 'y'};  // the order of the publication

// The links' masses, each in the frame after the moving joint that carries it.
std::vector<PointMass> link_masses(const Robot& robot) {
  std::vector<PointMass> masses;
  int frame = -1;
  KDL::Frame pose = KDL::Frame::Identity();  // of the segment's link, in the frame after the last moving joint
  for (const KDL::Segment& segment : robot.chain.segments) {
    if (segment.getJoint().getType() == KDL::Joint::Fixed) {
      pose = pose * segment.getFrameToTip();
    } else {
      ++frame;
      pose = KDL::Frame::Identity();
    }
    if (frame >= 0 && segment.getInertia().getMass() > 0.0) {
      masses.push_back(
          {.frame = frame, .mass = segment.getInertia().getMass(), .centre = pose * segment.getInertia().getCOG()});
    }
  }
  return masses;
}

KDL::Vector unit(char axis) { return {axis == 'x' ? 1.0 : 0.0, axis == 'y' ? 1.0 : 0.0, axis == 'z' ? 1.0 : 0.0}; }

// The letter of a coordinate axis that `direction` is parallel to, or 'q'.
char parallel_letter(const KDL::Vector& direction) {
  for (const char letter : kAxisOrder) {
    if ((unit(letter) * direction).Norm() < 1e-9) {
      return letter;
    }
  }
  return 'q';
}

std::string carrying_joint(const Robot& robot, std::size_t frame) {
  return frame < robot.joints.size() ? robot.joints[frame].name : robot.tip_joint;
}

void add_link_parameters(const Robot& robot, std::size_t link, std::vector<ErrorParameter>& parameters) {
  const KDL::Frame& origin = link < robot.joints.size() ? robot.joints[link].origin : robot.tip_origin;
  const char own_axis = link == 0 ? 'q' : parallel_letter(origin.M.Inverse(robot.joints[link - 1].axis));
  const KDL::Vector offset = origin.M.Inverse(origin.p);
  for (const ParameterKind kind : {ParameterKind::translation, ParameterKind::rotation}) {
    for (const char axis : kAxisOrder) {
      if (axis == own_axis) {
        continue;
      }
      const bool translation = kind == ParameterKind::translation;
      parameters.push_back({.name = std::string(translation ? "T" : "R") + axis + std::to_string(link),
                            .joint = carrying_joint(robot, link),
                            .kind = kind,
                            .axis = axis,
                            .frame = static_cast<int>(link),
                            .nominal = translation ? KDL::dot(offset, unit(axis)) : 0.0});
    }
  }
}

KDL::Joint joint_motion(const MovingJoint& joint, const std::string& name) {
  const auto type = joint.type == JointType::prismatic ? KDL::Joint::TransAxis : KDL::Joint::RotAxis;
  return {name, KDL::Vector::Zero(), joint.axis, type};
}

KDL::Joint parameter_motion(const ErrorModel& model, const ErrorParameter& parameter) {
  const auto type = is_length(model, parameter) ? KDL::Joint::TransAxis : KDL::Joint::RotAxis;
  return {parameter.name, KDL::Vector::Zero(), parameter_axis(model, parameter), type};
}

void add_parameter_factors(const ErrorModel& model, int frame, bool offsets, std::vector<ChainFactor>& factors) {
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const ErrorParameter& parameter = model.parameters[p];
    if (parameter.frame == frame && (parameter.kind == ParameterKind::joint_offset) == offsets) {
      factors.push_back({.source = ChainFactor::Source::parameter,
                         .index = p,
                         .name = parameter.name,
                         .frame = KDL::Frame::Identity(),
                         .motion = parameter_motion(model, parameter)});
    }
  }
}

}  // namespace

Eigen::Vector3d to_eigen(const KDL::Vector& v) { return {v.x(), v.y(), v.z()}; }

Eigen::Isometry3d to_eigen(const KDL::Frame& X_AB) {
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      result.linear()(row, column) = X_AB.M(row, column);
    }
  }
  result.translation() = to_eigen(X_AB.p);
  return result;
}

KDL::Frame to_kdl(const Eigen::Isometry3d& X_AB) {
  const auto& R = X_AB.linear();
  const auto& p = X_AB.translation();
  return {KDL::Rotation(R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)),
          KDL::Vector(p.x(), p.y(), p.z())};
}

ErrorModel complete_model(const Robot& robot) {
  ErrorModel model{
      .joints = robot.joints, .tip_origin = robot.tip_origin, .tip_joint = robot.tip_joint, .parameters = {}};
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    model.parameters.push_back({.name = "dq" + std::to_string(i + 1),
                                .joint = robot.joints[i].name,
                                .kind = ParameterKind::joint_offset,
                                .axis = parallel_letter(robot.joints[i].axis),
                                .frame = static_cast<int>(i)});
  }
  for (std::size_t link = 0; link <= robot.joints.size(); ++link) {
    add_link_parameters(robot, link, model.parameters);
  }
  model.link_masses = link_masses(robot);
  return model;
}

const char* to_string(ParameterKind kind) {
  switch (kind) {
    case ParameterKind::joint_offset:
      return "joint_offset";
    case ParameterKind::translation:
      return "translation";
    case ParameterKind::rotation:
      return "rotation";
    case ParameterKind::effect:
      return "effect";
  }
  return "unknown";
}

bool is_length(const ErrorModel& model, const ErrorParameter& parameter) {
  return parameter.kind == ParameterKind::translation ||
         (parameter.kind == ParameterKind::joint_offset &&
          model.joints[static_cast<std::size_t>(parameter.frame)].type == JointType::prismatic);
}

bool is_length(const ErrorModel& model, const EffectTerm& term) {
  return term.axis == EffectAxis::own &&
         model.joints[static_cast<std::size_t>(term.index)].type == JointType::prismatic;
}

double usual_error(const ErrorModel& model, const ErrorParameter& parameter) {
  return is_length(model, parameter) ? 0.003 : 0.005;
}

KDL::Vector parameter_axis(const ErrorModel& model, const ErrorParameter& parameter) {
  return parameter.kind == ParameterKind::joint_offset ? model.joints[static_cast<std::size_t>(parameter.frame)].axis
                                                       : unit(parameter.axis);
}

std::size_t parameter_index(const ErrorModel& model, const std::string& name) {
  const auto found = std::find_if(model.parameters.begin(), model.parameters.end(),
                                  [&](const ErrorParameter& parameter) { return parameter.name == name; });
  if (found == model.parameters.end()) {
    throw InputError("no error parameter is named '" + name + "', expected one of the model's");
  }
  return static_cast<std::size_t>(found - model.parameters.begin());
}

KDL::Frame frame_correction(const ErrorModel& model, const Eigen::VectorXd& errors, int frame) {
  require_count("errors", errors.size(), model.parameters.size());
  require_index("the frame", frame, model.joints.size() + 1);
  KDL::Frame result = KDL::Frame::Identity();
  for (const bool offsets : {false, true}) {
    for (std::size_t p = 0; p < model.parameters.size(); ++p) {
      const ErrorParameter& parameter = model.parameters[p];
      const double value = errors[static_cast<Eigen::Index>(p)];
      if (parameter.frame == frame && (parameter.kind == ParameterKind::joint_offset) == offsets && value != 0.0) {
        result = result * parameter_motion(model, parameter).pose(value);
      }
    }
  }
  return result;
}

std::vector<ChainFactor> chain_factors(const ErrorModel& model) {
  std::vector<ChainFactor> factors;
  const auto joints = static_cast<int>(model.joints.size());
  for (int frame = 0; frame <= joints; ++frame) {
    const bool tip = frame == joints;
    const auto i = static_cast<std::size_t>(frame);
    factors.push_back({.source = ChainFactor::Source::fixed,
                       .index = 0,
                       .name = tip ? "tip" : model.joints[i].name + ".origin",
                       .frame = tip ? model.tip_origin : model.joints[i].origin});
    add_parameter_factors(model, frame, false, factors);
    if (!tip) {
      factors.push_back({.source = ChainFactor::Source::joint,
                         .index = i,
                         .name = model.joints[i].name,
                         .frame = KDL::Frame::Identity(),
                         .motion = joint_motion(model.joints[i], model.joints[i].name)});
      add_parameter_factors(model, frame, true, factors);
    }
  }
  return factors;
}

KDL::Chain error_chain(const ErrorModel& model, const Eigen::VectorXd& errors) {
  require_count("errors", errors.size(), model.parameters.size());
  KDL::Chain chain;
  for (const ChainFactor& factor : chain_factors(model)) {
    switch (factor.source) {
      case ChainFactor::Source::fixed:
        chain.addSegment(KDL::Segment(factor.name, KDL::Joint(KDL::Joint::Fixed), factor.frame));
        break;
      case ChainFactor::Source::joint:
        chain.addSegment(KDL::Segment(factor.name, factor.motion));
        break;
      case ChainFactor::Source::parameter:
        chain.addSegment(KDL::Segment(factor.name, KDL::Joint(KDL::Joint::Fixed),
                                      factor.motion.pose(errors[static_cast<Eigen::Index>(factor.index)])));
        break;
    }
  }
  return chain;
}

KDL::Chain folded_chain(const ErrorModel& model, const Eigen::VectorXd& errors) {
  KDL::Chain chain;
  for (std::size_t i = 0; i < model.joints.size(); ++i) {
    const MovingJoint& joint = model.joints[i];
    const KDL::Frame origin = joint.origin * frame_correction(model, errors, static_cast<int>(i));
    const auto type = joint.type == JointType::prismatic ? KDL::Joint::TransAxis : KDL::Joint::RotAxis;
    chain.addSegment(KDL::Segment(joint.name, KDL::Joint(joint.name, origin.p, origin.M * joint.axis, type), origin));
  }
  const KDL::Frame tip = model.tip_origin * frame_correction(model, errors, static_cast<int>(model.joints.size()));
  chain.addSegment(KDL::Segment("tip", KDL::Joint(KDL::Joint::Fixed), tip));
  return chain;
}

ParameterChain parameter_chain(const ErrorModel& model) {
  ParameterChain result;
  result.joint_index.resize(model.joints.size());
  result.parameter_index.resize(model.parameters.size());
  for (const ChainFactor& factor : chain_factors(model)) {
    if (factor.source == ChainFactor::Source::fixed) {
      result.chain.addSegment(KDL::Segment(factor.name, KDL::Joint(KDL::Joint::Fixed), factor.frame));
      continue;
    }
    auto& indices = factor.source == ChainFactor::Source::joint ? result.joint_index : result.parameter_index;
    indices[factor.index] = result.chain.getNrOfJoints();
    result.chain.addSegment(KDL::Segment(factor.name, factor.motion));
  }
  return result;
}

const TargetFrame* find_target(const std::vector<TargetFrame>& targets, const std::string& name) {
  const auto found =
      std::find_if(targets.begin(), targets.end(), [&](const TargetFrame& target) { return target.name == name; });
  return found == targets.end() ? nullptr : &*found;
}

const std::vector<std::string>& base_parameter_names() {
  static const std::vector<std::string> names = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"};
  return names;
}

std::vector<std::string> target_parameter_names(const TargetFrame& target) {
  std::vector<std::string> names = {target.name + ".x", target.name + ".y", target.name + ".z"};
  if (target.with_orientation) {
    names.insert(names.end(), {target.name + ".Rx", target.name + ".Ry", target.name + ".Rz"});
  }
  return names;
}

}  // namespace kdl_calibration
