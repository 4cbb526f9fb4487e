#include "validation/validation.hpp"

#include <algorithm>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <limits>
#include <map>
#include <utility>

#include "base/parallel.hpp"
#include "base/preconditions.hpp"
#include "base/random.hpp"
#include "estimation/input_check.hpp"
#include "measurements/readings.hpp"
#include "measurements/same_poses.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"
#include "validation/folds.hpp"

namespace kdl_calibration {

ErrorStatistics error_statistics(std::vector<double> distances) {
  ErrorStatistics statistics;
  statistics.count = static_cast<long>(distances.size());
  if (distances.empty()) {
    return statistics;
  }
  const Eigen::Map<const Eigen::ArrayXd> d(distances.data(), static_cast<Eigen::Index>(distances.size()));
  const double n = static_cast<double>(distances.size());
  statistics.mean = d.mean();
  statistics.rms = std::sqrt(d.square().mean());
  statistics.max = d.maxCoeff();
  const double position = 0.95 * (n - 1.0);
  const auto below = static_cast<std::size_t>(position);
  statistics.std = distances.size() > 1 ? std::sqrt((d - statistics.mean).square().sum() / (n - 1.0)) : 0.0;
  const auto lower = distances.begin() + static_cast<std::ptrdiff_t>(below);
  std::nth_element(distances.begin(), lower, distances.end());
  const double upper = lower + 1 == distances.end() ? *lower : *std::min_element(lower + 1, distances.end());
  statistics.p95 = *lower + (position - std::floor(position)) * (upper - *lower);
  return statistics;
}

namespace {

bool is_among(const Observation& observation, Rows rows) {
  return rows == Rows::all || (observation.split == Split::train) == (rows == Rows::train);
}

}  // namespace

std::vector<double> position_errors(const ErrorModel& model, const Estimate& estimate, const Measurements& measurements,
                                    Rows rows) {
  check(estimate, model, measurements);
  return position_errors(flange_poses(model, estimate, measurements), estimate, measurements, rows);
}

std::vector<double> position_errors(const std::vector<Eigen::Isometry3d>& X_BF, const Estimate& estimate,
                                    const Measurements& measurements, Rows rows) {
  std::vector<double> distances;
  for (const Observation& observation : measurements.observations) {
    if (is_among(observation, rows)) {
      distances.push_back(measured_minus_predicted(observation, estimate, X_BF).norm());
    }
  }
  return distances;
}

Estimate registered(const ErrorModel& model, const Eigen::VectorXd& errors, const Measurements& measurements,
                    const RegistrationOptions& options) {
  const Registration registration =
      register_base_and_targets(flange_poses(folded(model, errors), measurements.joint_values), measurements, options);
  return {.errors = errors, .frames = registration.frames, .effects = {}};
}

Iso9283 iso_9283(const ErrorModel& model, const Estimate& estimate, const Measurements& measurements, Rows rows) {
  check(estimate, model, measurements);
  return iso_9283(flange_poses(model, estimate, measurements), estimate, measurements, rows);
}

Iso9283 iso_9283(const std::vector<Eigen::Isometry3d>& X_BF, const Estimate& estimate, const Measurements& measurements,
                 Rows rows) {
  const Measurements means = averaged(measurements);
  Iso9283 result;
  result.accuracy = error_statistics(position_errors(X_BF, estimate, means, rows));
  const auto cell_of = [&](const Observation& o) {
    return static_cast<std::size_t>(o.configuration) * measurements.targets.size() + static_cast<std::size_t>(o.target);
  };
  const bool whole = !has_single_coordinates(measurements);
  std::vector<int> repeats(static_cast<std::size_t>(measurements.joint_values.cols()) * measurements.targets.size(), 0);
  for (const Observation& o : measurements.observations) {
    repeats[cell_of(o)] += whole && is_among(o, rows) ? 1 : 0;
  }
  std::map<std::size_t, Eigen::Vector3d> mean_of;  // for points with repeats only
  for (const Observation& o : means.observations) {
    if (repeats[cell_of(o)] > 1) {
      mean_of[cell_of(o)] = o.position();
    }
  }
  std::map<std::size_t, std::vector<double>> scatter;
  for (const Observation& o : measurements.observations) {
    if (is_among(o, rows) && repeats[cell_of(o)] > 1) {
      scatter[cell_of(o)].push_back((o.position() - mean_of[cell_of(o)]).norm());
    }
  }
  std::vector<double> repeatabilities;
  for (const auto& [cell, distances] : scatter) {
    const ErrorStatistics l = error_statistics(distances);
    repeatabilities.push_back(l.mean + 3.0 * l.std);
  }
  result.repeatability = error_statistics(repeatabilities);
  return result;
}

namespace {

// Groups of neighbouring configurations, ordered by the first of each.
std::vector<std::vector<Eigen::Index>> neighbours(const Measurements& measurements, const std::vector<bool>& trained) {
  const std::vector<Eigen::Index> first = first_of_neighbours(measurements.joint_values);
  constexpr auto kNowhere = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> place(trained.size(), kNowhere);  // group index of each first configuration
  std::vector<std::vector<Eigen::Index>> result;
  for (std::size_t c = 0; c < trained.size(); ++c) {
    if (!trained[c]) {
      continue;
    }
    std::size_t& group = place[static_cast<std::size_t>(first[c])];
    if (group == kNowhere) {
      group = result.size();
      result.emplace_back();
    }
    result[group].push_back(static_cast<Eigen::Index>(c));
  }
  return result;
}

// So that a fold depends on the measurements, and not on the order of their rows.
void sort_by_joint_values(const Eigen::MatrixXd& q, std::vector<std::vector<Eigen::Index>>& groups) {
  const auto is_before = [&](Eigen::Index a, Eigen::Index b) {
    return std::lexicographical_compare(q.col(a).begin(), q.col(a).end(), q.col(b).begin(), q.col(b).end());
  };
  for (std::vector<Eigen::Index>& group : groups) {
    std::stable_sort(group.begin(), group.end(), is_before);
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [&](const auto& a, const auto& b) { return is_before(a.front(), b.front()); });
}

// The rows of a station to fit without those of a fold.
Measurements rest_of(const Measurements& station, const std::vector<Eigen::Index>& fold) {
  return subset(station, [&](const Observation& o) {
    return o.split == Split::train && std::find(fold.begin(), fold.end(), o.configuration) == fold.end();
  });
}

// The stations of each fold whose base the other configurations determine less.
std::vector<std::vector<std::int16_t>> bases_lost(const Measurements& measurements,
                                                  const std::vector<std::vector<Eigen::Index>>& folds) {
  constexpr std::size_t kEnough = 10;  // configurations beside the fold
  std::vector<std::vector<std::int16_t>> result(folds.size());
  if (measurements.stations.size() < 2) {
    return result;
  }
  const std::vector<std::int16_t> stations = stations_of_configurations(measurements);
  for (std::size_t station = 0; station < measurements.stations.size(); ++station) {
    const auto s = static_cast<std::int16_t>(station);
    const Measurements own = rows_of_station(measurements, station).measurements;
    const Eigen::Index undetermined = undetermined_rotations(rest_of(own, {})).axes.cols();
    const auto all = static_cast<std::size_t>(std::count(stations.begin(), stations.end(), s));
    for (std::size_t f = 0; f < folds.size(); ++f) {
      const auto left_out =
          static_cast<std::size_t>(std::count_if(folds[f].begin(), folds[f].end(), [&](Eigen::Index c) {
            return stations[static_cast<std::size_t>(c)] == s;
          }));
      if (left_out == 0 || all > left_out + kEnough) {
        continue;
      }
      const Measurements rest = rest_of(own, folds[f]);
      if (rest.observations.empty() || undetermined_rotations(rest).axes.cols() > undetermined) {
        result[f].push_back(s);
      }
    }
  }
  return result;
}

// Takes configurations out of the folds without which their station would lose its base: no fit would predict them.
// Leaves the folds alone if that takes all.
void keep_bases(const Measurements& measurements, std::vector<std::vector<Eigen::Index>>& folds) {
  const std::vector<std::vector<std::int16_t>> lost = bases_lost(measurements, folds);
  const std::vector<std::int16_t> stations = stations_of_configurations(measurements);
  std::vector<std::vector<Eigen::Index>> kept = folds;
  for (std::size_t f = 0; f < kept.size(); ++f) {
    for (const std::int16_t station : lost[f]) {
      std::erase_if(kept[f], [&](Eigen::Index c) { return stations[static_cast<std::size_t>(c)] == station; });
    }
  }
  std::erase_if(kept, [](const std::vector<Eigen::Index>& fold) { return fold.empty(); });
  if (!kept.empty()) {
    folds = std::move(kept);
  }
}

}  // namespace

std::vector<std::vector<Eigen::Index>> make_folds(const Measurements& measurements, int folds, std::uint64_t seed) {
  std::vector<std::vector<Eigen::Index>> configurations =
      neighbours(measurements, trained_configurations(measurements));
  const std::size_t count = configurations.size();
  const bool one_each = folds <= 0 || static_cast<std::size_t>(folds) >= count;
  if (!one_each) {
    sort_by_joint_values(measurements.joint_values, configurations);
    Random random(seed);  // Fisher-Yates
    for (std::size_t i = count; i > 1; --i) {
      std::swap(configurations[i - 1], configurations[random.bits() % i]);
    }
  }
  std::vector<std::vector<Eigen::Index>> result(one_each ? count : static_cast<std::size_t>(folds));
  for (std::size_t i = 0; i < count; ++i) {
    std::vector<Eigen::Index>& fold = result[i % result.size()];
    fold.insert(fold.end(), configurations[i].begin(), configurations[i].end());
  }
  keep_bases(measurements, result);
  return result;
}

std::vector<std::vector<Eigen::Index>> folds_with_rest(std::vector<std::vector<Eigen::Index>> folds,
                                                       const Measurements& measurements) {
  std::vector<bool> is_in_none = trained_configurations(measurements);
  for (const std::vector<Eigen::Index>& fold : folds) {
    for (const Eigen::Index c : fold) {
      is_in_none[static_cast<std::size_t>(c)] = false;
    }
  }
  std::vector<Eigen::Index> rest;
  for (std::size_t c = 0; c < is_in_none.size(); ++c) {
    if (is_in_none[c]) {
      rest.push_back(static_cast<Eigen::Index>(c));
    }
  }
  if (!rest.empty()) {
    folds.push_back(std::move(rest));
  }
  return folds;
}

namespace {

// Turns the rows of the given configurations into test rows.
Measurements without(Measurements training, const std::vector<Eigen::Index>& left_out) {
  std::vector<bool> is_left_out(training.configurations.size(), false);
  for (const Eigen::Index c : left_out) {
    is_left_out[static_cast<std::size_t>(c)] = true;
  }
  for (Observation& observation : training.observations) {
    if (is_left_out[static_cast<std::size_t>(observation.configuration)]) {
      observation.split = Split::test;
    }
  }
  return training;
}

}  // namespace

RefittedFold refit_without(const FitProblem& problem, const std::vector<Eigen::Index>& fold) {
  const Measurements rest = without(problem.measurements, fold);
  const Identification found = fit(with_measurements(problem, rest));
  const Measurements means = averaged(rest);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(problem.model, found.estimate, means);
  RefittedFold result{
      .residuals = {}, .configurations = {}, .targets = {}, .converged = found.termination == Termination::converged};
  for (const Observation& o : means.observations) {
    if (is_among(o, Rows::test)) {
      result.residuals.push_back(measured_minus_predicted(o, found.estimate, X_BF));
      result.configurations.push_back(o.configuration);
      result.targets.push_back(o.target);
    }
  }
  return result;
}

bool can_be_left_out(const Measurements& measurements, const std::vector<std::vector<Eigen::Index>>& folds,
                     Eigen::Index unknowns) {
  std::vector<Eigen::Index> equations(static_cast<std::size_t>(measurements.joint_values.cols()), 0);
  Eigen::Index all = 0;
  const TrainingRows training(measurements);
  for (const Observation& observation : (*training).observations) {
    const int own = has_orientation(observation) ? 6 : dimension(observation.reading);
    equations[static_cast<std::size_t>(observation.configuration)] += own;
    all += own;
  }
  const std::vector<std::vector<std::int16_t>> lost = bases_lost(measurements, folds);
  return folds.size() > 1 &&
         std::all_of(lost.begin(), lost.end(), [](const auto& stations) { return stations.empty(); }) &&
         std::all_of(folds.begin(), folds.end(), [&](const std::vector<Eigen::Index>& fold) {
           Eigen::Index left = all;
           for (const Eigen::Index c : fold) {
             left -= equations[static_cast<std::size_t>(c)];
           }
           return left >= unknowns;
         });
}

HoldOut cross_validate(const FitProblem& problem, const std::vector<std::vector<Eigen::Index>>& folds, int threads) {
  const TrainingProblem training(problem);
  std::vector<RefittedFold> refitted(folds.size());
  parallel_for(folds.size(), threads, [&](std::size_t f) { refitted[f] = refit_without(*training, folds[f]); });
  HoldOut result{.distances = {}, .refits = static_cast<int>(folds.size())};
  for (const RefittedFold& fold : refitted) {
    for (const Eigen::Vector3d& residual : fold.residuals) {
      result.distances.push_back(residual.norm());
    }
    result.not_converged += fold.converged ? 0 : 1;
  }
  return result;
}

namespace {
constexpr Eigen::Index kComparedWithKdl = 1000;
}  // namespace

double difference_to_kdl(const ErrorModel& model, const Eigen::VectorXd& errors, const Eigen::MatrixXd& joint_values) {
  require_count("joint values", joint_values.rows(), model.joints.size());
  const KDL::Chain chain = error_chain(model, errors);
  KDL::ChainFkSolverPos_recursive solver(chain);
  const FoldedChain ours = folded(model, errors);
  KDL::JntArray q(chain.getNrOfJoints());
  double largest = 0.0;
  const Eigen::Index compared = std::min<Eigen::Index>(joint_values.cols(), kComparedWithKdl);
  for (Eigen::Index i = 0; i < compared; ++i) {
    const Eigen::Index c = i * joint_values.cols() / compared;  // evenly spaced
    q.data = joint_values.col(c);
    KDL::Frame expected;
    solver.JntToCart(q, expected);
    const Eigen::Matrix4d difference = flange_pose(ours, joint_values.col(c)).matrix() - to_eigen(expected).matrix();
    largest = std::max(largest, difference.cwiseAbs().maxCoeff());
  }
  return largest;
}

}  // namespace kdl_calibration
