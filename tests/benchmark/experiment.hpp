#pragma once

// The published experiment: errors of the irreducible model, three tools, N random configurations without noise.

#include "../virtual_experiment.hpp"
#include "estimation/identification.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration::benchmarks {

struct Experiment : testing::VirtualExperiment {
  Experiment() : VirtualExperiment({.sizes = {}, .ranges = published_ranges}) {}

  Measurements measurements(int count, std::uint64_t seed = 1, double sigma = 0.0) const {
    VirtualExperiment drawn = *this;
    drawn.restart(Random(seed));
    return drawn.measure(count, {.sigma = sigma});
  }
  /// Nominal geometry, base and tools: the start of all that is compared.
  Estimate nominal() const {
    return {.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size())),
            .frames = {.targets = published_targets()},
            .effects = {}};
  }
};

inline const Experiment& experiment() {
  static const Experiment instance;
  return instance;
}

/// One Gauss-Newton fit or iteration as others would write it.
struct Outcome {
  int iterations = 0;
  double rms = 0.0;  // [m] over the points
};

/// Analytic Jacobian stacked row by row and solved by QR of the normal equations, in plain Eigen.
Outcome fit_with_plain_eigen(const Experiment& experiment, const Measurements& measured, int max_iterations);
/// The same, with the Jacobian from KDL's solver for the chain in which every error is a joint.
Outcome fit_with_kdl(const Experiment& experiment, const Measurements& measured, int max_iterations);

enum class CeresSolver { dense_normal_cholesky, dense_qr };
/// Automatic differentiation, one residual block per configuration.
Outcome fit_with_ceres(const Experiment& experiment, const Measurements& measured, CeresSolver solver,
                       int max_iterations);

}  // namespace kdl_calibration::benchmarks
