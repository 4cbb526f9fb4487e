#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace kdl_calibration {

/// Which parameters the measurements determine. All figures are those of the whitened Jacobian with its columns scaled
/// to unit norm, which makes them independent of the units of the parameters.
struct Identifiability {
  int columns = 0;
  int rank = 0;
  Eigen::VectorXd singular_values;  ///< descending
  double condition = 0.0;           ///< largest over smallest singular value; infinite if rank deficient
  /// Each group holds parameters that the measurements cannot tell apart; a group of one has no effect at all.
  std::vector<std::vector<std::string>> tied;
  /// Weakly determined: combinations whose singular value is below `weak` times the largest (and not zero), each with
  /// the parameters that make up most of it, heaviest first.
  std::vector<std::vector<std::string>> weak;
};

struct IdentifiabilityOptions {
  double weak = 1e-2;
  double tolerance = 1e-9;  ///< singular values below this times the largest count as zero
};

/// `jacobian`: rows x columns, whitened; `names`: one per column.
Identifiability identifiability(const Eigen::MatrixXd& jacobian, const std::vector<std::string>& names,
                                const IdentifiabilityOptions& options = {});

/// Rank of the scaled Jacobian alone.
int rank_of(const Eigen::MatrixXd& jacobian, const IdentifiabilityOptions& options = {});

}  // namespace kdl_calibration
