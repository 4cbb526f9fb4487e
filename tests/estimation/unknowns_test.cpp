#include "estimation/unknowns.hpp"

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <numeric>

#include "base/random.hpp"
#include "effects/effect_terms.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "support.hpp"

namespace kdl_calibration::unknowns_test {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::ElementsAre;

Isometry3d random_frame(Random& random) {
  const Vector3d axis{random.normal(), random.normal(), random.normal()};
  const Eigen::Translation3d place{random.normal(), random.normal(), random.normal()};
  return place * Eigen::AngleAxisd(random.uniform(-1.0, 1.0), axis.normalized());
}

// The odd arm with gains, two targets of which the second has an orientation, and something free of every group.
struct OddArm {
  OddArm() {
    model.effects = gain_terms(model);
    for (EffectTerm& term : model.effects) {
      term.sigma = 0.125;
    }
    targets = testing::targets_at({{0.1, 0.0, 0.2}, {0.0, 0.1, 0.3}});
    targets[1].with_orientation = true;
    free = Unknowns(model, targets, names);
  }

  Estimate random_estimate() {
    Estimate estimate{.errors = testing::random_errors(model, random, 0.01, 0.02),
                      .frames = {.bases = {random_frame(random)}, .targets = targets},
                      .effects = VectorXd(static_cast<Index>(model.effects.size()))};
    for (TargetFrame& target : estimate.frames.targets) {
      target.X_FT = random_frame(random);
    }
    for (double& value : estimate.effects) {
      value = 0.01 * random.normal();
    }
    return estimate;
  }

  VectorXd random_step() {
    VectorXd step(free.size());
    for (double& value : step) {
      value = random.uniform(-0.5, 0.5);
    }
    return step;
  }

  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  std::vector<TargetFrame> targets;
  std::vector<std::string> names = {"B.Ry", "gain.3", "A.z", "dq3", "base.Rz", "B.x", "dq2", "base.Ty", "gain.1"};
  Unknowns free;
  Random random{7};
};

void expect_same_frame(const Isometry3d& a, const Isometry3d& b) {
  EXPECT_LT((a.matrix() - b.matrix()).cwiseAbs().maxCoeff(), 1e-14) << a.matrix() << "\nand\n" << b.matrix();
}

TEST(Unknowns, StandInTheOrderBaseGeometricEffectsTargets) {
  const OddArm arm;
  EXPECT_THAT(arm.free.names(),
              ElementsAre("base.Ty", "base.Rz", "dq2", "dq3", "gain.1", "gain.3", "A.z", "B.x", "B.Ry"));
  Index column = 0;
  for (const auto& [group, count] : {std::pair{UnknownGroup::base, 2}, std::pair{UnknownGroup::geometric, 2},
                                     std::pair{UnknownGroup::effects, 2}, std::pair{UnknownGroup::targets, 3}}) {
    EXPECT_EQ(arm.free.range(group).first, column);
    EXPECT_EQ(arm.free.range(group).count, count);
    column += count;
    EXPECT_EQ(arm.free.range(group).end(), column);
  }
  EXPECT_EQ(arm.free.size(), column);
  EXPECT_EQ(arm.free.chain().first, 0);
  EXPECT_EQ(arm.free.chain().count, 6);
}

TEST(Unknowns, AreFoundByNameAndByPlace) {
  const OddArm arm;
  const std::vector<std::string> names = arm.free.names();
  for (std::size_t c = 0; c < names.size(); ++c) {
    const Unknown& unknown = arm.free.columns()[c];
    EXPECT_EQ(arm.free.column(names[c]), static_cast<Index>(c)) << names[c];
    EXPECT_EQ(arm.free.column(unknown.group, unknown.index), static_cast<Index>(c)) << names[c];
  }
  EXPECT_EQ(arm.free.column("dq1"), std::nullopt);
  EXPECT_EQ(arm.free.column(UnknownGroup::geometric, parameter_index(arm.model, "dq1")), std::nullopt);
  EXPECT_THAT(arm.free.geometric(), ElementsAre(parameter_index(arm.model, "dq2"), parameter_index(arm.model, "dq3")));
  EXPECT_THAT(arm.free.effects(), ElementsAre(0, 2));
  EXPECT_THAT(arm.free.target_columns(0), ElementsAre(-1, -1, 6, -1, -1, -1));
  EXPECT_THAT(arm.free.target_columns(1), ElementsAre(7, -1, -1, -1, 8, -1));
  EXPECT_THAT(arm.free.target_columns(2), ElementsAre(-1, -1, -1, -1, -1, -1)) << "there is no third one";
  EXPECT_THAT(arm.free.target_columns(1000), ElementsAre(-1, -1, -1, -1, -1, -1));
}

TEST(Unknowns, KnowLengthsFromAngles) {
  const OddArm arm;
  std::vector<bool> lengths;
  for (const Unknown& unknown : arm.free.columns()) {
    lengths.push_back(unknown.length);
  }
  // Joint 2 slides, and its offset is a length.
  EXPECT_THAT(lengths, ElementsAre(true, false, true, false, false, false, true, true, false));
}

TEST(Unknowns, RefuseNamesThatNobodyHas) {
  const OddArm arm;
  for (const char* name : {"dq9", "C.x", "A.Rx", "gravity1", ""}) {  // A has no orientation
    EXPECT_THROW(Unknowns(arm.model, arm.targets, {"dq1", name}), InputError) << name;
  }
}

TEST(Unknowns, TakeANameOnce) {
  const OddArm arm;
  EXPECT_EQ(Unknowns(arm.model, arm.targets, {"dq2", "A.x", "dq2"}).size(), 2);
}

TEST(Unknowns, AreExchangedGroupByGroup) {
  const OddArm arm;
  const Unknowns rigid = arm.free.without(UnknownGroup::effects);
  EXPECT_THAT(rigid.names(), ElementsAre("base.Ty", "base.Rz", "dq2", "dq3", "A.z", "B.x", "B.Ry"));
  EXPECT_NE(rigid, arm.free);
  EXPECT_EQ(rigid.with(arm.model, UnknownGroup::effects, {2, 0}), arm.free);
  // Every coordinate of the targets, orientations that were not measured included.
  std::vector<std::size_t> coordinates(12);
  std::iota(coordinates.begin(), coordinates.end(), 0U);
  const Unknowns all = rigid.with(arm.model, UnknownGroup::targets, coordinates);
  EXPECT_EQ(all.range(UnknownGroup::targets).count, 12);
  EXPECT_THAT(all.target_columns(1), ElementsAre(10, 11, 12, 13, 14, 15));
  EXPECT_EQ(all.columns()[7].name, "A.Rx");
}

TEST(Unknowns, SubsetKeepsTheMarkedOnes) {
  const OddArm arm;
  const Unknowns few = arm.free.subset({false, true, false, true, true, false, false, false, true});
  EXPECT_THAT(few.names(), ElementsAre("base.Rz", "dq3", "gain.1", "B.Ry"));
  EXPECT_EQ(few.column("B.Ry"), 3);
  EXPECT_THAT(few.target_columns(1), ElementsAre(-1, -1, -1, -1, 3, -1));
}

TEST(Unknowns, FramesAreChosenFirstAsByTheReduction) {
  const OddArm arm;
  EXPECT_THAT(arm.free.order_of_choice(), ElementsAre(0, 1, 6, 7, 8, 2, 3, 4, 5));
  const Reduction reduction = reduced_model(arm.model, arm.targets);
  const Unknowns kept(arm.model, arm.targets, reduction.kept);
  std::vector<std::string> names;
  for (const Index column : kept.order_of_choice()) {
    names.push_back(kept.names()[static_cast<std::size_t>(column)]);
  }
  EXPECT_EQ(names, reduction.kept);
}

// base.Ty moves along the base's own y, base.Rz and B.Ry turn about their frames' own axes.
TEST(Unknowns, MoveFramesInTheirOwnAxesAndValuesByAddition) {
  OddArm arm;
  const Estimate start = arm.random_estimate();
  const VectorXd step = arm.random_step();
  const Estimate moved = arm.free.moved(start, step);

  Isometry3d base = start.frames.base();
  base.pretranslate(Vector3d(step[0] * start.frames.base().linear().col(1)));
  base.rotate(Eigen::AngleAxisd(step[1], Vector3d::UnitZ()));
  expect_same_frame(moved.frames.base(), base);
  Isometry3d first = start.frames.targets[0].X_FT;
  first.pretranslate(step[6] * Vector3d::UnitZ());
  expect_same_frame(moved.frames.targets[0].X_FT, first);
  Isometry3d second = start.frames.targets[1].X_FT;
  second.pretranslate(step[7] * Vector3d::UnitX());
  second.rotate(Eigen::AngleAxisd(step[8], Vector3d::UnitY()));
  expect_same_frame(moved.frames.targets[1].X_FT, second);

  VectorXd errors = start.errors;
  errors[static_cast<Index>(parameter_index(arm.model, "dq2"))] += step[2];
  errors[static_cast<Index>(parameter_index(arm.model, "dq3"))] += step[3];
  EXPECT_EQ(moved.errors, errors);
  VectorXd effects = start.effects;
  effects[0] += step[4];
  effects[2] += step[5];
  EXPECT_EQ(moved.effects, effects);
}

TEST(Unknowns, DifferenceUndoesTheMove) {
  OddArm arm;
  for (int round = 0; round < 20; ++round) {
    const Estimate start = arm.random_estimate();
    const VectorXd step = arm.random_step();
    const VectorXd found = arm.free.difference(start, arm.free.moved(start, step));
    EXPECT_LT((found - step).cwiseAbs().maxCoeff(), 1e-14) << found.transpose() << "\nexpected\n" << step.transpose();
  }
}

TEST(Unknowns, AnEstimateWithoutEffectsHasThemAtZero) {
  OddArm arm;
  Estimate start = arm.random_estimate();
  start.effects.resize(0);
  const VectorXd step = arm.random_step();
  const Estimate moved = arm.free.moved(start, step);
  ASSERT_EQ(moved.effects.size(), static_cast<Index>(arm.model.effects.size()));
  EXPECT_EQ(moved.effects[0], step[4]);
  EXPECT_EQ(moved.effects[1], 0.0);
  EXPECT_EQ(arm.free.difference(start, moved)[5], step[5]);
  EXPECT_EQ(arm.free.without(UnknownGroup::effects).moved(start, VectorXd::Zero(7)).effects.size(), 0);
}

TEST(Unknowns, PriorsTellOfErrorsAndEffectsByTheirKind) {
  const OddArm arm;
  const VectorXd information = arm.free.prior_information({.length = 0.5, .angle = 0.25});
  VectorXd expected(9);
  expected << 0.0, 0.0, 4.0, 16.0, 64.0, 64.0, 0.0, 0.0, 0.0;
  EXPECT_EQ(information, expected) << information.transpose();
  EXPECT_EQ(arm.free.prior_information({.length = 0.5})[3], 0.0);
}

TEST(Unknowns, PriorsCountFromTheValue) {
  OddArm arm;
  const Estimate estimate = arm.random_estimate();
  const auto value = [&](const char* name) {
    return Unknowns::value(estimate, arm.free.columns()[static_cast<std::size_t>(*arm.free.column(name))]);
  };
  EXPECT_EQ(value("dq3"), estimate.errors[static_cast<Index>(parameter_index(arm.model, "dq3"))]);
  EXPECT_EQ(value("gain.3"), estimate.effects[2]);
  EXPECT_EQ(value("A.z"), estimate.frames.targets[0].X_FT.translation().z());
  EXPECT_EQ(value("B.Ry"), 0.0);
  EXPECT_EQ(value("base.Ty"), 0.0);
}

}  // namespace
}  // namespace kdl_calibration::unknowns_test
