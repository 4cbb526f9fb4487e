#include "cli/simulated_places.hpp"

#include <utility>

#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {

void add_place_options(CLI::App& app, PlaceArguments& arguments) {
  add_count(app, "--stations", arguments.stations, {1, 100},
            "Places of the tracker, or with --sockets of the plate; each measures its share of the configurations");
  add_file(app, "--sockets", arguments.sockets,
           "Set the only target, a ball, into the sockets of a plate: their centres {\"targets\": [{\"name\", "
           "\"position\"}]} in its frame");
}

void require_places(const SimulateArguments& arguments) {
  const bool touches = !arguments.places.sockets.empty();
  if (arguments.places.stations > 1 && (arguments.two_step > 0 || arguments.monte_carlo > 0)) {
    throw InputError("--stations: are of measurements that are written, expected none with --two-step, --monte-carlo");
  }
  if (touches && (arguments.two_step > 0 || arguments.monte_carlo > 0 || arguments.test_configurations > 0 ||
                  !arguments.plan.empty() || arguments.poses || arguments.order || arguments.noise.repeats > 1)) {
    throw InputError(
        "--sockets: poses that touch a plate are drawn, each once, expected none of --plan, --poses, "
        "--order, --repeats, --test-configurations, --two-step, --monte-carlo");
  }
}

VirtualRobot at_places(VirtualRobot robot, const PlaceArguments& arguments, std::uint64_t seed) {
  constexpr std::uint64_t kStream = 3;
  if (arguments.stations < 2 || !arguments.sockets.empty()) {
    return robot;
  }
  Random random(seed, kStream);
  return at_stations(std::move(robot), arguments.stations, random);
}

Plate plate_of(const SimulateArguments& arguments) {
  Plate plate{.sockets = {}, .places = arguments.places.stations, .sigma = arguments.noise.sigma};
  for (const TargetFrame& socket : read_targets(arguments.places.sockets)) {
    plate.sockets.emplace_back(socket.X_FT.translation());
  }
  return plate;
}

}  // namespace kdl_calibration::cli
