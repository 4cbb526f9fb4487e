#include "uncertainty/observability.hpp"

#include <Eigen/Dense>
#include <cmath>

#include "base/decompositions.hpp"
#include "base/singular_values.hpp"
#include "uncertainty/unit_columns.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

ObservabilityIndices observability_indices(const MatrixXd& jacobian, Index configurations) {
  ObservabilityIndices indices;
  if (jacobian.size() == 0) {
    return indices;
  }
  const VectorXd s = singular_values(triangular_factor(jacobian));
  const double smallest = s.size() < jacobian.cols() ? 0.0 : s[s.size() - 1];
  if (!(smallest > 0.0)) {
    return indices;
  }
  indices.O1 = std::exp(s.array().log().mean()) / std::sqrt(static_cast<double>(configurations));
  indices.O2 = smallest / s[0];
  indices.O3 = smallest;
  indices.O4 = smallest * smallest / s[0];
  indices.O5 = 1.0 / s.cwiseInverse().sum();
  return indices;
}

}  // namespace kdl_calibration
