#pragma once

#include <array>
#include <kdl/frames.hpp>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// An arm with an ortho-parallel basis and a spherical wrist (M. Brandstoetter, A. Angerer, M. Hofbaur, 2014). With
/// t_i = signs[i] q_i - offsets[i] the tip in the base is
///   base · Tz(c1) Rz(t1) T(a1, b, 0) Ry(t2) Tz(c2) Ry(t3) T(a2, 0, c3) Rz(t4) Ry(t5) Rz(t6) Tz(c4) · tip.
/// Base and tip are the identity where the frames of the robot are those of the publication.
struct OpwParameters {
  double a1 = 0.0;  ///< [m] as are all lengths
  double a2 = 0.0;
  double b = 0.0;
  double c1 = 0.0;
  double c2 = 0.0;
  double c3 = 0.0;
  double c4 = 0.0;
  std::array<double, 6> offsets{};  ///< [rad]
  std::array<int, 6> signs{};       ///< 1 or -1
  KDL::Frame base;
  KDL::Frame tip;
};

/// Throws InputError for an arm of another build, or one whose tip is farther than rounding from where its parameters
/// put it.
OpwParameters opw_parameters_of(const Robot& robot);

/// The tip in the base.
KDL::Frame opw_pose(const OpwParameters& parameters, const std::vector<double>& q);

}  // namespace kdl_calibration
