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
  std::vector<std::string> tied_to;  ///< base or target parameters with the same effect
};

/// The identifiable parameters of the complete model.
struct Reduction {
  std::vector<std::string> kept;      ///< all names in declared order: base, targets, joint offsets, links
  std::vector<GaugeParameter> gauge;  ///< joint offsets exactly equivalent to a motion of base or targets: zero
  std::vector<DroppedParameter> dropped;
  int candidates = 0;
  int rank = 0;
  std::vector<std::string>
      replaceable;  ///< kept parameters that the other kept ones can nearly replace, so that noise may hide them
};

/// Configurations at which all parameters that can be told apart move the targets differently.
constexpr int kGenericConfigurations = 60;

struct ReductionOptions {
  std::vector<std::string> fixed;               ///< names of known base and target parameters, no candidates
  int configurations = kGenericConfigurations;  ///< uniform in ±π (±1 m for prismatic joints)
  std::uint64_t seed = 1;
  Eigen::VectorXd errors;  ///< geometry for the reduction, one value per parameter; empty: nominal
  double noise = 0.0;      ///< [m] 1 sigma of a measured coordinate: drops parameters that it hides; 0: none
};

/// The irreducible model: the columns kept by independent_columns of the Jacobian of measured positions and
/// orientations, stacked over seeded generic configurations. With noise, a geometric error must also be visible: the
/// part of its column outside the span of the kept ones, times its usual size, exceeds a tenth of the noise (RMS over
/// the coordinates).
Reduction reduced_model(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                        const ReductionOptions& options = {});

/// Least part of a column outside the span of the kept ones.
struct ColumnLimits {
  double clear = 0.05;   ///< relative to its norm, to be kept in the first pass
  double least = 1e-6;   ///< relative to its norm, to be kept in the second pass
  Eigen::VectorXd seen;  ///< least norm of that part in the second pass; one per column, empty: any
};

/// A well conditioned choice of columns with the same span as all candidates. The first pass, from left to right, keeps
/// each column whose angle to the span of the kept ones has a sine of at least `clear`. So nearly parallel columns are
/// not both kept before better later ones. The second pass repeatedly keeps the one with the largest sine (the first of
/// those above half of it), down to `least` and `seen`. Columns of rounding size are left out. `replaceable`, if given,
/// marks the columns of the second pass.
///
/// With unit columns and a sine of s for the k-th kept one, the smallest singular value is at least of the order of s,
/// so that uncertainties of parameters kept in the first pass are at most some twenty times those with orthogonal
/// columns. The choice of the largest sine is that of a QR factorisation with column pivoting (Businger and Golub
/// 1965), started from the declared order.
std::vector<bool> independent_columns(const Eigen::MatrixXd& columns, const std::vector<bool>& candidate,
                                      const ColumnLimits& limits = {}, std::vector<bool>* replaceable = nullptr);

/// `count` generic targets for use before measurement: seeded points within about 0.2 m of the flange.
std::vector<TargetFrame> generic_targets(int count, std::uint64_t seed = 1);

}  // namespace kdl_calibration
