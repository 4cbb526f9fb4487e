#include "planning/design_exchange.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>
#include <unordered_map>

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr Index kShortlist = 16;     // candidates evaluated exactly
constexpr double kLeastGain = 1e-9;  // least relative gain of an excursion

// Exchange search from a design.
class DesignExchange {
public:
  DesignExchange(const DesignProblem& problem, Index candidates, const SelectionOptions& options,
                 const std::vector<Index>& members)
      : problem_(problem), candidates_(candidates), options_(options) {
    design_.members = members;
    is_member_.assign(static_cast<std::size_t>(candidates), false);
    for (const Index i : members) {
      is_member_[static_cast<std::size_t>(i)] = true;
    }
    refresh();
  }

  // Makes excursions until none improves the design.
  ExchangedDesign improved() {
    for (int depth = 1; depth <= options_.depth;) {
      depth = excursion(depth, true) || excursion(depth, false) ? 1 : depth + 1;
    }
    return {.members = design_.members, .value = design_.value, .exchanges = exchanges_};
  }

  // A mean of high powers has many local minima; one of low powers differs from the maximum. So the power is raised
  // stepwise, and the design with the smallest maximum is kept.
  ExchangedDesign least_worst() {
    ExchangedDesign best{.members = design_.members, .value = problem_.tasks->worst(design_.C)};
    for (const double power : {8.0, 16.0, 32.0, 64.0, 128.0}) {
      power_ = power;
      refresh();
      improved();
      const double worst = problem_.tasks->worst(design_.C);
      if (worst < best.value) {
        best = {.members = design_.members, .value = worst};
      }
    }
    best.exchanges = exchanges_;
    return best;
  }

private:
  struct Design {
    std::vector<Index> members;
    MatrixXd C;
    double value = 0.0;
  };

  bool is_d() const { return options_.criterion == Criterion::d_optimal; }

  // Cached, because the same candidates are evaluated repeatedly.
  const MatrixXd& block(Index candidate) {
    const auto [found, is_new] = blocks_.try_emplace(candidate);
    if (is_new) {
      found->second = problem_.pool.block(candidate);
    }
    return found->second;
  }

  // Recomputes everything from the members, which removes accumulated rounding errors.
  void refresh() {
    MatrixXd M = problem_.given;
    for (const Index i : design_.members) {
      const MatrixXd& A = block(i);
      M.noalias() += A.transpose() * A;
    }
    const Eigen::LLT<MatrixXd> llt(M);
    design_.C = llt.solve(MatrixXd::Identity(M.rows(), M.cols()));
    switch (options_.criterion) {
      case Criterion::d_optimal:
        design_.value = -2.0 * llt.matrixLLT().diagonal().array().log().sum();
        break;
      case Criterion::i_optimal:
        weights_ = problem_.tasks->mean();
        design_.value = design_.C.cwiseProduct(weights_).sum();
        break;
      case Criterion::g_optimal:
        design_.value = problem_.tasks->power_mean(design_.C, power_, weights_);
        break;
    }
  }

  // One excursion of `depth` additions and as many removals; kept if it improves the design.
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

  // Decrease of the value by adding A (sign 1), or increase by removing it (sign -1). Empty if the design becomes
  // singular.
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

  // Updates C for M + sign A^T A.
  void update(const MatrixXd& A, double sign) {
    const MatrixXd A_C = A * design_.C;
    const Eigen::LLT<MatrixXd> llt(MatrixXd::Identity(A.rows(), A.rows()) + sign * A_C * A.transpose());
    const MatrixXd U = llt.matrixL().solve(A_C);
    design_.C.noalias() -= sign * U.transpose() * U;
  }

  // Updates the weights for G after every step.
  void renew_weights() {
    if (options_.criterion == Criterion::g_optimal) {
      problem_.tasks->power_mean(design_.C, power_, weights_);
    }
  }

  bool add_best() {
    renew_weights();
    Eigen::VectorXf score;
    if (is_d()) {
      score = problem_.pool.traces({design_.C}, candidates_, options_.threads).col(0);
    } else {
      const Eigen::MatrixXf both =
          problem_.pool.traces({design_.C * weights_ * design_.C, design_.C}, candidates_, options_.threads);
      const auto rows = static_cast<float>(problem_.pool.rows().points().S.rows());
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

  const DesignProblem& problem_;
  Index candidates_;
  const SelectionOptions& options_;
  Design design_;
  std::unordered_map<Index, MatrixXd> blocks_;
  std::vector<bool> is_member_;
  MatrixXd weights_;
  double power_ = 1.0;  // for G: power of the variances whose mean is minimised
  long exchanges_ = 0;
};

}  // namespace

ExchangedDesign exchanged_design(const DesignProblem& problem, Index candidates, const SelectionOptions& options,
                                 const std::vector<Index>& members) {
  DesignExchange exchange(problem, candidates, options, members);
  return options.criterion == Criterion::g_optimal ? exchange.least_worst() : exchange.improved();
}

}  // namespace kdl_calibration
