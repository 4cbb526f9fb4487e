#include "screening/gross_rows.hpp"

#include <gmock/gmock.h>

#include <set>

#include "virtual_experiment.hpp"

namespace kdl_calibration::gross_rows_test {
namespace {

// What is found in the fit of all rows.
GrossRows found_in(const testing::VirtualExperiment& experiment, const Measurements& measured, const Unknowns& free,
                   const FitOptions& options = {}) {
  const Estimate start{.errors = Eigen::VectorXd::Zero(experiment.robot.truth.errors.size()),
                       .frames = experiment.robot.truth.frames,
                       .effects = {}};
  const Identification fit = identify_jointly(experiment.model, measured, start, free);
  return find_gross_rows(
      {.model = experiment.model, .measurements = measured, .start = fit.estimate, .free = free, .options = options});
}

void displace(Measurements& measured, std::int32_t configuration, std::int32_t target, const Eigen::Vector3d& by) {
  for (Observation& o : measured.observations) {
    if (o.configuration == configuration && (target < 0 || o.target == target)) {
      o.position() += by;
    }
  }
}

TEST(GrossRows, NameOneConfigurationOfTwelveOfAnySize) {
  for (const double size : {0.005, 0.062, 1.0}) {
    testing::VirtualExperiment experiment;
    Measurements measured = experiment.measure(12, {.sigma = 2e-5});
    displace(measured, 7, -1, size * Eigen::Vector3d(0.6, 0.0, -0.8));
    const GrossRows found = found_in(experiment, measured, experiment.free);
    ASSERT_EQ(found.rows.size(), 1U) << size;
    EXPECT_EQ(found.rows[0].configuration, measured.configurations[7]);
    EXPECT_EQ(found.rows[0].target, "");
    EXPECT_NEAR(found.rows[0].distance, size, 0.05 * size + 2e-4);
    EXPECT_LT(found.rms_without, 5e-5);
  }
}

TEST(GrossRows, NameASinglePoint) {
  testing::VirtualExperiment experiment;
  Measurements measured = experiment.measure(20, {.sigma = 2e-5, .repeats = 2});
  displace(measured, 3, 1, {0.0, 0.02, 0.0});
  int fits = 0;
  FitOptions counting;
  counting.after_fit = [&] { ++fits; };
  const GrossRows found = found_in(experiment, measured, experiment.free, counting);
  EXPECT_GE(fits, 2) << "with the point and without it";
  ASSERT_EQ(found.rows.size(), 1U);
  EXPECT_EQ(found.rows[0].configuration, measured.configurations[3]);
  EXPECT_EQ(found.rows[0].target, measured.targets[1]);
  EXPECT_NEAR(found.rows[0].distance, 0.02, 2e-4);
}

TEST(GrossRows, NameAJointThatWasFiveDegreesOffAndSeveralOthers) {
  testing::VirtualExperiment experiment;
  Measurements measured = experiment.measure(40, {.sigma = 2e-5});
  measured.joint_values(3, 11) += 5.0 * testing::kDegree;
  displace(measured, 20, -1, {0.003, 0.0, 0.0});
  displace(measured, 30, -1, {0.0, 0.5, 0.0});
  std::set<std::string> names;
  for (const GrossRow& row : found_in(experiment, measured, experiment.free).rows) {
    names.insert(row.configuration);
  }
  EXPECT_EQ(names, (std::set<std::string>{measured.configurations[11], measured.configurations[20],
                                          measured.configurations[30]}));
}

TEST(GrossRows, AreNoneOfTwoHundredCorrectSets) {
  testing::VirtualExperiment experiment;
  for (int run = 0; run < 200; ++run) {
    experiment.restart(Random(5, static_cast<std::uint64_t>(run)));
    const Measurements measured = experiment.measure(12 + run % 30, {.sigma = 3e-5});
    EXPECT_THAT(found_in(experiment, measured, experiment.free).rows, ::testing::IsEmpty()) << "run " << run;
  }
}

}  // namespace
}  // namespace kdl_calibration::gross_rows_test
