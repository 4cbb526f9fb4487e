#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "calibration/new_point.hpp"
#include "estimation/prediction.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

/// What a prediction and its uncertainty need of a calibration.
struct PredictionBasis {
  ErrorModel model;
  Estimate estimate;
  Unknowns free;
  Eigen::MatrixXd covariance;  ///< of the free columns; infinite variance if not determined; empty: unknown
  Unknowns candidates;
  Eigen::MatrixXd undetermined;  ///< candidates x directions that the measurements do not determine
  NewPointNoise noise;
  MeasuredRegion region;
};

/// The predicted position of a target and its uncertainty. Of several stations W is that of the given one; without one
/// it is the first's, and the covariance is that of the position in the base frame.
struct PointWithCovariance {
  Eigen::Vector3d position;    ///< [m] in the base frame
  Eigen::Vector3d position_W;  ///< [m]
  Eigen::Matrix3d covariance;  ///< [m^2] in W, by the parameters alone
  NewPoint new_point;          ///< its radius includes the region's factor
  bool outside = false;        ///< outside the measured region: the radius does not hold there
};

/// Predictions and their uncertainty, infinite if they depend on parameters fixed by gauge. Keeps a reference.
class PointPredictor {
public:
  explicit PointPredictor(const PredictionBasis& basis);

  /// Every target at `q` and `signals` (one column).
  std::vector<PointWithCovariance> points(const Eigen::VectorXd& q, const DriveSignals& signals,
                                          std::optional<std::size_t> station = std::nullopt) const;

  /// Covariance [m^2] of every target in W.
  std::vector<Eigen::Matrix3d> covariances(const Eigen::VectorXd& q, const DriveSignals& signals,
                                           std::optional<std::size_t> station = std::nullopt) const;

  /// 3D 1 sigma [m], targets x N. One product for many configurations is three times faster than one for each.
  Eigen::MatrixXd sigmas(const Eigen::MatrixXd& joint_values, const DriveSignals& signals) const;

  /// The largest motion [m] of a target at `q` by a combination of parameters that the measurements do not determine,
  /// if none of these parameters changes by more than 1 mm or 1 mrad. 0 if all are determined.
  double undetermined_motion(const Eigen::VectorXd& q) const;

private:
  Eigen::VectorXd left_out(const Eigen::VectorXd& q, const DriveSignals& signals) const;
  std::vector<Eigen::Matrix3d> unmodelled_covariances(const Eigen::VectorXd& q, const DriveSignals& signals,
                                                      std::optional<std::size_t> station) const;
  bool determines(const Matrix3Xd& jacobian) const;

  const PredictionBasis& basis_;
  PositionPredictor free_;
  PositionPredictor candidates_;
  Unknowns offsets_;  // offsets of the joints, about their own axes
  PositionPredictor joints_;
};

}  // namespace kdl_calibration
