#include <benchmark/benchmark.h>

#include "base/random.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/simulation.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration::benchmarks {
namespace {

// As many as in prediction.py.
void prediction_library(benchmark::State& state) {
  constexpr Eigen::Index kPredictions = 40000;
  const Robot robot = load_robot(URDF_DIR "/fanuc_r2000ic_165f.urdf");
  const Calibration found = calibrate(robot, simulate(robot).measurements);
  const CalibratedArm arm = found.arm();
  Random random(2);
  const Eigen::MatrixXd q = random_configurations(robot.joints, limits_of(robot.joints), kPredictions, random);
  for (auto _ : state) {
    for (const auto& column : q.colwise()) {
      benchmark::DoNotOptimize(arm.predict(column, "A"));
    }
  }
}
BENCHMARK(prediction_library)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kdl_calibration::benchmarks
