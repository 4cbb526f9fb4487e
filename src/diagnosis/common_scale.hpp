#pragma once

// One factor on all lengths, or on those of one station.

#include <cstddef>
#include <vector>

#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

struct CommonScale {
  double factor = 1.0;   ///< fitted over nominal length
  double p_value = 1.0;  ///< that independent errors agree with one factor as well
};

/// The factor on all lengths of the arm that explains the fitted geometric errors best. A fit behind a wrong unit or a
/// wrong refractive index finds such errors. No factor (1, p-value 1) where the base is known or fewer than six errors
/// are free.
CommonScale common_scale(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                         const Unknowns& free);

/// Stations whose lengths contradict those of the others, the clearest first: one of two (either may be wrong), else
/// fewer than half of them, and at most three or a tenth. Each is significant among all stations.
struct StationScales {
  struct One {
    std::size_t station = 0;
    double factor = 1.0;  ///< on its lengths, with which they would agree
  };
  std::vector<One> stations;
  double misfit = 0.0;   ///< [m] RMS of the measured coordinates and distances after a linear fit
  double left = 0.0;     ///< [m] the same with these factors
  double freedom = 0.0;  ///< of `left`
};

StationScales scales_of_stations(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                                 const Unknowns& free);

/// [m] RMS of the measured coordinates and distances, `factor` times as long as they were read, from those of the
/// nominal arm with registered bases and targets.
double nominal_misfit(const ErrorModel& model, const Measurements& measurements, double factor);

}  // namespace kdl_calibration
