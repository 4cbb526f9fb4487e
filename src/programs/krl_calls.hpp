#pragma once

// Calls of routines in the KUKA Robot Language.

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration::krl {

struct Parameter {
  std::string name;           ///< in upper case
  bool is_reference = false;  ///< OUT: the routine may change the argument
};
/// Of "DEF NAME(A :IN,B :OUT)". Without IN a parameter is taken by reference.
std::vector<Parameter> parameters_of(std::string_view head);

struct Call {
  std::string name;  ///< of the routine, in upper case
  std::vector<std::string_view> arguments;
  std::size_t routine = 0;  ///< from which it is called
};
/// The calls in a line, also those of functions.
std::vector<Call> calls_in(std::string_view line, std::size_t routine);

}  // namespace kdl_calibration::krl
