#pragma once

// Options of the library from keywords of the same names. A structure is a dict of its members.

#include <pybind11/pybind11.h>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measuring_plan.hpp"
#include "kdl_calibration/simulation.hpp"
#include "kdl_calibration/validation.hpp"
#include "programs/compensated_program.hpp"
#include "python/bindings.hpp"
#include "python/interruptible.hpp"

namespace kdl_calibration::python {

/// Each throws TypeError for an unknown name, with the known ones, and for a value of another type.

struct GivenCalibrationOptions {
  CalibrationOptions options;            ///< without `progress`
  std::shared_ptr<const Found> earlier;  ///< keeps priors.earlier alive
  py::dict own;                          ///< effects.own as given
  py::object progress = py::none();
};
GivenCalibrationOptions calibration_options(const py::dict& keywords);

struct GivenPlanOptions {
  PlanOptions options;                 ///< without `progress`
  std::shared_ptr<const Found> after;  ///< keeps options.after alive
  py::object progress = py::none();
};
GivenPlanOptions plan_options(const py::dict& keywords);

SimulationOptions simulation_options(const py::dict& keywords);
CompensationOptions compensation_options(const py::dict& keywords);

/// What `compensate_program` takes.
struct GivenProgram {
  CompensationOptions options;
  std::optional<std::filesystem::path> controller;
  std::optional<std::variant<std::filesystem::path, JointConvention>> joint_convention;
  std::optional<std::filesystem::path> frames_file;
  ProgramFrames frames;  ///< without a file
  py::dict external_axes;
  py::object near = py::none();  ///< (n,)
  double line_tolerance = kLineTolerance;
};
GivenProgram program_options(const py::dict& keywords);

/// What `validate` takes: known frames and the options of the diagnosis.
struct GivenValidation {
  KnownFrames known;
  DiagnosisOptions diagnosis;
  py::object progress = py::none();
};
GivenValidation validation_options(const py::dict& keywords);

/// A dict of names and {'joint': name, 'axis': 'own', 'x', 'y' or 'along', 'function': (N, n) -> (N,) or (N, K)}.
std::vector<OwnEffect> own_effects(const py::handle& given, const std::string& where);
/// A copy of that dict that nothing outside changes.
py::dict copy_of_effects(const py::dict& own);

/// A dict of names and positions (3,), or poses (4, 4) of targets with orientation.
std::vector<TargetFrame> target_frames(const py::handle& given, const std::string& where);

}  // namespace kdl_calibration::python
