#pragma once

#include <span>
#include <vector>

#include "diagnosis/alternative_readings.hpp"
#include "diagnosis/explanations.hpp"
#include "diagnosis/mistake_trial.hpp"
#include "diagnosis/ordinary_fit.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Throws InputError for names that are no words or not unique, alternatives without readings, a joint that the robot
/// does not have, and functions that give anything but finite columns at the measured configurations.
void require_alternatives(const DiagnosisOptions& options, const ErrorModel& model, const Measurements& measurements);

struct OwnTrials {
  std::vector<MistakeFamily> families;     ///< of one trial for each alternative that shows
  std::vector<AlternativeReading> hidden;  ///< remarks about the others
};

/// The alternatives of FitToDoubt. One is hidden if some combination of its columns is constant, or in the span of what
/// the result estimates: no measurement tells it from that. The trials keep a reference to the fit.
OwnTrials try_alternatives(const OrdinaryFit& fit, const Explanations& explanations,
                           std::span<const OwnAlternative> alternatives);

/// Its estimate in words: "alternative tilt, 0.0002 +- 3e-06 times its function".
std::string said_estimate(const std::string& subject, const Explained& found);
/// Estimate and 1 sigma of each column, numbered if there are several, and their number.
std::vector<NamedFigure> figures_of_columns(const Explained& found);

/// Remarks that name the alternatives of which no reading says anything, as another one came before them.
std::vector<AlternativeReading> untried(std::span<const OwnAlternative> alternatives,
                                        const std::vector<AlternativeReading>& readings);

}  // namespace kdl_calibration
