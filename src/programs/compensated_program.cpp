#include "programs/compensated_program.hpp"

#include <fmt/core.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include "base/degree.hpp"
#include "base/parallel.hpp"
#include "base/text.hpp"
#include "interface/compensated_line.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/ls_program.hpp"
#include "programs/wrist_arm.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;

constexpr double kOneMillimetre = 1e-3;  // [m]
constexpr std::size_t kFifth = 4;
constexpr std::array<Index, 3> kTurning = {0, 3, 5};  // the joints of RobotConfiguration::turns

// Joint values of the URDF from those of a controller that names its joints J1 to J6.
class ControllerJoints {
public:
  ControllerJoints(const Robot& robot, const JointConvention& convention)
      : convention_(matched_convention(convention, joint_names(robot))) {
    for (Index i = 0; i < 6; ++i) {
      const std::string name = fmt::format("J{}", i + 1);
      const auto& names = convention_.controller_joints;
      const auto found = std::find(names.begin(), names.end(), name);
      if (found == names.end() || names.size() != 6) {
        throw InputError(convention.name + ": names other joints, expected J1 to J6 of the controller");
      }
      place_[static_cast<std::size_t>(i)] = found - names.begin();
    }
    inverse_ = convention_.matrix.inverse();
  }

  SixJoints urdf(const SixJoints& values) const {
    SixJoints placed;
    for (std::size_t i = 0; i < place_.size(); ++i) {
      placed[place_[i]] = values[static_cast<Index>(i)];
    }
    return convention_.matrix * placed + convention_.offset;
  }

  SixJoints controller(const SixJoints& q) const {
    const SixJoints placed = inverse_ * (q - convention_.offset);
    SixJoints values;
    for (std::size_t i = 0; i < place_.size(); ++i) {
      values[static_cast<Index>(i)] = placed[place_[i]];
    }
    return values;
  }

private:
  JointConvention convention_;
  std::array<Index, 6> place_{};
  Eigen::Matrix<double, 6, 6> inverse_;
};

[[noreturn]] void refuse(const std::string& source, const ProgramPosition& position, const std::string& what) {
  throw InputError(fmt::format("{}:{}: P[{}]: {}", source, position.line, position.number, what));
}

// The joints of the chain before the six of the arm: rails and turntables, which are external axes of the controller.
class Carrier {
public:
  Carrier(const Robot& robot, const std::map<int, std::string>& axes) {
    std::vector<std::string> names = joint_names(robot);
    names.resize(names.size() - std::min<std::size_t>(names.size(), 6));
    for (std::size_t i = 0; i < names.size(); ++i) {
      const auto axis =
          std::find_if(axes.begin(), axes.end(), [&](const auto& each) { return each.second == names[i]; });
      if (axis != axes.end()) {
        joints_.push_back({.axis = axis->first, .joint = robot.joints[i]});
      }
    }
    if (joints_.size() != names.size() || axes.size() != names.size()) {
      throw InputError(robot.source + ": the joints before the six of the arm are " +
                       (names.empty() ? "none" : comma_separated(names)) +
                       ", expected --external-axis E1=JOINT for each of them and no other joint");
    }
  }

  /// The arm that stands on them.
  Robot arm(Robot robot) const {
    robot.joints.erase(robot.joints.begin(), robot.joints.begin() + static_cast<std::ptrdiff_t>(joints_.size()));
    return robot;
  }

  bool has(int axis) const {
    return std::any_of(joints_.begin(), joints_.end(), [&](const Joint& each) { return each.axis == axis; });
  }

  /// Their values [m or rad] at the position, before those of the arm.
  CompensatedJoints with(const ProgramPosition& position, const SixJoints& arm, const std::string& source) const {
    CompensatedJoints q(static_cast<Index>(joints_.size()) + arm.size());
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      const Joint& each = joints_[i];
      const bool slides = each.joint.type == JointType::prismatic;
      const auto found = std::find_if(position.external.begin(), position.external.end(),
                                      [&](const ExternalValue& external) { return external.axis == each.axis; });
      if (found == position.external.end() || found->is_length != slides) {
        refuse(source, position,
               fmt::format("has no E{} in {}, expected that of joint {}", each.axis, slides ? "mm" : "deg",
                           shown(each.joint.name)));
      }
      q[static_cast<Index>(i)] = found->value * (slides ? kOneMillimetre : kDegree);
    }
    q.tail<6>() = arm;
    return q;
  }

  /// X_BC: where the arm stands.
  Isometry3d pose(const CompensatedJoints& q) const {
    Isometry3d X_BC = Isometry3d::Identity();
    for (std::size_t i = 0; i < joints_.size(); ++i) {
      const MovingJoint& joint = joints_[i].joint;
      const Eigen::Vector3d axis = to_eigen(joint.axis);
      const double value = q[static_cast<Index>(i)];
      X_BC = X_BC * to_eigen(joint.origin);
      if (joint.type == JointType::prismatic) {
        X_BC = X_BC * Eigen::Translation3d(value * axis);
      } else {
        X_BC = X_BC * Eigen::AngleAxisd(value, axis);
      }
    }
    return X_BC;
  }

private:
  struct Joint {
    int axis = 0;
    MovingJoint joint;
  };
  std::vector<Joint> joints_;
};

SixJoints numbers_of(const ProgramPosition& position) {
  SixJoints numbers;
  for (std::size_t i = 0; i < position.fields.size(); ++i) {
    const bool is_length = position.configuration && i < 3;
    numbers[static_cast<Index>(i)] = position.fields[i].value * (is_length ? kOneMillimetre : kDegree);
  }
  return numbers;
}

// The same in the program's units with its three decimals, angles of a pose from -180 to 180 degrees.
void set_numbers(ProgramPosition& position, const SixJoints& numbers) {
  constexpr double kLast = 1e-3;
  constexpr double kTurn = 360.0;
  for (std::size_t i = 0; i < position.fields.size(); ++i) {
    const bool is_length = position.configuration && i < 3;
    const double value = numbers[static_cast<Index>(i)] / (is_length ? kOneMillimetre : kDegree);
    double rounded = std::round(value / kLast) * kLast;
    if (position.configuration && !is_length && std::abs(rounded) > kTurn / 2.0 + kLast / 2.0) {
      rounded = std::remainder(rounded, kTurn);
    }
    position.fields[i].value = rounded;
  }
}

// One program for one robot.
class ProgramCompensation {
public:
  ProgramCompensation(const Robot& robot, const Compensator& compensator, const Controller& controller,
                      std::string source)
      : compensator_(compensator),
        controller_(controller),
        source_(std::move(source)),
        carrier_(robot, controller.external_axes),
        joints_(carrier_.arm(robot), controller.convention),
        arm_(carrier_.arm(robot), joints_.urdf(SixJoints::Zero())) {}

  struct Outcome {
    CompensatedPosition position;
    const ProgramPosition* commanded = nullptr;
    CompensatedJoints asked;  // nominal joint values of the URDF
    CompensatedJoints q;      // those commanded
    double rounding = 0.0;    // [m]
  };

  /// Sets the numbers of the position.
  Outcome compensate(ProgramPosition& position) const {
    const SixJoints numbers = numbers_of(position);
    Outcome result;
    result.position.number = position.number;
    result.commanded = &position;
    const CompensatedPoint point = position.configuration ? solve_pose(position, numbers, result.asked)
                                                          : solve_joints(position, numbers, result.asked);
    result.position.status = point.status;
    result.q = point.joint_values;
    result.position.written =
        point.status == CompensationStatus::exact || point.status == CompensationStatus::position_only;
    if (result.position.written && position.configuration &&
        configuration_of(result.q.tail<6>()) != *position.configuration) {
      result.position.status = CompensationStatus::branch_changed;
      result.position.written = false;
    }
    if (!result.position.written) {
      result.q = result.asked;
      result.position.change.setZero();
      return result;
    }
    const SixJoints commanded = joints_.controller(result.q.tail<6>());
    result.position.change = commanded - joints_.controller(result.asked.tail<6>());
    result.position.position_error = point.position_error;
    result.position.orientation_error = point.orientation_error;
    set_numbers(position, position.configuration ? pose_numbers(position, numbers, result.q) : commanded);
    result.rounding =
        (flange(position, numbers_of(position)).translation() - compensator_.nominal_pose(result.q).translation())
            .norm();
    return result;
  }

  // [m] of the tool from the asked straight line between two positions.
  double deviation(const Outcome& from, const Outcome& to) const {
    const Isometry3d X_FT = controller_.X_FP * tool_frame(*to.commanded).value_or(Isometry3d::Identity());
    const auto end = [&](const Outcome& outcome) {
      return LineEnd{.X_BT = compensator_.nominal_pose(outcome.asked) * X_FT, .joint_values = outcome.q};
    };
    return line_deviation(compensator_, X_FT, end(from), end(to));
  }

private:
  [[noreturn]] void fail(const ProgramPosition& position, const std::string& what) const {
    refuse(source_, position, what);
  }

  // Frame 0 is the world, or the faceplate.
  static std::optional<Isometry3d> frame(const std::map<int, Isometry3d>& frames, std::optional<int> number) {
    if (number == 0) {
      return Isometry3d::Identity();
    }
    const auto found = number ? frames.find(*number) : frames.end();
    return found == frames.end() ? std::nullopt : std::optional(found->second);
  }

  std::optional<Isometry3d> tool_frame(const ProgramPosition& position) const {
    return frame(controller_.frames.tool, position.tool_frame);
  }

  Isometry3d required_frame(const ProgramPosition& position, bool is_tool) const {
    const std::optional<int> number = is_tool ? position.tool_frame : position.user_frame;
    const std::optional<Isometry3d> found = frame(is_tool ? controller_.frames.tool : controller_.frames.user, number);
    if (!found) {
      const char* name = is_tool ? "UT" : "UF";
      fail(position, number ? fmt::format("{} {} is not known, expected it in --frames", name, *number)
                            : fmt::format("{} has no number, expected the frame of the pose", name));
    }
    return *found;
  }

  CompensatedJoints all_joints(const ProgramPosition& position, const SixJoints& arm) const {
    return carrier_.with(position, arm, source_);
  }

  // X_BF of the position's numbers.
  Isometry3d flange(const ProgramPosition& position, const SixJoints& numbers) const {
    if (!position.configuration) {
      return compensator_.nominal_pose(all_joints(position, joints_.urdf(numbers)));
    }
    return controller_.X_BW * required_frame(position, false) * frame_of_xyzwpr(numbers) *
           (controller_.X_FP * required_frame(position, true)).inverse();
  }

  SixJoints pose_numbers(const ProgramPosition& position, const SixJoints& old, const CompensatedJoints& q) const {
    return xyzwpr_of((controller_.X_BW * required_frame(position, false)).inverse() * compensator_.nominal_pose(q) *
                         controller_.X_FP * required_frame(position, true),
                     old);
  }

  RobotConfiguration configuration_of(const SixJoints& q) const {
    const ArmPosture posture = arm_.posture(q);
    const SixJoints values = joints_.controller(q);
    RobotConfiguration result{.flip = std::remainder(values[kFifth], 2.0 * std::numbers::pi) > 0.0,
                              .elbow_up = posture.elbow_up,
                              .front = posture.front};
    for (std::size_t i = 0; i < kTurning.size(); ++i) {
      result.turns[i] = static_cast<int>(std::ceil(values[kTurning[i]] / (2.0 * std::numbers::pi) - 0.5));
    }
    return result;
  }

  CompensatedPoint solve_joints(const ProgramPosition& position, const SixJoints& numbers,
                                CompensatedJoints& asked) const {
    asked = all_joints(position, joints_.urdf(numbers));
    return compensator_.solve(asked);
  }

  CompensatedPoint solve_pose(const ProgramPosition& position, const SixJoints& numbers,
                              CompensatedJoints& asked) const {
    for (const ExternalValue& external : position.external) {
      if (!carrier_.has(external.axis)) {
        fail(position,
             fmt::format("is a pose with an external axis E{0}, expected --external-axis E{0}=JOINT of a URDF "
                         "with that joint, or joint values J1 to J6",
                         external.axis));
      }
    }
    const Isometry3d X_BF = flange(position, numbers);
    const CompensatedJoints start = all_joints(position, SixJoints::Zero());
    const WristArm::Solutions solutions = arm_.solve(carrier_.pose(start).inverse() * X_BF);
    const RobotConfiguration& wanted = *position.configuration;
    std::optional<SixJoints> found;
    for (const SixJoints& solution : solutions.joint_values) {
      SixJoints values = joints_.controller(solution);
      const RobotConfiguration first = configuration_of(solution);
      for (std::size_t i = 0; i < kTurning.size(); ++i) {
        values[kTurning[i]] += 2.0 * std::numbers::pi * (wanted.turns[i] - first.turns[i]);
      }
      const SixJoints candidate = joints_.urdf(values);
      if (configuration_of(candidate) == wanted) {
        constexpr double kSame = 1e-6;
        if (found && (candidate - *found).norm() > kSame) {
          fail(position, "is reached by several joint values with this CONFIG, expected joint values");
        }
        found = candidate;
      }
    }
    if (!found) {
      fail(position, solutions.singular
                         ? "stands in a singularity, where many joint values reach it, expected joint values"
                         : "no joint values reach it with this CONFIG, expected a pose within reach");
    }
    asked = all_joints(position, *found);
    return compensator_.solve(X_BF, asked);
  }

  const Compensator& compensator_;
  const Controller& controller_;
  std::string source_;
  Carrier carrier_;
  ControllerJoints joints_;
  WristArm arm_;
};

std::vector<PathDeviation> path_deviations(const ProgramCompensation& compensation, const LsProgram& program,
                                           const std::vector<ProgramCompensation::Outcome>& outcomes) {
  constexpr double kNoticeable = 1e-4;  // [m]
  std::map<int, const ProgramCompensation::Outcome*> by_number;
  for (const ProgramCompensation::Outcome& outcome : outcomes) {
    by_number[outcome.position.number] = &outcome;
  }
  struct Segment {
    std::size_t line;
    const ProgramCompensation::Outcome* from;
    const ProgramCompensation::Outcome* to;
  };
  std::vector<Segment> segments;
  const ProgramCompensation::Outcome* last = nullptr;
  for (const ProgramMotion& motion : program.motions) {
    const auto found = motion.position && motion.is_known ? by_number.find(*motion.position) : by_number.end();
    const ProgramCompensation::Outcome* next = found == by_number.end() ? nullptr : found->second;
    if (motion.is_straight && last != nullptr && next != nullptr) {
      segments.push_back({.line = motion.line, .from = last, .to = next});
    }
    last = next;
  }
  std::vector<PathDeviation> deviations(segments.size());
  parallel_for(segments.size(), 0, [&](std::size_t i) {
    const Segment& segment = segments[i];
    deviations[i] = {.line = segment.line,
                     .from = segment.from->position.number,
                     .to = segment.to->position.number,
                     .deviation = compensation.deviation(*segment.from, *segment.to)};
  });
  std::erase_if(deviations, [](const PathDeviation& path) { return !(path.deviation > kNoticeable); });
  std::stable_sort(deviations.begin(), deviations.end(),
                   [](const PathDeviation& a, const PathDeviation& b) { return a.deviation > b.deviation; });
  return deviations;
}

// A position that a motion with INC uses is no place, but an increment: it stays as it is.
void leave_out_increments(LsProgram& program) {
  std::set<int> increments;
  for (const ProgramMotion& motion : program.motions) {
    if (motion.is_increment) {
      increments.insert(motion.position.value_or(0));
    }
  }
  std::erase_if(program.positions,
                [&](const ProgramPosition& position) { return increments.contains(position.number); });
}

// "IN.LS:3: Offset moves ... (also in lines 5, 8 and 12 more)"
std::string warning_of(const ProgramRemark& remark, const std::string& source) {
  constexpr std::size_t kMostLines = 10;
  std::string others;
  for (std::size_t i = 1; i < std::min(kMostLines, remark.lines.size()); ++i) {
    others += (i == 1 ? "" : ", ") + std::to_string(remark.lines[i]);
  }
  if (remark.lines.size() > kMostLines) {
    others += fmt::format(" and {} more", remark.lines.size() - kMostLines);
  }
  return fmt::format(
      "{}:{}: {}{}", source, remark.lines.front(), remark.what,
      others.empty() ? "" : (remark.lines.size() == 2 ? " (also in line " : " (also in lines ") + others + ")");
}

}  // namespace

CompensatedProgram compensated_program(const Robot& robot, const Compensator& compensator, const Controller& controller,
                                       std::string_view text, const std::string& source) {
  LsProgram program = parse_ls_program(text, source);
  leave_out_increments(program);
  const ProgramCompensation compensation(robot, compensator, controller, source);
  std::vector<ProgramCompensation::Outcome> outcomes(program.positions.size());
  constexpr std::size_t kBlock = 64;
  parallel_blocks(outcomes.size(), kBlock, 0, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      outcomes[i] = compensation.compensate(program.positions[i]);
    }
  });
  CompensatedProgram result;
  std::vector<NumberField> fields;
  fields.reserve(6 * outcomes.size());
  for (const ProgramCompensation::Outcome& outcome : outcomes) {
    result.positions.push_back(outcome.position);
    result.rounding = std::max(result.rounding, outcome.rounding);
    if (outcome.position.written) {
      fields.insert(fields.end(), outcome.commanded->fields.begin(), outcome.commanded->fields.end());
    }
  }
  std::sort(fields.begin(), fields.end(), [](const NumberField& a, const NumberField& b) { return a.begin < b.begin; });
  result.text = with_numbers(text, fields);
  result.paths = path_deviations(compensation, program, outcomes);
  std::stable_sort(program.remarks.begin(), program.remarks.end(),
                   [](const ProgramRemark& a, const ProgramRemark& b) { return a.lines.front() < b.lines.front(); });
  for (const ProgramRemark& remark : program.remarks) {
    result.warnings.push_back(warning_of(remark, source));
  }
  return result;
}

}  // namespace kdl_calibration
