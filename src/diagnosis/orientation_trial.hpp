#pragma once

// Other readings of the measured orientations.

#include <optional>

#include "diagnosis/alternative_readings.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

struct OrientationTrial {
  bool explained = false;     ///< whether another reading fits
  bool of_most_rows = false;  ///< whether at least 80 % of all rows turn with the arm in another reading of the file
  AlternativeReading said;    ///< its subjects are the first row that does not turn with the arm, or the worst one
};

/// Compares measured orientations of the training rows with the flange's. The target's orientation on the flange is the
/// one that most of its rows agree on within 0.1 rad (consensus of Fischler and Bolles 1981, every row a candidate). A
/// row is an outlier if it is off by more than one degree and ten times the median of the rows that agree. Outliers are
/// tried as inverses and with their components in another order, and all rows also as angles about fixed or moving axes
/// or as a rotation vector. Returns nothing if there is no outlier.
std::optional<OrientationTrial> try_orientations(const ErrorModel& model, const Measurements& measurements,
                                                 const Estimate& fit);

}  // namespace kdl_calibration
