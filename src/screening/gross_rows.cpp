#include "screening/gross_rows.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <optional>
#include <utility>

#include "base/distributions.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/residual_options.hpp"
#include "measurements/readings.hpp"
#include "measurements/training_rows.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kByChance = 1e-4;         // probability of any finding among correct measurements
constexpr double kSmallMisfit = 1e-7;      // [m] with a smaller misfit nothing is gross
constexpr double kFarOff = 10.0;           // of the others' misfit, for single coordinates and distances
constexpr double kLeastRestFreedom = 3.0;  // least degrees of freedom of the others
constexpr double kOnePointAlone = 0.9;     // share of its configuration's decrease
constexpr double kWithoutWeight = 1e-9;

// The means, which of them are included, and their fit.
struct Search {
  const FitProblem& problem;
  Measurements means;
  std::vector<std::vector<std::size_t>> of_configuration;  // indices of the means
  std::vector<double> weights;
  Estimate estimate;
};

Search begin(const FitProblem& problem) {
  Search search{.problem = problem,
                .means = averaged(*TrainingRows(problem.measurements)),
                .of_configuration = {},
                .weights = {},
                .estimate = problem.start};
  search.weights.assign(search.means.observations.size(), 1.0);
  search.of_configuration.resize(search.means.configurations.size());
  for (std::size_t i = 0; i < search.means.observations.size(); ++i) {
    search.of_configuration[static_cast<std::size_t>(search.means.observations[i].configuration)].push_back(i);
  }
  std::erase_if(search.of_configuration, [](const auto& rows) { return rows.empty(); });
  return search;
}

// A group of means and the effect of leaving it out.
struct GrossGroup {
  std::vector<std::size_t> means;
  double coordinates = 0.0;
  double decrease = 0.0;  // of the sum of squares
};

// Equations of the included means.
struct Equations {
  WhitenedSystem system;
  Eigen::LLT<MatrixXd> information;
  std::vector<Index> first_row;  // of each mean, whose coordinates follow one another
  double squares = 0.0;
  double freedom = 0.0;
  double rms = 0.0;          // [m]
  double weighed_rms = 0.0;  // [m] each divided by the factor on its station's noise
};

std::optional<Equations> fitted(Search& search) {
  const FitProblem& problem = search.problem;
  ResidualOptions residuals;
  residuals.orientation_length = problem.options.joint.residuals.orientation_length;
  residuals.row_weights = search.weights;
  JointOptions joint;
  joint.residuals = residuals;
  const Identification found = identify_jointly(problem.model, search.means, search.estimate, problem.free, joint);
  if (problem.options.after_fit) {
    problem.options.after_fit();
  }
  if (found.termination == Termination::diverged || !std::isfinite(found.rms)) {
    return std::nullopt;
  }
  search.estimate = found.estimate;
  const LeastSquaresProblem equations(problem.model, search.means, problem.free, residuals);
  Equations result{.system = equations.whitened(search.estimate), .information = {}, .first_row = {}};
  result.information.compute(result.system.jacobian.transpose() * result.system.jacobian);
  const VectorXd diagonal = result.information.matrixLLT().diagonal().cwiseAbs();
  if (result.information.info() != Eigen::Success || !(diagonal.minCoeff() > 0.0)) {
    return std::nullopt;
  }
  result.first_row.resize(search.weights.size());
  double points = 0.0;
  double square_metres = 0.0;
  double weighed = 0.0;
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(problem.model, search.estimate, search.means);
  for (std::size_t c = 0; c < search.of_configuration.size(); ++c) {
    Index row = result.system.blocks[c];
    for (const std::size_t i : search.of_configuration[c]) {
      result.first_row[i] = row;
      const int coordinates = dimension(search.means.observations[i].reading);
      row += coordinates;
      if (search.weights[i] == 1.0) {
        points += 1.0;
        result.freedom += coordinates;
        const Observation& mean = search.means.observations[i];
        const double square = measured_minus_predicted(mean, search.estimate, X_BF).squaredNorm();
        square_metres += square;
        weighed += square / (mean.noise.length * mean.noise.length);
      }
    }
  }
  result.squares = result.system.residual.squaredNorm();
  result.freedom -= static_cast<double>(problem.free.size());
  result.rms = std::sqrt(square_metres / std::max(points, 1.0));
  result.weighed_rms = std::sqrt(weighed / std::max(points, 1.0));
  return result;
}

GrossGroup group_of(const Search& search, const Equations& equations, std::vector<std::size_t> means) {
  std::vector<Index> rows;
  for (const std::size_t i : means) {
    for (Index k = 0; k < dimension(search.means.observations[i].reading); ++k) {
      rows.push_back(equations.first_row[i] + k);
    }
  }
  const MatrixXd J = equations.system.jacobian(rows, Eigen::all);
  const VectorXd e = equations.system.residual(rows);
  const auto count = static_cast<Index>(rows.size());
  const MatrixXd rest = MatrixXd::Identity(count, count) - J * equations.information.solve(J.transpose());
  const Eigen::LDLT<MatrixXd> factor(rest);
  constexpr double kDetermined = 1e-6;  // least share of information without the group
  GrossGroup group{.means = std::move(means), .coordinates = static_cast<double>(count)};
  if (!(factor.vectorD().minCoeff() > kDetermined)) {
    return group;
  }
  group.decrease = e.dot(factor.solve(e));
  return group;
}

// The group with the largest decrease: a configuration, or one point of it with nearly the same decrease.
GrossGroup largest_group(const Search& search, const Equations& equations) {
  GrossGroup largest;
  for (const std::vector<std::size_t>& all : search.of_configuration) {
    std::vector<std::size_t> in;
    std::copy_if(all.begin(), all.end(), std::back_inserter(in),
                 [&](std::size_t i) { return search.weights[i] == 1.0; });
    if (in.empty()) {
      continue;
    }
    GrossGroup group = group_of(search, equations, in);
    if (group.decrease > largest.decrease) {
      largest = std::move(group);
    }
  }
  if (largest.means.size() > 1) {
    const double wanted = kOnePointAlone * largest.decrease;
    for (const std::size_t i : std::vector<std::size_t>(largest.means)) {
      GrossGroup point = group_of(search, equations, {i});
      if (point.decrease > wanted) {
        largest = std::move(point);
        break;
      }
    }
  }
  return largest;
}

bool may_be_chance(const GrossGroup& group, const Equations& equations, std::size_t groups) {
  const double rest = equations.freedom - group.coordinates;
  if (rest < kLeastRestFreedom) {
    return true;
  }
  const double F = group.decrease / group.coordinates / (std::max(equations.squares - group.decrease, 1e-300) / rest);
  return f_upper_tail(F, group.coordinates, rest) * static_cast<double>(groups) > kByChance;
}

}  // namespace

namespace {

// Whether a group that was taken out has single coordinates or distances that are far from where the others put them.
// No other check looks at single ones.
bool is_far_off(const Search& search, const GrossGroup& group, double rms) {
  if (is_whole(search.means.observations[group.means.front()])) {
    return false;
  }
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(search.problem.model, search.estimate, search.means);
  return std::any_of(group.means.begin(), group.means.end(), [&](std::size_t i) {
    return measured_minus_predicted(search.means.observations[i], search.estimate, X_BF).norm() > kFarOff * rms;
  });
}

// Messages' data: distances of groups from their predictions by the others.
std::vector<GrossRow> described(const Search& search, const std::vector<GrossGroup>& groups) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(search.problem.model, search.estimate, search.means);
  const Measurements& means = search.means;
  std::vector<GrossRow> rows;
  for (const GrossGroup& group : groups) {
    const Observation& first = means.observations[group.means.front()];
    const bool single = group.means.size() == 1 && means.targets.size() > 1;
    GrossRow& row = rows.emplace_back();
    row.configuration = means.configurations[static_cast<std::size_t>(first.configuration)];
    row.target = single ? means.targets[static_cast<std::size_t>(first.target)] : std::string();
    for (const std::size_t i : group.means) {
      row.distance =
          std::max(row.distance, measured_minus_predicted(search.means.observations[i], search.estimate, X_BF).norm());
    }
  }
  return rows;
}

}  // namespace

GrossRows find_gross_rows(const FitProblem& problem) {
  Search search = begin(problem);
  const std::size_t groups = search.of_configuration.size();
  const std::size_t most = std::clamp<std::size_t>(groups / 10, 1, kMostGrossGroups);
  std::optional<Equations> equations = fitted(search);
  GrossRows found;
  if (!equations || !(equations->rms > kSmallMisfit)) {
    return found;
  }
  found.rms = equations->rms;
  std::vector<GrossGroup> out;
  double kept = equations->weighed_rms;  // of the last accepted fit
  for (std::size_t taken = 0; taken < most; ++taken) {
    const GrossGroup group = largest_group(search, *equations);
    if (group.means.empty() || may_be_chance(group, *equations, groups)) {
      break;
    }
    found.beyond_chance = true;
    out.push_back(group);
    for (const std::size_t i : group.means) {
      search.weights[i] = kWithoutWeight;
    }
    equations = fitted(search);
    if (!equations) {
      break;
    }
    if (equations->weighed_rms < kMostMisfitLeft * kept || is_far_off(search, group, equations->rms)) {
      kept = equations->weighed_rms;
      found.rms_without = equations->rms;
      found.rows = described(search, out);
    }
  }
  return found;
}

}  // namespace kdl_calibration
