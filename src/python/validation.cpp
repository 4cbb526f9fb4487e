// Validation, and comparison of two calibrations.

#include "kdl_calibration/validation.hpp"

#include <pybind11/stl.h>

#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/interruptible.hpp"
#include "python/keywords.hpp"
#include "python/options.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

namespace {

// Of a robot, or of a calibration with its effects.
template <class Subject>
PositionErrors validated(const Subject& subject, const Measurements& measurements, const py::kwargs& keywords) {
  const GivenValidation stated = validation_options(keywords);
  return interruptible([&](Interruption& interruption) {
    const ProgressFunction progress =
        progress_hook<const std::string&, std::size_t, std::size_t>(stated.progress, interruption);
    return validate(subject, measurements, stated.known, stated.diagnosis, progress);
  });
}

py::array changes_of(const Comparison& comparison) {
  const auto count = static_cast<py::ssize_t>(comparison.parameters.size());
  std::vector<std::string> names;
  std::vector<std::string> joints;
  std::vector<std::string> units;
  Doubles before(count);
  Doubles change(count);
  Doubles std(count);
  Doubles explained(count);
  for (py::ssize_t i = 0; i < count; ++i) {
    const ParameterChange& parameter = comparison.parameters[static_cast<std::size_t>(i)];
    names.push_back(parameter.name);
    joints.push_back(parameter.joint);
    units.push_back(parameter.unit);
    before.mutable_at(i) = parameter.before;
    change.mutable_at(i) = parameter.change;
    std.mutable_at(i) = parameter.std;
    explained.mutable_at(i) = parameter.explained;
  }
  return structured({{"name", text_array(names)},
                     {"joint", text_array(joints)},
                     {"unit", text_array(units)},
                     {"before", before},
                     {"change", change},
                     {"std", std},
                     {"explained", explained}},
                    count);
}

void bind_position_errors(py::module_& module) {
  py::class_<PositionErrors>(module, "PositionErrors", "How well a geometry explains measurements.")
      .def_readonly("all", &PositionErrors::all)
      .def_readonly("train", &PositionErrors::train)
      .def_readonly("test", &PositionErrors::test)
      .def_readonly("all_means", &PositionErrors::all_means)
      .def_readonly("train_means", &PositionErrors::train_means)
      .def_readonly("test_means", &PositionErrors::test_means)
      .def_readonly("iso_9283", &PositionErrors::iso_9283)
      .def_readonly("registered", &PositionErrors::registered, "The frames that were not known.")
      .def_readonly("rms_corrected", &PositionErrors::rms_corrected, "[m] corrected for the registration's unknowns.")
      .def_readonly("upper_95_factor", &PositionErrors::upper_95_factor)
      .def_readonly("upper_95_factor_of_test", &PositionErrors::upper_95_factor_of_test)
      .def_property_readonly("warnings", [](const PositionErrors& errors) { return message_texts(errors.warnings); })
      .def_readonly("doubts", &PositionErrors::doubts)
      .def_property_readonly(
          "bases",
          [](const PositionErrors& errors) {
            py::list poses;
            for (const Eigen::Isometry3d& X_WB : errors.frames.bases) {
              poses.append(pose_array(X_WB));
            }
            return poses;
          },
          "(4, 4) the base in the measuring frame, of each station [m].")
      .def_property_readonly(
          "targets",
          [](const PositionErrors& errors) {
            py::dict poses;
            for (const TargetFrame& target : errors.frames.targets) {
              poses[py::str(target.name)] = pose_array(target.X_FT);
            }
            return poses;
          },
          "(4, 4) each target in the flange frame [m], by name.");
}

}  // namespace

void bind_validation(py::module_& module) {
  bind_position_errors(module);
  module.def(
      "validate",
      [](const Robot& robot, const std::shared_ptr<Measurements>& measurements, const py::kwargs& keywords) {
        return validated(robot, *named(measurements, robot), keywords);
      },
      "robot"_a, "measurements"_a.none(false),
      "Position errors of a robot, or of a calibration, at measurements. Only base and targets are fitted.\n\n"
      "Keywords: known = {'bases': {'W': (4, 4)}, 'targets': {'A': (3,)}}, diagnosis = {'try_readings': False},\n"
      "progress = f(what, done, of).");
  module.def(
      "validate",
      [](const Found& found, const std::shared_ptr<Measurements>& measurements, const py::kwargs& keywords) {
        return validated(found.calibration, *named(measurements, *found.robot), keywords);
      },
      "calibration"_a, "measurements"_a.none(false));

  py::class_<Comparison>(module, "Comparison", "The difference of two calibrations of one robot.")
      .def_readonly("chi_square", &Comparison::chi_square)
      .def_readonly("degrees_of_freedom", &Comparison::degrees_of_freedom)
      .def_readonly("p_value", &Comparison::p_value, "Of an unchanged robot.")
      .def_property_readonly("has_changed", &Comparison::has_changed, "Whether the p-value is below 0.001.")
      .def_property_readonly("parameters", &changes_of,
                             "Structured array: name, joint, unit, before, change, std (1 sigma), explained.")
      .def_readonly("unseen_zeros", &Comparison::unseen_zeros, "Joints whose zero may have changed without a trace.")
      .def_readonly("not_compared", &Comparison::not_compared)
      .def_readonly("same_measurements", &Comparison::same_measurements)
      .def_readonly("flange", &Comparison::flange, "Change of the flange's position [m].")
      .def_readonly("flange_sigma", &Comparison::flange_sigma, "[m] RMS 3D 1 sigma of this change.");
  module.def(
      "compare", [](const Found& before, const Found& after) { return compare(before.calibration, after.calibration); },
      "before"_a, "after"_a,
      "Whether a robot has changed between two calibrations. Raises InputError for different robots, and for a\n"
      "calibration that is not trusted or has no covariance.");
}

}  // namespace kdl_calibration::python
