#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace kdl_calibration {

/// Gauss-Newton equations of the whitened residuals e = measured - predicted at one estimate.
struct NormalEquations {
  Eigen::MatrixXd hessian;   ///< sum J^T W J
  Eigen::VectorXd gradient;  ///< sum J^T W e
  double cost = 0.0;         ///< sum e^T W e
};

/// What scales information to a unit diagonal, from both sides: one over the roots of its diagonal, 0 where there is
/// none.
Eigen::VectorXd unit_scale_of_information(const Eigen::Ref<const Eigen::MatrixXd>& information);

/// R of information = R^T R, upper triangular; nothing where the columns, scaled to unit norm, are so close to
/// depending on each other that a pivot is below 1e-3: figures made from R keep ten digits.
std::optional<Eigen::MatrixXd> well_conditioned_root(const Eigen::MatrixXd& information);

/// The same before the sum: J and e with W = L L^T multiplied in, J_w = L^T J.
struct WhitenedSystem {
  Eigen::MatrixXd jacobian;  ///< rows x columns; the priors' rows last
  Eigen::VectorXd residual;
  /// First row of each configuration that is fitted, in the order of the measurements, then the first row of the
  /// priors. The rows of a configuration are those of its points' positions, three each, then those of its
  /// orientations.
  std::vector<Eigen::Index> blocks;
};

/// What the uncertainty needs of a whitened system, of a size that the data do not change. With J_c and e_c the rows of
/// configuration c and s(.) the sum over its points (three rows):
struct WhitenedSummary {
  /// R of the Jacobian, the priors' rows included; the Jacobian where that has few rows.
  Eigen::MatrixXd sqrt_information;
  Eigen::Index rows = 0;           ///< of the Jacobian, the priors' rows included
  Eigen::Index measured_rows = 0;  ///< without the priors' rows
  Eigen::VectorXd priors;          ///< information that they add to each column
  Eigen::MatrixXd sums;            ///< sum s(J_c)^T s(J_c)
  double squares = 0.0;            ///< sum |e_c|^2
  double squares_of_sums = 0.0;    ///< sum |s(e_c)|^2
  double pairs = 0.0;              ///< pairs of coordinates of two points of one configuration
};
WhitenedSummary summarised(const WhitenedSystem& system);

/// Sums up rows that come configuration by configuration. Some hundred at a time are made a triangle, together with the
/// triangle of those before them, so that the memory is constant.
class RowSummary {
public:
  explicit RowSummary(Eigen::Index columns);

  void add_configuration(const Eigen::Ref<const Eigen::MatrixXd>& jacobian,
                         const Eigen::Ref<const Eigen::VectorXd>& residual);
  /// One row, a prior's.
  void add_prior(const Eigen::Ref<const Eigen::MatrixXd>& row);
  /// Of all rows. Nothing can be added afterwards.
  WhitenedSummary finish();

private:
  void append(const Eigen::Ref<const Eigen::MatrixXd>& rows);
  void make_triangle();

  Eigen::Index columns_;
  Eigen::MatrixXd rows_;
  Eigen::Index filled_ = 0;
  Eigen::MatrixXd sum_;
  WhitenedSummary summary_;
};

}  // namespace kdl_calibration
