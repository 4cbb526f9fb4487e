#include "model/error_chains.hpp"

#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

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

bool is_zero(const KDL::Vector& v) { return v.x() == 0.0 && v.y() == 0.0 && v.z() == 0.0; }

}  // namespace

KDL::Vector pivot_of(const ErrorModel& model, int frame) {
  return model.pivots.empty() ? KDL::Vector::Zero() : model.pivots[static_cast<std::size_t>(frame)];
}

KDL::Frame frame_correction(const ErrorModel& model, const Eigen::VectorXd& errors, int frame) {
  const KDL::Frame pivot(pivot_of(model, frame));
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
  return is_zero(pivot.p) ? result : pivot * result * pivot.Inverse();
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
    const KDL::Vector pivot = pivot_of(model, frame);
    if (!is_zero(pivot)) {
      factors.back().frame = factors.back().frame * KDL::Frame(pivot);
    }
    add_parameter_factors(model, frame, false, factors);
    if (!is_zero(pivot)) {
      factors.push_back(
          {.source = ChainFactor::Source::fixed, .name = model.joints[i].name + ".pivot", .frame = KDL::Frame(-pivot)});
    }
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

}  // namespace kdl_calibration
