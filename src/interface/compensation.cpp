#include "kdl_calibration/compensation.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "effects/arm_kinematics.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/input_check.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/joint_ranges.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace compensation {

using JointVector = CompensatedJoints;

// Value of a joint of the chain: multiplier * that of an independent joint + offset.
struct Coupling {
  Eigen::Index independent = 0;
  double multiplier = 1.0;
  double offset = 0.0;
  bool is_held = false;  // never changes
};

struct Bounds {
  JointVector lower;
  JointVector upper;

  bool hold(const JointVector& u) const { return (u.array() >= lower.array() && u.array() <= upper.array()).all(); }
  JointVector within(const JointVector& u) const { return u.cwiseMax(lower).cwiseMin(upper); }
  // Whether one of the first `joints` is at its end or beyond.
  bool touch(const JointVector& u, Eigen::Index joints) const {
    return (u.array() <= lower.array() || u.array() >= upper.array()).head(joints).any();
  }
};

}  // namespace compensation

namespace {

using compensation::Bounds;
using compensation::Coupling;
using compensation::JointVector;

using Eigen::Index;
using Eigen::Isometry3d;

constexpr double kExact = 1e-10;                // [m] and [rad]
constexpr double kPositionFirst = 1e5;          // [1/m] weight of positions against orientations
constexpr double kNearWristSingularity = 0.25;  // volume, see wrist_volume
constexpr double kCheap = 10.0;                 // [1/m] angle that an exact position may cost
constexpr int kMostJoints = kMostCompensatedJoints;
static_assert(kMostJoints <= static_cast<int>(kFewJoints));

using Columns = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, kMostJoints>;

std::vector<Coupling> couplings_of(const std::vector<MovingJoint>& joints, const std::vector<std::size_t>& independent,
                                   const std::vector<std::string>& held) {
  const auto place = [&](std::size_t joint) {
    return static_cast<Index>(std::find(independent.begin(), independent.end(), joint) - independent.begin());
  };
  std::vector<Coupling> couplings;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const Mimic mimic = joints[i].mimic.value_or(Mimic{.leader = i});
    couplings.push_back({.independent = place(mimic.leader),
                         .multiplier = mimic.multiplier,
                         .offset = mimic.offset,
                         .is_held = std::count(held.begin(), held.end(), joints[mimic.leader].name) > 0});
  }
  for (const std::string& name : held) {
    const auto is_there = [&](std::size_t joint) { return joints[joint].name == name; };
    if (std::none_of(independent.begin(), independent.end(), is_there)) {
      refuse_input("the arm has no independent joint " + shown(name) + " to hold", "names of its independent joints");
    }
  }
  return couplings;
}

// Distance of the arm from the asked pose as a twist in the base frame, and its derivative by the independent joints.
struct Deviation {
  Vector6d error;
  Columns jacobian;

  double position() const { return error.head<3>().norm(); }
  double orientation() const { return error.tail<3>().norm(); }
  bool is_exact() const { return position() <= kExact && orientation() <= kExact; }
};

// The pose that an arm is to reach.
struct Task {
  const ArmKinematics& arm;
  const std::vector<Coupling>& couplings;
  const Isometry3d& X_BF;

  Deviation at(const JointVector& u) const {
    Columns of_joints(6, arm.joints());
    const Isometry3d reached = arm.flange_pose(all_values(u), of_joints);
    Deviation result{.error = {}, .jacobian = Columns::Zero(6, u.size())};
    result.error << X_BF.translation() - reached.translation(),
        rotation_log(X_BF.linear() * reached.linear().transpose());
    for (Index i = 0; i < of_joints.cols(); ++i) {
      const Coupling& coupling = couplings[static_cast<std::size_t>(i)];
      result.jacobian.col(coupling.independent) += (coupling.is_held ? 0.0 : coupling.multiplier) * of_joints.col(i);
    }
    return result;
  }

  JointVector all_values(const JointVector& u) const {
    JointVector q(arm.joints());
    for (Index i = 0; i < q.size(); ++i) {
      const Coupling& coupling = couplings[static_cast<std::size_t>(i)];
      q[i] = coupling.multiplier * u[coupling.independent] + coupling.offset;
    }
    return q;
  }
};

// The smallest step that removes the deviation to first order.
JointVector least_step(const Deviation& deviation) {
  const Columns& J = deviation.jacobian;
  if (J.cols() == 6) {
    return Matrix6d(J).partialPivLu().solve(deviation.error);
  }
  return J.transpose() * Matrix6d(J * J.transpose()).ldlt().solve(deviation.error);
}

// Newton's method without bounds. False if it does not converge.
bool newton(const Task& task, JointVector& u, Deviation& deviation) {
  constexpr int kMostSteps = 12;
  constexpr double kLargestStep = std::numbers::pi;
  double before = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kMostSteps; ++i) {
    if (deviation.is_exact()) {
      return true;
    }
    const JointVector step = least_step(deviation);
    if (!(deviation.error.norm() < before) || !(step.lpNorm<Eigen::Infinity>() < kLargestStep)) {
      return false;
    }
    before = deviation.error.norm();
    u += step;
    deviation = task.at(u);
  }
  return deviation.is_exact();
}

// Least squares of the weighted deviation after a step within `range`, damped: min |w (e - J s)|^2 + damping |s|^2. A
// joint that would leave the range is held at its end.
JointVector bounded_step(const Deviation& deviation, double weight, double damping, const Bounds& range) {
  const Index n = deviation.jacobian.cols();
  const Vector6d weights = (Vector6d() << weight, weight, weight, 1.0, 1.0, 1.0).finished();
  const Columns J = weights.asDiagonal() * deviation.jacobian;
  const Vector6d error = weights.cwiseProduct(deviation.error);
  const JointVector pull = J.transpose() * error;
  JointVector step = JointVector::Zero(n);
  std::array<Index, kMostJoints> free{};
  Index count = 0;
  for (Index i = 0; i < n; ++i) {
    if ((pull[i] > 0.0 && range.upper[i] > 0.0) || (pull[i] < 0.0 && range.lower[i] < 0.0)) {
      free[static_cast<std::size_t>(count++)] = i;
    }
  }
  while (count > 0) {
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6 + kMostJoints, kMostJoints> A =
        decltype(A)::Zero(6 + count, count);
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 6 + kMostJoints, 1> b = decltype(b)::Zero(6 + count);
    b.head<6>() = error - J * step;
    for (Index k = 0; k < count; ++k) {
      const Index joint = free[static_cast<std::size_t>(k)];
      b.head<6>() += J.col(joint) * step[joint];
      A.col(k).head<6>() = J.col(joint);
      A(6 + k, k) = std::sqrt(damping);
    }
    const JointVector found = A.colPivHouseholderQr().solve(b);
    Index kept = 0;
    for (Index k = 0; k < count; ++k) {
      const Index joint = free[static_cast<std::size_t>(k)];
      step[joint] = std::clamp(found[k], range.lower[joint], range.upper[joint]);
      if (step[joint] == found[k]) {
        free[static_cast<std::size_t>(kept++)] = joint;
      }
    }
    if (kept == count) {
      break;
    }
    count = kept;
  }
  return step;
}

// Levenberg-Marquardt within bounds; `weight` [1/m] is that of positions against orientations.
void descend(const Task& task, const Bounds& bounds, double weight, JointVector& u, Deviation& deviation) {
  constexpr int kMostSteps = 100;
  constexpr double kLeastDamping = 1e-12;
  constexpr double kMostDamping = 1e6;
  constexpr double kNoStep = 1e-14;
  const auto cost = [&](const Deviation& d) { return std::hypot(weight * d.position(), d.orientation()); };
  double damping = 1e-4;
  for (int i = 0; i < kMostSteps && damping < kMostDamping && !deviation.is_exact(); ++i) {
    const JointVector step =
        bounded_step(deviation, weight, damping, {.lower = bounds.lower - u, .upper = bounds.upper - u});
    if (!(step.norm() > kNoStep)) {
      break;
    }
    const JointVector moved = bounds.within(u + step);
    Deviation there = task.at(moved);
    if (cost(there) < cost(deviation)) {
      u = moved;
      deviation = there;
      damping = std::max(kLeastDamping, damping / 10.0);
    } else {
      damping *= 10.0;
    }
  }
}

// Removes what is left of the position error and keeps the orientation.
void refine_position(const Task& task, const Bounds& bounds, JointVector& u, Deviation& deviation) {
  constexpr int kMostSteps = 3;
  for (int i = 0; i < kMostSteps && deviation.position() > kExact; ++i) {
    Deviation position = deviation;
    position.error.tail<3>().setZero();
    u = bounds.within(
        u + bounded_step(position, kPositionFirst, 0.0, {.lower = bounds.lower - u, .upper = bounds.upper - u}));
    deviation = task.at(u);
  }
}

// Volume that the unit vectors along the last three joints' axes span: 0 in a wrist singularity.
double wrist_volume(const Columns& jacobian) { return jacobian.bottomRightCorner<3, 3>().determinant(); }

// Whether elbow or shoulder are on the other side of a singularity. The determinant of a six-joint arm changes its sign
// with elbow, shoulder and wrist; the wrist's part is divided out, and must be told from 0.
bool changes_branch(const Columns& before, const Columns& after) {
  constexpr double kFromSingular = 0.05;
  if (before.cols() != 6 || std::abs(wrist_volume(before)) < kFromSingular ||
      std::abs(wrist_volume(after)) < kFromSingular) {
    return false;
  }
  const auto sign = [](const Columns& J) { return std::signbit(Matrix6d(J).determinant() * wrist_volume(J)); };
  return sign(before) != sign(after);
}

// Changes without bounds.
JointVector anywhere(Index joints) { return JointVector::Constant(joints, std::numeric_limits<double>::infinity()); }

// The pose with an exact rotation.
Isometry3d rigid_pose(const Isometry3d& X_BF) {
  require_finite("an asked pose", X_BF.matrix().allFinite());
  if (!is_rigid(X_BF)) {
    refuse_input("an asked pose is scaled, skewed or mirrored", "a rotation and a translation");
  }
  Isometry3d result = X_BF;
  result.linear() = Eigen::Quaterniond(X_BF.linear()).normalized().toRotationMatrix();
  return result;
}

}  // namespace

const char* to_string(CompensationStatus status) {
  switch (status) {
    case CompensationStatus::exact:
      return "exact";
    case CompensationStatus::position_only:
      return "position_only";
    case CompensationStatus::unreachable:
      return "unreachable";
    case CompensationStatus::out_of_limits:
      return "out_of_limits";
    case CompensationStatus::branch_changed:
      return "branch_changed";
    case CompensationStatus::step_limited:
      break;
  }
  return "step_limited";
}

struct Compensator::Parts {
  Parts(const PredictionBasis& basis, const CompensationOptions& options)
      : joints(basis.model.joints),
        leaders(independent_joints(joints)),
        couplings(couplings_of(joints, leaders, options.held)),
        calibrated(basis.model, basis.estimate.errors, basis.estimate.effects),
        nominal(basis.model, Eigen::VectorXd::Zero(basis.estimate.errors.size()), {}),
        position_first(options.position_first) {
    constexpr double kNoLimit = std::numeric_limits<double>::infinity();
    const auto count = static_cast<Index>(leaders.size());
    limits = {.lower = JointVector::Constant(count, -kNoLimit), .upper = JointVector::Constant(count, kNoLimit)};
    most_change = JointVector::Constant(count, options.most_change);
    most_step = JointVector::Constant(count, options.most_step);
    for (Index i = 0; i < count; ++i) {
      const MovingJoint& joint = joints[leaders[static_cast<std::size_t>(i)]];
      limits.lower[i] = joint.lower.value_or(-kNoLimit);
      limits.upper[i] = joint.upper.value_or(kNoLimit);
    }
    for (const Coupling& coupling : couplings) {  // a follower does not move by more either
      const double moves = std::max(1.0, std::abs(coupling.multiplier));
      double& of_leader = most_change[coupling.independent];
      of_leader = std::min(of_leader, options.most_change / moves);
      most_step[coupling.independent] = std::min(most_step[coupling.independent], options.most_step / moves);
    }
  }

  // The values of the independent joints.
  JointVector independent(const Eigen::Ref<const Eigen::VectorXd>& q) const {
    require_joint_values(q, joints);
    JointVector u(most_change.size());
    for (Index i = 0; i < u.size(); ++i) {
      u[i] = q[static_cast<Index>(leaders[static_cast<std::size_t>(i)])];
    }
    return u;
  }

  // Where the nominal arm is at the independent joints' values.
  Isometry3d asked_pose(const JointVector& u) const {
    return nominal.flange_pose(
        Task{.arm = nominal, .couplings = couplings, .X_BF = Isometry3d::Identity()}.all_values(u));
  }

  // The limits, and the largest change from `u`. A joint beyond its limits may stay where it is.
  Bounds around(const JointVector& u, const JointVector& change) const {
    return {.lower = limits.lower.cwiseMin(u).cwiseMax(u - change),
            .upper = limits.upper.cwiseMax(u).cwiseMin(u + change)};
  }

  CompensatedPoint solve(const ArmKinematics& arm, const Isometry3d& X_BF, const JointVector& start,
                         const JointVector& change) const;
  // The pose X_BF from `start`, with a correction near `correction`, that of the independent joints one point before.
  CompensatedPoint solve_near(const Isometry3d& X_BF, const JointVector& start, const JointVector& correction) const;
  Eigen::MatrixXd starts() const;
  // Joint values of the nominal arm within the limits, found from `start`; empty if it does not reach the pose.
  std::optional<JointVector> nominal_values(const Isometry3d& X_BF, const JointVector& start) const;

  std::vector<MovingJoint> joints;
  std::vector<std::size_t> leaders;  // the independent joints
  std::vector<Coupling> couplings;   // of each joint
  ArmKinematics calibrated;
  ArmKinematics nominal;
  Bounds limits;            // of the independent joints
  JointVector most_change;  // of the independent joints
  JointVector most_step;    // of their corrections, from point to point
  bool position_first;
};

CompensatedPoint Compensator::Parts::solve(const ArmKinematics& arm, const Isometry3d& X_BF, const JointVector& start,
                                           const JointVector& change) const {
  const Task task{.arm = arm, .couplings = couplings, .X_BF = X_BF};
  const auto point = [&](CompensationStatus status, const JointVector& u, const Deviation& deviation) {
    const bool beyond = status == CompensationStatus::exact && !limits.hold(u);
    return CompensatedPoint{.status = beyond ? CompensationStatus::out_of_limits : status,
                            .joint_values = task.all_values(u),
                            .change = task.all_values(u) - task.all_values(start),
                            .position_error = deviation.position(),
                            .orientation_error = deviation.orientation()};
  };
  const auto of_exact = [](bool other_branch) {
    return other_branch ? CompensationStatus::branch_changed : CompensationStatus::exact;
  };
  const Deviation first = task.at(start);
  const Bounds bounds = around(start, change);
  JointVector u = start;
  Deviation deviation = first;
  const bool converged = newton(task, u, deviation);
  const bool other_branch = converged && changes_branch(first.jacobian, deviation.jacobian);
  if (converged && bounds.hold(u)) {
    return point(of_exact(other_branch), u, deviation);
  }
  u = start;
  deviation = first;
  descend(task, bounds, 1.0, u, deviation);
  if (deviation.is_exact()) {
    return point(of_exact(changes_branch(first.jacobian, deviation.jacobian)), u, deviation);
  }
  const bool at_limit = limits.touch(u, u.size());
  if (at_limit && !position_first) {
    return point(CompensationStatus::out_of_limits, u, deviation);
  }
  JointVector held = u;
  Deviation of_held = deviation;
  descend(task, bounds, kPositionFirst, held, of_held);
  refine_position(task, bounds, held, of_held);
  // A stretched arm would buy little of the position with much of the orientation.
  const bool is_cheap = of_held.orientation() <= kCheap * (deviation.position() + deviation.orientation());
  const bool has_few_joints = held.size() < 6;
  const bool lacks_the_wrist = !has_few_joints && is_cheap && !bounds.touch(held, held.size() - 3) &&
                               std::abs(wrist_volume(of_held.jacobian)) < kNearWristSingularity;
  if (of_held.position() <= kExact && (position_first || has_few_joints || lacks_the_wrist)) {
    return point(CompensationStatus::position_only, held, of_held);
  }
  if (at_limit) {
    return point(CompensationStatus::out_of_limits, u, deviation);
  }
  return point(other_branch ? CompensationStatus::branch_changed : CompensationStatus::unreachable, u, deviation);
}

CompensatedPoint Compensator::Parts::solve_near(const Isometry3d& X_BF, const JointVector& start,
                                                const JointVector& correction) const {
  CompensatedPoint point = solve(calibrated, X_BF, start, most_change);
  JointVector change(start.size());
  for (Index i = 0; i < change.size(); ++i) {
    change[i] = point.change[static_cast<Index>(leaders[static_cast<std::size_t>(i)])];
  }
  if (((change - correction).array().abs() <= most_step.array()).all()) {
    return point;
  }
  const JointVector before = start + correction;
  const Bounds widest = around(start, most_change);
  const Bounds bounds = {.lower = widest.within(before - most_step), .upper = widest.within(before + most_step)};
  const Task task{.arm = calibrated, .couplings = couplings, .X_BF = X_BF};
  JointVector u = bounds.within(before);
  Deviation deviation = task.at(u);
  descend(task, bounds, kPositionFirst, u, deviation);
  refine_position(task, bounds, u, deviation);
  return {.status = CompensationStatus::step_limited,
          .joint_values = task.all_values(u),
          .change = task.all_values(u) - task.all_values(start),
          .position_error = deviation.position(),
          .orientation_error = deviation.orientation()};
}

std::optional<JointVector> Compensator::Parts::nominal_values(const Isometry3d& X_BF, const JointVector& start) const {
  const Task task{.arm = nominal, .couplings = couplings, .X_BF = X_BF};
  JointVector u = start;
  Deviation deviation = task.at(u);
  descend(task, limits, 1.0, u, deviation);
  return deviation.is_exact() ? std::optional(u) : std::nullopt;
}

Compensator::Compensator(const Calibration& calibration, const CompensationOptions& options) {
  if (!calibration.trusted()) {
    const std::vector<Doubt>& doubts = calibration.doubts();
    refuse_input("the calibration is not to be trusted" + (doubts.empty() ? "" : ": " + doubts.front().message),
                 "a trusted one");
  }
  if (!(options.most_change > 0.0)) {
    refuse_input("the largest change of a joint is not above 0", "radians or metres");
  }
  if (!(options.most_step > 0.0)) {
    refuse_input("the largest step of a correction is not above 0", "radians or metres");
  }
  const PredictionBasis& basis = calibration.parts();
  if (basis.model.joints.size() > kMostJoints) {
    refuse_input("an arm of " + std::to_string(basis.model.joints.size()) + " moving joints",
                 "at most " + std::to_string(kMostJoints) + " for compensation");
  }
  parts_ = std::make_shared<const Parts>(basis, options);
}

CompensatedPoint Compensator::solve(const Eigen::Ref<const Eigen::VectorXd>& q_nominal) const {
  const JointVector u = parts_->independent(q_nominal);
  return parts_->solve(parts_->calibrated, parts_->asked_pose(u), u, parts_->most_change);
}

CompensatedPoint Compensator::solve(const Eigen::Ref<const Eigen::VectorXd>& q_nominal,
                                    const CompensatedPoint& previous) const {
  const JointVector u = parts_->independent(q_nominal);
  require_count("corrections of the point before", previous.change.size(), parts_->joints.size());
  require_finite("a correction of the point before", previous.change.allFinite());
  JointVector correction(u.size());
  for (Index i = 0; i < u.size(); ++i) {
    correction[i] = previous.change[static_cast<Index>(parts_->leaders[static_cast<std::size_t>(i)])];
  }
  return parts_->solve_near(parts_->asked_pose(u), u, correction);
}

CompensatedPoint Compensator::solve(const Isometry3d& X_BF, const Eigen::Ref<const Eigen::VectorXd>& seed) const {
  const JointVector u = parts_->independent(seed);
  const Isometry3d asked = rigid_pose(X_BF);
  const CompensatedPoint nominal = parts_->solve(parts_->nominal, asked, u, anywhere(u.size()));
  return parts_->solve(parts_->calibrated, asked, parts_->independent(nominal.joint_values), parts_->most_change);
}

// Where the search for a pose begins: in the middle of the limits, then at random.
Eigen::MatrixXd Compensator::Parts::starts() const {
  constexpr int kStarts = 32;
  const JointRanges ranges = limits_of(joints);
  Random random(1);
  Eigen::MatrixXd result = random_configurations(joints, ranges, kStarts, random);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    result(static_cast<Index>(i), 0) = std::midpoint(ranges[i].first, ranges[i].second);
  }
  follow(joints, result.leftCols<1>());
  return result;
}

CompensatedPoint Compensator::solve(const Isometry3d& X_BF) const {
  const Isometry3d asked = rigid_pose(X_BF);
  const Eigen::MatrixXd starts = parts_->starts();
  for (const auto& start : starts.colwise()) {
    if (const auto nominal = parts_->nominal_values(asked, parts_->independent(start))) {
      return parts_->solve(parts_->calibrated, asked, *nominal, parts_->most_change);
    }
  }
  return solve(asked, starts.col(0));
}

double Compensator::spread_of_ways(const Isometry3d& X_BF) const {
  const Isometry3d asked = rigid_pose(X_BF);
  std::vector<Eigen::Vector3d> commanded;
  double spread = 0.0;
  const Eigen::MatrixXd starts = parts_->starts();
  for (const auto& start : starts.colwise()) {
    if (const auto nominal = parts_->nominal_values(asked, parts_->independent(start))) {
      const CompensatedPoint point = parts_->solve(parts_->calibrated, asked, *nominal, parts_->most_change);
      if (point.status == CompensationStatus::exact) {
        commanded.emplace_back(parts_->nominal.flange_pose(point.joint_values).translation());
        for (const Eigen::Vector3d& other : commanded) {
          spread = std::max(spread, (other - commanded.back()).norm());
        }
      }
    }
  }
  return spread;
}

Isometry3d Compensator::nominal_pose(const Eigen::Ref<const Eigen::VectorXd>& q) const {
  require_joint_values(q, parts_->joints);
  return parts_->nominal.flange_pose(q);
}

std::optional<CompensatedJoints> Compensator::nominal_joint_values(
    const Isometry3d& X_BF, const Eigen::Ref<const Eigen::VectorXd>& seed) const {
  const JointVector u = parts_->independent(seed);
  const CompensatedPoint nominal = parts_->solve(parts_->nominal, rigid_pose(X_BF), u, anywhere(u.size()));
  return nominal.status == CompensationStatus::exact ? std::optional(nominal.joint_values) : std::nullopt;
}

Isometry3d Compensator::calibrated_pose(const Eigen::Ref<const Eigen::VectorXd>& q) const {
  require_joint_values(q, parts_->joints);
  return parts_->calibrated.flange_pose(q);
}

}  // namespace kdl_calibration
