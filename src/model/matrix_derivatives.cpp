#include "kdl_calibration/matrix_derivatives.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "base/preconditions.hpp"

namespace kdl_calibration {
namespace {

struct MatrixFactor {
  Eigen::Matrix4d value;
  Eigen::Matrix4d derivative;  // zero where the factor is fixed
};

MatrixFactor matrix_factor(const ChainFactor& factor, const Eigen::VectorXd& errors, const Eigen::VectorXd& q) {
  MatrixFactor result{.value = Eigen::Matrix4d::Identity(), .derivative = Eigen::Matrix4d::Zero()};
  if (factor.source == ChainFactor::Source::fixed) {
    result.value = to_eigen(factor.frame).matrix();
    return result;
  }
  const auto index = static_cast<Eigen::Index>(factor.index);
  const double x = factor.source == ChainFactor::Source::joint ? q[index] : errors[index];
  const Eigen::Vector3d axis = to_eigen(factor.motion.JointAxis());
  if (factor.motion.getType() == KDL::Joint::TransAxis) {
    result.value.topRightCorner<3, 1>() = axis * x;
    result.derivative.topRightCorner<3, 1>() = axis;
    return result;
  }
  const Eigen::Matrix3d k = skew(axis);
  result.value.topLeftCorner<3, 3>() += std::sin(x) * k + (1.0 - std::cos(x)) * k * k;
  result.derivative.topLeftCorner<3, 3>() = std::cos(x) * k + std::sin(x) * k * k;
  return result;
}

std::ptrdiff_t count_of(ChainFactor::Source source, const std::vector<ChainFactor>& factors) {
  return std::count_if(factors.begin(), factors.end(), [&](const ChainFactor& f) { return f.source == source; });
}

}  // namespace

MatrixProduct matrix_product(const std::vector<ChainFactor>& factors, const Eigen::VectorXd& errors,
                             const Eigen::VectorXd& q) {
  require_count("errors", errors.size(), count_of(ChainFactor::Source::parameter, factors));
  require_count("joint values", q.size(), count_of(ChainFactor::Source::joint, factors));
  std::vector<MatrixFactor> matrices;
  matrices.reserve(factors.size());
  for (const ChainFactor& factor : factors) {
    matrices.push_back(matrix_factor(factor, errors, q));
  }
  std::vector<Eigen::Matrix4d> behind(factors.size() + 1, Eigen::Matrix4d::Identity());
  for (std::size_t i = factors.size(); i-- > 0;) {
    behind[i] = matrices[i].value * behind[i + 1];
  }
  MatrixProduct result{.pose = Eigen::Matrix4d::Identity(), .derivatives = {}};
  result.derivatives.reserve(factors.size());
  for (std::size_t i = 0; i < factors.size(); ++i) {
    result.derivatives.emplace_back(result.pose * matrices[i].derivative * behind[i + 1]);
    result.pose = result.pose * matrices[i].value;
  }
  return result;
}

Matrix3Xd point_columns(const std::vector<ChainFactor>& factors, const MatrixProduct& product,
                        const std::vector<std::size_t>& which, const Eigen::Vector3d& point) {
  require_count("derivatives", product.derivatives.size(), factors.size());
  const std::ptrdiff_t parameters = count_of(ChainFactor::Source::parameter, factors);
  require_indices("parameter", which, parameters);
  const Eigen::Vector4d homogeneous = point.homogeneous();
  Matrix3Xd all = Matrix3Xd::Zero(3, parameters);
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (factors[i].source == ChainFactor::Source::parameter) {
      require_index("the factor's parameter", factors[i].index, parameters);
      all.col(static_cast<Eigen::Index>(factors[i].index)) = (product.derivatives[i] * homogeneous).head<3>();
    }
  }
  return all(Eigen::all, which);
}

}  // namespace kdl_calibration
