#pragma once

// The exchange algorithm for designs: DETMAX (Mitchell 1974), see select_configurations().

#include <Eigen/Core>
#include <vector>

#include "planning/candidate_pool.hpp"
#include "planning/pose_selection.hpp"

namespace kdl_calibration {

struct DesignProblem {
  const CandidatePool& pool;
  Eigen::MatrixXd given;         ///< prior information, in the pool's basis; regular
  const Tasks* tasks = nullptr;  ///< needed for G and I
};

struct ExchangedDesign {
  std::vector<Eigen::Index> members;
  double value = 0.0;  ///< minimised: -log det M, or the largest or mean variance of a target
  long exchanges = 0;  ///< number of configurations exchanged
};

/// Improves the design `members` by excursions among the first `candidates` of the pool until none helps.
ExchangedDesign exchanged_design(const DesignProblem& problem, Eigen::Index candidates, const SelectionOptions& options,
                                 const std::vector<Eigen::Index>& members);

}  // namespace kdl_calibration
