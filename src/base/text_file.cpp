#include "base/text_file.hpp"

#include <array>
#include <cerrno>
#include <cstdint>
#include <system_error>
#include <utility>

#include "base/text.hpp"
#include "base/units.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

NoteInput input_note;

[[noreturn]] void fail(const std::string& source, const std::string& what, int error) {
  throw InputError(source + ": " + what + ": " + std::generic_category().message(error));
}

}  // namespace

void note_inputs(NoteInput note) { input_note = std::move(note); }

void note_input(const std::filesystem::path& file, const std::string& why, const std::string& sha256) {
  if (input_note) {
    input_note(file, why, sha256);
  }
}

File open_file(const std::filesystem::path& path) {
  if (path.native().find('\0') != std::string::npos) {  // the system would open the file named by the part before it
    throw InputError(one_line(path.string()) + ": has a NUL byte in its name, expected a file name");
  }
  File file(std::fopen(path.c_str(), "rb"));
  if (!file) {
    fail(path.string(), "cannot be opened", errno);
  }
  note_input(path, "this run reads");
  return file;
}

std::size_t read_bytes(std::FILE* file, char* bytes, std::size_t count, const std::string& source) {
  const std::size_t read = std::fread(bytes, 1, count, file);
  if (std::ferror(file) != 0) {
    fail(source, "cannot be read", errno);
  }
  return read;
}

std::string read_text_file(const std::filesystem::path& path, std::size_t most) {
  const auto check = [&](std::uintmax_t size) {
    if (size > most << 20U) {
      throw InputError(path.string() + ": larger than the limit of " + std::to_string(most) + " MiB");
    }
  };
  const File file = open_file(path);
  std::string text;
  // A known size (not of pipes) allows early refusal of large files and avoids reallocation.
  std::error_code no_size;
  if (const std::uintmax_t size = std::filesystem::file_size(path, no_size); !no_size) {
    check(size);
    text.reserve(size);
  }
  std::array<char, 16384> buffer{};
  while (const std::size_t read = read_bytes(file.get(), buffer.data(), buffer.size(), path.string())) {
    text.append(buffer.data(), read);
    check(text.size());
  }
  return text;
}

std::string lower_ending(const std::filesystem::path& file) { return lower_case(file.extension().string()); }

}  // namespace kdl_calibration
