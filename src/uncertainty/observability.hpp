#pragma once

#include <Eigen/Core>

namespace kdl_calibration {

/// Observability indices of a Jacobian with p columns, n configurations and singular values s1 >= … >= sp:
///   O1 = (s1 … sp)^(1/p) / sqrt(n)  (Borm and Menq 1991),  O2 = sp / s1,  O3 = sp,  O4 = sp^2 / s1,
///   O5 = 1 / (1/s1 + … + 1/sp)  (Driels and Pathre 1990; Nahvi et al. 1994; Nahvi and Hollerbach 1996; Sun and
/// Hollerbach 2008). The columns are not scaled to unit norm, as that would hide the differences that the indices
/// measure.
struct ObservabilityIndices {
  double O1 = 0.0, O2 = 0.0, O3 = 0.0, O4 = 0.0, O5 = 0.0;
};
ObservabilityIndices observability_indices(const Eigen::MatrixXd& jacobian, Eigen::Index configurations);

}  // namespace kdl_calibration
