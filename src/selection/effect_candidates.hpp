#pragma once

// A model with more or fewer effects, linearised at the optimum of geometry alone. Not installed.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "estimation/unknowns.hpp"
#include "kdl_calibration/measurements.hpp"
#include "selection/group_sizes.hpp"

namespace kdl_calibration {

/// The rows of the data as linear equations y = J x of errors and effects, linearised at the optimum.
struct LinearRows {
  Eigen::MatrixXd J;
  Eigen::VectorXd y;
  std::vector<Eigen::Index> first;  ///< first row of each configuration, then the number of rows
  double unit = 1.0;                ///< [m] per unit of residual
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
