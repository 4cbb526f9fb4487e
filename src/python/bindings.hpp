#pragma once

// The parts of the module.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/whole_files.hpp"
#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration::python {

namespace py = pybind11;

/// A calibration with what the functions that write it need beside it.
struct Found {
  Calibration calibration;
  std::shared_ptr<const Robot> robot;
  std::shared_ptr<const Measurements> measurements;  ///< null if it was read from a file
  std::string text = {};                             ///< of that file
  std::string file = {};                             ///< its name
  py::dict own = {};                                 ///< its effects that are functions of the caller's own
  Circumstances circumstances = {};                  ///< that `at` was given
  std::shared_ptr<const Found> origin = {};          ///< the one that `at` was called of, else null
  mutable std::optional<CalibratedArm> made_arm = {};

  const CalibratedArm& arm() const {
    if (!made_arm) {
      made_arm.emplace(calibration.arm());
    }
    return *made_arm;
  }
  /// Throws InputError if the calibration was read from a file.
  const Measurements& fitted() const;
};

/// Files that a calibration was made from, which nothing that it writes may replace.
std::vector<NamedFile> files_of(const Found& found);

/// The measurements with the robot's joint names, if they have none. Throws InputError for temperatures of links that
/// the robot does not have.
std::shared_ptr<const Measurements> named(const std::shared_ptr<const Measurements>& measurements, const Robot& robot);

/// A structured array of the observations: their labels, then these columns.
py::array observation_table(const Measurements& measurements,
                            const std::vector<std::pair<std::string, py::array>>& columns);

void bind_robot(py::module_& module);
void bind_measurements(py::module_& module);
void bind_doubts(py::module_& module);
void bind_arm(py::module_& module);
void bind_calibration(py::module_& module);
void bind_planning(py::module_& module);
void bind_compensation(py::module_& module);
void bind_programs(py::module_& module);
void bind_validation(py::module_& module);

}  // namespace kdl_calibration::python
