#include "planning/point_rows.hpp"

#include "effects/joint_effects.hpp"
#include "estimation/input_check.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// Packs the lower triangle row by row, off-diagonal elements doubled.
void pack_symmetric(const MatrixXd& C, VectorXd& weights) {
  Index k = 0;
  for (Index a = 0; a < C.cols(); ++a) {
    for (Index b = 0; b < a; ++b) {
      weights[k++] = 2.0 * C(a, b);
    }
    weights[k++] = C(a, a);
  }
}

MatrixXd unpacked_symmetric(const VectorXd& features, Index columns) {
  MatrixXd M(columns, columns);
  Index k = 0;
  for (Index a = 0; a < columns; ++a) {
    for (Index b = 0; b <= a; ++b) {
      M(a, b) = M(b, a) = features[k++];
    }
  }
  return M;
}

const Experiment& checked(const Experiment& experiment) {
  check(experiment.model);
  check({.errors = experiment.errors, .frames = {.targets = experiment.targets}, .effects = {}}, experiment.model,
        experiment.targets.size());
  check(experiment.free, experiment.model, experiment.targets.size());
  check(noise_model(experiment.noise));
  check(experiment.priors);
  return experiment;
}

}  // namespace

PointRows::PointRows(const Experiment& experiment)
    : model_(checked(experiment).model),
      chain_(folded(model_, experiment.errors)),
      effects_(experiment.free.effects()),
      effect_columns_(experiment.free.range(UnknownGroup::effects)),
      noise_(experiment.noise),
      targets_(experiment.targets) {
  twists_ = chain_twists(model_, chain_, experiment.errors, experiment.free);
  const auto T = static_cast<Index>(experiment.targets.size());
  const ColumnRange target_columns = experiment.free.range(UnknownGroup::targets);
  points_.S = MatrixXd::Zero(3 * T, 6);
  points_.E = MatrixXd::Zero(3 * T, target_columns.count);
  for (Index t = 0; t < T; ++t) {
    const auto k = static_cast<std::size_t>(t);
    points_.S.middleRows(3 * t, 3) << Eigen::Matrix3d::Identity(), -skew(experiment.targets[k].X_FT.translation());
    for (Index axis = 0; axis < 3; ++axis) {
      if (const int column = experiment.free.target_columns(k)[static_cast<std::size_t>(axis)]; column >= 0) {
        points_.E(3 * t + axis, column - target_columns.first) = 1.0;
      }
    }
    target_blocks_.push_back({.S = points_.S.middleRows(3 * t, 3), .E = points_.E.middleRows(3 * t, 3)});
  }
  // Covariance of one coordinate of all targets; the coordinates are independent.
  const double own = experiment.noise.sigma * experiment.noise.sigma;
  const double shared = experiment.noise.configuration_sigma * experiment.noise.configuration_sigma;
  const MatrixXd covariance = own * MatrixXd::Identity(T, T) + MatrixXd::Constant(T, T, shared);
  const MatrixXd whitening = covariance.llt().matrixL().solve(MatrixXd::Identity(T, T));
  MatrixXd W = MatrixXd::Zero(3 * T, 3 * T);
  for (Index i = 0; i < T; ++i) {
    for (Index j = 0; j <= i; ++j) {
      W.block<3, 3>(3 * i, 3 * j).diagonal().setConstant(whitening(i, j));
    }
  }
  whitened_ = {.S = W * points_.S, .E = W * points_.E};
  whitened_gram_ = whitened_.S.transpose() * whitened_.S;
}

bool PointRows::change_basis(const MatrixXd& mean) {
  constexpr double kSingular = 1e-13;
  const Index c = chain_columns();
  const Index t = columns() - c;
  MatrixXd schur = mean.topLeftCorner(c, c);
  if (t > 0) {
    schur -= mean.topRightCorner(c, t) * mean.bottomRightCorner(t, t).llt().solve(mean.bottomLeftCorner(t, c));
  }
  const VectorXd scale =
      mean.diagonal().head(c).cwiseMax(std::numeric_limits<double>::min()).cwiseSqrt().cwiseInverse();
  const Eigen::LLT<MatrixXd> llt(scale.asDiagonal() * schur * scale.asDiagonal());
  if (llt.info() != Eigen::Success || llt.matrixLLT().diagonal().cwiseAbs2().minCoeff() < kSingular) {
    return false;
  }
  const MatrixXd unscaled = llt.matrixU().solve(MatrixXd::Identity(c, c));
  basis_ = scale.asDiagonal() * unscaled;
  return true;
}

MatrixXd PointRows::in_basis(const MatrixXd& information) const {
  if (!basis_) {
    return information;
  }
  const Index c = chain_columns();
  const Index t = columns() - c;
  MatrixXd result = information;
  result.topLeftCorner(c, c) = basis_->transpose() * information.topLeftCorner(c, c) * *basis_;
  result.topRightCorner(c, t) = basis_->transpose() * information.topRightCorner(c, t);
  result.bottomLeftCorner(t, c) = result.topRightCorner(c, t).transpose();
  return result;
}

Matrix6Xd PointRows::jacobian(const Eigen::Ref<const VectorXd>& q) const {
  Matrix6Xd J;
  flange_jacobian(chain_, twists_, q, J);
  if (!effects_.empty()) {
    const MatrixXd basis = effect_basis(model_, q);
    for (std::size_t i = 0; i < effects_.size(); ++i) {
      J.col(effect_columns_.first + static_cast<Index>(i)) *= basis(static_cast<Index>(effects_[i]), 0);
    }
  }
  return basis_ ? Matrix6Xd(J * *basis_) : J;
}

MatrixXd PointRows::rows(const PointBlock& block, const Eigen::Ref<const VectorXd>& q) const {
  MatrixXd result(block.S.rows(), columns());
  result << block.S * jacobian(q), block.E;
  return result;
}

MatrixXd PointRows::stacked(const MatrixXd& joint_values) const {
  const Index height = points_.S.rows();
  MatrixXd result(height * joint_values.cols(), columns());
  for (Index c = 0; c < joint_values.cols(); ++c) {
    result.middleRows(c * height, height) = rows(points_, joint_values.col(c));
  }
  return result;
}

// A tracker's noise depends on where the points are; else whitening is the same for every configuration.
MatrixXd PointRows::whitened(const Eigen::Ref<const VectorXd>& q) const {
  if (!noise_.tracker) {
    return rows(whitened_, q);
  }
  const NoiseModel model = noise_model(noise_);
  const Isometry3d X_BF = flange_pose(chain_, q);
  const Index height = points_.S.rows();
  MatrixXd covariance(height, height);
  for (Index i = 0; i < height; i += 3) {
    for (Index j = 0; j < height; j += 3) {
      covariance.block<3, 3>(i, j) = model.common.cwiseAbs2().asDiagonal();
    }
    const TargetFrame& target = targets_[static_cast<std::size_t>(i / 3)];
    const Observation seen{.reading = Point{X_BF * target.X_FT.translation() - noise_.tracker_position}};
    covariance.block<3, 3>(i, i) += X_BF.linear().transpose() * point_covariance(model, seen) * X_BF.linear();
  }
  return covariance.llt().matrixL().solve(rows(points_, q));
}

Index PointRows::feature_count() const {
  return noise_.tracker ? columns() * (columns() + 1) / 2 : kdl_calibration::feature_count(chain_columns());
}

void PointRows::pack(const Eigen::Ref<const VectorXd>& q, Eigen::Ref<Eigen::RowVectorXd> features) const {
  if (!noise_.tracker) {
    pack_features(jacobian(q), whitened_gram_, features);
    return;
  }
  const MatrixXd A = whitened(q);
  Index k = 0;
  for (Index a = 0; a < A.cols(); ++a) {
    for (Index b = 0; b <= a; ++b) {
      features[k++] = A.col(a).dot(A.col(b));
    }
  }
}

PackedForm PointRows::form(const MatrixXd& C) const {
  if (!noise_.tracker) {
    return packed_form(whitened_, C, chain_columns());
  }
  PackedForm form{.weights = VectorXd(feature_count())};
  pack_symmetric(C, form.weights);
  return form;
}

MatrixXd PointRows::unpacked(const VectorXd& features, double weight) const {
  return noise_.tracker ? unpacked_symmetric(features, columns())
                        : unpacked_information(whitened_, features, weight, chain_columns());
}

Index feature_count(Index chain_columns) { return chain_columns * (chain_columns + 1) / 2 + 6 * chain_columns; }

void pack_features(const Matrix6Xd& J, const Matrix6d& P, Eigen::Ref<Eigen::RowVectorXd> features) {
  const Matrix6Xd P_J = P * J;
  Index k = 0;
  for (Index a = 0; a < J.cols(); ++a) {
    for (Index b = 0; b <= a; ++b) {
      features[k++] = J.col(a).dot(P_J.col(b));
    }
  }
  features.tail(J.size()) = Eigen::Map<const Eigen::RowVectorXd>(J.data(), J.size());
}

PackedForm packed_form(const PointBlock& block, const MatrixXd& C, Index chain_columns) {
  const Index c = chain_columns;
  const Index t = C.cols() - c;
  PackedForm form{.weights = VectorXd(feature_count(c))};
  pack_symmetric(C.topLeftCorner(c, c), form.weights);
  const Matrix6Xd linear = 2.0 * block.S.transpose() * block.E * C.bottomLeftCorner(t, c);
  form.weights.tail(linear.size()) = Eigen::Map<const VectorXd>(linear.data(), linear.size());
  form.constant = (block.E * C.bottomRightCorner(t, t) * block.E.transpose()).trace();
  return form;
}

MatrixXd unpacked_information(const PointBlock& block, const VectorXd& features, double weight, Index chain_columns) {
  const Index c = chain_columns;
  const Index t = block.E.cols();
  MatrixXd M(c + t, c + t);
  M.topLeftCorner(c, c) = unpacked_symmetric(features, c);
  const Eigen::Map<const Matrix6Xd> J(features.data() + c * (c + 1) / 2, 6, c);
  M.topRightCorner(c, t) = J.transpose() * (block.S.transpose() * block.E);
  M.bottomLeftCorner(t, c) = M.topRightCorner(c, t).transpose();
  M.bottomRightCorner(t, t) = weight * block.E.transpose() * block.E;
  return M;
}

}  // namespace kdl_calibration
