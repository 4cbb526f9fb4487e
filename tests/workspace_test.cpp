#include "kdl_calibration/workspace.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <kdl/chainfksolverpos_recursive.hpp>

#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/random.hpp"
#include "support.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Vector3d;
using testing::circle_of_targets;
using testing::kDegree;

Cell full_cell(const Robot& robot) {
  const ErrorModel model = complete_model(robot);
  Cell cell;
  cell.ranges = limits_of(model);
  cell.ranges[0] = {-2.0, 2.5};
  Eigen::VectorXd weights = Eigen::VectorXd::Zero(6);
  weights[1] = 1.0;
  weights[2] = 1.0;
  cell.sums.push_back({.name = "elevation", .weights = weights, .lower = -80 * kDegree, .upper = 90 * kDegree});
  cell.box = {.lower = {-2.6, -2.4, -1.0}, .upper = {2.6, 2.8, 2.6}};
  cell.height = 0.2;
  cell.radius = 0.7;
  cell.out_spheres = {{.center = {1.5, 1.5, 0.5}, .radius = 0.4}, {.center = {2.3, 2.3, 1.0}, .radius = 0.9}};
  cell.out_boxes = {{.lower = {-3.0, -3.0, -1.0}, .upper = {-0.8, 0.3, 0.8}}};
  cell.body = body_from_urdf(robot).capsules;
  for (const Capsule& capsule : tool_body(robot, circle_of_targets(), 0.02)) {
    cell.body.push_back(capsule);
  }
  cell.clearance = 0.05;
  cell.tracker =
      Tracker{.position = {2.3, 2.3, 1.0}, .least_distance = 1.0, .greatest_distance = 5.0, .acceptance = 80 * kDegree};
  cell.facing = {Vector3d(0, 1, 0), Vector3d(1, 1, 0), Vector3d::Zero()};
  return cell;
}

// What a configuration looks like, from KDL and from points strewn over the arm's capsules.
struct Scene {
  std::vector<Vector3d> targets;
  KDL::Frame flange;
  std::vector<std::vector<Vector3d>> axes;  // points along each capsule
};

Scene scene(const Robot& robot, const Cell& cell, const Eigen::VectorXd& q) {
  KDL::ChainFkSolverPos_recursive solver(robot.chain);
  KDL::JntArray joints(6);
  joints.data = q;
  Scene result;
  result.flange = testing::kdl_pose(robot.chain, q);
  for (const TargetFrame& target : circle_of_targets()) {
    const Vector3d& t = target.X_FT.translation();
    result.targets.push_back(to_eigen(result.flange * KDL::Vector(t.x(), t.y(), t.z())));
  }
  for (const Capsule& capsule : cell.body) {
    KDL::Frame X;
    solver.JntToCart(joints, X, static_cast<int>(capsule.frame));
    auto& points = result.axes.emplace_back();
    for (int i = 0; i <= 40; ++i) {
      const Vector3d p = capsule.a + (capsule.b - capsule.a) * (i / 40.0);
      points.push_back(to_eigen(X * KDL::Vector(p.x(), p.y(), p.z())));
    }
  }
  return result;
}

bool in_box(const Box& box, const Vector3d& p) {
  return (p.array() > box.lower.array()).all() && (p.array() < box.upper.array()).all();
}

double from_box(const Box& box, const Vector3d& p) { return (p - p.cwiseMax(box.lower).cwiseMin(box.upper)).norm(); }

void expect_in_reach(const Cell& cell, const Scene& now, const Eigen::VectorXd& q) {
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_GE(q[static_cast<Eigen::Index>(i)], cell.ranges[i].first);
    EXPECT_LE(q[static_cast<Eigen::Index>(i)], cell.ranges[i].second);
  }
  EXPECT_GE(q[1] + q[2], -80 * kDegree);
  EXPECT_LE(q[1] + q[2], 90 * kDegree);
  for (const Vector3d& target : now.targets) {
    EXPECT_TRUE(in_box(cell.box, target));
    EXPECT_GE(target.z(), 0.2);
    EXPECT_GE(std::hypot(target.x(), target.y()), 0.7);
  }
}

void expect_out_of_zones(const Cell& cell, const Scene& now) {
  for (const Sphere& sphere : cell.out_spheres) {
    for (const Vector3d& target : now.targets) {
      EXPECT_GT((target - sphere.center).norm(), sphere.radius);
    }
    for (std::size_t c = 0; c < now.axes.size(); ++c) {
      for (const Vector3d& p : now.axes[c]) {
        EXPECT_GT((p - sphere.center).norm(), sphere.radius + cell.body[c].radius);
      }
    }
  }
  for (const Box& box : cell.out_boxes) {
    for (std::size_t c = 0; c < now.axes.size(); ++c) {
      for (const Vector3d& p : now.axes[c]) {
        EXPECT_GT(from_box(box, p), cell.body[c].radius);
      }
    }
  }
}

void expect_clearance(const Robot& robot, const Cell& cell, const Scene& now) {
  for (const auto& [i, j] : pairs_to_keep_apart(robot, cell.body, 0.05)) {
    for (const Vector3d& p : now.axes[i]) {
      for (const Vector3d& r : now.axes[j]) {
        ASSERT_GE((p - r).norm() - cell.body[i].radius - cell.body[j].radius, 0.05 - 1e-9);
      }
    }
  }
}

void expect_visible(const Cell& cell, const Scene& now) {
  const Vector3d tracker(2.3, 2.3, 1.0);
  for (std::size_t t = 0; t < 3; ++t) {
    const Vector3d beam = tracker - now.targets[t];
    EXPECT_GE(beam.norm(), 1.0);
    EXPECT_LE(beam.norm(), 5.0);
    if (t < 2) {
      const KDL::Vector facing = now.flange.M * KDL::Vector(t == 0 ? 0.0 : 1.0, 1.0, 0.0);
      EXPECT_LE(std::acos(to_eigen(facing).normalized().dot(beam.normalized())), 80 * kDegree + 1e-9);
    }
    for (int i = 0; i <= 300; ++i) {
      const Vector3d p = now.targets[t] + beam * (i / 300.0);
      EXPECT_GE((p - cell.out_spheres[0].center).norm(), 0.4 - 1e-9);
      EXPECT_FALSE(in_box(cell.out_boxes[0], p));
      for (std::size_t c = 0; c < now.axes.size(); ++c) {
        for (const Vector3d& axis : now.axes[c]) {
          ASSERT_TRUE(cell.body[c].tool || (p - axis).norm() > cell.body[c].radius - 1e-9);
        }
      }
    }
  }
}

TEST(Workspace, SatisfiesEveryConstraintByIndependentCode) {
  const Robot robot = testing::fanuc();
  const Cell cell = full_cell(robot);
  const Candidates found = candidates(robot, circle_of_targets(), cell, {.count = 150});
  ASSERT_EQ(found.joint_values.cols(), 150);
  for (Eigen::Index c = 0; c < found.joint_values.cols(); ++c) {
    const Eigen::VectorXd q = found.joint_values.col(c);
    const Scene now = scene(robot, cell, q);
    expect_in_reach(cell, now, q);
    expect_out_of_zones(cell, now);
    expect_clearance(robot, cell, now);
    expect_visible(cell, now);
    EXPECT_TRUE(violated(robot, circle_of_targets(), cell, q).empty());
  }
  for (const Refusals& refusals : found.refusals) {  // so that each of the checks above had something to catch
    EXPECT_GT(refusals.samples, 0) << refusals.constraint;
  }
}

TEST(Workspace, NamesWhatAConfigurationViolates) {
  const Robot robot = testing::fanuc();
  Cell cell;
  cell.ranges = limits_of(complete_model(robot));
  cell.height = 1.0;
  cell.radius = 5.0;
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(6);
  EXPECT_THAT(violated(robot, circle_of_targets(), cell, zero), ::testing::ElementsAre("least radius 5000 mm"));
}

TEST(Workspace, MeasuresTheRadiusFromTheFirstAxis) {
  const Robot robot = testing::fanuc();
  Cell cell;
  cell.ranges = limits_of(complete_model(robot));
  Eigen::VectorXd upright = Eigen::VectorXd::Zero(6);
  upright[2] = 60 * kDegree;
  upright[4] = 30 * kDegree;
  const Scene now = scene(robot, cell, upright);
  double nearest = 1e9;
  for (const Vector3d& target : now.targets) {
    nearest = std::min(nearest, std::hypot(target.x(), target.y()));  // the first axis is the base's z
    ASSERT_GT(target.norm(), 1.1 * std::hypot(target.x(), target.y())) << "else the height would not show";
  }
  cell.radius = nearest - 1e-6;
  EXPECT_TRUE(violated(robot, circle_of_targets(), cell, upright).empty());
  cell.radius = nearest + 1e-6;
  EXPECT_EQ(violated(robot, circle_of_targets(), cell, upright).size(), 1U);
}

TEST(Workspace, SumsOfJointsCountTheirOffset) {
  const Robot robot = testing::fanuc();
  Cell cell;
  cell.ranges = limits_of(complete_model(robot));
  cell.sums.push_back({.name = "elbow", .weights = Eigen::VectorXd::Unit(6, 2), .offset = 0.3, .upper = 0.5});
  EXPECT_TRUE(violated(robot, circle_of_targets(), cell, 0.1 * Eigen::VectorXd::Unit(6, 2)).empty());
  EXPECT_THAT(violated(robot, circle_of_targets(), cell, 0.3 * Eigen::VectorXd::Unit(6, 2)),
              ::testing::ElementsAre("range of elbow"));
}

TEST(Workspace, DoesNotDependOnTheThreads) {
  const Robot robot = testing::fanuc();
  const Cell cell = full_cell(robot);
  const Candidates one = candidates(robot, circle_of_targets(), cell, {.count = 60, .seed = 5, .threads = 1});
  const Candidates three = candidates(robot, circle_of_targets(), cell, {.count = 60, .seed = 5, .threads = 3});
  EXPECT_EQ(one.joint_values, three.joint_values);
  EXPECT_EQ(one.samples, three.samples);
  const Candidates other = candidates(robot, circle_of_targets(), cell, {.count = 60, .seed = 6});
  EXPECT_NE(one.joint_values, other.joint_values);
  // More candidates are the same ones and further ones.
  const Candidates more = candidates(robot, circle_of_targets(), cell, {.count = 80, .seed = 5});
  EXPECT_EQ(one.joint_values, more.joint_values.leftCols(60));
}

TEST(Workspace, RoundsJointValuesBeforeItChecksThem) {
  const Robot robot = testing::fanuc();
  Cell cell;
  cell.ranges = limits_of(complete_model(robot));
  cell.height = 0.2;
  const Candidates found = candidates(robot, circle_of_targets(), cell, {.count = 200, .angle_step = 0.1 * kDegree});
  const Eigen::MatrixXd steps = found.joint_values / (0.1 * kDegree);
  EXPECT_LT((steps.array() - steps.array().round()).abs().maxCoeff(), 1e-9);
}

TEST(Workspace, SaysWhichConstraintRemovesHowMany) {
  const Robot robot = testing::fanuc();
  Cell cell;
  cell.ranges = limits_of(complete_model(robot));
  cell.height = 0.2;
  cell.radius = 4.0;  // beyond reach
  try {
    candidates(robot, circle_of_targets(), cell, {.count = 10, .most_samples = 2000});
    FAIL() << "found candidates that cannot be";
  } catch (const InputError& error) {
    // Counted independently: the same samples, one constraint at a time.
    long low = 0;
    for (int k = 0; k < 2000; ++k) {
      Random random(1, static_cast<std::uint64_t>(k));
      Eigen::VectorXd q(6);
      for (std::size_t i = 0; i < 6; ++i) {
        q[static_cast<Eigen::Index>(i)] = random.uniform(cell.ranges[i].first, cell.ranges[i].second);
      }
      const Scene now = scene(robot, cell, q);
      low += std::any_of(now.targets.begin(), now.targets.end(), [](const Vector3d& p) { return p.z() < 0.2; });
    }
    EXPECT_THAT(error.what(), ::testing::HasSubstr("leave 0 of 2000 sampled configurations, expected 10"));
    EXPECT_THAT(error.what(),
                ::testing::HasSubstr("least height 200 mm removes " + std::to_string(low) + " (0 alone)"));
    EXPECT_THAT(error.what(), ::testing::HasSubstr("least radius 4000 mm removes 2000 (" + std::to_string(2000 - low)));
    EXPECT_THAT(error.what(), ::testing::Not(::testing::HasSubstr("\n")));
  }
}

TEST(Workspace, RefusesCellsThatDoNotFit) {
  const Robot robot = testing::fanuc();
  Cell cell;
  EXPECT_THROW(candidates(robot, circle_of_targets(), cell), InputError);
  cell.ranges = limits_of(complete_model(robot));
  cell.ranges[2] = {1.0, -1.0};
  EXPECT_THROW(candidates(robot, circle_of_targets(), cell), InputError);
  cell.ranges[2] = {-1.0, 1.0};
  cell.facing = {Vector3d::UnitX()};
  EXPECT_THROW(candidates(robot, circle_of_targets(), cell), InputError);
}

}  // namespace
}  // namespace kdl_calibration
