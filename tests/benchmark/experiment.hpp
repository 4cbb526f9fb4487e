#pragma once

// The published experiment: errors of the irreducible model, three tools, N random configurations without noise.

#include <string>
#include <vector>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/simulation.hpp"

namespace kdl_calibration::benchmarks {

struct Experiment {
  ErrorModel model = complete_model(load_robot(std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf"));
  Reduction reduction = reduced_model(model, published_targets());
  Unknowns free = Unknowns(model, published_targets(), reduction.kept);

  VirtualRobot robot(Random& random) const {
    return virtual_robot(model, free.geometric(), published_targets(), {}, random);
  }
  Measurements measurements(int configurations, std::uint64_t seed = 1, double sigma = 0.0) const {
    Random random(seed);
    const VirtualRobot truth = robot(random);
    return measure(truth, random_configurations(published_ranges(model.joints), configurations, random),
                   {.sigma = sigma}, random);
  }
  /// Nominal geometry, base and tools: the start of all that is compared.
  Estimate nominal() const {
    return {.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size())),
            .X_WB = Eigen::Isometry3d::Identity(),
            .targets = published_targets(),
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
