#include "selection/effect_candidates.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "base/dense.hpp"
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

std::pair<Index, Index> LinearRows::range(Index configuration) const {
  const auto c = static_cast<std::size_t>(configuration);
  return {first[c], first[c + 1] - first[c]};
}

Index LinearRows::motion(Index column) const {
  const Index effect = column - first_effect;
  return effect < 0          ? column
         : is_effect(column) ? motion_of[static_cast<std::size_t>(effect)]
                             : effect - effects.rows() + first_effect + moved;
}

double LinearRows::value(Index column, Index configuration) const {
  return is_effect(column) ? effects(column - first_effect, configuration) : 1.0;
}

VectorXd LinearRows::product(Index configuration, const VectorXd& x) const {
  VectorXd of_motions = VectorXd::Zero(motions.cols());
  for (Index column = 0; column < x.size(); ++column) {
    of_motions[motion(column)] += value(column, configuration) * x[column];
  }
  const auto [start, count] = range(configuration);
  return motions.middleRows(start, count) * of_motions;
}

VectorXd LinearRows::residual(VectorXd v, const VectorXd& x) const {
  for (Index c = 0; c < configurations(); ++c) {
    const auto [start, count] = range(c);
    v.segment(start, count) -= product(c, x);
  }
  return v;
}

VectorXd LinearRows::moments(const VectorXd& v) const {
  VectorXd result = VectorXd::Zero(columns());
  for (Index c = 0; c < configurations(); ++c) {
    const auto [start, count] = range(c);
    const VectorXd of_motions = motions.middleRows(start, count).transpose() * v.segment(start, count);
    for (Index column = 0; column < result.size(); ++column) {
      result[column] += value(column, c) * of_motions[motion(column)];
    }
  }
  return result;
}

Candidate with_terms(const ErrorModel& rigid, const Unknowns& free, const std::vector<EffectTerm>& terms, bool sized) {
  Candidate result{.model = rigid, .free = {}, .sized = sized};
  result.model.effects = terms;
  result.free = free.with_group(result.model, UnknownGroup::effects);
  return result;
}

LinearRows linear_rows(const Candidate& candidate, const Measurements& means, Estimate optimum,
                       double orientation_length) {
  LinearRows rows{.effects = effect_basis(candidate.model, means.joint_values, means.signals),
                  .first_effect = candidate.free.range(UnknownGroup::effects).first};
  std::map<std::pair<int, EffectAxis>, Index> motions;
  std::vector<EffectTerm> units;  // an effect of value 1 on each motion
  for (const EffectTerm& term : candidate.model.effects) {
    const auto [found, is_new] =
        motions.try_emplace({term.index, term.axis}, rows.first_effect + static_cast<Index>(motions.size()));
    rows.motion_of.push_back(found->second);
    if (is_new) {
      units.push_back({.joint = term.joint,
                       .index = term.index,
                       .axis = term.axis,
                       .function = Sinusoid{.times = 0.0, .is_cosine = true}});
    }
  }
  rows.moved = static_cast<Index>(units.size());
  const Candidate moved = with_terms(candidate.model, candidate.free.without(UnknownGroup::effects), units, false);
  optimum.effects = VectorXd::Zero(static_cast<Index>(units.size()));
  ResidualOptions residuals;
  residuals.orientation_length = orientation_length;
  const LeastSquaresProblem problem(moved.model, means, moved.free, residuals);
  WhitenedSystem system = problem.whitened(optimum);
  rows.motions = std::move(system.jacobian);
  rows.y = std::move(system.residual);
  rows.first = std::move(system.blocks);
  for (const std::size_t i : candidate.free.geometric()) {
    const Index column = *candidate.free.column(UnknownGroup::geometric, i);
    rows.y += rows.motions.col(column) * optimum.errors[static_cast<Index>(i)];
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
  const Candidate candidate{.model = rigid, .free = joint_offsets(rigid, optimum.frames.targets)};
  return linear_rows(candidate, means, optimum, orientation_length);
}

namespace {

// The effects on one motion, their values at some configurations, and for each of these configurations the products of
// the motion's column with all columns of `motions` and with y.
struct MovedPart {
  Index motion = 0;
  std::vector<Index> columns;
  MatrixXd values;
  MatrixXd products;
};

std::vector<MovedPart> moved_parts(const LinearRows& rows, const std::vector<Index>& configurations) {
  std::map<Index, std::vector<Index>> effects;
  for (std::size_t e = 0; e < rows.motion_of.size(); ++e) {
    effects[rows.motion_of[e]].push_back(static_cast<Index>(e));
  }
  std::vector<MovedPart> parts;
  for (const auto& [motion, of_motion] : effects) {
    MovedPart& part = parts.emplace_back();
    part.motion = motion;
    part.values = rows.effects(of_motion, configurations);
    part.products.resize(static_cast<Index>(configurations.size()), rows.motions.cols() + 1);
    for (std::size_t i = 0; i < configurations.size(); ++i) {
      const auto [first, count] = rows.range(configurations[i]);
      const auto own = rows.motions.col(motion).segment(first, count).transpose();
      const auto row = static_cast<Index>(i);
      part.products.row(row).head(rows.motions.cols()) = own.lazyProduct(rows.motions.middleRows(first, count));
      part.products(row, rows.motions.cols()) = own.dot(rows.y.segment(first, count));
    }
    for (const Index e : of_motion) {
      part.columns.push_back(rows.first_effect + e);
    }
  }
  return parts;
}

// Sums of the columns that are no effects.
LinearSums plain_sums(const LinearRows& rows, const std::vector<Index>& configurations,
                      const std::vector<Index>& columns) {
  LinearSums sums{.information = MatrixXd::Zero(rows.columns(), rows.columns()),
                  .moment = VectorXd::Zero(rows.columns())};
  MatrixXd information = MatrixXd::Zero(rows.motions.cols(), rows.motions.cols());
  VectorXd moment = VectorXd::Zero(rows.motions.cols());
  for (const Index c : configurations) {
    const auto [first, count] = rows.range(c);
    const auto J = rows.motions.middleRows(first, count);
    const auto y = rows.y.segment(first, count);
    information.selfadjointView<Eigen::Lower>().rankUpdate(J.transpose());
    moment.noalias() += J.transpose() * y;
    sums.squares += y.squaredNorm();
    sums.equations += static_cast<double>(count);
  }
  information.triangularView<Eigen::StrictlyUpper>() = information.transpose();
  std::vector<Index> motions(columns.size());
  std::transform(columns.begin(), columns.end(), motions.begin(), [&](Index column) { return rows.motion(column); });
  sums.information(columns, columns) = information(motions, motions);
  sums.moment(columns) = moment(motions);
  return sums;
}

}  // namespace

LinearSums sums_of(const LinearRows& rows, const std::vector<Index>& configurations) {
  std::vector<Index> plain;
  for (Index column = 0; column < rows.columns(); ++column) {
    if (!rows.is_effect(column)) {
      plain.push_back(column);
    }
  }
  LinearSums sums = plain_sums(rows, configurations, plain);
  const std::vector<MovedPart> parts = moved_parts(rows, configurations);
  for (std::size_t a = 0; a < parts.size(); ++a) {
    const MovedPart& part = parts[a];
    const MatrixXd products = part.values * part.products;
    sums.moment(part.columns) = products.rightCols<1>();
    for (const Index column : plain) {
      sums.information(part.columns, column) = products.col(rows.motion(column));
      sums.information(column, part.columns) = products.col(rows.motion(column)).transpose();
    }
    for (std::size_t b = 0; b <= a; ++b) {
      const MovedPart& other = parts[b];
      const MatrixXd weighted = part.values * part.products.col(other.motion).asDiagonal();
      MatrixXd block = MatrixXd::Zero(part.values.rows(), other.values.rows());
      add_product(1.0, factor(weighted), factor(other.values), block);
      sums.information(part.columns, other.columns) = block;
      sums.information(other.columns, part.columns) = block.transpose();
    }
  }
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
