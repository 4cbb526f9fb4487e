#include "calibration/noise_stage.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "dense_fit.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "planning/simulation.hpp"
#include "validation/validation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::noise_stage_test {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// What a rotation vector changes by where the frame turns in its own axes (Solà et al. 2018, eq. 144).
Matrix3d inverse_right_jacobian(const Vector3d& r) {
  Matrix3d S;
  S << 0.0, -r.z(), r.y(), r.z(), 0.0, -r.x(), -r.y(), r.x(), 0.0;
  const double angle = r.norm();
  const double factor =
      angle > 0.0 ? 1.0 / (angle * angle) - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle)) : 1.0 / 12.0;
  return Matrix3d::Identity() + 0.5 * S + factor * S * S;
}

struct Printed {
  ErrorModel model = complete_model(testing::fanuc());
  Estimate estimate;
  Unknowns free;
  MatrixXd turns;       // what the printed values change by per unit of the columns
  MatrixXd covariance;  // of the columns

  Printed(const Vector3d& of_base, const Vector3d& of_target, const std::vector<std::string>& names) {
    estimate.errors = testing::errors_of(model);
    estimate.frames.targets = testing::as_frames(published_targets(2));
    estimate.frames.base().linear() = testing::turned_by(of_base);
    estimate.frames.targets[1].X_FT.linear() = testing::turned_by(of_target);
    free = Unknowns(model, estimate.frames.targets, names);
    turns = MatrixXd::Identity(free.size(), free.size());
    put("base.T", estimate.frames.base().linear());
    put("base.R", inverse_right_jacobian(of_base));
    put("A.R", inverse_right_jacobian(Vector3d::Zero()));
    put("B.R", inverse_right_jacobian(of_target));
    Random random(3);
    const MatrixXd root = MatrixXd::NullaryExpr(free.size(), free.size(), [&] { return random.normal(); });
    covariance = root * root.transpose();
  }

  void put(const std::string& stem, const Matrix3d& block) {
    for (Index i = 0; i < 3; ++i) {
      for (Index j = 0; j < 3; ++j) {
        const auto row = free.column(stem + "xyz"[i]);
        const auto column = free.column(stem + "xyz"[j]);
        if (row && column) {
          turns(*row, *column) = block(i, j);
        }
      }
    }
  }
};

const std::vector<std::string> kNames = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz", "A.x",
                                         "A.z",     "A.Rx",    "A.Ry",    "A.Rz",    "B.x",     "B.y",     "B.z",
                                         "B.Rx",    "B.Ry",    "B.Rz",    "dq2",     "Tx1",     "Rz3"};
const std::vector<std::string> kSomeNames = {"base.Ty", "base.Tz", "base.Rx", "base.Rz", "B.y", "B.Ry", "B.Rz", "dq2"};

NoiseReport unstated(double freedom) {
  NoiseReport noise;
  noise.source = NoiseSource::residuals;
  noise.degrees_of_freedom = freedom;
  return noise;
}

TEST(Uncertainties, AreThoseOfTheValuesAsTheyArePrinted) {
  for (const auto& [of_base, of_target] : {std::pair(Vector3d(0.3, -0.2, 1.1), Vector3d(-1.0, 0.8, 2.0)),
                                           {Vector3d(0.2, 0.3, -0.4), Vector3d::Zero()},
                                           {Vector3d(3e-5, 5e-5, -6e-5), Vector3d(4e-3, 0.0, 3e-3)}}) {
    for (const auto& names : {kNames, kSomeNames}) {
      const Printed printed(of_base, of_target, names);
      const VectorXd variances = (printed.turns * printed.covariance * printed.turns.transpose()).diagonal();
      const auto found = uncertainties(printed.estimate, printed.free, printed.covariance, unstated(9.0));
      ASSERT_EQ(found.size(), static_cast<std::size_t>(variances.size()));
      for (Index c = 0; c < variances.size(); ++c) {
        const ValueUncertainty& value = found[static_cast<std::size_t>(c)];
        EXPECT_NEAR(value.std / std::sqrt(variances[c]), 1.0, 1e-10) << names[static_cast<std::size_t>(c)];
        EXPECT_EQ(value.degrees_of_freedom, 9.0);
      }
    }
  }
}

TEST(Uncertainties, OfWhatIsNotDeterminedSpreadToNothingElse) {
  Printed printed({0.3, -0.2, 1.1}, {-1.0, 0.8, 2.0}, kNames);
  const MatrixXd known = printed.covariance;
  for (const std::string name : {"base.Rz", "A.x"}) {
    const Index unknown = *printed.free.column(name);
    printed.covariance = known;
    printed.covariance.row(unknown).setConstant(kInfinity);
    printed.covariance.col(unknown).setConstant(kInfinity);
    const auto found = uncertainties(printed.estimate, printed.free, printed.covariance, unstated(9.0));
    const auto before = uncertainties(printed.estimate, printed.free, known, unstated(9.0));
    for (std::size_t c = 0; c < found.size(); ++c) {
      const std::string& column = printed.free.columns()[c].name;
      if (column == name || (name == "base.Rz" && column.rfind("base.R", 0) == 0)) {
        EXPECT_EQ(found[c].std, kInfinity) << column;
      } else {
        EXPECT_NEAR(found[c].std / before[c].std, 1.0, 1e-12) << column;
      }
    }
  }
}

TEST(Uncertainties, RestOnTheFreedomOfThePartsThatTheyDependOn) {
  const Printed printed({0.3, -0.2, 1.1}, {-1.0, 0.8, 2.0}, kNames);
  NoiseReport noise = unstated(9.0);
  NoiseParts parts;
  parts.covariance.diagonal().setLinSpaced(1.0, 2.0);
  noise.parts = parts;
  noise.covariance_derivatives.resize(NoiseParts::kCount);
  Random random(8);
  for (const std::size_t k : {0U, 3U, 8U}) {
    const MatrixXd root =
        MatrixXd::NullaryExpr(printed.free.size(), printed.free.size(), [&] { return random.normal(); });
    noise.covariance_derivatives[k] = root * root.transpose();
  }
  MatrixXd covariance = printed.covariance;
  const Index unknown = *printed.free.column("A.z");
  covariance(unknown, unknown) = kInfinity;
  const auto found = uncertainties(printed.estimate, printed.free, covariance, noise);
  for (Index c = 0; c < printed.free.size(); ++c) {
    const VectorXd row = printed.turns.row(c);
    NoiseParts::Variances gradient = NoiseParts::Variances::Zero();
    for (const Index k : {0, 3, 8}) {
      gradient[k] = row.dot(noise.covariance_derivatives[static_cast<std::size_t>(k)] * row);
    }
    const double variance = row.dot(printed.covariance * row);
    const double expected =
        c == unknown ? 9.0 : 2.0 * variance * variance / gradient.cwiseAbs2().dot(parts.covariance.diagonal());
    EXPECT_NEAR(found[static_cast<std::size_t>(c)].degrees_of_freedom / expected, 1.0, 1e-9) << c;
  }
}

Measurements of_repeats(int repeats, double sigma) {
  static const testing::VirtualExperiment arm;
  testing::VirtualExperiment experiment = arm;
  Measurements measured = experiment.measure(6, {.repeats = repeats});
  for (Observation& o : measured.observations) {
    o.sigma = sigma;
  }
  return measured;
}

TEST(NoiseOfMeans, IsOfARowWhatItsMeanIsOffByWhereNothingIsStated) {
  for (const int repeats : {1, 4}) {
    const NoiseModel found = noise_of_means(of_repeats(repeats, 0.0), {}, 3e-5);
    EXPECT_LT((found.independent - Vector3d::Constant(3e-5 * std::sqrt(repeats))).norm(), 1e-18);
    EXPECT_EQ(found.target_misfit, 0.0);
  }
  Measurements some = of_repeats(2, 0.0);
  some.observations.resize(27);  // of eighteen means
  EXPECT_NEAR(noise_of_means(some, {}, 2e-5).independent.x(), 2e-5 * std::sqrt(27.0 / 15.0), 1e-18);
}

// What is left of three times the stated variance is a misfit of twice that.
TEST(NoiseOfMeans, IsTheStatedOneAndAMisfitWhereTheRestIsClearlyLarger) {
  NoiseBeforehand options;
  options.stated.independent.setConstant(2e-5);
  for (const int repeats : {1, 4}) {
    const Measurements measured = of_repeats(repeats, 0.0);
    const double sigma = 2e-5 / std::sqrt(repeats);
    const NoiseModel below = noise_of_means(measured, options, 1.05 * sigma);
    EXPECT_EQ(below.target_misfit, 0.0);
    EXPECT_EQ(below.independent, options.stated.independent);
    const NoiseModel above = noise_of_means(measured, options, std::sqrt(3.0) * sigma);
    EXPECT_NEAR(above.target_misfit, std::sqrt(2.0) * sigma, 1e-12);
    EXPECT_EQ(above.independent, options.stated.independent);
  }
  const Measurements of_rows = of_repeats(2, 5e-5);
  EXPECT_NEAR(noise_of_means(of_rows, {}, 1e-4).target_misfit, std::sqrt(1e-8 - 25e-10 / 2.0), 1e-12);
}

TEST(NoiseOfMeans, HasNoMisfitWhereNoneIsToBeEstimated) {
  const Measurements measured = of_repeats(1, 1e-5);
  for (const bool estimated : {true, false}) {
    EXPECT_EQ(noise_of_means(measured, {.stated = {}, .estimated = estimated}, 1e-3).target_misfit > 0.0, estimated);
  }
}

// What all targets of a repeat share, and what no geometry explains: joint 3 is off by this [rad] times sin(2 q3).
struct Noisy : testing::VirtualExperiment {
  Measurements measured;
  NoiseBeforehand beforehand;
  FitOptions fit_options;
  Estimate start;

  explicit Noisy(std::uint64_t seed, double common, double swing, int count = 16) : VirtualExperiment(arm()) {
    restart(Random(seed));
    const MatrixXd q = configurations(count);
    MatrixXd real = q;
    real.row(2).array() += swing * (2.0 * q.row(2).array()).sin();
    measured = testing::without_sigmas(
        measure(real, {.sigma = 1e-5, .repeats = 2, .common = Vector3d(common, common, 0.3 * common)}));
    measured.joint_values = q;
    start = nominal_start(model, measured);
  }

  static const VirtualExperiment& arm() {
    static const VirtualExperiment experiment;
    return experiment;
  }

  FitProblem nominal() const {
    return {.model = model, .measurements = measured, .start = start, .free = free, .options = fit_options};
  }

  FitProblem problem(const NoiseModel& noise) const {
    FitProblem result = nominal();
    result.options.joint.residuals.noise = noise;
    result.start = kdl_calibration::fit(result).estimate;
    return result;
  }

  NoiseParts parts() const { return estimate_noise(model, measured, problem({}).start, free, {}); }

  // Of left-out configurations by refits: weighed by the parts over weighed alike.
  double harm() const {
    const auto rms = [&](const NoiseModel& noise) {
      return error_statistics(cross_validate(problem(noise), make_folds(measured, 0), 1).distances).rms;
    };
    return rms(parts().model({})) / rms({});
  }
};

void expect_same(const NoiseModel& found, const NoiseModel& expected) {
  EXPECT_LT((found.independent - expected.independent).norm(), 1e-3 * expected.independent.norm());
  EXPECT_LT((found.common - expected.common).norm(), 1e-3 * expected.common.norm() + 1e-12);
  EXPECT_NEAR(found.misfit, expected.misfit, 1e-3 * expected.misfit + 1e-9);
  EXPECT_NEAR(found.target_misfit, expected.target_misfit, 1e-3 * expected.target_misfit + 1e-9);
}

// The plain fit, and the fit with the noise that its residuals show.
struct TwoFits {
  Identification plain;
  EstimatedNoise found;

  explicit TwoFits(const Noisy& noisy) {
    plain = identify_jointly(noisy.model, noisy.measured, noisy.start, noisy.free);
    FitProblem problem = noisy.nominal();
    problem.start = plain.estimate;
    found = fit_with_estimated_noise(problem, noisy.beforehand, plain.rms);
  }
};

// Seeds of which some are helped by the weights and some are harmed.
TEST(EstimatedNoise, WeighsRowsUnlessThatPredictsLeftOutConfigurationsWorse) {
  int harmed = 0;
  int helped = 0;
  for (const std::uint64_t seed : {1U, 2U}) {
    const Noisy noisy(seed, 6e-5, 0.0015);
    const double harm = noisy.harm();
    SCOPED_TRACE("seed " + std::to_string(seed) + ", harm " + std::to_string(harm));
    ASSERT_GT(std::abs(harm - 1.0), 0.02);
    (harm > 1.0 ? harmed : helped) += 1;
    const std::optional<NoiseModel> for_choice = weights_by_estimated_noise(noisy.nominal(), noisy.beforehand);
    ASSERT_EQ(for_choice.has_value(), harm < 1.0);
    const auto [plain, found] = TwoFits(noisy);
    ASSERT_TRUE(found.parts.has_value());
    EXPECT_TRUE(found.as_stated.noise.independent.isZero(0.0));
    if (harm < 1.0) {
      const NoiseModel expected = noisy.parts().model({});
      expect_same(*for_choice, expected);
      expect_same(found.weights, expected);
      const Estimate weighed = noisy.problem(found.weights).start;
      EXPECT_LT((found.estimate.errors - weighed.errors).norm(), 1e-8);
      EXPECT_GT((plain.estimate.errors - weighed.errors).norm(), 1e-6);
      EXPECT_EQ(found.parts->scatter.size(), 0);
    } else {
      EXPECT_FALSE(found.weights.is_absolute());
      EXPECT_EQ(found.estimate.errors, plain.estimate.errors);
      const NoiseParts beside = noise_beside_weights(noisy.problem({}), {}, true);
      EXPECT_LT((found.parts->variances - beside.variances).norm(), 1e-3 * beside.variances.norm());
      EXPECT_GT(found.parts->scatter.size(), 0);
    }
  }
  EXPECT_EQ(harmed, 1);
  EXPECT_EQ(helped, 1);
}

// Priors that are so wide that they tell nothing; the weights do less harm than may be chance.
TEST(EstimatedNoise, MayHarmALittleBesidePriors) {
  Noisy noisy(1, 6e-5, 0.0015);
  const double harm = noisy.harm();
  ASSERT_GT(harm, 1.02);
  ASSERT_LT(harm, 1.08);
  ResidualOptions& residuals = noisy.fit_options.joint.residuals;
  residuals.priors = {.length = 10.0, .angle = 10.0};
  const EstimatedNoise found = TwoFits(noisy).found;
  ASSERT_TRUE(found.parts.has_value());
  EXPECT_TRUE(found.weights.is_absolute());
  residuals.priors = {};
  EXPECT_FALSE(TwoFits(noisy).found.weights.is_absolute());
}

TEST(EstimatedNoise, IsNoneWhereItIsNotAskedForOrTheFitLeavesRounding) {
  Noisy noisy(1, 1e-4, 0.0);
  for (const bool asked : {true, false}) {
    noisy.beforehand.estimated = asked;
    EXPECT_EQ(weights_by_estimated_noise(noisy.nominal(), noisy.beforehand).has_value(), asked);
    EXPECT_EQ(TwoFits(noisy).found.parts.has_value(), asked);
  }
  EXPECT_FALSE(fit_with_estimated_noise(noisy.problem({}), {}, 1e-13).parts.has_value());
}

// Nothing is left to estimate where residuals are as small as the stated noise.
TEST(EstimatedNoise, IsNothingWhereWhatIsStatedHolds) {
  Noisy noisy(3, 0.0, 0.0);
  noisy.measured = subset(noisy.measured, [](const Observation& o) { return o.repeat == 1; });
  noisy.beforehand.stated.independent.setConstant(2e-5);
  noisy.fit_options.joint.residuals.noise = noisy.beforehand.stated;
  EXPECT_FALSE(weights_by_estimated_noise(noisy.nominal(), noisy.beforehand).has_value());
  const EstimatedNoise found = TwoFits(noisy).found;
  EXPECT_FALSE(found.parts.has_value());
  EXPECT_EQ(found.as_stated.noise.independent, noisy.beforehand.stated.independent);
  EXPECT_EQ(found.weights.independent, noisy.beforehand.stated.independent);
}

}  // namespace
}  // namespace kdl_calibration::noise_stage_test
