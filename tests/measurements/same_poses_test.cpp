#include "measurements/same_poses.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <iterator>
#include <map>
#include <set>

#include "base/random.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::same_poses_test {
namespace {

using Eigen::Index;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Poses a degree apart at least, each visited several times with read-backs that scatter by a microradian.
struct Visits {
  Eigen::MatrixXd joint_values;
  std::vector<Index> pose;
};

Visits shuffled_visits(int poses, int visits, Random& random) {
  Visits result;
  std::vector<Eigen::VectorXd> values;
  for (int p = 0; p < poses; ++p) {
    values.push_back(Eigen::VectorXd::NullaryExpr(6, [&] { return random.uniform(-2.0, 2.0); }));
  }
  result.joint_values.resize(6, poses * visits);
  for (Index c = 0; c < result.joint_values.cols(); ++c) {
    result.pose.push_back(static_cast<Index>(random.bits() % static_cast<std::uint64_t>(poses)));
    for (Index j = 0; j < 6; ++j) {
      result.joint_values(j, c) = values[static_cast<std::size_t>(result.pose.back())][j] + 1e-6 * random.normal();
    }
  }
  return result;
}

TEST(SamePoses, AreFoundInAnyOrder) {
  Random random(1);
  for (int trial = 0; trial < 20; ++trial) {
    const Visits visits = shuffled_visits(2 + trial, 8, random);
    const std::vector<Index> first = first_at_same_pose(visits.joint_values);
    for (std::size_t c = 0; c < first.size(); ++c) {
      const auto expected = std::find(visits.pose.begin(), visits.pose.end(), visits.pose[c]);
      EXPECT_EQ(first[c], expected - visits.pose.begin()) << "configuration " << c << " of trial " << trial;
    }
  }
}

TEST(SamePoses, AreNoNeighboursHalfADegreeAway) {
  Eigen::MatrixXd values = Eigen::MatrixXd::Zero(6, 3);
  values(0, 2) = 1.0;
  values(5, 1) = 0.5 * testing::kDegree;
  EXPECT_EQ(first_at_same_pose(values), (std::vector<Index>{0, 1, 2}));
}

// The joints' own ranges say what is near: the second one turns by three degrees in all.
TEST(SamePoses, HaveNeighboursWithinThreeDegreesOrATwentiethOfTheRange) {
  const Eigen::Matrix2Xd steps{{0.0, 2.8, 0.0, 0.0, 60.0}, {0.0, 0.0, 0.1, 0.2, 3.0}};
  EXPECT_EQ(first_of_neighbours(steps * testing::kDegree), (std::vector<Index>{0, 0, 0, 3, 4}));
  EXPECT_EQ(first_of_neighbours(Eigen::MatrixXd::Constant(3, 4, 0.7)), (std::vector<Index>{0, 0, 0, 0}));
  EXPECT_TRUE(first_of_neighbours(Eigen::MatrixXd(2, 0)).empty());
  // The third one is near to both others, which are apart: it joins the first.
  const Eigen::Matrix2Xd between{{0.0, 0.08, 0.045, 2.0}, {0.0, 0.0, 0.049, 2.0}};
  EXPECT_EQ(first_of_neighbours(between), (std::vector<Index>{0, 1, 0, 3}));
}

// A group has a member that all others are near to. If two groups had such members near to each other, they would be
// one.
TEST(SamePoses, HaveNeighboursNearOneOfThemInGroupsApartWhateverTheOrder) {
  Random random(1);
  const Eigen::MatrixXd values = Eigen::MatrixXd::NullaryExpr(3, 400, [&] { return random.uniform(); });
  const Eigen::Array3d limits = 0.05 * (values.rowwise().maxCoeff() - values.rowwise().minCoeff()).array().min(1.0);
  const auto near = [&](Index a, Index b) { return ((values.col(a) - values.col(b)).array().abs() <= limits).all(); };
  const std::vector<Index> first = first_of_neighbours(values);
  std::map<Index, std::vector<Index>> groups;
  for (Index c = 0; c < values.cols(); ++c) {
    groups[first[static_cast<std::size_t>(c)]].push_back(c);
  }
  EXPECT_LT(groups.size(), 395U);
  std::vector<std::vector<Index>> middles;
  for (const auto& group : groups) {
    const std::vector<Index>& members = group.second;
    EXPECT_EQ(group.first, members.front());
    std::vector<Index>& middle = middles.emplace_back();
    std::copy_if(members.begin(), members.end(), std::back_inserter(middle), [&](Index a) {
      return std::all_of(members.begin(), members.end(), [&](Index b) { return near(a, b); });
    });
    EXPECT_FALSE(middle.empty()) << group.first;
    for (std::size_t other = 0; other + 1 < middles.size(); ++other) {
      EXPECT_FALSE(std::all_of(middle.begin(), middle.end(), [&](Index a) {
        return std::all_of(middles[other].begin(), middles[other].end(), [&](Index b) { return near(a, b); });
      })) << group.first;
    }
  }
  const std::vector<Index> reversed = first_of_neighbours(values.rowwise().reverse());
  for (std::size_t c = 0; c < first.size(); ++c) {
    EXPECT_EQ(reversed[399 - c], reversed[399 - static_cast<std::size_t>(first[c])]) << c;
  }
  EXPECT_EQ(std::set<Index>(reversed.begin(), reversed.end()).size(), groups.size());
}

// A slide of a nanometre is as long for its robot as one of a metre.
TEST(SamePoses, DependOnTheSizeOfTheRobot) {
  Eigen::MatrixXd values(1, 3);
  values << 0.0, 0.5, 1.0;
  EXPECT_EQ(first_at_same_pose(1e-9 * values), (std::vector<Index>{0, 1, 2}));
  EXPECT_EQ(first_at_same_pose(values), (std::vector<Index>{0, 1, 2}));
}

// The same measurements, once with the repeats under one label and once each under a label of its own.
TEST(SamePoses, MakeRepeatsOfWhatHasLabelsOfItsOwn) {
  testing::VirtualExperiment experiment;
  const Measurements repeated = experiment.measure(12, {.sigma = 1e-5, .repeats = 4});
  Measurements apart = repeated;
  apart.configurations.clear();
  apart.joint_values.resize(6, 48);
  for (Index c = 0; c < 48; ++c) {
    apart.configurations.push_back("visit " + std::to_string(c));
    apart.joint_values.col(c) = repeated.joint_values.col(c / 4);
    apart.joint_values(2, c) += c % 2 == 0 ? 1e-6 : -1e-6;
  }
  for (Observation& o : apart.observations) {
    o.configuration = 4 * o.configuration + o.repeat - 1;
    o.repeat = 1;
  }
  const Measurements joined = with_poses_joined(apart);
  ASSERT_EQ(joined.configurations.size(), 12U);
  EXPECT_EQ(joined.configurations[1], "visit 4");
  EXPECT_LT((joined.joint_values - repeated.joint_values).cwiseAbs().maxCoeff(), 1e-15);
  ASSERT_EQ(joined.observations.size(), repeated.observations.size());
  for (std::size_t i = 0; i < joined.observations.size(); ++i) {
    EXPECT_EQ(joined.observations[i].configuration, repeated.observations[i].configuration);
    EXPECT_EQ(joined.observations[i].repeat, repeated.observations[i].repeat);
  }
  EXPECT_THAT(joined.remark, HasSubstr("48 labels stand for 12 poses"));
}

TEST(SamePoses, StayApartForTestsAndForOtherApproaches) {
  testing::VirtualExperiment experiment;
  Measurements measured = experiment.measure(4, {.sigma = 1e-5});
  for (Index c = 1; c < 4; ++c) {
    measured.joint_values.col(c) = measured.joint_values.col(0);
  }
  for (Observation& o : measured.observations) {
    o.split = o.configuration == 1 ? Split::test : Split::train;
  }
  measured.signals.approach = Eigen::MatrixXd::Ones(6, 4);
  measured.signals.approach(3, 2) = -1.0;
  EXPECT_EQ(with_poses_joined(measured).configurations.size(), 3U);
}

TEST(SamePoses, StayApartWhereALinkIsWarmerAndElseHaveTheMean) {
  testing::VirtualExperiment experiment;
  Measurements measured = experiment.measure(4, {.sigma = 1e-5});
  for (Index c = 1; c < 4; ++c) {
    measured.joint_values.col(c) = measured.joint_values.col(0);
  }
  measured.signals.links = {"link_1", "link_2"};
  measured.signals.link_temperatures.resize(2, 4);
  measured.signals.link_temperatures << 20.0, 20.1, 20.1, 20.1,  //
      25.0, 25.0, 26.0, 25.1;
  const Measurements joined = with_poses_joined(measured);
  ASSERT_EQ(joined.configurations.size(), 2U);
  EXPECT_EQ(joined.signals.links, measured.signals.links);
  EXPECT_NEAR(joined.signals.link_temperatures(0, 0), (20.0 + 20.1 + 20.1) / 3.0, 1e-12);
  EXPECT_NEAR(joined.signals.link_temperatures(1, 0), (25.0 + 25.0 + 25.1) / 3.0, 1e-12);
  EXPECT_EQ(joined.signals.link_temperatures.col(1), Eigen::Vector2d(20.1, 26.0));
}

TEST(SamePoses, OfDifferentConfigurationsChangeNothing) {
  testing::VirtualExperiment experiment;
  const Measurements measured = experiment.measure(10);
  const Measurements joined = with_poses_joined(measured);
  EXPECT_EQ(joined.joint_values, measured.joint_values);
  EXPECT_THAT(joined.remark, IsEmpty());
}

}  // namespace
}  // namespace kdl_calibration::same_poses_test
