#include "kdl_calibration/lack_of_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <tuple>
#include <utility>

#include "kdl_calibration/input_check.hpp"
#include "kdl_calibration/kinematics.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

std::vector<double> explained_by_joints(const ErrorModel& model, const Estimate& estimate,
                                        const Measurements& measurements) {
  check(measurements, model);
  check(estimate, model, measurements);
  const Measurements means = averaged(measurements);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, means.joint_values);
  std::vector<const Observation*> rows;
  for (const Observation& o : means.observations) {
    if (o.split == Split::train) {
      rows.push_back(&o);
    }
  }
  const auto n = static_cast<Index>(rows.size());
  Eigen::MatrixX3d residuals(n, 3);
  for (Index r = 0; r < n; ++r) {
    const Observation& o = *rows[static_cast<std::size_t>(r)];
    residuals.row(r) =
        o.position - estimate.X_WB * (X_BF[static_cast<std::size_t>(o.configuration)] *
                                      estimate.targets[static_cast<std::size_t>(o.target)].X_FT.translation());
  }
  const double total = residuals.squaredNorm();
  std::vector<double> explained;
  for (Index j = 0; j < means.joint_values.rows(); ++j) {
    MatrixXd terms(n, 3);
    for (Index r = 0; r < n; ++r) {
      const double q = means.joint_values(j, rows[static_cast<std::size_t>(r)]->configuration);
      terms.row(r) << 1.0, std::sin(q), std::cos(q);
    }
    const MatrixXd fitted = terms * terms.completeOrthogonalDecomposition().solve(residuals);
    explained.push_back(total > 0.0 ? 1.0 - (residuals - fitted).squaredNorm() / total : 0.0);
  }
  return explained;
}

}  // namespace kdl_calibration
