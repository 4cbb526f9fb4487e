#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "programs/add_remark.hpp"
#include "programs/program.hpp"

namespace kdl_calibration {

/// Takes the points out of which is_left(point) says so: they stay as they are, motions to them end at an unknown
/// place, and a remark names their lines.
template <typename IsLeft>
void leave_out_points(Program& program, const std::string& because, const IsLeft& is_left) {
  std::map<std::size_t, std::vector<std::size_t>> lines;  // of each file
  std::vector<std::optional<std::size_t>> moved_to(program.points.size());
  std::vector<ProgramPoint> kept;
  for (std::size_t i = 0; i < program.points.size(); ++i) {
    ProgramPoint& point = program.points[i];
    if (is_left(std::as_const(point))) {
      lines[point.file].push_back(point.line);
    } else {
      moved_to[i] = kept.size();
      kept.push_back(std::move(point));
    }
  }
  program.points = std::move(kept);
  for (ProgramMotion& motion : program.motions) {
    motion.point = motion.point ? moved_to[*motion.point] : std::nullopt;
    motion.is_known = motion.is_known && motion.point;
  }
  for (auto& [file, of_file] : lines) {
    add_remark(program.remarks, because, std::move(of_file), file);
  }
}

}  // namespace kdl_calibration
