#pragma once

#include <algorithm>
#include <cstddef>
#include <string>
#include <utility>
#include <vector>

#include "programs/program.hpp"

namespace kdl_calibration {

/// Adds a remark on these lines, in order and each once; none without a line.
inline void add_remark(std::vector<ProgramRemark>& remarks, std::string what, std::vector<std::size_t> lines,
                       std::size_t file = 0) {
  std::sort(lines.begin(), lines.end());
  lines.erase(std::unique(lines.begin(), lines.end()), lines.end());
  if (!lines.empty()) {
    remarks.push_back({.what = std::move(what), .lines = std::move(lines), .file = file});
  }
}

}  // namespace kdl_calibration
