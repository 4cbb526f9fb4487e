// The Python package's module of C++: kdl_calibration._native.

#include <exception>
#include <utility>

#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/version.hpp"
#include "python/bindings.hpp"
#include "python/file_names.hpp"
#include "python/keywords.hpp"

// pybind11 calls it.
PYBIND11_MODULE(_native, module) {  // NOLINT(readability-identifier-naming)
  using namespace kdl_calibration::python;
  module.doc() = "Kinematic calibration of robot arms: the C++ library.";
  module.attr("__version__") = kdl_calibration::version();
  const auto& error = py::register_exception<kdl_calibration::InputError>(module, "InputError", PyExc_ValueError);
  error.doc() = "Bad input, in one line: what, where, what was expected.";
  error.attr("__module__") = "kdl_calibration";
  // Comes before the translator that the line above registers: messages in the words of Python.
  static PyObject* const type = error.ptr();  // which lives as long as the module
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      std::rethrow_exception(std::move(thrown));
    } catch (const kdl_calibration::InputError& input) {
      PyErr_SetObject(type, message_text(in_keywords(input)).ptr());
    }
  });
  bind_robot(module);
  bind_measurements(module);
  bind_doubts(module);
  bind_arm(module);
  bind_calibration(module);
  bind_planning(module);
  bind_compensation(module);
  bind_programs(module);
  bind_validation(module);
}
