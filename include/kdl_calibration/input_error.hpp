#pragma once

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace kdl_calibration {

/// Bad input, told in one line: where (file, line or element), what (the value) and the rule it broke.
/// The only exception that the library throws for what a user gave it; a poor solve is a result instead.
class InputError : public std::runtime_error {
public:
  explicit InputError(const std::string& message) : std::runtime_error(message) {}
};

/// Bad input in one member of CalibrationOptions, by whatever name an interface lets its users state that.
class OptionError : public InputError {
public:
  /// `option`: the member, as in "noise.orientation"; `remedies`: members that would mend it.
  OptionError(std::string option, std::string fault, std::vector<std::string> remedies = {})
      : InputError(option + ": " + fault),
        option_(std::move(option)),
        fault_(std::move(fault)),
        remedies_(std::move(remedies)) {}

  const std::string& option() const { return option_; }
  const std::string& fault() const { return fault_; }
  const std::vector<std::string>& remedies() const { return remedies_; }

private:
  std::string option_;
  std::string fault_;
  std::vector<std::string> remedies_;
};

}  // namespace kdl_calibration
