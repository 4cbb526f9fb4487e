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

void require_two_step_data(const Unknowns& free, const Measurements& measurements, const CalibrationOptions& options) {
  const std::size_t targets = measurements.targets.size();
  const bool free_base = free.range(UnknownGroup::base).count == 6;
  const bool free_targets = free.range(UnknownGroup::targets).count >= static_cast<Eigen::Index>(3 * targets);
  if (!free_base || !free_targets) {
    throw OptionError("method", "the two-step procedure finds base and targets, which cannot be known or fixed");
  }
  if (!measurements.orientations.empty()) {
    throw OptionError("method", "the two-step procedure fits points; the measured orientations of " +
                                    measurements.source + " need the joint estimate");
  }
  const bool priors = options.automatic_priors || options.priors.length > 0.0 || options.priors.angle > 0.0;
  const bool effects = options.effects.automatic || !options.effects.groups.empty();
  if (priors || effects || options.loss != Loss::none || options.weights == Weights::repeats) {
    throw OptionError("method", "the published two-step procedure has no priors, effects, losses or noise model");
  }
}

struct Fitted {
  Identification identification;
  RobustRows robust;
};

Fitted identify(const FitTask& task, const Unknowns& free, Steps steps) {
  const CalibrationOptions& options = task.options;
  if (options.method == Method::two_step) {
    require_two_step_data(free, task.measurements, options);
    const TwoStepOptions two_step{.rounds = options.iterations > 0 ? options.iterations : kTwoStepRounds};
    return {identify_in_two_steps(
                task.model, [&](int) { return task.measurements; }, task.start, free.geometric(), two_step),
            {}};
  }
  const JointOptions& joint = task.fit_options.joint;
  if (task.fit_options.loss != Loss::none) {
    RobustIdentification robust = identify_robustly({.model = task.model,
                                                     .measurements = task.measurements,
                                                     .start = task.start,
                                                     .free = free,
                                                     .options = task.fit_options});
    return {std::move(robust.fit), {.weights = std::move(robust.weights), .scale = robust.scale}};
  }
  const LeastSquaresProblem problem(task.model, task.measurements, free, joint.residuals);
  if (steps == Steps::any || problem.equations() < problem.columns()) {
    return {identify_jointly(task.model, task.measurements, task.start, free, joint), {}};
  }
  return {descend(problem, task.start, joint, steps), {}};
}

// Of the columns those that raise the rank: those of `kept`, then the others in the order of choice. Where something is
// kept, what is weak beside it is no reason to add it.
Unknowns determined(const Unknowns& candidates, const Unknowns& kept, const Eigen::MatrixXd& triangle) {
  std::vector<Eigen::Index> order = candidates.order_of_choice();
  const auto others = std::stable_partition(order.begin(), order.end(), [&](Eigen::Index c) {
    const Unknown& unknown = candidates.columns()[static_cast<std::size_t>(c)];
    return kept.column(unknown.group, unknown.index).has_value();
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
  std::vector<bool> marked(order.size(), false);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool worth_while = i < known || known == 0 || !is_weak(static_cast<Eigen::Index>(i));
    marked[static_cast<std::size_t>(order[i])] = raises[i] && worth_while;
  }
  return candidates.subset(marked);
}

// What an earlier fit took counts as well.
void put_before(const Identification& earlier, Identification& later) {
  later.iterations += earlier.iterations;
  later.rms_history.insert(later.rms_history.begin(), earlier.rms_history.begin(), earlier.rms_history.end());
}

constexpr int kGaugeRounds = 3;

// Fits what the measurements determine of the candidates, as judged by the start. What the solution shows to be
// otherwise is taken out or, unless it is weak, added.
Fitted identify_in_gauge(const FitTask& task, const Unknowns& candidates, Unknowns& free, Steps steps) {
  const LeastSquaresProblem problem(task.model, task.measurements, candidates, task.fit_options.joint.residuals);
  free = candidates;
  if (task.options.method == Method::two_step || problem.equations() < problem.columns()) {
    return identify(task, candidates, steps);
  }
  const auto determined_at = [&](const Estimate& estimate, const Unknowns& kept) {
    if (well_conditioned_root(problem.linearise(estimate).hessian)) {
      return candidates;
    }
    const Eigen::MatrixXd triangle = problem.whitened_summary(estimate).triangle;
    return triangle.allFinite() ? determined(candidates, kept, triangle) : free;
  };
  free = determined_at(task.start, Unknowns());
  Fitted fitted;
  for (int round = 0; round < kGaugeRounds; ++round) {
    const Identification earlier = std::move(fitted.identification);
    fitted = identify(task, free, steps);
    put_before(earlier, fitted.identification);
    const Unknowns there = determined_at(fitted.identification.estimate, free);
    if (there == free || round + 1 == kGaugeRounds) {
      break;
    }
    free = there;
  }
  return fitted;
}

Unknowns parameters_of(const FitTask& task, const std::vector<std::string>& names, const Unknowns& effects) {
  return Unknowns(task.model, task.start.targets, names).with(task.model, UnknownGroup::effects, effects.effects());
}

constexpr double kEqualMisfits = 1e-10;  // [m] misfits below that differ by rounding alone

// Whether the complete set would explain most of a misfit that is more than rounding.
bool has_more_to_explain(const FitTask& task, const Unknowns& complete, const WholeFit& fit) {
  constexpr double kMost = 0.5;  // of the cost
  constexpr long kFreedom = 20;  // fewer equations than that beyond the unknowns leave nothing to explain
  constexpr Eigen::Index kMany = 20000;
  const LeastSquaresProblem problem(task.model, task.measurements, complete, task.fit_options.joint.residuals);
  if (fit.identification.rms < kEqualMisfits || problem.equations() < problem.columns() + kFreedom ||
      task.measurements.joint_values.cols() > kMany) {
    return false;
  }
  return promised_share(problem, fit.identification.estimate) > kMost;
}

constexpr double kBeyondGeometry = 0.005;  // [m] a misfit beyond that is not one of the geometry

// The complete set from the start, then what the measurements determine there.
WholeFit go_on_in_complete_set(const FitTask& task, const Unknowns& complete, const Unknowns& candidates) {
  const LeastSquaresProblem problem(task.model, task.measurements, complete, task.fit_options.joint.residuals);
  const Identification wide = descend(problem, task.start, task.fit_options.joint, Steps::prior);
  ParameterChoice choice =
      choose_parameters(task.model, wide.estimate.targets, task.options, {.errors = wide.estimate.errors});
  WholeFit result{.identification = wide,
                  .robust = {},
                  .reduction = std::move(choice.reduction),
                  .candidates = parameters_of(task, choice.free, candidates),
                  .free = {}};
  const FitTask from_there{.model = task.model,
                           .measurements = task.measurements,
                           .start = wide.estimate,
                           .options = task.options,
                           .fit_options = task.fit_options};
  const Fitted narrow = identify_in_gauge(from_there, result.candidates, result.free, Steps::plain);
  if (arrived(narrow.identification) && narrow.identification.rms <= std::max(wide.rms, kEqualMisfits)) {
    result.identification = narrow.identification;
  } else if (wide.termination == Termination::converged) {
    const bool explained = wide.rms < kBeyondGeometry;
    result.identification.termination = explained ? Termination::rank_deficient : Termination::stalled;
    result.identification.message =
        explained
            ? "converged, but the measurements do not determine all parameters: what they leave open was kept near "
              "nominal"
            : "no arm near the nominal one explains the measurements";
  }
  result.identification.iterations = wide.iterations + narrow.identification.iterations;
  std::vector<double>& history = result.identification.rms_history;
  history = wide.rms_history;
  history.insert(history.end(), narrow.identification.rms_history.begin(), narrow.identification.rms_history.end());
  return result;
}

// Through the complete set or, where that does not arrive, with the first set and every means.
void take_the_long_way(const FitTask& task, const Unknowns& complete, WholeFit& fit) {
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
  const Unknowns candidates = parameters_of(task, choice.free, fit.candidates);
  if (candidates == fit.candidates) {
    return;
  }
  WholeFit seen{.reduction = std::move(choice.reduction), .candidates = candidates};
  Fitted fitted = identify_in_gauge(task, candidates, seen.free, Steps::any);
  seen.identification = std::move(fitted.identification);
  seen.robust = std::move(fitted.robust);
  if (arrived(seen.identification) && seen.identification.rms <= kCost * fit.identification.rms) {
    put_before(fit.identification, seen.identification);
    fit = std::move(seen);
  }
}

}  // namespace

bool arrived(const Identification& found) {
  return found.termination == Termination::converged || found.termination == Termination::rank_deficient;
}

WholeFit fit_whole(const FitTask& task, const ParameterChoice& choice, const Unknowns& candidates) {
  WholeFit result{.reduction = choice.reduction, .candidates = candidates};
  const bool chosen = task.options.method == Method::joint && task.options.model == ModelChoice::irreducible;
  // What the user fixed must not come back under other names, and a limit that the user set is one.
  const bool as_asked = task.options.fix.empty() && task.options.iterations == 0;
  const bool may_go_on = chosen && task.fit_options.loss == Loss::none && as_asked;
  Fitted fitted = identify_in_gauge(task, candidates, result.free, may_go_on ? Steps::plain : Steps::any);
  result.identification = std::move(fitted.identification);
  result.robust = std::move(fitted.robust);
  if (may_go_on) {
    const Unknowns complete = parameters_of(task, choice.complete, candidates);
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
