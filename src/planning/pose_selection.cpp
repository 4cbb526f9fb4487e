#include "planning/pose_selection.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>
#include <optional>
#include <utility>

#include "base/decompositions.hpp"
#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/preconditions.hpp"
#include "base/random.hpp"
#include "kdl_calibration/input_error.hpp"
#include "planning/candidate_pool.hpp"
#include "planning/design_exchange.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kPoolOfStarts = 5000;
constexpr double kRidge = 1e-6;  // relative to the average information; used while designs may be singular

// Union of the sets, ascending.
std::vector<Index> united(const std::vector<std::vector<Index>>& sets) {
  std::vector<Index> all;
  for (const std::vector<Index>& set : sets) {
    all.insert(all.end(), set.begin(), set.end());
  }
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

// `count` distinct random numbers below `below`, ascending.
std::vector<Index> drawn(Index below, int count, Random& random) {
  std::vector<Index> all(static_cast<std::size_t>(below));
  std::iota(all.begin(), all.end(), Index{0});
  for (std::size_t k = 0; k < static_cast<std::size_t>(count); ++k) {
    const auto rest = static_cast<double>(all.size() - k);
    std::swap(all[k], all[k + static_cast<std::size_t>(random.uniform() * rest)]);
  }
  all.resize(static_cast<std::size_t>(count));
  std::sort(all.begin(), all.end());
  return all;
}

// Least number of configurations that can determine the parameters together with `given`.
int least_count(const Experiment& experiment, const MatrixXd& given) {
  const VectorXd values = eigenvalues(given);
  const Index missing = (values.array() <= 1e-14 * values.maxCoeff()).count();
  const auto rows = 3 * static_cast<Index>(experiment.targets.size());
  return static_cast<int>((missing + rows - 1) / rows);
}

void require_possible(const Experiment& experiment, Index candidates, const MatrixXd& given,
                      const SelectionOptions& options) {
  if (options.count < 1 || options.starts < 1 || options.depth < 1) {
    throw InputError("the numbers of configurations, starts and the depth must be positive");
  }
  if (candidates < options.count) {
    throw InputError(
        fmt::format("{} candidates, expected at least the {} configurations to choose", candidates, options.count));
  }
  const Index p = columns(experiment);
  const int needed = least_count(experiment, given);
  if (options.count < needed) {
    throw InputError(fmt::format(
        "{} configurations of {} targets cannot determine {} parameters, expected at least {} configurations",
        options.count, experiment.targets.size(), p, needed));
  }
}

// The best of several starts on part of the candidates comes first.
std::vector<ExchangedDesign> search(const DesignProblem& problem, const SelectionOptions& options) {
  const Index candidates = std::min(problem.pool.size(), std::max<Index>(kPoolOfStarts, 4L * options.count));
  std::vector<ExchangedDesign> starts(static_cast<std::size_t>(options.starts));
  SelectionOptions alone = options;
  alone.threads = 1;
  std::mutex mutex;
  int done = 0;
  parallel_for(starts.size(), options.threads, [&](std::size_t s) {
    Random random(options.seed, s);
    starts[s] = exchanged_design(problem, candidates, alone, drawn(candidates, options.count, random));
    const std::lock_guard lock(mutex);
    ++done;
    if (options.progress) {
      options.progress(static_cast<double>(done) / (static_cast<double>(options.starts) + 1.0));
    }
  });
  std::stable_sort(starts.begin(), starts.end(),
                   [](const ExchangedDesign& a, const ExchangedDesign& b) { return a.value < b.value; });
  return starts;
}

}  // namespace

Selection select_configurations(const Experiment& experiment, const SelectionTask& task,
                                const SelectionOptions& options) {
  const MatrixXd& candidates = task.candidates;
  const MatrixXd& given = task.given;
  require_possible(experiment, candidates.cols(), given, options);
  const CandidatePool pool(experiment, candidates, given, options.threads);
  std::optional<Tasks> where;
  if (options.criterion != Criterion::d_optimal) {
    where.emplace(pool.rows(), task.tasks.size() > 0 ? task.tasks : candidates,
                  options.criterion == Criterion::g_optimal, options.threads);
  }
  DesignProblem problem{.pool = pool, .given = pool.rows().in_basis(given), .tasks = where ? &*where : nullptr};
  problem.given += kRidge * static_cast<double>(options.count) * pool.mean_information();

  // For G the starts maximise the determinant: with arbitrary weights a D-optimal design is also G-optimal (Kiefer and
  // Wolfowitz 1960), otherwise close to it.
  SelectionOptions search_options = options;
  if (options.criterion == Criterion::g_optimal) {
    search_options.criterion = Criterion::d_optimal;
  }
  const std::vector<ExchangedDesign> starts = search(problem, search_options);
  ExchangedDesign final = exchanged_design(problem, pool.size(), options, starts.front().members);

  Selection selection;
  selection.chosen = std::move(final.members);
  std::sort(selection.chosen.begin(), selection.chosen.end());
  selection.information = given + information(experiment, candidates(Eigen::all, selection.chosen));
  selection.exchanges = std::accumulate(starts.begin(), starts.end(), final.exchanges,
                                        [](long sum, const ExchangedDesign& start) { return sum + start.exchanges; });
  const MatrixXd M = pool.rows().in_basis(selection.information);
  const Eigen::LLT<MatrixXd> llt(M);
  const MatrixXd C = llt.solve(MatrixXd::Identity(M.rows(), M.cols()));
  selection.objective = options.criterion == Criterion::d_optimal
                            ? 2.0 * selection.information.llt().matrixLLT().diagonal().array().log().sum()
                        : options.criterion == Criterion::g_optimal ? where->worst(C)
                                                                    : C.cwiseProduct(where->mean()).sum();
  return selection;
}

double figure_of(const Prediction& prediction, Figure figure) {
  switch (figure) {
    case Figure::mean:
      return prediction.sigma.mean;
    case Figure::p95:
      return prediction.sigma.p95;
    case Figure::max:
      return prediction.sigma.max;
  }
  return prediction.sigma.max;
}

Selection select_for_accuracy(const Experiment& experiment, const SelectionTask& task, double accuracy, Figure figure,
                              const SelectionOptions& options) {
  double reached = std::numeric_limits<double>::infinity();
  const auto attempt = [&](int count) {
    SelectionOptions with_count = options;
    with_count.count = count;
    Selection selection = select_configurations(experiment, task, with_count);
    reached = figure_of(predicted(experiment, selection.information, task.tasks, options.threads), figure);
    return selection;
  };
  const int most = static_cast<int>(std::min<Index>(options.count, task.candidates.cols()));
  int too_few = std::max(1, least_count(experiment, task.given)) - 1;
  int enough = std::min(most, too_few + 1);
  Selection best = attempt(enough);
  while (!(reached <= accuracy)) {
    if (enough == most) {
      throw InputError(
          fmt::format("the accuracy cannot be reached: {} configurations promise {} mm, expected at most {} mm", most,
                      shortest(reached * 1e3), shortest(accuracy * 1e3)));
    }
    too_few = enough;
    enough = std::min(most, 2 * enough);
    best = attempt(enough);
  }
  while (enough - too_few > 1) {
    const int middle = too_few + (enough - too_few) / 2;
    Selection selection = attempt(middle);
    if (reached <= accuracy) {
      enough = middle;
      best = std::move(selection);
    } else {
      too_few = middle;
    }
  }
  return best;
}

std::vector<MatrixXd> random_designs(const Experiment& experiment, const SelectionTask& task,
                                     const RandomDesigns& designs) {
  const MatrixXd& candidates = task.candidates;
  require_at_least("candidates", candidates.cols(), designs.count);
  std::vector<std::vector<Index>> chosen(static_cast<std::size_t>(designs.draws));
  parallel_for(chosen.size(), designs.threads, [&](std::size_t d) {
    Random random(designs.seed, d);
    chosen[d] = drawn(candidates.cols(), designs.count, random);
  });
  const PointRows rows(experiment);
  std::vector<VectorXd> sums(chosen.size(), VectorXd::Zero(rows.feature_count()));
  // Most candidates occur in many designs, so each one's information is computed once, in batches.
  constexpr std::size_t kAtOnce = 256;
  const std::vector<Index> used = united(chosen);
  for (std::size_t first = 0; first < used.size(); first += kAtOnce) {
    const std::vector<Index> some(used.begin() + static_cast<std::ptrdiff_t>(first),
                                  used.begin() + static_cast<std::ptrdiff_t>(std::min(first + kAtOnce, used.size())));
    std::vector<Eigen::RowVectorXd> features(some.size(), Eigen::RowVectorXd(rows.feature_count()));
    parallel_for(some.size(), designs.threads, [&](std::size_t i) { rows.pack(candidates.col(some[i]), features[i]); });
    parallel_for(chosen.size(), designs.threads, [&](std::size_t d) {
      for (std::size_t i = 0; i < some.size(); ++i) {
        if (std::binary_search(chosen[d].begin(), chosen[d].end(), some[i])) {
          sums[d] += features[i].transpose();
        }
      }
    });
  }
  std::vector<MatrixXd> result;
  result.reserve(sums.size());
  for (const VectorXd& sum : sums) {
    result.emplace_back(task.given + rows.unpacked(sum, static_cast<double>(designs.count)));
  }
  return result;
}

double d_efficiency(const Experiment& experiment, const SelectionTask& task, const MatrixXd& design, int count,
                    int threads) {
  require_at_least("candidates", task.candidates.cols(), 1);
  constexpr int kRounds = 150;
  const CandidatePool pool(experiment, task.candidates, task.given, threads);
  const PointRows& rows = pool.rows();
  const Index weighted = std::min(pool.size(), kPoolOfStarts);
  const MatrixXd M0 = rows.in_basis(task.given);
  const auto N = static_cast<double>(count);
  VectorXd w = VectorXd::Constant(weighted, 1.0 / static_cast<double>(weighted));
  const auto information_of = [&](const VectorXd& weights) {
    const Eigen::VectorXf sum = pool.features().topRows(weighted).transpose() * weights.cast<float>();
    return MatrixXd(M0 + N * rows.unpacked(sum.cast<double>(), weights.sum()));
  };
  double bound = std::numeric_limits<double>::infinity();  // of log det M*
  for (int round = 0; round <= kRounds; ++round) {
    const Eigen::LLT<MatrixXd> llt(information_of(w));
    const MatrixXd C = llt.solve(MatrixXd::Identity(columns(experiment), columns(experiment)));
    const bool last = round == kRounds;
    const VectorXd d = pool.traces({C}, last ? pool.size() : weighted, threads).col(0).cast<double>();
    const double mean = w.dot(d.head(weighted));
    bound = std::min(bound, 2.0 * llt.matrixLLT().diagonal().array().log().sum() +
                                (last || weighted == pool.size() ? N * (d.maxCoeff() - mean)
                                                                 : std::numeric_limits<double>::infinity()));
    w = w.cwiseProduct(d.head(weighted)) / mean;
  }
  const Eigen::LLT<MatrixXd> llt(rows.in_basis(design));
  const double log_det = 2.0 * llt.matrixLLT().diagonal().array().log().sum();
  return std::exp((log_det - bound) / static_cast<double>(columns(experiment)));
}

}  // namespace kdl_calibration
