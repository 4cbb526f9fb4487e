#include "planning/monte_carlo.hpp"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <utility>

#include "base/parallel.hpp"
#include "base/thinned.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "planning/experiment.hpp"

namespace kdl_calibration {
namespace {

struct Run {
  std::vector<double> distances;  // ordered by configuration
  bool trusted = false;
};

Run one_run(const MonteCarlo& experiment, std::uint64_t stream) {
  Random random(experiment.seed, stream);
  const VirtualRobot robot =
      placed(virtual_robot(experiment.model, experiment.with_errors, experiment.targets, experiment.sizes, random),
             experiment.X_WB);
  const Eigen::MatrixXd train = experiment.train(random);
  const Eigen::MatrixXd test = experiment.test(random);
  const Measurements measurements = measure(robot, train, experiment.noise, random);
  CalibrationSettings options = experiment.calibration;
  options.validation.held_out = false;     // the truth is known
  options.diagnosis.try_readings = false;  // simulated data are read correctly
  const CalibrationResult calibration = calibrate(experiment.model, measurements, options);
  const Measurements truth = measure(robot, test, {}, random, Split::test);
  return {.distances = position_errors(experiment.model, calibration.fit.identification.estimate, truth, Rows::test),
          .trusted = calibration.trusted()};
}

}  // namespace

MonteCarloResult run_monte_carlo(const MonteCarlo& experiment) {
  std::vector<Run> runs(static_cast<std::size_t>(experiment.runs));
  std::mutex mutex;
  std::size_t done = 0;
  parallel_for(runs.size(), experiment.threads, [&](std::size_t r) {
    runs[r] = one_run(experiment, static_cast<std::size_t>(experiment.first) + r);
    const std::lock_guard lock(mutex);
    ++done;
    if (experiment.progress) {
      experiment.progress(static_cast<double>(done) / static_cast<double>(runs.size()));
    }
  });

  MonteCarloResult result{.runs = experiment.runs};
  std::vector<double> all;
  std::vector<double> means;
  std::vector<double> maxima;
  const std::size_t points = runs.front().distances.size();
  bool same_size = true;
  for (const Run& run : runs) {
    const ErrorStatistics statistics = error_statistics(run.distances);
    all.insert(all.end(), run.distances.begin(), run.distances.end());
    result.each.push_back(statistics);
    result.trusted.push_back(run.trusted);
    means.push_back(statistics.mean);
    maxima.push_back(statistics.max);
    same_size = same_size && run.distances.size() == points;
    result.not_trusted += run.trusted ? 0 : 1;
  }
  if (same_size) {
    const auto targets = static_cast<Eigen::Index>(experiment.targets.size());
    result.rms = Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(points) / targets, targets);
    for (const Run& run : runs) {
      for (std::size_t i = 0; i < points; ++i) {
        const auto row = static_cast<Eigen::Index>(i) / targets;
        result.rms(row, static_cast<Eigen::Index>(i) % targets) += run.distances[i] * run.distances[i];
      }
    }
    result.rms = (result.rms / static_cast<double>(experiment.runs)).cwiseSqrt();
  }
  result.all_errors = thinned(all);
  result.mean_errors = thinned(means);
  result.largest_errors = thinned(maxima);
  result.all = error_statistics(std::move(all));
  result.means = error_statistics(std::move(means));
  result.maxima = error_statistics(std::move(maxima));
  return result;
}

std::vector<double> predicted_errors(const MonteCarlo& experiment) {
  constexpr int kRuns = 20;
  constexpr Eigen::Index kConfigurations = 30;
  std::vector<double> sigmas;
  if (!(experiment.noise.sigma > 0.0) || experiment.noise.tracker || experiment.noise.orientation_sigma > 0.0) {
    return sigmas;
  }
  const Experiment nominal =
      nominal_experiment(experiment.model, experiment.targets,
                         {.sigma = experiment.noise.sigma / std::sqrt(static_cast<double>(experiment.noise.repeats))});
  for (int r = 0; r < std::min(kRuns, experiment.runs); ++r) {
    Random random(experiment.seed, static_cast<std::uint64_t>(r));
    virtual_robot(experiment.model, experiment.with_errors, experiment.targets, experiment.sizes,
                  random);  // drawn before the configurations
    const Eigen::MatrixXd train = experiment.train(random);
    const Eigen::MatrixXd test = experiment.test(random);
    const Eigen::MatrixXd known = information(nominal, train);
    for (Eigen::Index c = 0; c < std::min(kConfigurations, test.cols()); ++c) {
      const double sigma = predicted(nominal, known, test.col(c), 1).worst_configuration;
      if (std::isfinite(sigma)) {
        sigmas.push_back(sigma);
      }
    }
  }
  std::sort(sigmas.begin(), sigmas.end());
  return sigmas;
}

}  // namespace kdl_calibration
