#pragma once

#include <stdexcept>
#include <string>

namespace kdl_calibration {

/// Bad input, told in one line: where (file, line or element), what (the value) and the rule it broke.
/// The only exception that the library throws for what a user gave it; a poor solve is a result instead.
class InputError : public std::runtime_error {
public:
  explicit InputError(const std::string& message) : std::runtime_error(message) {}
};

}  // namespace kdl_calibration
