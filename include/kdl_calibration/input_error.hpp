#pragma once

// The exception for bad input.
//
//     try { calibrate(robot, measurements); } catch (const InputError& error) { std::cerr << error.what() << "\n"; }

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

/// Bad input, reported in one line: place (file, line or element), value and violated rule. The library throws no other
/// exception for bad input. A poor fit is reported in the result instead.
class InputError : public std::runtime_error {
public:
  explicit InputError(const std::string& message) : std::runtime_error(message) {}
};

/// A bad member of CalibrationOptions; each interface replaces the member by its own name for it.
class OptionError : public InputError {
public:
  /// `option`: the member, for example "noise.orientation"; `remedies`: members that would solve the problem.
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
