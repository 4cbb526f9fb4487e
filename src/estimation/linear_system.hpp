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

/// Factors that scale information to a unit diagonal, from both sides: 1 / sqrt(diagonal), 0 for a zero on the
/// diagonal.
Eigen::VectorXd unit_scale_of_information(const Eigen::Ref<const Eigen::MatrixXd>& information);

/// R of information = R^T R, upper triangular. Empty if a pivot of the scaled information is below 1e-3, so that
/// results computed from R keep ten digits.
std::optional<Eigen::MatrixXd> well_conditioned_root(const Eigen::MatrixXd& information);

/// The whitened rows themselves: with W = L L^T, J_w = L^T J and e_w = L^T e.
struct WhitenedSystem {
  Eigen::MatrixXd jacobian;  ///< rows x columns; the priors' rows last
  Eigen::VectorXd residual;
  /// First row of each fitted configuration, in the order of the measurements, then of the priors. A configuration has
  /// three rows for each point's position, then those of its orientations.
  std::vector<Eigen::Index> blocks;
};

/// Summary of a whitened system for the uncertainty; its size does not depend on the data. J_c and e_c are the rows of
/// configuration c, s(.) is the sum over its points (three rows).
struct WhitenedSummary {
  /// R of the Jacobian, priors included; the Jacobian itself if it has few rows.
  Eigen::MatrixXd sqrt_information;
  Eigen::Index rows = 0;           ///< of the Jacobian, priors included
  Eigen::Index measured_rows = 0;  ///< without the priors' rows
  Eigen::MatrixXd priors;          ///< information of the priors
  Eigen::MatrixXd sums;            ///< sum s(J_c)^T s(J_c)
  double squares = 0.0;            ///< sum |e_c|^2
  double squares_of_sums = 0.0;    ///< sum |s(e_c)|^2
  double pairs = 0.0;              ///< pairs of coordinates of two points of one configuration
};

/// Summarises rows added configuration by configuration, in constant memory. Without a known square root of their
/// information, every few hundred rows are reduced to a triangular factor together with the previous one.
class RowSummary {
public:
  explicit RowSummary(Eigen::Index columns, std::optional<Eigen::MatrixXd> sqrt_information = std::nullopt);

  void add_configuration(const Eigen::Ref<const Eigen::MatrixXd>& jacobian,
                         const Eigen::Ref<const Eigen::VectorXd>& residual);
  /// Adds rows of the priors.
  void add_priors(const Eigen::Ref<const Eigen::MatrixXd>& rows);
  /// The summary of all rows. No rows can be added afterwards.
  WhitenedSummary finish();

private:
  void append(const Eigen::Ref<const Eigen::MatrixXd>& rows);
  void make_triangle();
  void add_sums();

  Eigen::Index columns_;
  std::optional<Eigen::MatrixXd> known_;
  Eigen::MatrixXd rows_;
  Eigen::Index filled_ = 0;
  Eigen::MatrixXd sums_;  // s(J_c) of some configurations
  Eigen::Index summed_ = 0;
  WhitenedSummary summary_;
};

}  // namespace kdl_calibration
