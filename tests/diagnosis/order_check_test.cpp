#include "diagnosis/order_check.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "mistake_table.hpp"

namespace kdl_calibration::order_check_test {
namespace {

using Eigen::Vector3d;
using testing::large_arm;
using testing::light_arm;
using testing::Measured;
using testing::measured;

using Kind = OrderFinding::Kind;

Estimate fit_of(const Measured& m) {
  return identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free).estimate;
}

// ---- what is found -------------------------------------------------------------------------------------------------

void move_base(Measured& m, int from, const Vector3d& step, double angle) {
  for (Observation& o : m.data.observations) {
    if (o.configuration >= from) {
      o.position() = rotation_exp({angle, 0.0, -angle}) * o.position() + step;
    }
  }
}

struct Case {
  const char* name;
  Measured m;
  Kind kind;
  int last_before = -1;
  double moved = 0.0;  // [m]; 0: not known in closed form
  int target = -1;
};

std::vector<Case> cases() {
  const Vector3d step(8e-4, -6e-4, 4e-4);
  std::vector<Case> all = {
      {"a step", measured(large_arm(), 1, {.configurations = 24}), Kind::step_of_base, 6, step.norm()},
      {"a turn", measured(light_arm(), 2, {.configurations = 24}), Kind::step_of_base, 8},
      {"two visits behind", measured(large_arm(), 3, {.configurations = 24}), Kind::step_of_base, 21},
      {"repeats", measured(large_arm(), 4, {.configurations = 24, .repeats = 2}), Kind::step_of_base, 7, step.norm()},
      {"one target", measured(light_arm(), 5, {.configurations = 24, .targets = 1}), Kind::step_of_base, 11},
      {"a drift", measured(large_arm(), 6, {.configurations = 24}), Kind::drift_of_base},
      {"a target", measured(large_arm(), 7, {.configurations = 24}), Kind::step_of_target, 5, step.norm(), 2}};
  move_base(all[0].m, 7, step, 0.0);
  move_base(all[1].m, 9, Vector3d::Zero(), 0.001);
  move_base(all[2].m, 22, 10.0 * step, 0.0);
  move_base(all[3].m, 8, step, 0.0);
  move_base(all[4].m, 12, 10.0 * step, 0.0);
  for (Observation& o : all[5].m.data.observations) {
    o.position() += o.configuration / 23.0 * 3.0 * step;
  }
  for (Observation& o : all[6].m.data.observations) {
    if (o.target == 2 && o.configuration >= 6) {
      o.position() += testing::true_flange(all[6].m, o.configuration).linear() * step;
    }
  }
  return all;
}

TEST(OrderCheck, FindsWhatMovedWhenAndByHowMuch) {
  for (const Case& one : cases()) {
    const std::optional<OrderFinding> found = check_order(one.m.model, one.m.data, fit_of(one.m), one.m.free);
    ASSERT_TRUE(found) << one.name;
    EXPECT_EQ(found->kind, one.kind) << one.name;
    EXPECT_EQ(found->target, one.target) << one.name;
    EXPECT_EQ(found->last_before, one.last_before) << one.name;
    if (one.moved > 0.0) {
      EXPECT_NEAR(found->moved, one.moved, 0.2 * one.moved) << one.name;
    }
    EXPECT_GT(found->share, 0.4) << one.name;
  }
}

TEST(OrderCheck, AccusesNothingThatStoodStill) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), seed, {.configurations = 24});
    EXPECT_FALSE(check_order(m.model, m.data, fit_of(m), m.free)) << seed;
  }
}

// The visits are ordered by the angle of the shoulder, so its sag changes along the order.
TEST(OrderCheck, AccusesNoArmThatSagsAlongTheOrder) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Measured m = measured(large_arm(), seed, {.configurations = 24, .effect = 0.002});
    for (Observation& o : m.data.observations) {
      o.order = std::lround(1e6 * m.data.joint_values(1, o.configuration));
    }
    EXPECT_FALSE(check_order(m.model, m.data, fit_of(m), m.free)) << seed;
  }
}

// The rows of a visit need not stand together, and visits not in their order.
TEST(OrderCheck, TakesVisitsInTheOrderThatIsStatedElseInThatOfTheirFirstRows) {
  Measured m = measured(large_arm(), 1, {.configurations = 24});
  move_base(m, 7, {8e-4, -6e-4, 4e-4}, 0.0);
  const Estimate fit = fit_of(m);
  const std::optional<OrderFinding> found = check_order(m.model, m.data, fit, m.free);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->last_before, 6);
  std::stable_sort(m.data.observations.begin(), m.data.observations.end(),
                   [](const Observation& a, const Observation& b) { return a.target < b.target; });
  const std::optional<OrderFinding> sorted = check_order(m.model, m.data, fit, m.free);
  ASSERT_TRUE(sorted);
  EXPECT_EQ(sorted->last_before, 6);
  EXPECT_NEAR(sorted->share, found->share, 1e-9);
  std::reverse(m.data.observations.begin(), m.data.observations.end());
  const std::optional<OrderFinding> reversed = check_order(m.model, m.data, fit, m.free);
  ASSERT_TRUE(reversed);
  EXPECT_EQ(reversed->last_before, 7);
  for (Observation& o : m.data.observations) {
    o.order = 100 + o.configuration;
  }
  const std::optional<OrderFinding> stated = check_order(m.model, m.data, fit, m.free);
  ASSERT_TRUE(stated);
  EXPECT_EQ(stated->last_before, 6);
}

TEST(OrderCheck, NeedsFiveVisits) {
  for (const int configurations : {4, 5}) {
    Measured m = measured(large_arm(), 11, {.configurations = configurations});
    const Estimate truth = [&] {
      Estimate rigid = m.truth;
      rigid.effects.resize(0);
      return rigid;
    }();
    move_base(m, 2, {0.01, 0.0, 0.0}, 0.0);
    const std::optional<OrderFinding> found = check_order(m.model, m.data, truth, Unknowns());
    ASSERT_EQ(found.has_value(), configurations == 5);
    EXPECT_EQ(found ? found->last_before : 1, 1);
  }
}

}  // namespace
}  // namespace kdl_calibration::order_check_test
