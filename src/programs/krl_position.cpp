#include "programs/krl_position.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "base/degree.hpp"
#include "base/text.hpp"
#include "programs/number_fields.hpp"
#include "programs/pose_numbers.hpp"

namespace kdl_calibration::krl {
namespace {

constexpr std::array<std::string_view, 6> kPose = {"X", "Y", "Z", "A", "B", "C"};
constexpr std::array<std::string_view, 6> kAxes = {"A1", "A2", "A3", "A4", "A5", "A6"};
constexpr int kBehind = 1;
constexpr int kElbow = 2;
constexpr int kWristNegative = 4;
constexpr int kAccurate = 16;
constexpr int kMostStatus = 63;
constexpr int kMostTurn = 63;

// 1 to 6 of E1 to E6; 0: another member.
int external_axis(std::string_view name) {
  return name.size() == 2 && (name.front() == 'E' || name.front() == 'e') && name.back() >= '1' && name.back() <= '6'
             ? name.back() - '0'
             : 0;
}

std::size_t index_of(std::string_view name, const std::array<std::string_view, 6>& names) {
  return static_cast<std::size_t>(
      std::find_if(names.begin(), names.end(), [&](std::string_view each) { return is_word(name, each); }) -
      names.begin());
}

// Reads one aggregate.
class PositionReader {
public:
  PositionReader(const Place& place, const std::string& name, bool is_typed)
      : place_(place), name_(name), is_typed_(is_typed) {}

  std::optional<Position> read(const Aggregate& aggregate) {
    for (const Member& member : aggregate.members) {
      if (!add(member)) {
        if (is_typed_) {
          fail("has " + shown(member.name) + ", expected X Y Z A B C S T or A1 to A6, and E1 to E6");
        }
        return std::nullopt;
      }
    }
    if (aggregate.members.empty() && !is_typed_) {
      return std::nullopt;
    }
    position_.is_joints = has_axes_;
    for (const std::optional<NumberField>& field : fields_) {
      if (field) {
        position_.fields.push_back(*field);
      }
    }
    return std::move(position_);
  }

private:
  [[noreturn]] void fail(const std::string& what) const { krl::fail(place_, name_ + ": " + what); }

  // False for a member that no position has.
  bool add(const Member& member) {
    if (const std::size_t pose = index_of(member.name, kPose); pose < kPose.size()) {
      has_pose_ = true;
      component(pose, member, pose < 3 ? kLeastOfLength : kLeastOfAngle);
    } else if (const std::size_t axis = index_of(member.name, kAxes); axis < kAxes.size()) {
      has_axes_ = true;
      component(axis, member, kLeastOfAngle);
    } else if (const int external = external_axis(member.name); external > 0) {
      add_external(external, member);
    } else if (is_word(member.name, "S")) {
      position_.status = whole(member, position_.status.has_value(), kMostStatus);
    } else if (is_word(member.name, "T")) {
      if (const std::optional<int> turn = whole(member, position_.turn.has_value(), kMostTurn)) {
        position_.turn = field_of(member.value, *turn, 0);
      }
    } else {
      return false;
    }
    return true;
  }

  void component(std::size_t index, const Member& member, int least_decimals) {
    if (has_pose_ && has_axes_) {
      fail("has components of a pose and of joint values, expected one of both");
    }
    if (fields_[index]) {
      fail("has " + std::string(member.name) + " twice");
    }
    const std::optional<double> value = number(member);
    fields_[index] = field_of(member.value, value.value_or(0.0), value ? decimals_of(member.value, least_decimals) : 0);
  }

  void add_external(int axis, const Member& member) {
    if (std::any_of(position_.external.begin(), position_.external.end(),
                    [&](const ExternalValue& each) { return each.axis == axis; })) {
      fail("has " + std::string(member.name) + " twice");
    }
    if (const std::optional<double> value = number(member)) {
      position_.external.push_back({.axis = axis, .value = *value, .is_length = {}});
    }
  }

  // None for an expression.
  std::optional<double> number(const Member& member) {
    const std::optional<double> value = number_in(member.value);
    constexpr double kMost = 1e9;
    const std::size_t begin = std::min(member.value.find_first_not_of("+-( \t"), member.value.size());
    const bool is_expression = !value && !word_at(member.value.substr(begin)).empty();
    if ((!value && !is_expression) || !(std::abs(value.value_or(0.0)) < kMost)) {
      fail(std::string(member.name) + " is " + shown(member.value) + ", expected a number");
    }
    position_.is_computed = position_.is_computed || is_expression;
    return value;
  }

  std::optional<int> whole(const Member& member, bool is_there, int most) {
    if (is_there) {
      fail("has " + std::string(member.name) + " twice");
    }
    const std::optional<int> value = whole_number_in(member.value);
    if (!value && !word_at(member.value).empty()) {
      position_.is_computed = true;
      return std::nullopt;
    }
    if (!value || *value < 0 || *value > most) {
      fail(fmt::format("{} is {}, expected 0 to {}", member.name, shown(member.value), most));
    }
    return value;
  }

  NumberField field_of(std::string_view bytes, double value, int decimals) const {
    const auto begin = static_cast<std::size_t>(bytes.data() - place_.text->text.data());
    return {.begin = begin, .end = begin + bytes.size(), .value = value, .decimals = decimals};
  }

  static constexpr int kLeastOfLength = 3;
  static constexpr int kLeastOfAngle = 4;

  const Place& place_;
  const std::string& name_;
  bool is_typed_;
  Position position_;
  std::array<std::optional<NumberField>, 6> fields_;
  bool has_pose_ = false;
  bool has_axes_ = false;
};

}  // namespace

std::optional<Position> position_in(const Aggregate& aggregate, const Place& place, const std::string& name,
                                    bool is_typed) {
  return PositionReader(place, name, is_typed).read(aggregate);
}

std::optional<ArmBranch> branch_of(const Position& position) {
  if (!position.status && !position.turn) {
    return std::nullopt;
  }
  ArmBranch branch;
  if (position.status) {
    branch.front = (*position.status & kBehind) == 0;
    branch.elbow_up = (*position.status & kElbow) != 0;
    branch.wrist_positive = (*position.status & kWristNegative) == 0;
  }
  if (position.turn) {
    constexpr double kInfinite = std::numeric_limits<double>::infinity();
    const auto turn = static_cast<unsigned>(position.turn->value);
    for (std::size_t i = 0; i < branch.turns.size(); ++i) {
      const bool is_negative = (turn >> i & 1U) != 0U;
      branch.turns[i] = is_negative ? JointInterval{.lower = -kInfinite, .upper = 0.0}
                                    : JointInterval{.lower = 0.0, .upper = kInfinite};
    }
  }
  return branch;
}

bool is_of_accurate_robot(const Position& position) { return (position.status.value_or(0) & kAccurate) != 0; }

int turn_of(const SixJoints& joint_values) {
  int turn = 0;
  for (Eigen::Index i = 0; i < joint_values.size(); ++i) {
    turn += joint_values[i] < 0.0 ? 1 << i : 0;
  }
  return turn;
}

Eigen::Isometry3d frame_of(const Position& position) {
  constexpr double kMillimetre = 1e-3;
  PointNumbers numbers(6);
  for (Eigen::Index i = 0; i < numbers.size(); ++i) {
    numbers[i] = position.fields[static_cast<std::size_t>(i)].value * (i < 3 ? kMillimetre : kDegree);
  }
  return pose_of(PointNotation::moving_zyx, numbers);
}

}  // namespace kdl_calibration::krl
