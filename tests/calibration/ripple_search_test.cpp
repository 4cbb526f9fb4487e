// The search for ripple against the same written out slowly, and where frequencies are looked for.

#include "calibration/ripple_search.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "base/f_distribution.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "support.hpp"

namespace kdl_calibration::ripple_search_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::IsEmpty;
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
    rows.J = MatrixXd::NullaryExpr(kRows * q.cols(), kColumns, normal);
    joints.J = MatrixXd::NullaryExpr(kRows * q.cols(), q.rows(), normal);
    for (Index c = 0; c <= q.cols(); ++c) {
      rows.first.push_back(kRows * c);
    }
    joints.first = rows.first;
    values = VectorXd::NullaryExpr(kColumns, normal);
    rows.y = rows.J * values + 1e-3 * VectorXd::NullaryExpr(rows.J.rows(), normal);
    for (Index column = 0; column + 1 < kColumns; ++column) {
      columns.push_back(column);
    }
    information = (rows.J.transpose() * rows.J)(columns, columns);
    information.diagonal().array() += 2.0;
  }

  void add(const Swing& swing) {
    for (Index c = 0; c < q.cols(); ++c) {
      const double angle =
          swing.amplitude * std::sin(swing.times * q(static_cast<Index>(swing.joint), c) + swing.phase);
      rows.y.segment(3 * c, 3) += angle * joints.J.col(static_cast<Index>(swing.joint)).segment(3 * c, 3);
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

// ---- written out ---------------------------------------------------------------------------------------------------

double t_squared(const MatrixXd& sample) {
  const auto n = static_cast<double>(sample.rows());
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (Index c = 0; c < sample.rows(); ++c) {
    mean += sample.row(c).transpose() / n;
  }
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  for (Index c = 0; c < sample.rows(); ++c) {
    const Eigen::Vector2d off = sample.row(c).transpose() - mean;
    covariance += off * off.transpose() / (n - 1.0);
  }
  return n * mean.dot(covariance.inverse() * mean);
}

/// What was found one after the other, and with which p-value after all that were tried; the last is not significant.
struct ByHand {
  std::vector<std::pair<std::size_t, double>> swings;
  std::vector<double> p;
};

class SlowSearch {
public:
  explicit SlowSearch(const Rows& data) : data_(data), rest_(data.rows.y - data.rows.J * data.values) {}

  ByHand search() {
    ByHand result;
    for (int round = 0; round < 12; ++round) {
      const auto [joint, coarse, tried] = best_on_grid();
      const double times = refined(joint, coarse);
      const MatrixXd columns = columns_of(joint, times);
      MatrixXd own = columns;
      const MatrixXd J = data_.rows.J(Eigen::all, data_.columns);
      own -= J * (data_.information.inverse() * (J.transpose() * columns));
      MatrixXd sample(data_.q.cols(), 2);
      for (Index c = 0; c < sample.rows(); ++c) {
        sample.row(c) = rest_.segment(3 * c, 3).transpose() * own.middleRows(3 * c, 3);
      }
      const auto n = static_cast<double>(sample.rows());
      const double F = (n - 2.0) / (2.0 * (n - 1.0)) * t_squared(sample);
      result.p.push_back(f_upper_tail(F, 2.0, n - 2.0) * tried);
      if (result.p.back() > 0.001) {
        break;
      }
      result.swings.emplace_back(joint, times);
      const Eigen::Matrix2d normal = columns.transpose() * own;
      rest_ -= own * (normal.inverse() * (columns.transpose() * rest_));
    }
    return result;
  }

private:
  struct Found {
    std::size_t joint = 0;
    double times = 0.0;
    double tried = 0.0;
  };

  double step(std::size_t joint) const {
    const auto row = data_.q.row(static_cast<Index>(joint));
    return kHalfTurn / (row.maxCoeff() - row.minCoeff());
  }

  Found best_on_grid() const {
    Found result;
    double most = 0.0;
    for (std::size_t joint = 0; joint < data_.model.joints.size(); ++joint) {
      if (data_.model.joints[joint].type == JointType::prismatic) {
        continue;
      }
      for (int n = 1; 2.0 + n * step(joint) <= 400.0; ++n) {
        const double times = 2.0 + n * step(joint);
        result.tried += 1.0;
        MatrixXd sample(data_.q.cols(), 2);
        for (Index c = 0; c < sample.rows(); ++c) {
          const double angle = times * data_.q(static_cast<Index>(joint), c);
          sample.row(c) << std::sin(angle), std::cos(angle);
          sample.row(c) *= motion(joint, c).dot(rest_.segment(3 * c, 3));
        }
        const double value = t_squared(sample);
        if (value > most) {
          most = value;
          result.joint = joint;
          result.times = times;
        }
      }
    }
    return result;
  }

  double refined(std::size_t joint, double coarse) const {
    double best = coarse;
    double most = 0.0;
    for (int part = -20; part <= 20; ++part) {
      const double times = std::round(100.0 * (coarse + step(joint) * part / 20)) / 100.0;
      if (times <= 2.0 || times > 400.0) {
        continue;
      }
      const MatrixXd columns = columns_of(joint, times);
      const Eigen::Vector2d moment = columns.transpose() * rest_;
      const Eigen::Matrix2d normal = columns.transpose() * columns;
      const double squares = moment.dot(normal.inverse() * moment);
      if (squares > most) {
        most = squares;
        best = times;
      }
    }
    return best;
  }

  VectorXd motion(std::size_t joint, Index c) const {
    return data_.joints.J.col(static_cast<Index>(joint)).segment(3 * c, 3);
  }

  MatrixXd columns_of(std::size_t joint, double times) const {
    MatrixXd result(rest_.size(), 2);
    for (Index c = 0; c < data_.q.cols(); ++c) {
      const double angle = times * data_.q(static_cast<Index>(joint), c);
      result.block(3 * c, 0, 3, 1) = motion(joint, c) * std::sin(angle);
      result.block(3 * c, 1, 3, 1) = motion(joint, c) * std::cos(angle);
    }
    return result;
  }

  const Rows& data_;
  VectorXd rest_;
};

/// Sines and cosines with these joints and frequencies, in this order.
void expect_terms(const std::vector<EffectTerm>& terms, const ByHand& by_hand, const std::string& what) {
  std::vector<std::pair<std::size_t, double>> found;
  for (std::size_t i = 0; i < terms.size(); i += 2) {
    found.emplace_back(static_cast<std::size_t>(terms[i].index), terms[i].harmonic);
    EXPECT_EQ(terms[i].group, EffectGroup::ripple);
    EXPECT_EQ(terms.at(i + 1).harmonic, -terms[i].harmonic);
  }
  EXPECT_EQ(found, by_hand.swings) << what;
}

TEST(RippleSearch, FindsWhatASlowSearchFinds) {
  double least_refused = 1.0;
  double most_taken = 0.0;
  for (int step = 0; step < 11; ++step) {
    Random random(7);
    const MatrixXd q = uniform(5, 60, 3.0, random);
    Rows data(parse_robot(testing::kOddArm), q, random);
    data.add({.joint = 3, .times = 41.37, .amplitude = 5e-3, .phase = 0.3});
    data.add({.joint = 0, .times = 3.0, .amplitude = 2e-3, .phase = 1.3});
    data.add({.joint = 1, .times = 30.0, .amplitude = 2e-4, .phase = 1.0});  // it slides
    data.add({.joint = 4, .times = 250.25, .amplitude = 7.6e-4 * std::pow(1.06, step), .phase = 2.3});
    const ByHand by_hand = SlowSearch(data).search();
    expect_terms(data.found(step % 3 + 1), by_hand, "step " + std::to_string(step));
    ASSERT_FALSE(by_hand.p.empty());
    for (const double p : by_hand.p) {
      (p > 0.001 ? least_refused : most_taken) = p > 0.001 ? std::min(least_refused, p) : std::max(most_taken, p);
    }
  }
  EXPECT_LT(least_refused, 8e-3) << "nothing lay close above the level";
  EXPECT_GT(most_taken, 1.5e-4) << "nothing lay close below the level";
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
  return terms.empty() ? 0.0 : std::abs(terms.front().harmonic);
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
