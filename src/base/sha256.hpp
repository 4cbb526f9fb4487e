#pragma once

// SHA-256 (FIPS 180-4).

#include <nettle/sha2.h>

#include <cstdio>
#include <filesystem>
#include <string>
#include <string_view>

namespace kdl_calibration {

/// The hash of bytes that come in pieces.
class Sha256 {
public:
  Sha256();
  void add(std::string_view bytes);
  /// 64 lower-case hexadecimal digits; starts anew.
  std::string hexadecimal();

private:
  sha256_ctx state_{};
};

/// 64 lower-case hexadecimal digits.
std::string sha256(std::string_view bytes);
/// Hash of the rest of an open file of any size, read in pieces. Throws InputError, naming `source`, if it cannot be
/// read.
std::string sha256_of(std::FILE* file, const std::string& source);
/// The same of a file that becomes an input by it (see open_file).
std::string sha256_of_file(const std::filesystem::path& path);

}  // namespace kdl_calibration
