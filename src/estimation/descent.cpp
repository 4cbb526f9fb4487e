#include "estimation/descent.hpp"

#include <fmt/core.h>
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <utility>

#include "estimation/scaled_solver.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Limits of errors: a radian, and half the length of the stretched arm (travels included) but at least 0.5 m. Points in
// feet exceed them for any arm with one long link.
constexpr double kLargestAngleError = 1.0;   // [rad]
constexpr double kLargestShareOfArm = 0.5;   // share of its length
constexpr double kLeastLargestLength = 0.5;  // [m]

double largest_length(const ErrorModel& model) {
  double length = arm_length(model);
  for (const MovingJoint& joint : model.joints) {
    if (joint.type == JointType::prismatic) {
      length += std::max(std::abs(joint.lower.value_or(0.0)), std::abs(joint.upper.value_or(0.0)));
    }
  }
  return std::max(kLeastLargestLength, kLargestShareOfArm * length);
}

// Message if errors exceed these limits, else nullptr.
const char* run_away(const ErrorModel& model, const VectorXd& errors) {
  const double largest = largest_length(model);
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const double value = std::abs(errors[static_cast<Index>(p)]);
    const bool length = is_length(model, model.parameters[p]);
    if (!(value <= (length ? largest : kLargestAngleError))) {
      return length ? "the fit ran away: a length is off by more than half the arm"
                    : "the fit ran away: an angle is off by more than a radian";
    }
  }
  return nullptr;
}

constexpr double kUsualEffect = 0.005;  // [rad], [m] or per unit
constexpr double kUsualTarget = 0.1;    // [m] from the flange
constexpr double kUsualFrame = 3.0;     // [m] or [rad] from the registered frame: practically no prior

// For every column the distance of the estimate from its prior mean, and the inverse square of the usual distance. The
// prior mean of errors and effects is zero, of targets the flange, of frames their start.
struct Expectation {
  VectorXd distance;
  VectorXd information;
};

// Usual distance of an unknown from its prior mean.
double usual_distance(const ErrorModel& model, const Unknown& unknown) {
  switch (unknown.group) {
    case UnknownGroup::base:
      return kUsualFrame;
    case UnknownGroup::geometric:
      return usual_error(model, model.parameters[unknown.index]);
    case UnknownGroup::effects:
      return kUsualEffect;
    case UnknownGroup::targets:
      return unknown.length ? kUsualTarget : kUsualFrame;
  }
  return kUsualFrame;
}

Expectation expectation(const ErrorModel& model, const Unknowns& unknowns, const Estimate& start) {
  Expectation result{.distance = VectorXd::Zero(unknowns.size()), .information = VectorXd::Zero(unknowns.size())};
  const double size = size_of_arm(model);
  Index column = 0;
  for (const Unknown& unknown : unknowns.columns()) {
    const bool grows = unknown.length && unknown.group != UnknownGroup::effects;
    const double usual = usual_distance(model, unknown) * (grows ? size : 1.0);
    result.distance[column] = Unknowns::value(start, unknown);
    result.information[column++] = 1.0 / (usual * usual);
  }
  return result;
}

// How a step is found. H and g are those of the data, s^2 the mean square of the whitened residuals, x the distance of
// the unknowns from what is expected of them, and D the information of that expectation.
enum class Phase {
  gauss_newton,  // H step = g
  with_prior,    // (H + s^2 w D) step = g - s^2 w D x, with the prior weight w
  damped         // (H + s^2 (w + d) D) step = g - s^2 w D x, with the damping d: a trust region
};

// Gauss-Newton steps while the cost falls as predicted. Where it does not, the errors have a prior. With w = 1 its
// optimum is the most probable robot if the residuals were noise: what the misfit leaves open stays near nominal. The
// prior weight then goes to zero, so that the optimum is that of the data alone. Steps that fail are damped.
class Descent {
public:
  Descent(const LeastSquaresProblem& problem, const Estimate& start, const JointOptions& options, Steps steps)
      : model_(problem.model()),
        problem_(problem),
        options_(options),
        steps_(steps),
        tolerance_(options.step_tolerance * size_of_arm(model_)),
        rounding_(kRoundingOfPoints * size_of_arm(model_)),
        expected_(expectation(model_, problem.unknowns(), start)),
        phase_(steps == Steps::prior ? Phase::with_prior : Phase::gauss_newton) {
    result_.estimate = start;
    result_.rms_history.reserve(static_cast<std::size_t>(std::max(options.max_iterations, 0)));
    finish(Termination::iteration_limit, fmt::format("still moving after {} iterations", options.max_iterations));
  }

  Identification run() {
    problem_.linearise(result_.estimate, workspace_, equations_);
    for (bool going = true; going && result_.iterations < options_.max_iterations && !misses_goal();) {
      ++result_.iterations;
      result_.rms_history.push_back(rms());
      going = iterate();
    }
    result_.rms = rms();
    const char* beyond = run_away(model_, result_.estimate.errors);
    if (result_.termination == Termination::converged && beyond != nullptr) {
      finish(Termination::diverged, beyond);
    }
    return std::move(result_);
  }

  double predicted_share() {
    problem_.linearise(result_.estimate, workspace_, equations_);
    propose();
    return predicted_reduction_ / equations_.cost;
  }

private:
  static constexpr double kKept = 0.5;             // least gain ratio of a Gauss-Newton step
  static constexpr double kLeastReduction = 0.02;  // share of the cost below which the prior weight is lowered
  static constexpr double kNegligible = 1e-6;      // prior weight below which steps are plain
  static constexpr double kFarthest = 50.0;        // longest Gauss-Newton step, in usual errors
  static constexpr double kStandstill = 1e15;
  static constexpr double kRoundingOfPoints = 2e-14;  // [m] twice the rounding of points some metres away
  static constexpr double kSettled = 1e-4;            // smallest predicted share of the cost for a step with prior
  static constexpr double kLittle = 1e-2;             // a fit with prior ends below this share of the cost
  static constexpr double kFirstDamping = 1e-3;
  static constexpr double kLeastGain = 0.1;
  static constexpr double kGoodGain = 0.7;
  static constexpr int kRefusals = 3;  // refused Gauss-Newton steps before they are left for the end

  // Whether the excess over the goal did not halve; false below the goal, and without one, as it is infinite.
  bool misses_goal() {
    constexpr int kFirst = 6;
    constexpr int kToHalve = 3;
    if (result_.iterations < kFirst) {
      return false;
    }
    const double before = result_.rms_history[static_cast<std::size_t>(result_.iterations - kToHalve)];
    if (rms() - options_.goal <= 0.5 * (before - options_.goal)) {
      return false;
    }
    finish(Termination::stalled, "the excess over the goal did not halve within three iterations");
    return true;
  }

  bool iterate() {
    propose();
    if (!std::isfinite(effect_) || !std::isfinite(equations_.cost)) {
      finish(Termination::diverged, "the misfit is no longer finite");
      return false;
    }
    if (steps_ == Steps::prior && phase_ == Phase::with_prior &&
        (effect_ <= tolerance_ || predicted_reduction_ < kSettled * equations_.cost)) {
      finish(Termination::converged, "errors of usual size do not reduce the misfit further");
      return false;
    }
    problem_.unknowns().move(result_.estimate, solver_.solution(), moved_);
    if (phase_ == Phase::gauss_newton && effect_ <= tolerance_) {
      take_last_step();
      return false;
    }
    problem_.linearise(moved_, workspace_, moved_equations_);
    const double gain = (equations_.cost - moved_equations_.cost) / predicted_reduction_;
    return phase_ == Phase::gauss_newton ? assess_gauss_newton(gain) : assess_with_prior(gain);
  }

  // Without a look at its equations, as no step follows.
  void take_last_step() {
    // The step changes the cost by less than its rounding, so it is accepted if it does not raise the cost beyond
    // that.
    if (const double cost = problem_.cost(moved_, workspace_); cost <= equations_.cost + rounding_of_cost()) {
      equations_.cost = cost;
      std::swap(result_.estimate, moved_);
    }
    finish(Termination::converged, "the last step moved the predicted points by less than the tolerance");
  }

  // Finds a step. Leaves the prior where its steps are too small to be worth it.
  void propose() {
    while (phase_ != Phase::gauss_newton) {
      const double s2 = equations_.cost / static_cast<double>(problem_.equations());
      added_ = s2 * (prior_weight_ + damping_) * expected_.information;
      gradient_ = equations_.gradient - s2 * prior_weight_ * expected_.information.cwiseProduct(expected_.distance);
      solver_.solve(equations_.hessian, added_, gradient_);
      measure_step();
      if (steps_ == Steps::prior) {
        return;
      }
      if (effect_ <= tolerance_) {  // the prior alone may shorten the step
        enter(Phase::gauss_newton);
      } else if (phase_ == Phase::damped || predicted_reduction_ >= kLeastReduction * equations_.cost) {
        return;
      } else {
        weaken_prior();
      }
    }
    solver_.solve(equations_.hessian, {}, equations_.gradient);
    measure_step();
  }

  void enter(Phase phase, double damping = 0.0) {
    phase_ = phase;
    damping_ = damping;
  }

  void weaken_prior() {
    prior_weight_ *= 0.1;
    enter(prior_weight_ < kNegligible ? Phase::gauss_newton : Phase::with_prior);
  }

  // Predicted reduction of the cost, and RMS motion [m] of the points.
  void measure_step() {
    const VectorXd& step = solver_.solution();
    curvature_.noalias() = equations_.hessian * step;
    const double squares = std::max(step.dot(curvature_), 0.0);
    predicted_reduction_ = 2.0 * step.dot(equations_.gradient) - squares;
    effect_ = std::sqrt(squares / problem_.total_weight());
  }

  bool assess_gauss_newton(double gain) {
    const double farthest = solver_.solution().cwiseAbs2().cwiseProduct(expected_.information).maxCoeff();
    const bool better = moved_equations_.cost < equations_.cost && gain > kKept;
    if (better && farthest < kFarthest * kFarthest) {
      accept();
      return true;
    }
    // Close to the end costs differ only by rounding, so the predicted reductions of successive steps decide.
    const double rounding = rounding_of_cost();
    if (predicted_reduction_ <= rounding && moved_equations_.cost <= equations_.cost + rounding) {
      if (predicted_reduction_ < 0.25 * last_predicted_reduction_) {
        last_predicted_reduction_ = predicted_reduction_;
        accept();
        return true;
      }
      finish(Termination::converged, "no step can reduce the misfit by more than its rounding");
      return false;
    }
    if (steps_ == Steps::plain) {
      finish(Termination::stalled, "the gain ratio of a step is too small");
      return false;
    }
    ++refused_;
    if (prior_weight_ < kNegligible) {
      enter(Phase::damped, kFirstDamping);
    } else {
      enter(Phase::with_prior);
    }
    return true;
  }

  // Of a step with a prior, damped or not.
  bool assess_with_prior(double gain) {
    if (!(moved_equations_.cost < equations_.cost && gain > kLeastGain)) {
      enter(Phase::damped, std::max(10.0 * damping_, prior_weight_));
      if (damping_ > kStandstill) {
        finish(Termination::stalled, "no step reduces the misfit any more");
        return false;
      }
      return true;
    }
    const bool much = moved_equations_.cost < 0.1 * equations_.cost;
    const bool little = equations_.cost - moved_equations_.cost < kLittle * equations_.cost;
    accept();
    if (steps_ == Steps::prior && little) {
      finish(Termination::converged, "errors of usual size do not reduce the misfit further");
      return false;
    }
    if (gain <= kGoodGain) {
      return true;
    }
    if (damping_ > kFirstDamping * prior_weight_) {
      damping_ *= 0.1;
    } else if (steps_ == Steps::prior) {
      enter(Phase::with_prior);
    } else {
      weaken_prior();
      if (much && refused_ < kRefusals) {
        enter(Phase::gauss_newton);
      }
    }
    return true;
  }

  void accept() {
    expected_.distance += solver_.solution();
    std::swap(result_.estimate, moved_);
    std::swap(equations_, moved_equations_);
  }

  double rounding_of_cost() const { return rounding_ * std::sqrt(equations_.cost * problem_.total_weight()); }

  double rms() const { return std::sqrt(equations_.cost / problem_.total_weight()); }

  void finish(Termination termination, std::string message) {
    result_.termination = termination;
    result_.message = std::move(message);
  }

  const ErrorModel& model_;
  const LeastSquaresProblem& problem_;
  const JointOptions& options_;
  const Steps steps_;
  const double tolerance_;
  const double rounding_;
  Expectation expected_;
  Phase phase_;
  Identification result_;
  LeastSquaresProblem::Workspace workspace_;
  NormalEquations equations_;
  NormalEquations moved_equations_;
  Estimate moved_;
  ScaledSolver solver_;
  VectorXd added_;
  VectorXd gradient_;
  VectorXd curvature_;
  double effect_ = 0.0;
  double predicted_reduction_ = 0.0;
  double prior_weight_ = 1.0;
  double damping_ = 0.0;
  int refused_ = 0;
  double last_predicted_reduction_ = std::numeric_limits<double>::infinity();
};

}  // namespace

double size_of_arm(const ErrorModel& model) {
  constexpr double kLargeArm = 10.0;  // [m]
  return std::max(1.0, arm_length(model) / kLargeArm);
}

Identification descend(const LeastSquaresProblem& problem, const Estimate& start, const JointOptions& options,
                       Steps steps) {
  return Descent(problem, start, options, steps).run();
}

double predicted_share(const LeastSquaresProblem& problem, const Estimate& estimate) {
  const JointOptions options;
  return Descent(problem, estimate, options, Steps::prior).predicted_share();
}

}  // namespace kdl_calibration
