#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "validation/fold_prediction.hpp"

namespace kdl_calibration {

/// A future measurement of the same kind as the existing ones.
struct NewPoint {
  double sigma = 0.0;               ///< [m] 3D 1 sigma of its distance from the prediction
  double radius_95 = 0.0;           ///< [m] of the sphere about the prediction; infinite if not determined
  double degrees_of_freedom = 0.0;  ///< of the variance of a single point
};

struct PointPrediction {
  Eigen::Matrix3d covariance;  ///< [m^2] in W, of the parameters alone
  Eigen::Vector3d place;       ///< [m] in W
  double repeats = 1.0;        ///< number of repeats that the measurement averages
  NoiseFactors noise = {};     ///< of the instrument
};

/// The noise of such a measurement.
struct NewPointNoise {
  NoiseModel model;
  double variance_factor = 1.0;     ///< on the variances of `model`, misfits excepted
  double degrees_of_freedom = 0.0;  ///< of the variance of a single point
  std::vector<NoiseFactors> stations = {};

  /// Factors 1 without a station.
  NoiseFactors at(std::optional<std::size_t> station) const {
    return station && !stations.empty() ? stations[*station] : NoiseFactors();
  }
};
NewPointNoise new_point_noise(const NoiseReport& noise);

/// With S the covariance of one measured point, misfit included, Sigma = covariance + S, s^2 = tr Sigma and k = s^4 /
/// tr Sigma^2, the squared error over s^2 is about F with k and nu degrees of freedom (Satterthwaite 1946, Box 1954),
/// nu those of tr S: radius s sqrt(F_0.95(k, nu)).
NewPoint new_point(const PointPrediction& prediction, const NewPointNoise& noise);

/// The errors of left-out points over their radii, by configuration.
std::map<std::int32_t, std::vector<double>> left_out_ratios(const std::vector<HeldOutPoint>& held_out,
                                                            const NewPointNoise& noise);

/// See MeasuredRegion.
MeasuredRegion measured_region(const Measurements& measurements, const std::vector<HeldOutPoint>& held_out,
                               const NoiseReport& noise, double optimism);

/// How far from its prediction a new measured point is, U = k sqrt(rms^2 + a^2 + b^2) [m], with the RMS errors of
/// points that were not fitted, a = PredictedAccuracy::of_assumptions (which no row shows), b^2 the variance by which a
/// single point scatters more than the mean of its repeats, which is what is left out, and k =
/// coverage_factor(configurations). All robots have the same k, a and rows; their bases and targets are registered.
struct NewPointErrors {
  /// The rows with these errors: left-out configurations, else test rows, else the fitted ones, which are too good.
  enum class Rows { left_out, test, fitted };
  Rows rows = Rows::fitted;
  bool of_coordinates = false;  ///< of single coordinates or distances instead of points
  int configurations = 0;       ///< of these rows
  double coverage_factor = 2.0;
  double of_one = 0.0;  ///< [m] b, where the rows are left out
  /// With effects; the RMS of left-out points without the optimism of the choice: that of nested leave-one-out, else
  /// multiplied by ModelSelection::optimism.
  double compensated = 0.0;
  double urdf_alone = 0.0;  ///< of the exported URDF
  double nominal = 0.0;
};
NewPointErrors new_point_errors(const CalibrationResult& calibration, const Measurements& measurements);

}  // namespace kdl_calibration
