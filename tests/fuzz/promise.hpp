#pragma once

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::fuzzing {

inline void promise(bool kept, const std::string& what) {
  if (!kept) {
    std::fprintf(stderr, "broken promise: %s\n", what.c_str());
    std::abort();
  }
}

/// Runs `work`. An InputError must be one line of at most a few hundred characters beside the names that it quotes.
template <class Work>
void let_input_errors_pass(const Work& work) {
  try {
    work();
  } catch (const InputError& error) {
    const std::string message = error.what();
    const auto is_control = [](char c) { return static_cast<unsigned char>(c) < 0x20U; };
    promise(!message.empty() && std::none_of(message.begin(), message.end(), is_control), "one line: " + message);
  }
}

}  // namespace kdl_calibration::fuzzing
