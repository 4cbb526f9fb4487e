#pragma once

#include <functional>
#include <string>

#include "kdl_calibration/calibrated_arm.hpp"
#include "python/arrays.hpp"

namespace kdl_calibration::python {

/// Calls work(i) for each row, without Python's lock and on several threads (0: one per core). Ctrl-C stops it. An
/// InputError names the first row that is refused.
void for_each_row(const Rows& rows, int threads, const std::function<void(std::size_t)>& work);

struct PredictionQuery {
  const py::object& q;
  std::string target;
  std::string frame;
  std::string station;
  int threads = 0;
};
/// Position, covariance, radius_95, outside, degrees_of_freedom.
py::tuple predictions(const CalibratedArm& arm, const PredictionQuery& query);
/// (N, 4, 4) or (4, 4).
py::array flange_poses(const CalibratedArm& arm, const py::object& joint_values, int threads);

constexpr const char* kPredictDocumentation =
    "Predicts a target's position and its uncertainty.\n\n"
    "q: (N, n) or (n,) joint values [rad or m]. frame: 'base', or 'measuring' of the measuring device; of several\n"
    "stations name one. Returns the named tuple Prediction: position (N, 3) [m], covariance (N, 3, 3) [m^2] by the\n"
    "parameters alone (infinite where not determined), radius_95 (N,) [m] of the sphere that holds a new measured\n"
    "point with 95 %, outside (N,): whether outside the measured region, where the radius does not hold, and\n"
    "degrees_of_freedom (N,) of the radius. For (n,) all without N.\n\n"
    "Raises InputError for other shapes, values that are not finite, and an unknown target or station.";

}  // namespace kdl_calibration::python
