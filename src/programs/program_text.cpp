#include "programs/program_text.hpp"

#include <cstdint>
#include <system_error>

#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {

std::string read_program_text(const std::filesystem::path& path) {
  constexpr std::size_t kMost = std::size_t{512} << 20U;
  constexpr std::size_t kAtOnce = std::size_t{1} << 20U;
  const auto check = [&](std::uintmax_t size) {
    if (size > kMost) {
      throw InputError(path.string() + ": larger than the limit of 512 MiB");
    }
  };
  const File file = open_file(path);
  std::string text;
  std::error_code no_size;
  if (const std::uintmax_t size = std::filesystem::file_size(path, no_size); !no_size) {
    check(size);
    text.reserve(size + kAtOnce);
  }
  for (std::size_t read = kAtOnce; read > 0;) {
    const std::size_t before = text.size();
    text.resize(before + kAtOnce);
    read = read_bytes(file.get(), text.data() + before, kAtOnce, path.string());
    text.resize(before + read);
    check(text.size());
  }
  return text;
}

}  // namespace kdl_calibration
