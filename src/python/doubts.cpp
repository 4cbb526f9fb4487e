// Doubts, remarks, and statistics of errors.

#include <fmt/core.h>
#include <pybind11/stl.h>

#include "kdl_calibration/accuracy.hpp"
#include "kdl_calibration/doubt.hpp"
#include "python/bindings.hpp"
#include "python/file_names.hpp"
#include "python/keywords.hpp"

namespace kdl_calibration::python {
namespace {

py::list subjects_of(const Doubt& doubt) {
  py::list subjects;
  for (const Subject& subject : doubt.subjects) {
    subjects.append(py::make_tuple(to_string(subject.kind), subject.name));
  }
  return subjects;
}

py::dict figures_of(const Doubt& doubt) {
  py::dict figures;
  for (const NamedFigure& figure : doubt.figures) {
    figures[py::str(figure.name)] = figure.value;
  }
  return figures;
}

py::object message_of(const Doubt& doubt) { return message_text(in_keywords(doubt.message)); }

std::string statistics_text(const ErrorStatistics& errors) {
  return fmt::format("<ErrorStatistics of {}: rms {:.3g} m, mean {:.3g} m, p95 {:.3g} m, max {:.3g} m>", errors.count,
                     errors.rms, errors.mean, errors.p95, errors.max);
}

}  // namespace

void bind_doubts(py::module_& module) {
  py::class_<Doubt>(module, "Doubt", "A reason not to trust a result, or a remark about it.")
      .def_property_readonly(
          "cause", [](const Doubt& doubt) { return to_string(doubt.cause); },
          "A word, as in the result file: 'not_determined'.")
      .def_property_readonly("subjects", &subjects_of, "What it concerns: a list of (kind, name).")
      .def_property_readonly("figures", &figures_of, "Numbers that were found, by name, in SI units.")
      .def_property_readonly("message", &message_of, "What was found and what to do.")
      .def("__str__", &message_of)
      .def("__repr__", [](const Doubt& doubt) {
        return message_text("<Doubt " + std::string(to_string(doubt.cause)) + ": " + in_keywords(doubt.message) + ">");
      });

  py::class_<ErrorStatistics>(module, "ErrorStatistics", "Statistics of 3D position errors [m].")
      .def_readonly("count", &ErrorStatistics::count)
      .def_readonly("mean", &ErrorStatistics::mean)
      .def_readonly("rms", &ErrorStatistics::rms)
      .def_readonly("p95", &ErrorStatistics::p95)
      .def_readonly("max", &ErrorStatistics::max)
      .def_readonly("std", &ErrorStatistics::std)
      .def("__repr__", &statistics_text);
  py::class_<Iso9283>(module, "Iso9283", "Accuracy and repeatability of ISO 9283 [m].")
      .def_readonly("accuracy", &Iso9283::accuracy)
      .def_readonly("repeatability", &Iso9283::repeatability);
  py::class_<BeforeAfter>(module, "BeforeAfter", "Errors of the nominal and the calibrated robot.")
      .def_readonly("before", &BeforeAfter::before)
      .def_readonly("after", &BeforeAfter::after)
      .def_readonly("rigid", &BeforeAfter::rigid, "Of the exported URDF alone, if it differs; else None.");
  py::class_<Accuracy>(module, "Accuracy", "Position errors of fitted, test and left-out rows; None if there are none.")
      .def_readonly("train", &Accuracy::train)
      .def_readonly("train_means", &Accuracy::train_means)
      .def_readonly("test", &Accuracy::test)
      .def_readonly("test_means", &Accuracy::test_means)
      .def_readonly("test_at_fitted_poses", &Accuracy::test_at_fitted_poses)
      .def_readonly("test_at_new_poses", &Accuracy::test_at_new_poses)
      .def_readonly("iso_before", &Accuracy::iso_before)
      .def_readonly("iso_after", &Accuracy::iso_after)
      .def_readonly("iso_test_before", &Accuracy::iso_test_before)
      .def_readonly("iso_test_after", &Accuracy::iso_test_after)
      .def_readonly("leave_one_out", &Accuracy::leave_one_out)
      .def_readonly("nested_leave_one_out", &Accuracy::nested_leave_one_out)
      .def_readonly("k_fold", &Accuracy::k_fold)
      .def_readonly("folds", &Accuracy::folds)
      .def_property_readonly("held_out", &Accuracy::held_out, py::return_value_policy::reference_internal,
                             "Errors at unseen configurations: leave-one-out, else k-fold, else None.");
}

}  // namespace kdl_calibration::python
