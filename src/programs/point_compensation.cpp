#include "programs/point_compensation.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;

constexpr std::size_t kFifth = 4;
constexpr double kTurn = 2.0 * std::numbers::pi;

bool is_length(const ProgramPoint& point, std::size_t field) {
  return point.notation != PointNotation::joints && field < 3;
}

bool is_angle_of_pose(const ProgramPoint& point, std::size_t field) {
  return field >= 3 && (point.notation == PointNotation::fixed_xyz || point.notation == PointNotation::moving_zyx);
}

bool is_within(const MovingJoint& joint, double value) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  return value >= joint.lower.value_or(-kInfinite) && value <= joint.upper.value_or(kInfinite);
}

// The full turns that bring the value into the interval, preferably within the joint's limits. Where several do, the
// fewest into an interval without end, else those that need no tolerance.
template <typename Allowed>
std::optional<int> turns_into(const JointInterval& interval, double value, double tolerance, const Allowed& allowed) {
  const bool is_endless = !std::isfinite(interval.lower) || !std::isfinite(interval.upper);
  const double nearest = is_endless ? 0.0 : std::round((interval.lower - value) / kTurn);
  std::optional<int> best;
  std::array<int, 3> best_rank{};
  for (int i = -2; i <= 2; ++i) {
    const int turns = static_cast<int>(nearest) + i;
    const double turned = value + turns * kTurn;
    if (!interval.contains(turned, tolerance)) {
      continue;
    }
    const int tolerated = interval.contains(turned) ? 0 : 1;
    const std::array<int, 3> rank = {allowed(turned) ? 0 : 1, is_endless ? std::abs(turns) : tolerated,
                                     is_endless ? tolerated : std::abs(turns)};
    if (!best || rank < best_rank) {
      best = turns;
      best_rank = rank;
    }
  }
  return best;
}

bool is_positive(const SixJoints& values) { return std::remainder(values[kFifth], kTurn) > 0.0; }

}  // namespace

PointCompensation::PointCompensation(const ProgramSetup& setup, const Program& program,
                                     const std::vector<ProgramText>& texts)
    : compensator_(setup.compensator),
      controller_(setup.controller),
      language_(setup.language),
      frames_(program.frames),
      texts_(texts),
      check_(setup.check),
      carrier_(setup.robot, setup.controller.external_axes),
      robot_(carrier_.arm(setup.robot)),
      joints_(robot_, setup.controller.convention ? &*setup.controller.convention : nullptr, setup.language),
      ways_(robot_) {
  if (std::any_of(program.points.begin(), program.points.end(),
                  [](const ProgramPoint& point) { return point.branch.has_value(); })) {
    arm_.emplace(robot_, joints_.urdf(SixJoints(language_.reference.data())));
  }
}

bool PointCompensation::follows_previous(const ProgramPoint& point) {
  return point.notation != PointNotation::joints && !point.branch && !point.near;
}

CompensatedPosition PointCompensation::compensate(ProgramPoint& point, const Approach& approach) const {
  if (check_) {
    check_();
  }
  const PointNumbers numbers = numbers_in(point);
  CompensatedPosition position{.name = point.name, .line = point.line, .point = {}, .change = SixJoints::Zero()};
  const CompensatedPoint found = solve(point, numbers, approach, position.other_way);
  position.point = {.status = found.status,
                    .joint_values = found.joint_values,
                    .change = found.change,
                    .position_error = found.position_error,
                    .orientation_error = found.orientation_error};
  CommandedPoint& solved = position.point;
  const CompensatedJoints nominal = position.asked();
  const SixJoints commanded = joints_.controller(solved.joint_values.tail<6>());
  position.written = solved.status == CompensationStatus::exact || solved.status == CompensationStatus::position_only;
  if (position.written && point.branch &&
      !(stays_in_branch(nominal, solved.joint_values) && states_turns(point, commanded))) {
    solved.status = CompensationStatus::branch_changed;
    position.written = false;
  }
  if (!position.written) {
    solved.joint_values = nominal;
    solved.change.setZero(nominal.size());
    const Isometry3d X_AR =  // where the arm is that goes to the point as it stands, from where it is asked to be
        compensator_.nominal_pose(nominal).inverse() * compensator_.calibrated_pose(nominal);
    solved.position_error = X_AR.translation().norm();
    solved.orientation_error = Eigen::AngleAxisd(X_AR.linear()).angle();
    return position;
  }
  position.change = commanded - joints_.controller(nominal.tail<6>());
  const Eigen::Vector3d flange_at = compensator_.nominal_pose(solved.joint_values).translation();
  position.displacement = (flange_at - compensator_.nominal_pose(nominal).translation()).norm();
  set_numbers(point, point.notation == PointNotation::joints ? PointNumbers(commanded)
                                                             : commanded_numbers(point, numbers, solved.joint_values));
  position.rounding = (flange(point, numbers_in(point)).translation() - flange_at).norm();
  return position;
}

LineDeviation PointCompensation::deviation(const CompensatedPosition& from, const CompensatedPosition& to,
                                           const ProgramPoint& end) const {
  const Isometry3d X_FT = controller_.X_FP * tool_frame(end).value_or(Isometry3d::Identity());
  const auto line_end = [&](const CompensatedPosition& position) {
    return LineEnd{.X_BT = compensator_.nominal_pose(position.asked()) * X_FT,
                   .joint_values = position.point.joint_values};
  };
  return line_deviation(compensator_, X_FT, line_end(from), line_end(to));
}

std::string PointCompensation::where(const ProgramPoint& point) const {
  return fmt::format("{}:{}: {}: ", texts_[point.file].source, point.line, point.name);
}

void PointCompensation::fail(const ProgramPoint& point, const std::string& what) const {
  throw InputError(where(point) + what);
}

// ---- Frames and numbers --------------------------------------------------------------------------------------------

std::optional<Isometry3d> PointCompensation::tool_frame(const ProgramPoint& point) const {
  for (const auto* frames : {&frames_.tool, &controller_.frames.tool}) {
    if (const auto found = point.tool_frame ? frames->find(*point.tool_frame) : frames->end(); found != frames->end()) {
      return found->second;
    }
  }
  return std::nullopt;
}

Isometry3d PointCompensation::required_frame(const ProgramPoint& point, bool is_tool) const {
  const std::optional<std::string>& key = is_tool ? point.tool_frame : point.user_frame;
  const std::string_view word = is_tool ? language_.tool_frame : language_.user_frame;
  if (!key) {
    fail(point, fmt::format("{} is not stated, expected the frame of the pose", word));
  }
  for (const ProgramFrames* frames : {&frames_, &controller_.frames}) {
    const std::map<std::string, Isometry3d>& named = is_tool ? frames->tool : frames->user;
    if (const auto found = named.find(*key); found != named.end()) {
      return found->second;
    }
  }
  fail(point, fmt::format("{} {} is not known, expected it in --frames", word, *key));
}

CompensatedJoints PointCompensation::all_joints(const ProgramPoint& point, const SixJoints& arm) const {
  return carrier_.with(point, arm, where(point));
}

// X_BF of the point's numbers.
Isometry3d PointCompensation::flange(const ProgramPoint& point, const PointNumbers& numbers) const {
  if (point.notation == PointNotation::joints) {
    return compensator_.nominal_pose(all_joints(point, joints_.urdf(numbers)));
  }
  return controller_.X_BW * required_frame(point, false) * pose_of(point.notation, numbers) *
         (controller_.X_FP * required_frame(point, true)).inverse();
}

PointNumbers PointCompensation::commanded_numbers(const ProgramPoint& point, const PointNumbers& old,
                                                  const CompensatedJoints& q) const {
  return numbers_of(point.notation,
                    (controller_.X_BW * required_frame(point, false)).inverse() * compensator_.nominal_pose(q) *
                        controller_.X_FP * required_frame(point, true),
                    old);
}

PointNumbers PointCompensation::numbers_in(const ProgramPoint& point) const {
  PointNumbers numbers(static_cast<Index>(point.fields.size()));
  for (std::size_t i = 0; i < point.fields.size(); ++i) {
    numbers[static_cast<Index>(i)] = point.fields[i].value * unit(point, i);
  }
  return numbers;
}

double PointCompensation::unit(const ProgramPoint& point, std::size_t field) const {
  if (is_length(point, field)) {
    return language_.length_unit;
  }
  return point.notation == PointNotation::quaternion ? 1.0 : language_.angle_unit;
}

// In the program's units with the decimals of the text; angles of a pose from -180 to 180 degrees.
void PointCompensation::set_numbers(ProgramPoint& point, const PointNumbers& numbers) const {
  for (std::size_t i = 0; i < point.fields.size(); ++i) {
    const double last = std::pow(10.0, -point.fields[i].decimals);
    const double turn = kTurn / language_.angle_unit;
    double rounded = std::round(numbers[static_cast<Index>(i)] / unit(point, i) / last) * last;
    if (is_angle_of_pose(point, i) && std::abs(rounded) > turn / 2.0 + last / 2.0) {
      rounded = std::remainder(rounded, turn);
    }
    point.fields[i].value = rounded;
  }
}

// ---- Joint values --------------------------------------------------------------------------------------------------

CompensatedPoint PointCompensation::solve(const ProgramPoint& point, const PointNumbers& numbers,
                                          const Approach& approach, double& other_way) const {
  if (point.notation == PointNotation::joints) {
    return compensator_.solve(all_joints(point, joints_.urdf(numbers)));
  }
  for (const ExternalValue& external : point.external) {
    if (!carrier_.has(external.axis)) {
      fail(point, fmt::format("is a pose with an external axis E{0}, expected --external-axis E{0}=JOINT of a URDF "
                              "with that joint, or E{0}=none if it does not carry the arm",
                              external.axis));
    }
  }
  const Isometry3d X_BF = flange(point, numbers);
  if (point.branch) {
    const CompensatedJoints start = all_joints(point, SixJoints::Zero());
    return compensator_.solve(X_BF, all_joints(point, solution(point, carrier_.pose(start).inverse() * X_BF)));
  }
  if (point.near) {
    return solve_near(point, X_BF, {.previous = all_joints(point, joints_.urdf(*point.near))}, other_way);
  }
  if (approach.previous.size() == 0) {
    fail(point,
         "is a pose whose joint values depend on the point before, expected a point with joint values before "
         "it, or --near");
  }
  return solve_near(point, X_BF, approach, other_way);
}

// Whether these are the nominal joint values for the pose.
bool PointCompensation::is_reached(const Isometry3d& X_BF, const CompensatedJoints& nominal) const {
  constexpr double kReached = 1e-6;
  return compensator_.nominal_pose(nominal).isApprox(X_BF, kReached);
}

// A joint motion ends in the joint values next to those before; along a path the arm keeps its configuration.
CompensatedPoint PointCompensation::solve_near(const ProgramPoint& point, const Isometry3d& X_BF,
                                               const Approach& approach, double& other_way) const {
  const Isometry3d X_CF = carrier_.pose(all_joints(point, SixJoints::Zero())).inverse() * X_BF;
  const SixJoints near = approach.previous.tail<6>();
  CompensatedPoint found;
  const std::vector<SixJoints> ways = ways_.all(X_CF, near);
  if (!approach.is_straight && !ways.empty()) {
    found = compensator_.solve(X_BF, all_joints(point, ways.front()));
  }
  if (found.joint_values.size() == 0 || !is_reached(X_BF, found.joint_values - found.change)) {
    found = followed(point, X_BF, approach.previous);
  }
  const SixJoints taken = (found.joint_values - found.change).tail<6>();
  std::vector<CompensatedJoints> others;
  for (const SixJoints& q : other_ways(ways, near, taken, approach.is_straight ? 1.0 : kAboutAsNear)) {
    others.push_back(all_joints(point, q));
  }
  other_way = spread_of_commands(compensator_, X_BF, found, others);
  return found;
}

// Follows the solution from pose to pose on the way, so that it stays in the branch of `near`.
CompensatedPoint PointCompensation::followed(const ProgramPoint& point, const Isometry3d& X_BF,
                                             const CompensatedJoints& near) const {
  constexpr int kSteps = 8;
  const Isometry3d from = compensator_.nominal_pose(near);
  const Eigen::Quaterniond start(from.linear());
  const Eigen::Quaterniond end(X_BF.linear());
  CompensatedJoints asked = all_joints(point, near.tail<6>());
  CompensatedPoint found;
  for (int i = 1; i <= kSteps; ++i) {
    const double share = static_cast<double>(i) / kSteps;
    Isometry3d pose = X_BF;
    if (i < kSteps) {
      pose.linear() = start.slerp(share, end).toRotationMatrix();
      pose.translation() = from.translation() + share * (X_BF.translation() - from.translation());
    }
    found = compensator_.solve(pose, asked);
    CompensatedJoints nominal = found.joint_values - found.change;
    if (i == kSteps && !is_reached(pose, nominal)) {
      found = compensator_.solve(pose, near);  // the way there may leave the arm's reach
      nominal = found.joint_values - found.change;
    }
    if (is_reached(pose, nominal)) {
      asked = nominal;
    } else if (i == kSteps) {
      fail(point,
           "no joint values reach it from those that are stated before it or beside it, expected a pose within reach");
    }
  }
  return found;
}

// Of the solutions for the flange in the frame of the arm's first link, the one that the branch means.
SixJoints PointCompensation::solution(const ProgramPoint& point, const Isometry3d& X_CF) const {
  const ArmSolutions solutions = arm_->solve(X_CF);
  std::optional<SixJoints> found;
  for (const SixJoints& each : solutions.joint_values) {
    const std::optional<SixJoints> candidate = turned(*point.branch, each);
    constexpr double kSame = 1e-6;
    if (candidate && found && (*candidate - *found).norm() > kSame) {
      fail(point, "is reached by several joint values with this configuration, expected joint values");
    }
    found = candidate ? candidate : found;
  }
  if (!found) {
    fail(point, solutions.singular ? "stands in a singularity, where many joint values reach it, expected joint values"
                                   : "no joint values reach it with this configuration, expected a pose within reach");
  }
  return *found;
}

// The solution with the turns of the branch; none if it is of another branch. Text rounds: a joint that a program has
// at the bound of an interval may lie beyond it.
std::optional<SixJoints> PointCompensation::turned(const ArmBranch& branch, const SixJoints& q) const {
  constexpr double kRounding = 2e-4;  // [rad]
  const ArmPosture posture = arm_->posture(q);
  SixJoints values = joints_.controller(q);
  if (branch.front.value_or(posture.front) != posture.front ||
      branch.elbow_up.value_or(posture.elbow_up) != posture.elbow_up ||
      branch.wrist_positive.value_or(is_positive(values)) != is_positive(values)) {
    return std::nullopt;
  }
  for (std::size_t i = 0; i < branch.turns.size(); ++i) {
    // Where no turn is stated, the one within the limits is meant.
    constexpr double kInfinite = std::numeric_limits<double>::infinity();
    const JointInterval any{.lower = -kInfinite, .upper = kInfinite};
    double& value = values[static_cast<Index>(i)];
    const std::optional<int> turns = turns_into(branch.turns[i].value_or(any), value, kRounding, [&](double turned) {
      SixJoints others = values;
      others[static_cast<Index>(i)] = turned;
      return is_within(robot_.joints[i], joints_.urdf(others)[static_cast<Index>(i)]);
    });
    if (!turns) {
      return std::nullopt;
    }
    value += *turns * kTurn;
  }
  return joints_.urdf(values);
}

// Shoulder, elbow and wrist on the same sides.
bool PointCompensation::stays_in_branch(const CompensatedJoints& asked, const CompensatedJoints& commanded) const {
  const SixJoints a = asked.tail<6>();
  const SixJoints b = commanded.tail<6>();
  return arm_->posture(a) == arm_->posture(b) &&
         is_positive(joints_.controller(a)) == is_positive(joints_.controller(b));
}

// Whether the point states the turns of these values of the controller's joints. Writes them where it has numbers that
// follow the values.
bool PointCompensation::states_turns(ProgramPoint& point, const SixJoints& commanded) const {
  constexpr double kNoise = 2e-6;  // [rad] below what the digits of a pose tell
  bool same = true;
  for (std::size_t i = 0; i < point.branch->turns.size(); ++i) {
    const std::optional<JointInterval>& interval = point.branch->turns[i];
    same = same && (!interval || interval->contains(commanded[static_cast<Index>(i)], kNoise));
  }
  if (same || point.turn_fields.empty()) {
    return same;
  }
  const std::vector<int> turns = language_.turns(commanded);
  for (std::size_t i = 0; i < turns.size(); ++i) {
    point.turn_fields[i].value = turns[i];
  }
  return true;
}

}  // namespace kdl_calibration
