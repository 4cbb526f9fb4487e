#include "kdl_calibration/deflection.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <numbers>

#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/mimic.hpp"
#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Axis and origin of every joint, and the frame behind its motion, in the base frame; the tip's frame last.
struct JointFrames {
  std::vector<Vector3d> axes;
  std::vector<Eigen::Isometry3d> moved;
};

JointFrames joint_frames(const ErrorModel& model, const VectorXd& q) {
  JointFrames frames;
  KDL::Frame pose = KDL::Frame::Identity();
  for (std::size_t i = 0; i < model.joints.size(); ++i) {
    const MovingJoint& joint = model.joints[i];
    pose = pose * joint.origin;
    frames.axes.push_back(to_eigen(pose.M * joint.axis));
    const double value = q[static_cast<Index>(i)];
    pose = pose * (joint.type == JointType::prismatic ? KDL::Frame(joint.axis * value)
                                                      : KDL::Frame(KDL::Rotation::Rot2(joint.axis, value)));
    frames.moved.push_back(to_eigen(pose));
  }
  frames.moved.push_back(to_eigen(pose * model.tip_origin));
  return frames;
}

// Torque (force for a prismatic joint) of the masses under gravity about the joint's axis, with g = 1.
double torque(const ErrorModel& model, const Deflection& deflection, const JointFrames& frames) {
  const auto joint = static_cast<std::size_t>(deflection.index);
  const Vector3d gravity = to_eigen(model.gravity);
  double sum = 0.0;
  for (const PointMass& load : deflection.masses) {
    const Vector3d centre = frames.moved[static_cast<std::size_t>(load.frame)] * to_eigen(load.centre);
    const Vector3d lever = centre - frames.moved[joint].translation();
    const Vector3d effect = model.joints[joint].type == JointType::prismatic ? gravity : Vector3d(lever.cross(gravity));
    sum += load.mass * frames.axes[joint].dot(effect);
  }
  return sum;
}

constexpr int kSamples = 200;
constexpr double kDistinct = 0.15;  // share of a torque that must be new

MatrixXd generic_configurations(const ErrorModel& model) {
  Random random(1);
  MatrixXd q(static_cast<Index>(model.joints.size()), kSamples);
  for (Index c = 0; c < q.cols(); ++c) {
    for (Index i = 0; i < q.rows(); ++i) {
      const bool prismatic = model.joints[static_cast<std::size_t>(i)].type == JointType::prismatic;
      const double range = prismatic ? 1.0 : std::numbers::pi;
      q(i, c) = random.uniform(-range, range);
    }
  }
  follow(model.joints, q);
  return q;
}

VectorXd torques(const ErrorModel& model, const Deflection& deflection, const MatrixXd& q) {
  VectorXd result(q.cols());
  for (Index c = 0; c < q.cols(); ++c) {
    result[c] = torque(model, deflection, joint_frames(model, q.col(c)));
  }
  return result;
}

std::vector<Deflection> candidates(const ErrorModel& model, std::size_t joint) {
  const std::string number = std::to_string(joint + 1);
  const auto first = static_cast<int>(joint);
  const auto tip = static_cast<int>(model.joints.size());
  std::vector<Deflection> result;
  if (!model.link_masses.empty()) {
    Deflection all{.name = "gravity" + number, .joint = model.joints[joint].name, .index = first, .masses = {}};
    for (const PointMass& mass : model.link_masses) {
      if (mass.frame >= first) {
        all.masses.push_back(mass);
      }
    }
    result.push_back(all);
    return result;
  }
  for (int frame = first + 1; frame <= tip; ++frame) {
    result.push_back({.name = "gravity" + number + "_" + std::to_string(frame + 1),
                      .joint = model.joints[joint].name,
                      .index = first,
                      .masses = {{.frame = frame}}});
  }
  return result;
}

}  // namespace

std::vector<Deflection> gravity_deflections(const ErrorModel& model) {
  const MatrixXd q = generic_configurations(model);
  struct Candidate {
    Deflection deflection;
    VectorXd torques;
  };
  std::vector<Candidate> all;
  double largest = 0.0;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    for (Deflection& deflection : candidates(model, joint)) {
      all.push_back({deflection, torques(model, deflection, q)});
      largest = std::max(largest, all.back().torques.cwiseAbs().maxCoeff());
    }
  }
  std::vector<Deflection> kept;
  MatrixXd basis(kSamples, 0);
  int joint = -1;
  for (Candidate& candidate : all) {
    if (candidate.deflection.index != joint) {
      joint = candidate.deflection.index;
      basis = VectorXd::Constant(kSamples, 1.0 / std::sqrt(kSamples));  // a constant is the joint's offset
    }
    const VectorXd rest = candidate.torques - basis * (basis.transpose() * candidate.torques);
    const double peak = candidate.torques.cwiseAbs().maxCoeff();
    if (peak < kDistinct * largest || rest.norm() < kDistinct * candidate.torques.norm()) {
      continue;
    }
    basis.conservativeResize(Eigen::NoChange, basis.cols() + 1);
    basis.rightCols<1>() = rest.normalized();
    candidate.deflection.largest = peak;
    kept.push_back(std::move(candidate.deflection));
  }
  return kept;
}

std::vector<Deflection> gain_deflections(const ErrorModel& model) {
  std::vector<Deflection> result;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    result.push_back({.name = "gain" + std::to_string(joint + 1),
                      .joint = model.joints[joint].name,
                      .index = static_cast<int>(joint),
                      .gain = true,
                      .masses = {}});
  }
  return result;
}

MatrixXd deflection_basis(const ErrorModel& model, const MatrixXd& joint_values) {
  MatrixXd basis(static_cast<Index>(model.deflections.size()), joint_values.cols());
  if (model.deflections.empty()) {
    return basis;
  }
  for (Index c = 0; c < joint_values.cols(); ++c) {
    const JointFrames frames = joint_frames(model, joint_values.col(c));
    for (std::size_t d = 0; d < model.deflections.size(); ++d) {
      const Deflection& deflection = model.deflections[d];
      basis(static_cast<Index>(d), c) =
          deflection.gain ? joint_values(deflection.index, c) : torque(model, deflection, frames) / deflection.largest;
    }
  }
  return basis;
}

MatrixXd deflected(const ErrorModel& model, const VectorXd& values, const MatrixXd& joint_values) {
  MatrixXd result = joint_values;
  if (values.size() == 0 || values.isZero(0.0)) {
    return result;
  }
  const MatrixXd basis = deflection_basis(model, joint_values);
  for (std::size_t d = 0; d < model.deflections.size(); ++d) {
    const auto row = static_cast<Index>(d);
    result.row(model.deflections[d].index) += values[row] * basis.row(row);
  }
  return result;
}

}  // namespace kdl_calibration
