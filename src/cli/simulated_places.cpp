#include "cli/simulated_places.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <string_view>
#include <tuple>
#include <utility>

#include "base/text.hpp"
#include "cli/cell_options.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {

namespace {
constexpr std::string_view kAxes = "xyz";
constexpr std::string_view kDistance = "r";
}  // namespace

void add_place_options(CLI::App& app, PlaceArguments& arguments) {
  add_count(app, "--stations", arguments.stations, {1, 100},
            "Places of the tracker, or with --sockets of the plate; each measures its share of the configurations");
  add_file(app, "--sockets", arguments.sockets,
           "Set the only target, a ball, into the sockets of a plate: their centres {\"targets\": [{\"name\", "
           "\"position\"}]} in its frame");
  app.add_option(
      "--directions", arguments.directions,
      "Coordinates that are measured: x, y, z, two of them, or r, the distance from the origin of the station [xyz]");
}

void add_plate_options(CLI::App& app, PlaceArguments& arguments) {
  app.add_flag("--plate-horizontal", arguments.plate_horizontal, "The plate lies: its z axis is the base's")
      ->needs("--sockets");
  app.add_option("--plate-heights", arguments.plate_heights,
                 "Where the origin of its frame may be above the base, lowest:highest in m")
      ->type_name("RANGE")
      ->needs("--sockets");
}

void require_directions(const PlaceArguments& arguments) {
  const std::string& directions = arguments.directions;
  if (directions != kDistance &&
      (directions.empty() || !std::includes(kAxes.begin(), kAxes.end(), directions.begin(), directions.end()))) {
    throw InputError("--directions: " + shown(directions) +
                     ", expected r, or some of xyz, each once and in this order");
  }
  if (directions != kAxes && !arguments.sockets.empty()) {
    throw InputError("--directions: a socket holds the whole point, expected none with --sockets");
  }
}

void require_one_ball(const PlaceArguments& arguments, std::size_t targets) {
  if (!arguments.sockets.empty() && targets != 1) {
    throw InputError(fmt::format("--sockets: {} targets, expected one, a ball (--targets 1)", targets));
  }
}

void require_places(const SimulateArguments& arguments) {
  require_directions(arguments.places);
  const bool single = arguments.places.directions != kAxes;
  if (single && (arguments.two_step > 0 || arguments.monte_carlo > 0 || arguments.poses)) {
    throw InputError(
        "--directions: are of points that are written, expected none with --poses, --two-step, --monte-carlo");
  }
  const bool touches = !arguments.places.sockets.empty();
  if (arguments.places.stations > 1 && (arguments.two_step > 0 || arguments.monte_carlo > 0)) {
    throw InputError("--stations: are of measurements that are written, expected none with --two-step, --monte-carlo");
  }
  if (arguments.touches_of_plan &&
      (touches || arguments.poses || arguments.noise.repeats > 1 || arguments.order ||
       arguments.test_configurations > 0 || arguments.two_step > 0 || arguments.monte_carlo > 0)) {
    throw InputError("--plan: " + arguments.plan +
                     " sets a ball into the sockets of a plate, each once, expected none of --sockets, --poses, "
                     "--order, --repeats, --test-configurations, --two-step, --monte-carlo");
  }
  if (touches && (arguments.two_step > 0 || arguments.monte_carlo > 0 || arguments.test_configurations > 0 ||
                  !arguments.plan.empty() || arguments.poses || arguments.order || arguments.noise.repeats > 1)) {
    throw InputError(
        "--sockets: poses that touch a plate are drawn, each once, expected none of --plan, --poses, "
        "--order, --repeats, --test-configurations, --two-step, --monte-carlo");
  }
}

Places places_of(const PlaceArguments& arguments) {
  Places places{
      .stations = arguments.stations, .horizontal = arguments.plate_horizontal, .directions = arguments.directions};
  if (!arguments.plate_heights.empty()) {
    std::tie(places.lowest, places.highest) =
        bounds("--plate-heights", arguments.plate_heights, "lowest:highest in metres");
  }
  if (!arguments.sockets.empty()) {
    for (const TargetFrame& socket : read_targets(arguments.sockets)) {
      places.sockets.emplace_back(socket.X_FT.translation());
    }
  }
  return places;
}

}  // namespace kdl_calibration::cli
