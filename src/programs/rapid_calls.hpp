#pragma once

// Calls of routines in RAPID, and what they change.

#include <cstddef>
#include <string>
#include <vector>

#include "programs/rapid_modules.hpp"

namespace kdl_calibration::rapid {

/// An argument that names data, or a component or an element of data.
struct CallArgument {
  std::string name;        ///< in lower case; empty for a value
  std::string option;      ///< "path" of \path:=p10; empty for others
  std::size_t number = 0;  ///< among those without option
  bool is_whole = false;   ///< no component
};

struct Call {
  std::string routine;  ///< in lower case
  Instruction at;       ///< without arguments
  bool is_statement = false;
  std::vector<CallArgument> arguments;
};

/// The calls in a text that the modules hold, in its order: those of their routines, and statements of other names but
/// motions and RETURN. A call of a routine that takes no parameter by reference is left out.
std::vector<Call> calls_in(const ProgramText& text, std::size_t file, const Modules& modules);

/// The arguments that a call hands to the parameters by reference of which `is_set(scope, name)` is true.
template <typename IsSet>
std::vector<std::string> changed_arguments(const Call& call, const Modules& modules, const IsSet& is_set) {
  std::vector<std::string> changed;
  for (const Routine* routine : modules.routines_of(call.routine)) {
    std::size_t number = 0;
    for (const Parameter& parameter : routine->parameters) {
      for (const CallArgument& argument : call.arguments) {
        const bool is_bound = parameter.is_optional ? argument.option == parameter.name
                                                    : argument.option.empty() && argument.number == number;
        if (is_bound && parameter.is_reference && !argument.name.empty() && is_set(routine->scope, parameter.name)) {
          changed.push_back(argument.name);
        }
      }
      number += parameter.is_optional ? 0 : 1;
    }
  }
  return changed;
}

}  // namespace kdl_calibration::rapid
