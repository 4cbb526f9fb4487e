#pragma once

#include <Eigen/Core>
#include <map>
#include <utility>
#include <vector>

#include "selection/effect_candidates.hpp"

namespace kdl_calibration {

/// J^T J plus the groups' prior information, for rows of sigma 1. Columns of groups of size zero are left out.
struct SizedInformation {
  std::vector<Eigen::Index> columns;
  Eigen::MatrixXd matrix;
};
SizedInformation sized_information(const Eigen::MatrixXd& information, const Groups& groups, const GroupSizes& sizes);

/// Posterior uncertainty of a candidate's tables. A table is withheld where its 1 sigma exceeds 0.8 of the prior one:
/// the measurements tell too little about it there.
class TableCertainty {
public:
  /// Keeps references to `candidate` and to the root of `sizes`.
  TableCertainty(const Candidate& candidate, const Groups& groups, const GroupSizes& sizes);

  /// Sets the values of tables withheld at these joint values to zero. `values`: columns x configurations.
  void withhold(const Eigen::MatrixXd& joint_values, Eigen::MatrixXd& values) const;
  /// Ranges within the measured one in which the joint's table is withheld.
  std::vector<std::pair<double, double>> gaps(int joint) const;
  /// Writes these ranges into the tables among `terms`.
  void withhold_gaps(std::vector<EffectTerm>& terms) const;

private:
  struct Table {
    std::vector<std::size_t> terms;     // indices into the model's effects
    std::vector<Eigen::Index> columns;  // columns of these terms
    Eigen::Index first = 0;             // row of the root
    double sigma = 0.0;                 // prior 1 sigma
  };
  std::vector<bool> is_uncertain(const Table& table, const Eigen::VectorXd& joint_values) const;

  const Candidate& candidate_;
  const Eigen::MatrixXd& root_;
  std::map<int, Table> tables_;  // by joint
};

/// Whether the term belongs to a table that is withheld over its whole range.
bool is_withheld_throughout(const EffectTerm& term);

}  // namespace kdl_calibration
