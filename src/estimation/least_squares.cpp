#include "estimation/least_squares.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "base/preconditions.hpp"
#include "estimation/block_pass.hpp"
#include "estimation/input_check.hpp"
#include "estimation/lane_pass.hpp"
#include "estimation/observed_data.hpp"
#include "estimation/residual_options.hpp"
#include "measurements/drive_signals.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct LeastSquaresProblem::Workspace::Content {
  LaneWorkspace lanes;
  BlockWorkspace blocks;
  VectorXd values;  // of the columns
  VectorXd left;    // residuals of the priors
};

LeastSquaresProblem::Workspace::Workspace() : content_(std::make_unique<Content>()) {}
LeastSquaresProblem::Workspace::~Workspace() = default;

namespace {

const ErrorModel& checked(const ErrorModel& model, const Measurements& measurements, const Unknowns& unknowns,
                          const ResidualOptions& options) {
  check(measurements, model);
  check(unknowns, model, measurements);
  check(options, measurements);
  return model;
}

}  // namespace

struct LeastSquaresProblem::Data {
  Data(const ErrorModel& the_model, const Measurements& measurements, const Unknowns& the_unknowns,
       const ResidualOptions& options)
      : model(checked(the_model, measurements, the_unknowns, options)),
        unknowns(the_unknowns),
        targets(measurements.targets.size()),
        observed(gathered(the_model, the_unknowns, measurements, options)),
        priors(prior_rows(the_unknowns, options)),
        prior_information(priors.information()),
        lanes(model, unknowns, observed.groups, options.threads),
        blocks(model, unknowns, observed) {}

  // Checks sizes only, because it runs in every pass.
  void require_fit(const Estimate& estimate) const {
    require_count("errors of an estimate", estimate.errors.size(), model.parameters.size());
    require_count("targets of an estimate", estimate.targets.size(), targets);
    if (estimate.effects.size() != 0) {
      require_count("effects of an estimate", estimate.effects.size(), model.effects.size());
    }
  }

  bool side_by_side() const { return !observed.groups.empty(); }

  bool is_summarised_side_by_side() const {
    std::size_t count = 0;
    for (const LaneGroup& group : observed.groups) {
      count += group.configurations;
    }
    return count > kManyConfigurations && std::all_of(observed.groups.begin(), observed.groups.end(), has_summary);
  }

  // Residuals of the priors, without allocation.
  template <class Content>
  const VectorXd& prior_residuals(const Estimate& estimate, Content& workspace) const {
    workspace.values.resize(unknowns.size());
    for (Index column = 0; column < unknowns.size(); ++column) {
      workspace.values[column] = Unknowns::value(estimate, unknowns.columns()[static_cast<std::size_t>(column)]);
    }
    workspace.left = priors.expected;
    workspace.left.noalias() -= priors.rows * workspace.values;
    return workspace.left;
  }

  std::optional<WhitenedSummary> summary_of_groups(const Estimate& estimate, const MatrixXd& information,
                                                   LaneWorkspace& workspace) const;

  const ErrorModel& model;
  const Unknowns unknowns;
  const std::size_t targets;
  const ObservedData observed;
  const PriorRows priors;
  const Eigen::SparseMatrix<double> prior_information;
  const LanePass lanes;
  const BlockPass blocks;
};

LeastSquaresProblem::LeastSquaresProblem(const ErrorModel& model, const Measurements& measurements,
                                         const Unknowns& unknowns, const ResidualOptions& options)
    : data_(std::make_unique<const Data>(model, measurements, unknowns, options)) {}
LeastSquaresProblem::~LeastSquaresProblem() = default;

const ErrorModel& LeastSquaresProblem::model() const { return data_->model; }
const Unknowns& LeastSquaresProblem::unknowns() const { return data_->unknowns; }
Index LeastSquaresProblem::columns() const { return data_->unknowns.size(); }
long LeastSquaresProblem::equations() const { return data_->observed.totals.equations; }
long LeastSquaresProblem::points() const { return data_->observed.totals.points; }
double LeastSquaresProblem::cost_of_repeats() const { return data_->observed.totals.cost_of_repeats; }
double LeastSquaresProblem::total_weight() const { return data_->observed.totals.weight; }

NormalEquations LeastSquaresProblem::linearise(const Estimate& estimate) const {
  Workspace workspace;
  NormalEquations equations;
  linearise(estimate, workspace, equations);
  return equations;
}

void LeastSquaresProblem::linearise(const Estimate& estimate, Workspace& workspace, NormalEquations& equations) const {
  data_->require_fit(estimate);
  const Index columns = data_->unknowns.size();
  equations.hessian.setZero(columns, columns);
  equations.gradient.setZero(columns);
  equations.cost = data_->observed.totals.cost_of_repeats;
  if (data_->side_by_side()) {
    data_->lanes.add(estimate, workspace.content_->lanes, equations);
  } else {
    data_->blocks.add(estimate, workspace.content_->blocks, equations);
  }
  if (data_->priors.rows.rows() > 0) {
    const VectorXd& left = data_->prior_residuals(estimate, *workspace.content_);
    equations.hessian += data_->prior_information;
    equations.gradient.noalias() += data_->priors.rows.transpose() * left;
    equations.cost += left.squaredNorm();
  }
  const ColumnRange chain = data_->unknowns.chain();
  const ColumnRange targets = data_->unknowns.range(UnknownGroup::targets);
  equations.hessian.bottomLeftCorner(targets.count, chain.count) =
      equations.hessian.topRightCorner(chain.count, targets.count).transpose();
}

double LeastSquaresProblem::cost(const Estimate& estimate) const {
  Workspace workspace;
  return cost(estimate, workspace);
}

double LeastSquaresProblem::cost(const Estimate& estimate, Workspace& workspace) const {
  data_->require_fit(estimate);
  double cost = data_->observed.totals.cost_of_repeats;
  cost += data_->side_by_side() ? data_->lanes.cost(estimate, workspace.content_->lanes)
                                : data_->blocks.cost(estimate, workspace.content_->blocks);
  if (data_->priors.rows.rows() > 0) {
    cost += data_->prior_residuals(estimate, *workspace.content_).squaredNorm();
  }
  return cost;
}

WhitenedSystem LeastSquaresProblem::whitened(const Estimate& estimate) const {
  data_->require_fit(estimate);
  const Index columns = data_->unknowns.size();
  std::vector<MatrixXd> blocks;
  Block linearised;
  Index rows = 0;
  data_->blocks.visit(estimate, linearised, [&](const Block& block) {
    whiten(block, columns, blocks.emplace_back());
    rows += blocks.back().rows();
  });
  const Index priors = data_->priors.rows.rows();
  WhitenedSystem system{
      .jacobian = MatrixXd::Zero(rows + priors, columns), .residual = VectorXd::Zero(rows + priors), .blocks = {}};
  const std::vector<Index> configurations = data_->observed.columns();
  std::vector<std::size_t> order(blocks.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return configurations[a] < configurations[b]; });
  Index row = 0;
  for (const std::size_t place : order) {
    const MatrixXd& block = blocks[place];
    system.blocks.push_back(row);
    system.jacobian.middleRows(row, block.rows()) = block.leftCols(columns);
    system.residual.segment(row, block.rows()) = block.rightCols<1>();
    row += block.rows();
  }
  system.blocks.push_back(row);
  system.jacobian.bottomRows(priors) = data_->priors.rows;
  system.residual.tail(priors) = data_->priors.residuals(data_->unknowns.values(estimate));
  return system;
}

WhitenedSummary LeastSquaresProblem::whitened_summary(const Estimate& estimate) const {
  data_->require_fit(estimate);
  if (data_->is_summarised_side_by_side()) {
    Workspace workspace;
    NormalEquations equations;
    linearise(estimate, workspace, equations);
    if (auto summary = data_->summary_of_groups(estimate, equations.hessian, workspace.content_->lanes)) {
      return std::move(*summary);
    }
  }
  const Index columns = data_->unknowns.size();
  RowSummary summary(columns);
  Block linearised;
  MatrixXd rows;
  data_->blocks.visit(estimate, linearised, [&](const Block& block) {
    whiten(block, columns, rows);
    summary.add_configuration(rows.leftCols(columns), rows.col(columns));
  });
  summary.add_priors(MatrixXd(data_->priors.rows));
  return summary.finish();
}

// Empty if the information is too badly conditioned for a Cholesky factor.
std::optional<WhitenedSummary> LeastSquaresProblem::Data::summary_of_groups(const Estimate& estimate,
                                                                            const MatrixXd& information,
                                                                            LaneWorkspace& workspace) const {
  std::optional<MatrixXd> root = well_conditioned_root(information);
  if (!root) {
    return std::nullopt;
  }
  WhitenedSummary summary;
  summary.sqrt_information = std::move(*root);
  summary.priors = prior_information;
  summary.sums = MatrixXd::Zero(unknowns.size(), unknowns.size());
  lanes.summarise(estimate, workspace, summary);
  summary.rows = summary.measured_rows + priors.rows.rows();
  return summary;
}

}  // namespace kdl_calibration
