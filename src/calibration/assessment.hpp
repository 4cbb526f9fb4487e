#pragma once

// Determined parameters and their uncertainty at the end of a fit.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "calibration/determined_fit.hpp"
#include "calibration/noise_stage.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

struct Assessment {
  Identifiability identifiability;  ///< of the candidates of base, targets and geometry, without priors
  std::vector<std::string> fixed_by_gauge;
  bool determined = true;  ///< whether all candidates are determined, given the priors
  ObservabilityIndices observability;
  NoiseReport noise;
  Eigen::MatrixXd covariance;  ///< of the estimated columns
  Influence influence;
  Eigen::MatrixXd shifts;  ///< see Uncertainty
  Eigen::MatrixXd root;    ///< R of the whitened system of these columns, see WhitenedSummary::sqrt_information
  Eigen::MatrixXd candidate_sqrt_information;  ///< of the candidates' system
};

/// `fit`: with the weights at its end.
Assessment assess(const FitProblem& fit, const DeterminedFit& fitted, const NoiseModel& stated,
                  const EstimatedNoise& estimated);

/// The fit with termination and message updated by the undetermined directions that only the assessment finds.
Identification with_undetermined_directions(const Identification& found, const Assessment& assessed, ModelChoice model);

}  // namespace kdl_calibration
