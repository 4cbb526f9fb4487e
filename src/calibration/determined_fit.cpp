#include "calibration/determined_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/decompositions.hpp"
#include "estimation/descent.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "two_step/two_step.hpp"

namespace kdl_calibration {
namespace {

struct Fitted {
  Identification identification;
  RobustRows robust;
};

FitProblem with_free(FitProblem problem, const Unknowns& free) {
  problem.free = free;
  return problem;
}

LeastSquaresProblem equations_of(const FitProblem& problem) {
  return {problem.model, problem.measurements, problem.free, problem.options.joint.residuals};
}

Fitted identify(const FitProblem& problem, const EstimatorOptions& estimator, Steps steps) {
  if (estimator.method == Method::two_step) {
    const TwoStepOptions two_step{.rounds = estimator.iterations > 0 ? estimator.iterations : kTwoStepRounds};
    return {identify_in_two_steps(
                problem.model, [&](int) { return problem.measurements; }, problem.start, problem.free.geometric(),
                two_step),
            {}};
  }
  const JointOptions& joint = problem.options.joint;
  if (problem.options.loss != Loss::none) {
    RobustIdentification robust = identify_robustly(problem);
    return {std::move(robust.fit), {.weights = std::move(robust.weights), .scale = robust.scale}};
  }
  const LeastSquaresProblem equations = equations_of(problem);
  if (steps == Steps::any || equations.equations() < equations.columns()) {
    return {identify_jointly(problem.model, problem.measurements, problem.start, problem.free, joint), {}};
  }
  return {descend(equations, problem.start, joint, steps), {}};
}

// Selects columns that raise the rank, those in `kept` first, then the others in the order of choice. A further column
// must also be clearly independent of the kept ones. Those in `last` come last.
Unknowns determined(const Unknowns& candidates, const Unknowns& kept, const Eigen::MatrixXd& sqrt_information,
                    const std::vector<Eigen::Index>& last) {
  std::vector<Eigen::Index> order = candidates.order_of_choice();
  std::stable_partition(order.begin(), order.end(),
                        [&](Eigen::Index c) { return std::find(last.begin(), last.end(), c) == last.end(); });
  const auto others = std::stable_partition(order.begin(), order.end(), [&](Eigen::Index c) {
    const Unknown& unknown = candidates.columns()[static_cast<std::size_t>(c)];
    return kept.column(unknown.group, unknown.index).has_value();
  });
  const auto known = static_cast<std::size_t>(others - order.begin());
  const Eigen::MatrixXd columns =
      sqrt_information(Eigen::all, order) / std::max(sqrt_information.cwiseAbs().maxCoeff(), 1e-300);
  const std::vector<bool> raises =
      independent_columns(columns, std::vector<bool>(order.size(), true), {.clear = IdentifiabilityOptions{}.weak});
  const Eigen::MatrixXd beside = outside_span(columns.leftCols(static_cast<Eigen::Index>(known)), columns);
  const auto is_weak = [&](Eigen::Index c) {
    return beside.col(c).norm() < IdentifiabilityOptions{}.weak * columns.col(c).norm();
  };
  std::vector<bool> marked(order.size(), false);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool worth_while = i < known || known == 0 || !is_weak(static_cast<Eigen::Index>(i));
    marked[static_cast<std::size_t>(order[i])] = raises[i] && worth_while;
  }
  return candidates.subset(marked);
}

// Columns to hold of the bases whose rows do not determine all of their motions: those that come last in a QR with
// pivots of the base's columns.
std::vector<Eigen::Index> undetermined_columns_of_bases(const Unknowns& candidates, std::size_t stations,
                                                        const Eigen::MatrixXd& sqrt_information) {
  constexpr double kDependent = 1e-7;           // of the largest pivot
  constexpr double kRotationsAfterwards = 0.5;  // rather a rotation is held than a translation
  std::vector<Eigen::Index> result;
  for (std::size_t station = 0; station < stations; ++station) {
    const std::array<int, 6>& columns = candidates.base_columns(station);
    if (std::any_of(columns.begin(), columns.end(), [](int column) { return column < 0; })) {
      continue;
    }
    Eigen::MatrixXd own = sqrt_information(Eigen::all, columns);
    own.leftCols(3) /= std::max(own.leftCols(3).colwise().norm().maxCoeff(), 1e-300);
    own.rightCols(3) *= kRotationsAfterwards / std::max(own.rightCols(3).colwise().norm().maxCoeff(), 1e-300);
    for (const Eigen::Index column : dependent_columns(own, kDependent)) {
      result.push_back(columns[static_cast<std::size_t>(column)]);
    }
  }
  return result;
}

constexpr int kGaugeRounds = 3;

struct FittedInGauge {
  Fitted fitted;
  Unknowns free;
};

// Fits the candidates that the measurements determine at the start. If the determined set differs at the solution, the
// fit is repeated with that set, without adding weakly determined columns.
FittedInGauge identify_in_gauge(const FitProblem& problem, const EstimatorOptions& estimator, Steps steps) {
  const Unknowns& candidates = problem.free;
  const LeastSquaresProblem equations = equations_of(problem);
  if (estimator.method == Method::two_step) {
    return {.fitted = identify(problem, estimator, steps), .free = candidates};
  }
  if (equations.equations() < equations.columns()) {
    const FitProblem fewer = with_determined_unknowns(problem);
    if (equations.equations() < fewer.free.size()) {
      return {.fitted = identify(fewer, estimator, steps), .free = fewer.free};
    }
  }
  Unknowns free = candidates;
  const auto determined_at = [&](const Estimate& estimate, const Unknowns& kept) {
    if (!problem.model.has_undetermined_bases && well_conditioned_root(equations.linearise(estimate).hessian)) {
      return candidates;
    }
    const Eigen::MatrixXd sqrt_information = equations.whitened_summary(estimate).sqrt_information;
    return sqrt_information.allFinite()
               ? determined(candidates, kept, sqrt_information,
                            undetermined_columns_of_bases(candidates, problem.model.stations.size(), sqrt_information))
               : free;
  };
  free = determined_at(problem.start, Unknowns());
  Fitted fitted;
  for (int round = 0; round < kGaugeRounds; ++round) {
    const Identification earlier = std::move(fitted.identification);
    fitted = identify(with_free(problem, free), estimator, steps);
    prepend_history(earlier, fitted.identification);
    const Unknowns there = determined_at(fitted.identification.estimate, free);
    if (there == free || round + 1 == kGaugeRounds) {
      break;
    }
    free = there;
  }
  return {.fitted = std::move(fitted), .free = std::move(free)};
}

// The named parameters and the effects of the problem.
Unknowns parameters_of(const FitProblem& problem, const std::vector<std::string>& names) {
  return Unknowns(problem.model, problem.start.frames.targets, names)
      .with(problem.model, UnknownGroup::effects, problem.free.effects());
}

DeterminedFit assembled(FittedInGauge found, Reduction reduction, Unknowns candidates) {
  return {.identification = std::move(found.fitted.identification),
          .robust = std::move(found.fitted.robust),
          .reduction = std::move(reduction),
          .candidates = std::move(candidates),
          .free = std::move(found.free)};
}

constexpr double kEqualMisfits = 1e-10;  // [m] smaller misfits differ only by rounding

// Whether the complete set would explain most of a misfit that is more than rounding.
bool has_more_to_explain(const FitProblem& complete, const Identification& found) {
  constexpr double kMost = 0.5;  // of the cost
  constexpr long kFreedom = 20;  // least surplus of equations over unknowns
  constexpr Eigen::Index kMany = 20000;
  const LeastSquaresProblem problem = equations_of(complete);
  if (found.rms < kEqualMisfits || problem.equations() < problem.columns() + kFreedom ||
      complete.measurements.joint_values.cols() > kMany) {
    return false;
  }
  return predicted_share(problem, found.estimate) > kMost;
}

constexpr double kBeyondGeometry = 0.005;  // [m] geometric errors do not leave a larger misfit

// Fits the complete set from the start, then the set that the measurements determine at its end.
DeterminedFit continue_in_complete_model(const FitProblem& complete, const FitRules& rules) {
  const Identification wide = descend(equations_of(complete), complete.start, complete.options.joint, Steps::prior);
  ParameterSelection choice = select_parameters(complete.model, wide.estimate.frames.targets, rules.parameters,
                                                {.errors = wide.estimate.errors});
  FitProblem from_there = with_free(complete, parameters_of(complete, choice.free));
  from_there.start = wide.estimate;
  const auto is_better = [&](const Identification& fit) {
    return has_converged(fit) && fit.rms <= std::max(wide.rms, kEqualMisfits);
  };
  FittedInGauge fitted = identify_in_gauge(from_there, rules.estimator, Steps::plain);
  if (!is_better(fitted.fitted.identification) && wide.termination == Termination::converged &&
      fitted.free == from_there.free) {
    // Directions that are determined, but weakly, make plain steps too long.
    Identification plain = std::move(fitted.fitted.identification);
    fitted = identify_in_gauge(from_there, rules.estimator, Steps::any);
    prepend_history(plain, fitted.fitted.identification);
  }
  DeterminedFit result = assembled(std::move(fitted), std::move(choice.reduction), from_there.free);
  const Identification narrow = std::exchange(result.identification, wide);
  if (is_better(narrow)) {
    result.identification = narrow;
  } else if (wide.termination == Termination::converged) {
    const bool explained = wide.rms < kBeyondGeometry;
    result.identification.termination = explained ? Termination::rank_deficient : Termination::stalled;
    result.identification.message =
        explained
            ? "converged, but the measurements do not determine all parameters: what they leave open was kept near "
              "nominal"
            : "no arm near the nominal one explains the measurements";
  }
  result.identification.iterations = wide.iterations + narrow.iterations;
  std::vector<double>& history = result.identification.rms_history;
  history = wide.rms_history;
  history.insert(history.end(), narrow.rms_history.begin(), narrow.rms_history.end());
  return result;
}

// The fit that converged, or the one with the smaller misfit. Iterations of `before` count for `next`.
DeterminedFit better_of(DeterminedFit before, DeterminedFit next) {
  prepend_history(before.identification, next.identification);
  const Identification& now = next.identification;
  const bool same = has_converged(now) == has_converged(before.identification);
  return (same ? now.rms < before.identification.rms : has_converged(now)) ? std::move(next) : std::move(before);
}

// Fits through the complete set or, if that does not converge, the first set with all kinds of steps.
DeterminedFit fit_via_complete_model(const FitProblem& problem, const FitProblem& complete, const FitRules& rules,
                                     const DeterminedFit& first) {
  DeterminedFit result = better_of(first, continue_in_complete_model(complete, rules));
  if (!has_converged(result.identification)) {
    result = better_of(std::move(result), assembled(identify_in_gauge(problem, rules.estimator, Steps::any),
                                                    first.reduction, first.candidates));
  }
  return result;
}

// Fixes parameters hidden by the noise, unless that raises the misfit by more than 5 %.
DeterminedFit fix_parameters_below_noise(const FitProblem& problem, const FitRules& rules, DeterminedFit fit) {
  constexpr double kCost = 1.05;
  ParameterSelection choice = select_parameters(problem.model, problem.start.frames.targets, rules.parameters,
                                                {.noise = fit.identification.rms / std::sqrt(3.0)});
  const FitProblem seen = with_free(problem, parameters_of(problem, choice.free));
  if (seen.free == fit.candidates) {
    return fit;
  }
  DeterminedFit result =
      assembled(identify_in_gauge(seen, rules.estimator, Steps::any), std::move(choice.reduction), seen.free);
  if (!has_converged(result.identification) || result.identification.rms > kCost * fit.identification.rms) {
    return fit;
  }
  prepend_history(fit.identification, result.identification);
  return result;
}

}  // namespace

FitProblem with_determined_unknowns(const FitProblem& problem) {
  if (!problem.model.has_undetermined_bases) {
    return problem;
  }
  const Eigen::MatrixXd sqrt_information = equations_of(problem).whitened_summary(problem.start).sqrt_information;
  std::vector<bool> marked(problem.free.columns().size(), true);
  if (sqrt_information.allFinite()) {
    for (const Eigen::Index column :
         undetermined_columns_of_bases(problem.free, problem.model.stations.size(), sqrt_information)) {
      marked[static_cast<std::size_t>(column)] = false;
    }
  }
  return with_free(problem, problem.free.subset(marked));
}

DeterminedFit fit_determined_parameters(const FitProblem& problem, const ParameterSelection& choice,
                                        const FitRules& rules) {
  const auto& [estimator, parameters] = rules;
  const bool chosen = estimator.method == Method::joint && parameters.model == ModelChoice::irreducible;
  // Parameters equivalent to fixed ones must not be estimated, and the user's iteration limit must hold.
  const bool as_asked = parameters.fix.empty() && estimator.iterations == 0;
  const bool may_go_on = chosen && problem.options.loss == Loss::none && as_asked;
  DeterminedFit result = assembled(identify_in_gauge(problem, estimator, may_go_on ? Steps::plain : Steps::any),
                                   choice.reduction, problem.free);
  if (may_go_on) {
    const FitProblem complete = with_free(problem, parameters_of(problem, choice.complete));
    if (!has_converged(result.identification) || has_more_to_explain(complete, result.identification)) {
      result = fit_via_complete_model(problem, complete, rules, result);
    }
  }
  if (chosen && has_converged(result.identification) && !result.reduction.replaceable.empty()) {
    result = fix_parameters_below_noise(problem, rules, std::move(result));
  }
  return result;
}

bool determines_arm(const DeterminedFit& fit) {
  return without_stations(fit.free.names()) == without_stations(fit.candidates.names());
}

}  // namespace kdl_calibration
