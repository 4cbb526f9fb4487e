#include "measurements/measurements_check.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <string>
#include <vector>

#include "base/number_range.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

template <class Values>
bool are_in_range(const Values& values) {
  return (values.array().abs() <= kLargestNumber).all();  // false for NaN
}

[[noreturn]] void refuse(const Measurements& measurements, const std::string& what) {
  throw InputError((measurements.source.empty() ? "measurements" : measurements.source) + ": " + what);
}

void require_size(const Measurements& measurements, const char* what, std::size_t size, std::size_t expected) {
  if (size != expected) {
    refuse(measurements, fmt::format("{} {}, expected {}, one for each", size, what, expected));
  }
}

// Checks the size of an optional member.
void require_size_if_any(const Measurements& measurements, const char* what, std::size_t size, std::size_t expected) {
  if (size != 0) {
    require_size(measurements, what, size, expected);
  }
}

// `refuse_row` says what is wrong with a row and throws. The position is finite.
template <class Refuse>
void require_sound(const Reading& reading, const Refuse& refuse_row) {
  constexpr double kUnitQuaternion = 1e-3;
  constexpr double kUnitVector = 1e-9;
  const auto check_kind =
      ByKind{[](const Point&) {},
             [&](const Pose& pose) {
               if (!(std::abs(pose.orientation.norm() - 1.0) <= kUnitQuaternion)) {
                 refuse_row("the orientation is no unit quaternion");
               }
             },
             [&](const Coordinates& some) {
               const bool is_unit = std::abs(some.normal.norm() - 1.0) <= kUnitVector;
               if (!is_unit || (some.count != 1 && some.count != 2)) {
                 refuse_row("its directions are none, expected 1 or 2 coordinates and a unit vector");
               }
             },
             [&](const Distance& distance) {
               if (!(distance.length > 0.0 && distance.length <= kLargestNumber)) {
                 refuse_row(fmt::format("a distance of {}, expected one above 0 up to 1e12", distance.length));
               }
             }};
  std::visit(check_kind, reading);
}

void require_sound(const Measurements& measurements, std::size_t row) {
  const Observation& observation = measurements.observations[row];
  const auto refuse_row = [&](const std::string& fault) {
    refuse(measurements, fmt::format("observation {}: {}", row, fault));
  };
  const auto configurations = static_cast<std::ptrdiff_t>(measurements.configurations.size());
  const auto targets = static_cast<std::ptrdiff_t>(measurements.targets.size());
  if (observation.configuration < 0 || observation.configuration >= configurations) {
    refuse_row(
        fmt::format("configuration {} is not there, expected 0 to {}", observation.configuration, configurations - 1));
  }
  if (observation.target < 0 || observation.target >= targets) {
    refuse_row(fmt::format("target {} is not there, expected 0 to {}", observation.target, targets - 1));
  }
  const auto stations = static_cast<std::ptrdiff_t>(measurements.stations.size());
  if (observation.station < 0 || observation.station >= stations) {
    refuse_row(fmt::format("station {} is not there, expected 0 to {}", observation.station, stations - 1));
  }
  if (!are_in_range(observation.position())) {
    refuse_row("a coordinate is not finite or beyond 1e12");
  }
  if (!std::isfinite(observation.sigma) || observation.sigma < 0.0) {
    refuse_row("sigma is negative or not finite, expected 0 where none is stated");
  }
  if (observation.sigma > 0.0 && observation.sigma < kSmallestSigma) {
    refuse_row(fmt::format("a sigma of {} m, expected at least {} m, or 0 where none is stated", observation.sigma,
                           kSmallestSigma));
  }
  if (observation.repeat < 0) {
    refuse_row(fmt::format("repeat {}, expected 0 or more", observation.repeat));
  }
  if (observation.order.has_value() != measurements.observations.front().order.has_value()) {
    refuse_row("some rows have a place in the order and others have none, expected it in all or in none");
  }
  require_sound(observation.reading, refuse_row);
}

// A configuration has rows of one station only, and its distances are from one anchor with no other rows beside them.
void require_one_place(const Measurements& measurements, std::size_t row, const Observation& first) {
  const Observation& observation = measurements.observations[row];
  const auto refuse_several = [&](const char* places) {
    refuse(measurements,
           fmt::format("observation {}: its configuration has rows of several {}, expected one", row, places));
  };
  if (observation.station != first.station) {
    refuse_several("stations");
  }
  if (is_distance(observation) != is_distance(first) ||
      (is_distance(observation) && observation.position() != first.position())) {
    refuse_several("anchors");
  }
}

}  // namespace

void check(const Measurements& measurements) {
  require_size(measurements, "configurations", measurements.configurations.size(),
               static_cast<std::size_t>(measurements.joint_values.cols()));
  require_size_if_any(measurements, "names of joints", measurements.joints.size(),
                      static_cast<std::size_t>(measurements.joint_values.rows()));
  require_size_if_any(measurements, "units of joints", measurements.joint_units.size(),
                      static_cast<std::size_t>(measurements.joint_values.rows()));
  if (const std::string fault = fault_of(measurements.signals, measurements.joint_values); !fault.empty()) {
    refuse(measurements, fault);
  }
  if (!are_in_range(measurements.joint_values)) {
    refuse(measurements, "a joint value is not finite or beyond 1e12");
  }
  if (measurements.stations.empty()) {
    refuse(measurements, "no station, expected the name of one or more");
  }
  if (measurements.stations.size() > kMostStations) {
    refuse(measurements, fmt::format("{} stations, expected at most {}", measurements.stations.size(), kMostStations));
  }
  if (measurements.targets.size() > kMostTargets) {
    refuse(measurements, fmt::format("{} targets, expected at most {}", measurements.targets.size(), kMostTargets));
  }
  std::set<std::string> targets;
  for (const std::string& target : measurements.targets) {
    if (target.empty()) {
      refuse(measurements, "target '' is empty, expected a name");
    }
    if (!targets.insert(target).second) {
      refuse(measurements, "target " + shown(target) + " is there twice, expected names that differ");
    }
  }
  std::vector<const Observation*> first(measurements.configurations.size(), nullptr);
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    require_sound(measurements, row);
    const Observation& observation = measurements.observations[row];
    const Observation*& first_row = first[static_cast<std::size_t>(observation.configuration)];
    first_row = first_row == nullptr ? &observation : first_row;
    require_one_place(measurements, row, *first_row);
  }
}

}  // namespace kdl_calibration
