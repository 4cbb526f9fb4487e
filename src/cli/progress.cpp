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
  const int percent = static_cast<int>(100.0 * std::clamp(share, 0.0, 1.0));
  if (percent != shown_ && due()) {
    show(percent, std::to_string(percent) + " %");
  }
}

void Progress::operator()(const std::string& what, std::size_t done, std::size_t of) {
  const std::size_t most = std::max<std::size_t>(of, 1);
  const int percent = static_cast<int>(100 * std::min(done, most) / most);
  if ((percent != shown_ || what != label_) && due()) {
    label_ = what;
    show(percent, std::to_string(done) + "/" + std::to_string(of));
  }
}

// Work of less than a second needs no bar.
bool Progress::due() const { return terminal_ && std::chrono::steady_clock::now() - start_ >= std::chrono::seconds(1); }

void Progress::show(int percent, const std::string& behind) {
  constexpr int kWidth = 40;
  shown_ = percent;
  const auto full = static_cast<std::size_t>(percent * kWidth / 100);
  write("\r" + label_ + " [" + std::string(full, '#') + std::string(kWidth - full, ' ') + "] " + behind + "\033[K");
}

}  // namespace kdl_calibration::cli
