#include "noise/noise_strata.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "estimation/prediction.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "model/kinematics.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::noise_strata_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::VirtualExperimentOptions;
using Variances = NoiseParts::Variances;

/// Some rows of a virtual experiment, and an estimate that is not the truth.
struct Trial {
  testing::VirtualExperiment experiment;
  Measurements measured;
  ResidualOptions options;
  Unknowns free;
  Estimate estimate;

  explicit Trial(int configurations, const MeasuringNoise& noise = {.sigma = 1e-4, .repeats = 3},
                 const VirtualExperimentOptions& arm = {})
      : experiment(arm),
        measured(experiment.measure(configurations, noise)),
        free(experiment.model, experiment.targets, {"base.Tx", "base.Rz", "A.x", "B.y"}),
        estimate(experiment.robot.truth) {
    estimate.frames.base().translation().y() += 2e-4;
    estimate.frames.targets[1].X_FT.translation().x() += 1e-4;
  }
};

/// As they may come: without some targets and repeats, and in no order.
Trial irregular() {
  Trial trial(14);
  Random random(31);
  trial.measured = subset(trial.measured, [&](const Observation& o) {
    const int c = o.configuration;
    return (c < 4 || o.target != 2 || o.repeat != 2) && (c % 4 != 1 || o.target == c % 3) &&
           (c != 2 || o.target != 0) && (c % 5 != 3 || o.repeat == 1) && random.uniform(0.0, 1.0) < 0.9;
  });
  std::vector<Observation>& rows = trial.measured.observations;
  for (std::size_t i = rows.size(); i > 1; --i) {
    std::swap(rows[i - 1], rows[random.bits() % i]);
  }
  return trial;
}

std::vector<Stratum> strata_of(const Trial& t, const Measurements& measured, const ResidualOptions& options) {
  NoiseStrata strata(measured, options);
  strata.add_means(t.experiment.model, t.estimate, t.free);
  return strata.finished();
}

/// The same rows as the estimate predicts them, with noise whose parts have these variances.
Measurements drawn(const Trial& t, const Variances& parts, Random& random) {
  const auto normal = [&] { return Vector3d{random.normal(), random.normal(), random.normal()}; };
  const Vector3d common = parts.segment<3>(NoiseParts::kCommon).cwiseSqrt();
  const Vector3d independent = parts.segment<3>(NoiseParts::kIndependent).cwiseSqrt();
  const auto X_BF = flange_poses(t.experiment.model, t.estimate, t.measured);
  std::map<int, Vector3d> of_configuration;
  std::map<std::pair<int, int>, Vector3d> of_target;
  std::map<std::pair<int, int>, Vector3d> of_repeat;
  Measurements measured = t.measured;
  for (Observation& o : measured.observations) {
    o.position() = predicted_point(t.estimate, X_BF, o) + independent.cwiseProduct(normal());
    o.position() +=
        std::sqrt(parts[NoiseParts::kMisfit]) * of_configuration.try_emplace(o.configuration, normal()).first->second;
    o.position() += std::sqrt(parts[NoiseParts::kTargetMisfit]) *
                    of_target.try_emplace({o.configuration, o.target}, normal()).first->second;
    o.position() += common.cwiseProduct(of_repeat.try_emplace({o.configuration, o.repeat}, normal()).first->second);
  }
  return measured;
}

// Configurations of one to three targets in one to three repeats, every target in every repeat. Squares of a stratum
// are count times lambda by expectation, and scatter by sqrt(2 / count) of that.
TEST(NoiseStrata, SquaresAreOnAverageWhatTheCoefficientsSay) {
  Trial trial(36);
  trial.free = Unknowns(trial.experiment.model, trial.experiment.targets, {});
  trial.measured = subset(testing::without_sigmas(trial.measured), [](const Observation& o) {
    return o.target <= o.configuration % 3 && o.repeat <= 1 + o.configuration / 3 % 3;
  });
  Variances parts;
  parts << 4.0, 2.0, 9.0, 1.0, 3.0, 5.0, 8.0, 2.0, 0.0;
  parts *= 1e-10;
  for (const bool stated : {false, true}) {
    ResidualOptions options;
    Variances unknown = parts;
    if (stated) {
      options.noise.independent = parts.segment<3>(NoiseParts::kIndependent).cwiseSqrt();
      unknown.segment<3>(NoiseParts::kIndependent).setZero();
    }
    constexpr int kRuns = 400;
    Random random(17);
    std::vector<double> squares;
    std::vector<Stratum> strata;
    for (int run = 0; run < kRuns; ++run) {
      strata = strata_of(trial, drawn(trial, parts, random), options);
      squares.resize(strata.size(), 0.0);
      for (std::size_t s = 0; s < strata.size(); ++s) {
        squares[s] += strata[s].squares / kRuns;
      }
    }
    EXPECT_GT(strata.size(), 20U);
    for (std::size_t s = 0; s < strata.size(); ++s) {
      const double expected = strata[s].count * (strata[s].known + strata[s].coefficients.dot(unknown));
      EXPECT_NEAR(squares[s] / expected, 1.0, 5.0 * std::sqrt(2.0 / (kRuns * strata[s].count))) << s << ", " << stated;
    }
  }
}

// Contrasts are a rotation of the means: together they say what the means say.
TEST(NoiseStrata, OfMeansAddUpToTheEquationsOfTheMeans) {
  const Trial trial = irregular();
  const Measurements measured = testing::without_sigmas(trial.measured);
  const NormalEquations expected =
      LeastSquaresProblem(trial.experiment.model, averaged(measured), trial.free).linearise(trial.estimate);
  MatrixXd information = MatrixXd::Zero(trial.free.size(), trial.free.size());
  VectorXd gradient = VectorXd::Zero(trial.free.size());
  double squares = 0.0;
  for (const Stratum& stratum : strata_of(trial, measured, {})) {
    if (stratum.is_of_means()) {
      information += stratum.information;
      gradient += stratum.gradient;
      squares += stratum.squares;
    }
  }
  EXPECT_LT((information - expected.hessian).norm(), 1e-11 * information.norm());
  EXPECT_LT((gradient - expected.gradient).norm(), 1e-9 * gradient.norm());
  EXPECT_NEAR(squares, expected.cost, 1e-9 * squares);
}

TEST(NoiseStrata, ARowOfNoWeightIsAsGoodAsNotThere) {
  for (const auto& [weight, counts] : {std::pair{2e-6, true}, {1e-6, false}, {5e-7, false}, {0.0, false}}) {
    Trial trial(2, {.sigma = 1e-4, .repeats = 2});
    trial.options.row_weights.assign(trial.measured.observations.size(), 1.0);
    trial.options.row_weights[3] = weight;
    EXPECT_EQ(NoiseStrata(trial.measured, trial.options).repeat_freedom(), counts ? 6.0 : 5.0) << weight;
    if (!counts) {
      Measurements without = trial.measured;
      without.observations.erase(without.observations.begin() + 3);
      const std::vector<Stratum> found = strata_of(trial, trial.measured, trial.options);
      const std::vector<Stratum> expected = strata_of(trial, without, {});
      ASSERT_EQ(found.size(), expected.size()) << weight;
      for (std::size_t s = 0; s < found.size(); ++s) {
        EXPECT_EQ(found[s].count, expected[s].count) << weight;
        EXPECT_NEAR(found[s].squares, expected[s].squares, 1e-12 * expected[s].squares) << weight;
        EXPECT_LT((found[s].coefficients - expected[s].coefficients).norm(), 1e-12) << weight;
      }
    }
  }
}

/// Rows of configuration, target and repeat.
Measurements rows_of(const std::vector<std::array<int, 3>>& places, double sigma = 0.0) {
  Measurements measured;
  for (const auto& [configuration, target, repeat] : places) {
    const auto at = static_cast<double>(measured.observations.size());
    measured.observations.push_back({.reading = Point{Vector3d(at, -at * at, std::sin(at))},
                                     .sigma = sigma,
                                     .configuration = configuration,
                                     .target = target,
                                     .repeat = repeat});
  }
  return measured;
}

struct Layout {
  std::string name;
  std::vector<std::array<int, 3>> places;
  bool several_targets = false;
  bool separates_common = false;
  double repeat_freedom = 0.0;
};

TEST(NoiseStrata, SeeWhatALayoutCanSeparate) {
  const std::vector<Layout> layouts = {
      {"one row", {{0, 0, 1}}},
      {"a target here, a target there", {{0, 0, 1}, {1, 1, 1}}},
      {"two targets at last", {{0, 0, 1}, {1, 0, 1}, {1, 1, 1}}, true},
      {"two targets at first", {{0, 0, 1}, {0, 1, 1}, {1, 1, 1}}, true},
      {"repeats of one target", {{0, 0, 1}, {0, 0, 2}, {0, 0, 3}}, false, false, 2.0},
      {"three rows of two repeats", {{0, 0, 1}, {0, 0, 2}, {0, 1, 1}}, true, false, 1.0},
      {"two targets, two repeats", {{0, 0, 1}, {0, 0, 2}, {0, 1, 1}, {0, 1, 2}}, true, true, 2.0},
      {"the same, then one target",
       {{0, 0, 1}, {0, 0, 2}, {0, 1, 1}, {0, 1, 2}, {1, 0, 1}, {1, 0, 2}},
       true,
       true,
       3.0},
      {"one target, then the same",
       {{0, 0, 1}, {0, 0, 2}, {1, 0, 1}, {1, 0, 2}, {1, 1, 1}, {1, 1, 2}},
       true,
       true,
       3.0},
      {"targets in repeats of their own", {{0, 0, 1}, {0, 0, 2}, {0, 1, 3}, {0, 1, 4}}, true, false, 2.0}};
  for (const Layout& layout : layouts) {
    const Measurements measured = rows_of(layout.places);
    const NoiseStrata strata(measured, {});
    const MatrixXd parts = strata.unknown_parts(PartsAsked::all);
    EXPECT_EQ(!parts.row(NoiseParts::kMisfit).isZero(), layout.several_targets) << layout.name;
    EXPECT_EQ(!parts.row(NoiseParts::kCommon).isZero(), layout.separates_common) << layout.name;
    EXPECT_EQ(strata.repeat_freedom(), layout.repeat_freedom) << layout.name;
    EXPECT_FALSE(strata.stated()) << layout.name;
    EXPECT_TRUE(strata.mean_known().isZero(0.0)) << layout.name;
  }
}

TEST(NoiseStrata, KnowTheMeanOfStatedVariances) {
  Measurements measured = rows_of({{0, 0, 1}, {0, 1, 1}, {1, 0, 1}, {1, 0, 2}});
  for (std::size_t i = 0; i < 4; ++i) {
    measured.observations[i].sigma = static_cast<double>(i + 1);
  }
  const NoiseStrata by_row(measured, {});
  EXPECT_TRUE(by_row.mean_known().isApprox(Vector3d::Constant(30.0 / 4.0), 1e-15));
  const ResidualOptions tracker{
      .noise = {.tracker = TrackerNoise{.range = 2.0, .transverse = 3.0}, .common = Vector3d::Ones()}};
  const Measurements along_x = [] {
    Measurements one = rows_of({{0, 0, 1}});
    one.observations[0].position() = Vector3d(5.0, 0.0, 0.0);
    return one;
  }();
  EXPECT_TRUE(NoiseStrata(along_x, tracker).mean_known().isApprox(Vector3d(4.0, 9.0, 9.0), 1e-15));
}

// Which parts are in which column.
std::vector<std::set<Index>> columns_of(const MatrixXd& parts) {
  std::vector<std::set<Index>> result;
  for (Index c = 0; c < parts.cols(); ++c) {
    std::set<Index>& column = result.emplace_back();
    for (Index k = 0; k < parts.rows(); ++k) {
      EXPECT_TRUE(parts(k, c) == 0.0 || parts(k, c) == 1.0);
      if (parts(k, c) == 1.0) {
        column.insert(k);
      }
    }
  }
  EXPECT_EQ(parts.rows(), 9);
  return result;
}

// So many repeats of as many targets in one configuration, and another configuration.
Measurements repeated(int targets, int repeats) {
  std::vector<std::array<int, 3>> places;
  for (int r = 1; r <= repeats; ++r) {
    for (int t = 0; t < targets; ++t) {
      places.push_back({0, t, r});
    }
  }
  places.push_back({1, 0, 1});
  return rows_of(places);
}

using Columns = std::vector<std::set<Index>>;
const std::set<Index> kCommonOfAll = {2, 3, 4};
const std::set<Index> kIndependentOfAll = {5, 6, 7};

TEST(NoiseStrata, AskForTheAxesApartFromTwentyDegreesOfFreedomOn) {
  const auto asked = [](int targets, int repeats, PartsAsked parts) {
    const Measurements measured = repeated(targets, repeats);
    return columns_of(NoiseStrata(measured, {}).unknown_parts(parts));
  };
  EXPECT_EQ(asked(1, 20, PartsAsked::of_repeats), Columns({kIndependentOfAll})) << "19 degrees of freedom";
  EXPECT_EQ(asked(1, 21, PartsAsked::of_repeats), Columns({{5}, {6}, {7}})) << "20 degrees of freedom";
  EXPECT_EQ(asked(3, 7, PartsAsked::of_repeats), Columns({kCommonOfAll, kIndependentOfAll})) << "18";
  EXPECT_EQ(asked(2, 11, PartsAsked::of_repeats), Columns({{2}, {3}, {4}, {5}, {6}, {7}})) << "20";
}

TEST(NoiseStrata, AskForWhatNobodyStatedAndTheLayoutSeparates) {
  const auto asked = [](const Measurements& measured, PartsAsked parts, const NoiseModel& noise = {}) {
    const ResidualOptions options{.noise = noise};
    return columns_of(NoiseStrata(measured, options).unknown_parts(parts));
  };
  const NoiseModel common{.common = Vector3d(0.0, 0.0, 1.0)};
  const NoiseModel independent{.independent = Vector3d(1.0, 0.0, 0.0)};
  const Measurements one = repeated(1, 1);
  EXPECT_EQ(asked(one, PartsAsked::all), Columns({kIndependentOfAll}));
  EXPECT_EQ(asked(one, PartsAsked::all, independent), Columns({{1}}));
  EXPECT_EQ(asked(one, PartsAsked::without_misfits, independent), Columns());
  const Measurements two = repeated(2, 1);
  EXPECT_EQ(asked(two, PartsAsked::all), Columns({{0}, kIndependentOfAll}));
  EXPECT_EQ(asked(two, PartsAsked::without_misfits), Columns({kIndependentOfAll}));
  EXPECT_EQ(asked(two, PartsAsked::all, independent), Columns({{0}, {1}}));
  const Measurements repeats_of_one = repeated(1, 3);
  EXPECT_EQ(asked(repeats_of_one, PartsAsked::all), Columns({{1}, kIndependentOfAll}));
  EXPECT_EQ(asked(repeats_of_one, PartsAsked::without_misfits), Columns({kIndependentOfAll}));
  const Measurements repeats = repeated(2, 3);
  EXPECT_EQ(asked(repeats, PartsAsked::all), Columns({{0}, {1}, kCommonOfAll, kIndependentOfAll}));
  EXPECT_EQ(asked(repeats, PartsAsked::all, common), Columns({{0}, {1}, kIndependentOfAll}));
  EXPECT_EQ(asked(repeats, PartsAsked::all, independent), Columns({{0}, {1}, kCommonOfAll}));
  EXPECT_EQ(asked(repeats, PartsAsked::of_repeats, independent), Columns({kCommonOfAll}));
  Measurements poses = repeats;
  testing::set_orientations(poses, Orientation::Identity());
  EXPECT_EQ(asked(poses, PartsAsked::all), Columns({{0}, {1}, kCommonOfAll, kIndependentOfAll, {8}}));
  EXPECT_EQ(asked(poses, PartsAsked::all, {.orientation = 1e-3}), Columns({{0}, {1}, kCommonOfAll, kIndependentOfAll}));
  EXPECT_EQ(asked(poses, PartsAsked::without_misfits), Columns({kCommonOfAll, kIndependentOfAll, {8}}));
  EXPECT_EQ(asked(poses, PartsAsked::of_repeats), Columns({kCommonOfAll, kIndependentOfAll}));
}

TEST(NoiseStrata, OfOrientationsSayWhatPosesSayBeyondTheirPoints) {
  const VirtualExperimentOptions arm{.targets = testing::as_frames(published_targets())};
  Trial trial(6, {.sigma = 1e-4, .orientation_sigma = 2e-4}, arm);
  trial.free = Unknowns(trial.experiment.model, trial.experiment.targets, {"base.Tx", "base.Rz", "base.Ry", "B.Rx"});
  trial.estimate.frames.targets[1].X_FT.rotate(Eigen::AngleAxisd(1e-3, Vector3d::UnitX()));
  trial.measured = subset(testing::without_sigmas(trial.measured),
                          [](const Observation& o) { return o.configuration != 1 || o.target == 2; });
  double poses = 0.0;
  for (Observation& o : trial.measured.observations) {
    if (o.target == 0 && o.configuration % 2 == 0) {
      testing::remove_orientation(o);
    } else {
      poses += 1.0;
    }
  }
  const Measurements points = without_orientations(trial.measured);
  const ResidualOptions unit{.noise = {.independent = Vector3d::Ones(), .orientation = 1.0}};
  const auto equations = [&](const Measurements& measured) {
    return LeastSquaresProblem(trial.experiment.model, measured, trial.free, unit).linearise(trial.estimate);
  };
  const NormalEquations all = equations(trial.measured);
  const NormalEquations without = equations(points);
  const std::vector<Stratum> strata = strata_of(trial, trial.measured, {});
  const Stratum& found = strata.front();
  ASSERT_TRUE(found.is_of_orientations());
  EXPECT_FALSE(found.is_of_means());
  EXPECT_EQ(std::count_if(strata.begin(), strata.end(), [](const Stratum& s) { return s.is_of_orientations(); }), 1);
  EXPECT_EQ(found.count, 3.0 * poses);
  EXPECT_EQ(found.known, 0.0);
  EXPECT_EQ(found.coefficients[NoiseParts::kOrientation], 1.0);
  EXPECT_LT((found.information - (all.hessian - without.hessian)).norm(), 1e-9 * all.hessian.norm());
  EXPECT_LT((found.gradient - (all.gradient - without.gradient)).norm(), 1e-9 * all.gradient.norm());
  EXPECT_NEAR(found.squares, all.cost - without.cost, 1e-9 * all.cost);
}

TEST(NoiseStrata, SampleTwoThousandConfigurationsEvenlyWithTheirWeights) {
  for (const int count : {1999, 2000, 2001, 9000}) {
    Measurements measured{.joints = {"one"}, .targets = {"A", "B"}};
    ResidualOptions options{.orientation_length = 0.7};
    measured.joint_values = Eigen::RowVectorXd::LinSpaced(count, 0.0, count - 1.0);
    for (int c = 0; c < count; ++c) {
      measured.configurations.push_back(std::to_string(c));
      for (int target = 0; target <= c % 2; ++target) {
        measured.observations.push_back(
            {.reading = Point{Vector3d::Constant(c)}, .configuration = c, .target = target});
        options.row_weights.push_back(static_cast<double>(c) + 0.5 * target);
      }
    }
    const NoiseSample sample = sampled(measured, options);
    const Eigen::RowVectorXd kept = sample.measurements.joint_values.row(0);
    ASSERT_EQ(kept.size(), std::min(count, 2000)) << count;
    EXPECT_EQ(sample.share, static_cast<double>(kept.size()) / count) << count;
    EXPECT_EQ(sample.options.orientation_length, 0.7) << count;
    const Eigen::RowVectorXd steps = kept.tail(kept.size() - 1) - kept.head(kept.size() - 1);
    EXPECT_GE(steps.minCoeff(), 1.0) << count;
    EXPECT_LE(steps.maxCoeff() - steps.minCoeff(), 1.0) << "evenly, of " << count;
    ASSERT_EQ(sample.options.row_weights.size(), sample.measurements.observations.size()) << count;
    for (std::size_t row = 0; row < sample.measurements.observations.size(); ++row) {
      const Observation& o = sample.measurements.observations[row];
      EXPECT_EQ(kept[o.configuration], o.position().x()) << count;
      EXPECT_EQ(sample.options.row_weights[row], o.position().x() + 0.5 * o.target) << count;
    }
  }
}

}  // namespace
}  // namespace kdl_calibration::noise_strata_test
