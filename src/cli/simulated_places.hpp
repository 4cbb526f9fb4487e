#pragma once

#include <CLI/App.hpp>
#include <cstdint>

#include "cli/simulate_arguments.hpp"
#include "planning/places.hpp"
#include "planning/simulation.hpp"

namespace kdl_calibration::cli {

/// --stations, --sockets, --directions
void add_place_options(CLI::App& app, PlaceArguments& arguments);
/// --plate-horizontal, --plate-heights
void add_plate_options(CLI::App& app, PlaceArguments& arguments);

/// Throws InputError for unknown directions, and for directions beside sockets.
void require_directions(const PlaceArguments& arguments);
/// Throws InputError for options that several places or a plate do not support.
void require_places(const SimulateArguments& arguments);

/// Throws InputError unless the robot that sets its ball into sockets has one target.
void require_one_ball(const PlaceArguments& arguments, std::size_t targets);

/// With the sockets of --sockets.
Places places_of(const PlaceArguments& arguments);

}  // namespace kdl_calibration::cli
