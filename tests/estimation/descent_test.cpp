// The descent against its rule written out with dense matrices: every step of it, why it ended, and how.

#include "kdl_calibration/descent.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::VirtualExperiment;

using Decided = std::map<std::string, int>;

double stretched(const ErrorModel& model) {
  double length = 0.0;
  for (const MovingJoint& joint : model.joints) {
    length += joint.origin.p.Norm();
  }
  return length + model.tip_origin.p.Norm();
}

class ByHand {
public:
  ByHand(const LeastSquaresProblem& problem, const Estimate& start, const JointOptions& options, Steps steps,
         Decided& decided)
      : estimate(start), problem_(problem), steps_(steps), size_(std::max(1.0, stretched(problem.model()) / 10.0)) {
    tolerance_ = size_ * options.step_tolerance;
    plain_ = steps != Steps::prior;
    usual_ = VectorXd(problem.columns());
    from_expected_ = VectorXd::Zero(problem.columns());
    Index column = 0;
    for (const Unknown& unknown : problem.unknowns().columns()) {
      usual_[column] = usual(unknown);
      from_expected_[column++] = Unknowns::value(start, unknown);
    }
    equations_ = problem.linearise(estimate);
    for (int i = 0; i < options.max_iterations && end.empty(); ++i) {
      history.push_back(std::sqrt(equations_.cost / problem.total_weight()));
      const double above = history.back() - options.goal;
      if (i >= 6 && above > 0.0 && 2.0 * above > history.at(static_cast<std::size_t>(i) - 3) - options.goal) {
        history.pop_back();
        end = "what lies above the goal did not halve within three iterations";
        ++decided["in vain"];
      } else {
        ++decided[step()];
      }
    }
    rms = std::sqrt(equations_.cost / problem.total_weight());
  }

  Estimate estimate;
  std::vector<double> history;
  double rms = 0.0;
  std::string end;  // of the words that say so, empty at the limit

private:
  double usual(const Unknown& unknown) const {
    const double grown = unknown.length ? size_ : 1.0;
    switch (unknown.group) {
      case UnknownGroup::base:
        return 3.0 * grown;
      case UnknownGroup::geometric:
        return (unknown.length ? 0.003 : 0.005) * grown;
      case UnknownGroup::effects:
        return 0.005;
      case UnknownGroup::targets:
        return unknown.length ? 0.1 * grown : 3.0;
    }
    return 0.0;
  }

  void solve(const VectorXd& weights, const VectorXd& gradient) {
    MatrixXd H = equations_.hessian;
    H.diagonal() += weights;
    const VectorXd scale = H.diagonal().cwiseSqrt().cwiseInverse();
    MatrixXd scaled = scale.asDiagonal() * H * scale.asDiagonal();
    scaled.diagonal().array() += 1e-12;
    step_ = scale.cwiseProduct(scaled.ldlt().solve(scale.cwiseProduct(gradient)));
    const double squares = step_.dot(equations_.hessian * step_);
    promise_ = 2.0 * step_.dot(equations_.gradient) - squares;
    motion_ = std::sqrt(squares / problem_.total_weight());
  }

  void propose() {
    plain_ = plain_ || (brake_ == 0.0 && fade_ < 1e-6);
    const double s2 = equations_.cost / static_cast<double>(problem_.equations());
    const VectorXd D = usual_.cwiseAbs2().cwiseInverse();
    while (!plain_) {
      solve(s2 * (fade_ + brake_) * D, equations_.gradient - s2 * fade_ * D.cwiseProduct(from_expected_));
      if (steps_ == Steps::prior || (motion_ > tolerance_ && (brake_ > 0.0 || promise_ >= 0.02 * equations_.cost))) {
        return;
      }
      fade_ *= motion_ > tolerance_ ? 0.1 : 1.0;
      plain_ = motion_ <= tolerance_ || fade_ < 1e-6;
    }
    solve(VectorXd::Zero(step_.size() == 0 ? problem_.columns() : step_.size()), equations_.gradient);
  }

  void take(const Estimate& moved, const NormalEquations& there) {
    estimate = moved;
    equations_ = there;
    from_expected_ += step_;
  }

  // NOLINTNEXTLINE(readability-function-cognitive-complexity): the rule written out
  std::string step() {
    propose();
    if (steps_ == Steps::prior && brake_ == 0.0 && (motion_ <= tolerance_ || promise_ < 1e-4 * equations_.cost)) {
      end = "the errors that are usual of an arm explain no more";
      return motion_ <= tolerance_ ? "no motion beside the prior" : "no promise beside the prior";
    }
    const Estimate moved = problem_.unknowns().moved(estimate, step_);
    const double rounding = 2e-14 * size_ * std::sqrt(equations_.cost * problem_.total_weight());
    if (plain_ && motion_ <= tolerance_) {
      if (const double cost = problem_.cost(moved); cost <= equations_.cost + rounding) {
        estimate = moved;
        equations_.cost = cost;
      }
      end = "the last step moved the predicted points by less than the tolerance";
      return "no motion";
    }
    const NormalEquations there = problem_.linearise(moved);
    const double gain = (equations_.cost - there.cost) / promise_;
    return plain_ ? judge_plain(moved, there, gain, rounding) : judge(moved, there, gain);
  }

  std::string judge_plain(const Estimate& moved, const NormalEquations& there, double gain, double rounding) {
    const bool near = step_.cwiseQuotient(usual_).cwiseAbs().maxCoeff() < 50.0;
    if (gain > 0.5 && there.cost < equations_.cost && near) {
      take(moved, there);
      return "plain";
    }
    if (promise_ <= rounding && there.cost <= equations_.cost + rounding) {
      if (promise_ >= 0.25 * last_promise_) {
        end = "no step can reduce the misfit by more than its rounding";
        return "rounding";
      }
      last_promise_ = promise_;
      take(moved, there);
      return "within rounding";
    }
    if (steps_ == Steps::plain) {
      end = "a step did not reduce the misfit as it should";
      return "not plain";
    }
    plain_ = false;
    ++refused_;
    brake_ = fade_ < 1e-6 ? 1e-3 : 0.0;
    return near ? brake_ > 0.0 ? "refused late" : "refused" : "too far";
  }

  std::string judge(const Estimate& moved, const NormalEquations& there, double gain) {
    const double before = equations_.cost;
    if (!(gain > 0.1 && there.cost < before)) {
      brake_ = std::max(10.0 * brake_, fade_);
      if (brake_ > 1e15) {
        end = "no step reduces the misfit any more";
      }
      return "brakes";
    }
    take(moved, there);
    if (steps_ == Steps::prior && before - there.cost < 0.01 * before) {
      end = "the errors that are usual of an arm explain no more";
      return "little beside the prior";
    }
    if (gain <= 0.7) {
      return "as before";
    }
    brake_ = brake_ > 1e-3 * fade_ ? 0.1 * brake_ : 0.0;
    if (steps_ != Steps::any || brake_ > 0.0) {
      return "releases";
    }
    fade_ *= 0.1;
    plain_ = there.cost < 0.1 * before && refused_ < 3;
    return plain_ ? "plain again" : "fades";
  }

  const LeastSquaresProblem& problem_;
  Steps steps_;
  double size_;
  double tolerance_ = 0.0;
  VectorXd usual_;
  VectorXd from_expected_;
  NormalEquations equations_;
  VectorXd step_;
  double promise_ = 0.0;
  double motion_ = 0.0;
  double fade_ = 1.0;
  double brake_ = 0.0;
  double last_promise_ = HUGE_VAL;
  int refused_ = 0;
  bool plain_ = true;
};

void expect_as_by_hand(const LeastSquaresProblem& problem, const Estimate& start, const JointOptions& options,
                       Steps steps, Decided& decided) {
  const Identification found = descend(problem, start, options, steps);
  const ByHand by_hand(problem, start, options, steps, decided);
  ASSERT_EQ(found.rms_history.size(), by_hand.history.size()) << found.message;
  EXPECT_EQ(found.iterations, static_cast<int>(by_hand.history.size()));
  for (std::size_t i = 0; i < by_hand.history.size(); ++i) {
    EXPECT_NEAR(found.rms_history[i], by_hand.history[i], 1e-6 * by_hand.history[i] + 1e-12) << i;
  }
  EXPECT_NEAR(found.rms, by_hand.rms, 1e-6 * by_hand.rms + 1e-12);
  const VectorXd apart = problem.unknowns().difference(by_hand.estimate, found.estimate);
  EXPECT_LT(apart.cwiseAbs().maxCoeff(), 1e-6);
  EXPECT_EQ(found.message, by_hand.end.empty()
                               ? "still moving after " + std::to_string(options.max_iterations) + " iterations"
                               : by_hand.end);
}

/// The arm with angles and lengths of this many millimetres and milliradians, as large as `scale` makes it.
struct Case {
  double size;
  double noise;
  int configurations;
  double scale = 1.0;
  double tolerance = 1e-11;
  int limit = 50;
  double goal = HUGE_VAL;
  bool wrong = false;  // one joint measured with the opposite sign
};

EffectTerm gain_of(int joint) {
  EffectTerm gain;
  gain.name = "gain" + std::to_string(joint);
  gain.group = EffectGroup::gain;
  gain.index = joint;
  return gain;
}

void expect_all_as_by_hand(unsigned seed, const Case& how, Decided& decided) {
  ErrorModel model = complete_model(testing::fanuc());
  for (MovingJoint& joint : model.joints) {
    joint.origin.p = how.scale * joint.origin.p;
  }
  const bool frames = seed % 2 == 0;
  std::vector<std::size_t> gains;
  if (seed % 3 == 0) {
    model.effects = {gain_of(1), gain_of(2)};
    gains = {0, 1};
  }
  VirtualExperiment experiment(
      {.model = model,
       .targets = frames ? testing::as_frames(testing::targets_at({{0.1, 0.2, 0.05}})) : testing::circle_of_targets(),
       .sizes = {.length = 1e-3 * how.size * how.scale, .angle = 1e-3 * how.size},
       .X_WB = Eigen::Isometry3d(Eigen::Translation3d(3.0, 0.5, 0.2)),
       .random = Random(seed)});
  Measurements measured = experiment.measure(
      how.configurations, {.sigma = how.noise, .orientation_sigma = frames ? 10.0 * how.noise : 0.0});
  if (how.wrong) {
    measured.joint_values.row(2) *= -1.0;
  }
  const Estimate start = nominal_start(experiment.model, measured);
  const LeastSquaresProblem problem(experiment.model, measured,
                                    experiment.free.with(experiment.model, UnknownGroup::effects, gains));
  for (const auto& [steps, name] : {std::pair{Steps::any, "any"}, {Steps::plain, "plain"}, {Steps::prior, "prior"}}) {
    SCOPED_TRACE(std::string(name) + ", seed " + std::to_string(seed));
    expect_as_by_hand(problem, start,
                      {.max_iterations = how.limit, .step_tolerance = how.tolerance, .goal = how.goal, .residuals = {}},
                      steps, decided);
  }
}

void expect_each(const Decided& decided, const std::vector<std::string>& what) {
  for (const std::string& one : what) {
    EXPECT_GT(decided.count(one), 0U) << one;
  }
}

TEST(Descent, GoesAsWritten) {
  Decided decided;
  unsigned seed = 0;
  for (const double size : {0.5, 5.0, 30.0, 100.0, 200.0, 300.0}) {
    for (const Case& how : {Case{.size = size, .noise = 3e-5, .configurations = 12},
                            Case{.size = size, .noise = 0.0, .configurations = 20},
                            Case{.size = size, .noise = 2e-3, .configurations = 15},
                            Case{.size = size, .noise = 2e-2, .configurations = 9},
                            Case{.size = 0.5 * size, .noise = 1e-4, .configurations = 14, .scale = 15.0},
                            Case{.size = size, .noise = 1e-4, .configurations = 16, .tolerance = 1e-5, .limit = 4},
                            Case{.size = size, .noise = 1e-4, .configurations = 12, .wrong = true},
                            Case{.size = size, .noise = 1e-3, .configurations = 12, .goal = 0.01, .wrong = true},
                            Case{.size = size, .noise = 1e-3, .configurations = 16, .goal = 0.04, .wrong = true},
                            Case{.size = size, .noise = 1e-3, .configurations = 16, .goal = 0.08, .wrong = true},
                            Case{.size = size, .noise = 1e-3, .configurations = 16, .goal = 0.15, .wrong = true},
                            Case{.size = size, .noise = 1e-2, .configurations = 12, .goal = 0.0}}) {
      expect_all_as_by_hand(++seed, how, decided);
    }
  }
  expect_each(decided, {"as before", "brakes", "fades", "in vain", "little beside the prior", "no motion",
                        "no motion beside the prior", "no promise beside the prior", "not plain", "plain",
                        "plain again", "releases", "too far", "within rounding"});
}

// How many steps that takes is up to the rounding itself.
TEST(Descent, EndsAtItsRoundingWhereNoMotionIsSmallEnough) {
  VirtualExperiment experiment({.random = Random(5)});
  const Measurements measured = experiment.measure(16, {.sigma = 1e-4});
  const Estimate start = nominal_start(experiment.model, measured);
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free);
  const Identification usual = descend(problem, start, {});
  const Identification found = descend(problem, start, {.max_iterations = 50, .step_tolerance = 0.0, .residuals = {}});
  EXPECT_EQ(found.message, "no step can reduce the misfit by more than its rounding");
  EXPECT_EQ(found.termination, Termination::converged);
  EXPECT_LT(found.iterations, usual.iterations + 6);
  EXPECT_NEAR(found.rms, usual.rms, 1e-14);
}

TEST(Descent, PromisesWhatTheFirstStepBesideThePriorTakesOff) {
  VirtualExperiment experiment({.random = Random(6)});
  const Measurements measured = experiment.measure(20, {.sigma = 1e-3});
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free);
  for (const Estimate& estimate : {nominal_start(experiment.model, measured), experiment.robot.truth}) {
    const NormalEquations at = problem.linearise(estimate);
    const double s2 = at.cost / static_cast<double>(problem.equations());
    MatrixXd H = at.hessian;
    VectorXd g = at.gradient;
    Index column = 0;
    for (const Unknown& unknown : problem.unknowns().columns()) {
      const double usual = unknown.group == UnknownGroup::base                                       ? 3.0
                           : unknown.group == UnknownGroup::targets                                  ? 0.1
                           : is_length(experiment.model, experiment.model.parameters[unknown.index]) ? 0.003
                                                                                                     : 0.005;
      H(column, column) += s2 / (usual * usual);
      g[column++] -= s2 / (usual * usual) * Unknowns::value(estimate, unknown);
    }
    const VectorXd step = H.ldlt().solve(g);
    const double promise = 2.0 * step.dot(at.gradient) - step.dot(at.hessian * step);
    EXPECT_NEAR(promised_share(problem, estimate), promise / at.cost, 1e-6);
  }
}

// A radian, and half of the arm as it is stretched out, its slides included; of a small one half a metre.
TEST(Descent, RunsAwayBeyondWhatNoRobotIsOffBy) {
  for (const double scale : {1.0, 0.1}) {
    ErrorModel model = complete_model(parse_robot(testing::kOddArm));
    for (MovingJoint& joint : model.joints) {
      joint.origin.p = scale * joint.origin.p;
    }
    VirtualExperiment experiment({.model = model, .sizes = {.length = 0.0, .angle = 0.0}});
    const double half = 0.5 * (stretched(experiment.model) + 0.5);
    for (const std::size_t p : experiment.free.geometric()) {
      const bool length = is_length(experiment.model, experiment.model.parameters[p]);
      const double limit = length ? std::max(half, 0.5) : 1.0;
      for (const double share : {-1.001, -0.999, 0.999, 1.001}) {
        experiment.robot.truth.errors.setZero();
        experiment.robot.truth.errors[static_cast<Index>(p)] = share * limit;
        const Measurements measured = experiment.measure(20);
        const LeastSquaresProblem problem(experiment.model, measured, experiment.free);
        const Identification found = descend(problem, experiment.robot.truth, {});
        const bool beyond = std::abs(share) > 1.0;
        EXPECT_EQ(found.termination, beyond ? Termination::diverged : Termination::converged)
            << experiment.model.parameters[p].name << " " << share << " " << found.message;
        if (beyond) {
          EXPECT_EQ(found.message, length ? "the fit ran away: a length is off by more than half the arm"
                                          : "the fit ran away: an angle is off by more than a radian");
        }
      }
    }
  }
}

}  // namespace
}  // namespace kdl_calibration
