#include "assessment/order_check.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "base/f_distribution.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/prediction.hpp"
#include "mistake_table.hpp"
#include "onset.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::Draw;
using testing::large_arm;
using testing::light_arm;
using testing::Measured;
using testing::measured;
using testing::onset;

using Kind = OrderFinding::Kind;

// ---- the rule written out ------------------------------------------------------------------------------------------

/// What a column block takes away of the squares beside all free columns.
struct Taken {
  double squares = 0.0;
  double freedom = 0.0;
  VectorXd step;
};

/// Every candidate by least squares over all rows.
class Dense {
public:
  Dense(const ErrorModel& model, const Measurements& data, const Estimate& estimate, const Unknowns& free)
      : data_(data), targets_(static_cast<int>(data.targets.size())) {
    const auto rows = static_cast<Index>(3 * data.observations.size());
    const Unknowns base(model, estimate.targets, base_parameter_names());
    const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, data);
    MatrixXd J(rows, free.size());
    base_.resize(rows, 6);
    turns_.resize(rows, 3);
    residuals_.resize(rows);
    for (std::size_t i = 0; i < data.observations.size(); ++i) {
      const Observation& o = data.observations[i];
      const auto k = static_cast<std::size_t>(o.target);
      const auto at = static_cast<Index>(3 * i);
      J.middleRows<3>(at) = PositionPredictor(model, estimate, free).jacobians(data, o.configuration)[k];
      base_.middleRows<3>(at) = PositionPredictor(model, estimate, base).jacobians(data, o.configuration)[k];
      turns_.middleRows<3>(at) = (estimate.X_WB * X_BF[static_cast<std::size_t>(o.configuration)]).linear();
      residuals_.segment<3>(at) = o.position - predicted_point(estimate, X_BF, o);
    }
    find_visits();
    Q_ = range_of(J, 1e-10);
    left_ = residuals_ - Q_ * (Q_.transpose() * residuals_);
  }

  /// The best explanation, with no regard to chance and share.
  struct Best {
    OrderFinding finding;
    double chance = 1.0;
    double squares = 0.0;
  };
  Best best() const {
    Best best;
    const auto visits = static_cast<Index>(visits_.size());
    const auto consider = [&](Kind kind, int target, Index visit, const MatrixXd& columns) {
      const Taken taken = take(columns);
      const double p = chance(taken);
      if (p < best.chance || (p == best.chance && taken.squares > best.squares)) {
        best.chance = p;
        best.squares = taken.squares;
        best.finding.kind = kind;
        best.finding.target = target;
        best.finding.last_before = visit > 0 ? configuration(visit - 1) : -1;
        best.finding.translation = taken.step.head<3>();
        best.finding.rotation = kind == Kind::step_of_target ? Vector3d(Vector3d::Zero()) : taken.step.tail<3>();
        best.finding.moved = moved(kind, target, taken.step);
      }
    };
    for (Index visit = visits - 2; visit >= 2; --visit) {
      consider(Kind::step_of_base, -1, visit, weighted(base_, [&](Index v, int) { return v >= visit ? 1.0 : 0.0; }));
      for (int target = 0; target < targets_; ++target) {
        consider(Kind::step_of_target, target, visit,
                 weighted(turns_, [&](Index v, int k) { return v >= visit && k == target ? 1.0 : 0.0; }));
      }
    }
    consider(Kind::drift_of_base, -1, 0,
             weighted(base_, [&](Index v, int) { return static_cast<double>(v) / static_cast<double>(visits - 1); }));
    best.finding.share = best.squares / left_.squaredNorm();
    best.finding.left =
        std::sqrt((left_.squaredNorm() - best.squares) / static_cast<double>(data_.observations.size()));
    return best;
  }
  double places() const { return static_cast<double>(visits_.size()) * (1.0 + targets_); }

private:
  void find_visits() {
    std::map<std::pair<int, int>, std::vector<std::size_t>> rows_of;
    for (std::size_t i = 0; i < data_.observations.size(); ++i) {
      rows_of[{data_.observations[i].configuration, data_.observations[i].repeat}].push_back(i);
    }
    std::vector<std::pair<std::int64_t, std::vector<std::size_t>>> timed;
    for (const auto& [key, rows] : rows_of) {
      timed.emplace_back(data_.order.empty() ? static_cast<std::int64_t>(rows[0]) : data_.order[rows[0]], rows);
    }
    std::sort(timed.begin(), timed.end());
    for (const auto& [time, rows] : timed) {
      visits_.push_back(rows);
    }
  }
  int configuration(Index visit) const {
    return data_.observations[visits_[static_cast<std::size_t>(visit)][0]].configuration;
  }
  /// An orthonormal basis of the columns' range, of which nothing below `least` counts.
  static MatrixXd range_of(const MatrixXd& M, double least) {
    if (M.cols() == 0) {
      return M;
    }
    const MatrixXd scaled = M * M.colwise().norm().cwiseMax(1e-300).cwiseInverse().asDiagonal();
    const Eigen::JacobiSVD<MatrixXd> svd(scaled, Eigen::ComputeThinU);
    return svd.matrixU().leftCols((svd.singularValues().array().square() > least).count());
  }
  template <class Weight>
  MatrixXd weighted(const MatrixXd& columns, const Weight& weight) const {
    MatrixXd result = MatrixXd::Zero(columns.rows(), columns.cols());
    for (std::size_t v = 0; v < visits_.size(); ++v) {
      for (const std::size_t i : visits_[v]) {
        const auto at = static_cast<Index>(3 * i);
        result.middleRows<3>(at) =
            weight(static_cast<Index>(v), data_.observations[i].target) * columns.middleRows<3>(at);
      }
    }
    return result;
  }
  Taken take(const MatrixXd& columns) const {
    const VectorXd scale = columns.colwise().norm().cwiseInverse();
    const MatrixXd scaled = columns * scale.asDiagonal();
    const MatrixXd beside = scaled - Q_ * (Q_.transpose() * scaled);
    const Eigen::JacobiSVD<MatrixXd> svd(beside, Eigen::ComputeThinU | Eigen::ComputeThinV);
    const Index rank = (svd.singularValues().array().square() > 1e-6).count();
    const VectorXd along = svd.matrixU().leftCols(rank).transpose() * left_;
    const VectorXd step = svd.matrixV().leftCols(rank) * along.cwiseQuotient(svd.singularValues().head(rank));
    return {.squares = along.squaredNorm(), .freedom = static_cast<double>(rank), .step = scale.asDiagonal() * step};
  }
  double chance(const Taken& taken) const {
    std::set<int> configurations;
    for (const Observation& o : data_.observations) {
      configurations.insert(o.configuration);
    }
    const auto equations = static_cast<double>(residuals_.size());
    const auto rank = static_cast<double>(Q_.cols());
    const double of_configurations =
        3.0 * static_cast<double>(configurations.size()) - std::max(rank - 3.0 * targets_, 0.0);
    const double rest = std::min(of_configurations, equations - rank) - taken.freedom;
    const double left = std::max(left_.squaredNorm() - taken.squares, 1e-12 * left_.squaredNorm());
    return rest < 5.0 || taken.freedom == 0.0
               ? 1.0
               : f_upper_tail(taken.squares / taken.freedom / left * rest, taken.freedom, rest);
  }
  double moved(Kind kind, int target, const VectorXd& step) const {
    double sum = 0.0;
    double count = 0.0;
    for (std::size_t i = 0; i < data_.observations.size(); ++i) {
      const auto at = static_cast<Index>(3 * i);
      if (kind != Kind::step_of_target) {
        sum += (base_.middleRows<3>(at) * step).squaredNorm();
        count += 1.0;
      } else if (data_.observations[i].target == target) {
        sum += step.squaredNorm();
        count += 1.0;
      }
    }
    return std::sqrt(sum / count);
  }

  const Measurements& data_;
  int targets_;
  MatrixXd base_;
  MatrixXd turns_;
  VectorXd residuals_;
  VectorXd left_;
  MatrixXd Q_;
  std::vector<std::vector<std::size_t>> visits_;
};

/// What the second look has beside the free parameters: compliance and gains, with three equations for two columns.
Dense::Best second_look(const Measured& m, const Estimate& fit) {
  ErrorModel wide = m.model;
  wide.effects = load_and_gain_terms(m.model);
  Estimate estimate = fit;
  estimate.effects = VectorXd::Zero(static_cast<Index>(wide.effects.size()));
  const Unknowns free = m.free.with_all(wide, UnknownGroup::effects);
  const auto equations =
      static_cast<double>(3 * m.data.joint_values.cols() * static_cast<Index>(m.data.targets.size()));
  return equations < 1.5 * static_cast<double>(free.size()) ? Dense(m.model, m.data, fit, m.free).best()
                                                            : Dense(wide, m.data, estimate, free).best();
}

Estimate fit_of(const Measured& m) {
  return identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free).estimate;
}

// ---- what is found -------------------------------------------------------------------------------------------------

void move_base(Measured& m, int from, const Vector3d& step, double angle) {
  for (Observation& o : m.data.observations) {
    if (o.configuration >= from) {
      o.position = rotation_exp({angle, 0.0, -angle}) * o.position + step;
    }
  }
}

struct Case {
  const char* name;
  Measured m;
  Kind kind;
};

std::vector<Case> cases() {
  const Vector3d step(8e-4, -6e-4, 4e-4);
  std::vector<Case> all = {
      {"a step", measured(large_arm(), 1, {.configurations = 24}), Kind::step_of_base},
      {"a turn", measured(light_arm(), 2, {.configurations = 24}), Kind::step_of_base},
      {"two visits behind", measured(large_arm(), 3, {.configurations = 24}), Kind::step_of_base},
      {"repeats", measured(large_arm(), 4, {.configurations = 24, .repeats = 2}), Kind::step_of_base},
      {"one target", measured(light_arm(), 5, {.configurations = 24, .targets = 1}), Kind::step_of_base},
      {"a drift", measured(large_arm(), 6, {.configurations = 24}), Kind::drift_of_base},
      {"a target", measured(large_arm(), 7, {.configurations = 24}), Kind::step_of_target}};
  move_base(all[0].m, 7, step, 0.0);
  move_base(all[1].m, 9, Vector3d::Zero(), 0.001);
  move_base(all[2].m, 22, 10.0 * step, 0.0);
  move_base(all[3].m, 8, step, 0.0);
  move_base(all[4].m, 12, 10.0 * step, 0.0);
  for (Observation& o : all[5].m.data.observations) {
    o.position += o.configuration / 23.0 * 3.0 * step;
  }
  for (Observation& o : all[6].m.data.observations) {
    if (o.target == 2 && o.configuration >= 6) {
      o.position += testing::true_flange(all[6].m, o.configuration).linear() * step;
    }
  }
  return all;
}

TEST(OrderCheck, FindsWhatTakesAwayMostOfTheSquaresBesideEverythingThatIsFree) {
  for (const Case& one : cases()) {
    const Estimate fit = fit_of(one.m);
    const Dense::Best expected = second_look(one.m, fit);
    const std::optional<OrderFinding> found = check_order(one.m.model, one.m.data, fit, one.m.free, 0.0);
    ASSERT_TRUE(found) << one.name;
    EXPECT_EQ(found->kind, one.kind) << one.name;
    EXPECT_EQ(found->kind, expected.finding.kind) << one.name;
    EXPECT_EQ(found->target, expected.finding.target) << one.name;
    EXPECT_EQ(found->last_before, expected.finding.last_before) << one.name;
    EXPECT_LT((found->translation - expected.finding.translation).norm(), 1e-4 * expected.finding.moved) << one.name;
    EXPECT_LT((found->rotation - expected.finding.rotation).norm(), 1e-4 * expected.finding.moved) << one.name;
    EXPECT_NEAR(found->moved / expected.finding.moved, 1.0, 1e-4) << one.name;
    EXPECT_NEAR(found->share, expected.finding.share, 1e-5) << one.name;
    EXPECT_NEAR(found->left / expected.finding.left, 1.0, 1e-4) << one.name;
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
  for (const Observation& o : m.data.observations) {
    m.data.order.push_back(100 + o.configuration);
  }
  const std::optional<OrderFinding> stated = check_order(m.model, m.data, fit, m.free);
  ASSERT_TRUE(stated);
  EXPECT_EQ(stated->last_before, 6);
}

// ---- where a finding begins ----------------------------------------------------------------------------------------

TEST(OrderCheck, AFindingBeginsAtAChanceOfOneInAHundredThousandOverAllPlaces) {
  for (const int targets : {1, 3}) {
    const Measured quiet = measured(large_arm(), 8, {.configurations = targets == 1 ? 34 : 20, .targets = targets});
    const auto moved = [&](double size) {
      Measured m = quiet;
      move_base(m, 9, {size, 0.0, 0.0}, 0.0);
      return m;
    };
    const auto found = [&](double size) {
      const Measured m = moved(size);
      return check_order(m.model, m.data, fit_of(m), m.free, 0.0).has_value();
    };
    const double size = onset(0.0, 0.001, found, 9);
    const Measured m = moved(size);
    const Estimate fit = fit_of(m);
    const double first = Dense(m.model, m.data, fit, m.free).best().chance;
    const double second = second_look(m, fit).chance;
    const double places = static_cast<double>(m.data.joint_values.cols()) * (1.0 + targets);
    EXPECT_NEAR(std::log10(std::max(first, second) * places), -5.0, 0.3)
        << targets << " targets, from " << size << " m";
  }
}

TEST(OrderCheck, AFindingTakesAwayTheShareThatIsAskedForAndAQuarterOfItAtFirst) {
  for (const double gain : {0.0, 0.00062}) {
    Measured m = measured(large_arm(), 9, {.configurations = 70, .targets = 1, .gain = gain});
    move_base(m, 33, {2e-3, -1e-3, 1e-3}, 0.0);
    const Estimate fit = fit_of(m);
    const double first = Dense(m.model, m.data, fit, m.free).best().finding.share;
    const double second = second_look(m, fit).finding.share;
    const double share = onset(
        0.0, 1.0, [&](double least) { return !check_order(m.model, m.data, fit, m.free, least); }, 18);
    EXPECT_NEAR(share, std::min(4.0 * first, second), 1e-5) << first << " at first, then " << second;
    EXPECT_EQ(4.0 * first<second, gain> 0.0) << "no fair comparison: " << first << ", " << second;
  }
}

TEST(OrderCheck, AShareOfFourTenthsIsAskedFor) {
  const Measured quiet = measured(large_arm(), 10, {.configurations = 45, .targets = 1});
  const auto disturbed = [&](double noise) {
    Measured m = quiet;
    Random random(3);
    for (Observation& o : m.data.observations) {
      o.position += noise * Vector3d{random.normal(), random.normal(), random.normal()};
    }
    move_base(m, 21, {5e-4, -3e-4, 2e-4}, 0.0);
    return m;
  };
  const double noise = onset(
      0.0, 0.001,
      [&](double size) {
        const Measured m = disturbed(size);
        return !check_order(m.model, m.data, fit_of(m), m.free);
      },
      9);
  const Measured m = disturbed(noise);
  EXPECT_NEAR(second_look(m, fit_of(m)).finding.share, 0.4, 0.01) << "with noise of " << noise << " m";
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

// Three configurations are nine coordinates, of which a step of the base explains six.
TEST(OrderCheck, NeedsFiveCoordinatesThatTellHowLargeTheRestIs) {
  for (const int configurations : {3, 4}) {
    Measured m = measured(large_arm(), 13, {.configurations = configurations, .targets = 3, .repeats = 2});
    m.truth.effects.resize(0);
    move_base(m, 2, {0.01, 0.0, 0.0}, 0.0);
    const std::optional<OrderFinding> found = check_order(m.model, m.data, m.truth, Unknowns());
    EXPECT_EQ(found && found->kind == Kind::step_of_base, configurations == 4);
  }
}

// Compliance and gains are free where three equations stand for two columns, else they are not.
TEST(OrderCheck, LooksBesideTheJointsEffectsWhereTheDataLeaveFreedomForThem) {
  bool narrow = false;
  bool wide = false;
  for (int configurations = 7; configurations <= 11; ++configurations) {
    Measured m =
        measured(large_arm(), 12, {.configurations = configurations, .targets = 1, .length = 0.0, .angle = 0.0});
    m.free = m.free.without(UnknownGroup::geometric);
    move_base(m, configurations / 2, {0.02, 0.01, 0.0}, 0.0);
    const Estimate fit = fit_of(m);
    const Dense::Best expected = second_look(m, fit);
    const std::optional<OrderFinding> found = check_order(m.model, m.data, fit, m.free, 0.0);
    const auto columns = static_cast<double>(m.free.size()) + static_cast<double>(load_and_gain_terms(m.model).size());
    (3.0 * configurations < 1.5 * columns ? narrow : wide) = true;
    ASSERT_EQ(found.has_value(), expected.chance * 2.0 * configurations < 1e-5) << configurations;
    if (found) {
      EXPECT_NEAR(found->share, expected.finding.share, 1e-6) << configurations;
    }
  }
  EXPECT_TRUE(narrow && wide) << "no fair comparison";
}

}  // namespace
}  // namespace kdl_calibration
