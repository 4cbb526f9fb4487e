#include "calibration/whole_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "kdl_calibration/descent.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/reduction.hpp"

namespace kdl_calibration {
namespace {

constexpr int kTwoStepRounds = 1000;

void require_two_step_data(const FreeParameters& free, const Measurements& measurements,
                           const CalibrationOptions& options) {
  const bool free_base = std::all_of(free.base.begin(), free.base.end(), [](bool f) { return f; });
  const bool free_targets = std::all_of(free.targets.begin(), free.targets.end(),
                                        [](const auto& target) { return target[0] && target[1] && target[2]; });
  if (!free_base || !free_targets) {
    throw InputError("--method two-step: base and targets are part of the procedure and cannot be known or fixed");
  }
  if (!measurements.orientations.empty()) {
    throw InputError(measurements.source +
                     ": --method two-step fits points; measured orientations need --method joint");
  }
  const bool priors = options.automatic_priors || options.priors.length > 0.0 || options.priors.angle > 0.0;
  const bool deflections = options.gravity != Use::no || options.joint_gain != Use::no;
  if (priors || deflections || options.loss != Loss::none || options.noise_from_repeats) {
    throw InputError("--method two-step: the published procedure has no priors, deflections, losses or noise model");
  }
}

struct Fitted {
  Identification identification;
  std::vector<double> weights;
};

Fitted identify(const FitTask& task, const FreeParameters& free, Steps steps) {
  const CalibrationOptions& options = task.options;
  if (options.method == Method::two_step) {
    require_two_step_data(free, task.measurements, options);
    const TwoStepOptions two_step{.rounds = options.iterations > 0 ? options.iterations : kTwoStepRounds};
    return {identify_in_two_steps(
                task.model, [&](int) { return task.measurements; }, task.start, free.geometric, two_step),
            {}};
  }
  const JointOptions& joint = task.fit_options.joint;
  if (task.fit_options.loss != Loss::none) {
    RobustIdentification robust =
        identify_robustly(task.model, task.measurements, task.start, free, task.fit_options.loss, joint);
    return {std::move(robust.fit), std::move(robust.weights)};
  }
  const LeastSquaresProblem problem(task.model, task.measurements, free, joint.residuals);
  if (steps == Steps::any || problem.equations() < problem.columns()) {
    return {identify_jointly(task.model, task.measurements, task.start, free, joint), {}};
  }
  return {descend(task.model, problem, free, task.start, joint, steps), {}};
}

// Of the columns those that raise the rank: those of `kept`, then the others in the order of the reduction: base,
// targets, geometric errors, then deflections. Where something is kept, what is weak beside it is no reason to add it.
FreeParameters determined(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                          const FreeParameters& candidates, const FreeParameters& kept,
                          const Eigen::MatrixXd& triangle) {
  const std::vector<std::string> names = column_names(model, targets, candidates);
  const std::vector<std::string> first = column_names(model, targets, kept);
  const auto base = static_cast<Eigen::Index>(std::count(candidates.base.begin(), candidates.base.end(), true));
  const Eigen::Index chain =
      base + static_cast<Eigen::Index>(candidates.geometric.size() + candidates.deflections.size());
  std::vector<Eigen::Index> order;
  const auto add = [&](Eigen::Index begin, Eigen::Index end) {
    for (Eigen::Index c = begin; c < end; ++c) {
      order.push_back(c);
    }
  };
  add(0, base);
  add(chain, triangle.cols());
  add(base, chain);
  const auto others = std::stable_partition(order.begin(), order.end(), [&](Eigen::Index c) {
    return std::find(first.begin(), first.end(), names[static_cast<std::size_t>(c)]) != first.end();
  });
  const auto known = static_cast<std::size_t>(others - order.begin());
  const Eigen::MatrixXd columns = triangle(Eigen::all, order) / std::max(triangle.cwiseAbs().maxCoeff(), 1e-300);
  const std::vector<bool> raises =
      independent_columns(columns, std::vector<bool>(order.size(), true), {.clear = IdentifiabilityOptions{}.weak});
  const Eigen::HouseholderQR<Eigen::MatrixXd> basis(columns.leftCols(static_cast<Eigen::Index>(known)));
  const auto is_weak = [&](Eigen::Index c) {
    const Eigen::VectorXd turned = basis.householderQ().transpose() * columns.col(c);
    return turned.tail(turned.size() - static_cast<Eigen::Index>(known)).norm() <
           IdentifiabilityOptions{}.weak * turned.norm();
  };
  std::vector<std::string> result;
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (raises[i] && (i < known || known == 0 || !is_weak(static_cast<Eigen::Index>(i)))) {
      result.push_back(names[static_cast<std::size_t>(order[i])]);
    }
  }
  return free_parameters(model, targets, result);
}

// What an earlier fit took counts as well.
void put_before(const Identification& earlier, Identification& later) {
  later.iterations += earlier.iterations;
  later.rms_history.insert(later.rms_history.begin(), earlier.rms_history.begin(), earlier.rms_history.end());
}

constexpr int kGaugeRounds = 3;

// Fits what the measurements determine of the candidates, as judged by the start. What the solution shows to be
// otherwise is taken out or, unless it is weak, added.
Fitted identify_in_gauge(const FitTask& task, const FreeParameters& candidates, FreeParameters& free, Steps steps) {
  const LeastSquaresProblem problem(task.model, task.measurements, candidates, task.fit_options.joint.residuals);
  free = candidates;
  if (task.options.method == Method::two_step || problem.equations() < problem.columns()) {
    return identify(task, candidates, steps);
  }
  const auto determined_at = [&](const Estimate& estimate, const FreeParameters& kept) {
    if (well_conditioned_root(problem.linearise(estimate).hessian)) {
      return candidates;
    }
    const Eigen::MatrixXd triangle = problem.whitened_summary(estimate).triangle;
    return triangle.allFinite() ? determined(task.model, task.start.targets, candidates, kept, triangle) : free;
  };
  FreeParameters nothing;
  nothing.targets.resize(candidates.targets.size());
  free = determined_at(task.start, nothing);
  Fitted fitted;
  for (int round = 0; round < kGaugeRounds; ++round) {
    const Identification earlier = std::move(fitted.identification);
    fitted = identify(task, free, steps);
    put_before(earlier, fitted.identification);
    const FreeParameters there = determined_at(fitted.identification.estimate, free);
    if (same_parameters(there, free) || round + 1 == kGaugeRounds) {
      break;
    }
    free = there;
  }
  return fitted;
}

bool arrived(const Identification& found) {
  return found.termination == Termination::converged || found.termination == Termination::rank_deficient;
}

FreeParameters parameters_of(const FitTask& task, const std::vector<std::string>& names,
                             const FreeParameters& deflections) {
  FreeParameters free = free_parameters(task.model, task.start.targets, names);
  free.deflections = deflections.deflections;
  return free;
}

// Whether the complete set would explain most of a misfit that is more than rounding.
bool has_more_to_explain(const FitTask& task, const FreeParameters& complete, const WholeFit& fit) {
  constexpr double kRounding = 1e-10;  // [m]
  constexpr double kMost = 0.5;        // of the cost
  constexpr long kFreedom = 20;        // fewer equations than that beyond the unknowns leave nothing to explain
  constexpr Eigen::Index kMany = 20000;
  const LeastSquaresProblem problem(task.model, task.measurements, complete, task.fit_options.joint.residuals);
  if (fit.identification.rms < kRounding || problem.equations() < problem.columns() + kFreedom ||
      task.measurements.joint_values.cols() > kMany) {
    return false;
  }
  return promised_share(task.model, problem, complete, fit.identification.estimate) > kMost;
}

constexpr double kExplained = 0.005;  // [m] a misfit beyond that is not one of the geometry

// The complete set from the start, then what the measurements determine there.
WholeFit go_on_in_complete_set(const FitTask& task, const FreeParameters& complete, const FreeParameters& candidates) {
  const LeastSquaresProblem problem(task.model, task.measurements, complete, task.fit_options.joint.residuals);
  const Identification wide = descend(task.model, problem, complete, task.start, task.fit_options.joint, Steps::prior);
  ParameterChoice choice =
      choose_parameters(task.model, wide.estimate.targets, task.options, {.errors = wide.estimate.errors});
  WholeFit result{.identification = wide,
                  .weights = {},
                  .reduction = std::move(choice.reduction),
                  .candidates = parameters_of(task, choice.free, candidates),
                  .free = {}};
  const FitTask from_there{.model = task.model,
                           .measurements = task.measurements,
                           .start = wide.estimate,
                           .options = task.options,
                           .fit_options = task.fit_options};
  const Fitted narrow = identify_in_gauge(from_there, result.candidates, result.free, Steps::plain);
  if (arrived(narrow.identification) && narrow.identification.rms <= wide.rms) {
    result.identification = narrow.identification;
    result.identification.iterations += wide.iterations;
  } else if (wide.termination == Termination::converged) {
    const bool explained = wide.rms < kExplained;
    result.identification.iterations += narrow.identification.iterations;
    result.identification.termination = explained ? Termination::rank_deficient : Termination::stalled;
    result.identification.message =
        explained
            ? "converged, but the measurements do not determine all parameters: what they leave open was kept near "
              "nominal"
            : "no arm near the nominal one explains the measurements";
  }
  std::vector<double>& history = result.identification.rms_history;
  history = wide.rms_history;
  history.insert(history.end(), narrow.identification.rms_history.begin(), narrow.identification.rms_history.end());
  return result;
}

// Through the complete set or, where that does not arrive, with the first set and every means.
void take_the_long_way(const FitTask& task, const FreeParameters& complete, WholeFit& fit) {
  const auto follow = [&](WholeFit next) {
    Identification& now = next.identification;
    const Identification& before = fit.identification;
    put_before(before, now);
    const bool better = arrived(now) != arrived(before) ? arrived(now) : now.rms < before.rms;
    if (better) {
      fit = std::move(next);
    }
  };
  const WholeFit first = fit;
  follow(go_on_in_complete_set(task, complete, fit.candidates));
  if (!arrived(fit.identification)) {
    WholeFit next{.reduction = first.reduction, .candidates = first.candidates};
    next.identification = identify_in_gauge(task, next.candidates, next.free, Steps::any).identification;
    follow(std::move(next));
  }
}

// What the noise hides beside the others is held, unless that costs a misfit.
void hide_in_noise(const FitTask& task, WholeFit& fit) {
  constexpr double kCost = 1.05;
  ParameterChoice choice = choose_parameters(task.model, task.start.targets, task.options,
                                             {.noise = fit.identification.rms / std::sqrt(3.0)});
  const FreeParameters candidates = parameters_of(task, choice.free, fit.candidates);
  if (same_parameters(candidates, fit.candidates)) {
    return;
  }
  WholeFit seen{.reduction = std::move(choice.reduction), .candidates = candidates};
  Fitted fitted = identify_in_gauge(task, candidates, seen.free, Steps::any);
  seen.identification = std::move(fitted.identification);
  seen.weights = std::move(fitted.weights);
  if (arrived(seen.identification) && seen.identification.rms <= kCost * fit.identification.rms) {
    put_before(fit.identification, seen.identification);
    fit = std::move(seen);
  }
}

}  // namespace

bool same_parameters(const FreeParameters& a, const FreeParameters& b) {
  return a.base == b.base && a.geometric == b.geometric && a.deflections == b.deflections && a.targets == b.targets;
}

WholeFit fit_whole(const FitTask& task, const ParameterChoice& choice, const FreeParameters& candidates) {
  WholeFit result{.reduction = choice.reduction, .candidates = candidates};
  const bool chosen = task.options.method == Method::joint && task.options.model == ModelChoice::irreducible;
  // What the user fixed must not come back under other names, and a limit that the user set is one.
  const bool as_asked = task.options.fix.empty() && task.options.iterations == 0;
  const bool may_go_on = chosen && task.fit_options.loss == Loss::none && as_asked;
  Fitted fitted = identify_in_gauge(task, candidates, result.free, may_go_on ? Steps::plain : Steps::any);
  result.identification = std::move(fitted.identification);
  result.weights = std::move(fitted.weights);
  if (may_go_on) {
    const FreeParameters complete = parameters_of(task, choice.complete, candidates);
    if (!arrived(result.identification) || has_more_to_explain(task, complete, result)) {
      take_the_long_way(task, complete, result);
    }
  }
  if (chosen && arrived(result.identification) && !result.reduction.faint.empty()) {
    hide_in_noise(task, result);
  }
  return result;
}

}  // namespace kdl_calibration
