#pragma once

#include <cstddef>
#include <optional>
#include <string_view>

namespace kdl_calibration::rapid {

/// What the kind of a motion instruction says of its arguments: those before the targets, the targets, others, the
/// tool, and those behind it.
struct MotionKind {
  std::size_t before = 0;
  std::size_t targets = 1;
  std::size_t behind = 0;
  bool is_straight = false;
  bool has_joints = false;  ///< the target is a jointtarget
  bool moves_arm = true;    ///< else external axes only
  bool stops_on_signal = false;
};

/// None for a name, in lower case, that is no motion instruction of RAPID or of its options.
std::optional<MotionKind> motion_kind(std::string_view name);

}  // namespace kdl_calibration::rapid
