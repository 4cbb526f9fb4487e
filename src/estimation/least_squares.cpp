#include "estimation/least_squares.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

#include "base/decompositions.hpp"
#include "estimation/block_pass.hpp"
#include "estimation/lane_pass.hpp"
#include "estimation/observed_data.hpp"
#include "estimation/residual_options.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/stations.hpp"
#include "model/parameters.hpp"

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

// The rotations as motions of the base, in `count` columns. None if a column of the base is fixed.
MatrixXd motions_of_base(const UndeterminedRotations& undetermined, const Eigen::Isometry3d& X_WB,
                         const std::array<int, 6>& columns, Index count) {
  const bool free = std::none_of(columns.begin(), columns.end(), [](int column) { return column < 0; });
  MatrixXd result = MatrixXd::Zero(count, free ? undetermined.axes.cols() : 0);
  for (Index i = 0; i < result.cols(); ++i) {
    const Eigen::Vector3d turn = X_WB.linear().transpose() * undetermined.axes.col(i);
    Vector6d motion;
    motion << (X_WB.inverse() * undetermined.centre).cross(turn), turn;
    result(columns, i) = motion;
  }
  return result;
}

}  // namespace

struct LeastSquaresProblem::Data {
  // The rows of one of several stations, and the columns of its unknowns among all.
  struct Part {
    std::size_t station;
    std::vector<Index> columns;
    std::unique_ptr<const LeastSquaresProblem> problem;
    UndeterminedRotations undetermined;

    Estimate at(const Estimate& estimate) const {
      return {.errors = estimate.errors,
              .frames = {.bases = {estimate.frames.base(station)}, .targets = estimate.frames.targets},
              .effects = estimate.effects};
    }
  };

  Data(const ErrorModel& the_model, const Measurements& measurements, const Unknowns& the_unknowns,
       const ResidualOptions& options)
      : model(the_model),
        unknowns(the_unknowns),
        one_station(the_model.has_undetermined_bases
                        ? std::make_unique<const ErrorModel>(model_at_stations({}, the_model))
                        : nullptr),
        parts(parts_of(measurements, options)),
        observed(parts.empty() ? gathered(the_model, the_unknowns, measurements, options) : ObservedData()),
        totals(totals_of_parts()),
        priors(prior_rows(the_unknowns, options)),
        prior_information(priors.information()),
        lanes(model, unknowns, observed.groups, options.threads),
        blocks(model, unknowns, observed) {}

  std::vector<Part> parts_of(const Measurements& measurements, const ResidualOptions& options) const;
  ObservedTotals totals_of_parts() const;
  void add_parts(const Estimate& estimate, NormalEquations& equations) const;
  double cost_of_parts(const Estimate& estimate) const;
  std::vector<Index> configurations() const;
  template <class Visitor>
  void visit_whitened(const Estimate& estimate, Visitor visitor) const;

  bool side_by_side() const { return !observed.groups.empty(); }

  // Whether a Cholesky factor saves much beside a QR decomposition of the rows.
  bool has_much() const {
    constexpr std::size_t kUsualColumns = 30;
    std::size_t count = 0;
    for (const LaneGroup& group : observed.groups) {
      count += group.configurations;
    }
    const auto columns = static_cast<std::size_t>(unknowns.size());
    return count * std::max(columns, kUsualColumns) > kManyConfigurations * kUsualColumns;
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

  WhitenedSummary summary_of_groups(const Estimate& estimate, MatrixXd sqrt_information,
                                    LaneWorkspace& workspace) const;

  const ErrorModel& model;
  const Unknowns unknowns;
  const std::unique_ptr<const ErrorModel> one_station;  // the model of the parts
  const std::vector<Part> parts;                        // of several stations, or one with undetermined rotations
  const ObservedData observed;                          // of a single one
  const ObservedTotals totals;
  const PriorRows priors;
  const Eigen::SparseMatrix<double> prior_information;
  const LanePass lanes;
  const BlockPass blocks;
};

std::vector<LeastSquaresProblem::Data::Part> LeastSquaresProblem::Data::parts_of(const Measurements& measurements,
                                                                                 const ResidualOptions& options) const {
  std::vector<Part> result;
  const bool in_parts = model.stations.size() > 1 ||
                        (model.has_undetermined_bases && undetermined_rotations(measurements).axes.cols() > 0);
  for (std::size_t station = 0; in_parts && station < model.stations.size(); ++station) {
    const StationRows own = rows_of_station(measurements, station);
    ResidualOptions residuals = options;
    residuals.priors = {};
    residuals.earlier = nullptr;
    residuals.row_weights.clear();
    for (std::size_t i = 0; !options.row_weights.empty() && i < own.rows.size(); ++i) {
      residuals.row_weights.push_back(options.row_weights[own.rows[i]]);
    }
    Part& part = result.emplace_back(Part{station, {}, nullptr, undetermined_rotations(own.measurements)});
    const std::vector<bool> marked = unknowns.columns_at_station(station);
    for (std::size_t column = 0; column < marked.size(); ++column) {
      if (marked[column]) {
        part.columns.push_back(static_cast<Index>(column));
      }
    }
    part.problem = std::make_unique<const LeastSquaresProblem>(*one_station, own.measurements,
                                                               unknowns.of_station(station), residuals);
  }
  return result;
}

ObservedTotals LeastSquaresProblem::Data::totals_of_parts() const {
  ObservedTotals sum = observed.totals;
  for (const Part& part : parts) {
    const ObservedTotals& own = part.problem->data_->totals;
    sum.equations += own.equations;
    sum.points += own.points;
    sum.cost_of_repeats += own.cost_of_repeats;
    sum.weight += own.weight;
  }
  return sum;
}

void LeastSquaresProblem::Data::add_parts(const Estimate& estimate, NormalEquations& equations) const {
  for (const Part& part : parts) {
    const NormalEquations own = part.problem->linearise(part.at(estimate));
    equations.hessian(part.columns, part.columns) += own.hessian;
    equations.gradient(part.columns) += own.gradient;
    equations.cost += own.cost;
  }
}

double LeastSquaresProblem::Data::cost_of_parts(const Estimate& estimate) const {
  double cost = 0.0;
  for (const Part& part : parts) {
    cost += part.problem->cost(part.at(estimate));
  }
  return cost;
}

// The configurations in the order of visit_whitened().
std::vector<Index> LeastSquaresProblem::Data::configurations() const {
  std::vector<Index> result = observed.columns();
  for (const Part& part : parts) {
    const std::vector<Index> own = part.problem->data_->configurations();
    result.insert(result.end(), own.begin(), own.end());
  }
  return result;
}

// Calls visitor(rows) for each configuration: its whitened Jacobian with the residual as last column.
template <class Visitor>
void LeastSquaresProblem::Data::visit_whitened(const Estimate& estimate, Visitor visitor) const {
  Block linearised;
  MatrixXd rows;
  blocks.visit(estimate, linearised, [&](const Block& block) {
    whiten(block, unknowns.size(), rows);
    visitor(rows);
  });
  for (const Part& part : parts) {
    const LeastSquaresProblem::Data& own = *part.problem->data_;
    const Estimate at = part.at(estimate);
    Block of_part;
    MatrixXd whitened;
    own.blocks.visit(at, of_part, [&](const Block& block) {
      whiten(block, own.unknowns.size(), whitened);
      rows.setZero(whitened.rows(), unknowns.size() + 1);
      rows(Eigen::all, part.columns) = whitened.leftCols(own.unknowns.size());
      rows.rightCols<1>() = whitened.rightCols<1>();
      visitor(rows);
    });
  }
}

LeastSquaresProblem::LeastSquaresProblem(const ErrorModel& model, const Measurements& measurements,
                                         const Unknowns& unknowns, const ResidualOptions& options)
    : data_(std::make_unique<const Data>(model, measurements, unknowns, options)) {}
LeastSquaresProblem::~LeastSquaresProblem() = default;

const ErrorModel& LeastSquaresProblem::model() const { return data_->model; }
const Unknowns& LeastSquaresProblem::unknowns() const { return data_->unknowns; }
Index LeastSquaresProblem::columns() const { return data_->unknowns.size(); }
long LeastSquaresProblem::equations() const { return data_->totals.equations; }
long LeastSquaresProblem::points() const { return data_->totals.points; }
double LeastSquaresProblem::cost_of_repeats() const { return data_->totals.cost_of_repeats; }
double LeastSquaresProblem::total_weight() const { return data_->totals.weight; }

NormalEquations LeastSquaresProblem::linearise(const Estimate& estimate) const {
  Workspace workspace;
  NormalEquations equations;
  linearise(estimate, workspace, equations);
  return equations;
}

void LeastSquaresProblem::linearise(const Estimate& estimate, Workspace& workspace, NormalEquations& equations) const {
  const Index columns = data_->unknowns.size();
  equations.hessian.setZero(columns, columns);
  equations.gradient.setZero(columns);
  equations.cost = data_->observed.totals.cost_of_repeats;
  if (data_->side_by_side()) {
    data_->lanes.add(estimate, workspace.content_->lanes, equations);
  } else {
    data_->blocks.add(estimate, workspace.content_->blocks, equations);
  }
  data_->add_parts(estimate, equations);
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
  double cost = data_->observed.totals.cost_of_repeats;
  cost += data_->side_by_side() ? data_->lanes.cost(estimate, workspace.content_->lanes)
                                : data_->blocks.cost(estimate, workspace.content_->blocks);
  cost += data_->cost_of_parts(estimate);
  if (data_->priors.rows.rows() > 0) {
    cost += data_->prior_residuals(estimate, *workspace.content_).squaredNorm();
  }
  return cost;
}

WhitenedSystem LeastSquaresProblem::whitened(const Estimate& estimate) const {
  const Index columns = data_->unknowns.size();
  std::vector<MatrixXd> blocks;
  Index rows = 0;
  data_->visit_whitened(estimate, [&](const MatrixXd& block) {
    blocks.push_back(block);
    rows += block.rows();
  });
  const Index priors = data_->priors.rows.rows();
  WhitenedSystem system{
      .jacobian = MatrixXd::Zero(rows + priors, columns), .residual = VectorXd::Zero(rows + priors), .blocks = {}};
  const std::vector<Index> configurations = data_->configurations();
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
  std::optional<MatrixXd> root;
  if (data_->has_much()) {
    Workspace workspace;
    NormalEquations equations;
    linearise(estimate, workspace, equations);
    root = well_conditioned_root(equations.hessian);
    if (root && std::all_of(data_->observed.groups.begin(), data_->observed.groups.end(), has_summary)) {
      return data_->summary_of_groups(estimate, std::move(*root), workspace.content_->lanes);
    }
  }
  const Index columns = data_->unknowns.size();
  RowSummary summary(columns, std::move(root));
  data_->visit_whitened(
      estimate, [&](const MatrixXd& rows) { summary.add_configuration(rows.leftCols(columns), rows.col(columns)); });
  summary.add_priors(MatrixXd(data_->priors.rows));
  WhitenedSummary result = summary.finish();
  for (const Data::Part& part : data_->parts) {
    const MatrixXd undetermined = motions_of_base(part.undetermined, estimate.frames.base(part.station),
                                                  data_->unknowns.base_columns(part.station), columns);
    if (undetermined.cols() > 0) {
      result.sqrt_information -= result.sqrt_information * undetermined * pseudo_inverse(undetermined);
    }
  }
  return result;
}

WhitenedSummary LeastSquaresProblem::Data::summary_of_groups(const Estimate& estimate, MatrixXd sqrt_information,
                                                             LaneWorkspace& workspace) const {
  WhitenedSummary summary;
  summary.sqrt_information = std::move(sqrt_information);
  summary.priors = prior_information;
  summary.sums = MatrixXd::Zero(unknowns.size(), unknowns.size());
  lanes.summarise(estimate, workspace, summary);
  summary.rows = summary.measured_rows + priors.rows.rows();
  return summary;
}

}  // namespace kdl_calibration
