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

class ConfigurationSystems {
public:
  // Keeps references to all but `R`, of the whole whitened system.
  ConfigurationSystems(const LeastSquaresProblem& problem, const Measurements& measurements,
                       const ResidualOptions& residuals, const Estimate& estimate, MatrixXd R)
      : model_(problem.model()),
        measurements_(measurements),
        residuals_(residuals),
        estimate_(estimate),
        R_(std::move(R)) {
    // With every target free its columns are those of U.
    std::vector<std::size_t> coordinates(6 * measurements.targets.size());
    std::iota(coordinates.begin(), coordinates.end(), 0U);
    all_ = problem.unknowns().with(model_, UnknownGroup::targets, coordinates);
    for (const Unknown& unknown : problem.unknowns().columns()) {
      estimated_.push_back(*all_.column(unknown.group, unknown.index));
    }
  }

  // Of the configuration that has these rows.
  ConfigurationSystem of(const std::vector<std::size_t>& rows) const {
    Oriented oriented;
    const WhitenedSystem system = whitened(rows, oriented);
    ConfigurationSystem result;
    const Index measured = system.blocks.back();
    result.U = system.jacobian.topRows(measured)(Eigen::all, place_points(oriented, result));
    result.e = system.residual.head(measured);
    const MatrixXd jacobian = system.jacobian.topRows(measured)(Eigen::all, estimated_);
    const MatrixXd transposed = R_.triangularView<Eigen::Upper>().transpose().solve(MatrixXd(jacobian.transpose()));
    result.B = transposed.transpose();
    return result;
  }

private:
  using Oriented = std::map<std::int32_t, bool>;  // of each target that was measured, whether its orientation was

  WhitenedSystem whitened(const std::vector<std::size_t>& rows, Oriented& oriented) const {
    Measurements single{
        .source = measurements_.source, .joints = measurements_.joints, .targets = measurements_.targets};
    single.joint_values = measurements_.joint_values.col(measurements_.observations[rows.front()].configuration);
    single.configurations = {""};
    ResidualOptions single_residuals = residuals_;
    single_residuals.row_weights.clear();
    for (const std::size_t row : rows) {
      single.observations.push_back(measurements_.observations[row]);
      single.observations.back().configuration = 0;
      bool& with_orientation = oriented[measurements_.observations[row].target];
      if (!measurements_.orientations.empty()) {
        single.orientations.push_back(measurements_.orientations[row]);
        with_orientation = with_orientation || !is_point(measurements_.orientations[row]);
      }
      if (!residuals_.row_weights.empty()) {
        single_residuals.row_weights.push_back(residuals_.row_weights[row]);
      }
    }
    return LeastSquaresProblem(model_, single, all_, single_residuals).whitened(estimate_);
  }

  // The rows of each point, those of the orientations behind those of all positions; gives the columns of U.
  std::vector<Index> place_points(const Oriented& oriented, ConfigurationSystem& result) const {
    std::vector<Index> positions;
    std::vector<Index> orientations;
    Index position_row = 0;
    auto orientation_row = static_cast<Index>(3 * oriented.size());
    for (const auto& [target, with_orientation] : oriented) {
      result.targets.push_back(target);
      std::vector<Index>& own = result.rows.emplace_back();
      for (std::size_t i = 0; i < (with_orientation ? 6 : 3); ++i) {
        own.push_back(i < 3 ? position_row++ : orientation_row++);
        const int column = all_.target_columns(static_cast<std::size_t>(target))[i];
        (i < 3 ? positions : orientations).push_back(column);
      }
    }
    positions.insert(positions.end(), orientations.begin(), orientations.end());
    return positions;
  }

  const ErrorModel& model_;
  const Measurements& measurements_;
  const ResidualOptions& residuals_;
  const Estimate& estimate_;
  MatrixXd R_;
  Unknowns all_;
  std::vector<Index> estimated_;  // columns of the estimated ones among all
};

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

Influence influence(const LeastSquaresProblem& problem, const Measurements& measurements,
                    const ResidualOptions& residuals, const Estimate& estimate, const MatrixXd& triangle) {
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
  const ConfigurationSystems systems(problem, measurements, residuals, estimate, R);
  for (const auto& [configuration, rows] : rows_by_configuration(measurements)) {
    const ConfigurationSystem system = systems.of(rows);
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
