#pragma once

// Files that are read whole. Not installed.

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

namespace kdl_calibration {

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

/// Throws InputError with the system's reason where the file cannot be opened.
File open_file(const std::filesystem::path& path);

/// Reads until `count` bytes are there or the file ends. Throws InputError where that fails.
std::size_t read_bytes(std::FILE* file, char* bytes, std::size_t count, const std::string& source);

/// The bytes of a file of at most 64 MiB. Throws InputError where it is larger or cannot be read.
std::string read_text_file(const std::filesystem::path& path);

}  // namespace kdl_calibration
