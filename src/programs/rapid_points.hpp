#pragma once

#include <array>
#include <cstddef>
#include <numbers>
#include <vector>

#include "programs/program.hpp"

namespace kdl_calibration::rapid {

/// The axes of cf1, cf4 and cf6, and the angle of a quadrant [rad].
constexpr std::array<std::size_t, 3> kTurning = {0, 3, 5};
constexpr double kQuadrant = 0.5 * std::numbers::pi;

/// The places of RAPID modules with the frames that motions use, and the motions. Throws InputError.
Program program_of(const std::vector<ProgramText>& texts);

}  // namespace kdl_calibration::rapid
