#include "cli/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <utility>

namespace kdl_calibration::cli {
namespace {

void write(const std::string& text) {
  std::fwrite(text.data(), 1, text.size(), stderr);
  std::fflush(stderr);
}

}  // namespace

Progress::Progress(std::string label)
    : label_(std::move(label)), start_(std::chrono::steady_clock::now()), terminal_(::isatty(STDERR_FILENO) == 1) {}

Progress::~Progress() {
  if (shown_ >= 0) {
    write("\r\033[K");
  }
}

void Progress::operator()(double share) {
  constexpr int kWidth = 40;
  const int percent = static_cast<int>(100.0 * std::clamp(share, 0.0, 1.0));
  if (!terminal_ || percent == shown_ || std::chrono::steady_clock::now() - start_ < std::chrono::seconds(1)) {
    return;
  }
  shown_ = percent;
  const auto full = static_cast<std::size_t>(percent * kWidth / 100);
  write("\r" + label_ + " [" + std::string(full, '#') + std::string(kWidth - full, ' ') + "] " +
        std::to_string(percent) + " %");
}

}  // namespace kdl_calibration::cli
