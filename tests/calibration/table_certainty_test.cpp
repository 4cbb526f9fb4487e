// What measurements tell of tables, by the covariance of a dense inverse.

#include "calibration/table_certainty.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>

#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/joint_effects.hpp"
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
    if (term.group == EffectGroup::tables && term.index == joint) {
      functions[*s.candidate.free.column(UnknownGroup::effects, e)] = table_value(term.table, value);
      size = size_of(s, term);
    }
  }
  return size > 0.0 ? std::sqrt(functions.dot(covariance * functions)) / (size * functions.norm()) : 0.0;
}

const TableTerm& table_of(const Setting& s, int joint) {
  return std::find_if(s.candidate.model.effects.begin(), s.candidate.model.effects.end(),
                      [&](const EffectTerm& term) { return is_of_table(term) && term.index == joint; })
      ->table;
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

// NOLINTNEXTLINE(readability-function-cognitive-complexity): the rule written out
TEST(TableCertainty, WithholdsATableThatStaysAboveEightTenthsOfWhatItWas) {
  int withheld = 0;
  int told = 0;
  double least_withheld = 1.0;
  double most_told = 0.0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    Setting s(seed);
    s.sizes.sigma = 6e-4 * std::pow(1.3, seed);
    const MatrixXd covariance = covariance_by_hand(s);
    const TableCertainty certainty(s.candidate, s.information, s.groups, s.sizes);
    const MatrixXd q = s.arm.configurations(12);
    for (Index c = 0; c < q.cols(); ++c) {
      const VectorXd before = VectorXd::LinSpaced(covariance.cols(), 1.0, 2.0);
      VectorXd expected = before;
      for (std::size_t e = 0; e < s.candidate.model.effects.size(); ++e) {
        const EffectTerm& term = s.candidate.model.effects[e];
        if (!is_of_table(term)) {
          continue;
        }
        const double share = share_by_hand(s, covariance, term.index, q(term.index, c));
        (share > 0.8 ? withheld : told) += 1;
        (share > 0.8 ? least_withheld : most_told) =
            share > 0.8 ? std::min(least_withheld, share) : std::max(most_told, share);
        if (share > 0.8) {
          expected[*s.candidate.free.column(UnknownGroup::effects, e)] = 0.0;
        }
      }
      VectorXd columns = before;
      certainty.withhold(q.col(c), columns);
      EXPECT_TRUE(columns == expected) << "seed " << seed << ", configuration " << c;
    }
  }
  EXPECT_GT(withheld, 100);
  EXPECT_GT(told, 100);
  EXPECT_LT(least_withheld, 0.83);
  EXPECT_GT(most_told, 0.77);
}

// NOLINTNEXTLINE(readability-function-cognitive-complexity): the rule written out
TEST(TableCertainty, GapsReachFromTheLastCertainPlaceToTheNext) {
  std::size_t gaps = 0;
  std::size_t certain = 0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    Setting s(seed);
    s.sizes.sigma = 6e-4 * std::pow(1.3, seed);
    const MatrixXd covariance = covariance_by_hand(s);
    const TableCertainty certainty(s.candidate, s.information, s.groups, s.sizes);
    for (int joint = 0; joint < 5; ++joint) {
      const TableTerm& table = table_of(s, joint);
      const double width = table.upper - table.lower;
      const int steps = static_cast<int>(std::ceil(8.0 * width / table.length));
      std::vector<bool> open;
      for (int i = 0; i <= steps; ++i) {
        open.push_back(share_by_hand(s, covariance, joint, table.lower + width * i / steps) > 0.8);
      }
      Ranges expected;
      for (int i = 0; i <= steps; ++i) {
        const auto at = static_cast<std::size_t>(i);
        if (open[at] && (i == 0 || !open[at - 1])) {
          int last = i;
          while (last < steps && open[static_cast<std::size_t>(last)]) {
            ++last;
          }
          expected.emplace_back(table.lower + width * std::max(i - 1, 0) / steps, table.lower + width * last / steps);
        }
      }
      const Ranges found = certainty.gaps(joint);
      ASSERT_EQ(found.size(), expected.size()) << "seed " << seed << ", joint " << joint;
      for (std::size_t g = 0; g < found.size(); ++g) {
        EXPECT_NEAR(found[g].first, expected[g].first, 1e-12);
        EXPECT_NEAR(found[g].second, expected[g].second, 1e-12);
      }
      gaps += found.size();
      certain += found.empty() ? 1 : 0;
    }
  }
  EXPECT_GT(gaps, 10U);
  EXPECT_GT(certain, 8U);  // those that are switched off among them
}

TEST(TableCertainty, OfNothingKnownTheWholeRangeIsAGapAndOfAllNone) {
  Setting s;
  for (const auto& [scale, whole] : {std::pair{1e-12, true}, std::pair{1e12, false}}) {
    const TableCertainty certainty(s.candidate, scale * s.information, s.groups, s.sizes);
    const TableTerm& table = table_of(s, 2);
    EXPECT_EQ(certainty.gaps(2), whole ? Ranges({{table.lower, table.upper}}) : Ranges());
    EXPECT_THAT(certainty.gaps(3), IsEmpty()) << "it is switched off";
    EXPECT_THAT(certainty.gaps(7), IsEmpty());
  }
  Setting rigid;
  rigid.candidate = with_terms(rigid.arm.model, rigid.arm.free, {}, true);
  const TableCertainty none(rigid.candidate, rigid.information, rigid.groups, rigid.sizes);
  EXPECT_THAT(none.gaps(0), IsEmpty());
}

// Ten thousand steps are enough for a short table over a long way.
TEST(TableCertainty, AGapIsFoundToATenThousandthOfTheRange) {
  EffectTerm term{.name = "tables.1.1", .joint = "turn", .index = 0, .group = EffectGroup::tables};
  term.table = {.number = 1, .length = 1e-4, .lower = 0.0, .upper = 1.0};
  const ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  for (const int functions : {1, 2}) {
    std::vector<EffectTerm> terms(static_cast<std::size_t>(functions), term);
    MatrixXd information = MatrixXd::Identity(functions, functions);
    if (functions == 2) {
      terms[1].name = "tables.1.2";
      terms[1].table.number = 2;
      information(0, 0) = 0.0;
    }
    const Candidate candidate = with_terms(model, Unknowns(model, {}, {}), terms, false);
    const Groups groups = groups_of(candidate, {});
    const TableCertainty certainty(candidate, information, groups, {.sizes = {1.0}, .sigma = 0.5});
    const Ranges gaps = certainty.gaps(0);
    if (functions == 1) {
      EXPECT_THAT(gaps, IsEmpty());
      continue;
    }
    ASSERT_EQ(gaps.size(), 1U);               // around the middle, where the second function is zero
    const auto is_open = [&](double value) {  // the second is known to 0.2 of its variance
      const double first = table_value(terms[0].table, value);
      const double second = table_value(terms[1].table, value);
      return first * first + 0.2 * second * second > 0.64 * (first * first + second * second);
    };
    EXPECT_FALSE(is_open(gaps[0].first));
    EXPECT_TRUE(is_open(gaps[0].first + 1.001e-4));
    EXPECT_FALSE(is_open(gaps[0].second));
    EXPECT_TRUE(is_open(gaps[0].second - 1.001e-4));
    for (const double end : {gaps[0].first, gaps[0].second}) {
      EXPECT_NEAR(end * 1e4, std::round(end * 1e4), 1e-6);
    }
    EXPECT_NEAR(gaps[0].first + gaps[0].second, 1.0, 1e-9);
  }
}

}  // namespace
}  // namespace kdl_calibration::table_certainty_test
