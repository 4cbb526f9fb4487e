#include "validation/registered_errors.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>
#include <string>
#include <utility>

#include "base/distributions.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/parameters.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {
namespace {

Freedom freedom_of(const Measurements& training, const KnownFrames& known, const Registration& registration) {
  std::set<int> targets;
  std::set<int> configurations;
  std::set<int> stations;
  for (const Observation& observation : training.observations) {
    targets.insert(observation.target);
    configurations.insert(observation.configuration);
    if (find_base(known.bases, training.stations[station_of(observation)]) == nullptr) {
      stations.insert(observation.station);
    }
  }
  const auto unknown_targets = static_cast<int>(targets.size()) - static_cast<int>(known.targets.size());
  const int of_bases = 6 * static_cast<int>(stations.size());
  const int coordinates = dimension(averaged(training));
  return {.unknowns = of_bases + 3 * std::max(unknown_targets, 0),
          .undetermined = registration.undetermined,
          .coordinates = coordinates,
          .configurations = static_cast<int>(configurations.size()),
          .points = std::min(coordinates, 3 * static_cast<int>(configurations.size())),
          .of_points = of_bases + (unknown_targets > 0 ? 3 : 0)};
}

// Nothing is fitted to the test rows beside training rows.
Freedom freedom_of_test(const Measurements& measurements) {
  const Measurements test =
      subset(measurements, [](const Observation& observation) { return observation.split == Split::test; });
  std::set<int> configurations;
  for (const Observation& observation : test.observations) {
    configurations.insert(observation.configuration);
  }
  return {.points = std::min(dimension(averaged(test)), 3 * static_cast<int>(configurations.size()))};
}

void require_freedom(const Freedom& freedom, const std::string& source) {
  if (freedom.left() > 0) {
    return;
  }
  const int needed = freedom.spent() * freedom.configurations / std::max(freedom.coordinates, 1) + 1;
  throw InputError(
      fmt::format("{}: {} coordinates in {} configurations, and base and targets take {} of them: nothing is left to "
                  "show an error, expected at least {} configurations, or a known base and known targets",
                  source, freedom.coordinates, freedom.configurations, freedom.spent(), needed));
}

}  // namespace

double Freedom::correction() const { return std::sqrt(static_cast<double>(coordinates) / left()); }

// With f degrees of freedom, points * rms^2 / true^2 is about chi-squared.
double Freedom::upper_95() const {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const int freedom = points - std::max(of_points - undetermined, 0);
  return freedom > 0 ? std::sqrt(points / (freedom * f_critical(0.95, freedom, kInfinity))) : kInfinity;
}

bool has_only_test_rows(const Measurements& measurements) {
  return std::all_of(measurements.observations.begin(), measurements.observations.end(),
                     [](const Observation& observation) { return observation.split == Split::test; });
}

Measurements rows_to_register(Measurements measurements) {
  if (has_only_test_rows(measurements)) {
    for (Observation& observation : measurements.observations) {
      observation.split = Split::train;
    }
  }
  return measurements;
}

RegisteredErrors registered_errors(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                   const Measurements& to_register, const KnownFrames& known) {
  require_rows_of_each_station(measurements, *TrainingRows(to_register));
  RegisteredErrors result{.registration = register_base_and_targets(X_BF, to_register, {.known = known})};
  result.freedom = freedom_of(*TrainingRows(to_register), known, result.registration);
  require_freedom(result.freedom, measurements.source);
  result.of_test = has_only_test_rows(measurements) ? result.freedom : freedom_of_test(measurements);
  const Estimate placed{.errors = {}, .frames = result.registration.frames, .effects = {}};
  const auto statistics = [&](Rows rows) {
    return error_statistics(position_errors(X_BF, placed, measurements, rows));
  };
  result.all = statistics(Rows::all);
  result.train = statistics(Rows::train);
  result.test = statistics(Rows::test);
  result.iso = iso_9283(X_BF, placed, measurements, Rows::all);
  if (result.iso.repeatability.count > 0) {
    const auto means_of = [&](Rows rows) {
      const ErrorStatistics means = iso_9283(X_BF, placed, measurements, rows).accuracy;
      return means.count > 0 ? std::optional(means) : std::nullopt;
    };
    result.all_means = result.iso.accuracy;
    result.train_means = means_of(Rows::train);
    result.test_means = means_of(Rows::test);
  }
  return result;
}

}  // namespace kdl_calibration
