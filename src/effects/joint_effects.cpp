#include "effects/joint_effects.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory_resource>

#include "effects/effect_functions.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/drive_signals.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Ref;
using Eigen::VectorXd;

const char* to_string(EffectGroup group) {
  constexpr std::array kNames = {"gravity", "transverse", "gain",      "backlash", "harmonics", "ripple", "tables",
                                 "torque",  "coupling",   "expansion", "drift",    "payload",   "own"};
  static_assert(kNames.size() == kEffectGroups + 1, "the last one has no group that can be asked for");
  return kNames[static_cast<std::size_t>(group)];
}

const char* to_string(EffectAxis axis) {
  constexpr std::array<const char*, 4> kNames = {"own", "x", "y", "along"};
  return kNames[static_cast<std::size_t>(axis)];
}

std::optional<EffectGroup> effect_group(const std::string& name) {
  for (std::size_t i = 0; i < kEffectGroups; ++i) {
    if (name == to_string(static_cast<EffectGroup>(i))) {
      return static_cast<EffectGroup>(i);
    }
  }
  return std::nullopt;
}

std::vector<std::string> effect_group_names() {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < kEffectGroups; ++i) {
    names.emplace_back(to_string(static_cast<EffectGroup>(i)));
  }
  return names;
}

std::optional<Circumstance> needed_circumstance(EffectGroup group) {
  switch (group) {
    case EffectGroup::expansion:
    case EffectGroup::drift:
      return Circumstance::temperature;
    case EffectGroup::payload:
      return Circumstance::payload;
    default:
      return std::nullopt;
  }
}

bool depend_on(const std::vector<EffectTerm>& effects, Circumstance circumstance) {
  return std::any_of(effects.begin(), effects.end(),
                     [&](const EffectTerm& term) { return needed_circumstance(term.group()) == circumstance; });
}

bool states_any(const Circumstances& circumstances) {
  return !std::isnan(circumstances.temperature) || !std::isnan(circumstances.payload) ||
         !circumstances.link_temperatures.empty();
}

double temperature_before(const MovingJoint& joint, const Circumstances& circumstances) {
  if (!circumstances.link_temperatures.empty()) {
    for (const std::string& link : joint.links) {
      const auto own = circumstances.link_temperatures.find(link);
      if (own != circumstances.link_temperatures.end()) {
        return own->second;
      }
    }
  }
  return circumstances.temperature;
}

bool depends_on_temperature(const EffectTerm& term) {
  return needed_circumstance(term.group()) == Circumstance::temperature;
}

EffectGroup EffectTerm::group() const {
  using enum EffectGroup;
  constexpr std::array kGroups = {gravity, gravity, gain,     backlash, backlash, harmonics,
                                  tables,  torque,  coupling, drift,    payload,  own};
  static_assert(kGroups.size() == std::variant_size_v<EffectFunction>, "a group for each kind, in the same order");
  if (const auto* const swing = std::get_if<Sinusoid>(&function)) {
    return swing->is_ripple ? ripple : harmonics;
  }
  if (axis == EffectAxis::along && !std::holds_alternative<OwnFunction>(function)) {
    return expansion;
  }
  const EffectGroup of_kind = kGroups[function.index()];
  return of_kind == gravity && axis != EffectAxis::own ? transverse : of_kind;
}

std::string size_name(const EffectTerm& term) {
  const std::string group = to_string(term.group());
  if (const auto* const own = std::get_if<OwnFunction>(&term.function)) {
    return group + "." + own->effect;
  }
  return term.group() == EffectGroup::tables ? group + "." + std::to_string(term.index + 1) : group;
}

std::map<EffectMotionKey, std::vector<Index>> terms_by_motion(const ErrorModel& model) {
  std::map<EffectMotionKey, std::vector<Index>> result;
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const EffectTerm& term = model.effects[e];
    result[{.group = term.group(), .joint = term.index, .axis = term.axis}].push_back(static_cast<Index>(e));
  }
  return result;
}

Index motion_size(const ErrorModel& model) {
  const auto any = [&](const auto& is_such) {
    return std::any_of(model.effects.begin(), model.effects.end(),
                       [&](const EffectTerm& term) { return is_such(term.axis); });
  };
  const Index entries = any([](EffectAxis axis) { return axis == EffectAxis::along; }) ? 4
                        : any([](EffectAxis axis) { return axis != EffectAxis::own; }) ? 3
                                                                                       : 1;
  return static_cast<Index>(model.joints.size()) * entries;
}

Index motion_entry(const ErrorModel& model, const EffectTerm& term) {
  if (term.axis == EffectAxis::own) {
    return term.index;
  }
  if (term.axis == EffectAxis::along) {
    return 3 * static_cast<Index>(model.joints.size()) + term.index;
  }
  return static_cast<Index>(model.joints.size()) + Index{2} * term.index + (term.axis == EffectAxis::across_y ? 1 : 0);
}

namespace {

// Standardised value of the term; 0 if it depends on an unknown signal.
double scaled(const EffectTerm& term, double raw) { return std::isnan(raw) ? 0.0 : (raw - term.mean) / term.scale; }

// Calls work(e, standardised values) for each term of a function of the caller's own. Each function is called once.
template <typename Work>
void for_each_own_term(const ErrorModel& model, const MatrixXd& joint_values, const Work& work) {
  std::map<std::string, MatrixXd> columns;  // by the effect
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const EffectTerm& term = model.effects[e];
    if (const auto* const own = std::get_if<OwnFunction>(&term.function)) {
      auto known = columns.find(own->effect);
      if (known == columns.end()) {
        known = columns.emplace(own->effect, own_columns(own->effect, own->columns, joint_values)).first;
      }
      work(e, VectorXd((own_values(*own, known->second).array() - term.mean) / term.scale));
    }
  }
}

}  // namespace

bool needs_torques(const ErrorModel& model) {
  return std::any_of(model.effects.begin(), model.effects.end(),
                     [](const EffectTerm& term) { return std::holds_alternative<MeasuredTorque>(term.function); });
}

bool misses_approach(const EffectTerm& term, const DriveSignals& signals, Index column) {
  return std::holds_alternative<ApproachSide>(term.function) &&
         (signals.approach.size() == 0 || std::isnan(signals.approach(term.index, column)));
}

MatrixXd effect_basis(const ErrorModel& model, const MatrixXd& joint_values, const DriveSignals& signals) {
  if (const std::string fault = fault_of(signals, joint_values); !fault.empty()) {
    throw InputError(fault);
  }
  MatrixXd basis(static_cast<Index>(model.effects.size()), joint_values.cols());
  if (model.effects.empty()) {
    return basis;
  }
  for (Index c = 0; c < joint_values.cols(); ++c) {
    const JointFrames frames = joint_frames(model, joint_values.col(c));
    const Stop stop{joint_values.col(c), frames, signals, c};
    for (std::size_t e = 0; e < model.effects.size(); ++e) {
      const EffectTerm& term = model.effects[e];
      if (!std::holds_alternative<OwnFunction>(term.function)) {
        basis(static_cast<Index>(e), c) = scaled(term, raw_value(model, term, stop));
      }
    }
  }
  for_each_own_term(model, joint_values,
                    [&](std::size_t e, const VectorXd& values) { basis.row(static_cast<Index>(e)) = values; });
  return basis;
}

void effect_motion(const ErrorModel& model, const VectorXd& values, const Ref<const VectorXd>& q,
                   Ref<VectorXd> motion) {
  alignas(Eigen::Isometry3d) std::array<std::byte, (kFewJoints + 1) * (sizeof(Eigen::Isometry3d) + sizeof(Matrix3d))>
      bytes;
  std::pmr::monotonic_buffer_resource memory(bytes.data(), bytes.size());
  const JointFrames frames = joint_frames(model, q, &memory);
  const DriveSignals unknown;
  const Stop stop{q, frames, unknown};
  motion.setZero();
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const EffectTerm& term = model.effects[e];
    if (!std::holds_alternative<OwnFunction>(term.function)) {
      motion[motion_entry(model, term)] += values[static_cast<Index>(e)] * scaled(term, raw_value(model, term, stop));
    }
  }
}

MatrixXd own_motions(const ErrorModel& model, const VectorXd& values, const MatrixXd& joint_values) {
  MatrixXd motions = MatrixXd::Zero(motion_size(model), joint_values.cols());
  for_each_own_term(model, joint_values, [&](std::size_t e, const VectorXd& basis) {
    motions.row(motion_entry(model, model.effects[e])) += values[static_cast<Index>(e)] * basis;
  });
  return motions;
}

bool has_own_functions(const ErrorModel& model) {
  return std::any_of(model.effects.begin(), model.effects.end(),
                     [](const EffectTerm& term) { return std::holds_alternative<OwnFunction>(term.function); });
}

MatrixXd effective_joint_values(const ErrorModel& model, const VectorXd& values, const MatrixXd& joint_values,
                                const DriveSignals& signals) {
  if (values.size() == 0 || values.isZero(0.0)) {
    return joint_values;
  }
  return effective_joint_values(model, values, joint_values, effect_basis(model, joint_values, signals));
}

MatrixXd effective_joint_values(const ErrorModel& model, const VectorXd& values, const MatrixXd& joint_values,
                                const MatrixXd& basis) {
  if (values.size() == 0 || values.isZero(0.0)) {
    return joint_values;
  }
  MatrixXd result = MatrixXd::Zero(motion_size(model), joint_values.cols());
  result.topRows(joint_values.rows()) = joint_values;
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const auto row = static_cast<Index>(e);
    result.row(motion_entry(model, model.effects[e])) += values[row] * basis.row(row);
  }
  return result;
}

KDL::Chain stretched_chain(const ErrorModel& model, const KDL::Chain& chain, const VectorXd& stretches) {
  KDL::Chain result;
  std::size_t next = 0;  // moving joint
  bool at_start = true;  // of the link before it, which may have several segments
  for (const KDL::Segment& segment : chain.segments) {
    KDL::Frame origin = segment.getFrameToTip();
    if (at_start && next < model.joints.size()) {
      const KDL::Vector link = model.joints[next].origin.p;
      const double length = link.Norm();
      const double share = length > 0.0 ? stretches[static_cast<Index>(next)] / length : 0.0;
      origin = KDL::Frame(link * share) * origin;
    }
    const KDL::Joint& joint = segment.getJoint();
    at_start = joint.getType() != KDL::Joint::Fixed;
    next += at_start ? 1 : 0;
    const KDL::Joint moved =
        at_start ? KDL::Joint(joint.getName(), origin.p, joint.JointAxis(), joint.getType()) : joint;
    result.addSegment(KDL::Segment(segment.getName(), moved, origin, segment.getInertia()));
  }
  return result;
}

KDL::Chain tilted_chain(const KDL::Chain& chain, const VectorXd& tilts) {
  const auto moves = [](const KDL::Segment& segment) { return segment.getJoint().getType() != KDL::Joint::Fixed; };
  KDL::Chain result;
  Index next = 0;
  for (const KDL::Segment& segment : chain.segments) {
    const KDL::Joint& joint = segment.getJoint();
    if (!moves(segment)) {
      result.addSegment(segment);
      continue;
    }
    const KDL::Frame origin = segment.getFrameToTip();
    const KDL::Vector axis = origin.M.Inverse(joint.JointAxis());
    const Matrix3d turn = z_onto(to_eigen(axis));
    Eigen::Isometry3d tilt = Eigen::Isometry3d::Identity();
    tilt.linear() = turn * Eigen::AngleAxisd(tilts[next], Eigen::Vector3d::UnitX()) *
                    Eigen::AngleAxisd(tilts[next + 1], Eigen::Vector3d::UnitY()) * turn.transpose();
    next += 2;
    const KDL::Frame tilted = origin * to_kdl(tilt);
    const KDL::Joint moved(joint.getName(), tilted.p, tilted.M * axis, joint.getType());
    result.addSegment(KDL::Segment(segment.getName(), moved, tilted, segment.getInertia()));
  }
  return result;
}

}  // namespace kdl_calibration
