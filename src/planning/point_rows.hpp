#pragma once

// Linearised measurements of an experiment per configuration, packed so that one matrix-vector product evaluates a
// quadratic form for many configurations.

#include <Eigen/Dense>
#include <optional>
#include <utility>
#include <vector>

#include "model/kinematics.hpp"
#include "planning/experiment.hpp"

namespace kdl_calibration {

/// Rows [S J, E] of one or more points: J (6 x chain columns) is the flange's twist, E acts on the targets' columns.
struct PointBlock {
  Eigen::MatrixXd S;  ///< k x 6
  Eigen::MatrixXd E;  ///< k x target columns
};

/// tr([S J, E] C [S J, E]^T) = features(J, S^T S) . form(C).weights + form(C).constant for symmetric C.
struct PackedForm {
  Eigen::VectorXd weights;
  double constant = 0.0;
};
/// The rows of an experiment. The basis of the chain's columns may be changed: J becomes J * basis.
class PointRows {
public:
  explicit PointRows(const Experiment& experiment);

  Eigen::Index chain_columns() const { return static_cast<Eigen::Index>(twists_.size()); }
  Eigen::Index columns() const { return chain_columns() + points_.E.cols(); }
  Eigen::Index targets() const { return static_cast<Eigen::Index>(target_blocks_.size()); }

  const PointBlock& points() const { return points_; }                             ///< all targets
  const std::vector<PointBlock>& target_blocks() const { return target_blocks_; }  ///< 3 rows each

  /// Changes to a basis in which the chain's block of the information `mean`, after elimination of the targets, is the
  /// identity, so that columns are well conditioned. False if `mean` is singular.
  bool change_basis(const Eigen::MatrixXd& mean);
  /// Information (or a matrix that transforms alike) in the changed basis.
  Eigen::MatrixXd in_basis(const Eigen::MatrixXd& information) const;

  Matrix6Xd jacobian(const Eigen::Ref<const Eigen::VectorXd>& q) const;
  /// [S J, E] for one of the blocks.
  Eigen::MatrixXd rows(const PointBlock& block, const Eigen::Ref<const Eigen::VectorXd>& q) const;
  /// The rows of all targets in each of these configurations (joints x N).
  Eigen::MatrixXd stacked(const Eigen::MatrixXd& joint_values) const;
  /// A: rows of all targets, whitened to unit noise.
  Eigen::MatrixXd whitened(const Eigen::Ref<const Eigen::VectorXd>& q) const;

  /// Packed information of a configuration: tr(A C A^T) = features. form(C).weights + form(C).constant for symmetric C.
  Eigen::Index feature_count() const;
  void pack(const Eigen::Ref<const Eigen::VectorXd>& q, Eigen::Ref<Eigen::RowVectorXd> features) const;
  PackedForm form(const Eigen::MatrixXd& C) const;
  /// Sum of w A^T A from the sums of w · features and of w.
  Eigen::MatrixXd unpacked(const Eigen::VectorXd& features, double weight) const;

private:
  ErrorModel model_;
  FoldedChain chain_;
  std::vector<ParameterTwist> twists_;
  std::vector<std::size_t> effects_;  // free terms of the model
  ColumnRange effect_columns_;        // columns of these terms among the chain's
  PointBlock points_;
  PointBlock whitened_;     // for noise independent of the configuration
  Matrix6d whitened_gram_;  // S^T S of whitened_
  PointNoise noise_;
  std::vector<TargetFrame> targets_;
  std::vector<PointBlock> target_blocks_;
  std::optional<Eigen::MatrixXd> basis_;  // empty: unchanged
};

Eigen::Index feature_count(Eigen::Index chain_columns);
void pack_features(const Matrix6Xd& J, const Matrix6d& P, Eigen::Ref<Eigen::RowVectorXd> features);
PackedForm packed_form(const PointBlock& block, const Eigen::MatrixXd& C, Eigen::Index chain_columns);
/// Sum of w [S J, E]^T [S J, E] from the sums of w · features and of w.
Eigen::MatrixXd unpacked_information(const PointBlock& block, const Eigen::VectorXd& features, double weight,
                                     Eigen::Index chain_columns);

}  // namespace kdl_calibration
