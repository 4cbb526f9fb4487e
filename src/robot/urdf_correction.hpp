#pragma once

#include <array>
#include <kdl/frames.hpp>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration {

/// Roll, pitch and yaw of the rotation; of equivalent angles the nearest to `old`. Ignores old angles of many turns,
/// whose last digit is no small angle. Accurate near pitch +-90 degrees, where only yaw is ill determined: roll and
/// pitch come from the rest after removing yaw. With a cosine of pitch below `locked` yaw stays as in `old`.
std::array<double, 3> rpy_of(const KDL::Rotation& rotation, const std::array<double, 3>& old = {},
                             double locked = 4.0 * std::numeric_limits<double>::epsilon());

/// Correction of one URDF joint: its new origin is (old origin) * correction.
struct OriginCorrection {
  std::string joint;
  KDL::Frame correction;  ///< metres, radians; in the joint's own frame at zero
};

/// The new origin of one URDF joint.
struct NewOrigin {
  std::string joint;
  std::array<double, 3> xyz;  ///< [m]
  std::array<double, 3> rpy;  ///< [rad]
};

/// Rewrites the origins of the named joints in the original URDF text and leaves every other byte alone: comments,
/// order, white space, quotes, line ends and unknown tags stay. Numbers are written with the fewest digits that read
/// back to the same double. Components that a correction does not change keep their text; a correction that is the
/// identity to the last bit changes nothing. A missing <origin>, xyz or rpy is added if its value is not zero.
/// Among equivalent roll, pitch and yaw angles the nearest to the old ones are used.
/// Throws InputError for malformed XML, a joint that does not exist or exists twice, two corrections of one joint, an
/// origin that is not three numbers, a corrected origin that is not finite.
std::string corrected_urdf(std::string_view urdf, const std::vector<OriginCorrection>& corrections);
/// The same with these numbers as they are.
std::string urdf_with_origins(std::string_view urdf, const std::vector<NewOrigin>& origins);

}  // namespace kdl_calibration
