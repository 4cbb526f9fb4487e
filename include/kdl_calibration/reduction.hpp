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
};

struct ReductionOptions {
  std::vector<std::string> fixed;  ///< names of base and target parameters that are known and so no candidates
  int configurations = 60;         ///< generic ones, uniform in ±π (±1 m for prismatic joints)
  std::uint64_t seed = 1;
  double tolerance = 1e-8;  ///< a column whose part outside the span of those before it is below this is redundant
};

/// The irreducible model: keeps, in declared order, each candidate whose column raises the rank of the stacked
/// Jacobian (from KDL's solver) of the measured positions and orientations over seeded generic configurations.
Reduction reduced_model(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                        const ReductionOptions& options = {});

/// Which columns raise the rank, taken from left to right: each candidate whose part outside the span of those kept
/// before it exceeds `tolerance` times its norm. Columns without an entry above 1e-12 have no effect.
std::vector<bool> columns_that_raise_the_rank(const Eigen::MatrixXd& columns, const std::vector<bool>& candidate,
                                              double tolerance);

/// `count` generic targets for use before anything is measured: seeded points some 0.2 m around the flange.
std::vector<TargetFrame> generic_targets(int count, std::uint64_t seed = 1);

}  // namespace kdl_calibration
