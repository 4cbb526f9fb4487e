#include "measurements/directions.hpp"

#include "base/decompositions.hpp"

namespace kdl_calibration {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

Matrix3d directions_at(const Measurements& measurements, std::size_t row, const Vector3d& f) {
  const MeasuredCoordinates measured = coordinates_at(measurements, row);
  const Vector3d n = from_anchor(measurements.observations[row].position, f);
  return measured.distance > 0.0 ? Matrix3d(n * n.transpose()) : measured.directions;
}

Matrix3Xd root_of_directions(const Matrix3d& information) {
  constexpr double kNothing = 1e-12;  // of the largest eigenvalue
  const auto [values, vectors] = spectrum(information);
  const Eigen::Index count = (values.array() > kNothing * values[2]).count();
  return vectors.rightCols(count) * values.tail(count).cwiseSqrt().asDiagonal();
}

Matrix3d projector(const Matrix3Xd& R) {
  return R * R.colwise().squaredNorm().cwiseInverse().asDiagonal() * R.transpose();
}

Matrix3d inverse_on_directions(const Matrix3Xd& R) {
  return R * R.colwise().squaredNorm().cwiseAbs2().cwiseInverse().asDiagonal() * R.transpose();
}

}  // namespace kdl_calibration
