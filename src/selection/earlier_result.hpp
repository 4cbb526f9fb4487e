#pragma once

// A calibration that continues an earlier one of the same robot.

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "estimation/residual_options.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// What the earlier result says of the arm; base and targets are new.
struct EarlierResult {
  std::vector<EffectTerm> terms;
  GaussianPrior prior;               ///< of geometric errors and effects, in the order of Unknowns
  Eigen::VectorXd rigid;             ///< these geometric errors of the exported URDF, which has no effects
  std::vector<TargetFrame> targets;  ///< they decided which parameters there are
  NoiseModel noise;
};

/// How the measurements agree with the earlier result.
struct EarlierComparison {
  double chi_square = 0.0;  ///< as in Comparison
  double degrees_of_freedom = 0.0;
  double p_value = 1.0;
  /// Geometric errors that may have changed, and by how much [m] or [rad]. The first one exceeds its earlier sigma
  /// most.
  std::vector<std::pair<std::string, double>> changes;
  std::size_t changeable = 0;  ///< number of geometric errors
  double noise_ratio = 1.0;    ///< of the measurements with these changes, to that of the earlier result
  /// Joints whose zero may have changed without a trace: a new base or new targets take it up.
  std::vector<std::string> unseen_zeros;

  bool has_changed() const { return p_value < 1e-3; }
  /// A crash changes few errors. Here many have changed, or few changes do not explain the measurements.
  bool contradicts() const { return has_changed() && (3 * changes.size() > changeable || noise_ratio > 3.0); }
};

/// "dq2 by 0.02826 degrees", for each change.
std::vector<std::string> in_words(const ErrorModel& model, const EarlierComparison& comparison);

struct ContinuedResult {
  std::shared_ptr<const GaussianPrior> prior;  ///< with the variances of the changes
  std::shared_ptr<const GaussianPrior> rigid;  ///< the same of the arm without effects
  NoiseModel noise;                            ///< scaled to the measurements
  EarlierComparison comparison;
};

/// Compares training measurements with the earlier result, and gives the prior of the new fit. A crash changes few
/// errors, and old variances would hold these. So each geometric error may have changed by a normal value of its own 1
/// sigma, which maximises the evidence (automatic relevance determination, MacKay 1992). Most become zero. `rigid`: the
/// model without effects; `options`: the noise. Throws InputError if the earlier covariance is not positive definite.
ContinuedResult continue_result(const ErrorModel& rigid, const Measurements& training, const EarlierResult& earlier,
                                const ResidualOptions& options);

}  // namespace kdl_calibration
