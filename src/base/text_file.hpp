#pragma once

// Reading of whole files.

#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>

namespace kdl_calibration {

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;

/// `note` is called with each file that is an input from now on, and why: open_file opens it, or a result was made from
/// it, whose hash is then known. By default nothing is noted: a program that uses the library may replace a file that
/// it has read.
using NoteInput =
    std::function<void(const std::filesystem::path& file, const std::string& why, const std::string& sha256)>;
void note_inputs(NoteInput note);
void note_input(const std::filesystem::path& file, const std::string& why, const std::string& sha256 = {});

/// The ending of a file's name in small letters: ".json".
std::string lower_ending(const std::filesystem::path& file);

/// Throws InputError with the system's reason if the file cannot be opened.
File open_file(const std::filesystem::path& path);

/// Reads `count` bytes, or fewer at the end of the file. Throws InputError on failure.
std::size_t read_bytes(std::FILE* file, char* bytes, std::size_t count, const std::string& source);

/// The bytes of a file of at most so many MiB. Throws InputError if it is larger or cannot be read.
std::string read_text_file(const std::filesystem::path& path, std::size_t most = 64);

}  // namespace kdl_calibration
