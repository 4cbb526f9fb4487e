#include "effects/effect_functions.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>

#include "base/preconditions.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/kinematics.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Ref;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// The linear function of the direction of gravity in a link, see GravityTerm.
double gravity_moment(const ErrorModel& model, const EffectTerm& term, const Ref<const VectorXd>& q,
                      const JointFrames& frames) {
  const Vector3d gravity = to_eigen(model.gravity);
  const Vector3d axis = frames.axis(static_cast<std::size_t>(term.index), term.axis);
  const auto link = static_cast<std::size_t>(term.gravity.link);
  switch (term.gravity.axis) {
    case GravityTerm::kOwn:
      return axis.dot(gravity);
    case GravityTerm::kSlide:
      return q[static_cast<Index>(link)] * axis.dot(frames.axis(link).cross(gravity));
    default:
      return axis.dot(Vector3d(frames.moved[link].linear().col(term.gravity.axis)).cross(gravity));
  }
}

double harmonic(double times, double q) { return times > 0 ? std::sin(times * q) : std::cos(-times * q); }

// Beyond its ends a table is what it is there.
bool is_withheld(const TableTerm& table, double q) {
  const double held = std::clamp(q, table.lower, table.upper);
  return std::any_of(table.withheld.begin(), table.withheld.end(),
                     [&](const auto& range) { return range.first <= held && held <= range.second; });
}

}  // namespace

bool is_withheld(const EffectTerm& term, double q) {
  return term.group == EffectGroup::tables && is_withheld(term.table, q);
}

bool withholds_tables(const ErrorModel& model, const VectorXd& q) {
  require_count("joint values", q.size(), model.joints.size());
  return std::any_of(model.effects.begin(), model.effects.end(),
                     [&](const EffectTerm& term) { return is_withheld(term, q[term.index]); });
}

Vector3d JointFrames::axis(std::size_t joint, EffectAxis axis) const {
  return axes[joint].col(axis == EffectAxis::own ? 2 : axis == EffectAxis::across_x ? 0 : 1);
}

JointFrames joint_frames(const ErrorModel& model, const Ref<const VectorXd>& q, std::pmr::memory_resource* memory) {
  JointFrames frames{.axes = std::pmr::vector<Matrix3d>(memory), .moved = std::pmr::vector<Eigen::Isometry3d>(memory)};
  frames.axes.reserve(model.joints.size());
  frames.moved.reserve(model.joints.size() + 1);
  KDL::Frame pose = KDL::Frame::Identity();
  for (std::size_t i = 0; i < model.joints.size(); ++i) {
    const MovingJoint& joint = model.joints[i];
    pose = pose * joint.origin;
    frames.axes.emplace_back(to_eigen(pose).linear() * z_onto(to_eigen(joint.axis)));
    const double value = q[static_cast<Index>(i)];
    pose = pose * (joint.type == JointType::prismatic ? KDL::Frame(joint.axis * value)
                                                      : KDL::Frame(KDL::Rotation::Rot2(joint.axis, value)));
    frames.moved.push_back(to_eigen(pose));
  }
  frames.moved.push_back(to_eigen(pose * model.tip_origin));
  return frames;
}

std::vector<JointFrames> joint_frames_of_all(const ErrorModel& model, const MatrixXd& joint_values) {
  std::vector<JointFrames> result;
  result.reserve(static_cast<std::size_t>(joint_values.cols()));
  for (Index c = 0; c < joint_values.cols(); ++c) {
    result.push_back(joint_frames(model, joint_values.col(c)));
  }
  return result;
}

// sqrt of the spectral density of the Matérn-3/2 covariance of unit variance at the function's frequency, times the
// function, orthonormal on [-L, L].
double table_value(const TableTerm& table, double q) {
  const double half = 0.5 * (table.upper - table.lower);
  const double middle = 0.5 * (table.upper + table.lower);
  const double L = half + kTableBeyond * table.length;
  const double frequency = table.number * std::numbers::pi / (2.0 * L);
  const double x = std::clamp(q, table.lower, table.upper) - middle;
  const double width = frequency * table.length;
  return std::sqrt(4.0 * table.length / (std::sqrt(3.0) * L)) * std::sin(frequency * (x + L)) /
         (1.0 + width * width / 3.0);
}

double torque(const ErrorModel& model, const EffectTerm& term, const JointFrames& frames) {
  const auto joint = static_cast<std::size_t>(term.index);
  const Vector3d gravity = to_eigen(model.gravity);
  double sum = 0.0;
  for (const PointMass& load : term.masses) {
    const Vector3d centre = frames.moved[static_cast<std::size_t>(load.frame)] * to_eigen(load.centre);
    const Vector3d lever = centre - frames.moved[joint].translation();
    const Vector3d effect = model.joints[joint].type == JointType::prismatic ? gravity : Vector3d(lever.cross(gravity));
    sum += load.mass * frames.axis(joint).dot(effect);
  }
  return sum;
}

double raw_value(const ErrorModel& model, const EffectTerm& term, const DriveSignals& signals, Index column) {
  const bool told = term.signal == DriveSignal::torque;
  const MatrixXd& values = told ? signals.torques : signals.approach;
  const double value = values.size() > 0 ? values(term.index, column) : std::numeric_limits<double>::quiet_NaN();
  if (told && std::isnan(value)) {
    throw InputError("no measured torque of " + model.joints[static_cast<std::size_t>(term.index)].name +
                     (values.size() > 0 ? " at configuration number " + std::to_string(column + 1) : "") +
                     ", expected one for the effect " + term.name);
  }
  return told && term.play > 0.0 ? std::tanh(value / term.play) : value;
}

double raw_value(const ErrorModel& model, const EffectTerm& term, const Ref<const VectorXd>& q,
                 const JointFrames& frames) {
  if (term.signal != DriveSignal::none) {
    return raw_value(model, term, DriveSignals(), 0);
  }
  const double own = q[term.index];
  switch (term.group) {
    case EffectGroup::gravity:
    case EffectGroup::transverse:
      return term.masses.empty() ? gravity_moment(model, term, q, frames) : torque(model, term, frames);
    case EffectGroup::gain:
      return own;
    case EffectGroup::backlash:
      return std::tanh(torque(model, term, frames));
    case EffectGroup::harmonics:
    case EffectGroup::ripple:
      return harmonic(term.harmonic, own);
    case EffectGroup::tables:
      return is_withheld(term.table, own) ? 0.0 : table_value(term.table, own);
    case EffectGroup::torque:
      break;
  }
  return 0.0;
}

VectorXd raw_values(const ErrorModel& model, const EffectTerm& term, const MatrixXd& joint_values,
                    const std::vector<JointFrames>& frames) {
  VectorXd result(joint_values.cols());
  for (Index c = 0; c < joint_values.cols(); ++c) {
    result[c] = raw_value(model, term, joint_values.col(c), frames[static_cast<std::size_t>(c)]);
  }
  return result;
}

}  // namespace kdl_calibration
