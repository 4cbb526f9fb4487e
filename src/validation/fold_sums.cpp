#include "validation/fold_sums.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "base/parallel.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/residual_options.hpp"
#include "estimation/scaled_solver.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kMostSteps = 10;
constexpr double kSettledOfNoise = 1e-3;  // of the noise
constexpr double kExactSum = 1e-11;       // [m]

// Measurements and normal equations of each fold, and of the configurations in none, at one estimate.
class ConfigurationSums {
public:
  ConfigurationSums(const FitProblem& problem, const std::vector<std::vector<Index>>& folds, int threads)
      : problem_(problem),
        priors_(prior_rows(problem.free, problem.options.joint.residuals)),
        measurements_(folds.size()),
        at_start_(folds.size()) {
    std::vector<std::size_t> fold_of(static_cast<std::size_t>(problem.measurements.joint_values.cols()), folds.size());
    for (std::size_t f = 0; f < folds.size(); ++f) {
      for (const Index c : folds[f]) {
        fold_of[static_cast<std::size_t>(c)] = f;
      }
    }
    ResidualOptions residuals = problem.options.joint.residuals;
    residuals.priors = {};
    residuals.earlier = nullptr;
    std::vector<std::unique_ptr<LeastSquaresProblem>> parts(folds.size());
    parallel_for(folds.size(), threads, [&](std::size_t f) {
      measurements_[f] = subset(problem.measurements, [&](const Observation& o) {
        return fold_of[static_cast<std::size_t>(o.configuration)] == f;
      });
      parts[f] = std::make_unique<LeastSquaresProblem>(problem.model, measurements_[f], problem.free, residuals);
      at_start_[f] = parts[f]->linearise(problem.start);
    });
    parts_ = std::move(parts);
  }

  const Measurements& measurements(std::size_t fold) const { return measurements_[fold]; }

  // Sum over all parts but one, plus the priors.
  NormalEquations without(std::size_t fold, const Estimate& estimate, bool at_start) const {
    const Index columns = problem_.free.size();
    NormalEquations sum{.hessian = MatrixXd::Zero(columns, columns), .gradient = VectorXd::Zero(columns)};
    for (std::size_t f = 0; f < parts_.size(); ++f) {
      if (f != fold) {
        const NormalEquations at_estimate = at_start ? NormalEquations{} : parts_[f]->linearise(estimate);
        const NormalEquations& part = at_start ? at_start_[f] : at_estimate;
        sum.hessian += part.hessian;
        sum.gradient += part.gradient;
      }
    }
    sum.hessian += priors_.information();
    sum.gradient += priors_.rows.transpose() * priors_.residuals(problem_.free.values(estimate));
    return sum;
  }

  double weight_without(std::size_t fold) const {
    double sum = 0.0;
    for (std::size_t f = 0; f < parts_.size(); ++f) {
      sum += f != fold ? parts_[f]->total_weight() : 0.0;
    }
    return sum;
  }

private:
  const FitProblem& problem_;
  PriorRows priors_;
  std::vector<Measurements> measurements_;
  std::vector<NormalEquations> at_start_;
  std::vector<std::unique_ptr<LeastSquaresProblem>> parts_;
};

}  // namespace

HoldOut cross_validate_by_sums(const FitProblem& problem, const std::vector<std::vector<Index>>& folds, double noise,
                               int threads) {
  const TrainingProblem training(problem);
  const ConfigurationSums sums(*training, folds_with_rest(folds, (*training).measurements), threads);
  const double settled = std::max(kSettledOfNoise * noise, kExactSum);
  std::vector<std::vector<double>> distances(folds.size());
  std::vector<int> moving(folds.size(), 1);
  parallel_for(folds.size(), threads, [&](std::size_t f) {
    Estimate estimate = problem.start;
    ScaledSolver solver;
    for (int step = 0; step < kMostSteps && moving[f] != 0; ++step) {
      const NormalEquations equations = sums.without(f, estimate, step == 0);
      solver.solve(equations.hessian, {}, equations.gradient);
      const VectorXd& move = solver.solution();
      const double effect = std::sqrt(move.dot(equations.hessian * move) / sums.weight_without(f));
      if (!std::isfinite(effect)) {
        break;
      }
      estimate = problem.free.moved(estimate, move);
      moving[f] = effect > settled ? 1 : 0;
    }
    distances[f] = position_errors(problem.model, estimate, averaged(sums.measurements(f)));
    if (problem.options.after_fit) {
      problem.options.after_fit();
    }
  });
  HoldOut result{.distances = {}, .refits = static_cast<int>(folds.size())};
  for (std::size_t f = 0; f < folds.size(); ++f) {
    result.distances.insert(result.distances.end(), distances[f].begin(), distances[f].end());
    result.not_converged += moving[f];
  }
  return result;
}

}  // namespace kdl_calibration
