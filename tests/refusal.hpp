#pragma once

#include <string>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::testing {

/// What the call is refused with; says so where it is not.
template <class Call>
std::string refusal(Call&& call) {
  try {
    call();
  } catch (const InputError& error) {
    return error.what();
  }
  return "nothing was refused";
}

}  // namespace kdl_calibration::testing
