#include "kdl_calibration/pose_selection.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <mutex>
#include <numeric>
#include <optional>
#include <unordered_map>

#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/preconditions.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/random.hpp"
#include "planning/candidate_pool.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr Index kPoolOfStarts = 5000;
constexpr Index kShortlist = 16;     // candidates evaluated exactly
constexpr double kRidge = 1e-6;      // of the average information, while designs may still be singular
constexpr double kLeastGain = 1e-9;  // relative, of an excursion

// A design and its neighbours.
class Exchange {
public:
  Exchange(const CandidatePool& pool, Index candidates, const MatrixXd& given, const SelectionOptions& options,
           const Tasks* tasks)
      : pool_(pool),
        candidates_(candidates),
        given_(given),
        criterion_(options.criterion),
        depth_(options.depth),
        tasks_(tasks),
        threads_(options.threads),
        is_member_(static_cast<std::size_t>(candidates), false) {}

  void start(const std::vector<Index>& members) {
    design_.members = members;
    is_member_.assign(static_cast<std::size_t>(candidates_), false);
    for (const Index i : members) {
      is_member_[static_cast<std::size_t>(i)] = true;
    }
    refresh();
  }

  /// Excursions until none helps.
  void run() {
    for (int depth = 1; depth <= depth_;) {
      depth = excursion(depth, true) || excursion(depth, false) ? 1 : depth + 1;
    }
  }

  /// For G: the power of the variances whose mean is made small from here on.
  void set_power(double power) {
    power_ = power;
    refresh();
  }

  const std::vector<Index>& members() const { return design_.members; }
  const MatrixXd& covariance() const { return design_.C; }
  double value() const { return design_.value; }  ///< to be made small
  long exchanges() const { return exchanges_; }

private:
  struct Design {
    std::vector<Index> members;
    MatrixXd M;
    MatrixXd C;
    double log_det = 0.0;
    double value = 0.0;
  };

  bool is_d() const { return criterion_ == Criterion::d_optimal; }

  // The same candidates are looked at again and again.
  const MatrixXd& block(Index candidate) {
    const auto [found, is_new] = blocks_.try_emplace(candidate);
    if (is_new) {
      found->second = pool_.block(candidate);
    }
    return found->second;
  }

  // Everything anew from the members, which takes away what rounding has gathered.
  void refresh() {
    design_.M = given_;
    for (const Index i : design_.members) {
      const MatrixXd& A = block(i);
      design_.M.noalias() += A.transpose() * A;
    }
    const Eigen::LLT<MatrixXd> llt(design_.M);
    design_.C = llt.solve(MatrixXd::Identity(design_.M.rows(), design_.M.cols()));
    design_.log_det = 2.0 * llt.matrixLLT().diagonal().array().log().sum();
    switch (criterion_) {
      case Criterion::d_optimal:
        design_.value = -design_.log_det;
        break;
      case Criterion::i_optimal:
        weights_ = tasks_->mean();
        design_.value = design_.C.cwiseProduct(weights_).sum();
        break;
      case Criterion::g_optimal:
        design_.value = tasks_->power_mean(design_.C, power_, weights_);
        break;
    }
  }

  // One excursion of `depth` additions and as many removals; kept where it improves the design.
  bool excursion(int depth, bool additions_first) {
    const Design before = design_;
    const std::vector<bool> members_before = is_member_;
    if (depth >= static_cast<int>(before.members.size()) && !additions_first) {
      return false;
    }
    for (int step = 0; step < 2 * depth; ++step) {
      const bool adds = (step < depth) == additions_first;
      if (adds ? !add_best() : !remove_least()) {
        break;
      }
    }
    if (design_.members.size() == before.members.size()) {
      std::sort(design_.members.begin(), design_.members.end());
      if (design_.members != sorted(before.members)) {
        refresh();
        const double scale = is_d() ? 1.0 : std::abs(before.value);
        if (design_.value < before.value - kLeastGain * scale) {
          exchanges_ += exchanged(before.members);
          return true;
        }
      }
    }
    design_ = before;
    is_member_ = members_before;
    return false;
  }

  static std::vector<Index> sorted(std::vector<Index> members) {
    std::sort(members.begin(), members.end());
    return members;
  }

  long exchanged(const std::vector<Index>& before) const {
    return std::count_if(before.begin(), before.end(),
                         [&](Index i) { return !is_member_[static_cast<std::size_t>(i)]; });
  }

  // How much the value falls by adding A (sign 1), or rises by taking it away (sign -1). None where that leaves a
  // singular design.
  std::optional<double> change(const MatrixXd& A, double sign) const {
    const MatrixXd A_C = A * design_.C;
    const Eigen::LLT<MatrixXd> llt(MatrixXd::Identity(A.rows(), A.rows()) + sign * A_C * A.transpose());
    if (llt.info() != Eigen::Success || !(llt.matrixLLT().diagonal().minCoeff() > 1e-7)) {
      return std::nullopt;
    }
    if (is_d()) {
      return sign * 2.0 * llt.matrixLLT().diagonal().array().log().sum();
    }
    return llt.solve(A_C * weights_ * A_C.transpose()).trace();
  }

  // C after M + sign A^T A, and its determinant.
  void update(const MatrixXd& A, double sign) {
    const MatrixXd A_C = A * design_.C;
    const Eigen::LLT<MatrixXd> llt(MatrixXd::Identity(A.rows(), A.rows()) + sign * A_C * A.transpose());
    const MatrixXd U = llt.matrixL().solve(A_C);
    design_.C.noalias() -= sign * U.transpose() * U;
    design_.log_det += 2.0 * llt.matrixLLT().diagonal().array().log().sum();
  }

  // G's weights follow the design at every step.
  void renew_weights() {
    if (criterion_ == Criterion::g_optimal) {
      tasks_->power_mean(design_.C, power_, weights_);
    }
  }

  bool add_best() {
    renew_weights();
    Eigen::VectorXf score;
    if (is_d()) {
      score = pool_.traces({design_.C}, candidates_, threads_).col(0);
    } else {
      const Eigen::MatrixXf both = pool_.traces({design_.C * weights_ * design_.C, design_.C}, candidates_, threads_);
      const auto rows = static_cast<float>(pool_.rows().points().S.rows());
      score = both.col(0).array() / (1.0F + both.col(1).array() / rows);
    }
    std::optional<double> most;
    Index best = -1;
    for (const Index i : shortlist(score)) {
      const std::optional<double> gain = change(block(i), 1.0);
      if (gain && (!most || *gain > *most)) {
        most = gain;
        best = i;
      }
    }
    if (best < 0) {
      return false;
    }
    update(block(best), 1.0);
    design_.members.push_back(best);
    is_member_[static_cast<std::size_t>(best)] = true;
    return true;
  }

  std::vector<Index> shortlist(const Eigen::VectorXf& score) const {
    std::vector<Index> order;
    order.reserve(static_cast<std::size_t>(candidates_));
    for (Index i = 0; i < candidates_; ++i) {
      if (!is_member_[static_cast<std::size_t>(i)]) {
        order.push_back(i);
      }
    }
    const auto count = std::min<std::ptrdiff_t>(kShortlist, static_cast<std::ptrdiff_t>(order.size()));
    const auto better = [&](Index a, Index b) { return score[a] != score[b] ? score[a] > score[b] : a < b; };
    std::nth_element(order.begin(), order.begin() + count, order.end(), better);
    order.resize(static_cast<std::size_t>(count));
    std::sort(order.begin(), order.end());
    return order;
  }

  bool remove_least() {
    renew_weights();
    std::optional<double> least;
    std::size_t worst = 0;
    for (std::size_t k = 0; k < design_.members.size(); ++k) {
      const std::optional<double> loss = change(block(design_.members[k]), -1.0);
      if (loss && (!least || *loss < *least)) {
        least = loss;
        worst = k;
      }
    }
    if (!least) {
      return false;
    }
    const Index i = design_.members[worst];
    update(block(i), -1.0);
    design_.members.erase(design_.members.begin() + static_cast<std::ptrdiff_t>(worst));
    is_member_[static_cast<std::size_t>(i)] = false;
    return true;
  }

  const CandidatePool& pool_;
  Index candidates_;
  const MatrixXd& given_;
  Criterion criterion_;
  int depth_;
  const Tasks* tasks_;
  int threads_;
  Design design_;
  std::unordered_map<Index, MatrixXd> blocks_;
  std::vector<bool> is_member_;
  MatrixXd weights_;
  double power_ = 1.0;
  long exchanges_ = 0;
};

// Every number of any of them once, ascending.
std::vector<Index> united(const std::vector<std::vector<Index>>& sets) {
  std::vector<Index> all;
  for (const std::vector<Index>& set : sets) {
    all.insert(all.end(), set.begin(), set.end());
  }
  std::sort(all.begin(), all.end());
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

// `count` different numbers below `below`, ascending.
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

void require_information(const Experiment& experiment, const MatrixXd& information) {
  require_count("rows of the information", information.rows(), columns(experiment));
  require_count("columns of the information", information.cols(), columns(experiment));
}

// The least number of configurations that can determine what `given` does not.
int least_count(const Experiment& experiment, const MatrixXd& given) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> eigen(given, Eigen::EigenvaluesOnly);
  const Index missing = (eigen.eigenvalues().array() <= 1e-14 * eigen.eigenvalues().maxCoeff()).count();
  const auto rows = 3 * static_cast<Index>(experiment.targets.size());
  return static_cast<int>((missing + rows - 1) / rows);
}

void require_possible(const Experiment& experiment, Index candidates, const MatrixXd& given,
                      const SelectionOptions& options) {
  if (options.count < 1 || options.starts < 1 || options.depth < 1) {
    throw InputError("the numbers of configurations, starts and the depth must be positive");
  }
  if (candidates < options.count) {
    throw InputError(std::to_string(candidates) + " candidates, expected at least the " +
                     std::to_string(options.count) + " configurations to choose");
  }
  require_information(experiment, given);
  const Index p = columns(experiment);
  const int needed = least_count(experiment, given);
  if (options.count < needed) {
    throw InputError(std::to_string(options.count) + " configurations of " + std::to_string(experiment.targets.size()) +
                     " targets cannot determine " + std::to_string(p) + " parameters, expected at least " +
                     std::to_string(needed) + " configurations");
  }
}

// The best of several starts on part of the candidates.
struct Start {
  std::vector<Index> members;
  double value = 0.0;
  long exchanges = 0;
};

std::vector<Start> search(const CandidatePool& pool, const MatrixXd& given, const SelectionOptions& options,
                          const Tasks* tasks) {
  const Index candidates = std::min(pool.size(), std::max<Index>(kPoolOfStarts, 4L * options.count));
  std::vector<Start> starts(static_cast<std::size_t>(options.starts));
  SelectionOptions alone = options;
  alone.threads = 1;
  std::mutex mutex;
  int done = 0;
  parallel_for(starts.size(), options.threads, [&](std::size_t s) {
    Random random(options.seed, s);
    Exchange exchange(pool, candidates, given, alone, tasks);
    exchange.start(drawn(candidates, options.count, random));
    exchange.run();
    starts[s] = {.members = exchange.members(), .value = exchange.value(), .exchanges = exchange.exchanges()};
    const std::lock_guard lock(mutex);
    ++done;
    if (options.progress) {
      options.progress(static_cast<double>(done) / (static_cast<double>(options.starts) + 1.0));
    }
  });
  std::stable_sort(starts.begin(), starts.end(), [](const Start& a, const Start& b) { return a.value < b.value; });
  return starts;
}

std::vector<Index> run_once(Exchange& exchange) {
  exchange.run();
  return exchange.members();
}

// A mean of high powers has many local minima, one of low powers is not the largest variance: raised step by step, and
// the design with the smallest of the largest variances kept.
std::vector<Index> least_worst(Exchange& exchange, const Tasks& tasks) {
  std::vector<Index> best = exchange.members();
  double least = tasks.worst(exchange.covariance());
  for (const double power : {8.0, 16.0, 32.0, 64.0, 128.0}) {
    exchange.set_power(power);
    exchange.run();
    const double worst = tasks.worst(exchange.covariance());
    if (worst < least) {
      least = worst;
      best = exchange.members();
    }
  }
  return best;
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
  const Tasks* tasks_in_basis = where ? &*where : nullptr;
  MatrixXd base = pool.rows().in_basis(given);
  base += kRidge * static_cast<double>(options.count) * pool.mean_information();

  // For G the starts look for the best determinant, whose design is G-optimal as well if its weights may be any
  // (Kiefer and Wolfowitz 1960), and close to it otherwise.
  SelectionOptions search_options = options;
  if (options.criterion == Criterion::g_optimal) {
    search_options.criterion = Criterion::d_optimal;
  }
  const std::vector<Start> starts = search(pool, base, search_options, tasks_in_basis);
  Exchange final(pool, pool.size(), base, options, tasks_in_basis);
  final.start(starts.front().members);

  Selection selection;
  selection.chosen = options.criterion == Criterion::g_optimal ? least_worst(final, *where) : run_once(final);
  std::sort(selection.chosen.begin(), selection.chosen.end());
  selection.information = given + information(experiment, candidates(Eigen::all, selection.chosen));
  selection.exchanges = std::accumulate(starts.begin(), starts.end(), final.exchanges(),
                                        [](long sum, const Start& start) { return sum + start.exchanges; });
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
  require_information(experiment, task.given);
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
      throw InputError("the accuracy cannot be reached: " + std::to_string(most) + " configurations promise " +
                       shortest(reached * 1e3) + " mm, expected at most " + shortest(accuracy * 1e3) + " mm");
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
  require_information(experiment, task.given);
  require_at_least("draws", designs.draws, 0);
  require_at_least("configurations of a design", designs.count, 0);
  require_at_least("candidates", candidates.cols(), designs.count);
  std::vector<std::vector<Index>> chosen(static_cast<std::size_t>(designs.draws));
  parallel_for(chosen.size(), designs.threads, [&](std::size_t d) {
    Random random(designs.seed, d);
    chosen[d] = drawn(candidates.cols(), designs.count, random);
  });
  const PointRows rows(experiment);
  std::vector<VectorXd> sums(chosen.size(), VectorXd::Zero(rows.feature_count()));
  // Most candidates are in many designs: what each tells is found once, for so many at a time.
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
  require_information(experiment, task.given);
  require_information(experiment, design);
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
