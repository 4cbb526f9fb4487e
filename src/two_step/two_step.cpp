#include "two_step/two_step.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "estimation/prediction.hpp"
#include "measurements/training_rows.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"
#include "two_step/matrix_derivatives.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Step 5: base and tools for the current geometry. With T_robot(q_i) = (R_i, p_i) and points y in the current base
// frame, y_ij - p_i = A_i [p_base; phi_base; u_1; …; u_m] with
//     A_i = [I  [~p_i]^T  R_i  0  0;  I  [~p_i]^T  0  R_i  0;  I  [~p_i]^T  0  0  R_i]    (9 x 15 for three tools),
// where [~p]^T phi = phi x p is the small rotation of the base and u_j the tool.
void update_base_and_tools(const std::vector<Eigen::Isometry3d>& T_robot, const Measurements& measurements,
                           Estimate& estimate) {
  const Index tools = static_cast<Index>(estimate.frames.targets.size());
  const Index unknowns = 6 + 3 * tools;
  MatrixXd AtA = MatrixXd::Zero(unknowns, unknowns);
  VectorXd Atp = VectorXd::Zero(unknowns);
  const Eigen::Isometry3d X_BW = estimate.frames.base().inverse();
  for (const Observation& observation : measurements.observations) {
    const Eigen::Isometry3d& pose = T_robot[static_cast<std::size_t>(observation.configuration)];
    const Matrix3Xd A = base_and_tool_rows(pose, observation.target, tools);
    const Vector3d dp = X_BW * observation.position() - pose.translation();
    AtA += A.transpose() * A;
    Atp += A.transpose() * dp;
  }
  const VectorXd solution = AtA.ldlt().solve(Atp);
  estimate.frames.base().translation() += estimate.frames.base().linear() * solution.head<3>();
  estimate.frames.base().linear() = estimate.frames.base().linear() * rotation_exp(solution.segment<3>(3));
  for (Index j = 0; j < tools; ++j) {
    estimate.frames.targets[static_cast<std::size_t>(j)].X_FT.translation() = solution.segment<3>(6 + 3 * j);
  }
}

// Steps 6 and 7: dPi = (sum J^T J)^-1 sum J^T dp with base and tools held. Returns dPi and the resulting RMS motion of
// the points.
struct GeometryUpdate {
  VectorXd step;
  double effect = 0.0;
  double rms = 0.0;
};

GeometryUpdate geometry_update(const ErrorModel& model, const std::vector<Eigen::Isometry3d>& T_robot,
                               const Measurements& measurements, const Estimate& estimate,
                               const std::vector<std::size_t>& geometric) {
  const auto unknowns = static_cast<Index>(geometric.size());
  const std::vector<ChainFactor> factors = chain_factors(model);
  MatrixProduct product;  // of the last configuration
  Index configuration = -1;
  MatrixXd JtJ = MatrixXd::Zero(unknowns, unknowns);
  VectorXd Jtp = VectorXd::Zero(unknowns);
  double sum = 0.0;
  double count = 0.0;
  for (const Observation& observation : measurements.observations) {
    const Vector3d tool = estimate.frames.targets[static_cast<std::size_t>(observation.target)].X_FT.translation();
    const Vector3d dp = measured_minus_predicted(observation, estimate, T_robot);
    if (observation.configuration != configuration) {
      configuration = observation.configuration;
      product = matrix_product(factors, estimate.errors, measurements.joint_values.col(configuration));
    }
    const Matrix3Xd J = estimate.frames.base().linear() * point_columns(factors, product, geometric, tool);
    JtJ += J.transpose() * J;
    Jtp += J.transpose() * dp;
    sum += dp.squaredNorm();
    count += 1.0;
  }
  GeometryUpdate update;
  update.step = JtJ.ldlt().solve(Jtp);
  update.effect = std::sqrt(std::max(update.step.dot(JtJ * update.step), 0.0) / count);
  update.rms = std::sqrt(sum / count);
  return update;
}

}  // namespace

Eigen::Matrix3Xd base_and_tool_rows(const Eigen::Isometry3d& T_robot, Index tool, Index tools) {
  Eigen::Matrix3Xd A = Eigen::Matrix3Xd::Zero(3, 6 + 3 * tools);
  A.middleCols<3>(0).setIdentity();
  A.middleCols<3>(3) = skew(T_robot.translation()).transpose();
  A.middleCols<3>(6 + 3 * tool) = T_robot.linear();
  return A;
}

double convergence_factor(const std::vector<double>& changes, double least_change) {
  std::size_t last = changes.size();
  while (last > 0 && changes[last - 1] < least_change) {
    --last;
  }
  if (last < 3) {
    return 0.0;
  }
  return std::pow(changes[last - 1] / changes[1], 1.0 / static_cast<double>(last - 2));
}

Identification identify_in_two_steps(const ErrorModel& model,
                                     const std::function<Measurements(int)>& measurements_of_round,
                                     const Estimate& start, const std::vector<std::size_t>& geometric,
                                     const TwoStepOptions& options) {
  Identification result;
  result.estimate = start;  // (i) all errors zero unless the caller states others
  result.termination = Termination::iteration_limit;
  result.message = "still moving after " + std::to_string(options.rounds) + " rounds";
  Estimate& estimate = result.estimate;
  std::vector<double> effects;
  for (int round = 0; round < options.rounds; ++round) {             // (viii)
    const Measurements measurements = measurements_of_round(round);  // (ii), (iii)
    const TrainingRows training(measurements);
    const std::vector<Eigen::Isometry3d> T_robot =
        flange_poses(folded(model, estimate.errors), measurements.joint_values);                    // (iii), (iv)
    update_base_and_tools(T_robot, *training, estimate);                                            // (v)
    const GeometryUpdate update = geometry_update(model, T_robot, *training, estimate, geometric);  // (vi)
    ++result.iterations;
    result.rms_history.push_back(update.rms);
    result.rms = update.rms;
    if (!update.step.allFinite() || !std::isfinite(update.rms)) {
      result.termination = Termination::diverged;
      result.message = "the misfit is no longer finite";
      break;
    }
    for (std::size_t i = 0; i < geometric.size(); ++i) {  // (vii)
      estimate.errors[static_cast<Index>(geometric[i])] += update.step[static_cast<Index>(i)];
    }
    effects.push_back(update.effect);
    if (options.after_round) {
      options.after_round({.number = result.iterations, .change = update.effect, .misfit = update.rms}, estimate);
    }
    if (update.effect <= options.step_tolerance) {
      result.termination = Termination::converged;
      result.message = "the last round moved the predicted points by less than the tolerance";
      break;
    }
  }
  result.convergence_factor = convergence_factor(effects);
  return result;
}

}  // namespace kdl_calibration
