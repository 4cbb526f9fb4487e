#include "selection/table_certainty.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "base/dense.hpp"
#include "effects/joint_effects.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

SizedInformation sized_information(const MatrixXd& information, const Groups& groups, const GroupSizes& sizes) {
  VectorXd added = VectorXd::Zero(information.cols());
  for (std::size_t g = 0; g < groups.columns.size(); ++g) {
    const double ratio = sizes.sigma / sizes.sizes[g];  // infinite if the group is switched off
    added(groups.columns[g]).setConstant(ratio * ratio);
  }
  SizedInformation result;
  for (Index column = 0; column < added.size(); ++column) {
    if (std::isfinite(added[column])) {
      result.columns.push_back(column);
    }
  }
  result.matrix = information(result.columns, result.columns);
  result.matrix.diagonal() += added(result.columns);
  return result;
}

TableCertainty::TableCertainty(const Candidate& candidate, const Groups& groups, const GroupSizes& sizes)
    : candidate_(candidate), root_(sizes.root) {
  std::map<std::string, int> joint_of;  // by name of the group
  for (const std::size_t e : candidate.free.effects()) {
    const EffectTerm& term = candidate.model.effects[e];
    if (is_of_table(term)) {
      joint_of[size_name(term)] = term.index;
      tables_[term.index].terms.push_back(e);
    }
  }
  Index first = 0;
  for (std::size_t g = 0; g < groups.names.size(); ++g) {
    if (const auto found = joint_of.find(groups.names[g]); found != joint_of.end()) {
      Table& table = tables_[found->second];
      table.columns = groups.columns[g];
      table.first = first;
      table.sigma = sizes.sizes[g];
    }
    first += std::ssize(groups.columns[g]);
  }
  std::erase_if(tables_, [](const auto& table) { return table.second.sigma == 0.0; });
}

// The variance of a table's value f . x with covariance (L L^T)^-1 of x over its squared sigma is |L^-1 f|^2.
std::vector<bool> TableCertainty::is_uncertain(const Table& table, const VectorXd& joint_values) const {
  constexpr double kShare = 0.8;
  const Index left = root_.rows() - table.first;  // L^-1 f is zero before
  MatrixXd functions = MatrixXd::Zero(left, joint_values.size());
  for (std::size_t k = 0; k < table.terms.size(); ++k) {
    const auto& function = std::get<JointTable>(candidate_.model.effects[table.terms[k]].function);
    for (Index i = 0; i < joint_values.size(); ++i) {
      functions(static_cast<Index>(k), i) = table_value(function, joint_values[i]);
    }
  }
  const VectorXd beforehand = functions.colwise().squaredNorm();
  solve_lower(root_.bottomRightCorner(left, left), functions);
  std::vector<bool> result;
  for (Index i = 0; i < joint_values.size(); ++i) {
    result.push_back(!(functions.col(i).squaredNorm() <= kShare * kShare * beforehand[i]));
  }
  return result;
}

void TableCertainty::withhold(const MatrixXd& joint_values, MatrixXd& values) const {
  for (const auto& [joint, table] : tables_) {
    const std::vector<bool> uncertain = is_uncertain(table, joint_values.row(joint));
    for (std::size_t i = 0; i < uncertain.size(); ++i) {
      if (uncertain[i]) {
        values.col(static_cast<Index>(i))(table.columns).setZero();
      }
    }
  }
}

std::vector<std::pair<double, double>> TableCertainty::gaps(int joint) const {
  constexpr double kParts = 8.0;  // of the table's length
  constexpr double kMostSteps = 1e4;
  std::vector<std::pair<double, double>> result;
  const auto found = tables_.find(joint);
  if (found == tables_.end()) {
    return result;
  }
  const JointTable& range = std::get<JointTable>(candidate_.model.effects[found->second.terms.front()].function);
  const double parts = (range.upper - range.lower) / range.length * kParts;
  const auto steps = static_cast<int>(std::ceil(std::min(parts, kMostSteps)));
  const double step = (range.upper - range.lower) / steps;
  VectorXd values = VectorXd::LinSpaced(steps + 1, range.lower, range.lower + step * steps);
  values[steps] = range.upper;
  const std::vector<bool> uncertain = is_uncertain(found->second, values);
  bool inside = false;
  for (int i = 0; i <= steps; ++i) {
    const bool here = uncertain[static_cast<std::size_t>(i)];
    if (here && !inside) {
      result.emplace_back(values[std::max(i - 1, 0)], values[i]);
    }
    if (here || inside) {
      result.back().second = values[i];  // ends at the first certain value
    }
    inside = here;
  }
  return result;
}

void TableCertainty::withhold_gaps(std::vector<EffectTerm>& terms) const {
  std::map<int, std::vector<std::pair<double, double>>> of_joint;
  for (EffectTerm& term : terms) {
    if (auto* const table = std::get_if<JointTable>(&term.function)) {
      const auto [own, is_new] = of_joint.try_emplace(term.index);
      if (is_new) {
        own->second = gaps(term.index);
      }
      table->withheld = own->second;
    }
  }
}

bool is_withheld_throughout(const EffectTerm& term) {
  const auto* const table = std::get_if<JointTable>(&term.function);
  return table != nullptr && !table->withheld.empty() &&
         table->withheld.front() == std::pair(table->lower, table->upper);
}

}  // namespace kdl_calibration
