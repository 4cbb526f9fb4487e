#include "assessment/trial_sample.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <set>
#include <utility>

#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;
using testing::as_frames;
using ::testing::ElementsAre;
using testing::VirtualExperiment;

const VirtualExperiment& of_poses() {
  static const VirtualExperiment experiment({.targets = as_frames(published_targets(2))});
  return experiment;
}

TEST(TrialSample, HoldsThePositionsOfTrainingRowsAndWhatIsFreeOfThem) {
  VirtualExperiment experiment = of_poses();
  Measurements all = experiment.measure(20, {.sigma = 1e-5, .orientation_sigma = 1e-5, .repeats = 2});
  std::set<std::pair<int, int>> points;
  for (Observation& o : all.observations) {
    o.sigma = 1e-5;
    o.split = o.configuration % 4 == 3 ? Split::test : Split::train;
    o.target = o.configuration == 5 ? 0 : o.target;  // one target twice
  }
  const TrialSample sample = trial_sample(experiment.model, all, experiment.free, 100);
  for (const Observation& o : sample.measurements.observations) {
    EXPECT_EQ(o.sigma, 0.0);
    EXPECT_EQ(o.split, Split::train);
    points.insert({o.configuration, o.target});
  }
  EXPECT_TRUE(sample.measurements.orientations.empty());
  EXPECT_EQ(sample.measurements.joint_values.cols(), 15);
  EXPECT_EQ(sample.measurements.observations.size(), 60U);
  ASSERT_EQ(points.size(), 29U);
  // Base, geometry and six coordinates of points, without those of orientations.
  std::vector<std::string> names = experiment.free.without(UnknownGroup::targets).names();
  for (const char* name : {"A.x", "A.y", "A.z", "B.x", "B.y", "B.z"}) {
    names.emplace_back(name);
  }
  EXPECT_EQ(sample.free.names(), names);
  EXPECT_EQ(experiment.free.size() - sample.free.size(), 6);
  EXPECT_DOUBLE_EQ(sample.freedom, 3.0 * 29.0 - static_cast<double>(names.size()));
  EXPECT_DOUBLE_EQ(sample.points_of_a_configuration, 29.0 / 15.0);
}

TEST(TrialSample, HoldsNoMoreConfigurationsThanAskedFor) {
  VirtualExperiment experiment = of_poses();
  const Measurements all = experiment.measure(20);
  EXPECT_EQ(trial_sample(experiment.model, all, experiment.free, 7).measurements.joint_values.cols(), 7);
  const Measurements none = subset(all, [](const Observation&) { return false; });
  EXPECT_EQ(trial_sample(experiment.model, none, experiment.free, 7).points_of_a_configuration, 0.0);
}

// ---- poses as points -----------------------------------------------------------------------------------------------

TEST(TrialSample, APoseIsItsPointAndOneTenCentimetresAlongEachAxis) {
  VirtualExperiment experiment = of_poses();
  Measurements all = experiment.measure(4, {.repeats = 2});
  all.orientations[5] = point_alone();
  all.order.resize(all.observations.size());
  const Estimate& truth = experiment.robot.truth;
  const PosePoints points = pose_points(experiment.model, all, truth, experiment.free, {});
  EXPECT_THAT(points.measurements.targets, ElementsAre("A", "A.x", "A.y", "A.z", "B", "B.x", "B.y", "B.z"));
  EXPECT_TRUE(points.measurements.orientations.empty());
  EXPECT_TRUE(points.measurements.order.empty());
  EXPECT_EQ(points.measurements.joint_values, all.joint_values);
  std::size_t next = 0;
  for (std::size_t row = 0; row < all.observations.size(); ++row) {
    for (int i = 0; i < (row == 5 ? 1 : 4); ++i, ++next) {
      ASSERT_LT(next, points.measurements.observations.size());
      const Observation& point = points.measurements.observations[next];
      Vector3d expected = all.observations[row].position;
      if (i > 0) {
        expected += 0.1 * all.orientations[row].toRotationMatrix().col(i - 1);
      }
      EXPECT_LT((point.position - expected).norm(), 1e-12) << row << ", " << i;
      EXPECT_EQ(point.target, 4 * all.observations[row].target + i);
      EXPECT_EQ(point.configuration, all.observations[row].configuration);
      EXPECT_EQ(point.repeat, all.observations[row].repeat);
    }
  }
  EXPECT_EQ(next, points.measurements.observations.size());
  ASSERT_EQ(points.fit.targets.size(), 8U);
  for (std::size_t k = 0; k < 8; ++k) {
    const Eigen::Isometry3d& X_FT = truth.targets[k / 4].X_FT;
    const Vector3d expected = k % 4 == 0
                                  ? Vector3d(X_FT.translation())
                                  : Vector3d(X_FT.translation() + 0.1 * X_FT.linear().col(Eigen::Index(k % 4) - 1));
    EXPECT_EQ(points.fit.targets[k].name, points.measurements.targets[k]);
    EXPECT_LT((points.fit.targets[k].X_FT.translation() - expected).norm(), 1e-12) << k;
    EXPECT_FALSE(points.fit.targets[k].with_orientation);
  }
  EXPECT_EQ(points.fit.errors, truth.errors);
}

TEST(TrialSample, KnownTargetsAndEffectsStayWhatTheyAre) {
  VirtualExperiment experiment = of_poses();
  ErrorModel model = experiment.model;
  model.effects.resize(3);
  Measurements all = experiment.measure(4);
  std::vector<std::size_t> first;  // the second target is known
  for (std::size_t i = 0; i < 6; ++i) {
    first.push_back(i);
  }
  const Unknowns free =
      experiment.free.with(model, UnknownGroup::targets, first).with(model, UnknownGroup::effects, {0, 2});
  RegistrationOptions registration;
  registration.known_base = Eigen::Isometry3d::Identity();
  registration.known_targets = {experiment.robot.truth.targets[1]};
  const PosePoints points = pose_points(model, all, experiment.robot.truth, free, registration);
  EXPECT_THAT(points.free.effects(), ElementsAre(0, 2));
  EXPECT_EQ(points.free.geometric(), free.geometric());
  EXPECT_EQ(points.free.of(UnknownGroup::base), free.of(UnknownGroup::base));
  std::vector<std::string> names;
  for (const Eigen::Index column : {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11}) {
    const Eigen::Index at = points.free.range(UnknownGroup::targets).first + column;
    ASSERT_LT(at, points.free.size());
    names.push_back(points.free.columns()[static_cast<std::size_t>(at)].name);
  }
  EXPECT_THAT(names, ElementsAre("A.x", "A.y", "A.z", "A.x.x", "A.x.y", "A.x.z", "A.y.x", "A.y.y", "A.y.z", "A.z.x",
                                 "A.z.y", "A.z.z"));
  EXPECT_EQ(points.free.range(UnknownGroup::targets).count, 12);
  EXPECT_TRUE(points.registration.known_base);
  std::vector<std::string> known;
  for (const TargetFrame& target : points.registration.known_targets) {
    known.push_back(target.name);
  }
  EXPECT_THAT(known, ElementsAre("B", "B.x", "B.y", "B.z"));
}

}  // namespace
}  // namespace kdl_calibration
