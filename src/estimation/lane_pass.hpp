#pragma once

// The fast pass: several similar configurations in parallel (see chain_kernel.hpp).

#include <cstddef>
#include <vector>

#include "estimation/chain_kernel.hpp"
#include "estimation/linear_system.hpp"
#include "estimation/observed_data.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

/// A part of a group's configurations, summed by one thread.
struct LaneStrand {
  ChainKernelInput input;
  ChainKernelSums sums;
};

/// Buffers of the pass, for one caller.
struct LaneWorkspace {
  FoldedChain chain;
  std::vector<ParameterTwist> twists;  // of base and geometric columns
  std::vector<std::size_t> order;      // unknowns' columns in the kernel's order: turning ones first, then the terms'
  ChainKernelInput input;
  ChainKernelSums sums;
  std::vector<LaneStrand> strands;  // parts of large groups
};

/// Whether summarise() supports the group: without own roots and orientations.
bool has_summary(const LaneGroup& group);

class LanePass {
public:
  /// Keeps references to its arguments.
  LanePass(const ErrorModel& model, const Unknowns& unknowns, const std::vector<LaneGroup>& groups, int threads);

  /// Adds all groups: both triangles of the chain's block, and the upper block of chain and targets.
  void add(const Estimate& estimate, LaneWorkspace& workspace, NormalEquations& equations) const;
  /// sum e^T W e.
  double cost(const Estimate& estimate, LaneWorkspace& workspace) const;
  /// Adds all members except the square-root information and the priors.
  void summarise(const Estimate& estimate, LaneWorkspace& workspace, WhitenedSummary& summary) const;

private:
  void prepare(const Estimate& estimate, LaneWorkspace& workspace) const;
  void set_motions(const Estimate& estimate, LaneWorkspace& workspace) const;
  double sum(const LaneGroup& group, const Estimate& estimate, bool cost_only, LaneWorkspace& workspace) const;
  template <class Visitor>
  void visit_targets(const LaneGroup& group, std::size_t k, Visitor visitor) const;
  void add_group(const LaneGroup& group, double weight, const LaneWorkspace& workspace,
                 NormalEquations& equations) const;
  void add_targets(const LaneGroup& group, const LaneWorkspace& workspace, NormalEquations& equations) const;
  void add_targets_of_rows(const LaneGroup& group, const LaneWorkspace& workspace, NormalEquations& equations) const;
  void add_orientations(const LaneGroup& group, const LaneWorkspace& workspace, NormalEquations& equations) const;
  void add_sums(const LaneGroup& group, const Estimate& estimate, LaneWorkspace& workspace,
                WhitenedSummary& summary) const;
  void add_sums_of_points(const LaneGroup& group, const Estimate& estimate, LaneWorkspace& workspace,
                          NormalEquations& own, WhitenedSummary& summary) const;

  void sum_strands(bool cost_only, LaneWorkspace& workspace) const;
  void add_gram(double weight, const LaneWorkspace& workspace, Eigen::MatrixXd& hessian) const;

  const ErrorModel& model_;
  const Unknowns& unknowns_;
  const std::vector<LaneGroup>& groups_;
  ChainFolder folder_;
  std::vector<ParameterTwist> twists_;  // of the base, then space for the geometric ones
  std::vector<std::size_t> terms_;      // as terms_in_lanes()
  std::vector<ChainMotion> motions_;
  std::vector<std::size_t> term_columns_;  // columns of the free terms, in their order
  int threads_;
};

}  // namespace kdl_calibration
