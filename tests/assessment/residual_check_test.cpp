// The residuals beside an estimate, here that of the truth: no fit bends to follow what is wrong.

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "assessment/change_points.hpp"
#include "assessment/heavy_tails.hpp"
#include "base/robust_statistics.hpp"
#include "kdl_calibration/data_quality.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/prediction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "onset.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using testing::fanuc;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::onset;
using testing::refusal;
using testing::targets_at;

const ErrorModel& arm() {
  static const ErrorModel model = complete_model(fanuc());
  return model;
}

const std::vector<Vector3d> kThree = {{0.1, 0.0, 0.0}, {0.0, 0.0, 0.1}, {-0.05, 0.12, 0.02}};

struct Scene {
  int configurations = 20;
  int errors = 3;  // that are not zero
  double noise = 2e-5;
  int repeats = 1;
  std::vector<Vector3d> targets = kThree;
  std::uint64_t seed = 1;
};

/// What was measured of an arm that is known.
struct Known {
  ErrorModel model;
  Estimate truth;
  Measurements measured;

  explicit Known(const Scene& scene) : model(arm()) {
    Random random(scene.seed);
    truth.errors = Eigen::VectorXd::Zero(static_cast<Index>(model.parameters.size()));
    truth.errors.head(scene.errors).setConstant(0.001);
    truth.X_WB.linear() = rotation_exp({0.3, -0.5, 1.1});
    truth.X_WB.translation() = Vector3d(2.0, -1.0, 0.3);
    truth.targets = targets_at(scene.targets);
    Eigen::MatrixXd q(6, scene.configurations);
    for (Index c = 0; c < q.cols(); ++c) {
      q.col(c) = 0.5 * testing::random_joints(model, random);
    }
    measured = measure({.model = model, .truth = truth}, q, {.sigma = scene.noise, .repeats = scene.repeats}, random);
    for (Observation& o : measured.observations) {
      o.sigma = 0.0;
    }
  }

  Vector3d expected(int configuration, std::size_t target) const {
    return truth.X_WB * flange_poses(model, truth, measured)[static_cast<std::size_t>(configuration)] *
           Vector3d(truth.targets[target].X_FT.translation());
  }
  Observation& row(int configuration, int target, int repeat = 1) {
    return *std::find_if(measured.observations.begin(), measured.observations.end(), [&](const Observation& o) {
      return o.configuration == configuration && o.target == target && o.repeat == repeat;
    });
  }
  std::vector<QualityFinding> findings(const QualityOptions& options = {}) const {
    return check_residuals(model, measured, truth, options);
  }
};

std::vector<std::string> messages(const std::vector<QualityFinding>& findings) {
  std::vector<std::string> result;
  for (const QualityFinding& finding : findings) {
    result.push_back(finding.message);
  }
  return result;
}

// ---- where a finding begins ----------------------------------------------------------------------------------------

double fitted_of(const Known& known) {
  double fitted = 6.0 + 3.0 * static_cast<double>(known.truth.targets.size());
  for (const double value : known.truth.errors) {
    fitted += value != 0.0 ? 1.0 : 0.0;
  }
  for (const double value : known.truth.effects) {
    fitted += value != 0.0 ? 1.0 : 0.0;
  }
  return fitted;
}

std::vector<Vector3d> residuals_of(const Known& known) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(known.model, known.truth, known.measured);
  std::vector<Vector3d> residuals;
  for (const Observation& o : known.measured.observations) {
    residuals.emplace_back(o.position - predicted_point(known.truth, X_BF, o));
  }
  return residuals;
}

/// Of a set in which nothing slipped: what each row may be off by along an axis.
std::vector<double> limits_of(const Known& known, const QualityOptions& options) {
  const std::vector<Observation>& rows = known.measured.observations;
  const std::vector<Vector3d> residuals = residuals_of(known);
  std::vector<double> sigmas;
  std::set<std::pair<int, int>> points;
  for (const Observation& o : rows) {
    sigmas.push_back(o.sigma);
    if (o.split == Split::train) {
      points.insert({o.configuration, o.target});
    }
  }
  const double typical = median(sigmas) > 0.0 ? median(sigmas) : 1.0;
  std::vector<double> of_train;
  std::vector<double> of_test;
  std::vector<double> sizes;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (const double value : residuals[i]) {
      const double relative = value / (rows[i].sigma > 0.0 ? rows[i].sigma / typical : 1.0);
      (rows[i].split == Split::train ? of_train : of_test).push_back(relative);
      sizes.push_back(std::abs(relative));
    }
  }
  const double equations = 3.0 * static_cast<double>(points.size());
  const double fitted = fitted_of(known);
  const double leverage = 2.5 * fitted / equations;
  const double train =
      std::sqrt(equations / (equations - fitted)) * std::max(robust_sigma(of_train), options.noise_floor);
  const double test = std::max({train, robust_sigma(of_test), options.noise_floor});
  const double t = threshold(options.false_alarm, static_cast<double>(sizes.size()), 1, 0.8 * (equations - fitted)) /
                   std::sqrt(1.0 - leverage);
  const double heavy = limit_of_heavy_tails(sizes);
  std::vector<double> limits;
  for (const Observation& o : rows) {
    limits.push_back((o.sigma > 0.0 ? o.sigma / typical : 1.0) *
                     std::max(t * (o.split == Split::train ? train : test), heavy));
  }
  return limits;
}

/// How far the worst coordinate is off, in units of what it may be.
double worst_of(const Known& known, const QualityOptions& options = {}) {
  const std::vector<Vector3d> residuals = residuals_of(known);
  const std::vector<double> limits = limits_of(known, options);
  double worst = 0.0;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    worst = std::max(worst, residuals[i].cwiseAbs().maxCoeff() / limits[i]);
  }
  return worst;
}

struct Case {
  const char* name;
  Known known;
  QualityOptions options = {};
};

std::vector<Case> cases() {
  std::vector<Case> all = {
      {"as usual", Known({.seed = 1})},
      {"many errors", Known({.configurations = 16, .errors = 28, .seed = 2}), {.false_alarm = 1e-14}},
      {"repeats", Known({.configurations = 14, .repeats = 3, .seed = 3}), {.false_alarm = 1e-3}},
      {"a floor", Known({.seed = 4}), {.noise_floor = 1e-3}},
      {"effects", Known({.configurations = 12, .noise = 0.0, .seed = 5}), {.false_alarm = 1e-14}},
      {"stated sigmas", Known({.noise = 0.0, .seed = 6})},
      {"heavy tails", Known({.noise = 0.0, .seed = 7})},
      {"test rows", Known({.seed = 8}), {.false_alarm = 1e-14}},
      {"the row is for tests", Known({.seed = 9}), {.false_alarm = 1e-14}}};
  Random random(10);
  const auto disturb = [&](Known& known, const auto& size) {
    for (Observation& o : known.measured.observations) {
      o.position += size(o) * Vector3d{random.normal(), random.normal(), random.normal()};
    }
  };
  all[4].known.model.effects = gain_terms(arm());
  all[4].known.truth.effects = Eigen::VectorXd::Constant(6, 1e-12);
  disturb(all[4].known, [](const Observation&) { return 2e-5; });
  disturb(all[5].known, [&](Observation& o) { return o.sigma = std::exp(random.uniform(-12.0, -9.0)); });
  disturb(all[6].known, [&](const Observation&) { return 1e-5 * std::exp(1.2 * random.normal()); });
  for (const std::size_t i : {7U, 8U}) {
    for (Observation& o : all[i].known.measured.observations) {
      o.split =
          o.configuration >= (i == 7 ? 12 : 0) && o.configuration < (i == 7 ? 20 : 8) ? Split::test : Split::train;
    }
    disturb(all[i].known, [](const Observation& o) { return o.split == Split::test ? 5e-5 : 0.0; });
  }
  return all;
}

TEST(ResidualCheck, AFindingBeginsWhereACoordinateIsBeyondTheLimitOfTheRule) {
  for (const Case& one : cases()) {
    const auto displaced = [&](double size) {
      Known known = one.known;
      known.row(3, 1).position.y() -= size;
      return known;
    };
    const double size = onset(
        0.0, 0.02, [&](double s) { return !displaced(s).findings(one.options).empty(); }, 22);
    // The limit itself may fall there: what was a heavy tail is a defect.
    EXPECT_LE(worst_of(displaced(size * (1.0 - 1e-5)), one.options), 1.001) << one.name << ", " << size << " m";
    EXPECT_GE(worst_of(displaced(size * (1.0 + 1e-5)), one.options), 0.999) << one.name << ", " << size << " m";
  }
}

// 2.5 times the mean leverage of 13 unknowns among 33 equations is 0.985: limits of eight sigmas' sigmas.
TEST(ResidualCheck, HasNothingToSayWhereARobustFitMayFollowAnyRow) {
  for (const int configurations : {10, 11, 12}) {
    for (int errors = 0; errors <= 6; ++errors) {
      Known known({.configurations = configurations, .errors = errors, .targets = {kThree[0]}});
      known.row(3, 0).position.y() += 0.01;
      const double leverage = 2.5 * fitted_of(known) / (3.0 * configurations);
      const bool told = leverage < 1.0 && 1.0 / std::sqrt(1.0 - leverage) < 5.0;
      EXPECT_EQ(known.findings().size(), told ? 1U : 0U) << configurations << " configurations, " << errors;
    }
  }
}

// A slip of a target is a step in its residuals as the flange sees them.
TEST(ResidualCheck, ASlipBeginsWhereTheSeriesOfATargetHasAStep) {
  const Known quiet({.configurations = 24, .repeats = 2, .seed = 11});
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(quiet.model, quiet.truth, quiet.measured);
  const Vector3d direction(0.6, 0.0, -0.8);
  const auto slipped = [&](double size) {
    Known known = quiet;
    for (Observation& o : known.measured.observations) {
      if (o.target == 2 && o.configuration >= 9) {
        o.position +=
            size * (quiet.truth.X_WB.linear() * X_BF[static_cast<std::size_t>(o.configuration)].linear() * direction);
      }
    }
    return known;
  };
  const auto levels = [&](double size) {
    const Known known = slipped(size);
    std::vector<Repeats> repeats(3);
    for (const Observation& o : known.measured.observations) {
      const auto k = static_cast<std::size_t>(o.target);
      const Vector3d seen =
          (quiet.truth.X_WB * X_BF[static_cast<std::size_t>(o.configuration)]).inverse() * o.position -
          Vector3d(quiet.truth.targets[k].X_FT.translation());
      repeats[k].configurations.push_back(o.configuration);
      repeats[k].values.insert(repeats[k].values.end(), seen.begin(), seen.end());
    }
    return find_levels({series_of(repeats[0], 3), series_of(repeats[1], 3), series_of(repeats[2], 3)}, fitted_of(known),
                       1.0, {});
  };
  const double size = onset(0.0, 0.001, [&](double s) { return !slipped(s).findings().empty(); });
  const double expected = onset(0.0, 0.001, [&](double s) { return !levels(s)[2].starts.empty(); });
  EXPECT_NEAR(size, expected, 1e-8);
  const std::vector<QualityFinding> found = slipped(0.0005).findings();
  const Levels of_target = levels(0.0005)[2];
  ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
  EXPECT_EQ(found[0].kind, QualityKind::slipped_target);
  EXPECT_EQ(found[0].configuration, "9");
  EXPECT_THAT(found[0].targets, ElementsAre("C"));
  const Vector3d step = of_target.values.at(1) - of_target.values.at(0);
  EXPECT_LT((found[0].offset - step).norm(), 1e-12);
  EXPECT_NEAR(found[0].amount, step.norm(), 1e-12);
}

// ---- rows by themselves --------------------------------------------------------------------------------------------

TEST(ResidualCheck, AnOffsetIsBesideTheMeanOfTheRowsThatAreRight) {
  Known known({.targets = {kThree[0], kThree[1], kThree[2], {0.0, 0.1, 0.1}}});
  known.row(3, 1).position += Vector3d(0.0, -0.01, 0.00004);
  known.row(6, 2).position += Vector3d(0.003, 0.0, -0.004);
  const std::vector<Vector3d> residuals = residuals_of(known);
  std::vector<Vector3d> off;  // of the second row of configuration 4 and the third of configuration 7
  for (const auto& [configuration, wrong] : {std::pair(3, 1), std::pair(6, 2)}) {
    Vector3d others = Vector3d::Zero();
    Vector3d own = Vector3d::Zero();
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      const Observation& o = known.measured.observations[i];
      if (o.configuration == configuration) {
        (o.target == wrong ? own : others) += residuals[i];
      }
    }
    off.emplace_back(own - others / 3.0);
  }
  const std::vector<QualityFinding> found = known.findings();
  ASSERT_EQ(found.size(), 2U) << ::testing::PrintToString(messages(found));
  EXPECT_EQ(found[0].kind, QualityKind::mistyped_coordinate);
  EXPECT_EQ(found[0].axis, 'y');
  EXPECT_THAT(found[0].targets, ElementsAre("B"));
  EXPECT_LT((found[0].offset - off[0]).norm(), 1e-12);
  EXPECT_NEAR(found[0].amount, std::abs(off[0].y()), 1e-12);
  EXPECT_EQ(found[1].kind, QualityKind::displaced_point);
  EXPECT_EQ(found[1].axis, ' ');
  EXPECT_THAT(found[1].targets, ElementsAre("C"));
  EXPECT_LT((found[1].offset - off[1]).norm(), 1e-12);
  EXPECT_NEAR(found[1].amount, off[1].norm(), 1e-12);
}

TEST(ResidualCheck, TheOnlyRowOfAConfigurationIsARowByItself) {
  Known known({.configurations = 30, .targets = {kThree[0]}});
  known.row(3, 0).position += Vector3d(0.02, 0.0, 0.0);
  EXPECT_THAT(messages(known.findings()),
              ElementsAre(HasSubstr("target A in configuration 4, repeat 1: x is off by ")));
}

TEST(ResidualCheck, AllRowsTogetherAreTheArmWhereTheyAreFiveTimesAsFarOffAsOneMayBe) {
  const auto elsewhere = [&](double size) {
    Known known({.seed = 12});
    for (int target = 0; target < 3; ++target) {
      known.row(5, target).position += size * Vector3d(0.48, 0.8 + 0.1 * target, -0.36);
    }
    return known;
  };
  const double size = onset(
      0.0, 0.01, [&](double s) { return !elsewhere(s).findings().empty(); }, 22);
  // Smaller ones, of one or two rows, are findings of these: the last size without any counts.
  const double last_without = onset(
      1e-4, 0.01,
      [&](double s) {
        const std::vector<QualityFinding> found = elsewhere(s).findings();
        return !found.empty() && found[0].kind == QualityKind::displaced_configuration;
      },
      22);
  EXPECT_NEAR(worst_of(elsewhere(last_without)), 5.0, 5e-3);
  EXPECT_LE(size, last_without + 1e-8);
  const Known known = elsewhere(0.02);
  const std::vector<QualityFinding> found = known.findings();
  ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
  EXPECT_EQ(found[0].configuration, "6");
  EXPECT_THAT(found[0].targets, ElementsAre("A", "B", "C"));
  Vector3d largest = Vector3d::Zero();
  for (const Vector3d& residual : residuals_of(known)) {
    largest = residual.norm() > largest.norm() ? residual : largest;
  }
  EXPECT_LT((found[0].offset - largest).norm(), 1e-12);
  EXPECT_NEAR(found[0].amount, largest.norm(), 1e-12);
}

// ---- rows that lie where others should -----------------------------------------------------------------------------

/// The row of B this far from where C should be.
Known beside_another(const Scene& scene, const Vector3d& off) {
  Known known(scene);
  known.row(4, 1).position = known.expected(4, 2) + off;
  return known;
}

bool is_mistaken(const Known& known) {
  const std::vector<QualityFinding> found = known.findings();
  return found.size() == 1 && found[0].kind == QualityKind::mistaken_target;
}

TEST(ResidualCheck, ARowIsAnothersWithinAShareOfTheirDistanceOrTheNoise) {
  const Vector3d direction = Vector3d(1.0, -2.0, 0.5).normalized();
  const double apart = (kThree[1] - kThree[2]).norm();
  const double share = onset(0.0, 0.1, [&](double size) { return !is_mistaken(beside_another({}, size * direction)); });
  EXPECT_NEAR(share, 0.05 * apart, 1e-7);

  const Scene noisy{.noise = 0.001};
  const double noise =
      onset(0.0, 0.1, [&](double size) { return !is_mistaken(beside_another(noisy, size * direction)); });
  const Known there = beside_another(noisy, noise * direction);
  EXPECT_GT(noise, 0.05 * apart) << "no fair comparison";
  EXPECT_NEAR(noise, std::sqrt(3.0) * limits_of(there, {}).front(), 1e-5);
}

// Of neighbours a few millimetres apart.
TEST(ResidualCheck, ARowIsAnothersWhereItIsHalfAsFarFromThereAsFromItsOwnPlace) {
  const Scene close{.configurations = 60, .noise = 0.0003, .targets = {kThree[0], {0.0, 0.0, 0.1}, {0.0085, 0.0, 0.1}}};
  const auto between = [&](double share) {
    Known known(close);
    known.row(4, 1).position = known.expected(4, 1) + share * (known.expected(4, 2) - known.expected(4, 1));
    return known;
  };
  const double share = onset(0.55, 1.0, [&](double s) { return is_mistaken(between(s)); });
  EXPECT_NEAR(share, 2.0 / 3.0, 1e-5);
}

TEST(ResidualCheck, ARowIsThatOfTheNearestOther) {
  const Scene scene{.targets = {kThree[0], {0.1, 0.0, 0.1}, {0.0, 0.0, 0.1}, {0.0, 0.003, 0.1}}};
  for (const int target : {2, 3}) {
    Known known(scene);
    known.row(4, 1).position = known.expected(4, static_cast<std::size_t>(target)) + Vector3d(0.0, 1e-4, 0.0);
    const std::vector<QualityFinding> found = known.findings();
    ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
    EXPECT_THAT(found[0].targets, ElementsAre("B", target == 2 ? "C" : "D"));
    const Vector3d offset = known.row(4, 1).position - known.expected(4, 1);
    EXPECT_LT((found[0].offset - offset).norm(), 1e-12);
    EXPECT_NEAR(found[0].amount, offset.norm(), 1e-12);
  }
}

TEST(ResidualCheck, RowsInARingAreSwappedAndThoseThatLeadToOneAreMistaken) {
  const std::vector<Vector3d> four = {{0.1, 0.0, 0.0}, {0.0, 0.0, 0.1}, {-0.05, 0.12, 0.02}, {0.0, -0.1, 0.05}};
  const auto said_of = [&](const std::vector<std::size_t>& places) {
    Known known({.targets = four});
    for (int target = 0; target < 4; ++target) {
      const std::size_t place = places[static_cast<std::size_t>(target)];
      known.row(7, target).position = known.expected(7, place) + Vector3d(1e-5, 0.0, 0.0);
    }
    return messages(known.findings());
  };
  EXPECT_THAT(said_of({1, 0, 3, 2}), ElementsAre("targets A and B are swapped in configuration 8",
                                                 "targets C and D are swapped in configuration 8"));
  EXPECT_THAT(said_of({1, 2, 0, 3}), ElementsAre("targets A, B and C are swapped in configuration 8"));
  EXPECT_THAT(said_of({1, 3, 0, 2}), ElementsAre("targets A, B, C and D are swapped in configuration 8"));
  EXPECT_THAT(said_of({1, 2, 1, 3}), ElementsAre("targets B and C are swapped in configuration 8",
                                                 "target A in configuration 8 lies where target B is"));
  EXPECT_THAT(said_of({1, 2, 2, 3}), ElementsAre("target A in configuration 8 lies where target B is",
                                                 "target B in configuration 8 lies where target C is"));
}

TEST(ResidualCheck, ARowMayBeThatOfATargetWithoutOne) {
  Known known({.seed = 13});
  known.row(7, 0).position = known.expected(7, 2);
  known.measured.observations.erase(known.measured.observations.begin() + (&known.row(7, 2) - &known.row(0, 0)));
  EXPECT_THAT(messages(known.findings()), ElementsAre("target A in configuration 8 lies where target C is"));
}

TEST(ResidualCheck, ASwapIsAsFarAsItsFirstRowIsOff) {
  Known known({.seed = 14});
  std::swap(known.row(7, 0).position, known.row(7, 2).position);
  const std::vector<QualityFinding> found = known.findings();
  ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
  const Vector3d offset = known.row(7, 0).position - known.expected(7, 0);
  EXPECT_LT((found[0].offset - offset).norm(), 1e-12);
  EXPECT_NEAR(found[0].amount, offset.norm(), 1e-12);
}

// ---- residuals and distances together ------------------------------------------------------------------------------

/// All targets of a configuration are off together by millimetres, which residuals show and distances do not: single
/// defects of a millimetre are found by the distances alone.
Known shifted(int repeats) {
  Known known({.configurations = 24,
               .noise = 1e-5,
               .repeats = repeats,
               .targets = {{0.1, 0.0, 0.0}, {0.0, 0.0, 0.1}, {-0.05, 0.12, 0.02}, {0.0, -0.1, 0.05}}});
  Random random(15);
  Eigen::Matrix3Xd shifts(3, 24);
  for (double& shift : shifts.reshaped()) {
    shift = 0.002 * random.normal();
  }
  for (Observation& o : known.measured.observations) {
    o.position += shifts.col(o.configuration);
  }
  return known;
}

std::vector<std::string> where_of(const Known& known) {
  std::vector<std::string> result;
  for (const QualityFinding& finding : check_measurements(known.model, known.measured, known.truth)) {
    std::string targets;
    for (const std::string& target : finding.targets) {
      targets += target;
    }
    result.push_back((finding.kind == QualityKind::slipped_target ? "slip " : "") + finding.configuration + "/" +
                     std::to_string(finding.repeat) + targets);
  }
  return result;
}

const Vector3d kHuge(0.3, -0.2, 0.1);  // that residuals see

/// Four millimetres away from the other targets, which distances alone see.
void push_away(Known& known, int configuration, int target, int repeat = 1) {
  Vector3d others = Vector3d::Zero();
  for (int other = 0; other < 4; ++other) {
    others += other == target ? Vector3d::Zero() : Vector3d(known.expected(configuration, std::size_t(other)) / 3.0);
  }
  known.row(configuration, target, repeat).position +=
      0.004 * (known.expected(configuration, std::size_t(target)) - others).normalized();
}

TEST(DataQuality, WhatDistancesShowOfTheSameRowIsNotSaidTwice) {
  Known known = shifted(2);
  EXPECT_THAT(where_of(known), IsEmpty());
  known.row(4, 1, 2).position += kHuge;
  EXPECT_THAT(where_of(known), ElementsAre("5/2B"));
}

TEST(DataQuality, WhatDistancesShowOfAnotherTargetConfigurationOrRepeatIsSaid) {
  Known known = shifted(2);
  known.row(4, 1, 2).position += kHuge;
  Known target = known;
  push_away(target, 4, 3, 2);
  EXPECT_THAT(where_of(target), ElementsAre("5/2B", "5/2D"));
  Known configuration = known;
  push_away(configuration, 8, 1, 2);
  EXPECT_THAT(where_of(configuration), ElementsAre("5/2B", "9/2B"));
  Known repeat = shifted(3);
  repeat.row(4, 1, 2).position += kHuge;
  push_away(repeat, 4, 1, 1);
  EXPECT_THAT(where_of(repeat), ElementsAre("5/2B", "5/1B"));
}

TEST(DataQuality, WhatEveryRepeatHasIsTheMatterOfEach) {
  Known in_distances = shifted(2);
  in_distances.row(4, 1, 1).position += kHuge;
  push_away(in_distances, 4, 1, 2);
  EXPECT_THAT(where_of(in_distances), ElementsAre("5/1B"));
}

TEST(DataQuality, ASlipAndARowThatIsOffAreDifferentMatters) {
  Known known = shifted(1);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(known.model, known.truth, known.measured);
  const auto slip = [&](int target, const Vector3d& step) {
    for (Observation& o : known.measured.observations) {
      if (o.target == target && o.configuration >= 12) {
        o.position += known.truth.X_WB.linear() * X_BF[static_cast<std::size_t>(o.configuration)].linear() * step;
      }
    }
  };
  slip(1, kHuge);
  EXPECT_THAT(where_of(known), ElementsAre("slip 12/0B"));
  push_away(known, 8, 1);
  EXPECT_THAT(where_of(known), ElementsAre("slip 12/0B", "9/1B"));
  slip(3, {0.0, -0.004, 0.0});
  EXPECT_THAT(where_of(known), ElementsAre("slip 12/0B", "slip 12/0D", "9/1B"));
}

TEST(ResidualCheck, RefusesWhatDoesNotHoldTogether) {
  Known known({.seed = 16});
  EXPECT_THAT(messages(known.findings()), IsEmpty());
  EXPECT_THAT(refusal([&] { known.findings({.noise_floor = -1.0}); }), HasSubstr("the floor of the noise"));
  Known estimate = known;
  estimate.truth.targets.pop_back();
  EXPECT_THAT(refusal([&] { estimate.findings(); }), HasSubstr("targets of an estimate"));
  known.measured.observations[2].position.y() = std::nan("");
  EXPECT_THAT(refusal([&] { known.findings(); }), HasSubstr("observation 2"));
}

}  // namespace
}  // namespace kdl_calibration
