// Strata against contrasts written out: an orthogonal matrix over the targets of a configuration, projections of the
// repeats.

#include "assessment/noise_strata.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/prediction.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::VirtualExperiment;
using testing::VirtualExperimentOptions;
using Variances = NoiseParts::Variances;

constexpr double kLeastWeight = 1e-6;

/// Some rows of a virtual experiment, and an estimate that is not the truth.
struct Trial {
  VirtualExperiment experiment;
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
    estimate.X_WB.translation().y() += 2e-4;
    estimate.targets[1].X_FT.translation().x() += 1e-4;
  }

  double weight(std::size_t row) const { return options.row_weights.empty() ? 1.0 : options.row_weights[row]; }
};

/// As they may come: without some targets and repeats, in no order, and rows of any weight.
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
  const std::vector<double> weights = {1.0, 1.0, 0.3, 1.0, 0.8, 2e-6};
  for (std::size_t i = 0; i < rows.size(); ++i) {
    trial.options.row_weights.push_back(weights[i % weights.size()]);
  }
  return trial;
}

/// A stratum as sums over configurations, and then as it comes out.
struct Expected {
  std::vector<Eigen::RowVectorXd> J;
  std::vector<double> e;
  double squares = 0.0;
  double count = 0.0;
  Variances coefficients = Variances::Zero();
  double known = 0.0;
  double configurations = 0.0;
};
using Key = std::array<long, 4>;  // means, deviations or repeats, then what is alike
using Strata = std::map<Key, Expected>;

/// Rows of a configuration that count, by target.
std::map<int, std::vector<std::size_t>> cells_of(const Trial& t, int configuration) {
  std::map<int, std::vector<std::size_t>> cells;
  for (std::size_t row = 0; row < t.measured.observations.size(); ++row) {
    const Observation& o = t.measured.observations[row];
    if (o.configuration == configuration && t.weight(row) > kLeastWeight) {
      cells[o.target].push_back(row);
    }
  }
  return cells;
}

VectorXd weights_of(const Trial& t, const std::vector<std::size_t>& rows) {
  VectorXd w(static_cast<Index>(rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    w[static_cast<Index>(i)] = t.weight(rows[i]);
  }
  return w;
}

VectorXd coordinates(const Trial& t, const std::vector<std::size_t>& rows, int axis) {
  VectorXd x(static_cast<Index>(rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    x[static_cast<Index>(i)] = t.measured.observations[rows[i]].position[axis];
  }
  return x;
}

VectorXd stated_variances(const Trial& t, const std::vector<std::size_t>& rows, int axis, bool stated) {
  VectorXd x(static_cast<Index>(rows.size()));
  for (std::size_t i = 0; i < rows.size(); ++i) {
    x[static_cast<Index>(i)] =
        stated ? point_covariance(t.options.noise, t.measured.observations[rows[i]])(axis, axis) : 0.0;
  }
  return x;
}

// Orthonormal, the first of one weight for all.
MatrixXd contrasts(Index n) {
  MatrixXd start = MatrixXd::Identity(n, n);
  start.col(0).setOnes();
  MatrixXd Q = Eigen::HouseholderQR<MatrixXd>(start).householderQ();
  return Q.transpose();
}

void expect_means(const Trial& t, int c, bool stated, Strata& strata) {
  const auto cells = cells_of(t, c);
  const auto T = static_cast<Index>(cells.size());
  const PositionPredictor predictor(t.experiment.model, t.estimate, t.free);
  const auto jacobians = predictor.jacobians(t.measured, c);
  const auto X_BF = flange_poses(t.experiment.model, t.estimate, t.measured.joint_values.col(c));
  for (int axis = 0; axis < 3; ++axis) {
    MatrixXd J(T, t.free.size());
    VectorXd e(T);
    double inverse_weight = 0.0;
    double known = 0.0;
    Index at = 0;
    for (const auto& [target, rows] : cells) {
      const VectorXd share = weights_of(t, rows) / weights_of(t, rows).sum();
      const auto k = static_cast<std::size_t>(target);
      J.row(at) = jacobians[k].row(axis);
      e[at++] = share.dot(coordinates(t, rows, axis)) -
                (t.estimate.X_WB * X_BF[0] * t.estimate.targets[k].X_FT.translation())[axis];
      inverse_weight += 1.0 / weights_of(t, rows).sum() / static_cast<double>(T);
      // Own variances are those of rows of the weight one.
      known += share.dot(stated_variances(t, rows, axis, stated)) / weights_of(t, rows).sum() / static_cast<double>(T);
    }
    const MatrixXd H = contrasts(T);
    const auto number = static_cast<double>(T);
    for (Index i = 0; i < T; ++i) {
      Expected& stratum = strata[{i == 0 ? 0 : 1, T, std::lround(1.0 / inverse_weight), axis}];
      stratum.J.emplace_back(H.row(i) * J);
      stratum.e.push_back(H.row(i).dot(e));
      stratum.count += 1.0;
      if (i > 1) {
        continue;
      }
      stratum.configurations += 1.0;
      stratum.known += known;
      stratum.coefficients[NoiseParts::kTargetMisfit] += 1.0;
      stratum.coefficients[NoiseParts::kIndependent + axis] += inverse_weight;
      stratum.coefficients[NoiseParts::kMisfit] += i == 0 ? number : 0.0;
      stratum.coefficients[NoiseParts::kCommon + axis] += i == 0 ? number * inverse_weight : 0.0;
    }
  }
}

/// Whether what repeats share was told from the rest.
bool expect_repeats(const Trial& t, int c, bool stated, Strata& strata) {
  std::vector<std::size_t> all;
  std::map<int, double> repeats;  // rows of each
  double freedom = 0.0;
  const auto cells = cells_of(t, c);
  for (const auto& [target, rows] : cells) {
    all.insert(all.end(), rows.begin(), rows.end());
    freedom += static_cast<double>(rows.size()) - 1.0;
    for (const std::size_t row : rows) {
      repeats[t.measured.observations[row].repeat] += 1.0;
    }
  }
  if (freedom == 0.0) {
    return false;
  }
  const double together = static_cast<double>(all.size()) / static_cast<double>(repeats.size());
  const double shared_freedom = std::min(static_cast<double>(repeats.size()) - 1.0, freedom);
  for (int axis = 0; axis < 3; ++axis) {
    std::map<int, double> sums;
    double squares = 0.0;
    for (const auto& [target, rows] : cells) {
      const VectorXd w = weights_of(t, rows);
      const VectorXd x = coordinates(t, rows, axis);
      const VectorXd d = w.cwiseSqrt().cwiseProduct(VectorXd(x.array() - w.dot(x) / w.sum()));
      squares += d.squaredNorm();
      for (std::size_t i = 0; i < rows.size(); ++i) {
        sums[t.measured.observations[rows[i]].repeat] += d[static_cast<Index>(i)];
      }
    }
    double shared = 0.0;
    for (const auto& [repeat, sum] : sums) {
      shared += sum * sum / repeats[repeat];
    }
    const auto add = [&](long kind, double sum, double count, double of_common) {
      Expected& stratum = strata[{2, kind, std::lround(together), axis}];
      stratum.squares += sum;
      stratum.count += count;
      stratum.configurations += 1.0;
      stratum.coefficients[NoiseParts::kCommon + axis] += of_common;
      stratum.coefficients[NoiseParts::kIndependent + axis] += 1.0;
      stratum.known += stated_variances(t, all, axis, stated).mean();
    };
    if (together > 1.5) {
      add(0, shared, shared_freedom, together);
      add(1, squares - shared, freedom - shared_freedom, 0.0);
    } else {
      add(2, squares, freedom, 1.0);
    }
  }
  return together > 1.5;
}

Strata expected_strata(const Trial& t, bool stated) {
  Strata strata;
  for (int c = 0; c < t.measured.joint_values.cols(); ++c) {
    if (!cells_of(t, c).empty()) {
      expect_means(t, c, stated, strata);
      expect_repeats(t, c, stated, strata);
    }
  }
  return strata;
}

void expect_stratum(const Stratum& found, const Expected& expected, const std::string& what) {
  EXPECT_NEAR(found.count, expected.count, 1e-12) << what;
  EXPECT_NEAR(found.known, expected.known / expected.configurations, 1e-12 * std::abs(found.known)) << what;
  EXPECT_LT((found.coefficients - expected.coefficients / expected.configurations).norm(), 1e-12) << what;
  EXPECT_EQ(found.predicted, !expected.J.empty()) << what;
  if (expected.J.empty()) {
    EXPECT_NEAR(found.squares, expected.squares, 1e-9 * expected.squares + 1e-22) << what;
    EXPECT_EQ(found.information.size() + found.gradient.size(), 0) << what;
    return;
  }
  MatrixXd information = MatrixXd::Zero(found.information.rows(), found.information.cols());
  VectorXd gradient = VectorXd::Zero(found.gradient.size());
  double squares = 0.0;
  for (std::size_t i = 0; i < expected.J.size(); ++i) {
    information += expected.J[i].transpose() * expected.J[i];
    gradient += expected.e[i] * expected.J[i].transpose();
    squares += expected.e[i] * expected.e[i];
  }
  EXPECT_NEAR(found.squares, squares, 1e-9 * squares) << what;
  EXPECT_LT((found.information - information).norm(), 1e-9 * (1.0 + information.norm())) << what;
  EXPECT_LT((found.gradient - gradient).norm(), 1e-9 * (1e-3 + gradient.norm())) << what;
}

void expect_strata(const Trial& t, bool stated, const std::string& what) {
  NoiseStrata strata(t.measured, t.options);
  EXPECT_EQ(strata.stated(), stated) << what;
  strata.add_means(t.experiment.model, t.estimate, t.free);
  const std::vector<Stratum> found = strata.finished();
  Strata expected = expected_strata(t, stated);
  std::erase_if(expected, [](const auto& entry) { return entry.second.count == 0.0; });
  ASSERT_EQ(found.size(), expected.size()) << what;
  std::size_t at = 0;
  for (const auto& [key, stratum] : expected) {
    expect_stratum(found[at], stratum, what + ", stratum " + std::to_string(at));
    ++at;
  }
}

TEST(NoiseStrata, AreContrastsOverTargetsAndProjectionsOfRepeats) {
  Trial trial = irregular();
  trial.measured = testing::without_sigmas(trial.measured);
  expect_strata(trial, false, "nothing stated");
  trial.options.noise.common = Vector3d(1e-5, 2e-5, 3e-5);
  expect_strata(trial, false, "what is shared stated");
  trial.options.noise.independent = Vector3d(1e-5, 2e-5, 3e-5);
  expect_strata(trial, true, "stated by axis");
  trial.options.noise.tracker = TrackerNoise{.range = 1e-5, .transverse = 2e-5, .transverse_per_metre = 1e-5};
  expect_strata(trial, true, "stated of a tracker");
  trial.options.row_weights.clear();
  trial.options.noise = {};
  for (std::size_t i = 0; i < trial.measured.observations.size(); ++i) {
    trial.measured.observations[i].sigma = 1e-5 * static_cast<double>(1 + i % 5);
  }
  expect_strata(trial, true, "stated by row");
  trial.measured.observations[3].sigma = 0.0;
  expect_strata(trial, false, "stated by all rows but one");
}

TEST(NoiseStrata, LeaveOutWhatHasLessThanAMillionthOfARowsWeight) {
  for (const auto& [weight, counts] : {std::pair{2e-6, true}, {1e-6, false}, {5e-7, false}, {0.0, false}}) {
    Trial trial(2, {.sigma = 1e-4, .repeats = 2});
    trial.options.row_weights.assign(trial.measured.observations.size(), 1.0);
    trial.options.row_weights[3] = weight;
    EXPECT_EQ(NoiseStrata(trial.measured, trial.options).repeat_freedom(), counts ? 6.0 : 5.0) << weight;
    expect_strata(trial, true, "weight " + std::to_string(weight));
  }
}

/// Rows of configuration, target and repeat.
Measurements rows_of(const std::vector<std::array<int, 3>>& places, double sigma = 0.0) {
  Measurements measured;
  for (const auto& [configuration, target, repeat] : places) {
    const auto at = static_cast<double>(measured.observations.size());
    measured.observations.push_back({.position = Vector3d(at, -at * at, std::sin(at)),
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
    EXPECT_EQ(strata.several_targets(), layout.several_targets) << layout.name;
    EXPECT_EQ(strata.separates_common(), layout.separates_common) << layout.name;
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
    one.observations[0].position = Vector3d(5.0, 0.0, 0.0);
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
  poses.orientations.assign(poses.observations.size(), Eigen::Quaterniond::Identity());
  EXPECT_EQ(asked(poses, PartsAsked::all), Columns({{0}, {1}, kCommonOfAll, kIndependentOfAll, {8}}));
  EXPECT_EQ(asked(poses, PartsAsked::all, {.orientation = 1e-3}), Columns({{0}, {1}, kCommonOfAll, kIndependentOfAll}));
  EXPECT_EQ(asked(poses, PartsAsked::without_misfits), Columns({kCommonOfAll, kIndependentOfAll, {8}}));
  EXPECT_EQ(asked(poses, PartsAsked::of_repeats), Columns({kCommonOfAll, kIndependentOfAll}));
}

// Of a target in W, as a function of a step from the estimate.
Eigen::Matrix3d predicted_orientation(const Trial& t, const VectorXd& step, const Observation& o) {
  const Estimate moved = t.free.moved(t.estimate, step);
  const auto X_BF = flange_poses(t.experiment.model, moved, MatrixXd(t.measured.joint_values.col(o.configuration)));
  return (moved.X_WB * X_BF[0] * moved.targets[static_cast<std::size_t>(o.target)].X_FT).linear();
}

// Orientations of a configuration's targets, each repeat as good as its weight.
struct Turns {
  std::map<std::pair<int, int>, std::vector<std::size_t>> rows;

  explicit Turns(const Trial& t) {
    for (std::size_t row = 0; row < t.measured.observations.size(); ++row) {
      const Observation& o = t.measured.observations[row];
      if (!is_point(t.measured.orientations[row]) && t.weight(row) > kLeastWeight) {
        rows[{o.configuration, o.target}].push_back(row);
      }
    }
  }
};

void expect_orientations(const Trial& t) {
  NoiseStrata strata(t.measured, t.options);
  strata.add_means(t.experiment.model, t.estimate, t.free);
  const std::vector<Stratum> all = strata.finished();
  const Stratum& found = all.front();
  ASSERT_TRUE(found.is_of_orientations());
  EXPECT_FALSE(found.is_of_means());
  EXPECT_EQ(std::count_if(all.begin(), all.end(), [](const Stratum& s) { return s.is_of_orientations(); }), 1);
  MatrixXd information = MatrixXd::Zero(t.free.size(), t.free.size());
  VectorXd gradient = VectorXd::Zero(t.free.size());
  double squares = 0.0;
  double inverse_weights = 0.0;
  const Turns turns(t);
  for (const auto& [place, rows] : turns.rows) {
    const Observation& o = t.measured.observations[rows.front()];
    const Eigen::Matrix3d R = predicted_orientation(t, VectorXd::Zero(t.free.size()), o);
    const MatrixXd J = testing::central_differences(t.free.size(), 1e-5, [&](const VectorXd& step) {
      return VectorXd(rotation_log(R.transpose() * predicted_orientation(t, step, o)));
    });
    const VectorXd w = weights_of(t, rows);
    Vector3d e = Vector3d::Zero();
    for (std::size_t i = 0; i < rows.size(); ++i) {
      e += w[static_cast<Index>(i)] / w.sum() *
           rotation_log(R.transpose() * t.measured.orientations[rows[i]].toRotationMatrix());
    }
    information += J.transpose() * J;
    gradient += J.transpose() * e;
    squares += e.squaredNorm();
    inverse_weights += 1.0 / w.sum();
  }
  const auto cells = static_cast<double>(turns.rows.size());
  EXPECT_EQ(found.count, 3.0 * cells);
  EXPECT_EQ(found.known, 0.0);
  EXPECT_NEAR(found.coefficients[NoiseParts::kOrientation], inverse_weights / cells, 1e-12);
  EXPECT_NEAR(found.squares, squares, 1e-5 * squares);
  // Which side of a turn its columns count from matters as much as the turn is large.
  EXPECT_LT((found.information - information).norm(), 1e-3 * information.norm());
  EXPECT_LT((found.gradient - gradient).norm(), 2e-3 * gradient.norm());
}

TEST(NoiseStrata, TakeOrientationsBesideTheMeans) {
  const VirtualExperimentOptions arm{.targets = testing::as_frames(published_targets())};
  Trial trial(6, {.sigma = 1e-4, .orientation_sigma = 2e-4, .repeats = 2}, arm);
  trial.free = Unknowns(trial.experiment.model, trial.experiment.targets, {"base.Tx", "base.Rz", "base.Ry", "B.Rx"});
  trial.estimate.targets[1].X_FT.rotate(Eigen::AngleAxisd(1e-3, Vector3d::UnitX()));
  trial.measured = subset(
      trial.measured, [](const Observation& o) { return o.configuration != 1 || (o.target == 2 && o.repeat == 1); });
  for (std::size_t row = 0; row < trial.measured.observations.size(); ++row) {
    const Observation& o = trial.measured.observations[row];
    if (o.target == 0 && o.configuration % 2 == 0) {
      trial.measured.orientations[row] = point_alone();
    }
  }
  expect_orientations(trial);
  for (std::size_t row = 0; row < trial.measured.observations.size(); ++row) {
    trial.options.row_weights.push_back(row % 3 == 1 ? 0.25 : 1.0);
  }
  trial.options.noise.orientation = 3e-3;
  expect_orientations(trial);
}

// A point of a weight too small to count stands between others.
TEST(NoiseStrata, TakeOrientationsBesideAPointThatCountsForNothing) {
  const VirtualExperimentOptions arm{.targets = testing::as_frames(published_targets())};
  Trial trial(4, {.sigma = 1e-4, .orientation_sigma = 2e-4}, arm);
  trial.free = Unknowns(trial.experiment.model, trial.experiment.targets, {"base.Tx", "base.Rz", "base.Ry", "B.Rx"});
  trial.options.row_weights.assign(trial.measured.observations.size(), 1.0);
  trial.options.row_weights[4] = 5e-7;
  expect_orientations(trial);
  for (const std::size_t row : {0U, 1U, 2U}) {
    trial.options.row_weights[row] = 5e-7;
  }
  expect_orientations(trial);
}

TEST(NoiseStrata, SampleTwoThousandConfigurationsEvenly) {
  for (const int count : {1999, 2000, 2001, 3000, 9000}) {
    Measurements measured;
    ResidualOptions options{.orientation_length = 0.7};
    measured.joints = {"one"};
    measured.targets = {"A", "B"};
    measured.joint_values = Eigen::RowVectorXd::LinSpaced(count, 0.0, count - 1.0);
    for (int c = 0; c < count; ++c) {
      measured.configurations.push_back(std::to_string(c));
      for (int target = 0; target <= c % 2; ++target) {
        measured.observations.push_back({.position = Vector3d::Constant(c), .configuration = c, .target = target});
        options.row_weights.push_back(static_cast<double>(c) + 0.5 * target);
      }
    }
    const NoiseSample sample = sampled(measured, options);
    const Index kept = std::min(count, 2000);
    ASSERT_EQ(sample.measurements.joint_values.cols(), kept) << count;
    EXPECT_EQ(sample.share, static_cast<double>(kept) / count) << count;
    EXPECT_EQ(sample.options.orientation_length, 0.7) << count;
    ASSERT_EQ(sample.options.row_weights.size(), sample.measurements.observations.size()) << count;
    for (Index i = 0; i < kept; ++i) {
      const Index place = i * count / kept;
      EXPECT_EQ(sample.measurements.joint_values(0, i), static_cast<double>(place)) << count;
    }
    for (std::size_t row = 0; row < sample.measurements.observations.size(); ++row) {
      const Observation& o = sample.measurements.observations[row];
      EXPECT_EQ(sample.measurements.joint_values(0, o.configuration), o.position.x()) << count;
      EXPECT_EQ(sample.options.row_weights[row], o.position.x() + 0.5 * o.target) << count;
    }
    EXPECT_EQ(sampled(measured, {}).options.row_weights.size(), 0U) << count;
  }
}

}  // namespace
}  // namespace kdl_calibration
