#include "kdl_calibration/compensation.hpp"

#include <benchmark/benchmark.h>

#include <algorithm>
#include <chrono>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainiksolverpos_lma.hpp>
#include <limits>
#include <memory>
#include <vector>

#include "base/random.hpp"
#include "interface/calibration_parts.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration::benchmarks {
namespace {

// A calibration that found errors of 0.5 mm and 0.5 mrad.
Calibration found_calibration(const Robot& robot) {
  CalibrationParts parts;
  parts.model = complete_model(robot);
  Random random(3);
  parts.estimate.errors = Eigen::VectorXd::NullaryExpr(static_cast<Eigen::Index>(parts.model.parameters.size()),
                                                       [&] { return 5e-4 * random.normal(); });
  parts.urdf_errors = parts.estimate.errors;
  parts.verdict = Verdict::trusted;
  return Calibration(std::make_shared<CalibrationParts>(std::move(parts)));
}

template <class Work>
double median_seconds(const Eigen::MatrixXd& q, const Work& work) {
  std::vector<double> seconds;
  for (const auto& column : q.colwise()) {
    const auto begin = std::chrono::steady_clock::now();
    work(column);
    seconds.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  }
  const auto middle = seconds.begin() + static_cast<std::ptrdiff_t>(seconds.size() / 2);
  std::nth_element(seconds.begin(), middle, seconds.end());
  return *middle;
}

// A point over the whole limits, on one thread, beside KDL's solver from the same start to the same accuracy.
void compensation_point(benchmark::State& state) {
  const Robot robot = load_robot(std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf");
  const Calibration calibration = found_calibration(robot);
  const Compensator compensator(calibration);
  const KDL::Chain chain = calibration.urdf_chain();
  KDL::ChainFkSolverPos_recursive nominal(robot.chain);
  KDL::ChainIkSolverPos_LMA solver(chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-10);
  Random random(1);
  const Eigen::MatrixXd q = random_configurations(limits_of(robot.joints), 2000, random);
  KDL::JntArray start(6);
  KDL::JntArray joints(6);
  KDL::Frame asked;
  double ours = 0.0;
  double of_kdl = 0.0;
  for (auto _ : state) {
    ours = median_seconds(q, [&](const auto& column) { benchmark::DoNotOptimize(compensator.solve(column)); });
    of_kdl = median_seconds(q, [&](const auto& column) {
      start.data = column;
      nominal.JntToCart(start, asked);
      benchmark::DoNotOptimize(solver.CartToJnt(start, asked, joints));
    });
  }
  state.counters["median_us"] = 1e6 * ours;
  state.counters["kdl_median_us"] = 1e6 * of_kdl;
  state.counters["times_faster"] = of_kdl / ours;
}
BENCHMARK(compensation_point)->Iterations(5)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace kdl_calibration::benchmarks
