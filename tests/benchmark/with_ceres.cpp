#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <algorithm>
#include <array>

#include "experiment.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration::benchmarks {
namespace {

using Eigen::Index;
using Eigen::Vector3d;

constexpr int kBase = 6;
constexpr int kGeometric = 18;
constexpr int kTools = 9;

// One factor of the chain with everything constant before it multiplied out.
struct Step {
  Eigen::Isometry3d constant = Eigen::Isometry3d::Identity();
  int parameter = -1;  // among the geometric ones; -1: none
  bool translation = false;
  int axis = 0;
  double sign = 1.0;
};

std::vector<Step> steps_at(const Experiment& experiment, const Eigen::VectorXd& q) {
  std::vector<Step> steps(1);
  const std::vector<std::size_t>& free = experiment.free.geometric();
  for (const ChainFactor& factor : chain_factors(experiment.model)) {
    if (factor.source == ChainFactor::Source::fixed) {
      steps.back().constant = steps.back().constant * to_eigen(factor.frame);
    } else if (factor.source == ChainFactor::Source::joint) {
      steps.back().constant = steps.back().constant * to_eigen(factor.motion.pose(q[static_cast<Index>(factor.index)]));
    } else if (const auto found = std::find(free.begin(), free.end(), factor.index); found != free.end()) {
      const Vector3d axis = to_eigen(factor.motion.JointAxis());
      Step& step = steps.back();
      step.parameter = static_cast<int>(found - free.begin());
      step.translation = factor.motion.getType() == KDL::Joint::TransAxis;
      Index largest = 0;
      axis.cwiseAbs().maxCoeff(&largest);
      step.axis = static_cast<int>(largest);
      step.sign = axis[largest] > 0.0 ? 1.0 : -1.0;
      steps.emplace_back();
    }
  }
  return steps;
}

// Carries the three points from the flange to the base: fewer operations than products of rotations.
struct PointResiduals {
  std::vector<Step> steps;
  std::array<Vector3d, 3> measured;

  template <class T>
  bool operator()(const T* base, const T* geometric, const T* tools, T* residuals) const {
    std::array<T, 9> points;
    std::copy_n(tools, 9, points.begin());
    for (auto step = steps.rbegin(); step != steps.rend(); ++step) {
      if (step->parameter >= 0) {
        const T value = step->sign * geometric[step->parameter];
        const int x = (step->axis + 1) % 3;
        const int y = (step->axis + 2) % 3;
        const T s = step->translation ? value : sin(value);
        const T c = step->translation ? value : cos(value);
        for (int k = 0; k < 9; k += 3) {
          if (step->translation) {
            points[static_cast<std::size_t>(k + step->axis)] += value;
            continue;
          }
          T& first = points[static_cast<std::size_t>(k + x)];
          T& second = points[static_cast<std::size_t>(k + y)];
          const T turned = c * first - s * second;
          second = s * first + c * second;
          first = turned;
        }
      }
      const Eigen::Matrix3d R = step->constant.linear();
      const Vector3d p = step->constant.translation();
      for (std::size_t k = 0; k < 9; k += 3) {
        const std::array<T, 3> v = {points[k], points[k + 1], points[k + 2]};
        for (Index r = 0; r < 3; ++r) {
          points[k + static_cast<std::size_t>(r)] = R(r, 0) * v[0] + R(r, 1) * v[1] + R(r, 2) * v[2] + p[r];
        }
      }
    }
    for (std::size_t k = 0; k < 3; ++k) {
      std::array<T, 3> turned;
      ceres::AngleAxisRotatePoint(base + 3, points.data() + 3 * k, turned.data());
      for (std::size_t c = 0; c < 3; ++c) {
        residuals[3 * k + c] = turned[c] + base[c] - measured[k][static_cast<Index>(c)];
      }
    }
    return true;
  }
};

}  // namespace

Outcome fit_with_ceres(const Experiment& experiment, const Measurements& measured, CeresSolver solver,
                       int max_iterations) {
  std::array<double, kBase> base = {};
  std::array<double, kGeometric> geometric = {};
  std::array<double, kTools> tools = {};
  const Estimate start = experiment.nominal();
  for (std::size_t k = 0; k < 3; ++k) {
    Eigen::Map<Vector3d>(tools.data() + 3 * k) = start.targets[k].X_FT.translation();
  }
  ceres::Problem problem;
  for (std::size_t i = 0; i + 2 < measured.observations.size(); i += 3) {
    auto* residuals = new PointResiduals;
    residuals->steps = steps_at(experiment, measured.joint_values.col(measured.observations[i].configuration));
    for (std::size_t k = 0; k < 3; ++k) {
      const Observation& o = measured.observations[i + k];
      residuals->measured[static_cast<std::size_t>(o.target)] = o.position();
    }
    problem.AddResidualBlock(new ceres::AutoDiffCostFunction<PointResiduals, 9, kBase, kGeometric, kTools>(residuals),
                             nullptr, base.data(), geometric.data(), tools.data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = solver == CeresSolver::dense_qr ? ceres::DENSE_QR : ceres::DENSE_NORMAL_CHOLESKY;
  options.num_threads = 1;
  options.max_num_iterations = max_iterations;
  options.initial_trust_region_radius = 1e16;
  options.function_tolerance = 0.0;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 1e-11;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return {.iterations = static_cast<int>(summary.iterations.size()) - 1,
          .rms = std::sqrt(2.0 * summary.final_cost / static_cast<double>(measured.observations.size()))};
}

}  // namespace kdl_calibration::benchmarks
