#pragma once

// Not installed.

#include <vector>

namespace kdl_calibration {

/// What the sizes of such values exceed by chance in one of two hundred sets, however heavy their tails are: 0 where
/// there are too few values to tell. They are taken for a Student's t whose degrees of freedom nu the values tell
/// themselves, by the likelihood of each nu with the scale that fits it best, 1 / nu beforehand uniform from 0 (normal)
/// to 0.4. The largest values, which may be defects, count as larger than the others at first, whatever they are; half
/// of them at a time come back as long as they stay below the limit that the others set, so that a single defect faces
/// all other values (as in Rosner's test of many outliers, 1983).
double limit_of_heavy_tails(std::vector<double> sizes);

}  // namespace kdl_calibration
