#pragma once

// Not installed.

#include <Eigen/Core>
#include <map>
#include <utility>
#include <vector>

#include "selection/effect_candidates.hpp"

namespace kdl_calibration {

/// J^T J plus the prior information of groups of these sizes, with rows of sigma 1. Columns of groups without size are
/// left out.
struct SizedInformation {
  std::vector<Eigen::Index> columns;
  Eigen::MatrixXd matrix;
};
SizedInformation sized_information(const Eigen::MatrixXd& information, const Groups& groups, const GroupSizes& sizes);

/// What measurements tell of the tables of a candidate. Where the 1 sigma of a table stays above 0.8 of what it was
/// beforehand, they tell so little that the table is better left out.
class TableCertainty {
public:
  /// `information`: J^T J. Keeps a reference to `candidate`.
  TableCertainty(const Candidate& candidate, const Eigen::MatrixXd& information, const Groups& groups,
                 const GroupSizes& sizes);

  /// Sets the columns of tables to zero that are better left out at these joint values.
  void withhold(const Eigen::VectorXd& joint_values, Eigen::VectorXd& columns) const;
  /// Ranges within the measured one in which the joint's table is better left out.
  std::vector<std::pair<double, double>> gaps(int joint) const;

private:
  struct Table {
    std::vector<std::size_t> terms;     // of the model
    std::vector<Eigen::Index> columns;  // of theirs
    Eigen::MatrixXd covariance;         // of those
    double sigma = 0.0;                 // beforehand
  };
  bool is_uncertain(const Table& table, double joint_value) const;

  const Candidate& candidate_;
  std::map<int, Table> tables_;  // by joint
};

}  // namespace kdl_calibration
