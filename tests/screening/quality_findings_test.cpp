#include "screening/quality_findings.hpp"

#include <gmock/gmock.h>

#include <array>

#include "screening/messages.hpp"

namespace kdl_calibration::quality_findings_test {
namespace {

using Eigen::Vector3d;
using ::testing::ElementsAre;
using testing::messages;

/// Rows (configuration, repeat, target) of three configurations "a", "b", "c" and four targets.
Measurements with_rows(const std::vector<std::array<int, 3>>& rows) {
  Measurements measurements;
  measurements.configurations = {"a", "b", "c"};
  measurements.targets = {"A", "B", "C", "D"};
  for (const auto& [configuration, repeat, target] : rows) {
    measurements.observations.push_back({.reading = Point{Vector3d::Zero()},
                                         .configuration = configuration,
                                         .target = target,
                                         .repeat = repeat,
                                         .split = Split::train});
  }
  return measurements;
}

const Measurements& three_repeats() {
  static const Measurements measurements =
      with_rows({{1, 1, 0}, {1, 1, 1}, {1, 2, 0}, {1, 2, 1}, {1, 3, 0}, {1, 3, 1}, {2, 1, 2}, {2, 1, 3}});
  return measurements;
}

// ---- repeats together ----------------------------------------------------------------------------------------------

Found found_at(QualityKind kind, int configuration, int repeat, const std::vector<std::string>& targets,
               const Vector3d& offset) {
  Found found{.finding = {}, .configuration = configuration, .rows = {}};
  found.finding.kind = kind;
  found.finding.repeat = repeat;
  found.finding.targets = targets;
  found.finding.offset = offset;
  found.finding.amount = offset.norm();
  return found;
}

std::vector<QualityFinding> together(const std::vector<Found>& all) {
  return put_together(three_repeats(), groups_of(three_repeats()), all);
}

TEST(QualityFindings, WhatEveryRepeatHasIsOneFindingOfTheMean) {
  const std::vector<QualityFinding> found =
      together({found_at(QualityKind::displaced_point, 1, 3, {"B"}, {0.001, 0.0, 0.0}),
                found_at(QualityKind::displaced_point, 1, 1, {"B"}, {0.0, 0.002, 0.0}),
                found_at(QualityKind::displaced_point, 1, 2, {"B"}, {0.0, 0.0, 0.006})});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].configuration, "b");
  EXPECT_EQ(found[0].repeat, 0);
  EXPECT_NEAR(found[0].amount, 0.003, 1e-15);
  EXPECT_LT((found[0].offset - Vector3d(0.001, 0.002, 0.006) / 3.0).norm(), 1e-15);
  EXPECT_EQ(found[0].message, "target B in configuration b is off by about 3.0 mm in every repeat");
}

TEST(QualityFindings, WhatSomeRepeatsHaveStaysAFindingOfEach) {
  const std::vector<QualityFinding> found =
      together({found_at(QualityKind::swapped_targets, 1, 1, {"A", "B"}, {0.1, 0.0, 0.0}),
                found_at(QualityKind::swapped_targets, 1, 3, {"A", "B"}, {0.3, 0.0, 0.0}),
                found_at(QualityKind::swapped_targets, 2, 1, {"C", "D"}, {0.1, 0.0, 0.0})});
  EXPECT_THAT(messages(found), ElementsAre("targets A and B are swapped in configuration b, repeat 1",
                                           "targets A and B are swapped in configuration b, repeat 3",
                                           "targets C and D are swapped in configuration c"));
  EXPECT_THAT(std::vector<int>({found[0].repeat, found[1].repeat, found[2].repeat}), ElementsAre(1, 3, 1));
  EXPECT_EQ(found[1].amount, 0.3);
}

TEST(QualityFindings, OtherTargetsKindsAndAxesAreOtherFindings) {
  std::vector<Found> all = {found_at(QualityKind::mistyped_coordinate, 1, 1, {"A"}, {0.01, 0.0, 0.0}),
                            found_at(QualityKind::mistyped_coordinate, 1, 2, {"A"}, {0.0, -0.02, 0.0}),
                            found_at(QualityKind::mistyped_coordinate, 1, 3, {"B"}, {0.0, 0.0, 0.03})};
  all[0].finding.axis = 'x';
  all[1].finding.axis = 'y';
  all[2].finding.axis = 'z';
  EXPECT_THAT(messages(together(all)), ElementsAre("target A in configuration b, repeat 1: x is off by about 10.0 mm",
                                                   "target A in configuration b, repeat 2: y is off by about -20.0 mm",
                                                   "target B in configuration b, repeat 3: z is off by about 30.0 mm"));
}

// ---- words ---------------------------------------------------------------------------------------------------------

TEST(QualityFindings, SayEachKindInItsWords) {
  const Vector3d off(0.003, 0.0, 0.004);
  std::vector<Found> all = {found_at(QualityKind::swapped_targets, 2, 1, {"A", "B", "C"}, off),
                            found_at(QualityKind::mistaken_target, 2, 1, {"C", "D"}, off),
                            found_at(QualityKind::mistyped_coordinate, 2, 1, {"C"}, off),
                            found_at(QualityKind::displaced_point, 2, 1, {"C", "D"}, off),
                            found_at(QualityKind::displaced_configuration, 2, 1, {"A", "C", "D"}, off)};
  all[2].finding.axis = 'z';
  EXPECT_THAT(
      messages(together(all)),
      ElementsAre("targets A, B and C are swapped in configuration c",
                  "target C in configuration c lies where target D is",
                  "target C in configuration c, repeat 1: z is off by about 4.0 mm",
                  "target C or D in configuration c, repeat 1 is off by about 5.0 mm",
                  "targets A, C and D in configuration c are off by up to 5.0 mm; are its joint values right?"));
}

TEST(QualityFindings, SayTheRepeatWhereOthersAreRight) {
  const Vector3d off(0.003, 0.0, 0.004);
  EXPECT_THAT(messages(together({found_at(QualityKind::mistaken_target, 1, 2, {"A", "B"}, off),
                                 found_at(QualityKind::displaced_configuration, 1, 2, {"A", "B"}, off)})),
              ElementsAre("target A in configuration b, repeat 2 lies where target B is",
                          "targets A and B in configuration b, repeat 2 are off by up to 5.0 mm; are its joint values "
                          "right?"));
}

TEST(QualityFindings, SayASlipAfterTheLastConfigurationBeforeIt) {
  const QualityFinding found = slip(three_repeats(), 1, {2, 0, 3}, 0.0012, {0.0, -0.0012, 0.0});
  EXPECT_EQ(found.kind, QualityKind::slipped_target);
  EXPECT_EQ(found.configuration, "b");
  EXPECT_EQ(found.repeat, 0);
  EXPECT_THAT(found.targets, ElementsAre("A", "C", "D"));
  EXPECT_EQ(found.amount, 0.0012);
  EXPECT_EQ(found.offset, Vector3d(0.0, -0.0012, 0.0));
  EXPECT_EQ(found.message, "target A, C or D slipped by about 1.2 mm after configuration b");
}

// Distances tell no direction.
TEST(QualityFindings, AnAmountWithoutADirectionIsABound) {
  EXPECT_EQ(slip(three_repeats(), 0, {1}, 0.0012, Vector3d::Zero()).message,
            "target B slipped by at least 1.2 mm after configuration a");
}

}  // namespace
}  // namespace kdl_calibration::quality_findings_test
