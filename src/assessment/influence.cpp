#include "kdl_calibration/influence.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <numeric>
#include <tuple>
#include <utility>

#include "assessment/unit_columns.hpp"
#include "kdl_calibration/kinematics.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// The training rows of each configuration by themselves.
std::vector<std::pair<std::int32_t, std::vector<std::size_t>>> rows_by_configuration(const Measurements& measurements) {
  std::map<std::int32_t, std::vector<std::size_t>> rows;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    if (measurements.observations[row].split == Split::train) {
      rows[measurements.observations[row].configuration].push_back(row);
    }
  }
  return {rows.begin(), rows.end()};
}

// One configuration of the whitened system: J_c R^-1, e_c, and U of its information U^T U, whose columns are those of
// its points' coordinates.
struct ConfigurationSystem {
  MatrixXd B;
  VectorXd e;
  MatrixXd U;
  std::vector<std::int32_t> targets;
  std::vector<std::vector<Index>> rows;  // of each point
};

ConfigurationSystem configuration_system(const ErrorModel& model, const Measurements& measurements,
                                         const std::vector<std::size_t>& rows, const Estimate& estimate,
                                         const Unknowns& free, const ResidualOptions& residuals, const MatrixXd& R) {
  Measurements single{.source = measurements.source, .joints = measurements.joints, .targets = measurements.targets};
  single.joint_values = measurements.joint_values.col(measurements.observations[rows.front()].configuration);
  single.configurations = {""};
  ResidualOptions single_residuals = residuals;
  single_residuals.row_weights.clear();
  std::map<std::int32_t, bool> oriented;  // of each target
  for (const std::size_t row : rows) {
    single.observations.push_back(measurements.observations[row]);
    single.observations.back().configuration = 0;
    bool& with_orientation = oriented[measurements.observations[row].target];
    if (!measurements.orientations.empty()) {
      single.orientations.push_back(measurements.orientations[row]);
      with_orientation = with_orientation || !std::isnan(measurements.orientations[row].w());
    }
    if (!residuals.row_weights.empty()) {
      single_residuals.row_weights.push_back(residuals.row_weights[row]);
    }
  }
  // With every target free its columns are those of U.
  std::vector<std::size_t> coordinates(6 * single.targets.size());
  std::iota(coordinates.begin(), coordinates.end(), 0U);
  const Unknowns all = free.with(model, UnknownGroup::targets, coordinates);
  std::vector<Index> estimated;
  for (const Unknown& unknown : free.columns()) {
    estimated.push_back(*all.column(unknown.group, unknown.index));
  }
  std::vector<Index> positions;
  std::vector<Index> orientations;
  ConfigurationSystem result;
  for (const auto& [target, with_orientation] : oriented) {
    result.targets.push_back(target);
    for (std::size_t i = 0; i < (with_orientation ? 6 : 3); ++i) {
      const int column = all.target_columns(static_cast<std::size_t>(target))[i];
      (i < 3 ? positions : orientations).push_back(column);
    }
  }
  Index orientation_row = 3 * static_cast<Index>(result.targets.size());
  for (std::size_t i = 0; i < result.targets.size(); ++i) {
    const auto first = static_cast<Index>(3 * i);
    std::vector<Index>& own = result.rows.emplace_back(std::vector<Index>{first, first + 1, first + 2});
    if (oriented[result.targets[i]]) {
      own.insert(own.end(), {orientation_row, orientation_row + 1, orientation_row + 2});
      orientation_row += 3;
    }
  }
  const WhitenedSystem system = LeastSquaresProblem(model, single, all, single_residuals).whitened(estimate);
  const Index measured = system.blocks.back();
  positions.insert(positions.end(), orientations.begin(), orientations.end());
  result.U = system.jacobian.topRows(measured)(Eigen::all, positions);
  result.e = system.residual.head(measured);
  const MatrixXd jacobian = system.jacobian.topRows(measured)(Eigen::all, estimated);
  const MatrixXd transposed = R.triangularView<Eigen::Upper>().transpose().solve(MatrixXd(jacobian.transpose()));
  result.B = transposed.transpose();
  return result;
}

// Cook's distance times p s^2 of leaving out the coordinates whose whitened unit vectors are the columns of G.
double change_without(const ConfigurationSystem& system, const MatrixXd& rest, const MatrixXd& G) {
  const Eigen::LDLT<MatrixXd> left(G.transpose() * rest * G);
  const VectorXd own = (G.transpose() * G).diagonal();
  if (!(left.vectorD().minCoeff() > kSingular * own.maxCoeff())) {
    return std::numeric_limits<double>::infinity();
  }
  return (system.B.transpose() * (G * left.solve(G.transpose() * system.e))).squaredNorm();
}

}  // namespace

Influence influence(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                    const Unknowns& free, const ResidualOptions& residuals, const MatrixXd& triangle) {
  Influence result;
  const Index columns = triangle.cols();
  if (triangle.rows() < columns || columns == 0) {
    return result;
  }
  const MatrixXd R =
      Eigen::HouseholderQR<MatrixXd>(triangle).matrixQR().topRows(columns).triangularView<Eigen::Upper>();
  if (!(R.diagonal().cwiseAbs().cwiseProduct(unit_scale(triangle)).minCoeff() > kSingular)) {
    return result;
  }
  double squares = 0.0;
  double decided = 0.0;  // by the measurements, not by priors
  double coordinates = 0.0;
  double points = 0.0;
  for (const auto& [configuration, rows] : rows_by_configuration(measurements)) {
    const ConfigurationSystem system = configuration_system(model, measurements, rows, estimate, free, residuals, R);
    const Index m = system.e.size();
    const MatrixXd H = system.B * system.B.transpose();
    const MatrixXd rest = MatrixXd::Identity(m, m) - H;
    const VectorXd leverages = system.U.partialPivLu().solve(MatrixXd(H * system.U)).diagonal();
    ConfigurationInfluence& entry = result.configurations.emplace_back();
    entry.configuration = configuration;
    entry.leverage = H.trace();
    entry.cook = change_without(system, rest, MatrixXd::Identity(m, m));
    entry.coordinates = static_cast<int>(m);
    for (std::size_t i = 0; i < system.targets.size(); ++i) {
      entry.points.push_back({.target = system.targets[i],
                              .coordinates = static_cast<int>(system.rows[i].size()),
                              .leverage = leverages(system.rows[i]).sum(),
                              .cook = change_without(system, rest, system.U(Eigen::all, system.rows[i]))});
    }
    squares += system.e.squaredNorm();
    decided += entry.leverage;
    coordinates += static_cast<double>(m);
    points += static_cast<double>(system.targets.size());
  }
  const double freedom = coordinates - decided;
  const double unit = freedom > 0.0 ? decided * squares / freedom : 0.0;
  result.leverage_limit = 2.0 * decided / coordinates;
  result.cook_limit = 4.0 / static_cast<double>(result.configurations.size());
  result.point_cook_limit = 4.0 / points;
  const auto judge = [&](auto& entry, double cook_limit) {
    entry.cook = unit > 0.0 ? entry.cook / unit : 0.0;
    entry.high_leverage = entry.leverage > entry.coordinates * result.leverage_limit;
    entry.influential = entry.cook > cook_limit;
  };
  for (ConfigurationInfluence& entry : result.configurations) {
    judge(entry, result.cook_limit);
    for (PointInfluence& point : entry.points) {
      judge(point, result.point_cook_limit);
    }
  }
  return result;
}

}  // namespace kdl_calibration
