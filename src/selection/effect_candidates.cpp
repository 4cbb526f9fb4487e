#include "selection/effect_candidates.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "effects/joint_effects.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/residual_options.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

constexpr double kMostOfTable = 2e-3;  // [m or rad]
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

}  // namespace

Candidate with_terms(const ErrorModel& rigid, const Unknowns& free, const std::vector<EffectTerm>& terms, bool sized) {
  Candidate result{.model = rigid, .free = {}, .sized = sized};
  result.model.effects = terms;
  result.free = free.with_all(result.model, UnknownGroup::effects);
  return result;
}

LinearRows linear_rows(const Candidate& candidate, const Measurements& means, Estimate optimum,
                       double orientation_length) {
  optimum.effects = VectorXd::Zero(static_cast<Index>(candidate.model.effects.size()));
  ResidualOptions residuals;
  residuals.orientation_length = orientation_length;
  const LeastSquaresProblem problem(candidate.model, means, candidate.free, residuals);
  WhitenedSystem system = problem.whitened(optimum);
  LinearRows rows{.J = std::move(system.jacobian), .y = std::move(system.residual), .first = std::move(system.blocks)};
  for (const std::size_t i : candidate.free.geometric()) {
    const Index column = *candidate.free.column(UnknownGroup::geometric, i);
    rows.y += rows.J.col(column) * optimum.errors[static_cast<Index>(i)];
  }
  const auto points = static_cast<double>(std::max(problem.points(), 1L));
  rows.unit = 1.0 / std::sqrt(problem.total_weight() / points);
  return rows;
}

Unknowns joint_offsets(const ErrorModel& model, const std::vector<TargetFrame>& targets) {
  std::vector<std::string> names;
  for (const ErrorParameter& parameter : model.parameters) {
    if (parameter.kind == ParameterKind::joint_offset) {
      names.push_back(parameter.name);
    }
  }
  return {model, targets, names};
}

LinearRows joint_rows(const ErrorModel& rigid, const Measurements& means, const Estimate& optimum,
                      double orientation_length) {
  const Candidate candidate{.model = rigid, .free = joint_offsets(rigid, optimum.targets)};
  return linear_rows(candidate, means, optimum, orientation_length);
}

LinearSums sums_of(const LinearRows& rows, const std::vector<Index>& configurations) {
  LinearSums sums{.information = MatrixXd::Zero(rows.J.cols(), rows.J.cols()), .moment = VectorXd::Zero(rows.J.cols())};
  for (const Index c : configurations) {
    const Index first = rows.first[static_cast<std::size_t>(c)];
    const Index count = rows.first[static_cast<std::size_t>(c) + 1] - first;
    const auto J = rows.J.middleRows(first, count);
    const auto y = rows.y.segment(first, count);
    sums.information.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
    sums.moment.noalias() += J.transpose() * y;
    sums.squares += y.squaredNorm();
    sums.equations += static_cast<double>(count);
  }
  sums.information.triangularView<Eigen::StrictlyUpper>() = sums.information.transpose();
  return sums;
}

bool is_of_table(const EffectTerm& term) { return std::holds_alternative<JointTable>(term.function); }

Groups groups_of(const Candidate& candidate, const Priors& stated) {
  Groups result;
  std::map<std::string, std::size_t> number;
  const auto add = [&](const std::string& name, Index column, double size, double most, bool is_ample) {
    const auto [found, is_new] = number.emplace(name, result.columns.size());
    if (is_new) {
      result.columns.emplace_back();
      result.names.push_back(name);
      result.limits.held.push_back(size);
      result.limits.most.push_back(most);
      result.limits.inflated.push_back(is_ample);
    }
    result.columns[found->second].push_back(column);
  };
  const ColumnRange geometric = candidate.free.range(UnknownGroup::geometric);
  for (Index column = geometric.first; column < geometric.end(); ++column) {
    const bool length = candidate.free.columns()[static_cast<std::size_t>(column)].length;
    const double size = length ? stated.length : stated.angle;
    if (candidate.sized || size > 0.0) {
      add(length ? "length" : "angle", column, candidate.sized ? 0.0 : size, kUnlimited, true);
    }
  }
  for (const std::size_t e : candidate.free.effects()) {
    const EffectTerm& term = candidate.model.effects[e];
    add(size_name(term), *candidate.free.column(UnknownGroup::effects, e), 0.0,
        is_of_table(term) ? kMostOfTable : kUnlimited, false);
  }
  return result;
}

}  // namespace kdl_calibration
