#pragma once

#include <string>

#include "cli/frames.hpp"

namespace kdl_calibration::cli {

/// The text under this key of a JSON object; empty if absent.
std::string text_at(const Json& object, const char* key);

/// The text quoted as one word for a POSIX shell.
std::string shell_word(const std::string& text);

/// The command that plans further configurations for a result, with the files named in it; empty if it names none.
std::string plan_command(const Json& result);

}  // namespace kdl_calibration::cli
