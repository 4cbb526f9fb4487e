#pragma once

// Zero offsets that were entered on the controller.

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// What the controller's display grew by at an arm that did not move.
struct EnteredOffset {
  std::string joint;   ///< the controller's name
  double added = 0.0;  ///< [rad], or [m] for a joint that slides
  bool is_length = false;
};

/// A result of calibrate, turned into that of the robot after the entry.
struct MasteredResult {
  std::string json;  ///< with `mastering_entered`: the hash of the earlier text and what was entered
  std::vector<std::string> warnings = {};  ///< of entries that put a zero further off than it was
  double moved = 0.0;  ///< [m] RMS by which predictions of the same arm differ: loads are taken at the new joint values
};

/// With M the convention's matrix and e what was entered, the URDF's joint values grow by E = M e, so that the offsets
/// become dq - E. Functions of single joint values (gain, harmonics, ripple, tables, coupling) and the measured region
/// are moved by E as well. `asked` points are left out, as they were predicted at the old joint values. Throws
/// InputError for a result that is not valid, not of this robot or not trusted.
MasteredResult mastered_result(std::string_view result, const std::string& source, const Robot& robot,
                               const JointConvention& convention, const std::vector<EnteredOffset>& entered);

}  // namespace kdl_calibration
