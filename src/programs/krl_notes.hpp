#pragma once

// What a user has to know of a program in the KUKA Robot Language.

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

#include "programs/program.hpp"

namespace kdl_calibration::krl {

enum class Note : std::uint8_t {
  // Motions and statements.
  computed_place,
  other_file,
  increment,
  circle_angle,
  computed_frame,
  computed_data,
  moving_base,
  uncertain_frame,
  own_frame_data,
  copied,
  handed_on,
  correction,
  sensor,
  root_set,
  // Points.
  changed,
  partial,
  computed_component,
  in_cell,
  two_frames,
  run_time_frame,
  unused,
  accurate_robot,
  count
};

/// Lines by note and text.
class Notes {
public:
  void add(Note note, std::size_t file, std::size_t line) {
    lines_[static_cast<std::size_t>(note)][file].push_back(line);
  }

  std::vector<ProgramRemark> remarks() const;

private:
  std::array<std::map<std::size_t, std::vector<std::size_t>>, static_cast<std::size_t>(Note::count)> lines_;
};

}  // namespace kdl_calibration::krl
