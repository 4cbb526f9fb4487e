// The search for ripple: it finds swings that were put into rows and nothing in rows without any.

#include "selection/ripple_search.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "support.hpp"

namespace kdl_calibration::ripple_search_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::SizeIs;

constexpr double kHalfTurn = std::numbers::pi;

struct Swing {
  std::size_t joint = 0;
  double times = 0.0;
  double amplitude = 0.0;
  double phase = 0.0;
};

/// Rows of so many configurations, random but for swings of the joints.
struct Rows {
  ErrorModel model;
  MatrixXd q;
  LinearRows rows;
  LinearRows joints;
  VectorXd values;
  std::vector<Index> columns;  // all but the last
  MatrixXd information;

  Rows(const Robot& robot, const MatrixXd& joint_values, Random& random)
      : model(complete_model(robot)), q(joint_values) {
    constexpr Index kRows = 3;
    constexpr Index kColumns = 7;
    const auto normal = [&] { return random.normal(); };
    rows.motions = MatrixXd::NullaryExpr(kRows * q.cols(), kColumns, normal);
    joints.motions = MatrixXd::NullaryExpr(kRows * q.cols(), q.rows(), normal);
    for (Index c = 0; c <= q.cols(); ++c) {
      rows.first.push_back(kRows * c);
    }
    joints.first = rows.first;
    values = VectorXd::NullaryExpr(kColumns, normal);
    rows.y = rows.motions * values + 1e-3 * VectorXd::NullaryExpr(rows.motions.rows(), normal);
    for (Index column = 0; column + 1 < kColumns; ++column) {
      columns.push_back(column);
    }
    information = (rows.motions.transpose() * rows.motions)(columns, columns);
    information.diagonal().array() += 2.0;
  }

  void add(const Swing& swing) {
    for (Index c = 0; c < q.cols(); ++c) {
      const double angle =
          swing.amplitude * std::sin(swing.times * q(static_cast<Index>(swing.joint), c) + swing.phase);
      rows.y.segment(3 * c, 3) += angle * joints.motions.col(static_cast<Index>(swing.joint)).segment(3 * c, 3);
    }
  }

  std::vector<EffectTerm> found(int threads = 1) const {
    return find_ripple({.model = model,
                        .joint_values = q,
                        .rows = rows,
                        .joints = joints,
                        .information = information,
                        .columns = columns,
                        .values = values},
                       threads);
  }
};

MatrixXd uniform(Index joints, Index count, double range, Random& random) {
  return MatrixXd::NullaryExpr(joints, count, [&] { return random.uniform(-0.5 * range, 0.5 * range); });
}

// ---- what it finds -------------------------------------------------------------------------------------------------

TEST(RippleSearch, FindsSwingsTheStrongestFirst) {
  for (const std::uint64_t seed : {7U, 8U, 9U}) {
    Random random(seed);
    const MatrixXd q = uniform(5, 120, 3.0, random);
    Rows data(parse_robot(testing::kOddArm), q, random);
    data.add({.joint = 3, .times = 41.37, .amplitude = 5e-3, .phase = 0.3});
    data.add({.joint = 0, .times = 6.2, .amplitude = 3e-3, .phase = 1.3});
    data.add({.joint = 1, .times = 30.0, .amplitude = 2e-4, .phase = 1.0});  // it slides
    data.add({.joint = 4, .times = 250.25, .amplitude = 2e-3, .phase = 2.3});
    const std::vector<EffectTerm> terms = data.found();
    ASSERT_THAT(terms, SizeIs(6)) << seed;
    EXPECT_EQ(terms[0].index, 3) << seed;
    std::map<int, double> times;
    for (std::size_t i = 0; i < terms.size(); i += 2) {
      const auto& sine = std::get<Sinusoid>(terms[i].function);
      const auto& cosine = std::get<Sinusoid>(terms[i + 1].function);
      times[terms[i].index] = sine.times;
      EXPECT_EQ(terms[i].group(), EffectGroup::ripple);
      EXPECT_EQ(cosine.times, sine.times);
      EXPECT_TRUE(cosine.is_cosine && !sine.is_cosine);
      EXPECT_EQ(terms[i + 1].index, terms[i].index);
    }
    EXPECT_NEAR(times[3], 41.37, 0.1) << seed;
    EXPECT_NEAR(times[0], 6.2, 0.1) << seed;
    EXPECT_NEAR(times[4], 250.25, 0.1) << seed;
    for (const int threads : {2, 3}) {
      const std::vector<EffectTerm> other = data.found(threads);
      ASSERT_EQ(other.size(), terms.size());
      for (std::size_t i = 0; i < terms.size(); ++i) {
        EXPECT_EQ(other[i].name, terms[i].name) << threads << " threads";
      }
    }
  }
}

// One set in a thousand may have one by chance.
TEST(RippleSearch, FindsNothingWhereNothingSwings) {
  int found = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Random random(seed);
    const MatrixXd q = uniform(5, 40, 3.0, random);
    found += Rows(parse_robot(testing::kOddArm), q, random).found().empty() ? 0 : 1;
  }
  EXPECT_LE(found, 1);
}

TEST(RippleSearch, TakesTwelveSwingsAtMost) {
  Random random(8);
  const MatrixXd q = uniform(5, 300, 6.0, random);
  Rows data(parse_robot(testing::kOddArm), q, random);
  for (int i = 0; i < 16; ++i) {
    data.add({.joint = i % 2 == 0 ? 0U : 3U,
              .times = 10.0 + 20.0 * i,
              .amplitude = 0.02 * std::pow(0.8, i),
              .phase = 0.4 * i});
  }
  EXPECT_THAT(data.found(), SizeIs(24));
}

// ---- where it looks ------------------------------------------------------------------------------------------------

/// The first frequency that is found where joint 1 of the FANUC stands at these values and swings so many times a turn;
/// 0 where none is found. The other joints stand still.
double found_of(const VectorXd& values, double times) {
  Random random(9);
  MatrixXd q = MatrixXd::Zero(6, values.size());
  q.row(0) = values.transpose();
  Rows data(testing::fanuc(), q, random);
  data.add({.joint = 0, .times = times, .amplitude = 0.02, .phase = 0.7});
  const std::vector<EffectTerm> terms = data.found();
  return terms.empty() ? 0.0 : std::get<Sinusoid>(terms.front().function).times;
}

VectorXd random_values(Index count, double range) {
  Random random(10);
  VectorXd values = VectorXd::NullaryExpr(count, [&] { return random.uniform(0.0, range); });
  values[0] = 0.0;
  values[1] = range;
  return values;
}

TEST(RippleSearch, LooksFromTwoTo400TimesATurn) {
  const VectorXd values = random_values(80, 6.2);
  EXPECT_NEAR(found_of(values, 2.6), 2.6, 0.1);
  EXPECT_THAT(found_of(values, 1.3), ::testing::AnyOf(0.0, ::testing::Gt(2.0)));
  EXPECT_NEAR(found_of(values, 399.3), 399.3, 0.1);
  EXPECT_EQ(found_of(values, 408.0), 0.0);
}

TEST(RippleSearch, LooksAtJointsThatTurnByTenDegreesAndNotBy25Turns) {
  EXPECT_NEAR(found_of(random_values(80, 0.176), 200.0), 200.0, 3.0);
  EXPECT_EQ(found_of(random_values(80, 0.173), 200.0), 0.0);
  EXPECT_NEAR(found_of(random_values(200, 156.0), 300.0), 300.0, 0.02);
  EXPECT_EQ(found_of(random_values(200, 159.0), 300.0), 0.0);
}

/// Multiples of a spacing, every one off by up to `off`. The steps between neighbours are one of two.
VectorXd on_lattice(double spacing, int short_step, int long_step, double off = 0.0, Index count = 90) {
  Random random(11);
  VectorXd values(count);
  int steps = 3;
  for (double& value : values) {
    value = steps * spacing + random.uniform(-off, off);
    steps += random.uniform(0.0, 1.0) < 0.5 ? short_step : long_step;
  }
  return values;
}

TEST(RippleSearch, OnALatticeLooksUpToHalfItsRate) {
  constexpr double kSpacing = 0.02;
  const double highest = kHalfTurn / kSpacing;
  struct Lattice {
    int short_step;
    int long_step;
    double off;
    bool is_one;
  };
  for (const auto& [short_step, long_step, off, is_one] :
       {Lattice{1, 2, 0.0, true}, Lattice{1, 2, 2e-5, true}, Lattice{2, 3, 0.0, true}, Lattice{4, 5, 2e-5, true},
        Lattice{6, 7, 0.0, true}, Lattice{7, 8, 4e-5, false}, Lattice{1, 2, 6e-4, false}}) {
    const VectorXd values = on_lattice(kSpacing, short_step, long_step, off);
    const std::string what =
        std::to_string(short_step) + ", " + std::to_string(long_step) + ", off by " + std::to_string(off);
    double most = 0.0;
    for (const double share : {0.97, 1.03, 1.6, 2.4}) {
      const double found = found_of(values, share * highest);
      most = std::max(most, found);
      if (is_one) {  // what is above half the rate looks as what is mirrored at it
        EXPECT_NEAR(found, std::abs(share - 2.0 * std::round(0.5 * share)) * highest, 0.1) << what << ", " << share;
      }
    }
    EXPECT_EQ(most > 1.01 * highest, !is_one) << what << ", " << most;
  }
}

// Values that occur twice say nothing of a lattice, and one whose half rate is above all frequencies limits nothing.
TEST(RippleSearch, RepeatedValuesAndFineLatticesLimitNothing) {
  VectorXd twice = on_lattice(0.02, 1, 2, 0.0, 45).replicate(2, 1);
  twice.tail(45).array() += 5e-5;
  const double highest = kHalfTurn / 0.02;
  for (const auto& [share, seen] : {std::pair{1.03, 0.97}, std::pair{1.6, 0.4}, std::pair{2.4, 0.4}}) {
    EXPECT_NEAR(found_of(twice, share * highest), seen * highest, 0.1) << share;
  }
  EXPECT_NEAR(found_of(on_lattice(0.007, 1, 3), 395.0), 395.0, 0.2);
  const double fine = kHalfTurn / 0.009;  // 349
  EXPECT_NEAR(found_of(on_lattice(0.009, 1, 3), 1.03 * fine), 0.97 * fine, 0.2);
}

TEST(RippleSearch, IsNothingWhereNoJointTurnsOrALatticeIsTooCoarse) {
  EXPECT_EQ(found_of(VectorXd::Zero(40), 50.0), 0.0);
  EXPECT_EQ(found_of(on_lattice(1.5, 1, 1, 0.0, 40), 50.0), 0.0);  // up to 2.1 times a turn
}

}  // namespace
}  // namespace kdl_calibration::ripple_search_test
