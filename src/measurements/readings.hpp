#pragma once

// Residual, directions and number of equations of a reading.

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <map>
#include <optional>
#include <vector>

#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// A function for each kind of reading, as one for std::visit, which does not compile if a kind has none.
template <class... Functions>
struct ByKind : Functions... {
  using Functions::operator()...;
};
template <class... Functions>
ByKind(Functions...) -> ByKind<Functions...>;

/// Measured minus predicted position [m] in W, for a point predicted at f: P (z - f), or n (d - |f - a|) for a distance
/// d from an anchor a.
Eigen::Vector3d measured_minus_predicted(const Reading& reading, const Eigen::Vector3d& f);

/// The projector P onto the measured directions, minus the derivative of that difference by f. For coordinates it does
/// not depend on f.
Eigen::Matrix3d directions(const Reading& reading, const Eigen::Vector3d& f);
Eigen::Matrix3d directions(const Coordinates& coordinates);

/// Number of measured coordinates of the position, the rank of P: 1, 2 or 3.
inline int dimension(const Reading& reading) {
  return std::visit(
      ByKind{[](const Point&) { return 3; }, [](const Pose&) { return 3; },
             [](const Coordinates& some) { return static_cast<int>(some.count); }, [](const Distance&) { return 1; }},
      reading);
}
/// Their sum over all rows.
int dimension(const Measurements& measurements);

/// The coordinates along the directions of `information`, a sum of weighted projectors: a point if it has all three.
Reading reading_along(const Eigen::Matrix3d& information, const Eigen::Vector3d& position);

inline bool is_whole(const Observation& observation) { return dimension(observation.reading) == 3; }
inline bool has_orientation(const Observation& observation) { return observation.orientation() != nullptr; }
inline bool is_distance(const Observation& observation) {
  return std::holds_alternative<Distance>(observation.reading);
}

/// Whether some row is no whole point.
bool has_single_coordinates(const Measurements& measurements);
std::size_t rows_of_single_coordinates(const Measurements& measurements);
/// Whether some row is a pose.
bool has_orientations(const Measurements& measurements);
/// Whether the order of driving is known.
bool has_order(const Measurements& measurements);

/// The same joints, configurations, targets and stations without rows.
Measurements without_observations(const Measurements& measurements);
/// The rows that are whole points, as measurements without single coordinates; none if there are no such rows.
Measurements whole_points(const Measurements& measurements);
/// The measurements with their distances counted from this zero: each is shorter by it.
Measurements from_zero(Measurements measurements, double zero);
/// The same, or without a zero the measurements themselves, to which a reference is kept.
class FromZero {
public:
  FromZero(const Measurements& measurements, double zero);
  FromZero(Measurements&&, double) = delete;

  const Measurements& operator*() const { return shorter_ ? *shorter_ : all_; }

private:
  const Measurements& all_;
  std::optional<Measurements> shorter_;
};

/// Rows by a value that stands in several configurations, if such rows are most of those that have one: measured values
/// do not repeat. Places are those of sockets, planes and anchors.
std::map<std::array<double, 3>, std::vector<std::size_t>> rows_of_stated_places(const Measurements& measurements);
std::map<double, std::vector<std::size_t>> rows_of_stated_distances(const Measurements& measurements);
/// The same rows with points instead of poses.
Measurements without_orientations(Measurements measurements);
/// The same rows in no known order.
Measurements without_order(Measurements measurements);

/// The unit vector from an anchor to a point; any if they are the same.
Eigen::Vector3d from_anchor(const Eigen::Vector3d& anchor, const Eigen::Vector3d& point);

/// R of information = R R^T, a sum of weighted projectors: one column for each direction that it determines.
Eigen::Matrix3Xd root_of_directions(const Eigen::Matrix3d& information);
/// The projector onto these directions, and the pseudo-inverse of R R^T.
Eigen::Matrix3d projector(const Eigen::Matrix3Xd& R);
Eigen::Matrix3d inverse_on_directions(const Eigen::Matrix3Xd& R);

}  // namespace kdl_calibration
