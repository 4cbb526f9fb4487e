#include "kdl_calibration/error_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>
#include <numbers>
#include <utility>

#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/mimic.hpp"
#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

constexpr std::array<char, 3> kAxisOrder = {'z', 'x', 'y'};  // the order of the publication

// The links' masses, each in the frame behind the moving joint that carries it.
std::vector<PointMass> link_masses(const Robot& robot) {
  std::vector<PointMass> masses;
  int frame = -1;
  KDL::Frame pose = KDL::Frame::Identity();  // of the segment's link behind the last moving joint
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

// ---- reduction -----------------------------------------------------------------------------------------------------

// Stacks the Jacobian columns of base, targets and geometric parameters for one configuration, in the frame B.
class CandidateJacobian {
public:
  CandidateJacobian(const ErrorModel& model, const std::vector<TargetFrame>& targets, const ReductionOptions& options)
      : model_(model),
        targets_(targets),
        options_(options),
        chain_(parameter_chain(model)),
        forward_(chain_.chain),
        jacobian_(chain_.chain) {
    names_ = base_parameter_names();
    for (const TargetFrame& target : targets) {
      const auto target_names = target_parameter_names(target);
      names_.insert(names_.end(), target_names.begin(), target_names.end());
    }
    first_geometric_ = names_.size();
    for (const ErrorParameter& parameter : model.parameters) {
      names_.push_back(parameter.name);
    }
  }

  const std::vector<std::string>& names() const { return names_; }
  std::size_t first_geometric() const { return first_geometric_; }

  Eigen::MatrixXd stacked() {
    Eigen::Index rows_each = 0;
    for (const TargetFrame& target : targets_) {
      rows_each += target.with_orientation ? 6 : 3;
    }
    Eigen::MatrixXd stack =
        Eigen::MatrixXd::Zero(rows_each * options_.configurations, static_cast<Eigen::Index>(names_.size()));
    Random random(options_.seed);
    KDL::JntArray q(chain_.chain.getNrOfJoints());
    Eigen::VectorXd values(static_cast<Eigen::Index>(model_.joints.size()));
    for (int c = 0; c < options_.configurations; ++c) {
      for (std::size_t i = 0; i < model_.joints.size(); ++i) {
        const double range = model_.joints[i].type == JointType::prismatic ? 1.0 : std::numbers::pi;
        values[static_cast<Eigen::Index>(i)] = random.uniform(-range, range);
      }
      follow(model_.joints, values);
      for (std::size_t i = 0; i < model_.joints.size(); ++i) {
        q(chain_.joint_index[i]) = values[static_cast<Eigen::Index>(i)];
      }
      fill(q, stack.middleRows(rows_each * c, rows_each));
    }
    return stack;
  }

private:
  void fill(const KDL::JntArray& q, Eigen::Ref<Eigen::MatrixXd> rows) {
    KDL::Frame flange;
    forward_.JntToCart(q, flange);
    KDL::Jacobian flange_jacobian(chain_.chain.getNrOfJoints());
    jacobian_.JntToJac(q, flange_jacobian);
    Eigen::Index row = 0;
    Eigen::Index target_column = 6;
    for (const TargetFrame& target : targets_) {
      const Eigen::Index height = target.with_orientation ? 6 : 3;
      const KDL::Frame X_FT = to_kdl(target.X_FT);
      const KDL::Vector lever = flange.M * X_FT.p;
      auto block = rows.middleRows(row, height);
      const KDL::Rotation orientation = flange.M * X_FT.M;
      for (int axis = 0; axis < 3; ++axis) {
        KDL::Vector e = KDL::Vector::Zero();
        e[axis] = 1.0;
        write(block, axis, KDL::Twist(e, KDL::Vector::Zero()));
        write(block, 3 + axis, KDL::Twist(e * (flange.p + lever), e));
        write(block, target_column + axis, KDL::Twist(flange.M * e, KDL::Vector::Zero()));
        if (target.with_orientation) {
          write(block, target_column + 3 + axis, KDL::Twist(KDL::Vector::Zero(), orientation * e));
        }
      }
      target_column += height;
      for (std::size_t p = 0; p < model_.parameters.size(); ++p) {
        const KDL::Twist column = flange_jacobian.getColumn(chain_.parameter_index[p]);
        write(block, static_cast<Eigen::Index>(first_geometric_ + p), column.RefPoint(lever));
      }
      row += height;
    }
  }

  static void write(Eigen::Ref<Eigen::MatrixXd> block, Eigen::Index column, const KDL::Twist& twist) {
    block.col(column).head<3>() = to_eigen(twist.vel);
    if (block.rows() == 6) {
      block.col(column).tail<3>() = to_eigen(twist.rot);
    }
  }

  const ErrorModel& model_;
  const std::vector<TargetFrame>& targets_;
  const ReductionOptions& options_;
  ParameterChain chain_;
  KDL::ChainFkSolverPos_recursive forward_;
  KDL::ChainJntToJacSolver jacobian_;
  std::vector<std::string> names_;
  std::size_t first_geometric_ = 0;
};

bool without_effect(const Eigen::MatrixXd& columns, Eigen::Index column) {
  return columns.col(column).cwiseAbs().maxCoeff() < 1e-12;  // [m] or [rad] per unit: rounding
}

using Combination = std::map<std::string, double>;

// Coefficients of `column` over the columns in `among`; empty where they do not span it.
Combination combination(const Eigen::MatrixXd& columns, Eigen::Index column, const std::vector<Eigen::Index>& among,
                        const std::vector<std::string>& names) {
  Combination result;
  if (among.empty()) {
    return result;
  }
  const Eigen::MatrixXd basis = columns(Eigen::all, among);
  const Eigen::VectorXd coefficients = basis.colPivHouseholderQr().solve(columns.col(column));
  const double norm = columns.col(column).norm();
  if ((basis * coefficients - columns.col(column)).norm() > 1e-7 * norm) {
    return result;
  }
  for (std::size_t i = 0; i < among.size(); ++i) {
    const double contribution = coefficients[static_cast<Eigen::Index>(i)];
    if (std::abs(contribution) * basis.col(static_cast<Eigen::Index>(i)).norm() > 1e-7 * norm) {
      const double rounded = std::round(contribution * 1e9) * 1e-9;
      result[names[static_cast<std::size_t>(among[i])]] =
          std::abs(rounded - std::round(rounded)) < 1e-8 ? std::round(rounded) : contribution;
    }
  }
  return result;
}

}  // namespace

// Modified Gram-Schmidt with one repetition, which keeps the basis orthogonal to rounding.
std::vector<bool> columns_that_raise_the_rank(const Eigen::MatrixXd& columns, const std::vector<bool>& candidate,
                                              double tolerance) {
  std::vector<bool> raises(static_cast<std::size_t>(columns.cols()), false);
  Eigen::MatrixXd basis(columns.rows(), columns.cols());
  Eigen::Index rank = 0;
  for (Eigen::Index c = 0; c < columns.cols(); ++c) {
    if (!candidate[static_cast<std::size_t>(c)]) {
      continue;
    }
    Eigen::VectorXd rest = columns.col(c);
    const double norm = rest.norm();
    for (int pass = 0; pass < 2; ++pass) {
      rest -= basis.leftCols(rank) * (basis.leftCols(rank).transpose() * rest);
    }
    if (rest.norm() > tolerance * norm && !without_effect(columns, c)) {
      basis.col(rank++) = rest.normalized();
      raises[static_cast<std::size_t>(c)] = true;
    }
  }
  return raises;
}

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
  }
  return "unknown";
}

bool is_length(const ErrorModel& model, const ErrorParameter& parameter) {
  return parameter.kind == ParameterKind::translation ||
         (parameter.kind == ParameterKind::joint_offset &&
          model.joints[static_cast<std::size_t>(parameter.frame)].type == JointType::prismatic);
}

KDL::Vector parameter_axis(const ErrorModel& model, const ErrorParameter& parameter) {
  return parameter.kind == ParameterKind::joint_offset ? model.joints[static_cast<std::size_t>(parameter.frame)].axis
                                                       : unit(parameter.axis);
}

std::size_t parameter_index(const ErrorModel& model, const std::string& name) {
  const auto found = std::find_if(model.parameters.begin(), model.parameters.end(),
                                  [&](const ErrorParameter& parameter) { return parameter.name == name; });
  if (found == model.parameters.end()) {
    throw InputError("no error parameter is named '" + name + "'");
  }
  return static_cast<std::size_t>(found - model.parameters.begin());
}

KDL::Frame frame_correction(const ErrorModel& model, const Eigen::VectorXd& errors, int frame) {
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

Reduction reduced_model(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                        const ReductionOptions& options) {
  CandidateJacobian candidates(model, targets, options);
  const Eigen::MatrixXd columns = candidates.stacked();
  const std::vector<std::string>& names = candidates.names();
  std::vector<bool> candidate(names.size());
  for (std::size_t c = 0; c < names.size(); ++c) {
    candidate[c] = std::find(options.fixed.begin(), options.fixed.end(), names[c]) == options.fixed.end();
  }
  const std::vector<bool> raises = columns_that_raise_the_rank(columns, candidate, options.tolerance);

  Reduction reduction;
  reduction.candidates = static_cast<int>(std::count(candidate.begin(), candidate.end(), true));
  std::vector<Eigen::Index> kept;
  std::vector<Eigen::Index> frames;  // the kept ones of base and targets
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (raises[c]) {
      kept.push_back(static_cast<Eigen::Index>(c));
      reduction.kept.push_back(names[c]);
      if (c < candidates.first_geometric()) {
        frames.push_back(static_cast<Eigen::Index>(c));
      }
    }
  }
  reduction.rank = static_cast<int>(kept.size());

  std::vector<Eigen::Index> gauge;
  for (std::size_t c = 0; c < names.size(); ++c) {
    if (raises[c] || !candidate[c]) {
      continue;
    }
    const auto column = static_cast<Eigen::Index>(c);
    const bool joint_offset = c >= candidates.first_geometric() &&
                              model.parameters[c - candidates.first_geometric()].kind == ParameterKind::joint_offset;
    const Combination tied = combination(columns, column, frames, names);
    if (joint_offset && (without_effect(columns, column) || !tied.empty())) {
      GaugeParameter parameter{.name = names[c], .tied_to = {}};
      for (const auto& entry : tied) {
        parameter.tied_to.push_back(entry.first);
      }
      reduction.gauge.push_back(std::move(parameter));
      gauge.push_back(column);
      continue;
    }
    // A single gauge parameter says it in one word where base or targets would need many.
    Combination replacement;
    for (const Eigen::Index g : gauge) {
      replacement = combination(columns, column, {g}, names);
      if (!replacement.empty()) {
        break;
      }
    }
    if (replacement.empty()) {
      replacement = combination(columns, column, kept, names);
    }
    reduction.dropped.push_back({.name = names[c], .replaced_by = std::move(replacement)});
  }
  return reduction;
}

std::vector<TargetFrame> generic_targets(int count, std::uint64_t seed) {
  std::vector<TargetFrame> targets;
  Random random(seed);
  for (int k = 0; k < count; ++k) {
    TargetFrame target{.name = k < 26 ? std::string(1, static_cast<char>('A' + k)) : "T" + std::to_string(k + 1)};
    for (int axis = 0; axis < 3; ++axis) {
      target.X_FT.translation()[axis] = random.uniform(-0.2, 0.2);
    }
    targets.push_back(std::move(target));
  }
  return targets;
}

}  // namespace kdl_calibration
