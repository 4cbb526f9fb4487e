#include "selection/table_certainty.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <string>

#include "base/dense.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/linear_system.hpp"

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

TableCertainty::TableCertainty(const Candidate& candidate, const MatrixXd& information, const Groups& groups,
                               const GroupSizes& sizes)
    : candidate_(candidate) {
  if (std::none_of(candidate.model.effects.begin(), candidate.model.effects.end(), is_of_table)) {
    return;
  }
  SizedInformation sized = sized_information(information, groups, sizes);
  std::map<int, std::vector<Index>> places;  // among the columns that are left
  for (const std::size_t e : candidate.free.effects()) {
    const EffectTerm& term = candidate.model.effects[e];
    if (!is_of_table(term)) {
      continue;
    }
    const Index column = *candidate.free.column(UnknownGroup::effects, e);
    const auto place = std::lower_bound(sized.columns.begin(), sized.columns.end(), column);
    if (place != sized.columns.end() && *place == column) {
      Table& table = tables_[term.index];
      table.terms.push_back(e);
      table.columns.push_back(column);
      places[term.index].push_back(place - sized.columns.begin());
      const auto name = std::find(groups.names.begin(), groups.names.end(), size_name(term));
      table.sigma = sizes.sizes[static_cast<std::size_t>(name - groups.names.begin())];
    }
  }
  const Index n = sized.matrix.rows();
  const VectorXd scale = unit_scale_of_information(sized.matrix);
  MatrixXd root = scale.asDiagonal() * sized.matrix * scale.asDiagonal();
  factorise(root);
  invert_lower(root);
  for (auto& [joint, table] : tables_) {
    MatrixXd own = MatrixXd::Zero(n, static_cast<Index>(table.columns.size()));
    for (Index k = 0; k < own.cols(); ++k) {
      const Index place = places[joint][static_cast<std::size_t>(k)];
      own.col(k).tail(n - place) = sizes.sigma * scale[place] * root.col(place).tail(n - place);
    }
    table.covariance = MatrixXd::Zero(own.cols(), own.cols());
    add_product(1.0, factor(own).transposed(), factor(own).transposed(), table.covariance);
  }
}

bool TableCertainty::is_uncertain(const Table& table, double joint_value) const {
  constexpr double kShare = 0.8;
  VectorXd functions(static_cast<Index>(table.terms.size()));
  for (std::size_t k = 0; k < table.terms.size(); ++k) {
    functions[static_cast<Index>(k)] =
        table_value(std::get<JointTable>(candidate_.model.effects[table.terms[k]].function), joint_value);
  }
  const double beforehand = table.sigma * functions.norm();
  const double variance = functions.dot(table.covariance * functions);
  return !(variance <= kShare * kShare * beforehand * beforehand);
}

void TableCertainty::withhold(const VectorXd& joint_values, VectorXd& columns) const {
  for (const auto& [joint, table] : tables_) {
    if (is_uncertain(table, joint_values[joint])) {
      columns(table.columns).setZero();
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
  bool inside = false;
  for (int i = 0; i <= steps; ++i) {
    const double value = i == steps ? range.upper : range.lower + step * i;
    const bool uncertain = is_uncertain(found->second, value);
    if (uncertain && !inside) {
      result.emplace_back(i == 0 ? value : value - step, value);
    }
    if (uncertain || inside) {
      result.back().second = value;  // ends at the first certain value
    }
    inside = uncertain;
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
