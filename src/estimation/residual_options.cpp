#include "estimation/residual_options.hpp"

#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Matrix3d point_covariance(const NoiseModel& noise, const Observation& observation) {
  if (observation.sigma > 0.0) {
    return observation.sigma * observation.sigma * Matrix3d::Identity();
  }
  if (noise.tracker) {
    const double distance = observation.position.norm();
    const double range = noise.tracker->range + noise.tracker->range_per_metre * distance;
    const double transverse = noise.tracker->transverse + noise.tracker->transverse_per_metre * distance;
    const Vector3d line = distance > 0.0 ? Vector3d(observation.position / distance) : Vector3d::UnitZ();
    const Matrix3d along = line * line.transpose();
    return range * range * along + transverse * transverse * (Matrix3d::Identity() - along);
  }
  return noise.independent.cwiseAbs2().asDiagonal();
}

double position_information(const ResidualOptions& options, const Observation& observation) {
  const double sigma = observation.sigma > 0.0 ? observation.sigma : options.noise.independent.x();
  return sigma > 0.0 ? 1.0 / (sigma * sigma) : 1.0;
}

double orientation_information(const ResidualOptions& options, double position_information) {
  const double sigma = options.noise.orientation;
  return sigma > 0.0 ? 1.0 / (sigma * sigma)
                     : position_information * options.orientation_length * options.orientation_length;
}

}  // namespace kdl_calibration
