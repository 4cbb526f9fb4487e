#include "assessment/quality_findings.hpp"

#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "refusal.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::refusal;

/// Rows (configuration, repeat, target) of three configurations "a", "b", "c" and four targets.
Measurements with_rows(const std::vector<std::array<int, 3>>& rows) {
  Measurements measurements;
  measurements.configurations = {"a", "b", "c"};
  measurements.targets = {"A", "B", "C", "D"};
  for (const auto& [configuration, repeat, target] : rows) {
    measurements.observations.push_back({.position = Vector3d::Zero(),
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

// ---- rows that were measured together ------------------------------------------------------------------------------

TEST(QualityFindings, GroupsAreTheRowsOfARepeatInTheOrderOfConfigurations) {
  const Measurements rows = with_rows({{2, 1, 0}, {0, 2, 0}, {0, 1, 3}, {2, 1, 1}, {0, 2, 1}, {0, 1, 2}});
  const std::vector<Group> groups = groups_of(rows);
  ASSERT_EQ(groups.size(), 3U);
  EXPECT_EQ(groups[0].configuration, 0);
  EXPECT_EQ(groups[0].repeat, 1);
  EXPECT_THAT(groups[0].rows, ElementsAre(2, 5));
  EXPECT_EQ(groups[1].configuration, 0);
  EXPECT_EQ(groups[1].repeat, 2);
  EXPECT_THAT(groups[1].rows, ElementsAre(1, 4));
  EXPECT_EQ(groups[2].configuration, 2);
  EXPECT_EQ(groups[2].repeat, 1);
  EXPECT_THAT(groups[2].rows, ElementsAre(0, 3));
}

TEST(QualityFindings, SigmasCountBesideTheirMedianWhereEveryRowStatesOne) {
  Measurements rows = with_rows({{0, 1, 0}, {0, 1, 1}, {0, 1, 2}, {0, 1, 3}});
  const std::vector<double> sigmas = {4e-5, 1e-5, 8e-5, 2e-5};
  for (std::size_t i = 0; i < sigmas.size(); ++i) {
    rows.observations[i].sigma = sigmas[i];
  }
  const std::vector<double> relative = relative_sigmas(rows);
  ASSERT_EQ(relative.size(), 4U);
  for (std::size_t i = 0; i < sigmas.size(); ++i) {
    EXPECT_DOUBLE_EQ(relative[i], sigmas[i] / 3e-5);
  }
  rows.observations[2].sigma = 0.0;
  EXPECT_THAT(relative_sigmas(rows), ElementsAre(1.0, 1.0, 1.0, 1.0));
}

TEST(QualityFindings, AFindingNamesItsTargetsInTheirOrder) {
  const Measurements rows = with_rows({{1, 2, 3}, {1, 2, 0}, {1, 2, 2}});
  const Found found = found_in(rows, {.configuration = 1, .repeat = 2, .rows = {0, 1, 2}},
                               QualityKind::displaced_configuration, {0, 1, 2});
  EXPECT_EQ(found.configuration, 1);
  EXPECT_THAT(found.rows, ElementsAre(1, 2, 0));
  EXPECT_EQ(found.finding.kind, QualityKind::displaced_configuration);
  EXPECT_EQ(found.finding.repeat, 2);
  EXPECT_THAT(found.finding.targets, ElementsAre("A", "C", "D"));
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

std::vector<std::string> messages(const std::vector<QualityFinding>& findings) {
  std::vector<std::string> result;
  for (const QualityFinding& finding : findings) {
    result.push_back(finding.message);
  }
  return result;
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

TEST(QualityFindings, AmountsHaveMoreDigitsTheSmallerTheyAre) {
  const std::vector<std::pair<double, std::string>> expected = {
      {1.2345, "1234.5 mm"},   {0.00096, "1.0 mm"},      {0.00094, "0.94 mm"}, {0.000096, "0.10 mm"},
      {0.000094, "0.0940 mm"}, {0.0000123, "0.0123 mm"}, {-0.00234, "-2.3 mm"}};
  for (const auto& [amount, text] : expected) {
    EXPECT_EQ(slip(three_repeats(), 0, {1}, amount, Vector3d::UnitX()).message,
              "target B slipped by about " + text + " after configuration a");
  }
}

TEST(QualityFindings, EachKindHasItsName) {
  const std::vector<QualityKind> kinds = {QualityKind::slipped_target,  QualityKind::swapped_targets,
                                          QualityKind::mistaken_target, QualityKind::mistyped_coordinate,
                                          QualityKind::displaced_point, QualityKind::displaced_configuration};
  std::vector<std::string> names;
  for (const QualityKind kind : kinds) {
    names.push_back(to_string(kind));
  }
  EXPECT_THAT(names, ElementsAre("slipped_target", "swapped_targets", "mistaken_target", "mistyped_coordinate",
                                 "displaced_point", "displaced_configuration"));
}

// ---- options -------------------------------------------------------------------------------------------------------

TEST(QualityFindings, ThresholdsThatAreNoneAreRefused) {
  check(QualityOptions{.false_alarm = 0.0, .noise_floor = 0.0, .smallest_slip = 0.0});
  for (const double none : {-1e-12, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THAT(refusal([&] { check(QualityOptions{.false_alarm = none}); }),
                HasSubstr("the probability of a false alarm"));
    EXPECT_THAT(refusal([&] { check(QualityOptions{.noise_floor = none}); }), HasSubstr("the floor of the noise"));
    EXPECT_THAT(refusal([&] { check(QualityOptions{.smallest_slip = none}); }), HasSubstr("the smallest slip"));
  }
}

}  // namespace
}  // namespace kdl_calibration
