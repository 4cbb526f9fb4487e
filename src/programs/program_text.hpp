#pragma once

#include <filesystem>
#include <string>

namespace kdl_calibration {

/// The bytes of a file of a robot program, of at most 512 MiB: about two million points. Throws InputError if it is
/// larger or cannot be read.
std::string read_program_text(const std::filesystem::path& path);

}  // namespace kdl_calibration
