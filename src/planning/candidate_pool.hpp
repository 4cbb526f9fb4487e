#pragma once

// Many configurations, packed for fast ranking of a design's neighbours.

#include <Eigen/Core>
#include <vector>

#include "planning/point_rows.hpp"

namespace kdl_calibration {

/// Single precision suffices for ranking in a basis of the parameters in which the information is well conditioned.
using RowMajorXf = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// The candidates. Keeps a reference to their joint values.
class CandidatePool {
public:
  /// Throws InputError if all candidates and `given` together do not determine the parameters.
  CandidatePool(const Experiment& experiment, const Eigen::MatrixXd& joint_values, const Eigen::MatrixXd& given,
                int threads);

  Eigen::Index size() const { return joint_values_.cols(); }
  const PointRows& rows() const { return rows_; }
  const RowMajorXf& features() const { return features_; }
  const Eigen::MatrixXd& mean_information() const { return mean_; }  ///< per candidate, in the basis

  /// Whitened rows A of candidate i in the basis.
  Eigen::MatrixXd block(Eigen::Index i) const { return rows_.whitened(joint_values_.col(i)); }

  /// tr(A C A^T) of the first `count` candidates, one column per C.
  Eigen::MatrixXf traces(const std::vector<Eigen::MatrixXd>& forms, Eigen::Index count, int threads) const;

private:
  PointRows rows_;
  const Eigen::MatrixXd& joint_values_;
  RowMajorXf features_;
  Eigen::MatrixXd mean_;
};

/// Task configurations, at which to predict. Keeps a reference to the rows; C and B are in their basis.
class Tasks {
public:
  /// `worst`: prepares worst() and power_mean(), which use the first 5,000 tasks.
  Tasks(const PointRows& rows, const Eigen::MatrixXd& joint_values, bool worst, int threads);

  /// B, so that tr(C B) is the mean variance of a target [m^2].
  const Eigen::MatrixXd& mean() const { return mean_; }
  /// The largest variance of a target for covariance C [m^2].
  double worst(const Eigen::MatrixXd& C) const { return variances(C).maxCoeff(); }
  /// (mean of v^power)^(1/power) of the variances v, and B whose tr(C B) has the same derivative.
  double power_mean(const Eigen::MatrixXd& C, double power, Eigen::MatrixXd& B) const;

private:
  Eigen::MatrixXd variances(const Eigen::MatrixXd& C) const;

  const PointRows& rows_;
  std::vector<RowMajorXf> packed_;  // one per target
  Eigen::MatrixXd mean_;
};

}  // namespace kdl_calibration
