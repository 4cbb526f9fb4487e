#include "selection/model_score.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <utility>

#include "base/counted_fits.hpp"
#include "base/parallel.hpp"
#include "base/text.hpp"
#include "effects/joint_effects.hpp"
#include "selection/table_certainty.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kMostSingleFolds = 40;
constexpr int kFolds = 10;
constexpr double kEvidenceToPrefer = 2.0;    // gain in log evidence
constexpr double kEvidenceToAddGroup = 7.0;  // larger, as the best of several gains by chance
constexpr double kFileRounding = 1e-9;       // [m] of the numbers in a file
constexpr double kLeastPrior = 1e-7;         // [m or rad]
constexpr double kEquations = 1.1;           // least number per column

// Columns with information in `sums`; those of targets that do not occur there are left out.
std::vector<Index> informed_columns(const Candidate& candidate, const LinearSums& sums, const LinearSums& all) {
  constexpr double kLeastShare = 1e-9;  // of the information of all rows
  std::vector<Index> columns;
  for (Index c = 0; c < sums.information.cols(); ++c) {
    const bool of_target = candidate.free.columns()[static_cast<std::size_t>(c)].group == UnknownGroup::targets;
    if (!of_target || sums.information(c, c) > kLeastShare * all.information(c, c)) {
      columns.push_back(c);
    }
  }
  return columns;
}

std::vector<Index> all_of(Index count) {
  std::vector<Index> columns(static_cast<std::size_t>(count));
  std::iota(columns.begin(), columns.end(), Index{0});
  return columns;
}

// The groups' names, with the length of tables.
std::string in_words(const CandidateModel& model) {
  double length = 0.0;
  for (const EffectTerm& term : model.terms) {
    if (const auto* const table = std::get_if<JointTable>(&term.function)) {
      length = std::max(length, table->length);
    }
  }
  const long degrees = std::lround(length * 180.0 / std::numbers::pi);
  return "trying " + (model.names.empty() ? "geometry alone" : comma_separated(model.names)) +
         (degrees > 0 ? " of " + std::to_string(degrees) + " degrees" : "") + (model.sized ? " with priors" : "");
}

// Mean decrease of a configuration's held-out squares, over its standard error.
double certainty_of_gain(const ModelScore& with, const ModelScore& without) {
  const VectorXd gain = without.squares - with.squares;
  const auto n = static_cast<double>(gain.size());
  const double mean = gain.mean();
  return mean / std::sqrt((gain.array() - mean).square().sum() / (n * (n - 1.0)));
}

}  // namespace

double size_of(const ModelScore& score, const std::string& name) {
  const auto found = std::find(score.groups.names.begin(), score.groups.names.end(), name);
  const auto number = static_cast<std::size_t>(found - score.groups.names.begin());
  return number < score.sizes.sizes.size() ? score.sizes.sizes[number] : 0.0;
}

double evidence_to_prefer(const ModelScore& than) { return than.sizes.evidence + kEvidenceToPrefer; }

double evidence_to_accept(const ModelScore& than) { return than.sizes.evidence + kEvidenceToAddGroup; }

bool is_likelier(const ModelScore& one, const ModelScore& other) {
  return one.sizes.evidence >= evidence_to_prefer(other);
}

bool predicts_as_well(const ModelScore& one, const ModelScore& other) { return certainty_of_gain(one, other) > -1.0; }

bool is_clearly_better(const ModelScore& one, const ModelScore& other) {
  return one.determined && one.held_out_rms <= kClearlyBetter * other.held_out_rms;
}

bool helps(const ModelScore& with, const ModelScore& without) {
  return is_clearly_better(with, without) && with.motion <= kLargestMotion && certainty_of_gain(with, without) > 1.0;
}

ModelScorer::ModelScorer(const ModelSelectionTask& task, const Measurements& means, int threads, bool reports_progress)
    : task_(task), means_(means), threads_(threads), reports_progress_(reports_progress) {
  const std::vector<std::vector<Index>> singly = make_folds(means_, 0);
  folds_ = singly.size() < kMostSingleFolds ? singly : make_folds(means_, kFolds);
  // No model can predict a target that occurs in one fold only.
  std::map<std::int32_t, std::pair<std::set<std::size_t>, std::size_t>> folds_and_points_of;
  for (std::size_t f = 0; f < folds_.size(); ++f) {
    for (const Observation& o : means_.observations) {
      if (std::find(folds_[f].begin(), folds_[f].end(), o.configuration) != folds_[f].end()) {
        auto& [folds, points] = folds_and_points_of[o.target];
        folds.insert(f);
        ++points;
      }
    }
  }
  for (const auto& [target, of_target] : folds_and_points_of) {
    const std::array<int, 6> columns = task_.free.target_columns(static_cast<std::size_t>(target));
    const bool is_known = std::all_of(columns.begin(), columns.end(), [](int column) { return column < 0; });
    (of_target.first.size() > 1 || is_known ? points_ : not_compared_) += static_cast<double>(of_target.second);
  }
}

ModelScore ModelScorer::score_of(const CandidateModel& model, TriedModels& tried, double wanted) const {
  const Candidate candidate = with_terms(task_.model, task_.free, model.terms, model.sized);
  ModelScore score;
  score.groups = groups_of(candidate, task_.options.priors);
  const LinearRows rows = linear_rows(candidate, means_, task_.optimum, task_.orientation_length);
  if (static_cast<double>(rows.y.size()) < kEquations * static_cast<double>(rows.columns())) {
    return score;
  }
  const std::function<void()> after_fold =
      reports_progress_ ? counted_fits(task_.progress, in_words(model), folds_.size()) : nullptr;
  Sums sums = sums_by_folds(rows);
  const std::vector<Index> columns = informed_columns(candidate, sums.all, sums.all);
  const double rounding = kFileRounding / rows.unit;
  if (const SizeEstimator whole(sums.all, columns, score.groups.columns); whole.is_determined()) {
    score.sizes = whole.estimate({}, score.groups.limits, rounding);
  } else {
    return score;
  }
  score.noise = score.sizes.sigma * rows.unit;
  score.motion = motion_of(candidate, rows, score.sizes.values);
  if (score.sizes.evidence >= wanted) {
    predict_folds(candidate, rows, std::move(sums), score, after_fold);
  }
  tried.add({.priors = priors_of(score, model.sized),
             .effects = model.names,
             .sized = model.sized,
             .held_out_rms = score.held_out_rms,
             .evidence = score.sizes.evidence},
            score.squares);
  return score;
}

Priors ModelScorer::priors_of(const ModelScore& score, bool sized) const {
  if (!sized || score.sizes.sizes.empty()) {
    return task_.options.priors;
  }
  return {.length = std::max(size_of(score, "length"), kLeastPrior),
          .angle = std::max(size_of(score, "angle"), kLeastPrior)};
}

double ModelScorer::motion_of(const Candidate& candidate, const LinearRows& rows, const VectorXd& values) const {
  if (candidate.model.effects.empty()) {
    return 0.0;
  }
  const ColumnRange effects = candidate.free.range(UnknownGroup::effects);
  MatrixXd moved = effective_joint_values(candidate.model, values.segment(effects.first, effects.count),
                                          means_.joint_values, rows.effects);
  moved.topRows(means_.joint_values.rows()) -= means_.joint_values;
  return moved.cwiseAbs().maxCoeff();
}

ModelScorer::Sums ModelScorer::sums_by_folds(const LinearRows& rows) const {
  const std::vector<std::vector<Index>> parts = folds_with_rest(folds_, means_);
  Sums sums{.all = {}, .folds = std::vector<LinearSums>(parts.size())};
  parallel_for(parts.size(), threads_, [&](std::size_t f) { sums.folds[f] = sums_of(rows, parts[f]); });
  sums.all = sums.folds.front();
  std::for_each(sums.folds.begin() + 1, sums.folds.end(), [&](const LinearSums& fold) { sums.all += fold; });
  return sums;
}

void ModelScorer::predict_folds(const Candidate& candidate, const LinearRows& rows, Sums sums, ModelScore& score,
                                const std::function<void()>& after_fold) const {
  const double rounding = kFileRounding / rows.unit;
  score.squares = VectorXd::Zero(rows.configurations());
  std::vector<int> predicted(folds_.size(), 0);
  parallel_for(folds_.size(), threads_, [&](std::size_t f) {
    LinearSums without = std::move(sums.folds[f]);
    without.subtract_from(sums.all);
    const std::vector<Index> columns = informed_columns(candidate, without, sums.all);
    std::vector<Index> uninformed = all_of(rows.columns());
    std::erase_if(uninformed, [&](Index c) { return std::binary_search(columns.begin(), columns.end(), c); });
    const SizeEstimator rest(without, columns, score.groups.columns);
    if (!rest.is_determined()) {
      return;
    }
    const GroupSizes sizes = rest.estimate(score.sizes, score.groups.limits, rounding);
    MatrixXd values = sizes.values.replicate(1, std::ssize(folds_[f]));  // one column for each configuration
    TableCertainty(candidate, score.groups, sizes).withhold(means_.joint_values(Eigen::all, folds_[f]), values);
    for (std::size_t i = 0; i < folds_[f].size(); ++i) {
      const Index c = folds_[f][i];
      const VectorXd x = values.col(static_cast<Index>(i));
      const auto [first, count] = rows.range(c);
      VectorXd error = rows.y.segment(first, count) - rows.product(c, x);
      for (const Index column : uninformed) {
        error = (rows.motions.col(rows.motion(column)).segment(first, count).array() != 0.0).select(0.0, error);
      }
      score.squares[c] = error.squaredNorm();
    }
    predicted[f] = 1;
    if (after_fold) {
      after_fold();
    }
  });
  score.squares *= rows.unit * rows.unit;
  score.determined = std::all_of(predicted.begin(), predicted.end(), [](int p) { return p == 1; });
  if (score.determined) {
    score.held_out_rms = std::sqrt(score.squares.sum() / points_);
  }
}

}  // namespace kdl_calibration
