#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <map>
#include <string>
#include <string_view>

#include "kdl_calibration/joint_convention.hpp"

namespace kdl_calibration {

/// User frames in the world frame and tool frames in the faceplate's, by number from 1.
struct NumberedFrames {
  std::map<int, Eigen::Isometry3d> user;
  std::map<int, Eigen::Isometry3d> tool;
};

/// How the controller of an arm counts joints, and where it has its frames.
struct Controller {
  JointConvention convention;
  Eigen::Isometry3d X_BW;                         ///< its world frame in the base frame; not the measuring device's
  Eigen::Isometry3d X_FP;                         ///< the faceplate in the flange frame
  NumberedFrames frames;                          ///< empty unless they are read as well
  std::map<int, std::string> external_axes = {};  ///< by number, the joints of the URDF that carry the arm
};

/// Reads such a description (JSON, see urdf/README.md) and the joint convention that it names. Throws InputError.
Controller read_controller(const std::filesystem::path& file);

/// Reads the frames of motion group 1 from SYSFRAME.VA of a FANUC controller's backup, or from a file that ends in
/// .json: {"user_frames": {"1": {"position": [...], "quaternion_wxyz": [...]}}, "tool_frames": {...}}, metres. Frames
/// that are not set are left out. Throws InputError.
NumberedFrames read_numbered_frames(const std::filesystem::path& file);
NumberedFrames parse_system_frames(std::string_view text, const std::string& source);

/// X Y Z [m] and W P R [rad] as a frame: the rotation is Rz(R) Ry(P) Rx(W).
Eigen::Isometry3d frame_of_xyzwpr(const Eigen::Matrix<double, 6, 1>& xyzwpr);

/// The reverse. Among equivalent angles those nearest to W P R of `old`; near P = +-90 degrees its R is kept.
Eigen::Matrix<double, 6, 1> xyzwpr_of(const Eigen::Isometry3d& frame, const Eigen::Matrix<double, 6, 1>& old);

}  // namespace kdl_calibration
