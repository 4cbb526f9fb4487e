#pragma once

#include <optional>
#include <string>

#include "cli/frames.hpp"

namespace kdl_calibration::cli {

/// The text under this key of a JSON object; empty if absent.
std::string text_at(const Json& object, const char* key);

/// Hash of the input file with this role; empty if the result names none.
std::optional<std::string> hash_of_input(const Json& result, const std::string& role);

/// Throws InputError if the result in the file `source` was made with another file of this role than that at `path`
/// (empty: none), by its hash. Nothing is required where the result names none.
void require_same_input(const Json& result, const std::string& source, const std::string& role,
                        const std::string& path);

/// Throws InputError if the result in the file `source` is one after its mastering was entered, and these are the
/// measurements from before.
void require_after_entry(const Json& result, const std::string& source, const std::string& measurements);

/// Warns if the result in the file `source` was made with another joint convention than that at `path`.
void warn_of_other_convention(const Json& result, const std::string& source, const std::string& path);
/// The same of the result in this file; nothing where a name is empty.
void warn_of_other_convention(const std::string& source, const std::string& path);

/// The text quoted as one word for a POSIX shell.
std::string shell_word(const std::string& text);

/// The command that plans further configurations for a result, with the files named in it; empty if it names none.
std::string plan_command(const Json& result);

/// The command that turns a result in this file into that of the robot after its joint zero offsets were entered.
std::string apply_command(const Json& result, const std::string& file);

}  // namespace kdl_calibration::cli
