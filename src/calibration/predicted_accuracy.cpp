#include "calibration/predicted_accuracy.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <vector>

#include "calibration/new_point.hpp"
#include "kdl_calibration/covariance.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/random.hpp"
#include "selection/effect_candidates.hpp"

namespace kdl_calibration {
namespace {

std::vector<double> listed_values(const Eigen::MatrixXd& matrix) {
  return {matrix.data(), matrix.data() + matrix.size()};
}

// Predictions and their uncertainty, infinite if they depend on parameters fixed by gauge.
class UncertainPredictor {
public:
  explicit UncertainPredictor(const UncertainEstimate& uncertain)
      : uncertain_(uncertain),
        estimate_(uncertain.fit.identification.estimate),
        undetermined_(undetermined_directions(uncertain.candidate_sqrt_information)),
        free_(uncertain.model, estimate_, uncertain.fit.free),
        candidates_(uncertain.model, estimate_, uncertain.fit.candidates),
        offsets_(joint_offsets(uncertain.model, estimate_.targets)),
        joints_(uncertain.model, estimate_, offsets_) {}

  // Covariance [m^2] of every target in W at `q` and `signals` (one column).
  std::vector<Eigen::Matrix3d> covariances(const Eigen::VectorXd& q, const DriveSignals& signals) const {
    std::vector<Eigen::Matrix3d> result = unmodelled_covariances(q, signals);
    const std::vector<Matrix3Xd> jacobians = free_.jacobians(q, signals);
    for (std::size_t k = 0; k < result.size(); ++k) {
      if (result[k].allFinite()) {
        result[k] += jacobians[k] * uncertain_.covariance * jacobians[k].transpose();
      }
    }
    return result;
  }

  // 3D 1 sigma [m], targets x N. One product for many configurations is three times faster than one for each.
  Eigen::MatrixXd sigmas(const Eigen::MatrixXd& joint_values, const DriveSignals& signals) const {
    constexpr Eigen::Index kAtOnce = 32;
    const auto targets = static_cast<Eigen::Index>(estimate_.targets.size());
    Eigen::MatrixXd variances(targets, joint_values.cols());
    for (Eigen::Index first = 0; first < joint_values.cols(); first += kAtOnce) {
      const Eigen::Index count = std::min(kAtOnce, joint_values.cols() - first);
      Eigen::MatrixXd rows(3 * targets * count, uncertain_.covariance.cols());
      Eigen::Index row = 0;
      for (Eigen::Index c = first; c < first + count; ++c) {
        for (const Matrix3Xd& jacobian : free_.jacobians(joint_values.col(c), column(signals, c))) {
          rows.middleRows<3>(row) = jacobian;
          row += 3;
        }
      }
      const Eigen::VectorXd coordinates = (rows * uncertain_.covariance).cwiseProduct(rows).rowwise().sum();
      variances.middleCols(first, count) =
          coordinates.reshaped(3, targets * count).colwise().sum().reshaped(targets, count);
    }
    for (Eigen::Index c = 0; c < joint_values.cols(); ++c) {
      Eigen::Index k = 0;
      for (const Eigen::Matrix3d& covariance : unmodelled_covariances(joint_values.col(c), column(signals, c))) {
        variances(k++, c) += covariance.trace();
      }
    }
    return variances.cwiseSqrt();
  }

  std::vector<PredictedPoint> points(const Configurations& asked, const MeasuredRegion& region) const {
    std::vector<PredictedPoint> result;
    if (asked.names.empty()) {
      return result;
    }
    const auto X_BF = flange_poses(uncertain_.model, estimate_, asked.joint_values, asked.signals);
    for (std::size_t c = 0; c < asked.names.size(); ++c) {
      const Eigen::VectorXd q = asked.joint_values.col(static_cast<Eigen::Index>(c));
      const auto all = covariances(q, column(asked.signals, static_cast<Eigen::Index>(c)));
      for (std::size_t k = 0; k < estimate_.targets.size(); ++k) {
        PredictedPoint& point = result.emplace_back();
        point.configuration = asked.names[c];
        point.target = estimate_.targets[k].name;
        point.position = X_BF[c] * estimate_.targets[k].X_FT.translation();
        point.position_W = estimate_.X_WB * point.position;
        point.std = all[k].diagonal().cwiseSqrt();
        point.sigma = std::sqrt(all[k].trace());
        const NewPoint fresh = new_point({.covariance = all[k], .place = point.position_W}, uncertain_.noise);
        point.radius_95 = region.radius_factor * fresh.radius_95;
        point.degrees_of_freedom = fresh.degrees_of_freedom;
        point.outside = !region.holds(q, all[k]) || withholds_tables(uncertain_.model, q);
      }
    }
    return result;
  }

private:
  // Variances [rad^2 or m^2] of the joints' motions due to effects left out at `q`: withheld tables with their prior
  // variance, and effects of an unknown direction of approach.
  Eigen::VectorXd left_out(const Eigen::VectorXd& q, const DriveSignals& signals) const {
    Eigen::VectorXd variances = Eigen::VectorXd::Zero(q.size());
    for (std::size_t place = 0; place < uncertain_.model.effects.size(); ++place) {
      const EffectTerm& term = uncertain_.model.effects[place];
      double motion = 0.0;
      if (is_withheld(term, q[term.index])) {
        motion = term.sigma * table_value(std::get<JointTable>(term.function), q[term.index]);
      } else if (misses_approach(term, signals, 0)) {
        motion = estimate_.effects[static_cast<Eigen::Index>(place)];
      }
      variances[term.index] += motion * motion;
    }
    return variances;
  }

  // Covariance [m^2] of every target beyond that of the free unknowns: from left-out effects, infinite if it depends on
  // parameters fixed by gauge.
  std::vector<Eigen::Matrix3d> unmodelled_covariances(const Eigen::VectorXd& q, const DriveSignals& signals) const {
    std::vector<Eigen::Matrix3d> result(estimate_.targets.size(), Eigen::Matrix3d::Zero());
    const Eigen::VectorXd variances = left_out(q, signals);
    if (!variances.isZero(0.0)) {
      const std::vector<Matrix3Xd> jacobians = joints_.jacobians(q, signals);
      for (std::size_t k = 0; k < result.size(); ++k) {
        result[k] = jacobians[k] * variances.asDiagonal() * jacobians[k].transpose();
      }
    }
    if (undetermined_.cols() > 0) {
      const std::vector<Matrix3Xd> jacobians = candidates_.jacobians(q, signals);
      for (std::size_t k = 0; k < result.size(); ++k) {
        if (!determines(jacobians[k])) {
          result[k] = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()).asDiagonal();
        }
      }
    }
    return result;
  }

  bool determines(const Matrix3Xd& jacobian) const {
    constexpr double kNothing = 1e-6;
    const Eigen::ArrayXd sizes = (jacobian.cwiseAbs() * undetermined_.cwiseAbs()).colwise().sum().transpose();
    const Eigen::ArrayXd effects = (jacobian * undetermined_).colwise().norm().transpose();
    return (effects <= kNothing * sizes).all();
  }

  const UncertainEstimate& uncertain_;
  const Estimate& estimate_;
  Eigen::MatrixXd undetermined_;
  PositionPredictor free_;
  PositionPredictor candidates_;
  Unknowns offsets_;  // offsets of the joints, about their own axes
  PositionPredictor joints_;
};

// Mean and largest sigma of the configurations by cube of the workspace.
std::vector<WorkspaceCell> cells_of(const std::vector<Eigen::Isometry3d>& X_BF, const Eigen::MatrixXd& sigmas,
                                    double edge) {
  std::map<std::array<double, 3>, WorkspaceCell> cells;  // doubles: cube indices of a large robot overflow int
  for (std::size_t c = 0; c < X_BF.size(); ++c) {
    const auto sigma = sigmas.col(static_cast<Eigen::Index>(c));
    const Eigen::Vector3d cube = (X_BF[c].translation() / edge).array().floor();
    WorkspaceCell& cell = cells[{cube.x(), cube.y(), cube.z()}];
    cell.centre = (cube.array() + 0.5) * edge;
    cell.mean = (cell.mean * cell.count + sigma.mean()) / (cell.count + 1);
    cell.max = std::max(cell.max, sigma.maxCoeff());
    ++cell.count;
  }
  std::vector<WorkspaceCell> result;
  result.reserve(cells.size());
  for (const auto& [cube, cell] : cells) {
    result.push_back(cell);
  }
  return result;
}

constexpr int kWorkspaceSamples = 1000;

}  // namespace

PredictedAccuracy predicted_accuracy(const UncertainEstimate& uncertain, const Measurements& measurements,
                                     const Configurations& asked) {
  const ErrorModel& model = uncertain.model;
  Random random(1);
  const Eigen::MatrixXd workspace =
      random_configurations(model.joints, limits_of(model.joints), kWorkspaceSamples, random);
  PredictedAccuracy result;
  const UncertainPredictor predictor(uncertain);
  const MeasuredRegion region = measured_region(measurements, uncertain.held_out, uncertain.noise, uncertain.optimism);
  result.radius_factor = region.radius_factor;
  result.asked = predictor.points(asked, region);
  if (!uncertain.covariance.diagonal().allFinite()) {
    return result;
  }
  const Eigen::Index most = std::min<Eigen::Index>(measurements.joint_values.cols(), kWorkspaceSamples);
  const Eigen::MatrixXd there = predictor.sigmas(measurements.joint_values.leftCols(most), measurements.signals);
  if (there.allFinite()) {
    result.measured = error_statistics(listed_values(there));
  }
  if (needs_torques(model)) {  // unknown at unmeasured configurations
    return result;
  }
  const Eigen::MatrixXd everywhere = predictor.sigmas(workspace, {});
  if (!everywhere.allFinite()) {
    return result;
  }
  result.workspace = error_statistics(listed_values(everywhere));
  result.cells =
      cells_of(flange_poses(model, uncertain.fit.identification.estimate, workspace), everywhere, result.cell);
  return result;
}

}  // namespace kdl_calibration
