#pragma once

// Not installed.

#include <Eigen/Core>
#include <vector>

#include "noise/noise_strata.hpp"

namespace kdl_calibration {

/// What is known of strata, and which of the parts behind them are to be found.
struct VarianceTask {
  std::vector<Stratum> strata;
  Eigen::MatrixXd unknown;         ///< parts x unknowns; a column ties parts that are one
  NoiseParts::Variances stated;    ///< of the other parts
  Eigen::VectorXd priors;          ///< information of the columns
  Eigen::VectorXd prior_gradient;  ///< of the columns
};

/// The variances of the parts by the residual squares of the strata, about the solution that some weights have.
class VarianceEstimation {
public:
  explicit VarianceEstimation(VarianceTask task);

  Eigen::Index unknowns() const { return task_.unknown.cols(); }

  /// Restricted maximum likelihood (Patterson and Thompson 1971). False where it does not get there, or where the
  /// residuals contradict what it found.
  bool maximise();
  /// The parts that the residuals of the solution with the weights of these variances have by expectation (minimum norm
  /// quadratic unbiased estimation, Rao 1971, with those weights instead of the parts' own); the likeliest parts where
  /// the residuals contradict those. False where they contradict these as well.
  bool match(const NoiseParts::Variances& weights);

  /// How probable squares of the means as large as theirs, or larger, are of these variances.
  double tail_of_means() const;
  NoiseParts parts() const;

private:
  /// At weights, one for each stratum: the columns' covariance as the weights promise it, and what is left of the
  /// squares.
  struct Solution {
    Eigen::VectorXd weights;
    Eigen::MatrixXd covariance;
    Eigen::VectorXd squares;
    double minus_two_log = 0.0;  // of the restricted likelihood, up to a constant
  };
  /// Of these squares: by_variances . variances of the strata + by_priors.
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
  Eigen::VectorXd floor_;    // of these
  Eigen::VectorXd x_;        // unknowns
  Eigen::VectorXd lambda_;   // variances of the strata
  Eigen::VectorXd freedom_;  // of the strata
  Eigen::MatrixXd fisher_;   // of the unknowns
  Solution solution_;
  bool with_own_weights_ = true;
};

}  // namespace kdl_calibration
