#pragma once

// Positions of the KUKA Robot Language: {X 10,Y 20,Z 30,A 0,B 90,C 0,S 2,T 35} and {A1 0,A2 -90,...}.

#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "programs/krl_text.hpp"
#include "programs/program.hpp"

namespace kdl_calibration::krl {

/// What an aggregate states of a position.
struct Position {
  bool is_joints = false;           ///< A1 to A6, else X Y Z A B C
  std::vector<NumberField> fields;  ///< of the components that are there, in this order
  bool is_computed = false;         ///< a component is an expression
  std::optional<int> status;        ///< S
  std::optional<NumberField> turn;  ///< T
  std::vector<ExternalValue> external;

  /// All six components are numbers.
  bool is_complete() const { return fields.size() == 6 && !is_computed; }
};

/// The position that an aggregate states; none where it has members of other kinds, or none of a position. Throws
/// InputError for a component that is there twice, and for a number out of range; where `is_typed`, for other members
/// too.
std::optional<Position> position_in(const Aggregate& aggregate, const Place& place, const std::string& name,
                                    bool is_typed);

/// S and T of a pose. None where the text states neither.
///
/// S, bit 0: the wrist is behind axis 1. Bit 1: axis 3 stands at or above the angle at which the arm is stretched. Bit
/// 2: axis 5 stands below zero. T, bit n - 1: axis n stands below zero. KUKA System Software, Operating and Programming
/// Instructions for System Integrators, "Status" and "Turn".
std::optional<ArmBranch> branch_of(const Position& position);

/// Whether an absolutely accurate robot taught the position: bit 4 of S.
bool is_of_accurate_robot(const Position& position);

/// T of these joint values [rad].
int turn_of(const SixJoints& joint_values);

/// A complete pose as a frame: the rotation is Rz(A) Ry(B) Rx(C).
Eigen::Isometry3d frame_of(const Position& position);

}  // namespace kdl_calibration::krl
