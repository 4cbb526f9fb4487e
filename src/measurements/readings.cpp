#include "measurements/readings.hpp"

#include <algorithm>
#include <utility>

#include "base/decompositions.hpp"

namespace kdl_calibration {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

Vector3d measured_minus_predicted(const Reading& reading, const Vector3d& f) {
  return std::visit(ByKind{[&](const Point& point) -> Vector3d { return point.position - f; },
                           [&](const Pose& pose) -> Vector3d { return pose.position - f; },
                           [&](const Coordinates& some) -> Vector3d { return directions(some) * (some.position - f); },
                           [&](const Distance& distance) -> Vector3d {
                             return (distance.length - (f - distance.anchor).norm()) * from_anchor(distance.anchor, f);
                           }},
                    reading);
}

Matrix3d directions(const Reading& reading, const Vector3d& f) {
  return std::visit(ByKind{[](const Point&) -> Matrix3d { return Matrix3d::Identity(); },
                           [](const Pose&) -> Matrix3d { return Matrix3d::Identity(); },
                           [](const Coordinates& some) -> Matrix3d { return directions(some); },
                           [&](const Distance& distance) -> Matrix3d {
                             const Vector3d n = from_anchor(distance.anchor, f);
                             return n * n.transpose();
                           }},
                    reading);
}

Matrix3d directions(const Coordinates& coordinates) {
  const Matrix3d along = coordinates.normal * coordinates.normal.transpose();
  return coordinates.count == 1 ? along : Matrix3d(Matrix3d::Identity() - along);
}

int dimension(const Measurements& measurements) {
  int sum = 0;
  for (const Observation& observation : measurements.observations) {
    sum += dimension(observation.reading);
  }
  return sum;
}

Reading reading_along(const Matrix3d& information, const Vector3d& position) {
  const Matrix3Xd R = root_of_directions(information);
  if (R.cols() == 3) {
    return Point{position};
  }
  const Vector3d normal = R.cols() == 1 ? Vector3d(R) : Vector3d(R.col(0)).cross(Vector3d(R.col(1)));
  return Coordinates{.position = position, .normal = normal.normalized(), .count = static_cast<std::int8_t>(R.cols())};
}

bool has_single_coordinates(const Measurements& measurements) {
  return !std::all_of(measurements.observations.begin(), measurements.observations.end(), is_whole);
}

std::size_t rows_of_single_coordinates(const Measurements& measurements) {
  const auto& rows = measurements.observations;
  return rows.size() - static_cast<std::size_t>(std::count_if(rows.begin(), rows.end(), is_whole));
}

bool has_orientations(const Measurements& measurements) {
  return std::any_of(measurements.observations.begin(), measurements.observations.end(), has_orientation);
}

bool has_order(const Measurements& measurements) {
  return !measurements.observations.empty() &&
         std::all_of(measurements.observations.begin(), measurements.observations.end(),
                     [](const Observation& observation) { return observation.order.has_value(); });
}

Measurements without_observations(const Measurements& measurements) {
  return {.source = measurements.source,
          .joints = measurements.joints,
          .joint_values = measurements.joint_values,
          .configurations = measurements.configurations,
          .targets = measurements.targets,
          .stations = measurements.stations,
          .observations = {},
          .joint_units = measurements.joint_units,
          .remark = measurements.remark,
          .signals = measurements.signals};
}

Measurements whole_points(const Measurements& measurements) { return subset(measurements, is_whole); }

Measurements from_zero(Measurements measurements, double zero) {
  for (Observation& row : measurements.observations) {
    if (auto* const distance = std::get_if<Distance>(&row.reading)) {
      distance->length -= zero;
    }
  }
  return measurements;
}

FromZero::FromZero(const Measurements& measurements, double zero) : all_(measurements) {
  if (zero != 0.0) {
    shorter_ = from_zero(measurements, zero);
  }
}

namespace {

// Without the values of a single configuration; none if the others are fewer than half.
template <class Value>
std::map<Value, std::vector<std::size_t>> stated(const Measurements& measurements,
                                                 std::map<Value, std::vector<std::size_t>> rows) {
  const auto configuration = [&](std::size_t row) { return measurements.observations[row].configuration; };
  std::size_t all = 0;
  std::size_t repeated = 0;
  std::erase_if(rows, [&](const auto& entry) {
    const std::vector<std::size_t>& own = entry.second;
    const bool once = std::all_of(own.begin(), own.end(),
                                  [&](std::size_t row) { return configuration(row) == configuration(own.front()); });
    all += own.size();
    repeated += once ? 0 : own.size();
    return once;
  });
  if (2 * repeated < all) {
    rows.clear();
  }
  return rows;
}

}  // namespace

std::map<std::array<double, 3>, std::vector<std::size_t>> rows_of_stated_places(const Measurements& measurements) {
  std::map<std::array<double, 3>, std::vector<std::size_t>> rows;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Vector3d& place = measurements.observations[row].position();
    rows[{place.x(), place.y(), place.z()}].push_back(row);
  }
  return stated(measurements, std::move(rows));
}

std::map<double, std::vector<std::size_t>> rows_of_stated_distances(const Measurements& measurements) {
  std::map<double, std::vector<std::size_t>> rows;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    if (const auto* const distance = std::get_if<Distance>(&measurements.observations[row].reading)) {
      rows[distance->length].push_back(row);
    }
  }
  return stated(measurements, std::move(rows));
}

Measurements without_orientations(Measurements measurements) {
  for (Observation& observation : measurements.observations) {
    if (has_orientation(observation)) {
      observation.reading = Point{observation.position()};
    }
  }
  return measurements;
}

Measurements without_order(Measurements measurements) {
  for (Observation& observation : measurements.observations) {
    observation.order.reset();
  }
  return measurements;
}

Vector3d from_anchor(const Vector3d& anchor, const Vector3d& point) {
  const double distance = (point - anchor).norm();
  return distance > 0.0 ? Vector3d((point - anchor) / distance) : Vector3d::UnitX();
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
