#include "two_step/matrix_derivatives.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <kdl/chainjnttojacsolver.hpp>

#include "model/error_chains.hpp"
#include "model/manipulator_jacobian.hpp"

namespace kdl_calibration {
namespace {

struct MatrixFactor {
  Eigen::Matrix4d value;
  Eigen::Matrix4d derivative;  // zero for a fixed factor
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
  const std::ptrdiff_t parameters = count_of(ChainFactor::Source::parameter, factors);
  const Eigen::Vector4d homogeneous = point.homogeneous();
  Matrix3Xd all = Matrix3Xd::Zero(3, parameters);
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (factors[i].source == ChainFactor::Source::parameter) {
      all.col(static_cast<Eigen::Index>(factors[i].index)) = (product.derivatives[i] * homogeneous).head<3>();
    }
  }
  return all(Eigen::all, which);
}

namespace {

Matrix6Xd kdl_jacobian(const KDL::Chain& chain, const Eigen::VectorXd& q) {
  KDL::JntArray joints(chain.getNrOfJoints());
  joints.data = q;
  KDL::Jacobian jacobian(chain.getNrOfJoints());
  KDL::ChainJntToJacSolver(chain).JntToJac(joints, jacobian);
  return jacobian.data;
}

Matrix6Xd matrix_derivative_jacobian(const ErrorModel& model, const Eigen::VectorXd& errors, const Eigen::VectorXd& q) {
  const std::vector<ChainFactor> factors = chain_factors(model);
  const MatrixProduct product = matrix_product(factors, errors, q);
  const Eigen::Matrix3d orientation_transposed = product.pose.topLeftCorner<3, 3>().transpose();
  Matrix6Xd jacobian(6, q.size());
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (factors[i].source != ChainFactor::Source::joint) {
      continue;
    }
    // dR R^T = [omega]x
    const Eigen::Matrix4d& derivative = product.derivatives[i];
    const Eigen::Matrix3d spin = derivative.topLeftCorner<3, 3>() * orientation_transposed;
    auto column = jacobian.col(static_cast<Eigen::Index>(factors[i].index));
    column << derivative.topRightCorner<3, 1>(), spin(2, 1), spin(0, 2), spin(1, 0);
  }
  return jacobian;
}

Matrix6Xd cross_product_jacobian(const FoldedChain& chain, const Eigen::VectorXd& q) {
  Matrix6Xd jacobian(6, q.size());
  manipulator_jacobian(chain, q, jacobian);
  return jacobian;
}

}  // namespace

ManipulatorJacobians manipulator_jacobians(const ErrorModel& model, const Eigen::VectorXd& errors,
                                           const Eigen::VectorXd& q) {
  ManipulatorJacobians result{.kdl = kdl_jacobian(error_chain(model, errors), q),
                              .matrix_derivative = matrix_derivative_jacobian(model, errors, q),
                              .cross_product = cross_product_jacobian(folded(model, errors), q)};
  result.largest_difference = std::max((result.kdl - result.matrix_derivative).cwiseAbs().maxCoeff(),
                                       (result.kdl - result.cross_product).cwiseAbs().maxCoeff());
  return result;
}

}  // namespace kdl_calibration
