#pragma once

#include <vector>

namespace kdl_calibration {

/// The limit that correct values exceed in one of two hundred sets, whatever the weight of their tails; 0 for too few
/// values. Values follow a scaled Student's t. Its degrees of freedom nu are estimated by likelihood, with the best
/// scale for each nu and 1 / nu uniform from 0 (normal) to 0.4 beforehand. The largest values may be defects and are
/// censored at first. Half of them at a time are readmitted while they stay below the limit of the others, as in
/// Rosner's test of many outliers (1983).
double limit_of_heavy_tails(std::vector<double> sizes);

}  // namespace kdl_calibration
