#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

struct DroppedParameter {
  std::string name;
  std::map<std::string, double> replaced_by;  ///< coefficients, m/m, rad/rad, or mixed; to first order at nominal
};

struct GaugeParameter {
  std::string name;
  std::vector<std::string> tied_to;  ///< base or target parameters that do the same
};

/// What of the complete model can be told apart.
struct Reduction {
  std::vector<std::string> kept;      ///< all names in declared order: base, targets, joint offsets, links
  std::vector<GaugeParameter> gauge;  ///< joint offsets that only move base or targets: zero, exact for finite values
  std::vector<DroppedParameter> dropped;
  int candidates = 0;
  int rank = 0;
  std::vector<std::string>
      faint;  ///< of the kept ones those that are nearly replaced by the others: noise may hide them
};

struct ReductionOptions {
  std::vector<std::string> fixed;  ///< names of base and target parameters that are known and so no candidates
  int configurations = 60;         ///< generic ones, uniform in ±π (±1 m for prismatic joints)
  std::uint64_t seed = 1;
  Eigen::VectorXd errors;  ///< the geometry at which to tell, one value per parameter of the model; empty: nominal
  double noise = 0.0;      ///< [m] 1 sigma of a measured coordinate: what it hides beside others is dropped; 0: nothing
};

/// The irreducible model: of the columns of the stacked Jacobian of the measured positions and orientations over seeded
/// generic configurations those that independent_columns keeps. With noise, a geometric error must also be able to
/// show: what its column does that the kept ones cannot, times the usual size of such an error, is more than a tenth of
/// the noise (RMS over the coordinates).
Reduction reduced_model(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                        const ReductionOptions& options = {});

/// What must be left of a column outside the span of those kept.
struct ColumnLimits {
  double clear = 0.05;   ///< relative to its norm, for being kept because it comes first
  double least = 1e-6;   ///< relative to its norm, for being kept at all
  Eigen::VectorXd seen;  ///< the norm of it, for being kept in the second pass; one per column, empty: any
};

/// A well conditioned choice of columns that spans what all candidates do. First, from left to right, each column that
/// is clearly its own: the sine of its angle to the span of those kept is at least `clear`. Nearly parallel columns
/// are no reason to keep both of two before better ones that come later. Then, of what is left, again and again the
/// one with the largest sine (the first of those above half of it), down to `least` and to what can be seen. Columns
/// of rounding size have no effect and are left out. `faint`, if given, becomes true for what the second pass kept.
///
/// With unit columns and a sine of s for the k-th kept one, the smallest singular value is at least of the order of s,
/// so that values and uncertainties of what is kept in the first pass are at most some twenty times those of a model
/// with orthogonal columns. The choice of the largest sine is that of a QR factorisation with column pivoting
/// (Businger and Golub 1965), started from the declared order.
std::vector<bool> independent_columns(const Eigen::MatrixXd& columns, const std::vector<bool>& candidate,
                                      const ColumnLimits& limits = {}, std::vector<bool>* faint = nullptr);

/// `count` generic targets for use before anything is measured: seeded points some 0.2 m around the flange.
std::vector<TargetFrame> generic_targets(int count, std::uint64_t seed = 1);

}  // namespace kdl_calibration
