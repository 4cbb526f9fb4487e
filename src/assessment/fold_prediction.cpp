#include "kdl_calibration/fold_prediction.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "assessment/configuration_system.hpp"
#include "assessment/folds.hpp"
#include "assessment/unit_columns.hpp"
#include "base/parallel.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kAsGoodAsLinear = 0.1;       // of the noise
constexpr double kRounding = 1e-10;           // [m]
constexpr double kLeftOfInformation = 1e-10;  // eigenvalue of what a fold leaves of the information of all

// What every fold needs to know; keeps references.
struct Task {
  const ErrorModel& model;
  const Measurements& measurements;
  const Estimate& estimate;
  const Unknowns& free;
  const FitOptions& options;
  const MatrixXd& R;
  double noise;
};

struct Part {
  std::vector<HeldOutPoint> points;
  bool refitted = false;
  bool converged = true;
};

// C, dy: covariance and step of the columns times R without the fold.
struct WithoutFold {
  MatrixXd covariance;
  VectorXd step;
};

std::optional<WithoutFold> solve_without(const std::vector<ConfigurationSystem>& fold, Index columns) {
  MatrixXd information = MatrixXd::Identity(columns, columns);
  VectorXd gradient = VectorXd::Zero(columns);
  for (const ConfigurationSystem& system : fold) {
    information.noalias() -= system.B.transpose() * system.B;
    gradient.noalias() -= system.B.transpose() * system.e;
  }
  const Eigen::LDLT<MatrixXd> factor(information);
  if (factor.info() != Eigen::Success || !(factor.vectorD().minCoeff() > kLeftOfInformation)) {
    return std::nullopt;
  }
  return WithoutFold{.covariance = factor.solve(MatrixXd::Identity(columns, columns)), .step = factor.solve(gradient)};
}

// Of the configuration's points, in metres and flange frame: what is left by the step, and its covariance.
void predict(const Task& task, const ConfigurationSystem& system, Index configuration, const WithoutFold& without,
             std::vector<HeldOutPoint>& points) {
  const Eigen::PartialPivLU<MatrixXd> to_metres(system.U);
  const VectorXd left = to_metres.solve(VectorXd(system.e - system.B * without.step));
  const MatrixXd J = to_metres.solve(system.B);
  const Eigen::Isometry3d X_WF =
      task.estimate.X_WB *
      flange_poses(task.model, task.estimate, task.measurements.joint_values.col(configuration)).front();
  for (std::size_t i = 0; i < system.targets.size(); ++i) {
    const auto first = static_cast<Index>(3 * i);
    const auto rows = J.middleRows<3>(first);
    const Matrix3d in_flange = rows * without.covariance * rows.transpose();
    points.push_back({.configuration = static_cast<std::int32_t>(configuration),
                      .target = system.targets[i],
                      .distance = left.segment<3>(first).norm(),
                      .covariance = X_WF.linear() * in_flange * X_WF.linear().transpose()});
  }
}

// Whether the points of the fold, predicted at the moved estimate, are where the linear prediction has them.
bool as_good_as_linear(const Task& task, const Measurements& held_out, const WithoutFold& without,
                       const std::vector<HeldOutPoint>& points) {
  const VectorXd step = task.R.triangularView<Eigen::Upper>().solve(without.step);
  const Estimate moved = task.free.moved(task.estimate, step);
  const std::vector<double> exact = position_errors(task.model, moved, held_out, Rows::test);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (!(std::abs(exact[i] - points[i].distance) <= std::max(kAsGoodAsLinear * task.noise, kRounding))) {
      return false;
    }
  }
  return exact.size() == points.size();
}

}  // namespace

FoldPrediction predict_folds(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                             const Unknowns& free, const std::vector<std::vector<Index>>& folds,
                             const FitOptions& options, const MatrixXd& triangle, double noise, int threads) {
  const Index columns = triangle.cols();
  const MatrixXd R =
      triangle.rows() < columns
          ? MatrixXd(MatrixXd::Zero(columns, columns))
          : MatrixXd(
                Eigen::HouseholderQR<MatrixXd>(triangle).matrixQR().topRows(columns).triangularView<Eigen::Upper>());
  const bool determined = R.diagonal().cwiseAbs().cwiseProduct(unit_scale(R)).minCoeff() > kSingular;
  const Task task{.model = model,
                  .measurements = measurements,
                  .estimate = estimate,
                  .free = free,
                  .options = options,
                  .R = R,
                  .noise = noise};
  std::map<Index, std::vector<std::size_t>> rows;
  for (auto& [configuration, of_configuration] : rows_by_configuration(measurements)) {
    rows[configuration] = std::move(of_configuration);
  }
  const Measurements means = averaged(measurements);
  std::map<Index, std::vector<std::size_t>> rows_of_means;
  for (std::size_t row = 0; row < means.observations.size(); ++row) {
    if (means.observations[row].split == Split::train) {
      rows_of_means[means.observations[row].configuration].push_back(row);
    }
  }
  std::vector<Part> parts(folds.size());
  parallel_for(folds.size(), threads, [&](std::size_t f) {
    Part& part = parts[f];
    std::vector<Index> fold = folds[f];
    std::sort(fold.begin(), fold.end());
    std::vector<ConfigurationSystem> systems;
    Measurements held_out{
        .source = measurements.source, .joints = measurements.joints, .targets = measurements.targets};
    held_out.joint_values.resize(measurements.joint_values.rows(), static_cast<Index>(fold.size()));
    for (std::size_t i = 0; i < fold.size() && determined; ++i) {
      const Index c = fold[i];
      systems.push_back(
          configuration_system(model, measurements, rows.at(c), estimate, free, options.joint.residuals, R));
      held_out.joint_values.col(static_cast<Index>(i)) = measurements.joint_values.col(c);
      for (const std::size_t row : rows_of_means.at(c)) {
        Observation& observation = held_out.observations.emplace_back(means.observations[row]);
        observation.configuration = static_cast<std::int32_t>(i);
        observation.split = Split::test;
      }
    }
    const std::optional<WithoutFold> without =
        determined ? solve_without(systems, columns) : std::optional<WithoutFold>();
    if (without) {
      for (std::size_t i = 0; i < systems.size(); ++i) {
        predict(task, systems[i], fold[i], *without, part.points);
      }
      if (as_good_as_linear(task, held_out, *without, part.points)) {
        return;
      }
    }
    part.refitted = true;
    const RefittedFold refitted = refit_without(model, measurements, fold, estimate, free, options);
    part.converged = refitted.converged;
    if (!without) {
      part.points.clear();
    }
    for (std::size_t i = 0; i < refitted.distances.size(); ++i) {
      if (without) {
        part.points[i].distance = refitted.distances[i];
      } else {
        part.points.push_back({.configuration = refitted.configurations[i],
                               .target = refitted.targets[i],
                               .distance = refitted.distances[i],
                               .covariance = Matrix3d::Constant(std::numeric_limits<double>::infinity())});
      }
    }
  });
  std::map<std::pair<std::int32_t, std::int32_t>, double> repeats;
  for (const Observation& observation : measurements.observations) {
    repeats[{observation.configuration, observation.target}] += observation.split == Split::train ? 1.0 : 0.0;
  }
  FoldPrediction result;
  for (Part& part : parts) {
    for (HeldOutPoint& point : part.points) {
      point.repeats = repeats[{point.configuration, point.target}];
    }
    result.points.insert(result.points.end(), part.points.begin(), part.points.end());
    result.refits += part.refitted ? 1 : 0;
    result.not_converged += part.converged ? 0 : 1;
  }
  return result;
}

}  // namespace kdl_calibration
