#include "assessment/configuration_system.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;

std::vector<std::pair<std::int32_t, std::vector<std::size_t>>> rows_by_configuration(const Measurements& measurements) {
  std::map<std::int32_t, std::vector<std::size_t>> rows;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    if (measurements.observations[row].split == Split::train) {
      rows[measurements.observations[row].configuration].push_back(row);
    }
  }
  return {rows.begin(), rows.end()};
}

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

}  // namespace kdl_calibration
