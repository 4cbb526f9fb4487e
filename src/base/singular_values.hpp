#pragma once

// Apart from the other decompositions because it takes as long to compile as all of them.

#include <Eigen/Core>

namespace kdl_calibration {

/// Singular values in falling order, and all right singular vectors. For more than kManyColumns by divide and conquer:
/// ten times faster, exact relative to the largest value only.
constexpr Eigen::Index kManyColumns = 100;
struct SingularSystem {
  Eigen::VectorXd values;
  Eigen::MatrixXd V;
};
SingularSystem singular_system(const Eigen::MatrixXd& matrix);
Eigen::VectorXd singular_values(const Eigen::MatrixXd& matrix);

}  // namespace kdl_calibration
