#include <Eigen/Dense>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <kdl/chainjnttojacsolver.hpp>

#include "experiment.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"
#include "parameter_chain.hpp"

namespace kdl_calibration::benchmarks {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Gauss-Newton with a stacked Jacobian: `rows` fills three rows of Jacobian and residual for an observation.
template <class Rows>
Outcome gauss_newton(const Experiment& experiment, const Measurements& measured, int max_iterations, const Rows& rows) {
  Estimate estimate = experiment.nominal();
  const auto count = static_cast<Index>(3 * measured.observations.size());
  MatrixXd J(count, experiment.free.size());
  VectorXd e(count);
  Outcome outcome;
  while (outcome.iterations < max_iterations) {
    ++outcome.iterations;
    rows(estimate, J, e);
    const MatrixXd hessian = J.transpose() * J;
    const VectorXd step = hessian.ldlt().solve(J.transpose() * e);
    estimate = experiment.free.moved(estimate, step);
    if ((J * step).norm() <= 1e-12 * std::sqrt(static_cast<double>(count) / 3.0)) {
      break;
    }
  }
  rows(estimate, J, e);
  outcome.rms = e.norm() / std::sqrt(static_cast<double>(count) / 3.0);
  return outcome;
}

}  // namespace

Outcome fit_with_plain_eigen(const Experiment& experiment, const Measurements& measured, int max_iterations) {
  Matrix6Xd chain;
  return gauss_newton(experiment, measured, max_iterations, [&](const Estimate& estimate, MatrixXd& J, VectorXd& e) {
    const FoldedChain folded_now = folded(experiment.model, estimate.errors);
    const std::vector<ParameterTwist> twists =
        chain_twists(experiment.model, folded_now, estimate.errors, experiment.free);
    J.setZero();
    std::int32_t configuration = -1;
    Eigen::Isometry3d X_WF;
    for (std::size_t i = 0; i < measured.observations.size(); ++i) {
      const Observation& o = measured.observations[i];
      if (o.configuration != configuration) {
        configuration = o.configuration;
        X_WF = estimate.frames.base() *
               flange_jacobian(folded_now, twists, measured.joint_values.col(configuration), chain);
      }
      const Vector3d t = estimate.frames.targets[static_cast<std::size_t>(o.target)].X_FT.translation();
      const auto row = static_cast<Index>(3 * i);
      J.block(row, 0, 3, chain.cols()) = chain.topRows<3>() - skew(t) * chain.bottomRows<3>();
      J.block<3, 3>(row, chain.cols() + 3 * o.target).setIdentity();
      e.segment<3>(row) = X_WF.linear().transpose() * (o.position() - X_WF.translation()) - t;
    }
  });
}

Outcome fit_with_kdl(const Experiment& experiment, const Measurements& measured, int max_iterations) {
  const testing::ParameterChain parameters = testing::parameter_chain(experiment.model);
  KDL::ChainJntToJacSolver jacobian_solver(parameters.chain);
  KDL::ChainFkSolverPos_recursive pose_solver(parameters.chain);
  KDL::JntArray joints(parameters.chain.getNrOfJoints());
  KDL::Jacobian jacobian(parameters.chain.getNrOfJoints());
  return gauss_newton(experiment, measured, max_iterations, [&](const Estimate& estimate, MatrixXd& J, VectorXd& e) {
    for (std::size_t p = 0; p < parameters.parameter_index.size(); ++p) {
      joints(parameters.parameter_index[p]) = estimate.errors[static_cast<Index>(p)];
    }
    J.setZero();
    std::int32_t configuration = -1;
    Eigen::Isometry3d X_BF = Eigen::Isometry3d::Identity();
    for (std::size_t i = 0; i < measured.observations.size(); ++i) {
      const Observation& o = measured.observations[i];
      if (o.configuration != configuration) {
        configuration = o.configuration;
        for (std::size_t j = 0; j < parameters.joint_index.size(); ++j) {
          joints(parameters.joint_index[j]) = measured.joint_values(static_cast<Index>(j), configuration);
        }
        KDL::Frame pose;
        pose_solver.JntToCart(joints, pose);
        jacobian_solver.JntToJac(joints, jacobian);
        X_BF = to_eigen(pose);
      }
      // Rows in the flange frame, columns from twists of the flange in the base frame.
      const Vector3d t = estimate.frames.targets[static_cast<std::size_t>(o.target)].X_FT.translation();
      const Eigen::Matrix3d to_flange = X_BF.linear().transpose();
      const Vector3d arm = X_BF.linear() * t;
      const auto row = static_cast<Index>(3 * i);
      J.block<3, 3>(row, 0) = to_flange;
      J.block<3, 3>(row, 3) = -to_flange * skew(X_BF.translation() + arm);
      Index column = 6;
      for (const std::size_t p : experiment.free.geometric()) {
        const auto twist = jacobian.data.col(parameters.parameter_index[p]);
        J.block<3, 1>(row, column++) = to_flange * (twist.head<3>() + Vector3d(twist.tail<3>()).cross(arm));
      }
      J.block<3, 3>(row, column + 3 * o.target).setIdentity();
      const Vector3d in_base = estimate.frames.base().inverse() * o.position();
      e.segment<3>(row) = to_flange * (in_base - X_BF.translation()) - t;
    }
  });
}

}  // namespace kdl_calibration::benchmarks
