#pragma once

// The exchange algorithm for designs: DETMAX (Mitchell 1974), see select_configurations(). Not installed.

#include <Eigen/Core>
#include <vector>

#include "kdl_calibration/pose_selection.hpp"
#include "planning/candidate_pool.hpp"

namespace kdl_calibration {

struct DesignProblem {
  const CandidatePool& pool;
  Eigen::MatrixXd given;         ///< information beforehand, in the pool's basis; regular
  const Tasks* tasks = nullptr;  ///< for G and I
};

struct ExchangedDesign {
  std::vector<Eigen::Index> members;
  double value = 0.0;  ///< made small: -log det M, or the largest or mean variance of a target
  long exchanges = 0;  ///< of one configuration for another
};

/// The design `members` after all excursions that improve it, among the first `candidates` of the pool.
ExchangedDesign exchanged_design(const DesignProblem& problem, Eigen::Index candidates, const SelectionOptions& options,
                                 const std::vector<Eigen::Index>& members);

}  // namespace kdl_calibration
