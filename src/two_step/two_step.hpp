#pragma once

// The published two-step procedure.
//
//     const Identification found = identify_in_two_steps(model, [&](int) { return measurements; }, start, geometric);

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <functional>
#include <vector>

#include "estimation/identification.hpp"

namespace kdl_calibration {

/// Result of one round of the two-step procedure.
struct TwoStepRound {
  int number = 1;
  double change = 0.0;  ///< [m] RMS motion of the predicted points by the step of the geometric errors
  double misfit = 0.0;  ///< [m] 3D RMS over the round's points before that step, base and tools fitted to them
};

struct TwoStepOptions {
  int rounds = 10;
  double step_tolerance = 1e-11;  ///< [m] as for the joint estimator
  /// Called after every round with its estimate.
  std::function<void(const TwoStepRound&, const Estimate&)> after_round = {};
};

/// The rows that a point of tool j adds to the matrix A of the published linear least squares problem for base and
/// tools, y - p = A [p_base; phi_base; u_1; …; u_m] in the base frame: [I [~p]^T 0 … R … 0] (3 x 6 + 3 m), with R and p
/// the orientation and position of the flange pose `T_robot`. Three tools make the 9 x 15 matrix of the publication.
Eigen::Matrix3Xd base_and_tool_rows(const Eigen::Isometry3d& T_robot, Eigen::Index tool, Eigen::Index tools);

/// Factor of linear convergence: the geometric mean of the ratios of successive changes. The first change (far from
/// linear) and changes below `least_change` are skipped; 0 if fewer than three remain.
double convergence_factor(const std::vector<double>& changes, double least_change = 1e-12);

/// The published two-step procedure (see src/README.md): in every round base and targets by linear least squares with
/// the geometry held, then the geometric errors with base and targets held. `measurements_of_round` gives fresh
/// configurations or the same recorded ones; it is called with 0, 1, …
Identification identify_in_two_steps(const ErrorModel& model,
                                     const std::function<Measurements(int)>& measurements_of_round,
                                     const Estimate& start, const std::vector<std::size_t>& geometric,
                                     const TwoStepOptions& options = {});

}  // namespace kdl_calibration
