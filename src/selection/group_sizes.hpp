#pragma once

#include <Eigen/Core>
#include <vector>

namespace kdl_calibration {

/// Sums of the linear equations y = J x + noise, all rows with the same unknown 1 sigma.
struct LinearSums {
  Eigen::MatrixXd information;  ///< J^T J
  Eigen::VectorXd moment;       ///< J^T y
  double squares = 0.0;         ///< y^T y
  double equations = 0.0;

  LinearSums& operator+=(const LinearSums& other);
  /// Becomes all - itself.
  void subtract_from(const LinearSums& all);
};

/// Groups of columns drawn from a zero-mean normal distribution with a common 1 sigma. A column is in one group at
/// most; columns in none have no prior.
using SizedGroups = std::vector<std::vector<Eigen::Index>>;

struct GroupSizes {
  std::vector<double> sizes;  ///< 1 sigma of each group; 0 if it is switched off
  double sigma = 0.0;         ///< of a row
  double evidence = 0.0;      ///< log likelihood of sizes and sigma, up to a constant of the free columns
  Eigen::VectorXd values;     ///< of the columns; zero in groups that are switched off
  /// L of the covariance S (L L^T)^-1 S of the groups' columns, one group after the other, with their sizes S.
  Eigen::MatrixXd root;
};

/// One value per group; empty: no limits.
struct SizeLimits {
  std::vector<double> held;    ///< the size if stated, else 0
  std::vector<double> most;    ///< upper bound of the size
  std::vector<bool> inflated;  ///< whether to use a size two standard errors above the likeliest
};

/// Sizes and noise that make the rows most likely when the values themselves are integrated out (type-II likelihood:
/// MacKay 1992, Tipping 2001). With M = A / sigma^2 + diag(1 / s_g^2), C = M^-1 and gamma_g = n_g - tr(C_gg) / s_g^2,
/// the number of values of group g that the rows determine,
///   s_g^2 <- |x_g|^2 / gamma_g,  sigma^2 <- |y - J x|^2 / (N - sum gamma - number of free columns),
/// until the evidence converges. The free columns depend on neither and are eliminated beforehand. A group whose size
/// goes to zero is switched off. The standard error of log s_g is 1 / sqrt(2 gamma_g): with few values the likeliest
/// size can be far too small. If the rows determine the values well, too small a size does more harm than too large a
/// one.
class SizeEstimator {
public:
  /// `columns`: indices of the columns used, those of the groups included.
  SizeEstimator(const LinearSums& sums, const std::vector<Eigen::Index>& columns, const SizedGroups& groups);

  bool is_determined() const { return determined_; }
  /// `start`: from similar data, or empty. `rounding`: lower bound of sigma.
  GroupSizes estimate(const GroupSizes& start, const SizeLimits& limits, double rounding) const;

private:
  struct Fit {
    Eigen::VectorXd x;     // of the sized columns
    Eigen::MatrixXd root;  // L of C^-1 = L L^T in units of the groups' sizes; entries above are not used
    double squares = 0.0;  // of the residuals
    double log_determinant = 0.0;
    double penalty = 0.0;  // sum |x_g|^2 / s_g^2
  };
  void solve(const std::vector<double>& variances, double variance, Fit& fit) const;
  // Of each group. Inverts the fit's root.
  Eigen::VectorXd gamma(Fit& fit) const;
  Eigen::VectorXd all_values(const Eigen::VectorXd& sized) const;

  Eigen::Index size_ = 0;  // columns of the sums
  std::vector<Eigen::Index> free_;
  std::vector<Eigen::Index> sized_;
  std::vector<std::vector<Eigen::Index>> groups_;  // indices into sized_
  bool determined_ = true;
  double equations_ = 0.0;
  // After elimination of the free columns. Of the information the lower triangle.
  Eigen::MatrixXd information_;
  Eigen::VectorXd moment_;
  double squares_ = 0.0;
  // x_free = offset_ - slope_ x_sized
  Eigen::VectorXd offset_;
  Eigen::MatrixXd slope_;
};

}  // namespace kdl_calibration
