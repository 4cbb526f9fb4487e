// What measurements tell of tables, by the covariance of a dense inverse.

#include "selection/table_certainty.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>
#include <numeric>

#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::table_certainty_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using ::testing::IsEmpty;

using Ranges = std::vector<std::pair<double, double>>;

/// A small arm whose joints have gains and tables, and random rows that tell something of them.
struct Setting {
  testing::VirtualExperiment arm;
  Candidate candidate;
  Groups groups;
  MatrixXd information;
  GroupSizes sizes;

  explicit Setting(unsigned seed = 1)
      : arm({.model = complete_model(parse_robot(testing::kOddArm)), .random = Random(seed)}) {
    const MatrixXd q = arm.configurations(20);
    std::vector<EffectTerm> terms = effect_terms(arm.model, EffectGroup::gain, q);
    const std::vector<EffectTerm> tables = table_terms(arm.model, q, 0.6);
    terms.insert(terms.end(), tables.begin(), tables.end());
    candidate = with_terms(arm.model, arm.free, terms, true);
    groups = groups_of(candidate, {});
    const MatrixXd J =
        MatrixXd::NullaryExpr(candidate.free.size() + 15, candidate.free.size(), [&] { return arm.random.normal(); });
    information = J.transpose() * J;
    sizes.sigma = 1e-3;
    for (const std::string& name : groups.names) {
      sizes.sizes.push_back(name == "tables.4" || name == "gain" ? 0.0 : 3e-4);
    }
  }
};

/// The sizes with the root of the covariance that they have with so many times the information.
GroupSizes with_root(const Setting& s, double times = 1.0) {
  const Index n = s.information.cols();
  std::vector<Index> all(static_cast<std::size_t>(n));
  std::iota(all.begin(), all.end(), Index{0});
  const LinearSums sums{
      .information = times * s.information, .moment = VectorXd::Zero(n), .squares = 0.0, .equations = 1e6};
  return SizeEstimator(sums, all, s.groups.columns).estimate(s.sizes, {.held = s.sizes.sizes}, s.sizes.sigma);
}

/// The covariance of all columns with what their sizes say; zero of those that are switched off.
MatrixXd covariance_by_hand(const Setting& s) {
  VectorXd prior = VectorXd::Zero(s.information.cols());  // 1 / sigma^2
  std::vector<bool> off(static_cast<std::size_t>(prior.size()), false);
  for (std::size_t g = 0; g < s.groups.columns.size(); ++g) {
    for (const Index column : s.groups.columns[g]) {
      prior[column] = 1.0 / (s.sizes.sizes[g] * s.sizes.sizes[g]);
      off[static_cast<std::size_t>(column)] = s.sizes.sizes[g] == 0.0;
    }
  }
  std::vector<Index> on;
  for (Index column = 0; column < prior.size(); ++column) {
    if (!off[static_cast<std::size_t>(column)]) {
      on.push_back(column);
    }
  }
  MatrixXd M = s.information(on, on) / (s.sizes.sigma * s.sizes.sigma);
  M += VectorXd(prior(on)).asDiagonal();
  const MatrixXd inverse = M.inverse();
  MatrixXd covariance = MatrixXd::Zero(prior.size(), prior.size());
  covariance(on, on) = inverse;
  return covariance;
}

double size_of(const Setting& s, const EffectTerm& term) {
  const auto found = std::find(s.groups.names.begin(), s.groups.names.end(), size_name(term));
  return s.sizes.sizes.at(static_cast<std::size_t>(found - s.groups.names.begin()));
}

/// 1 sigma of a joint's table at a value afterwards over beforehand; 0 of no table.
double share_by_hand(const Setting& s, const MatrixXd& covariance, int joint, double value) {
  VectorXd functions = VectorXd::Zero(covariance.cols());
  double size = 0.0;
  for (std::size_t e = 0; e < s.candidate.model.effects.size(); ++e) {
    const EffectTerm& term = s.candidate.model.effects[e];
    if (is_of_table(term) && term.index == joint) {
      functions[*s.candidate.free.column(UnknownGroup::effects, e)] =
          table_value(std::get<JointTable>(term.function), value);
      size = size_of(s, term);
    }
  }
  return size > 0.0 ? std::sqrt(functions.dot(covariance * functions)) / (size * functions.norm()) : 0.0;
}

const JointTable& table_of(const Setting& s, int joint) {
  const auto found = std::find_if(s.candidate.model.effects.begin(), s.candidate.model.effects.end(),
                                  [&](const EffectTerm& term) { return is_of_table(term) && term.index == joint; });
  return std::get<JointTable>(found->function);
}

TEST(TableCertainty, SizesAddTheirInformation) {
  const Setting s;
  const SizedInformation sized = sized_information(s.information, s.groups, s.sizes);
  const MatrixXd covariance = covariance_by_hand(s);
  ASSERT_EQ(sized.matrix.rows(), static_cast<Index>(sized.columns.size()));
  const MatrixXd expected = covariance(sized.columns, sized.columns);
  EXPECT_LT((s.sizes.sigma * s.sizes.sigma * sized.matrix.inverse() - expected).norm(), 1e-9 * expected.norm());
  MatrixXd others = covariance;
  others(sized.columns, sized.columns).setZero();
  EXPECT_TRUE(others.isZero(0.0));
  EXPECT_LT(sized.columns.size(), static_cast<std::size_t>(covariance.cols()));
}

/// Whether the table of a joint is left out at this value.
bool is_withheld(const Setting& s, const TableCertainty& certainty, int joint, double value) {
  VectorXd q = VectorXd::Zero(5);
  for (int j = 0; j < 5; ++j) {
    q[j] = 0.5 * (table_of(s, j).lower + table_of(s, j).upper);
  }
  q[joint] = value;
  MatrixXd columns = MatrixXd::Ones(s.candidate.free.size(), 1);
  certainty.withhold(q, columns);
  for (std::size_t e = 0; e < s.candidate.model.effects.size(); ++e) {
    const EffectTerm& term = s.candidate.model.effects[e];
    if (is_of_table(term) && term.index == joint) {
      return columns(*s.candidate.free.column(UnknownGroup::effects, e), 0) == 0.0;
    }
  }
  return false;
}

/// Settings from one that tells much of its tables to one that tells little.
std::vector<Setting> settings() {
  std::vector<Setting> all;
  for (unsigned seed = 1; seed <= 6; ++seed) {
    all.emplace_back(seed);
    all.back().sizes.sigma = 6e-4 * std::pow(1.4, seed);
  }
  return all;
}

const std::vector<int> kWithTables = {0, 1, 2, 4};  // that of joint 4 is switched off

// What the covariance leaves of the 1 sigma beforehand decides, whatever the table and the joint.
TEST(TableCertainty, WithholdsTheTablesOfWhichMostUncertaintyIsLeft) {
  double least_withheld = 1.0;
  double most_told = 0.0;
  for (const Setting& s : settings()) {
    const MatrixXd covariance = covariance_by_hand(s);
    const GroupSizes sizes = with_root(s);
    const TableCertainty certainty(s.candidate, s.groups, sizes);
    for (const int joint : kWithTables) {
      const JointTable& table = table_of(s, joint);
      for (int i = 0; i <= 20; ++i) {
        const double value = table.lower + (table.upper - table.lower) * i / 20.0;
        const double share = share_by_hand(s, covariance, joint, value);
        if (is_withheld(s, certainty, joint, value)) {
          least_withheld = std::min(least_withheld, share);
        } else {
          most_told = std::max(most_told, share);
        }
      }
    }
  }
  EXPECT_LT(most_told, least_withheld);
  EXPECT_LT(least_withheld - most_told, 0.05) << "nothing lay near the limit";
}

TEST(TableCertainty, GapsAreWhereTablesAreWithheldAndShrinkWithMoreInformation) {
  std::size_t gaps = 0;
  for (const Setting& s : settings()) {
    const GroupSizes sizes = with_root(s);
    const TableCertainty certainty(s.candidate, s.groups, sizes);
    const GroupSizes of_more = with_root(s, 4.0);
    const TableCertainty surer(s.candidate, s.groups, of_more);
    for (const int joint : kWithTables) {
      const Ranges found = certainty.gaps(joint);
      const JointTable& table = table_of(s, joint);
      const double step = (table.upper - table.lower) / std::ceil(8.0 * (table.upper - table.lower) / table.length);
      const auto inside = [&](const Ranges& ranges, double value, double margin) {
        return std::any_of(ranges.begin(), ranges.end(), [&](const auto& gap) {
          return value >= gap.first - margin && value <= gap.second + margin;
        });
      };
      for (int i = 0; i <= 40; ++i) {
        const double value = table.lower + (table.upper - table.lower) * i / 40.0;
        if (inside(found, value, -step)) {
          EXPECT_TRUE(is_withheld(s, certainty, joint, value)) << joint << ", " << value;
        } else if (!inside(found, value, step)) {
          EXPECT_FALSE(is_withheld(s, certainty, joint, value)) << joint << ", " << value;
        }
      }
      for (const auto& [from, to] : surer.gaps(joint)) {
        EXPECT_TRUE(inside(found, from, 1e-12) && inside(found, to, 1e-12)) << joint;
      }
      gaps += found.size();
    }
    EXPECT_THAT(certainty.gaps(3), IsEmpty());
  }
  EXPECT_GT(gaps, 5U);
}

TEST(TableCertainty, OfNothingKnownTheWholeRangeIsAGapAndOfAllNone) {
  Setting s;
  for (const auto& [scale, whole] : {std::pair{1e-12, true}, std::pair{1e12, false}}) {
    const GroupSizes sizes = with_root(s, scale);
    const TableCertainty certainty(s.candidate, s.groups, sizes);
    const JointTable& table = table_of(s, 2);
    EXPECT_EQ(certainty.gaps(2), whole ? Ranges({{table.lower, table.upper}}) : Ranges());
    EXPECT_THAT(certainty.gaps(3), IsEmpty()) << "it is switched off";
    EXPECT_THAT(certainty.gaps(7), IsEmpty());
  }
  Setting rigid;
  rigid.candidate = with_terms(rigid.arm.model, rigid.arm.free, {}, true);
  const GroupSizes sizes = with_root(rigid);
  const TableCertainty none(rigid.candidate, rigid.groups, sizes);
  EXPECT_THAT(none.gaps(0), IsEmpty());
}

}  // namespace
}  // namespace kdl_calibration::table_certainty_test
