#pragma once

// What the measurements determine at the end of a fit, and how well. Not installed.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "calibration/determined_fit.hpp"
#include "calibration/noise_stage.hpp"
#include "kdl_calibration/calibration.hpp"

namespace kdl_calibration {

struct Assessment {
  Identifiability identifiability;  ///< of base, targets and geometry among the candidates, by the measurements alone
  std::vector<std::string> fixed_by_gauge;
  bool determined = true;  ///< whether all candidates are, with what the priors say of them
  ObservabilityIndices observability;
  NoiseReport noise;
  Eigen::MatrixXd covariance;  ///< of the columns that were estimated
  Influence influence;
  Eigen::MatrixXd root;  ///< R of the whitened system of these columns, see WhitenedSummary::sqrt_information
  Eigen::MatrixXd candidate_sqrt_information;  ///< of the candidates' system
};

/// `fit`: its rows, weighed as at its end.
Assessment assess(const FitProblem& fit, const DeterminedFit& fitted, const NoiseModel& stated,
                  const EstimatedNoise& estimated);

/// The fit, whose termination and message say what the assessment found open. A fit alone does not know that.
Identification with_open_directions(const Identification& found, const Assessment& assessed, ModelChoice model);

}  // namespace kdl_calibration
