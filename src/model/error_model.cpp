#include "kdl_calibration/error_model.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>

#include "base/preconditions.hpp"
#include "model/error_chains.hpp"
#include "model/kept_axes.hpp"
#include "model/parameters.hpp"

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

void add_link_parameters(const Robot& robot, std::size_t link, const LinkErrors& allowed,
                         std::vector<ErrorParameter>& parameters) {
  const KDL::Frame& origin = link < robot.joints.size() ? robot.joints[link].origin : robot.tip_origin;
  const char own_axis = link == 0 ? 'q' : parallel_letter(origin.M.Inverse(robot.joints[link - 1].axis));
  const KDL::Vector offset = origin.M.Inverse(origin.p);
  for (const ParameterKind kind : {ParameterKind::translation, ParameterKind::rotation}) {
    const bool translation = kind == ParameterKind::translation;
    const bool along_own = translation && allowed.own_translation;
    for (const char axis : kAxisOrder) {
      if (!(axis == own_axis ? along_own : translation ? allowed.translations : allowed.rotations)) {
        continue;
      }
      parameters.push_back({.name = std::string(translation ? "T" : "R") + axis + std::to_string(link),
                            .joint = carrying_joint(robot, link),
                            .kind = kind,
                            .axis = axis,
                            .frame = static_cast<int>(link),
                            .nominal = translation ? KDL::dot(offset, unit(axis)) : 0.0});
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

ErrorModel complete_model(const Robot& robot, KeptAxes kept) {
  if (robot.joints.empty()) {
    refuse_input("a robot without moving joints", "one that load_robot or parse_robot gives");
  }
  ErrorModel model{
      .joints = robot.joints, .tip_origin = robot.tip_origin, .tip_joint = robot.tip_joint, .parameters = {}};
  for (std::size_t i = 0; i < robot.joints.size(); ++i) {
    model.parameters.push_back({.name = "dq" + std::to_string(i + 1),
                                .joint = robot.joints[i].name,
                                .kind = ParameterKind::joint_offset,
                                .axis = parallel_letter(robot.joints[i].axis),
                                .frame = static_cast<int>(i)});
  }
  const std::vector<LinkErrors> allowed = link_errors(robot.joints, kept);
  for (std::size_t link = 0; link <= robot.joints.size(); ++link) {
    add_link_parameters(robot, link, allowed[link], model.parameters);
    if (kept != KeptAxes::none) {
      model.pivots.push_back(allowed[link].pivot);
    }
  }
  model.kept_axes = kept;
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

KDL::Chain error_chain(const ErrorModel& model, const Eigen::VectorXd& errors) {
  require_count("errors", errors.size(), model.parameters.size());
  require_finite("an error", errors.allFinite());
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

}  // namespace kdl_calibration
