#include <benchmark/benchmark.h>

#include <Eigen/Cholesky>
#include <filesystem>
#include <fstream>

#include "base/parallel.hpp"
#include "calibration/calibrate.hpp"
#include "diagnosis/alternative_readings.hpp"
#include "effects/effect_terms.hpp"
#include "estimation/registration.hpp"
#include "estimation/residual_options.hpp"
#include "experiment.hpp"
#include "kdl_calibration/measurements.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration::benchmarks {
namespace {

constexpr int kPublished = 30;

void publish(benchmark::State& state, const Outcome& outcome) {
  state.counters["iterations"] = outcome.iterations;
  state.counters["rms_m"] = outcome.rms;
}

// ---- the published experiment, from nominal geometry, base and tools ------------------------------------------------

void published_library(benchmark::State& state) {
  const Measurements measured = experiment().measurements(kPublished);
  const Estimate start = experiment().nominal();
  Identification found;
  for (auto _ : state) {
    found = identify_jointly(experiment().model, measured, start, experiment().free);
  }
  publish(state, {.iterations = found.iterations, .rms = found.rms});
}
BENCHMARK(published_library)->Unit(benchmark::kMicrosecond);

void published_plain_eigen(benchmark::State& state) {
  const Measurements measured = experiment().measurements(kPublished);
  Outcome outcome;
  for (auto _ : state) {
    outcome = fit_with_plain_eigen(experiment(), measured, 50);
  }
  publish(state, outcome);
}
BENCHMARK(published_plain_eigen)->Unit(benchmark::kMicrosecond);

void published_kdl(benchmark::State& state) {
  const Measurements measured = experiment().measurements(kPublished);
  Outcome outcome;
  for (auto _ : state) {
    outcome = fit_with_kdl(experiment(), measured, 50);
  }
  publish(state, outcome);
}
BENCHMARK(published_kdl)->Unit(benchmark::kMicrosecond);

void registration(benchmark::State& state) {
  const Measurements measured = experiment().measurements(kPublished);
  for (auto _ : state) {
    benchmark::DoNotOptimize(nominal_start(experiment().model, measured));
  }
}
BENCHMARK(registration)->Unit(benchmark::kMicrosecond);

#ifdef KDL_CALIBRATION_WITH_CERES
void published_ceres(benchmark::State& state, CeresSolver solver) {
  const Measurements measured = experiment().measurements(kPublished);
  Outcome outcome;
  for (auto _ : state) {
    outcome = fit_with_ceres(experiment(), measured, solver, 50);
  }
  publish(state, outcome);
}
BENCHMARK_CAPTURE(published_ceres, normal_cholesky, CeresSolver::dense_normal_cholesky)->Unit(benchmark::kMicrosecond);
BENCHMARK_CAPTURE(published_ceres, qr, CeresSolver::dense_qr)->Unit(benchmark::kMicrosecond);

// Two fits of different length, so that setting up does not count.
void iteration_ceres_qr(benchmark::State& state) {
  const Measurements measured = experiment().measurements(static_cast<int>(state.range(0)));
  const auto seconds = [&](int iterations) {
    const auto begin = std::chrono::steady_clock::now();
    fit_with_ceres(experiment(), measured, CeresSolver::dense_qr, iterations);
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  for (auto _ : state) {
    state.SetIterationTime(seconds(3) / 2.0 - seconds(1) / 2.0);
  }
  state.counters["per_configuration"] = benchmark::Counter(
      static_cast<double>(state.range(0)), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(iteration_ceres_qr)
    ->Arg(3000)
    ->Arg(30000)
    ->Arg(300000)
    ->UseManualTime()
    ->Iterations(1)
    ->Unit(benchmark::kMillisecond);
#endif

// ---- long measurements
// -----------------------------------------------------------------------------------------------

// One iteration: the pass over the data and the step.
void iteration(benchmark::State& state, const LeastSquaresProblem& problem, const Estimate& start) {
  LeastSquaresProblem::Workspace workspace;
  NormalEquations equations;
  for (auto _ : state) {
    problem.linearise(start, workspace, equations);
    benchmark::DoNotOptimize(equations.hessian.llt().solve(equations.gradient).eval());
  }
  state.counters["per_configuration"] = benchmark::Counter(
      static_cast<double>(state.range(0)), benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
void iteration(benchmark::State& state, const Measurements& measured, const ResidualOptions& options) {
  iteration(state, LeastSquaresProblem(experiment().model, measured, experiment().free, options),
            experiment().nominal());
}
void iteration(benchmark::State& state, const ResidualOptions& options) {
  iteration(state, experiment().measurements(static_cast<int>(state.range(0))), options);
}
void iteration_library(benchmark::State& state) { iteration(state, {}); }
BENCHMARK(iteration_library)->Arg(30)->Arg(300)->Arg(3000)->Arg(30000)->Arg(300000)->Unit(benchmark::kMicrosecond);

// With noise that the points of a configuration share.
void iteration_correlated(benchmark::State& state) {
  ResidualOptions options;
  options.noise.independent.setConstant(3e-5);
  options.noise.common.setConstant(1e-5);
  iteration(state, options);
}
BENCHMARK(iteration_correlated)->Arg(300)->Arg(30000)->Unit(benchmark::kMicrosecond);

// The same, another one along each axis.
void iteration_by_axis(benchmark::State& state) {
  ResidualOptions options;
  options.noise.independent = {3e-5, 2e-5, 4e-5};
  options.noise.common = {1e-5, 2e-5, 3e-5};
  iteration(state, options);
}
BENCHMARK(iteration_by_axis)->Arg(300)->Arg(30000)->Unit(benchmark::kMicrosecond);

// A tracker's, which has its line of sight.
void iteration_tracker(benchmark::State& state) {
  ResidualOptions options;
  options.noise.tracker = {.range = 1e-5, .transverse = 3e-5};
  iteration(state, options);
}
BENCHMARK(iteration_tracker)->Arg(300)->Arg(30000)->Unit(benchmark::kMicrosecond);

// Whole poses of the targets.
void iteration_poses(benchmark::State& state) {
  Measurements measured = experiment().measurements(static_cast<int>(state.range(0)));
  for (Observation& row : measured.observations) {
    row.reading = Pose{row.position(), Orientation::Identity()};
  }
  iteration(state, measured, {});
}
BENCHMARK(iteration_poses)->Arg(300)->Arg(30000)->Unit(benchmark::kMicrosecond);

// The first 60 terms of what bends, turns and tilts joints.
void iteration_effects(benchmark::State& state) {
  const Measurements measured = experiment().measurements(static_cast<int>(state.range(0)));
  ErrorModel model = experiment().model;
  for (const EffectGroup group : {EffectGroup::gravity, EffectGroup::gain, EffectGroup::backlash,
                                  EffectGroup::harmonics, EffectGroup::transverse}) {
    const std::vector<EffectTerm> terms = effect_terms(model, group, measured.joint_values);
    model.effects.insert(model.effects.end(), terms.begin(), terms.end());
  }
  model.effects.resize(60);
  Estimate start = experiment().nominal();
  start.effects = Eigen::VectorXd::Constant(60, 1e-5);
  const Unknowns free = experiment().free.with_group(model, UnknownGroup::effects);
  iteration(state, LeastSquaresProblem(model, measured, free, {.priors = {.length = 1e-3, .angle = 1e-3}}), start);
}
BENCHMARK(iteration_effects)->Arg(300)->Arg(30000)->Unit(benchmark::kMicrosecond);

void whole_fit_library(benchmark::State& state) {
  const Measurements measured = experiment().measurements(static_cast<int>(state.range(0)));
  const Estimate start = experiment().nominal();
  for (auto _ : state) {
    benchmark::DoNotOptimize(identify_jointly(experiment().model, measured, start, experiment().free));
  }
}
BENCHMARK(whole_fit_library)->Arg(300)->Arg(3000)->Arg(30000)->Arg(300000)->Unit(benchmark::kMillisecond);

// Everything that `kdlcal calibrate` does behind reading.
void calibrate_library(benchmark::State& state) {
  const Measurements measured = experiment().measurements(static_cast<int>(state.range(0)), 1, 0.00003);
  for (auto _ : state) {
    benchmark::DoNotOptimize(calibrate(experiment().model, measured, {}));
  }
}
BENCHMARK(calibrate_library)->Arg(30)->Arg(300000)->Unit(benchmark::kMillisecond);

// What calibrate() tries of other readings of the data, and all the rest that it does with one model.
void hypotheses_library(benchmark::State& state) {
  const Measurements measured = experiment().measurements(static_cast<int>(state.range(0)), 1, 0.00003);
  const CalibrationResult found = calibrate(experiment().model, measured, {.diagnosis = {.try_readings = false}});
  for (auto _ : state) {
    benchmark::DoNotOptimize(alternative_readings(experiment().model, measured, found.fit.identification.estimate,
                                                  found.fit.free, {.threads = 0}));
  }
}
BENCHMARK(hypotheses_library)->Arg(1000)->UseRealTime()->Unit(benchmark::kMillisecond);

void one_model_library(benchmark::State& state) {
  const Measurements measured = experiment().measurements(static_cast<int>(state.range(0)), 1, 0.00003);
  for (auto _ : state) {
    benchmark::DoNotOptimize(calibrate(experiment().model, measured, {.diagnosis = {.try_readings = false}}));
  }
}
BENCHMARK(one_model_library)->Arg(1000)->UseRealTime()->Unit(benchmark::kMillisecond);

double peak_megabytes() {
  std::ifstream status("/proc/self/status");
  double kibibytes = 0.0;
  for (std::string word; status >> word;) {
    if (word == "VmHWM:") {
      status >> kibibytes;
    }
  }
  return kibibytes * 1024.0 / 1e6;
}

// Largest resident memory of this process during one fit, the measurements included (Linux).
void memory_library(benchmark::State& state) {
  const Measurements measured = experiment().measurements(static_cast<int>(state.range(0)));
  const Estimate start = experiment().nominal();
  std::ofstream("/proc/self/clear_refs") << "5";  // forgets the peak so far
  const double before = peak_megabytes();
  for (auto _ : state) {
    benchmark::DoNotOptimize(identify_jointly(experiment().model, measured, start, experiment().free));
  }
  state.counters["peak_MB"] = peak_megabytes();
  state.counters["before_MB"] = before;
}
BENCHMARK(memory_library)->Arg(300000)->Iterations(1)->Unit(benchmark::kMillisecond);

// ---- many fits
// -------------------------------------------------------------------------------------------------------

void monte_carlo(benchmark::State& state) {
  constexpr std::size_t kFits = 10000;
  const Measurements measured = experiment().measurements(kPublished);
  const Estimate start = experiment().nominal();
  std::vector<double> rms(kFits);
  for (auto _ : state) {
    parallel_for(kFits, static_cast<int>(state.range(0)), [&](std::size_t i) {
      Random random(i);
      Measurements noisy = measured;
      for (Observation& observation : noisy.observations) {
        observation.position() += 0.00003 * Eigen::Vector3d{random.normal(), random.normal(), random.normal()};
      }
      rms[i] = identify_jointly(experiment().model, noisy, start, experiment().free).rms;
    });
  }
}
BENCHMARK(monte_carlo)->Arg(1)->Arg(2)->UseRealTime()->Unit(benchmark::kMillisecond);

// ---- reading
// ---------------------------------------------------------------------------------------------------------

void read_csv(benchmark::State& state) {
  const auto file = std::filesystem::temp_directory_path() / "kdl_calibration_benchmark.csv";
  const Measurements measured = experiment().measurements(static_cast<int>(state.range(0)));
  std::ofstream(file) << measurements_csv(measured);
  for (auto _ : state) {
    benchmark::DoNotOptimize(read_measurements(file, measured.joints));
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) *
                          static_cast<std::int64_t>(std::filesystem::file_size(file)));
  std::filesystem::remove(file);
}
BENCHMARK(read_csv)->Arg(300000)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kdl_calibration::benchmarks

BENCHMARK_MAIN();
