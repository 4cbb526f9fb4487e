#include "uncertainty/influence.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <limits>
#include <vector>

#include "base/decompositions.hpp"
#include "estimation/residual_options.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"
#include "uncertainty/configuration_system.hpp"
#include "uncertainty/unit_columns.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// Cook's distance times p s^2 without the coordinates whose whitened unit vectors are the columns of G.
double change_without(const ConfigurationSystem& system, const MatrixXd& rest, const MatrixXd& G) {
  const Eigen::LDLT<MatrixXd> left(G.transpose() * rest * G);
  const VectorXd own = (G.transpose() * G).diagonal();
  if (!(left.vectorD().minCoeff() > kSingular * own.maxCoeff())) {
    return std::numeric_limits<double>::infinity();
  }
  return (system.B.transpose() * (G * left.solve(G.transpose() * system.e))).squaredNorm();
}

// Sums over all configurations.
struct Totals {
  double squares = 0.0;
  double decided = 0.0;  // number of parameters determined by measurements, not priors
  double coordinates = 0.0;
  double points = 0.0;
};

// The columns of a point, or a basis of their range if only single coordinates of it were measured.
MatrixXd measured_directions(const MatrixXd& U, bool is_whole) {
  if (is_whole) {
    return U;
  }
  return range_basis(U);
}

void add(const ConfigurationSystem& system, std::int32_t configuration, ConfigurationInfluence& entry, Totals& totals) {
  const Index m = system.e.size();
  const MatrixXd H = system.B * system.B.transpose();
  const MatrixXd rest = MatrixXd::Identity(m, m) - H;
  const VectorXd leverages = system.in_metres(H * system.U).diagonal();
  entry.configuration = configuration;
  entry.leverage = H.trace();
  entry.cook = change_without(system, rest, MatrixXd::Identity(m, m));
  entry.coordinates = static_cast<int>(m);
  for (std::size_t i = 0; i < system.targets.size(); ++i) {
    const MatrixXd G = measured_directions(system.U(Eigen::all, system.rows[i]), m == system.U.cols());
    entry.points.push_back({.target = system.targets[i],
                            .coordinates = static_cast<int>(G.cols()),
                            .leverage = leverages(system.rows[i]).sum(),
                            .cook = change_without(system, rest, G)});
  }
  totals.squares += system.e.squaredNorm();
  totals.decided += entry.leverage;
  totals.coordinates += static_cast<double>(m);
  totals.points += static_cast<double>(system.targets.size());
}

// See ConfigurationInfluence::shift.
VectorXd shift(const ConfigurationSystem& system, const MatrixXd& R) {
  const Index m = system.e.size();
  const auto [left, axes] = spectrum(MatrixXd::Identity(m, m) - system.B * system.B.transpose());
  const Eigen::ArrayXd e = axes.transpose() * system.e;
  const VectorXd whole = axes * (left.array() > kSingular).select(e / left.array().max(kSingular).sqrt(), 0.0).matrix();
  return R.triangularView<Eigen::Upper>().solve(system.B.transpose() * whole);
}

// Divides Cook's distances by p s^2 and marks large values.
void judge(const Totals& totals, Influence& result) {
  const double freedom = totals.coordinates - totals.decided;
  const double unit = freedom > 0.0 ? totals.decided * totals.squares / freedom : 0.0;
  result.leverage_limit = 2.0 * totals.decided / totals.coordinates;
  result.cook_limit = 4.0 / static_cast<double>(result.configurations.size());
  result.point_cook_limit = 4.0 / totals.points;
  const auto judged = [&](auto& entry, double cook_limit) {
    entry.cook = unit > 0.0 ? entry.cook / unit : 0.0;
    entry.high_leverage = entry.leverage > entry.coordinates * result.leverage_limit;
    entry.influential = entry.cook > cook_limit;
  };
  for (ConfigurationInfluence& entry : result.configurations) {
    judged(entry, result.cook_limit);
    for (PointInfluence& point : entry.points) {
      judged(point, result.point_cook_limit);
    }
  }
}

}  // namespace

Influence influence(const LeastSquaresProblem& problem, const Measurements& measurements,
                    const ResidualOptions& residuals, const Estimate& estimate, const MatrixXd& sqrt_information) {
  Influence result;
  const Index columns = sqrt_information.cols();
  if (sqrt_information.rows() < columns || columns == 0) {
    return result;
  }
  const MatrixXd R = triangular_factor(sqrt_information);
  if (!(R.diagonal().cwiseAbs().cwiseProduct(unit_scale(sqrt_information)).minCoeff() > kSingular)) {
    return result;
  }
  Totals totals;
  const TrainingRows training(measurements);
  FitProblem fit{.model = problem.model(),
                 .measurements = *training,
                 .start = estimate,
                 .free = problem.unknowns(),
                 .options = {.joint = {.residuals = residuals}}};
  fit.options.joint.residuals.row_weights = training.values_of(residuals.row_weights);
  const ConfigurationSystems systems(fit, R);
  const auto configurations = rows_by_configuration(*training);
  std::vector<ConfigurationSystem> together;
  for (std::size_t c = 0; c < configurations.size(); ++c) {
    const std::size_t place = c % ConfigurationSystems::kTogether;
    if (place == 0) {
      std::vector<std::vector<std::size_t>> rows;
      for (std::size_t i = c; i < std::min(c + ConfigurationSystems::kTogether, configurations.size()); ++i) {
        rows.push_back(configurations[i].second);
      }
      together = systems.of(rows);
    }
    add(together[place], configurations[c].first, result.configurations.emplace_back(), totals);
    result.configurations.back().shift = shift(together[place], R);
  }
  judge(totals, result);
  return result;
}

}  // namespace kdl_calibration
