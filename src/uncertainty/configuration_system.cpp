#include "uncertainty/configuration_system.hpp"

#include <Eigen/Dense>
#include <map>
#include <numeric>
#include <utility>

#include "base/dense.hpp"
#include "estimation/residual_options.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;

std::vector<std::pair<std::int32_t, std::vector<std::size_t>>> rows_by_configuration(const Measurements& measurements) {
  std::map<std::int32_t, std::vector<std::size_t>> rows;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    rows[measurements.observations[row].configuration].push_back(row);
  }
  return {rows.begin(), rows.end()};
}

ConfigurationSystems::ConfigurationSystems(const FitProblem& fit, const MatrixXd& R)
    : model_(fit.model),
      measurements_(fit.measurements),
      residuals_(fit.options.joint.residuals),
      estimate_(fit.start),
      transposed_(R.transpose()) {
  // If all targets are free, their columns are those of U.
  std::vector<std::size_t> coordinates(6 * measurements_.targets.size());
  std::iota(coordinates.begin(), coordinates.end(), 0U);
  all_ = fit.free.with(model_, UnknownGroup::targets, coordinates);
  for (const Unknown& unknown : fit.free.columns()) {
    estimated_.push_back(*all_.column(unknown.group, unknown.index));
  }
}

std::vector<ConfigurationSystem> ConfigurationSystems::of(const std::vector<std::vector<std::size_t>>& rows) const {
  std::vector<Oriented> oriented(rows.size());
  const WhitenedSystem system = whitened(rows, oriented);
  MatrixXd solved = system.jacobian(Eigen::all, estimated_).transpose();
  solve_lower(transposed_, solved);
  std::vector<ConfigurationSystem> results(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    ConfigurationSystem& result = results[i];
    const Index first = system.blocks[i];
    const Index measured = system.blocks[i + 1] - first;
    result.U = system.jacobian.middleRows(first, measured)(Eigen::all, place_points(oriented[i], result));
    result.e = system.residual.segment(first, measured);
    result.B = solved.middleCols(first, measured).transpose();
  }
  return results;
}

// The whitened system of these rows' configurations, in their order.
WhitenedSystem ConfigurationSystems::whitened(const std::vector<std::vector<std::size_t>>& rows,
                                              std::vector<Oriented>& oriented) const {
  Measurements some{.source = measurements_.source, .joints = measurements_.joints, .targets = measurements_.targets};
  some.stations = measurements_.stations;
  some.joint_values.resize(measurements_.joint_values.rows(), static_cast<Index>(rows.size()));
  some.configurations.resize(rows.size());
  ResidualOptions residuals = residuals_;
  residuals.row_weights.clear();
  std::vector<Index> which;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const std::int32_t configuration = measurements_.observations[rows[i].front()].configuration;
    which.push_back(configuration);
    some.joint_values.col(static_cast<Index>(i)) = measurements_.joint_values.col(configuration);
    for (const std::size_t row : rows[i]) {
      some.observations.push_back(measurements_.observations[row]);
      some.observations.back().configuration = static_cast<std::int32_t>(i);
      bool& with_orientation = oriented[i][measurements_.observations[row].target];
      with_orientation = with_orientation || has_orientation(measurements_.observations[row]);
      if (!residuals_.row_weights.empty()) {
        residuals.row_weights.push_back(residuals_.row_weights[row]);
      }
    }
  }
  some.signals = columns(measurements_.signals, which);
  return LeastSquaresProblem(model_, some, all_, residuals).whitened(estimate_);
}

// Sets the rows of each point (orientations follow all positions) and returns the columns of U.
std::vector<Index> ConfigurationSystems::place_points(const Oriented& oriented, ConfigurationSystem& result) const {
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

}  // namespace kdl_calibration
