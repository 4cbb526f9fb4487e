#include "kdl_calibration/descent.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <utility>

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Steps of H x = g, solved with the columns scaled to unit norm.
class Solver {
public:
  // With what keeps a singular H from being one.
  void solve(const NormalEquations& equations) {
    diagonal_ = equations.hessian.diagonal();
    solve(equations.hessian, equations.gradient, kSmallestDamping);
  }

  // Of (H + diag(weights)) x = gradient.
  void solve(const NormalEquations& equations, const VectorXd& weights, const VectorXd& gradient) {
    diagonal_ = equations.hessian.diagonal() + weights;
    solve(equations.hessian, gradient, kSmallestDamping);
  }

  const VectorXd& step() const { return step_; }
  // Of the scaled matrix: near zero means rank deficient.
  double smallest_pivot() const { return smallest_pivot_; }

private:
  void solve(const MatrixXd& hessian, const VectorXd& gradient, double damping) {
    const Index n = gradient.size();
    scale_ = diagonal_.unaryExpr([](double d) { return d > 0.0 ? 1.0 / std::sqrt(d) : 0.0; });
    scaled_.resize(n, n);
    const auto scale_lower = [&] {
      for (Index c = 0; c < n; ++c) {
        scaled_.col(c).tail(n - c) = scale_[c] * scale_.tail(n - c).cwiseProduct(hessian.col(c).tail(n - c));
        scaled_(c, c) = 1.0 + damping;
      }
    };
    scale_lower();
    step_ = scale_.cwiseProduct(gradient);
    // Without pivoting the pivots are the squared distances of the columns from the span of those before them: only
    // where one of them is small is there a reason to pivot.
    factorise();
    if (smallest_pivot_ > kPivotInDoubt) {
      scaled_.triangularView<Eigen::Lower>().solveInPlace(step_);
      scaled_.triangularView<Eigen::Lower>().adjoint().solveInPlace(step_);
    } else {
      scale_lower();
      const Eigen::LDLT<MatrixXd> pivoted(scaled_);
      step_ = pivoted.solve(step_);
      smallest_pivot_ = pivoted.vectorD().minCoeff();
    }
    step_.array() *= scale_.array();
  }

  // scaled_ = L L^T in place; no smallest pivot where one is in doubt.
  void factorise() {
    constexpr Index kLarge = 128;  // for Eigen's blocks
    if (scaled_.cols() < kLarge) {
      factorise_small();
      return;
    }
    const Eigen::LLT<Eigen::Ref<MatrixXd>> root(scaled_);
    const double pivot = root.matrixLLT().diagonal().cwiseAbs2().minCoeff();
    smallest_pivot_ = root.info() == Eigen::Success && pivot > kPivotInDoubt ? std::min(pivot, 1.0) : 0.0;
  }

  // Four columns at a time; stops at a pivot in doubt.
  void factorise_small() {
    const Index n = scaled_.cols();
    smallest_pivot_ = 1.0;
    for (Index first = 0; first < n; first += 4) {
      const Index end = std::min(first + 4, n);
      for (Index j = first; j < end; ++j) {
        for (Index k = first; k < j; ++k) {
          scaled_.col(j).tail(n - j) -= scaled_(j, k) * scaled_.col(k).tail(n - j);
        }
        smallest_pivot_ = std::min(smallest_pivot_, scaled_(j, j));
        if (!(smallest_pivot_ > kPivotInDoubt)) {
          smallest_pivot_ = 0.0;
          return;
        }
        scaled_.col(j).tail(n - j) /= std::sqrt(scaled_(j, j));
      }
      for (Index c = end; c < n; ++c) {  // only reached behind four full columns
        const auto part = [&](Index k) { return scaled_(c, first + k) * scaled_.col(first + k).tail(n - c); };
        scaled_.col(c).tail(n - c) -= (part(0) + part(1)) + (part(2) + part(3));
      }
    }
  }

  static constexpr double kPivotInDoubt = 1e-9;
  static constexpr double kSmallestDamping = 1e-12;
  VectorXd diagonal_;
  VectorXd scale_;
  VectorXd step_;
  MatrixXd scaled_;
  double smallest_pivot_ = 0.0;
};

// [m] of all links, one behind the other.
double stretched(const ErrorModel& model) {
  double length = model.tip_origin.p.Norm();
  for (const MovingJoint& joint : model.joints) {
    length += joint.origin.p.Norm();
  }
  return length;
}

// What no robot is off by: an angle by a radian, a length by half of the arm as it is stretched out, its slides
// included, and by half a metre where that is more. Points in feet ask for more of any arm that has one long link.
constexpr double kLargestAngle = 1.0;        // [rad]
constexpr double kLargestShareOfArm = 0.5;   // of its length
constexpr double kLeastLargestLength = 0.5;  // [m]

double largest_length(const ErrorModel& model) {
  double length = stretched(model);
  for (const MovingJoint& joint : model.joints) {
    if (joint.type == JointType::prismatic) {
      length += std::max(std::abs(joint.lower.value_or(0.0)), std::abs(joint.upper.value_or(0.0)));
    }
  }
  return std::max(kLeastLargestLength, kLargestShareOfArm * length);
}

// How the fit has run away to errors beyond any robot's; nothing where it has not.
const char* run_away(const ErrorModel& model, const VectorXd& errors) {
  const double largest = largest_length(model);
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const double value = std::abs(errors[static_cast<Index>(p)]);
    const bool length = is_length(model, model.parameters[p]);
    if (!(value <= (length ? largest : kLargestAngle))) {
      return length ? "the fit ran away: a length is off by more than half the arm"
                    : "the fit ran away: an angle is off by more than a radian";
    }
  }
  return nullptr;
}

constexpr double kDeficientPivot = 1e-11;

constexpr double kUsualEffect = 0.005;  // [rad], [m] or per unit
constexpr double kUsualTarget = 0.1;    // [m] from the flange
constexpr double kUsualFrame = 3.0;     // [m] or [rad] of a frame from where it was registered: anywhere

// What is usual is that of an arm of up to ten metres; a larger one has larger errors, and coarser rounding.
double size_of(const ErrorModel& model) {
  constexpr double kLargeArm = 10.0;  // [m]
  return std::max(1.0, stretched(model) / kLargeArm);
}

// Of every column: how far the estimate is from what is expected beforehand, and the inverse square of the distance
// that is usual. Errors and effects are expected to be zero, targets at the flange, frames where they start.
struct Expectation {
  VectorXd distance;
  VectorXd information;
};

// How far an unknown usually is from what is expected of it.
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
  const double size = size_of(model);
  Index column = 0;
  for (const Unknown& unknown : unknowns.columns()) {
    const bool grows = unknown.length && unknown.group != UnknownGroup::effects;
    const double usual = usual_distance(model, unknown) * (grows ? size : 1.0);
    result.distance[column] = Unknowns::value(start, unknown);
    result.information[column++] = 1.0 / (usual * usual);
  }
  return result;
}

// Gauss-Newton steps, plain ones while the reduction of the cost is as predicted. Where one does not, the errors have a
// prior: with H, g of the data, s^2 the mean square of the whitened residuals, x the errors and D what is usual of
// them,
//   (H + s^2 (w + d) D) step = g - s^2 w D x,
// with the prior weight w and the damping d.
// With w = 1 and d = 0 this is the most probable robot if the residuals were noise: what the misfit leaves open
// stays near nominal, whatever it is measured in, and becomes free as the misfit falls. Towards the end w goes to
// zero, so that the optimum is that of the data alone. Damping about the present estimate is a trust region.
class Descent {
public:
  Descent(const LeastSquaresProblem& problem, const Estimate& start, const JointOptions& options, Steps steps)
      : model_(problem.model()),
        problem_(problem),
        options_(options),
        steps_(steps),
        tolerance_(options.step_tolerance * size_of(model_)),
        rounding_(kRoundingOfPoints * size_of(model_)),
        expected_(expectation(model_, problem.unknowns(), start)),
        plain_(steps != Steps::prior) {
    result_.estimate = start;
    result_.rms_history.reserve(static_cast<std::size_t>(std::max(options.max_iterations, 0)));
    finish(Termination::iteration_limit,
           "still moving after " + std::to_string(options.max_iterations) + " iterations");
  }

  Identification run() {
    problem_.linearise(result_.estimate, workspace_, equations_);
    for (bool going = true; going && result_.iterations < options_.max_iterations && !is_in_vain();) {
      ++result_.iterations;
      result_.rms_history.push_back(rms());
      going = iterate();
    }
    result_.rms = rms();
    const char* beyond = run_away(model_, result_.estimate.errors);
    if (result_.termination == Termination::converged && beyond != nullptr) {
      finish(Termination::diverged, beyond);
    }
    if (result_.termination == Termination::converged && smallest_pivot_ < kDeficientPivot) {
      finish(Termination::rank_deficient, "converged, but the measurements do not determine all parameters");
    }
    return std::move(result_);
  }

  double predicted_share() {
    problem_.linearise(result_.estimate, workspace_, equations_);
    propose();
    return predicted_reduction_ / equations_.cost;
  }

private:
  static constexpr double kKept = 0.5;             // least gain ratio of a plain step
  static constexpr double kLeastReduction = 0.02;  // share of the cost below which the prior stands in the way
  static constexpr double kPlain = 1e-6;           // prior weight below which it matters no more
  static constexpr double kFarthest = 50.0;        // plain step, in usual errors
  static constexpr double kStandstill = 1e15;
  static constexpr double kRoundingOfPoints = 2e-14;  // [m] twice that of predicted points some metres away
  static constexpr double kSettled = 1e-4;            // share of the cost that is not worth a step with a prior
  static constexpr double kLittle = 1e-2;             // share of the cost of a step that ends a fit with a prior
  static constexpr double kFirstDamping = 1e-3;
  static constexpr double kLeastGain = 0.1;
  static constexpr double kGoodGain = 0.7;
  static constexpr int kRefusals = 3;  // of plain steps, before they are left for the end

  // Whether what lies above the goal did not halve; never below the goal, nor without one, as it is infinite then.
  bool is_in_vain() {
    constexpr int kFirst = 6;
    constexpr int kToHalve = 3;
    if (result_.iterations < kFirst) {
      return false;
    }
    const double before = result_.rms_history[static_cast<std::size_t>(result_.iterations - kToHalve)];
    if (rms() - options_.goal <= 0.5 * (before - options_.goal)) {
      return false;
    }
    finish(Termination::stalled, "what lies above the goal did not halve within three iterations");
    return true;
  }

  bool iterate() {
    propose();
    if (!std::isfinite(effect_) || !std::isfinite(equations_.cost)) {
      finish(Termination::diverged, "the misfit is no longer finite");
      return false;
    }
    if (steps_ == Steps::prior && damping_ == 0.0 &&
        (effect_ <= tolerance_ || predicted_reduction_ < kSettled * equations_.cost)) {
      smallest_pivot_ = solver_.smallest_pivot();
      finish(Termination::converged, "the errors that are usual of an arm explain no more");
      return false;
    }
    problem_.unknowns().move(result_.estimate, solver_.step(), moved_);
    if (plain_ && effect_ <= tolerance_) {  // the last look: no step follows
      smallest_pivot_ = solver_.smallest_pivot();
      // So small a step changes the cost by less than its rounding, so the predicted reduction decides.
      if (const double cost = problem_.cost(moved_, workspace_); cost <= equations_.cost + rounding_of_cost()) {
        equations_.cost = cost;
        std::swap(result_.estimate, moved_);
      }
      finish(Termination::converged, "the last step moved the predicted points by less than the tolerance");
      return false;
    }
    problem_.linearise(moved_, workspace_, moved_equations_);
    const double gain = (equations_.cost - moved_equations_.cost) / predicted_reduction_;
    return plain_ ? assess_plain_step(gain) : assess_step(gain);
  }

  void propose() {
    plain_ = plain_ || (damping_ == 0.0 && prior_weight_ < kPlain);
    while (!plain_) {
      const double s2 = equations_.cost / static_cast<double>(problem_.equations());
      weights_ = s2 * (prior_weight_ + damping_) * expected_.information;
      gradient_ = equations_.gradient - s2 * prior_weight_ * expected_.information.cwiseProduct(expected_.distance);
      solver_.solve(equations_, weights_, gradient_);
      measure_step();
      if (steps_ == Steps::prior) {
        return;
      }
      if (effect_ <= tolerance_) {  // what holds it back may be all that is left
        plain_ = true;
        break;
      }
      if (damping_ > 0.0 || predicted_reduction_ >= kLeastReduction * equations_.cost) {
        return;
      }
      prior_weight_ *= 0.1;
      plain_ = prior_weight_ < kPlain;
    }
    solver_.solve(equations_);
    measure_step();
  }

  // The reduction of the cost that the step predicts, and how far it moves the points.
  void measure_step() {
    const VectorXd& step = solver_.step();
    curvature_.noalias() = equations_.hessian * step;
    const double squares = std::max(step.dot(curvature_), 0.0);
    predicted_reduction_ = 2.0 * step.dot(equations_.gradient) - squares;
    effect_ = std::sqrt(squares / problem_.total_weight());
  }

  bool assess_plain_step(double gain) {
    const double farthest = solver_.step().cwiseAbs2().cwiseProduct(expected_.information).maxCoeff();
    const bool better = moved_equations_.cost < equations_.cost && gain > kKept;
    if (better && farthest < kFarthest * kFarthest) {
      smallest_pivot_ = solver_.smallest_pivot();
      accept();
      return true;
    }
    // So close to the end the costs differ by their rounding alone, so the predicted reduction of the next step
    // decides.
    const double rounding = rounding_of_cost();
    if (predicted_reduction_ <= rounding && moved_equations_.cost <= equations_.cost + rounding) {
      smallest_pivot_ = solver_.smallest_pivot();
      if (predicted_reduction_ < 0.25 * last_predicted_reduction_) {
        last_predicted_reduction_ = predicted_reduction_;
        accept();
        return true;
      }
      finish(Termination::converged, "no step can reduce the misfit by more than its rounding");
      return false;
    }
    if (steps_ == Steps::plain) {
      finish(Termination::stalled, "a step did not reduce the misfit as it should");
      return false;
    }
    plain_ = false;
    ++refused_;
    damping_ = prior_weight_ < kPlain ? kFirstDamping : 0.0;
    return true;
  }

  bool assess_step(double gain) {
    if (!(moved_equations_.cost < equations_.cost && gain > kLeastGain)) {
      damping_ = std::max(10.0 * damping_, prior_weight_);
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
      finish(Termination::converged, "the errors that are usual of an arm explain no more");
      return false;
    }
    if (gain > kGoodGain) {
      damping_ = damping_ > kFirstDamping * prior_weight_ ? 0.1 * damping_ : 0.0;
      if (steps_ == Steps::any && damping_ == 0.0) {
        prior_weight_ *= 0.1;
        plain_ = much && refused_ < kRefusals;
      }
    }
    return true;
  }

  void accept() {
    expected_.distance += solver_.step();
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
  bool plain_;
  Identification result_;
  LeastSquaresProblem::Workspace workspace_;
  NormalEquations equations_;
  NormalEquations moved_equations_;
  Estimate moved_;
  Solver solver_;
  VectorXd weights_;
  VectorXd gradient_;
  VectorXd curvature_;
  double effect_ = 0.0;
  double predicted_reduction_ = 0.0;
  double smallest_pivot_ = 1.0;
  double prior_weight_ = 1.0;
  double damping_ = 0.0;
  int refused_ = 0;
  double last_predicted_reduction_ = std::numeric_limits<double>::infinity();
};

}  // namespace

Identification descend(const LeastSquaresProblem& problem, const Estimate& start, const JointOptions& options,
                       Steps steps) {
  return Descent(problem, start, options, steps).run();
}

double predicted_share(const LeastSquaresProblem& problem, const Estimate& estimate) {
  const JointOptions options;
  return Descent(problem, estimate, options, Steps::prior).predicted_share();
}

}  // namespace kdl_calibration
