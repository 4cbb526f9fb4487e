#pragma once

#include <Eigen/Core>
#include <vector>

namespace kdl_calibration {

/// Sums of the linear equations y = J x + noise, each row of the same unknown 1 sigma.
struct LinearSums {
  Eigen::MatrixXd information;  ///< J^T J
  Eigen::VectorXd moment;       ///< J^T y
  double squares = 0.0;         ///< y^T y
  double equations = 0.0;

  LinearSums& operator-=(const LinearSums& other);
};

/// Of which columns are drawn from a normal distribution around zero with a common 1 sigma. A column is in one group at
/// most; the others may be anything.
using SizedGroups = std::vector<std::vector<Eigen::Index>>;

struct GroupSizes {
  std::vector<double> sizes;  ///< 1 sigma of each group; 0 where it is switched off
  double sigma = 0.0;         ///< of a row
  double evidence = 0.0;      ///< log of the likelihood of sizes and sigma, but for a constant of the free columns
  Eigen::VectorXd values;     ///< of the columns; zero in groups that are switched off
};

/// Of each group; empty: nothing is known.
struct SizeLimits {
  std::vector<double> held;    ///< the size where it is stated, else 0
  std::vector<double> most;    ///< no size is above that
  std::vector<bool> inflated;  ///< whether it shall be two standard errors above the likeliest
};

/// Sizes and noise that make the rows most likely when the values themselves are integrated out (type-II likelihood:
/// MacKay 1992, Tipping 2001). With M = A / sigma^2 + diag(1 / s_g^2), C = M^-1 and gamma_g = n_g - tr(C_gg) / s_g^2,
/// the number of values of group g that the rows tell,
///   s_g^2 <- |x_g|^2 / gamma_g,  sigma^2 <- |y - J x|^2 / (N - sum gamma - number of free columns),
/// until the evidence does. The free columns are eliminated beforehand, as they see neither. A group whose size goes to
/// zero is switched off. The standard error of log s_g is 1 / sqrt(2 gamma_g): of few values the likeliest size can be
/// far too small, which costs more than one far too large where the rows tell the values well. Nothing where the free
/// columns are not determined or no equation is left for the noise.
class SizeEstimator {
public:
  /// `columns`: those of the sums that take part, those of the groups included.
  SizeEstimator(const LinearSums& sums, const std::vector<Eigen::Index>& columns, const SizedGroups& groups);

  bool is_determined() const { return determined_; }
  /// `start`: sizes of similar data, near which these are, or empty. `rounding`: sigma is not estimated below that.
  GroupSizes estimate(const std::vector<double>& start, const SizeLimits& limits, double rounding) const;

private:
  struct Fit {
    Eigen::VectorXd x;      // of the sized columns
    Eigen::VectorXd gamma;  // of each group
    double squares = 0.0;   // of what is left
    double log_determinant = 0.0;
    double penalty = 0.0;  // sum |x_g|^2 / s_g^2
  };
  Fit solve(const std::vector<double>& variances, double variance) const;
  Eigen::VectorXd all_values(const Eigen::VectorXd& sized) const;

  Eigen::Index size_ = 0;  // of the sums
  std::vector<Eigen::Index> free_;
  std::vector<Eigen::Index> sized_;
  std::vector<std::vector<Eigen::Index>> groups_;  // places among sized_
  bool determined_ = true;
  double equations_ = 0.0;
  // Without the free columns.
  Eigen::MatrixXd information_;
  Eigen::VectorXd moment_;
  double squares_ = 0.0;
  // x_free = offset_ - slope_ x_sized
  Eigen::VectorXd offset_;
  Eigen::MatrixXd slope_;
};

}  // namespace kdl_calibration
