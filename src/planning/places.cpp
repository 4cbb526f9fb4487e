#include "planning/places.hpp"

#include <Eigen/QR>
#include <utility>

#include "base/decompositions.hpp"
#include "estimation/least_squares.hpp"
#include "measurements/readings.hpp"
#include "selection/parameter_selection.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr double kNothing = 1e-7;  // of a column, a pivot or a singular value

// Columns of unit norm. Those that are nothing beside `before` become zero.
MatrixXd scaled(MatrixXd columns, const MatrixXd& before) {
  for (Index c = 0; c < columns.cols(); ++c) {
    const double norm = columns.col(c).norm();
    if (norm > kNothing * before.col(c).norm()) {
      columns.col(c) /= norm;
    } else {
      columns.col(c).setZero();
    }
  }
  return columns;
}

MatrixXd range_of(const MatrixXd& columns) { return range_basis(scaled(columns, columns), kNothing); }

}  // namespace

Plate plate_of(const Places& places) {
  return {.sockets = places.sockets,
          .places = places.stations,
          .horizontal = places.horizontal,
          .lowest = places.lowest,
          .highest = places.highest};
}

bool are_special(const Places& places) {
  return places.stations > 1 || !places.sockets.empty() || places.directions != "xyz";
}

Measurements along_directions(Measurements points, const std::string& directions) {
  if (directions == "xyz") {
    return points;
  }
  Eigen::Vector3d is_measured = Eigen::Vector3d::Zero();
  for (const char axis : {'x', 'y', 'z'}) {
    is_measured[axis - 'x'] = directions.find(axis) == std::string::npos ? 0.0 : 1.0;
  }
  for (Observation& observation : points.observations) {
    observation.reading =
        directions == "r"
            ? Reading(Distance{.length = observation.position().norm(), .anchor = Eigen::Vector3d::Zero()})
            : reading_along(is_measured.asDiagonal(), observation.position().cwiseProduct(is_measured));
  }
  return points;
}

VirtualRobot nominal_robot(const ErrorModel& model, const std::vector<TargetFrame>& targets) {
  return {.model = model,
          .truth = {.errors = Eigen::VectorXd::Zero(std::ssize(model.parameters)),
                    .frames = {.targets = targets},
                    .effects = Eigen::VectorXd::Zero(std::ssize(model.effects))}};
}

PlacedRows rows_at(const Places& places, VirtualRobot robot, const Reach& reach, const MatrixXd& q, Random& random) {
  if (!places.sockets.empty()) {
    Plate plate = plate_of(places);
    plate.allowed = reach.allowed;
    const Measurements touches = touch(plate, reach.ranges, q.cols(), random, robot);
    return {.robot = robot, .measurements = touches};
  }
  // The first of the stations is where the robot stands, where no distance depends on joint 1.
  robot = robot_at_stations(std::move(robot), places.stations + 1, random);
  robot.model.stations.pop_back();
  robot.truth.frames.bases.erase(robot.truth.frames.bases.begin());
  const Measurements points = measure(robot, q, {}, random);
  return {.robot = robot, .measurements = along_directions(points, places.directions)};
}

DeterminedByRows determined_by(const PlacedRows& rows) {
  const ErrorModel& model = rows.robot.model;
  const Estimate& truth = rows.robot.truth;
  const Unknowns free(model, truth.frames.targets, select_parameters(model, truth.frames.targets, {}).free);
  const MatrixXd J = LeastSquaresProblem(model, rows.measurements, free).whitened_summary(truth).sqrt_information;
  const Index bases = free.range(UnknownGroup::base).count;
  const MatrixXd Q = range_of(J.leftCols(bases));
  const MatrixXd arm = J.rightCols(J.cols() - bases);

  DeterminedByRows result;
  const std::vector<std::string> names = free.names();
  result.arm_names.assign(names.begin() + bases, names.end());
  result.arm = identifiability(scaled(arm - Q * (Q.transpose() * arm), arm), result.arm_names, {.tolerance = kNothing});
  for (Index station = 0; station < bases; station += 6) {
    result.bases.push_back(static_cast<int>(range_of(J.middleCols(station, 6)).cols()));
  }
  return result;
}

}  // namespace kdl_calibration
