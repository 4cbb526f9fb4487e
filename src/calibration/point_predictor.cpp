#include "calibration/point_predictor.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <variant>

#include "base/dense.hpp"
#include "effects/joint_effects.hpp"
#include "measurements/drive_signals.hpp"
#include "model/kinematics.hpp"
#include "selection/effect_candidates.hpp"

namespace kdl_calibration {

PointPredictor::PointPredictor(const PredictionBasis& basis)
    : basis_(basis),
      free_(basis.model, basis.estimate, basis.free),
      candidates_(basis.model, basis.estimate, basis.candidates),
      offsets_(joint_offsets(basis.model, basis.estimate.frames.targets)),
      joints_(basis.model, basis.estimate, offsets_) {}

// Variances [rad^2 or m^2] of the joints' motions due to effects left out at `q`: withheld tables with their prior
// variance, and effects of an unknown direction of approach.
Eigen::VectorXd PointPredictor::left_out(const Eigen::VectorXd& q, const DriveSignals& signals) const {
  Eigen::VectorXd variances = Eigen::VectorXd::Zero(q.size());
  for (std::size_t place = 0; place < basis_.model.effects.size(); ++place) {
    const EffectTerm& term = basis_.model.effects[place];
    double motion = 0.0;
    if (is_withheld(term, q[term.index])) {
      motion = term.sigma * table_value(std::get<JointTable>(term.function), q[term.index]);
    } else if (misses_approach(term, signals, 0)) {
      motion = basis_.estimate.effects[static_cast<Eigen::Index>(place)];
    }
    variances[term.index] += motion * motion;
  }
  return variances;
}

// Covariance [m^2] of every target beyond that of the free unknowns: from left-out effects, infinite if it depends on
// parameters fixed by gauge.
std::vector<Eigen::Matrix3d> PointPredictor::unmodelled_covariances(const Eigen::VectorXd& q,
                                                                    const DriveSignals& signals,
                                                                    std::optional<std::size_t> station) const {
  std::vector<Eigen::Matrix3d> result(basis_.estimate.frames.targets.size(), Eigen::Matrix3d::Zero());
  const Eigen::VectorXd variances = left_out(q, signals);
  if (!variances.isZero(0.0)) {
    const std::vector<Matrix3Xd> jacobians = joints_.jacobians(q, signals, station);
    for (std::size_t k = 0; k < result.size(); ++k) {
      result[k] = jacobians[k] * variances.asDiagonal() * jacobians[k].transpose();
    }
  }
  if (basis_.undetermined.cols() > 0) {
    const std::vector<Matrix3Xd> jacobians = candidates_.jacobians(q, signals, station);
    for (std::size_t k = 0; k < result.size(); ++k) {
      if (!determines(jacobians[k])) {
        result[k] = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()).asDiagonal();
      }
    }
  }
  return result;
}

bool PointPredictor::determines(const Matrix3Xd& jacobian) const {
  constexpr double kNothing = 1e-6;
  const Eigen::ArrayXd sizes = (jacobian.cwiseAbs() * basis_.undetermined.cwiseAbs()).colwise().sum().transpose();
  const Eigen::ArrayXd effects = (jacobian * basis_.undetermined).colwise().norm().transpose();
  return (effects <= kNothing * sizes).all();
}

double PointPredictor::undetermined_motion(const Eigen::VectorXd& q) const {
  constexpr double kChange = 1e-3;  // [m] or [rad]
  double largest = 0.0;
  if (basis_.undetermined.cols() == 0) {
    return largest;
  }
  for (const Matrix3Xd& jacobian : candidates_.jacobians(q)) {
    for (const auto& direction : basis_.undetermined.colwise()) {
      largest = std::max(largest, kChange * (jacobian * direction).norm() / direction.lpNorm<Eigen::Infinity>());
    }
  }
  return largest;
}

std::vector<Eigen::Matrix3d> PointPredictor::covariances(const Eigen::VectorXd& q, const DriveSignals& signals,
                                                         std::optional<std::size_t> station) const {
  std::vector<Eigen::Matrix3d> result = unmodelled_covariances(q, signals, station);
  const std::vector<Matrix3Xd> jacobians = free_.jacobians(q, signals, station);
  for (std::size_t k = 0; k < result.size(); ++k) {
    if (result[k].allFinite()) {
      result[k] += jacobians[k] * basis_.covariance * jacobians[k].transpose();
    }
  }
  return result;
}

Eigen::MatrixXd PointPredictor::sigmas(const Eigen::MatrixXd& joint_values, const DriveSignals& signals) const {
  constexpr Eigen::Index kAtOnce = 32;
  const auto targets = static_cast<Eigen::Index>(basis_.estimate.frames.targets.size());
  Eigen::MatrixXd variances(targets, joint_values.cols());
  for (Eigen::Index first = 0; first < joint_values.cols(); first += kAtOnce) {
    const Eigen::Index count = std::min(kAtOnce, joint_values.cols() - first);
    Eigen::MatrixXd rows(3 * targets * count, basis_.covariance.cols());
    Eigen::Index row = 0;
    for (Eigen::Index c = first; c < first + count; ++c) {
      for (const Matrix3Xd& jacobian : free_.jacobians(joint_values.col(c), column(signals, c))) {
        rows.middleRows<3>(row) = jacobian;
        row += 3;
      }
    }
    const Eigen::VectorXd coordinates =
        product(factor(rows), factor(basis_.covariance)).cwiseProduct(rows).rowwise().sum();
    variances.middleCols(first, count) =
        coordinates.reshaped(3, targets * count).colwise().sum().reshaped(targets, count);
  }
  for (Eigen::Index c = 0; c < joint_values.cols(); ++c) {
    Eigen::Index k = 0;
    for (const Eigen::Matrix3d& covariance :
         unmodelled_covariances(joint_values.col(c), column(signals, c), std::nullopt)) {
      variances(k++, c) += covariance.trace();
    }
  }
  return variances.cwiseSqrt();
}

std::vector<PointWithCovariance> PointPredictor::points(const Eigen::VectorXd& q, const DriveSignals& signals,
                                                        std::optional<std::size_t> station) const {
  const Estimate& estimate = basis_.estimate;
  const Eigen::Isometry3d X_BF = flange_poses(basis_.model, estimate, q, signals).front();
  const std::vector<Eigen::Matrix3d> all = covariances(q, signals, station);
  const double unproved = basis_.region.unproved;
  const Eigen::Matrix3d of_unproved = unproved * unproved / 3.0 * Eigen::Matrix3d::Identity();
  std::vector<PointWithCovariance> result;
  for (std::size_t k = 0; k < estimate.frames.targets.size(); ++k) {
    PointWithCovariance& point = result.emplace_back();
    point.position = X_BF * estimate.frames.targets[k].X_FT.translation();
    point.position_W = estimate.frames.base(station.value_or(0)) * point.position;
    point.covariance = all[k];
    point.new_point =
        new_point({.covariance = all[k] + of_unproved, .place = point.position_W, .noise = basis_.noise.at(station)},
                  basis_.noise);
    point.new_point.radius_95 *= basis_.region.radius_factor;
    point.outside = !basis_.region.holds(q, all[k]) || withholds_tables(basis_.model, q);
  }
  return result;
}

}  // namespace kdl_calibration
