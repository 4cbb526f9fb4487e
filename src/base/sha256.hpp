#pragma once

// SHA-256 (FIPS 180-4). Not installed.

#include <filesystem>
#include <string>
#include <string_view>

namespace kdl_calibration {

/// 64 lower-case hexadecimal digits.
std::string sha256(std::string_view bytes);
/// Hash of a file of any size, read in pieces. Throws InputError if it cannot be read.
std::string sha256_of_file(const std::filesystem::path& path);

}  // namespace kdl_calibration
