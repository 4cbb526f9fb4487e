#pragma once

// Whole files.

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

namespace kdl_calibration {

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

/// Throws InputError with the system's reason if the file cannot be opened.
File open_file(const std::filesystem::path& path);

/// Reads `count` bytes, or fewer at the end of the file. Throws InputError on failure.
std::size_t read_bytes(std::FILE* file, char* bytes, std::size_t count, const std::string& source);

/// The bytes of a file of at most 64 MiB. Throws InputError if it is larger or cannot be read.
std::string read_text_file(const std::filesystem::path& path);

/// Writes the text to a temporary file beside `path` and renames it, so that the old or the new file is there at any
/// moment. Throws InputError if it cannot be written, or if it is the file `read`.
void replace_file(const std::filesystem::path& path, std::string_view text, const std::filesystem::path& read);

}  // namespace kdl_calibration
