#pragma once

// Not installed.

#include <Eigen/Core>
#include <vector>

#include "selection/effect_candidates.hpp"

namespace kdl_calibration {

/// What a model leaves of the rows, and what a small motion of each joint about its own axis would add to them.
struct RippleData {
  const ErrorModel& model;              ///< rigid
  const Eigen::MatrixXd& joint_values;  ///< joints x configurations
  const LinearRows& rows;               ///< of the model with all its columns
  const LinearRows& joints;             ///< of the same configurations, one column a joint
  Eigen::MatrixXd information;          ///< J^T J and what priors add, of the columns that take part
  std::vector<Eigen::Index> columns;    ///< those
  Eigen::VectorXd values;               ///< of all columns of `rows`
};

/// Sine and cosine of the frequencies at which revolute joints swing, the most certain first, at most a few.
/// Frequencies from 2 to 400 a turn are tried on a grid of half a swing over the joint's range, but none above half the
/// rate of a lattice that the joint's values lie on. What is found is taken off before the next one is looked for.
///
/// The sums of (motion x residual) of each configuration are one sample of two values, as whatever a configuration's
/// rows have in common then counts once: Hotelling's T^2 against zero, p < 0.001 after all that were tried.
std::vector<EffectTerm> find_ripple(RippleData data, int threads);

}  // namespace kdl_calibration
