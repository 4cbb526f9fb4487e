#include "two_step/identification_jacobian.hpp"

#include "base/preconditions.hpp"
#include "estimation/identification.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"
#include "two_step/matrix_derivatives.hpp"
#include "two_step/two_step.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

}  // namespace

MatrixXd identification_jacobian(const ErrorModel& model, const Estimate& estimate, const Unknowns& free,
                                 const Eigen::VectorXd& q) {
  if (!free.effects().empty()) {
    refuse_input("the published identification Jacobian has no columns for effects", "none to be free");
  }
  const Eigen::Isometry3d X_BF = flange_pose(folded(model, estimate.errors), q);
  const std::vector<ChainFactor> factors = chain_factors(model);
  const MatrixProduct product = matrix_product(factors, estimate.errors, q);
  const Eigen::Matrix3d R_WB = estimate.frames.base().linear();
  const ColumnRange base = free.range(UnknownGroup::base);
  const ColumnRange geometric = free.range(UnknownGroup::geometric);
  MatrixXd J = MatrixXd::Zero(3 * static_cast<Index>(estimate.frames.targets.size()), free.size());
  for (std::size_t k = 0; k < estimate.frames.targets.size(); ++k) {
    const Eigen::Vector3d p_F = estimate.frames.targets[k].X_FT.translation();
    const Eigen::Vector3d p_B = X_BF * p_F;
    auto rows = J.middleRows<3>(3 * static_cast<Index>(k));
    for (Index c = 0; c < base.count; ++c) {  // right-multiplied by a small motion in its own frame
      const std::size_t i = free.of(UnknownGroup::base)[static_cast<std::size_t>(c)];
      const Eigen::Vector3d axis = Eigen::Vector3d::Unit(static_cast<Index>(i % 3));
      rows.col(base.first + c) = R_WB * (i < 3 ? axis : Eigen::Vector3d(axis.cross(p_B)));
    }
    rows.middleCols(geometric.first, geometric.count) = R_WB * point_columns(factors, product, free.geometric(), p_F);
    for (std::size_t i = 0; i < 3; ++i) {  // a target's rotation does not move its point
      if (const int column = free.target_columns(k)[i]; column >= 0) {
        rows.col(column) = R_WB * X_BF.linear().col(static_cast<Index>(i));
      }
    }
  }
  return J;
}

MatrixXd base_and_tool_matrix(const ErrorModel& model, const Estimate& estimate, const Eigen::VectorXd& q) {
  const auto tools = static_cast<Index>(estimate.frames.targets.size());
  const Eigen::Isometry3d T_robot = flange_pose(folded(model, estimate.errors), q);
  MatrixXd A(3 * tools, 6 + 3 * tools);
  for (Index j = 0; j < tools; ++j) {
    A.middleRows<3>(3 * j) = base_and_tool_rows(T_robot, j, tools);
  }
  return A;
}

std::vector<std::string> base_and_tool_names(const std::vector<TargetFrame>& targets) {
  std::vector<std::string> vectors = {"p_base", "phi_base"};
  for (const TargetFrame& target : targets) {
    vectors.push_back("u_" + target.name);
  }
  std::vector<std::string> names;
  for (const std::string& vector : vectors) {
    for (const char* axis : {".x", ".y", ".z"}) {
      names.push_back(vector + axis);
    }
  }
  return names;
}

}  // namespace kdl_calibration
