#pragma once

// A model with more or fewer effects, linearised at the optimum of geometry alone.

#include <Eigen/Core>
#include <string>
#include <utility>
#include <vector>

#include "estimation/unknowns.hpp"
#include "kdl_calibration/measurements.hpp"
#include "selection/group_sizes.hpp"

namespace kdl_calibration {

/// The rows of the data as linear equations y = J x of errors and effects, linearised at the optimum. All effects on
/// one motion of a joint have its column of J, times their values at each configuration.
struct LinearRows {
  Eigen::MatrixXd motions;  ///< columns of J in their order, but one for each motion instead of those of the effects
  Eigen::MatrixXd effects;  ///< values of effects x configurations
  std::vector<Eigen::Index> motion_of;  ///< column of `motions` of each effect
  Eigen::Index first_effect = 0;        ///< first column of effects in J, and of their motions
  Eigen::Index moved = 0;               ///< number of motions by effects
  Eigen::VectorXd y;
  std::vector<Eigen::Index> first;  ///< first row of each configuration, then the number of rows
  double unit = 1.0;                ///< [m] per unit of residual

  Eigen::Index columns() const { return motions.cols() - moved + effects.rows(); }
  Eigen::Index configurations() const { return static_cast<Eigen::Index>(first.size()) - 1; }
  /// First row of a configuration, and their number.
  std::pair<Eigen::Index, Eigen::Index> range(Eigen::Index configuration) const;
  bool is_effect(Eigen::Index column) const { return column >= first_effect && column < first_effect + effects.rows(); }
  /// Column of `motions` that belongs to a column of J, and its factor at a configuration.
  Eigen::Index motion(Eigen::Index column) const;
  double value(Eigen::Index column, Eigen::Index configuration) const;
  /// The rows of a configuration of J x.
  Eigen::VectorXd product(Eigen::Index configuration, const Eigen::VectorXd& x) const;
  /// v - J x, and J^T v.
  Eigen::VectorXd residual(Eigen::VectorXd v, const Eigen::VectorXd& x) const;
  Eigen::VectorXd moments(const Eigen::VectorXd& v) const;
};

/// A model to be scored: the rigid parameters and some effect terms. The rows are linearised at zero effects, so the
/// solution is the effects themselves.
struct Candidate {
  ErrorModel model;
  Unknowns free;
  bool sized = false;  ///< whether priors of the geometry are sized by evidence
};
Candidate with_terms(const ErrorModel& rigid, const Unknowns& free, const std::vector<EffectTerm>& terms, bool sized);

LinearRows linear_rows(const Candidate& candidate, const Measurements& means, Estimate optimum,
                       double orientation_length);
/// The offsets of all joints, rotations about (or motions along) their own axes: one column per joint, in order.
Unknowns joint_offsets(const ErrorModel& model, const std::vector<TargetFrame>& targets);
/// The rows with joint offsets as columns.
LinearRows joint_rows(const ErrorModel& rigid, const Measurements& means, const Estimate& optimum,
                      double orientation_length);
LinearSums sums_of(const LinearRows& rows, const std::vector<Eigen::Index>& configurations);

bool is_of_table(const EffectTerm& term);

/// The groups of a candidate: lengths and angles if their sizes are estimated or stated, then the effects.
struct Groups {
  SizedGroups columns;
  std::vector<std::string> names;
  SizeLimits limits;
};
Groups groups_of(const Candidate& candidate, const Priors& stated);

}  // namespace kdl_calibration
