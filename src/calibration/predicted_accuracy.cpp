#include "calibration/predicted_accuracy.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "base/distributions.hpp"
#include "base/random.hpp"
#include "calibration/new_point.hpp"
#include "calibration/point_predictor.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/prediction.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "model/kinematics.hpp"
#include "robot/joint_ranges.hpp"
#include "selection/effect_candidates.hpp"
#include "uncertainty/covariance.hpp"

namespace kdl_calibration {
namespace {

std::vector<double> listed_values(const Eigen::MatrixXd& matrix) {
  return {matrix.data(), matrix.data() + matrix.size()};
}

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

std::vector<AskedPoint> asked_points(const PointPredictor& predictor, const ErrorModel& model, const Estimate& estimate,
                                     const Configurations& asked) {
  std::vector<AskedPoint> result;
  const Eigen::VectorXd no_errors = Eigen::VectorXd::Zero(estimate.errors.size());
  const auto X_BF_nominal = flange_poses(folded(model, no_errors), asked.joint_values);
  for (std::size_t c = 0; c < asked.names.size(); ++c) {
    const auto place = static_cast<Eigen::Index>(c);
    const auto points = predictor.points(asked.joint_values.col(place), column(asked.signals, place));
    for (std::size_t k = 0; k < points.size(); ++k) {
      const PointWithCovariance& point = points[k];
      result.push_back({.configuration = asked.names[c],
                        .target = estimate.frames.targets[k].name,
                        .position = point.position,
                        .nominal = X_BF_nominal[c] * estimate.frames.targets[k].X_FT.translation(),
                        .position_W = point.position_W,
                        .std = point.covariance.diagonal().cwiseSqrt(),
                        .sigma = std::sqrt(point.covariance.trace()),
                        .radius_95 = point.new_point.radius_95,
                        .outside = point.outside,
                        .degrees_of_freedom = point.new_point.degrees_of_freedom});
    }
  }
  return result;
}

// The chance that test rows are off by so much more of their radius than left-out configurations are.
double chance_beside_left_out(std::vector<double> tested, const UncertainEstimate& uncertain, double radius_factor) {
  constexpr double kMore = 1.5;  // times
  std::vector<double> left_out;
  for (const auto& [configuration, ratios] : left_out_ratios(uncertain.held_out, new_point_noise(uncertain.noise))) {
    left_out.push_back(error_statistics(ratios).rms);
  }
  for (double& ratio : tested) {
    ratio *= radius_factor;
  }
  const bool worse = error_statistics(tested).rms > kMore * error_statistics(left_out).rms;
  return worse ? rank_sum_upper_tail(tested, left_out) : 1.0;
}

// Single coordinates and distances have no radius.
TestedRadius tested_radius(const PredictionBasis& basis, const UncertainEstimate& uncertain,
                           const Measurements& measurements) {
  constexpr double kOutside = 0.15;  // a radius that holds for 85 % is still of use
  const PointPredictor predictor(basis);
  Measurements tested = without_observations(measurements);
  for (const Observation& observation : measurements.observations) {
    if (observation.split == Split::test && is_whole(observation)) {
      tested.observations.push_back(observation);
    }
  }
  if (tested.observations.empty()) {
    return {};
  }
  std::map<std::int32_t, std::vector<Observation>> rows_of;
  for (const Observation& mean : averaged(tested).observations) {
    rows_of[mean.configuration].push_back(mean);
  }
  TestedRadius result;
  std::vector<double> ratios;
  for (const auto& [configuration, rows] : rows_of) {
    if (result.configurations == kWorkspaceSamples) {
      break;
    }
    const auto points = predictor.points(tested.joint_values.col(configuration), column(tested.signals, configuration),
                                         station_of(rows.front()));
    std::vector<double> own;
    bool holds = true;
    for (const Observation& row : rows) {
      const PointWithCovariance& point = points[static_cast<std::size_t>(row.target)];
      own.push_back((row.position() - point.position_W).norm() / point.new_point.radius_95);
      holds = holds && !point.outside;
    }
    if (holds) {
      ratios.push_back(error_statistics(std::move(own)).rms);
      result.configurations += 1;
      result.outside += ratios.back() > 1.0 ? 1 : 0;
    }
  }
  result.p_value = std::min(binomial_upper_tail(result.outside, result.configurations, kOutside),
                            chance_beside_left_out(std::move(ratios), uncertain, basis.region.radius_factor));
  return result;
}

// 3D 1 sigma [m] of every target in every configuration by errors that move the estimate by these columns.
std::vector<double> sigmas_of(const Eigen::MatrixXd& assumed, const PredictionBasis& basis, const Eigen::MatrixXd& q,
                              const DriveSignals& signals) {
  const PositionPredictor predictor(basis.model, basis.estimate, basis.free);
  std::vector<double> result;
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    for (const Matrix3Xd& jacobian : predictor.jacobians(q.col(c), column(signals, c))) {
      result.push_back((jacobian * assumed).norm());
    }
  }
  return result;
}

// 3D 1 sigma [m] of the predictions of left-out configurations from the others.
ErrorStatistics sigmas_left_out(const std::vector<HeldOutPoint>& held_out) {
  std::vector<double> sigmas;
  for (const HeldOutPoint& point : held_out) {
    if (std::isfinite(point.covariance.trace())) {
      sigmas.push_back(std::sqrt(point.covariance.trace()));
    }
  }
  return error_statistics(sigmas);
}

void add_workspace(const PointPredictor& predictor, const PredictionBasis& basis, PredictedAccuracy& result) {
  const std::vector<MovingJoint>& joints = basis.model.joints;
  Random random(1);
  const Eigen::MatrixXd workspace = random_configurations(joints, limits_of(joints), kWorkspaceSamples, random);
  if (const Eigen::MatrixXd everywhere = predictor.sigmas(workspace, {}); everywhere.allFinite()) {
    result.workspace = error_statistics(listed_values(everywhere));
    result.cells = cells_of(flange_poses(basis.model, basis.estimate, workspace), everywhere, result.cell);
  }
}

// Up to 300 configurations between the measured ones, where radii hold; the measured ones if there are none.
Eigen::MatrixXd configurations_in(const PredictionBasis& basis, const PointPredictor& predictor,
                                  const Eigen::MatrixXd& measured) {
  constexpr int kTried = 1000;
  constexpr Eigen::Index kMost = 300;
  Random random(2);
  const Eigen::MatrixXd all = random_configurations(basis.model.joints, basis.region.joints, kTried, random);
  const Eigen::ArrayXd sigmas = predictor.sigmas(all, {}).colwise().maxCoeff().transpose();
  std::vector<Eigen::Index> inside;
  for (Eigen::Index c = 0; c < all.cols() && std::ssize(inside) < kMost; ++c) {
    if (sigmas[c] * sigmas[c] <= basis.region.largest_variance) {
      inside.push_back(c);
    }
  }
  return inside.empty() ? measured : Eigen::MatrixXd(all(Eigen::all, inside));
}

// 3D distances [m] of the models' predictions from the first one's, root mean square by the odds.
double unproved(std::span<const PlausibleModel> plausible, const Eigen::MatrixXd& q) {
  const auto points = [&](const PlausibleModel& one) {
    const Frames& frames = one.estimate.frames;
    const Eigen::Isometry3d X_WB = one.model.has_undetermined_bases ? Eigen::Isometry3d::Identity() : frames.base();
    Matrix3Xd result(3, q.cols() * std::ssize(frames.targets));
    Eigen::Index column = 0;
    for (const Eigen::Isometry3d& X_BF : flange_poses(one.model, one.estimate, q)) {
      for (const TargetFrame& target : frames.targets) {
        result.col(column++) = X_WB * (X_BF * target.X_FT.translation());
      }
    }
    return result;
  };
  double squares = 0.0;
  double odds = 0.0;
  const Matrix3Xd chosen = points(plausible.front());
  for (const PlausibleModel& one : plausible) {
    const Matrix3Xd others = points(one);
    squares += one.odds * (others - chosen).squaredNorm();
    odds += one.odds;
  }
  return std::sqrt(squares / (odds * static_cast<double>(chosen.cols())));
}

}  // namespace

PredictedAccuracy predicted_accuracy(const UncertainEstimate& uncertain, const TrainingRows& rows,
                                     const Configurations& asked) {
  const ErrorModel& model = uncertain.model;
  const Measurements& measurements = *rows;
  PredictedAccuracy result;
  // The distances of left-out single coordinates are no 3D distances.
  const bool whole = !has_single_coordinates(measurements);
  result.region = measured_region(measurements, whole ? uncertain.held_out : std::vector<HeldOutPoint>(),
                                  uncertain.noise, uncertain.optimism);
  result.undetermined = undetermined_directions(uncertain.candidate_sqrt_information);
  if (model.has_undetermined_bases) {  // directions of bases alone have rounding errors in the other columns
    constexpr double kRounding = 1e-9;
    result.undetermined = result.undetermined.unaryExpr([](double x) { return std::abs(x) < kRounding ? 0.0 : x; });
  }
  PredictionBasis basis{.model = model,
                        .estimate = uncertain.fit.identification.estimate,
                        .free = uncertain.fit.free,
                        .covariance = uncertain.covariance,
                        .candidates = uncertain.fit.candidates,
                        .undetermined = result.undetermined,
                        .noise = new_point_noise(uncertain.noise),
                        .region = result.region};
  const bool is_known = uncertain.covariance.diagonal().allFinite();
  const Eigen::MatrixXd measured =
      measurements.joint_values.leftCols(std::min<Eigen::Index>(measurements.joint_values.cols(), kWorkspaceSamples));
  const std::vector<double> of_assumptions = sigmas_of(uncertain.assumed, basis, measured, measurements.signals);
  const double most_assumed = *std::max_element(of_assumptions.begin(), of_assumptions.end());
  basis.region.largest_variance += most_assumed * most_assumed;  // left-out errors do not show them
  if (!uncertain.plausible.empty() && is_known && !needs_torques(model)) {
    basis.region.unproved = unproved(uncertain.plausible, configurations_in(basis, PointPredictor(basis), measured));
  }
  result.tested = tested_radius(basis, uncertain, rows.all());
  if (model.has_undetermined_bases) {
    basis.estimate.frames.base().setIdentity();  // predictions in the base frame, along its axes
  }
  const PointPredictor predictor(basis);
  const Eigen::MatrixXd there = is_known ? predictor.sigmas(measured, measurements.signals) : Eigen::MatrixXd();
  if (is_known && model.has_undetermined_bases) {  // of the arm alone, as all predictions without a station
    const double largest = there.maxCoeff();
    basis.region.largest_variance = largest * largest;
  }
  result.region = basis.region;
  result.asked = asked_points(predictor, model, basis.estimate, asked);
  if (!is_known) {
    return result;
  }
  if (there.allFinite()) {
    result.measured = error_statistics(listed_values(there));
    result.unseen = sigmas_left_out(uncertain.held_out);
    result.unseen = result.unseen.count > 0 ? result.unseen : result.measured;
    result.of_assumptions = error_statistics(of_assumptions).rms;
  }
  if (!needs_torques(model)) {  // which are unknown at unmeasured configurations
    add_workspace(predictor, basis, result);
  }
  return result;
}

double variance_of_fit(const PredictedAccuracy& predicted) {
  return std::max(std::pow(predicted.measured.rms, 2) - std::pow(predicted.of_assumptions, 2), 0.0);
}

}  // namespace kdl_calibration
