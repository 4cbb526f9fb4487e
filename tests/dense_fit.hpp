#pragma once

#include <Eigen/Dense>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "estimation/least_squares.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/parameters.hpp"
#include "support.hpp"

namespace kdl_calibration::testing {

inline Eigen::Matrix3d turned_by(const Eigen::Vector3d& rotation) {
  const double angle = rotation.norm();
  return angle > 0.0 ? Eigen::AngleAxisd(angle, rotation / angle).toRotationMatrix() : Eigen::Matrix3d::Identity();
}

inline Eigen::Vector3d rotation_vector(const Eigen::Matrix3d& R) {
  const Eigen::AngleAxisd turn(R);
  return turn.angle() * turn.axis();
}

/// What the measurements are worth, written out by the test that uses it.
struct DenseNoise {
  std::function<Eigen::Matrix3d(const Observation&)> position;  ///< covariance of a point by itself, in W [m^2]
  std::function<double(const Observation&)> orientation;        ///< variance of a component [rad^2]
  Eigen::Vector3d common = Eigen::Vector3d::Zero();             ///< [m] shared by the points of a repeat
  std::vector<double> weights;                                  ///< on the information of each row; empty: 1
};

/// The least squares problem in its plainest form, as an oracle: every row by itself and nothing gathered, predictions
/// from KDL's solver on the chain with error segments, covariances of whole repeats, a stacked Jacobian by central
/// differences, its QR factorisation.
class DenseFit {
public:
  DenseFit(const ErrorModel& model, const Measurements& measurements, Unknowns free, DenseNoise noise,
           const Priors& priors = {})
      : model_(model), measurements_(measurements), free_(std::move(free)), noise_(std::move(noise)), priors_(priors) {
    std::map<std::pair<int, int>, std::vector<std::size_t>> repeats;
    for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
      const Observation& o = measurements.observations[row];
      if (o.split == Split::train && weight(row) > 0.0) {
        repeats[{o.configuration, o.repeat}].push_back(row);
      }
    }
    for (auto& [key, rows] : repeats) {
      add_block(rows);
    }
  }

  long equations() const { return equations_; }  ///< measured coordinates, without the priors
  long columns() const { return free_.size(); }

  /// Whitened, the priors last.
  Eigen::VectorXd residuals(const Estimate& estimate) const {
    place_flange(estimate.errors);
    Eigen::VectorXd all(equations_ + prior_count());
    Eigen::Index at = 0;
    for (const Block& block : blocks_) {
      const Eigen::VectorXd e = block_residuals(block, estimate);
      all.segment(at, e.size()) = block.root.triangularView<Eigen::Lower>().solve(e);
      at += e.size();
    }
    for (const std::size_t p : free_.geometric()) {
      if (const double sigma = prior(p); sigma > 0.0) {
        all[at++] = -estimate.errors[static_cast<Eigen::Index>(p)] / sigma;
      }
    }
    return all;
  }

  double cost(const Estimate& estimate) const { return residuals(estimate).squaredNorm(); }

  /// Of the prediction: minus the derivative of the residuals. No effects.
  Eigen::MatrixXd jacobian(const Estimate& estimate) const {
    return central_differences(columns(), 1e-5, [&](const Eigen::VectorXd& step) {
      return Eigen::VectorXd(-residuals(moved(estimate, step)));
    });
  }

  /// Gauss-Newton from `start` until steps no longer matter.
  Estimate fit(Estimate start, int iterations = 12) const {
    for (int i = 0; i < iterations; ++i) {
      const Eigen::VectorXd e = residuals(start);
      const Eigen::MatrixXd J = jacobian(start);
      const Eigen::VectorXd scale = J.colwise().norm().cwiseInverse();
      const Eigen::VectorXd step = scale.cwiseProduct((J * scale.asDiagonal()).householderQr().solve(e));
      start = moved(start, step);
      if ((J * step).norm() < 1e-7 * std::sqrt(static_cast<double>(columns()))) {  // of one sigma
        break;
      }
    }
    return start;
  }

  /// (J^T J)^-1.
  Eigen::MatrixXd inverse_information(const Estimate& estimate) const {
    const Eigen::MatrixXd J = jacobian(estimate);
    const Eigen::VectorXd scale = J.colwise().norm().cwiseInverse();
    const Eigen::MatrixXd scaled = J * scale.asDiagonal();
    return scale.asDiagonal() * (scaled.transpose() * scaled).inverse() * scale.asDiagonal();
  }

  Estimate moved(const Estimate& estimate, const Eigen::VectorXd& step) const {
    Estimate result = estimate;
    const auto move = [&](UnknownGroup group, std::size_t first, Eigen::Isometry3d& X, const Eigen::Matrix3d& axes) {
      Eigen::Matrix<double, 6, 1> motion = Eigen::Matrix<double, 6, 1>::Zero();
      for (std::size_t i = 0; i < 6; ++i) {
        const std::optional<Eigen::Index> column = free_.column(group, first + i);
        motion[static_cast<Eigen::Index>(i)] = column ? step[*column] : 0.0;
      }
      X.translation() += axes * motion.head<3>();
      X.linear() = X.linear() * turned_by(motion.tail<3>());
    };
    move(UnknownGroup::base, 0, result.frames.base(), Eigen::Matrix3d(estimate.frames.base().linear()));
    for (const std::size_t p : free_.geometric()) {
      result.errors[static_cast<Eigen::Index>(p)] += step[*free_.column(UnknownGroup::geometric, p)];
    }
    for (std::size_t k = 0; k < result.frames.targets.size(); ++k) {
      move(UnknownGroup::targets, 6 * k, result.frames.targets[k].X_FT, Eigen::Matrix3d::Identity());
    }
    return result;
  }

private:
  struct Block {
    std::vector<std::size_t> rows;
    std::vector<std::size_t> oriented;  // those with a measured orientation
    Eigen::MatrixXd root;               // L of the covariance L L^T
  };

  double weight(std::size_t row) const { return noise_.weights.empty() ? 1.0 : noise_.weights[row]; }

  double prior(std::size_t p) const { return is_length(model_, model_.parameters[p]) ? priors_.length : priors_.angle; }

  Eigen::Index prior_count() const {
    return std::count_if(free_.geometric().begin(), free_.geometric().end(),
                         [&](std::size_t p) { return prior(p) > 0.0; });
  }

  void add_block(const std::vector<std::size_t>& rows) {
    Block block{.rows = rows, .oriented = {}, .root = {}};
    for (const std::size_t row : rows) {
      if (measurements_.observations[row].orientation() != nullptr) {
        block.oriented.push_back(row);
      }
    }
    const auto points = static_cast<Eigen::Index>(3 * rows.size());
    const auto size = points + static_cast<Eigen::Index>(3 * block.oriented.size());
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(size, size);
    for (Eigen::Index i = 0; i < points; ++i) {
      for (Eigen::Index j = 0; j < points; ++j) {
        covariance(i, j) = i % 3 == j % 3 ? std::pow(noise_.common[i % 3], 2) : 0.0;
      }
    }
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const auto at = static_cast<Eigen::Index>(3 * i);
      covariance.block<3, 3>(at, at) += noise_.position(measurements_.observations[rows[i]]) / weight(rows[i]);
    }
    for (std::size_t i = 0; i < block.oriented.size(); ++i) {
      const std::size_t row = block.oriented[i];
      covariance.diagonal()
          .segment<3>(points + static_cast<Eigen::Index>(3 * i))
          .setConstant(noise_.orientation(measurements_.observations[row]) / weight(row));
    }
    block.root = covariance.llt().matrixL();
    equations_ += size;
    blocks_.push_back(std::move(block));
  }

  // By KDL, where other errors than the last ones are asked for.
  void place_flange(const Eigen::VectorXd& errors) const {
    if (errors.size() == placed_errors_.size() && errors == placed_errors_) {
      return;
    }
    placed_errors_ = errors;
    X_BF_.clear();
    const KDL::Chain chain = error_chain(model_, errors);
    KDL::ChainFkSolverPos_recursive solver(chain);
    KDL::JntArray q(chain.getNrOfJoints());
    KDL::Frame pose;
    for (Eigen::Index c = 0; c < measurements_.joint_values.cols(); ++c) {
      q.data = measurements_.joint_values.col(c);
      solver.JntToCart(q, pose);
      X_BF_.push_back(to_eigen(pose));
    }
  }

  Eigen::VectorXd block_residuals(const Block& block, const Estimate& estimate) const {
    Eigen::VectorXd e(block.root.rows());
    Eigen::Index at = 0;
    const auto predicted = [&](std::size_t row) {
      const Observation& o = measurements_.observations[row];
      return estimate.frames.base() * X_BF_[static_cast<std::size_t>(o.configuration)] *
             estimate.frames.targets[static_cast<std::size_t>(o.target)].X_FT;
    };
    for (const std::size_t row : block.rows) {
      e.segment<3>(at) = measurements_.observations[row].position() - predicted(row).translation();
      at += 3;
    }
    for (const std::size_t row : block.oriented) {
      e.segment<3>(at) = rotation_vector(predicted(row).linear().transpose() *
                                         measurements_.observations[row].orientation()->toRotationMatrix());
      at += 3;
    }
    return e;
  }

  const ErrorModel& model_;
  const Measurements& measurements_;
  Unknowns free_;
  DenseNoise noise_;
  Priors priors_;
  std::vector<Block> blocks_;
  Eigen::Index equations_ = 0;
  mutable Eigen::VectorXd placed_errors_;
  mutable std::vector<Eigen::Isometry3d> X_BF_;
};

}  // namespace kdl_calibration::testing
