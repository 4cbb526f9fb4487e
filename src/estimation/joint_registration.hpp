#pragma once

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <vector>

#include "estimation/linear_system.hpp"
#include "estimation/registration.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// The fit of all bases and targets to training rows of any reading. Columns: six of each base, then six of each target
/// (a base as in UnknownGroup::base, a target as in UnknownGroup::targets); those of known frames stay zero. Keeps
/// references to its arguments.
class JointRegistration {
public:
  JointRegistration(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& training,
                    const RegistrationOptions& options);

  static constexpr int kToTheEnd = 100;

  /// At most this many Levenberg-Marquardt steps. Returns the cost.
  double fit(Frames& frames, int steps = kToTheEnd) const;
  /// Moves base positions and targets to the least cost. Directions that no row determines stay.
  void place(Frames& frames) const;
  /// Number of directions of the unknown frames that the rows do not determine.
  int count_undetermined_directions(const Frames& frames) const;

private:
  void add(const Eigen::Vector3d& residual, const Eigen::Matrix<double, 3, 12>& jacobian, double weight,
           const std::array<Eigen::Index, 2>& first, NormalEquations& equations) const;
  NormalEquations linearise(const Frames& frames) const;
  Frames moved(const Frames& frames, const Eigen::VectorXd& step) const;

  const std::vector<Eigen::Isometry3d>& X_BF_;
  const Measurements& training_;
  const RegistrationOptions& options_;
  std::vector<bool> is_known_;  // stations, then targets
  std::size_t bases_ = 0;
};

/// The registration of one station by that fit; `rms` is not set. With the rotation of the base held, its position and
/// the targets follow by linear least squares. A few steps are made from each rotation of the cube, and those from the
/// best one are continued. Distances give a start by themselves.
Registration register_readings(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& training,
                               const RegistrationOptions& options);

}  // namespace kdl_calibration
