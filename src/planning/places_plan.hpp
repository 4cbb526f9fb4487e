#pragma once

#include <Eigen/Core>
#include <vector>

#include "planning/places.hpp"
#include "planning/planner.hpp"

namespace kdl_calibration {

/// A plan for several stations, single coordinates, distances, or a plate with sockets.
struct PlacesPlan {
  PlacedRows rows;  ///< the chosen configurations, in the order to drive them, of the nominal robot at the best places
  DeterminedByRows determined;
  MeasuringPlan sheet;
  Prediction planned;    ///< of points in the base frame, over the tasks; infinite if the arm is not determined
  Prediction random;     ///< mean of 20 random designs at the same places
  double seconds = 0.0;  ///< travel time [s]
  std::vector<NarrowedRange> narrowed;  ///< joints that the cell's constraints keep from most of their range
};

/// Draws `starts` sets of places with a share of the candidates each, all within the cell, and at each set exchanges
/// configurations for others at the same place until no exchange of one lowers the volume of the confidence ellipsoid
/// of the arm's parameters, whatever the bases are (D_s-optimality: the largest det M / det M_b for the information M
/// and its block M_b of the bases; Atkinson, Donev and Tobias 2007, section 10.3). Keeps the best set. Each place has
/// as many configurations. Of the request `criterion`, `accuracy`, `priors`, `measured`, `calibrated`, `effects`,
/// `trying` and `monte_carlo` are not used. Throws InputError as rows_at() and candidates() do, and if the arm is not
/// determined.
PlacesPlan plan_at_places(const PlanRequest& request, const Places& places);

}  // namespace kdl_calibration
