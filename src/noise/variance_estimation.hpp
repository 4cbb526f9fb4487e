#pragma once

#include <Eigen/Core>
#include <vector>

#include "noise/noise_strata.hpp"

namespace kdl_calibration {

/// Strata and the unknown parts of their variances.
struct VarianceTask {
  std::vector<Stratum> strata;
  Eigen::MatrixXd unknown;         ///< parts x unknowns; parts in one column share a variance
  NoiseParts::Variances stated;    ///< of the other parts
  Eigen::MatrixXd priors;          ///< their information
  Eigen::VectorXd prior_gradient;  ///< of the columns
  Eigen::MatrixXd further = {};    ///< strata x other unknown variances, which are no part and must be none for parts()
};

/// Estimates the parts' variances from the residual squares of the strata, about a weighted solution.
class VarianceEstimation {
public:
  explicit VarianceEstimation(VarianceTask task);

  Eigen::Index unknowns() const { return task_.unknown.cols() + task_.further.cols(); }

  /// Restricted maximum likelihood (Patterson and Thompson 1971). False if it does not converge, or if the residuals
  /// contradict the result.
  bool maximise();
  /// Parts for which the expected residual squares equal the actual ones, at the solution with weights from `weights`
  /// (minimum norm quadratic unbiased estimation, Rao 1971). If the residuals contradict them, the maximum likelihood
  /// parts. False if they contradict these as well.
  bool match(const NoiseParts::Variances& weights);

  /// -2 log of the restricted likelihood, up to a constant of the strata.
  double minus_two_log() const { return solution_.minus_two_log; }
  /// The other variances that were asked for.
  Eigen::VectorXd further() const { return x_.tail(task_.further.cols()); }
  /// Degrees of freedom of each stratum.
  const Eigen::VectorXd& freedom() const { return freedom_; }
  /// p-value of the means' residual squares under these variances.
  double tail_of_means() const;
  NoiseParts parts() const;

private:
  /// The solution for weights, one per stratum: covariance of the columns if the weights are right, and residual
  /// squares.
  struct Solution {
    Eigen::VectorXd weights;
    Eigen::MatrixXd covariance;
    Eigen::VectorXd squares;
    double minus_two_log = 0.0;  // restricted likelihood, up to a constant
  };
  /// Expected residual squares: by_variances. variances of the strata + by_priors.
  struct Expectation {
    Eigen::MatrixXd by_variances;
    Eigen::VectorXd by_priors;
  };

  bool start();
  Eigen::VectorXd variances(const Eigen::VectorXd& x) const;
  Solution solve(const Eigen::VectorXd& weights) const;
  Expectation expectation(const Solution& solution) const;
  Eigen::VectorXd fisher_scoring_step();
  bool go_towards(const Eigen::VectorXd& x);
  Eigen::VectorXd mm_step() const;
  bool agrees() const;
  double freedom_of_residuals() const;
  void finish();

  VarianceTask task_;
  Eigen::MatrixXd design_;   // strata x unknowns
  Eigen::VectorXd known_;    // variances of the strata
  Eigen::VectorXd floor_;    // lower bounds of the variances
  Eigen::VectorXd x_;        // unknowns
  Eigen::VectorXd lambda_;   // variances of the strata
  Eigen::VectorXd freedom_;  // of the strata
  Eigen::MatrixXd fisher_;   // of the unknowns
  Solution solution_;
  bool with_own_weights_ = true;
};

}  // namespace kdl_calibration
