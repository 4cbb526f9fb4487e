#include "kdl_calibration/joint_effects.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <memory_resource>
#include <numbers>

#include "base/preconditions.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/mimic.hpp"
#include "kdl_calibration/random.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Ref;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Axis and origin of every joint, and the frame behind its motion, in the base frame; the tip's frame last.
struct JointFrames {
  std::pmr::vector<Vector3d> axes;
  std::pmr::vector<Eigen::Isometry3d> moved;
};

JointFrames joint_frames(const ErrorModel& model, const Ref<const VectorXd>& q,
                         std::pmr::memory_resource* memory = std::pmr::get_default_resource()) {
  JointFrames frames{.axes = std::pmr::vector<Vector3d>(memory), .moved = std::pmr::vector<Eigen::Isometry3d>(memory)};
  frames.axes.reserve(model.joints.size());
  frames.moved.reserve(model.joints.size() + 1);
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
double torque(const ErrorModel& model, const EffectTerm& term, const JointFrames& frames) {
  const auto joint = static_cast<std::size_t>(term.index);
  const Vector3d gravity = to_eigen(model.gravity);
  double sum = 0.0;
  for (const PointMass& load : term.masses) {
    const Vector3d centre = frames.moved[static_cast<std::size_t>(load.frame)] * to_eigen(load.centre);
    const Vector3d lever = centre - frames.moved[joint].translation();
    const Vector3d effect = model.joints[joint].type == JointType::prismatic ? gravity : Vector3d(lever.cross(gravity));
    sum += load.mass * frames.axes[joint].dot(effect);
  }
  return sum;
}

// The linear function of the direction of gravity in a link, see GravityTerm.
double gravity_moment(const ErrorModel& model, const EffectTerm& term, const Ref<const VectorXd>& q,
                      const JointFrames& frames) {
  const Vector3d gravity = to_eigen(model.gravity);
  const Vector3d& axis = frames.axes[static_cast<std::size_t>(term.index)];
  const auto link = static_cast<std::size_t>(term.gravity.link);
  switch (term.gravity.axis) {
    case GravityTerm::kOwn:
      return axis.dot(gravity);
    case GravityTerm::kSlide:
      return q[static_cast<Index>(link)] * axis.dot(frames.axes[link].cross(gravity));
    default:
      return axis.dot(Vector3d(frames.moved[link].linear().col(term.gravity.axis)).cross(gravity));
  }
}

constexpr double kLeastLever = 1e-3;  // [m] on the average; less is no load that changes sides
constexpr double kPlay = 0.15;        // of the torque's mean size, where the play has mostly changed sides

double harmonic(int times, double q) { return times > 0 ? std::sin(times * q) : std::cos(-times * q); }

constexpr double kBeyond = 2.5;     // lengths that a table reaches beyond the measured range on each side
constexpr double kFunctions = 3.4;  // per length: they carry 98.8 % of the variance
constexpr int kMostFunctions = 200;

// sqrt of the spectral density of the Matérn-3/2 covariance of unit variance at the function's frequency, times the
// function, orthonormal on [-L, L].
double table_value(const TableTerm& table, double q) {
  const double half = 0.5 * (table.upper - table.lower);
  const double middle = 0.5 * (table.upper + table.lower);
  const double L = half + kBeyond * table.length;
  const double frequency = table.number * std::numbers::pi / (2.0 * L);
  const double x = std::clamp(q, table.lower, table.upper) - middle;
  const double width = frequency * table.length;
  return std::sqrt(4.0 * table.length / (std::sqrt(3.0) * L)) * std::sin(frequency * (x + L)) /
         (1.0 + width * width / 3.0);
}

double raw_value(const ErrorModel& model, const EffectTerm& term, const Ref<const VectorXd>& q,
                 const JointFrames& frames) {
  const double own = q[term.index];
  switch (term.group) {
    case EffectGroup::gravity:
      return term.masses.empty() ? gravity_moment(model, term, q, frames) : torque(model, term, frames);
    case EffectGroup::gain:
      return own;
    case EffectGroup::backlash:
      return std::tanh(torque(model, term, frames));
    case EffectGroup::harmonics:
      return harmonic(term.harmonic, own);
    case EffectGroup::tables:
      return table_value(term.table, own);
  }
  return 0.0;
}

std::vector<JointFrames> all_frames(const ErrorModel& model, const MatrixXd& q) {
  std::vector<JointFrames> result;
  result.reserve(static_cast<std::size_t>(q.cols()));
  for (Index c = 0; c < q.cols(); ++c) {
    result.push_back(joint_frames(model, q.col(c)));
  }
  return result;
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

// What the term says before its mean is taken off and its scale applied.
VectorXd raw_values(const ErrorModel& model, const EffectTerm& term, const MatrixXd& q,
                    const std::vector<JointFrames>& frames) {
  VectorXd result(q.cols());
  for (Index c = 0; c < q.cols(); ++c) {
    result[c] = raw_value(model, term, q.col(c), frames[static_cast<std::size_t>(c)]);
  }
  return result;
}

std::vector<EffectTerm> candidates(const ErrorModel& model, std::size_t joint) {
  const std::string number = std::to_string(joint + 1);
  const auto first = static_cast<int>(joint);
  const auto tip = static_cast<int>(model.joints.size());
  std::vector<EffectTerm> result;
  if (!model.link_masses.empty()) {
    EffectTerm all{.name = "gravity" + number,
                   .joint = model.joints[joint].name,
                   .index = first,
                   .masses = {},
                   .gravity = {},
                   .table = {}};
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
                      .masses = {{.frame = frame}},
                      .gravity = {},
                      .table = {}});
  }
  return result;
}

bool slides(const ErrorModel& model, std::size_t joint) { return model.joints[joint].type == JointType::prismatic; }

EffectTerm term_of(const ErrorModel& model, std::size_t joint, EffectGroup group, const std::string& last = {}) {
  return {.name = std::string(to_string(group)) + "." + std::to_string(joint + 1) + (last.empty() ? "" : "." + last),
          .joint = model.joints[joint].name,
          .index = static_cast<int>(joint),
          .group = group,
          .masses = {},
          .gravity = {},
          .table = {}};
}

void add_gravity(const ErrorModel& model, std::size_t joint, std::vector<EffectTerm>& terms) {
  const auto add = [&](std::size_t link, int axis) {
    const std::string number = std::to_string(link + 1);
    EffectTerm term = term_of(model, joint, EffectGroup::gravity, number + "xyzso"[axis]);
    term.gravity = {.link = static_cast<int>(link), .axis = axis};
    terms.push_back(term);
  };
  if (slides(model, joint)) {
    add(joint, GravityTerm::kOwn);
    return;
  }
  for (std::size_t link = joint; link < model.joints.size(); ++link) {
    for (int axis = 0; axis < 3; ++axis) {
      add(link, axis);
    }
    if (slides(model, link)) {
      add(link, GravityTerm::kSlide);
    }
  }
}

void add_backlash(const ErrorModel& model, std::size_t joint, const MatrixXd& q, const std::vector<JointFrames>& frames,
                  std::vector<EffectTerm>& terms) {
  EffectTerm term = term_of(model, joint, EffectGroup::backlash);
  for (std::size_t frame = joint + 1; frame <= model.joints.size(); ++frame) {
    term.masses.push_back({.frame = static_cast<int>(frame), .mass = 1.0, .centre = {}});
  }
  double sum = 0.0;
  for (const JointFrames& at : frames) {
    sum += std::abs(torque(model, term, at));
  }
  const double mean = sum / static_cast<double>(q.cols());
  if (!(mean > kLeastLever)) {
    return;
  }
  const double play = kPlay * mean;
  for (PointMass& mass : term.masses) {
    mass.mass = 1.0 / play;
  }
  terms.push_back(term);
}

void add_harmonics(const ErrorModel& model, std::size_t joint, std::vector<EffectTerm>& terms) {
  constexpr int kMost = 2;
  for (int times = 1; times <= kMost && !slides(model, joint); ++times) {
    for (const bool sine : {true, false}) {
      EffectTerm term = term_of(model, joint, EffectGroup::harmonics, (sine ? "sin" : "cos") + std::to_string(times));
      term.harmonic = sine ? times : -times;
      terms.push_back(term);
    }
  }
}

constexpr double kLeastScale = 0.05;  // of a function of unit size
constexpr double kNew = 0.05;         // share of a function that others of its joint do not say

// Takes off means, applies scales, and leaves out what N joint values do not tell apart.
std::vector<EffectTerm> told_apart(const ErrorModel& model, const std::vector<EffectTerm>& terms, const MatrixXd& q,
                                   const std::vector<JointFrames>& frames) {
  std::vector<EffectTerm> kept;
  MatrixXd basis(q.cols(), 0);
  int joint = -1;
  for (EffectTerm term : terms) {
    if (term.index != joint) {
      joint = term.index;
      basis.resize(q.cols(), 0);
    }
    VectorXd values = raw_values(model, term, q, frames);
    term.mean = values.mean();
    values.array() -= term.mean;
    term.scale = values.norm() / std::sqrt(static_cast<double>(q.cols()));
    if (!(term.scale > (term.group == EffectGroup::gain ? 0.0 : kLeastScale))) {
      continue;
    }
    VectorXd rest = values.normalized();
    for (int pass = 0; pass < 2; ++pass) {  // twice is enough (Kahan, in Parlett 1980)
      rest -= basis * (basis.transpose() * rest);
    }
    if (rest.norm() < kNew) {
      continue;
    }
    basis.conservativeResize(Eigen::NoChange, basis.cols() + 1);
    basis.rightCols<1>() = rest.normalized();
    kept.push_back(std::move(term));
  }
  return kept;
}

}  // namespace

const char* to_string(EffectGroup group) {
  constexpr std::array<const char*, kEffectGroups> kNames = {"gravity", "gain", "backlash", "harmonics", "tables"};
  return kNames[static_cast<std::size_t>(group)];
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

std::string size_name(const EffectTerm& term) {
  const std::string group = to_string(term.group);
  return term.group == EffectGroup::tables ? group + "." + std::to_string(term.index + 1) : group;
}

std::vector<EffectTerm> effect_terms(const ErrorModel& model, EffectGroup group, const MatrixXd& joint_values) {
  require_count("joint values", joint_values.rows(), model.joints.size());
  if (group == EffectGroup::tables) {
    return table_terms(model, joint_values, std::numbers::pi / 6.0);
  }
  if (joint_values.cols() == 0) {
    return {};
  }
  const std::vector<JointFrames> frames = all_frames(model, joint_values);
  std::vector<EffectTerm> all;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    if (group == EffectGroup::gravity) {
      add_gravity(model, joint, all);
    } else if (group == EffectGroup::gain) {
      all.push_back(term_of(model, joint, group));
    } else if (group == EffectGroup::backlash) {
      add_backlash(model, joint, joint_values, frames, all);
    } else {
      add_harmonics(model, joint, all);
    }
  }
  return told_apart(model, all, joint_values, frames);
}

std::vector<EffectTerm> table_terms(const ErrorModel& model, const MatrixXd& joint_values, double length) {
  require_count("joint values", joint_values.rows(), model.joints.size());
  require_sigma("the length of a table", length);
  constexpr double kLeastTurn = std::numbers::pi / 18.0;
  constexpr double kLeastSlide = 0.02;
  std::vector<EffectTerm> result;
  for (std::size_t joint = 0; joint < model.joints.size() && joint_values.cols() > 0; ++joint) {
    const auto row = joint_values.row(static_cast<Index>(joint));
    TableTerm table{.length = length, .lower = row.minCoeff(), .upper = row.maxCoeff()};
    const double range = table.upper - table.lower;
    if (range < (slides(model, joint) ? kLeastSlide : kLeastTurn)) {
      continue;
    }
    table.length = std::min(length, 0.5 * range);
    const double L = 0.5 * range + kBeyond * table.length;
    const int functions = std::min(static_cast<int>(std::ceil(kFunctions * L / table.length)), kMostFunctions);
    for (table.number = 1; table.number <= functions; ++table.number) {
      EffectTerm term = term_of(model, joint, EffectGroup::tables, std::to_string(table.number));
      term.table = table;
      result.push_back(term);
    }
  }
  return result;
}

std::vector<EffectTerm> load_terms(const ErrorModel& model) {
  const MatrixXd q = generic_configurations(model);
  const std::vector<JointFrames> frames = all_frames(model, q);
  struct Candidate {
    EffectTerm term;
    VectorXd torques;
  };
  std::vector<Candidate> all;
  double largest = 0.0;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    for (EffectTerm& term : candidates(model, joint)) {
      all.push_back({term, raw_values(model, term, q, frames)});
      largest = std::max(largest, all.back().torques.cwiseAbs().maxCoeff());
    }
  }
  std::vector<EffectTerm> kept;
  MatrixXd basis(kSamples, 0);
  int joint = -1;
  for (Candidate& candidate : all) {
    if (candidate.term.index != joint) {
      joint = candidate.term.index;
      basis = VectorXd::Constant(kSamples, 1.0 / std::sqrt(kSamples));  // a constant is the joint's offset
    }
    const VectorXd rest = candidate.torques - basis * (basis.transpose() * candidate.torques);
    const double peak = candidate.torques.cwiseAbs().maxCoeff();
    if (peak < kDistinct * largest || rest.norm() < kDistinct * candidate.torques.norm()) {
      continue;
    }
    basis.conservativeResize(Eigen::NoChange, basis.cols() + 1);
    basis.rightCols<1>() = rest.normalized();
    candidate.term.scale = peak;
    kept.push_back(std::move(candidate.term));
  }
  return kept;
}

std::vector<EffectTerm> gain_terms(const ErrorModel& model) {
  std::vector<EffectTerm> result;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    result.push_back(term_of(model, joint, EffectGroup::gain));
  }
  return result;
}

std::vector<EffectTerm> load_and_gain_terms(const ErrorModel& model) {
  std::vector<EffectTerm> result = load_terms(model);
  const std::vector<EffectTerm> gains = gain_terms(model);
  result.insert(result.end(), gains.begin(), gains.end());
  return result;
}

std::map<std::pair<EffectGroup, int>, std::vector<Index>> terms_by_joint(const ErrorModel& model) {
  std::map<std::pair<EffectGroup, int>, std::vector<Index>> result;
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    result[{model.effects[e].group, model.effects[e].index}].push_back(static_cast<Index>(e));
  }
  return result;
}

MatrixXd effect_basis(const ErrorModel& model, const MatrixXd& joint_values) {
  require_count("joint values", joint_values.rows(), model.joints.size());
  MatrixXd basis(static_cast<Index>(model.effects.size()), joint_values.cols());
  if (model.effects.empty()) {
    return basis;
  }
  for (Index c = 0; c < joint_values.cols(); ++c) {
    const JointFrames frames = joint_frames(model, joint_values.col(c));
    for (std::size_t e = 0; e < model.effects.size(); ++e) {
      const EffectTerm& term = model.effects[e];
      basis(static_cast<Index>(e), c) = (raw_value(model, term, joint_values.col(c), frames) - term.mean) / term.scale;
    }
  }
  return basis;
}

void effect_motion(const ErrorModel& model, const VectorXd& values, const Ref<const VectorXd>& q,
                   Ref<VectorXd> motion) {
  require_count("values of effects", values.size(), model.effects.size());
  require_count("joint values", q.size(), model.joints.size());
  require_count("motions of joints", motion.size(), model.joints.size());
  alignas(Eigen::Isometry3d) std::array<std::byte, (kFewJoints + 1) * (sizeof(Eigen::Isometry3d) + sizeof(Vector3d))>
      bytes;
  std::pmr::monotonic_buffer_resource memory(bytes.data(), bytes.size());
  const JointFrames frames = joint_frames(model, q, &memory);
  motion.setZero();
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const EffectTerm& term = model.effects[e];
    motion[term.index] += values[static_cast<Index>(e)] * (raw_value(model, term, q, frames) - term.mean) / term.scale;
  }
}

MatrixXd effective_joint_values(const ErrorModel& model, const VectorXd& values, const MatrixXd& joint_values) {
  if (values.size() == 0 || values.isZero(0.0)) {
    return joint_values;
  }
  return effective_joint_values(model, values, joint_values, effect_basis(model, joint_values));
}

MatrixXd effective_joint_values(const ErrorModel& model, const VectorXd& values, const MatrixXd& joint_values,
                                const MatrixXd& basis) {
  MatrixXd result = joint_values;
  if (values.size() == 0 || values.isZero(0.0)) {
    return result;
  }
  require_count("values of effects", values.size(), model.effects.size());
  require_count("joint values", joint_values.rows(), model.joints.size());
  require_count("rows of a basis", basis.rows(), model.effects.size());
  require_count("columns of a basis", basis.cols(), joint_values.cols());
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const auto row = static_cast<Index>(e);
    result.row(model.effects[e].index) += values[row] * basis.row(row);
  }
  return result;
}

}  // namespace kdl_calibration
