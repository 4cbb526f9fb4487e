#include "calibration/predicted_accuracy.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <vector>

#include "base/distributions.hpp"
#include "base/random.hpp"
#include "calibration/new_point.hpp"
#include "calibration/point_predictor.hpp"
#include "effects/joint_effects.hpp"
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

// Single coordinates and distances have no radius.
TestedRadius tested_radius(const PredictionBasis& basis, const Measurements& measurements) {
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
  for (const auto& [configuration, rows] : rows_of) {
    if (result.configurations == kWorkspaceSamples) {
      break;
    }
    const auto points = predictor.points(tested.joint_values.col(configuration), column(tested.signals, configuration),
                                         station_of(rows.front()));
    double squares = 0.0;
    bool holds = true;
    for (const Observation& row : rows) {
      const PointWithCovariance& point = points[static_cast<std::size_t>(row.target)];
      squares += (row.position() - point.position_W).squaredNorm() / std::pow(point.new_point.radius_95, 2);
      holds = holds && !point.outside;
    }
    result.configurations += holds ? 1 : 0;
    result.outside += holds && squares > static_cast<double>(rows.size()) ? 1 : 0;
  }
  result.p_value = binomial_upper_tail(result.outside, result.configurations, kOutside);
  return result;
}

}  // namespace

PredictedAccuracy predicted_accuracy(const UncertainEstimate& uncertain, const TrainingRows& rows,
                                     const Configurations& asked) {
  const ErrorModel& model = uncertain.model;
  const Measurements& measurements = *rows;
  Random random(1);
  const Eigen::MatrixXd workspace =
      random_configurations(model.joints, limits_of(model.joints), kWorkspaceSamples, random);
  PredictedAccuracy result;
  // The distances of left-out single coordinates are no 3D distances.
  const bool whole = !has_single_coordinates(measurements);
  result.region = measured_region(measurements, whole ? uncertain.held_out : std::vector<HeldOutPoint>(),
                                  uncertain.noise, uncertain.optimism);
  result.undetermined = undetermined_directions(uncertain.candidate_sqrt_information);
  if (model.has_open_bases) {  // directions of bases alone have rounding errors in the other columns
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
  result.tested = tested_radius(basis, rows.all());
  if (model.has_open_bases) {
    basis.estimate.frames.base().setIdentity();  // predictions in the base frame, along its axes
  }
  const PointPredictor predictor(basis);
  const Eigen::Index most = std::min<Eigen::Index>(measurements.joint_values.cols(), kWorkspaceSamples);
  const bool is_known = uncertain.covariance.diagonal().allFinite();
  const Eigen::MatrixXd there =
      is_known ? predictor.sigmas(measurements.joint_values.leftCols(most), measurements.signals) : Eigen::MatrixXd();
  if (is_known && model.has_open_bases) {  // of the arm alone, as all predictions without a station
    const double largest = there.maxCoeff();
    result.region.largest_variance = largest * largest;
    basis.region = result.region;
  }
  result.asked = asked_points(predictor, model, basis.estimate, asked);
  if (!is_known) {
    return result;
  }
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
  result.cells = cells_of(flange_poses(model, basis.estimate, workspace), everywhere, result.cell);
  return result;
}

}  // namespace kdl_calibration
