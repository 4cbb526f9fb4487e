#include "cli/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <utility>

namespace kdl_calibration::cli {
namespace {

constexpr double kUntilABar = 1.0;      // [s]
constexpr double kBetweenLines = 10.0;  // [s]

void write(const std::string& text) {
  std::fwrite(text.data(), 1, text.size(), stderr);
  std::fflush(stderr);
}

std::function<double()> seconds_from_now() {
  using Clock = std::chrono::steady_clock;
  return [start = Clock::now()] { return std::chrono::duration<double>(Clock::now() - start).count(); };
}

}  // namespace

Progress::Progress(std::string label, std::function<double()> elapsed)
    : label_(std::move(label)),
      elapsed_(elapsed ? std::move(elapsed) : seconds_from_now()),
      terminal_(::isatty(STDERR_FILENO) == 1),
      next_(terminal_ ? kUntilABar : kBetweenLines) {}

Progress::~Progress() {
  if (terminal_ && shown_ >= 0) {
    write("\r\033[K");
  }
}

void Progress::operator()(double share) {
  const int percent = static_cast<int>(100.0 * std::clamp(share, 0.0, 1.0));
  say(label_, percent, std::to_string(percent) + " %");
}

void Progress::operator()(const std::string& what, std::size_t done, std::size_t of) {
  const std::size_t most = std::max<std::size_t>(of, 1);
  say(what, static_cast<int>(100 * std::min(done, most) / most), std::to_string(done) + "/" + std::to_string(of));
}

void Progress::say(const std::string& what, int percent, const std::string& amount) {
  constexpr int kWidth = 40;
  const double now = elapsed_();
  if (now < next_ || (terminal_ && percent == shown_ && what == label_)) {
    return;
  }
  label_ = what;
  shown_ = percent;
  if (!terminal_) {
    next_ = now + kBetweenLines;
    write("kdlcal: " + what + ": " + amount + " done\n");
    return;
  }
  const auto full = static_cast<std::size_t>(percent * kWidth / 100);
  write("\r" + what + " [" + std::string(full, '#') + std::string(kWidth - full, ' ') + "] " + amount + "\033[K");
}

}  // namespace kdl_calibration::cli
