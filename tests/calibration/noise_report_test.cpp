// The noise that a result states: closed forms, chances of chi-squared, and what was drawn.

#include "calibration/noise_report.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "calibration/option_check.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "noise/lack_of_fit.hpp"
#include "refusal.hpp"
#include "uncertainty/covariance.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::noise_report_test {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using ::testing::HasSubstr;
using testing::refusal;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr const char* kNothing = "nothing was refused";

/// The odd arm, fitted at equal weights or at those of the options.
struct Fitted : testing::VirtualExperiment {
  Measurements measured;
  NoiseModel stated;
  FitOptions fit_options;
  Estimate start;
  Estimate optimum;
  std::vector<double> row_weights;
  EstimatedNoise estimated;

  explicit Fitted(const MeasuringNoise& noise = {.sigma = 1e-4}, int count = 14, bool poses = false)
      : VirtualExperiment({.model = complete_model(parse_robot(testing::kOddArm)),
                           .targets = poses ? testing::as_frames(published_targets(2)) : published_targets(2),
                           .random = Random(3)}),
        measured(testing::without_sigmas(measure(count, noise))) {
    start = nominal_start(model, measured);
    fit();
  }

  void fit() {
    fit_options.joint.residuals.noise = stated;
    estimated.as_stated = fit_options.joint.residuals;
    optimum = identify_jointly(model, measured, start, free, fit_options.joint).estimate;
  }

  FitProblem fit_problem() const {
    return {.model = model, .measurements = measured, .start = start, .free = free, .options = fit_options};
  }

  ResidualOptions residuals() const {
    ResidualOptions result = fit_options.joint.residuals;
    result.row_weights = row_weights;
    return result;
  }
  LeastSquaresProblem problem() const { return {model, measured, free, residuals()}; }
  int rank() const { return static_cast<int>(free.size()); }

  NoiseAssessment assessed(const RobustRows& robust = {}) const {
    const LeastSquaresProblem fitted = problem();
    const WhitenedSummary system = fitted.whitened_summary(optimum);
    return assess_noise({.problem = fitted,
                         .estimate = optimum,
                         .free = free,
                         .system = system,
                         .row_weights = row_weights,
                         .rank = rank()},
                        fit_problem(), stated, robust, estimated);
  }

  double freedom() const { return 3.0 * static_cast<double>(measured.observations.size()) - rank(); }
};

void expect_close(const MatrixXd& got, const MatrixXd& wanted, const std::string& what) {
  ASSERT_EQ(got.rows(), wanted.rows()) << what;
  EXPECT_GT(wanted.norm(), 0.0) << what;
  EXPECT_LT((got - wanted).norm(), 1e-9 * wanted.norm()) << what;
}

/// Repeats that vary along z by this share of what they do along x and y.
Measurements repeated(double share) {
  Random random(5);
  Measurements measured;
  measured.source = "points.csv";
  measured.targets = {"A", "B"};
  for (std::int32_t c = 0; c < 10; ++c) {
    measured.configurations.push_back(std::to_string(c));
    for (std::int32_t target = 0; target < 2; ++target) {
      for (std::int32_t repeat = 1; repeat <= 3; ++repeat) {
        const Vector3d off{random.normal(), random.normal(), share * random.normal()};
        measured.observations.push_back(
            {.reading = Point{1e-4 * off}, .configuration = c, .target = target, .repeat = repeat});
      }
    }
  }
  measured.joint_values = MatrixXd::Zero(6, 10);
  return measured;
}

TEST(NoiseReport, RepeatsMustVaryAlongEveryAxis) {
  EXPECT_EQ(refusal([] { require_repeats(repeated(0.01)); }), kNothing);
  EXPECT_THAT(refusal([] { require_repeats(repeated(1e-4)); }),
              HasSubstr("repeats of single points in points.csv do not vary along every axis"));
}

TEST(NoiseReport, OneRepeatIsARepeatAndNoneIsNone) {
  Measurements measured = repeated(1.0);
  measured.observations.resize(2);  // one degree of freedom
  EXPECT_EQ(refusal([&] { require_repeats(measured); }), kNothing);
  measured.observations.resize(1);
  EXPECT_THAT(refusal([&] { require_repeats(measured); }),
              HasSubstr("needs configurations that were measured more than once, and points.csv has none"));
}

TEST(NoiseReport, OrientationsWithASigmaNeedOneOfPositions) {
  Measurements measured = repeated(1.0);
  NoiseOptions options;
  const auto said = [&] { return refusal([&] { require_comparable_orientations(measured, options); }); };
  EXPECT_EQ(said(), kNothing) << "nothing is stated";
  options.stated.orientation = 1e-4;
  EXPECT_THAT(said(), HasSubstr("no row of points.csv has a quaternion"));
  testing::set_orientations(measured, Orientation::Identity());
  EXPECT_THAT(said(), HasSubstr("needs the noise of positions as well"));
  options.weights = Weights::repeats;
  EXPECT_EQ(said(), kNothing);
  options.weights = Weights::automatic;
  options.stated.independent.setConstant(1e-5);
  EXPECT_EQ(said(), kNothing);
  options.stated.independent.setZero();
  for (Observation& o : measured.observations) {
    EXPECT_THAT(said(), HasSubstr("or a sigma in every row")) << "a row has none";
    o.sigma = 1e-5;
  }
  EXPECT_EQ(said(), kNothing);
}

TEST(NoiseReport, NoiseIsStatedByOptionsOrARow) {
  Measurements measured = repeated(1.0);
  NoiseModel stated;
  EXPECT_FALSE(noise_is_stated(measured, stated));
  measured.observations[7].sigma = 1e-6;
  EXPECT_TRUE(noise_is_stated(measured, stated));
  measured.observations[7].sigma = 0.0;
  stated.common.x() = 1e-6;
  EXPECT_TRUE(noise_is_stated(measured, stated));
}

TEST(NoiseReport, WhatTheFitLeavesIsTheScaleOfPriors) {
  Fitted f;
  const double sigma = std::sqrt(f.problem().cost(f.optimum) / f.freedom());
  EXPECT_NEAR(sigma, 1e-4, 2e-5);
  const double found = sigma_of_residuals(f.fit_problem());
  EXPECT_NEAR(found, sigma, 1e-6 * sigma);
  f.fit_options.joint.residuals.priors = {.length = 1e-6, .angle = 1e-6};  // the rest of the options counts as well
  EXPECT_NE(sigma_of_residuals(f.fit_problem()), found);
  EXPECT_EQ(sigma_of_residuals(Fitted({.sigma = 0.0}).fit_problem()), 1e-9);
}

TEST(NoiseReport, AFitThatLeavesNoFreedomHasTheLeastScale) {
  Fitted f;
  f.measured.observations.resize(1);
  f.free = Unknowns(f.model, f.targets, {"base.Tx", "base.Ty", "base.Tz"});
  EXPECT_EQ(sigma_of_residuals(f.fit_problem()), 1e-9);
}

// Priors that say nothing leave each error to the measurements, those that say all leave them none.
TEST(NoiseReport, OnlyWhatPriorsLeaveOpenTakesFreedom) {
  const auto errors = static_cast<double>(Fitted().free.geometric().size());
  for (const auto& [prior, determined] : {std::pair{1e6, 0.0}, std::pair{1e-9, errors}}) {
    Fitted f;
    f.stated.independent.setConstant(1e-4);
    f.fit_options.joint.residuals.priors = {.length = prior, .angle = prior};
    f.fit();
    EXPECT_NEAR(f.assessed().report.degrees_of_freedom, f.freedom() + determined, 1e-2) << prior;
  }
}

// The errors were drawn as the priors say, so that neither they nor the residuals are larger than stated.
TEST(NoiseReport, ErrorsAsLargeAsThePriorsExpectAreNoNoise) {
  for (const int count : {5, 6, 8, 14}) {
    Fitted f({.sigma = 1e-4}, count);
    f.stated.independent.setConstant(1e-4);
    f.fit_options.joint.residuals.priors = {.length = 0.001, .angle = 0.001};
    f.fit();
    EXPECT_EQ(f.assessed().report.variance_factor, 1.0) << count;
  }
}

TEST(NoiseReport, OfNothingStatedIsWhatResidualsAndRepeatsShow) {
  for (const int repeats : {1, 3}) {
    const Fitted f({.sigma = 1e-4, .repeats = repeats, .common = Vector3d::Constant(2e-4)});
    const NoiseAssessment got = f.assessed();
    EXPECT_EQ(got.report.source, NoiseSource::residuals);
    EXPECT_NEAR(got.report.sigma, std::sqrt(f.problem().cost(f.optimum) / f.freedom()), 1e-12);
    EXPECT_EQ(got.report.degrees_of_freedom, f.freedom());
    EXPECT_EQ(got.report.variance_factor, 1.0);
    EXPECT_EQ(got.report.repeats.has_value(), repeats > 1);
    EXPECT_FALSE(got.report.tracker.has_value());
    // What was drawn: 0.1 mm of each point, 0.2 mm that targets of a repeat share.
    const double shared = 2e-4 / std::sqrt(repeats);
    EXPECT_NEAR(got.report.misfit, shared, 0.6 * shared);
    EXPECT_NEAR(got.report.independent.x(), 1e-4, 1.3e-4);
    EXPECT_TRUE(got.report.independent == Vector3d::Constant(got.report.independent.x()));
    if (repeats > 1) {
      EXPECT_NEAR(got.report.repeats->common.norm() / std::sqrt(3.0), 2e-4, 4e-5);
      EXPECT_NEAR(got.report.repeats->independent.norm() / std::sqrt(3.0), 1e-4, 2e-5);
    }
  }
}

TEST(NoiseReport, OfPosesTheCovarianceIsScaledByTheResiduals) {
  const Fitted f({.sigma = 1e-4, .orientation_sigma = 3e-4}, 12, true);
  const NoiseAssessment got = f.assessed();
  const double freedom = 6.0 * static_cast<double>(f.measured.observations.size()) - f.rank();
  const LeastSquaresProblem problem = f.problem();
  EXPECT_EQ(got.report.degrees_of_freedom, freedom);
  expect_close(got.covariance,
               covariance(problem.whitened_summary(f.optimum).sqrt_information, problem.cost(f.optimum) / freedom),
               "poses");
}

/// P(chi^2 > x) of an even number of degrees of freedom: the sum of a Poisson distribution.
double chi_square_tail(int freedom, double x) {
  double term = std::exp(-0.5 * x);
  double sum = term;
  for (int k = 1; k < freedom / 2; ++k) {
    term *= 0.5 * x / k;
    sum += term;
  }
  return sum;
}

// Residuals that happen once in a thousand times under the stated noise enlarge it.
TEST(NoiseReport, OfStatedNoiseIsWhatIsStatedUnlessTheResidualsAreLarger) {
  for (const double chance : {0.5, 1.1e-3, 0.9e-3, 1e-6}) {
    Fitted f({.sigma = 1e-4, .repeats = 2});
    if (static_cast<int>(f.freedom()) % 2 == 1) {
      std::vector<std::string> names = f.free.names();
      names.pop_back();
      f.free = Unknowns(f.model, f.targets, names);
    }
    f.fit();
    double below = 0.0;
    double above = 10.0 * f.freedom();
    for (int halving = 0; halving < 100; ++halving) {
      const double middle = 0.5 * (below + above);
      (chi_square_tail(static_cast<int>(f.freedom()), middle) > chance ? below : above) = middle;
    }
    f.stated.independent.setConstant(std::sqrt(f.problem().cost(f.optimum) / above));
    f.fit();
    const NoiseAssessment got = f.assessed();
    const double factor = chance < 1e-3 ? above / f.freedom() : 1.0;
    EXPECT_EQ(got.report.source, NoiseSource::stated);
    EXPECT_NEAR(got.report.variance_factor, factor, 1e-6 * factor) << chance;
    EXPECT_LT((got.report.independent - f.stated.independent).norm(), 1e-12);
    expect_close(got.covariance, covariance(f.problem().whitened_summary(f.optimum).sqrt_information, factor),
                 "stated");
  }
}

TEST(NoiseReport, OfSigmasOfRowsIsTheirMeanSquare) {
  Fitted f({.sigma = 1e-4, .repeats = 2});
  f.stated.independent = Vector3d(1.0, 1.2, 0.9) * 2e-4;
  f.stated.common = Vector3d(2e-5, 4e-5, 6e-5);
  f.measured.observations[3].sigma = 2.6e-4;
  f.fit();
  const NoiseReport report = f.assessed().report;
  const double rows = static_cast<double>(f.measured.observations.size());
  const Vector3d squares = (rows - 1.0) * f.stated.independent.cwiseAbs2() + Vector3d::Constant(2.6e-4 * 2.6e-4);
  EXPECT_LT((report.independent - (squares / rows).cwiseSqrt()).norm(), 1e-12);
  EXPECT_TRUE(report.common == f.stated.common);
  EXPECT_EQ(report.variance_factor, 1.0);
}

TEST(NoiseReport, NamesTheTrackerWhereNoRowHasASigmaOfItsOwn) {
  Fitted f;
  f.stated.tracker = TrackerNoise{.range = 1e-4, .transverse = 1e-4};
  f.fit();
  EXPECT_TRUE(f.assessed().report.tracker.has_value());
  f.measured.observations[4].sigma = 1e-4;
  EXPECT_FALSE(f.assessed().report.tracker.has_value());
}

TEST(NoiseReport, RowsWithoutWeightAreNoneOfTheStatedNoise) {
  Fitted f;
  f.stated.independent.setConstant(1e-5);
  f.fit();
  f.row_weights.assign(f.measured.observations.size(), 0.25);
  EXPECT_NEAR(f.assessed().report.variance_factor, f.problem().cost(f.optimum) / f.freedom(), 1e-6);
}

TEST(NoiseReport, AsManyEquationsAsUnknownsLeaveNoNoise) {
  Fitted f({.sigma = 1e-4}, 14);
  const LeastSquaresProblem problem = f.problem();
  const WhitenedSummary system = problem.whitened_summary(f.optimum);
  const NoiseAssessment got = assess_noise({.problem = problem,
                                            .estimate = f.optimum,
                                            .free = f.free,
                                            .system = system,
                                            .row_weights = f.row_weights,
                                            .rank = static_cast<int>(problem.equations())},
                                           f.fit_problem(), f.stated, {}, f.estimated);
  EXPECT_EQ(got.report.degrees_of_freedom, 0.0);
  EXPECT_EQ(got.report.sigma, 0.0);
}

TEST(NoiseReport, PartsAreReportedAsTheyWereEstimated) {
  Fitted f;
  const Eigen::Index columns = f.free.size();
  Random random(8);
  const auto drawn = [&] {
    const MatrixXd root = MatrixXd::NullaryExpr(columns, columns, [&] { return random.normal(); });
    return MatrixXd(root * root.transpose());
  };
  NoiseParts& parts = f.estimated.parts.emplace();
  parts.variances = NoiseParts::Variances::LinSpaced(1e-10, 9e-10);
  parts.degrees_of_freedom = 37.5;
  parts.sensitivity.resize(NoiseParts::kCount);
  parts.sensitivity[1] = drawn();
  parts.sensitivity[5] = drawn();
  const MatrixXd promised = covariance(f.problem().whitened_summary(f.optimum).sqrt_information, 1.0);
  NoiseAssessment got = f.assessed();
  EXPECT_EQ(got.report.source, NoiseSource::parts);
  EXPECT_NEAR(got.report.misfit, std::sqrt(1e-10), 1e-15);
  EXPECT_NEAR(got.report.target_misfit, std::sqrt(2e-10), 1e-15);
  EXPECT_LT((got.report.common - Vector3d(3e-10, 4e-10, 5e-10).cwiseSqrt()).norm(), 1e-15);
  EXPECT_LT((got.report.independent - Vector3d(6e-10, 7e-10, 8e-10).cwiseSqrt()).norm(), 1e-15);
  EXPECT_NEAR(got.report.sigma, std::sqrt(1e-10 + 2e-10 + 4e-10 + 7e-10), 1e-15);
  EXPECT_EQ(got.report.degrees_of_freedom, 37.5);
  ASSERT_TRUE(got.report.parts.has_value());
  ASSERT_EQ(got.report.covariance_derivatives.size(), 9U);
  for (std::size_t k = 0; k < 9; ++k) {
    if (k == 1 || k == 5) {
      expect_close(got.report.covariance_derivatives[k], promised * parts.sensitivity[k] * promised,
                   "slope " + std::to_string(k));
    } else {
      EXPECT_EQ(got.report.covariance_derivatives[k].size(), 0) << k;
    }
  }
  expect_close(got.covariance, promised, "by the weights");
  parts.scatter = drawn();
  expect_close(f.assessed().covariance, promised * parts.scatter * promised, "by the scatter");
}

// How wide its intervals are is told by noise_parts_test.cpp, by Monte Carlo.
TEST(NoiseReport, OfARobustFitIsThatOfTheRowsThatAreNotOutliers) {
  for (const double stated : {0.0, 0.5e-4, 2e-4}) {
    Fitted f({.sigma = 1e-4}, 30);
    for (const std::size_t row : {4U, 17U, 33U}) {
      f.measured.observations[row].position().x() += 0.01;
    }
    f.stated.independent.setConstant(stated);
    f.fit_options.joint.residuals.noise = f.stated;
    f.fit_options.loss = Loss::tukey;
    const RobustIdentification found = identify_robustly(
        {.model = f.model, .measurements = f.measured, .start = f.start, .free = f.free, .options = f.fit_options});
    f.optimum = found.fit.estimate;
    const NoiseReport report = f.assessed({.weights = found.weights, .scale = found.scale}).report;
    EXPECT_EQ(report.source, stated > 0.0 ? NoiseSource::stated : NoiseSource::residuals);
    const double sigma = report.sigma * std::sqrt(report.variance_factor);
    EXPECT_NEAR(sigma, stated > 1e-4 ? stated : 1e-4, 2e-5) << stated;
    EXPECT_EQ(report.variance_factor > 1.0, stated == 0.5e-4) << stated;
  }
}

TEST(NoiseReport, VarianceOfUnitWeightIsTheMeanOverWhatWasMeasured) {
  Random random(9);
  const MatrixXd sqrt_information =
      MatrixXd::NullaryExpr(4, 4, [&] { return random.normal(); }).triangularView<Eigen::Upper>();
  MatrixXd covariance = 3.0 * (sqrt_information.transpose() * sqrt_information).inverse();
  EXPECT_NEAR(variance_of_unit_weight(sqrt_information, covariance), 3.0, 1e-9);
  covariance(2, 2) = kInfinity;
  EXPECT_EQ(variance_of_unit_weight(sqrt_information, covariance), 1.0);
  const MatrixXd unequal = Eigen::Vector2d(1.0, 2.0).asDiagonal();
  EXPECT_NEAR(variance_of_unit_weight(unequal, Eigen::Vector2d(3.0, 5.0).asDiagonal()), (3.0 + 4.0 * 5.0) / 2.0, 1e-12);
  EXPECT_EQ(variance_of_unit_weight(MatrixXd(0, 0), MatrixXd(0, 0)), 1.0);
  EXPECT_NEAR(variance_of_unit_weight(MatrixXd::Constant(1, 1, 2.0), MatrixXd::Constant(1, 1, 3.0)), 12.0, 1e-12);
}

TEST(NoiseReport, OnlyStatedNoiseThatHoldsIsKnownForSure) {
  NoiseReport noise;
  noise.degrees_of_freedom = 12.0;
  for (const auto& [source, factor, freedom] :
       {std::tuple{NoiseSource::stated, 1.0, kInfinity}, std::tuple{NoiseSource::stated, 1.5, 12.0},
        std::tuple{NoiseSource::residuals, 1.0, 12.0}, std::tuple{NoiseSource::parts, 1.5, 12.0}}) {
    noise.source = source;
    noise.variance_factor = factor;
    EXPECT_EQ(noise.freedom_of_covariance(), freedom) << to_string(source) << factor;
  }
}

TEST(NoiseReport, LackOfFitSaysWhichJointExplainsIt) {
  const Fitted once;
  EXPECT_FALSE(lack_of_fit(once.model, once.measured, once.optimum, once.free).has_value());
  Fitted f({.sigma = 1e-4, .repeats = 3}, 60);
  for (Observation& o : f.measured.observations) {
    const double q = f.measured.joint_values(2, o.configuration);
    o.position() += 1e-3 * Vector3d(std::sin(q), -std::cos(q), 0.0);
  }
  const std::optional<LackOfFit> lack = lack_of_fit(f.model, f.measured, f.optimum, f.free);
  ASSERT_TRUE(lack.has_value());
  EXPECT_LT(lack->p_value, 1e-10);
  const std::vector<double>& explained = lack->explained_by_joint;
  ASSERT_EQ(explained.size(), 5U);
  EXPECT_EQ(std::max_element(explained.begin(), explained.end()) - explained.begin(), 2);
  EXPECT_GT(explained[2], 0.9);
}

}  // namespace
}  // namespace kdl_calibration::noise_report_test
