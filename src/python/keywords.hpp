#pragma once

#include <pybind11/pybind11.h>

#include <string>
#include <vector>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::python {

/// The message with Python's keywords instead of options of kdlcal ("--near"). Names of files stay.
std::string in_keywords(std::string message);
/// The same of an error; its option with the structure that holds it ("estimator.method").
std::string in_keywords(const InputError& error);
/// A list of such messages.
pybind11::list message_texts(const std::vector<std::string>& messages);

}  // namespace kdl_calibration::python
