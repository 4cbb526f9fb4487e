#include "cli/text.hpp"

#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <system_error>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {

std::optional<double> parsed_number(std::string_view text) {
  if (text.size() > 1 && text.front() == '+' && text[1] != '-') {
    text.remove_prefix(1);
  }
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) {
    return std::nullopt;
  }
  return value;
}

void print(std::string_view text) {
  const std::string written = escaped(text);
  errno = 0;
  if (std::fwrite(written.data(), 1, written.size(), stdout) != written.size() || std::fflush(stdout) != 0) {
    throw InputError("standard output cannot be written: " + std::generic_category().message(errno));
  }
}

namespace {

void say(const char* what, const std::string& text) {
  const std::string line = std::string("kdlcal: ") + what + ": " + one_line(text) + "\n";
  std::fwrite(line.data(), 1, line.size(), stderr);
}

}  // namespace

void inform(const std::string& text) { say("note", text); }

void warn(const std::string& text) { say("warning", text); }

void print_doubt(const std::string& text) { say("not to be trusted", text); }

void print_requirement(const std::string& text) { say("required", text); }

}  // namespace kdl_calibration::cli
