#pragma once

// The fast pass: configurations that are alike, several side by side (see chain_kernel.hpp). Not installed.

#include <cstddef>
#include <vector>

#include "estimation/chain_kernel.hpp"
#include "estimation/observed_data.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/linear_system.hpp"

namespace kdl_calibration {

/// A part of a group's configurations.
struct LaneStrand {
  ChainKernelInput input;
  ChainKernelSums sums;
};

/// What the pass needs to remember, for one caller.
struct LaneWorkspace {
  FoldedChain chain;
  std::vector<ParameterTwist> twists;  // of base and geometric columns
  std::vector<std::size_t> order;      // columns of the kernel's columns, those that turn first, then of its terms
  ChainKernelInput input;
  ChainKernelSums sums;
  std::vector<LaneStrand> strands;  // of large groups
};

/// Whether summarise() takes a group: not where configurations have roots of their own or orientations.
bool has_summary(const LaneGroup& group);

class LanePass {
public:
  /// Keeps references to all of them.
  LanePass(const ErrorModel& model, const Unknowns& unknowns, const std::vector<LaneGroup>& groups, int threads);

  /// Adds what all groups tell, both triangles of the chain's part and the upper one that chain and targets share.
  void add(const Estimate& estimate, LaneWorkspace& workspace, NormalEquations& equations) const;
  /// sum e^T W e.
  double cost(const Estimate& estimate, LaneWorkspace& workspace) const;
  /// Adds all but the triangle and the priors.
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
  std::vector<ParameterTwist> twists_;  // those of the base, and room for the geometric ones
  std::vector<std::size_t> terms_;      // as terms_in_lanes()
  std::vector<ChainMotion> motions_;
  std::vector<std::size_t> term_columns_;  // of the terms that have columns, in their order
  int threads_;
};

}  // namespace kdl_calibration
