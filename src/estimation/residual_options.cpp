#include "estimation/residual_options.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <optional>
#include <vector>

#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

Matrix3d point_covariance(const NoiseModel& noise, const Observation& observation) {
  const double factor = observation.noise.length;
  if (observation.sigma > 0.0) {
    return factor * factor * observation.sigma * observation.sigma * Matrix3d::Identity();
  }
  if (noise.tracker) {
    const double distance = observation.position().norm();
    const double range = factor * (noise.tracker->range + noise.tracker->range_per_metre * distance);
    const double transverse = factor * (noise.tracker->transverse + noise.tracker->transverse_per_metre * distance);
    const Vector3d line = distance > 0.0 ? Vector3d(observation.position() / distance) : Vector3d::UnitZ();
    const Matrix3d along = line * line.transpose();
    return range * range * along + transverse * transverse * (Matrix3d::Identity() - along);
  }
  return Vector3d(factor * factor * noise.independent.cwiseAbs2()).asDiagonal();
}

// With the covariance L L^T of the earlier result its rows are L^-1.
PriorRows prior_rows(const Unknowns& free, const ResidualOptions& options) {
  VectorXd information = free.prior_information(options.priors);
  std::vector<Index> columns;
  std::vector<Index> places;
  for (std::size_t i = 0; options.earlier && i < options.earlier->names.size(); ++i) {
    if (const std::optional<Index> column = free.column(options.earlier->names[i])) {
      columns.push_back(*column);
      places.push_back(static_cast<Index>(i));
      information[*column] = 0.0;
    }
  }
  const auto earlier = static_cast<Index>(columns.size());
  const Index count = (information.array() > 0.0).count() + earlier;
  PriorRows result{.rows = Eigen::SparseMatrix<double>(count, free.size()), .expected = VectorXd::Zero(count)};
  std::vector<Eigen::Triplet<double>> entries;
  Index row = 0;
  for (Index column = 0; column < free.size(); ++column) {
    if (information[column] > 0.0) {
      entries.emplace_back(row++, column, std::sqrt(information[column]));
    }
  }
  if (earlier > 0) {
    const Eigen::LLT<MatrixXd> root(options.earlier->covariance(places, places));
    const MatrixXd whitened = root.matrixL().solve(MatrixXd::Identity(earlier, earlier));
    for (Index j = 0; j < earlier; ++j) {
      for (Index i = j; i < earlier; ++i) {
        entries.emplace_back(row + i, columns[static_cast<std::size_t>(j)], whitened(i, j));
      }
    }
    result.expected.tail(earlier) = whitened * options.earlier->mean(places);
  }
  result.rows.setFromTriplets(entries.begin(), entries.end());
  return result;
}

double position_information(const ResidualOptions& options, const Observation& observation) {
  const double sigma = observation.sigma > 0.0 ? observation.sigma : options.noise.independent.x();
  const double factor = observation.noise.length;
  return (sigma > 0.0 ? 1.0 / (sigma * sigma) : 1.0) / (factor * factor);
}

double orientation_information(const ResidualOptions& options, double position_information,
                               const NoiseFactors& factors) {
  const double sigma = options.noise.orientation * factors.orientation;
  const double length = options.orientation_length * factors.length / factors.orientation;
  return sigma > 0.0 ? 1.0 / (sigma * sigma) : position_information * length * length;
}

}  // namespace kdl_calibration
