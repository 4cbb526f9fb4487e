// No allocation inside an iteration: counts the calls of malloc, through which both Eigen and operator new go. Left out
// under sanitizers, which bring a malloc of their own.

#include <gmock/gmock.h>

#include <cstdlib>

#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/effect_terms.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/joint_effects.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/simulation.hpp"
#include "virtual_experiment.hpp"

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) && !defined(__clang__)

namespace {
thread_local long allocations = 0;
}  // namespace

extern "C" {
void* __libc_malloc(std::size_t size);
void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
}

namespace kdl_calibration {
namespace {

long allocations_of_a_pass(int configurations, const ResidualOptions& options) {
  testing::VirtualExperiment experiment({.ranges = published_ranges});
  const Measurements measured = experiment.measure(configurations);
  const LeastSquaresProblem problem(experiment.model, measured, experiment.free, options);
  const Estimate start{.errors = Eigen::VectorXd::Zero(experiment.robot.truth.errors.size()),
                       .targets = published_targets()};
  LeastSquaresProblem::Workspace workspace;
  NormalEquations equations;
  problem.linearise(start, workspace, equations);  // the workspace takes its size
  const long before = allocations;
  problem.linearise(start, workspace, equations);
  return allocations - before;
}

TEST(Allocation, AnIterationTakesNone) {
  const long before = allocations;
  std::free(std::malloc(1));
  ASSERT_GT(allocations, before);  // they are counted
  EXPECT_EQ(allocations_of_a_pass(300, {}), 0);
}

TEST(Allocation, CorrelatedNoiseTakesNonePerConfiguration) {
  ResidualOptions options;
  options.noise.independent.setConstant(1e-5);
  options.noise.common.setConstant(5e-5);
  EXPECT_EQ(allocations_of_a_pass(300, options), allocations_of_a_pass(30, options));
  options.noise.common.z() = 2e-5;  // no longer alike in every direction
  EXPECT_EQ(allocations_of_a_pass(300, options), 0);
  options.noise.tracker = {.range = 1e-5, .transverse = 1e-5};  // one configuration after the other
  EXPECT_EQ(allocations_of_a_pass(300, options), allocations_of_a_pass(30, options));
}

/// Of 40 poses with their Jacobians by an arm that has the effects of these groups.
long allocations_of_poses(ErrorModel model, const std::vector<std::string>& groups) {
  Random random(2);
  const Eigen::MatrixXd q = random_configurations(published_ranges(model.joints), 40, random);
  std::vector<EffectTerm> all;
  for (const std::string& name : groups) {
    const std::vector<EffectTerm> terms = effect_terms(model, *effect_group(name), q);
    EXPECT_FALSE(terms.empty() && name != "torque") << name;
    all.insert(all.end(), terms.begin(), terms.end());
  }
  model.effects = all;
  const auto count = static_cast<Eigen::Index>(all.size());
  const CalibratedArm arm(model, testing::random_errors(model, random, 0.001, 0.001),
                          Eigen::VectorXd::Constant(count, 1e-4));
  Matrix6Xd jacobian(6, arm.joints());
  double sum = 0.0;
  const long before = allocations;
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    sum += arm.flange_pose(q.col(c)).translation().x();
    sum += arm.flange_pose(q.col(c), jacobian).translation().x();
  }
  const long taken = allocations - before;
  EXPECT_NE(sum, 0.0);
  return taken;
}

TEST(Allocation, ACalibratedArmIsAskedWithoutAny) {
  EXPECT_EQ(allocations_of_poses(complete_model(testing::fanuc()), effect_group_names()), 0);
}

TEST(Allocation, AsManyJointsAsPromisedAreAskedWithoutAny) {
  Robot snake = testing::fanuc();
  while (snake.joints.size() < 32) {
    snake.joints.push_back(snake.joints[snake.joints.size() - 6]);
    snake.joints.back().name += "_again";
  }
  EXPECT_EQ(allocations_of_poses(complete_model(snake), {"gain", "transverse", "tables"}), 0);
}

}  // namespace
}  // namespace kdl_calibration

#else

TEST(Allocation, IsNotCountedHere) { GTEST_SKIP() << "malloc is not ours"; }

#endif
