#include "calibration/minimum_norm.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>

#include "planning/simulation.hpp"
#include "uncertainty/covariance.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::minimum_norm_test {
namespace {

// An arm fitted with all parameters of the complete model as candidates.
struct Fitted : testing::VirtualExperiment {
  Measurements measured;
  ParameterOptions options{.model = ModelChoice::complete};
  Estimate start;
  DeterminedFit fit;

  explicit Fitted(double sigma)
      : VirtualExperiment({.random = Random(7)}),
        measured(testing::without_sigmas(measure(30, {.sigma = sigma}))),
        start(nominal_start(model, measured)) {
    const ParameterSelection choice = select_parameters(model, start.frames.targets, options);
    fit = fit_determined_parameters(problem(Unknowns(model, start.frames.targets, choice.free)), choice,
                                    {.estimator = {}, .parameters = options});
  }
  Fitted(const Fitted&) = delete;
  Fitted& operator=(const Fitted&) = delete;

  FitProblem problem(const Unknowns& unknowns) const {
    return {.model = model, .measurements = measured, .start = start, .free = unknowns};
  }
  std::optional<Identification> smallest() const { return smallest_errors(problem(fit.free), fit); }

  // The derivative, along what is open, of the sum of squared errors in usual ones, over their size.
  double slope() const {
    const Estimate& estimate = fit.identification.estimate;
    const Eigen::MatrixXd open = undetermined_directions(
        LeastSquaresProblem(model, measured, fit.candidates).whitened_summary(estimate).sqrt_information);
    Eigen::VectorXd errors = Eigen::VectorXd::Zero(fit.candidates.size());
    Eigen::VectorXd scale = errors;
    for (Eigen::Index c = 0; c < fit.candidates.size(); ++c) {
      const Unknown& unknown = fit.candidates.columns()[static_cast<std::size_t>(c)];
      if (unknown.group == UnknownGroup::geometric) {
        scale[c] = unknown.length ? 1.0 / 0.003 : 1.0 / 0.005;
        errors[c] = scale[c] * Unknowns::value(estimate, unknown);
      }
    }
    const Eigen::MatrixXd along = scale.asDiagonal() * open;
    return (along.transpose() * errors).norm() / (along.norm() * errors.norm());
  }
};

TEST(MinimumNorm, ErrorsAreAsSmallAsTheyGetAlongWhatIsOpen) {
  Fitted f(1e-5);
  const double rms = f.fit.identification.rms;
  EXPECT_GT(f.slope(), 1e-3);
  f.fit.identification = f.smallest().value();
  EXPECT_LT(f.slope(), 1e-8);
  EXPECT_NEAR(f.fit.identification.rms, rms, 1e-12);
}

TEST(MinimumNorm, IsNoneWhereNothingIsOpenOrTheFitDidNotArrive) {
  Fitted f(1e-5);
  const DeterminedFit before = f.fit;
  for (const Termination termination : {Termination::stalled, Termination::iteration_limit, Termination::diverged}) {
    f.fit.identification.termination = termination;
    EXPECT_FALSE(f.smallest().has_value());
  }
  f.fit = before;
  f.fit.candidates = f.fit.free;
  EXPECT_FALSE(f.smallest().has_value());
}

// What the way there may cost: a billionth of the misfit and a tenth of a nanometre.
TEST(MinimumNorm, IsNotTakenWhereItCostsAMisfit) {
  Fitted f(0.03);
  const DeterminedFit before = f.fit;
  const double rms = before.identification.rms;
  ASSERT_TRUE(has_converged(before.identification)) << before.identification.message;
  ASSERT_GT(rms, 0.04);
  for (const double share : {0.9, 1.1}) {
    f.fit = before;
    f.fit.identification.rms = rms - share * (1e-9 * rms + 1e-10);
    EXPECT_EQ(f.smallest().has_value(), share < 1.0) << share;
  }
}

}  // namespace
}  // namespace kdl_calibration::minimum_norm_test
