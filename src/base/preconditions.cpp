#include "base/preconditions.hpp"

#include <cmath>

#include "base/number_range.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {

void refuse_input(const std::string& what, const std::string& expected) {
  throw InputError(what + ", expected " + expected);
}

void require_sigma(const char* what, double sigma) {
  if (!std::isfinite(sigma) || sigma < 0.0) {
    refuse_input(std::string(what) + " is negative or not finite", "0 or more");
  }
  if (sigma > kLargestNumber) {
    refuse_input(std::string(what) + " is out of range", "at most 1e12");
  }
}

void require_finite(const char* what, bool are_finite) {
  if (!are_finite) {
    refuse_input(std::string(what) + " has a value that is not finite", "finite ones");
  }
}

}  // namespace kdl_calibration
