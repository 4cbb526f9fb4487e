#pragma once

#include <string>

#include "cli/frames.hpp"

namespace kdl_calibration::cli {

/// The text that a JSON object has under this key; empty where it has none.
std::string text_at(const Json& object, const char* key);

/// A word of a command as a POSIX shell reads it back.
std::string shell_word(const std::string& text);

/// The command that chooses further configurations for a result, with the files that the result names; empty where it
/// names none.
std::string plan_command(const Json& result);

}  // namespace kdl_calibration::cli
