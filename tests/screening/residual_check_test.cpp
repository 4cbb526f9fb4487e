// The residuals beside an estimate, here that of the truth: no fit bends to follow what is wrong.

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "planning/simulation.hpp"
#include "screening/data_quality.hpp"
#include "screening/messages.hpp"
#include "support.hpp"

namespace kdl_calibration::residual_check_test {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::messages;

const ErrorModel& arm() {
  static const ErrorModel model = complete_model(testing::fanuc());
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
    truth.frames.base().linear() = rotation_exp({0.3, -0.5, 1.1});
    truth.frames.base().translation() = Vector3d(2.0, -1.0, 0.3);
    truth.frames.targets = testing::targets_at(scene.targets);
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
    return truth.frames.base() * flange_poses(model, truth, measured)[static_cast<std::size_t>(configuration)] *
           Vector3d(truth.frames.targets[target].X_FT.translation());
  }
  Observation& row(int configuration, int target, int repeat = 1) {
    return *std::find_if(measured.observations.begin(), measured.observations.end(), [&](const Observation& o) {
      return o.configuration == configuration && o.target == target && o.repeat == repeat;
    });
  }
  std::vector<QualityFinding> findings() const { return check_residuals(model, measured, truth); }
};

TEST(ResidualCheck, HasNothingToSayWhereARobustFitMayFollowAnyRow) {
  for (const bool many : {true, false}) {
    Known known({.configurations = many ? 12 : 10, .errors = many ? 0 : 6, .targets = {kThree[0]}});
    known.row(3, 0).position().y() += 0.01;
    EXPECT_EQ(known.findings().size(), many ? 1U : 0U);
  }
}

// A slip of a target is a step in its residuals as the flange sees them.
TEST(ResidualCheck, NamesASlipItsTargetAndItsStepInTheFlange) {
  Known known({.configurations = 24, .repeats = 2, .seed = 11});
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(known.model, known.truth, known.measured);
  const Vector3d step = 0.0005 * Vector3d(0.6, 0.0, -0.8);
  EXPECT_THAT(messages(known.findings()), IsEmpty());
  for (Observation& o : known.measured.observations) {
    if (o.target == 2 && o.configuration >= 9) {
      o.position() +=
          known.truth.frames.base().linear() * X_BF[static_cast<std::size_t>(o.configuration)].linear() * step;
    }
  }
  const std::vector<QualityFinding> found = known.findings();
  ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
  EXPECT_EQ(found[0].kind, QualityKind::slipped_target);
  EXPECT_EQ(found[0].configuration, "9");
  EXPECT_THAT(found[0].targets, ElementsAre("C"));
  EXPECT_LT((found[0].offset - step).norm(), 3e-5);
  EXPECT_NEAR(found[0].amount, 0.0005, 3e-5);
}

// ---- rows by themselves --------------------------------------------------------------------------------------------

TEST(ResidualCheck, TellsAMistypedCoordinateFromADisplacedPoint) {
  Known known({.targets = {kThree[0], kThree[1], kThree[2], {0.0, 0.1, 0.1}}});
  const Vector3d along_y(0.0, -0.01, 0.00004);
  const Vector3d along_two(0.003, 0.0, -0.004);
  known.row(3, 1).position() += along_y;
  known.row(6, 2).position() += along_two;
  const std::vector<QualityFinding> found = known.findings();
  ASSERT_EQ(found.size(), 2U) << ::testing::PrintToString(messages(found));
  EXPECT_EQ(found[0].kind, QualityKind::mistyped_coordinate);
  EXPECT_EQ(found[0].axis, 'y');
  EXPECT_THAT(found[0].targets, ElementsAre("B"));
  EXPECT_LT((found[0].offset - along_y).norm(), 1e-4);
  EXPECT_NEAR(found[0].amount, 0.01, 1e-4);
  EXPECT_EQ(found[1].kind, QualityKind::displaced_point);
  EXPECT_EQ(found[1].axis, ' ');
  EXPECT_THAT(found[1].targets, ElementsAre("C"));
  EXPECT_LT((found[1].offset - along_two).norm(), 1e-4);
  EXPECT_NEAR(found[1].amount, 0.005, 1e-4);
}

TEST(ResidualCheck, TheOnlyRowOfAConfigurationIsARowByItself) {
  Known known({.configurations = 30, .targets = {kThree[0]}});
  known.row(3, 0).position() += Vector3d(0.02, 0.0, 0.0);
  EXPECT_THAT(messages(known.findings()),
              ElementsAre(HasSubstr("target A in configuration 4, repeat 1: x is off by ")));
}

TEST(ResidualCheck, AllRowsFarOffTogetherAreAFindingOfTheConfiguration) {
  Known known({.seed = 12});
  for (int target = 0; target < 3; ++target) {
    known.row(5, target).position() += 0.02 * Vector3d(0.48, 0.8 + 0.1 * target, -0.36);
  }
  const std::vector<QualityFinding> found = known.findings();
  ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
  EXPECT_EQ(found[0].kind, QualityKind::displaced_configuration);
  EXPECT_EQ(found[0].configuration, "6");
  EXPECT_THAT(found[0].targets, ElementsAre("A", "B", "C"));
  EXPECT_NEAR(found[0].amount, 0.02 * Vector3d(0.48, 1.0, -0.36).norm(), 1e-4) << "of the row that is worst";
}

// ---- rows that lie where others should -----------------------------------------------------------------------------

TEST(ResidualCheck, ARowIsThatOfTheNearestOther) {
  const Scene scene{.targets = {kThree[0], {0.1, 0.0, 0.1}, {0.0, 0.0, 0.1}, {0.0, 0.003, 0.1}}};
  for (const int target : {2, 3}) {
    Known known(scene);
    known.row(4, 1).position() = known.expected(4, static_cast<std::size_t>(target)) + Vector3d(0.0, 1e-4, 0.0);
    const std::vector<QualityFinding> found = known.findings();
    ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
    EXPECT_THAT(found[0].targets, ElementsAre("B", target == 2 ? "C" : "D"));
    const Vector3d offset = known.row(4, 1).position() - known.expected(4, 1);
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
      known.row(7, target).position() = known.expected(7, place) + Vector3d(1e-5, 0.0, 0.0);
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
  known.row(7, 0).position() = known.expected(7, 2);
  known.measured.observations.erase(known.measured.observations.begin() + (&known.row(7, 2) - &known.row(0, 0)));
  EXPECT_THAT(messages(known.findings()), ElementsAre("target A in configuration 8 lies where target C is"));
}

TEST(ResidualCheck, ASwapIsAsFarAsItsFirstRowIsOff) {
  Known known({.seed = 14});
  std::swap(known.row(7, 0).position(), known.row(7, 2).position());
  const std::vector<QualityFinding> found = known.findings();
  ASSERT_EQ(found.size(), 1U) << ::testing::PrintToString(messages(found));
  const Vector3d offset = known.row(7, 0).position() - known.expected(7, 0);
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
    o.position() += shifts.col(o.configuration);
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
  known.row(configuration, target, repeat).position() +=
      0.004 * (known.expected(configuration, std::size_t(target)) - others).normalized();
}

TEST(DataQuality, WhatDistancesShowOfTheSameRowIsNotSaidTwice) {
  Known known = shifted(2);
  EXPECT_THAT(where_of(known), IsEmpty());
  known.row(4, 1, 2).position() += kHuge;
  EXPECT_THAT(where_of(known), ElementsAre("5/2B"));
}

TEST(DataQuality, WhatDistancesShowOfAnotherTargetConfigurationOrRepeatIsSaid) {
  Known known = shifted(2);
  known.row(4, 1, 2).position() += kHuge;
  Known target = known;
  push_away(target, 4, 3, 2);
  EXPECT_THAT(where_of(target), ElementsAre("5/2B", "5/2D"));
  Known configuration = known;
  push_away(configuration, 8, 1, 2);
  EXPECT_THAT(where_of(configuration), ElementsAre("5/2B", "9/2B"));
  Known repeat = shifted(3);
  repeat.row(4, 1, 2).position() += kHuge;
  push_away(repeat, 4, 1, 1);
  EXPECT_THAT(where_of(repeat), ElementsAre("5/2B", "5/1B"));
}

TEST(DataQuality, ASlipAndARowThatIsOffAreDifferentMatters) {
  Known known = shifted(1);
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(known.model, known.truth, known.measured);
  const auto slip = [&](int target, const Vector3d& step) {
    for (Observation& o : known.measured.observations) {
      if (o.target == target && o.configuration >= 12) {
        o.position() +=
            known.truth.frames.base().linear() * X_BF[static_cast<std::size_t>(o.configuration)].linear() * step;
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

}  // namespace
}  // namespace kdl_calibration::residual_check_test
