#include "planning/workspace.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <limits>
#include <numbers>
#include <regex>
#include <utility>
#include <vector>

#include "base/random.hpp"
#include "kdl_calibration/input_error.hpp"
#include "refusal.hpp"
#include "support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::workspace_test {
namespace {

using Eigen::Vector3d;
using testing::circle_of_targets;
using testing::kDegree;

Cell full_cell(const Robot& robot) {
  const ErrorModel model = complete_model(robot);
  Cell cell;
  cell.ranges = limits_of(model.joints);
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
  std::vector<std::vector<Vector3d>> axes;    // points along each capsule
  std::vector<std::vector<Vector3d>> shapes;  // points of the box in it, else the same
  std::vector<KDL::Frame> links;

  double radius(const Cell& cell, std::size_t c) const { return cell.body[c].box ? 0.0 : cell.body[c].radius; }
};

std::vector<Vector3d> points_of(const LinkBox& box, const KDL::Frame& X) {
  std::vector<Vector3d> points;
  for (int i = 0; i < 343; ++i) {
    const Vector3d share(i % 7 / 6.0, i / 7 % 7 / 6.0, i / 49 / 6.0);
    const Vector3d p = box.X_LB * (box.box.lower + share.cwiseProduct(box.box.upper - box.box.lower));
    points.push_back(to_eigen(X * KDL::Vector(p.x(), p.y(), p.z())));
  }
  return points;
}

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
    result.links.push_back(X);
    result.shapes.push_back(capsule.box ? points_of(*capsule.box, X) : points);
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
    for (const Vector3d& p : now.shapes[i]) {
      for (const Vector3d& r : now.shapes[j]) {
        ASSERT_GE((p - r).norm() - now.radius(cell, i) - now.radius(cell, j), 0.05 - 1e-9);
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
        if (const std::optional<LinkBox>& shape = cell.body[c].box) {
          const KDL::Vector in_link = now.links[c].Inverse() * KDL::Vector(p.x(), p.y(), p.z());
          ASSERT_FALSE(in_box(shape->box, shape->X_LB.inverse() * to_eigen(in_link)));
          continue;
        }
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
  const Candidates found = candidates(robot, circle_of_targets(), cell, {.count = 50});
  ASSERT_EQ(found.joint_values.cols(), 50);
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

TEST(Workspace, MeasuresTheRadiusFromTheFirstAxis) {
  const Robot robot = testing::fanuc();
  Cell cell;
  cell.ranges = limits_of(robot.joints);
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

TEST(Workspace, DoesNotDependOnTheThreads) {
  const Robot robot = testing::fanuc();
  const Cell cell = full_cell(robot);
  const Candidates one = candidates(robot, circle_of_targets(), cell, {.count = 25, .seed = 5, .threads = 1});
  const Candidates three = candidates(robot, circle_of_targets(), cell, {.count = 25, .seed = 5, .threads = 3});
  EXPECT_EQ(one.joint_values, three.joint_values);
  EXPECT_EQ(one.samples, three.samples);
  const Candidates other = candidates(robot, circle_of_targets(), cell, {.count = 25, .seed = 6});
  EXPECT_NE(one.joint_values, other.joint_values);
  // More candidates are the same ones and further ones.
  const Candidates more = candidates(robot, circle_of_targets(), cell, {.count = 35, .seed = 5});
  EXPECT_EQ(one.joint_values, more.joint_values.leftCols(25));
}

TEST(Workspace, RoundsJointValuesBeforeItChecksThem) {
  const Robot robot = testing::fanuc();
  Cell cell;
  cell.ranges = limits_of(robot.joints);
  cell.height = 0.2;
  const Candidates found = candidates(robot, circle_of_targets(), cell, {.count = 200, .angle_step = 0.1 * kDegree});
  const Eigen::MatrixXd steps = found.joint_values / (0.1 * kDegree);
  EXPECT_LT((steps.array() - steps.array().round()).abs().maxCoeff(), 1e-9);
}

// Three slides along x, y and z: the flange stands where the joint values say, to the last bit.
Robot gantry() {
  std::vector<testing::urdf::Part> slides;
  for (const std::string axis : {"1 0 0", "0 1 0", "0 0 1"}) {
    slides.push_back({"prismatic", "<axis xyz='" + axis + "'/>" + testing::urdf::limit("-8:8")});
  }
  return parse_robot(testing::urdf::serial(slides));
}

// One target at the flange's origin.
struct Gantry {
  Robot robot = gantry();
  std::vector<TargetFrame> targets = testing::targets_at({Vector3d::Zero()});
  Cell cell;

  Gantry() { cell.ranges = limits_of(robot.joints); }

  std::vector<std::string> at(double x, double y, double z) const {
    return violated(robot, targets, cell, Vector3d(x, y, z));
  }
  void expect_holds(double x, double y, double z) const {
    EXPECT_THAT(at(x, y, z), ::testing::IsEmpty()) << "at " << x << ", " << y << ", " << z;
  }
  void expect_violates(const std::string& name, double x, double y, double z) const {
    EXPECT_THAT(at(x, y, z), ::testing::ElementsAre(name)) << "at " << x << ", " << y << ", " << z;
  }
};

double just_above(double x) { return std::nextafter(x, 1e9); }
double just_below(double x) { return std::nextafter(x, -1e9); }

TEST(WorkspaceLimits, SumsHoldAtBothOfTheirBounds) {
  Gantry g;
  g.cell.sums.push_back(
      {.name = "diagonal", .weights = Vector3d(1.0, -2.0, 0.0), .offset = 0.25, .lower = -0.5, .upper = 1.5});
  g.expect_holds(1.25, 0.0, 3.0);
  g.expect_violates("range of diagonal", 1.25 + 1e-14, 0.0, 3.0);
  g.expect_holds(0.25, 0.5, 3.0);
  g.expect_violates("range of diagonal", 0.25 - 1e-14, 0.5, 3.0);
}

TEST(WorkspaceLimits, NumbersInNamesAreRoundedToWhatMatters) {
  Gantry g;
  g.cell.height = 7.12345678;
  g.expect_violates("least height 7123.457 mm", 0.0, 0.0, 0.0);
  g.cell.height.reset();
  g.cell.facing = {Vector3d::UnitX()};
  g.cell.tracker = Tracker{.position = {-1.0, 0.0, 0.0}, .acceptance = 12.3456789012 * kDegree};
  g.expect_violates("acceptance angle 12.345679 deg", 0.0, 0.0, 0.0);
  g.cell.tracker->acceptance = std::numbers::pi;  // which every direction is within
  g.expect_holds(0.0, 0.0, 0.0);
}

TEST(WorkspaceLimits, ABoxOfOneSideAloneIsOne) {
  for (int axis = 0; axis < 3; ++axis) {
    for (const bool upper : {false, true}) {
      Gantry g;
      (upper ? g.cell.box.upper : g.cell.box.lower)[axis] = 1.0;
      Vector3d p = Vector3d::Zero();
      p[axis] = upper ? 2.0 : 0.0;
      g.expect_violates("workspace box", p.x(), p.y(), p.z());
      p[axis] = upper ? 0.0 : 2.0;
      g.expect_holds(p.x(), p.y(), p.z());
    }
  }
}

TEST(WorkspaceLimits, ConstraintsAre64) {
  Gantry g;
  const Sphere far{.center = {100.0, 0.0, 0.0}, .radius = 1.0};
  g.cell.out_spheres.assign(63, far);
  g.cell.out_spheres.push_back({.center = {0.0, 0.0, 0.0}, .radius = 1.0});
  g.expect_violates("keep-out sphere 64", 0.0, 0.0, 0.0);
  g.expect_holds(2.0, 0.0, 0.0);
  g.cell.out_spheres.push_back(far);
  EXPECT_EQ(testing::refusal([&] { g.at(0.0, 0.0, 0.0); }), "the cell has 65 constraints, expected at most 64");
}

// The height is uniform between -8 m and 8 m: a quarter of the samples is above 4 m.
TEST(WorkspaceLimits, SayHowManySamplesEachOfThemRemoves) {
  Gantry g;
  g.cell.height = 4.0;
  g.cell.radius = 20.0;  // beyond reach
  const std::string said =
      testing::refusal([&] { candidates(g.robot, g.targets, g.cell, {.count = 10, .most_samples = 2000}); });
  static const std::regex counts(
      "the constraints leave 0 of 2000 sampled configurations, expected 10; least height "
      "4000 mm removes (\\d+) \\(0 alone\\), least radius 20000 mm removes 2000 "
      "\\((\\d+) alone\\)");
  std::smatch count;
  ASSERT_TRUE(std::regex_match(said, count, counts)) << said;
  EXPECT_NEAR(std::stoi(count[1]), 1500, 4.0 * std::sqrt(2000 * 0.75 * 0.25));
  EXPECT_EQ(std::stoi(count[1]) + std::stoi(count[2]), 2000);
}

// Only the quarter of the third slide's range above 4 m is used, which is five of twenty parts.
TEST(WorkspaceLimits, AJointThatUsesLittleOfItsRangeIsNamedWithTheCause) {
  Gantry g;
  g.cell.height = 4.0;
  g.cell.radius = 0.1;  // which rejects hardly any
  const Candidates found = candidates(g.robot, g.targets, g.cell, {.count = 2000});
  const std::vector<NarrowedRange> narrowed = narrowed_ranges(g.robot, g.targets, g.cell, found, 1);
  ASSERT_EQ(narrowed.size(), 1U);
  EXPECT_EQ(narrowed[0].joint, 2U);
  EXPECT_DOUBLE_EQ(narrowed[0].share, 0.25);
  ASSERT_EQ(narrowed[0].left_out.size(), 1U);
  EXPECT_NEAR(narrowed[0].left_out[0].first, -8.0, 1e-12);
  EXPECT_NEAR(narrowed[0].left_out[0].second, 4.0, 1e-12);
  EXPECT_EQ(narrowed[0].cause.constraint, "least height 4000 mm");
  EXPECT_EQ(narrowed[0].cause.links, "");
  g.cell.height = -0.1;  // a little more than half is used
  EXPECT_THAT(narrowed_ranges(g.robot, g.targets, g.cell, candidates(g.robot, g.targets, g.cell, {.count = 2000}), 1),
              ::testing::IsEmpty());
}

// A plate below the flange that reaches further along x than the slide does: clear of it only above 5 m.
TEST(WorkspaceLimits, AClearanceSaysWhichLinksItKeepsApart) {
  Gantry g;
  g.cell.body = {{.link = "l0", .frame = 0, .a = {-20.0, 0.0, 0.0}, .b = {20.0, 0.0, 0.0}, .radius = 0.1},
                 {.link = "far", .frame = 0, .a = {-20.0, 0.0, -90.0}, .b = {20.0, 0.0, -90.0}, .radius = 0.1},
                 {.link = "l3", .frame = 3, .a = {0.0, -20.0, 0.0}, .b = {0.0, 20.0, 0.0}, .radius = 0.1}};
  g.cell.clearance = 4.8;
  const Candidates found = candidates(g.robot, g.targets, g.cell, {.count = 2000});
  ASSERT_EQ(found.refusals.size(), 1U);
  EXPECT_EQ(found.refusals[0].links, "l0 and l3");
  const std::vector<NarrowedRange> narrowed = narrowed_ranges(g.robot, g.targets, g.cell, found, 1);
  ASSERT_EQ(narrowed.size(), 1U);
  EXPECT_EQ(narrowed[0].joint, 2U);
  EXPECT_EQ(narrowed[0].cause.constraint, "clearance 4800 mm");
  EXPECT_EQ(narrowed[0].cause.links, "l0 and l3");
  ASSERT_EQ(narrowed[0].left_out.size(), 1U);
  EXPECT_NEAR(narrowed[0].left_out[0].first, -4.8, 1e-9);  // the parts are 0.8 m long, and those at +-5 m are used
  EXPECT_NEAR(narrowed[0].left_out[0].second, 4.8, 1e-9);
}

TEST(WorkspaceLimits, GivesUpAfter100000SamplesAnd200ForEachCandidate) {
  Gantry g;
  g.cell.height = 9.0;  // beyond the limit of the joint
  EXPECT_EQ(testing::refusal([&] { candidates(g.robot, g.targets, g.cell, {.count = 7}); }),
            "the constraints leave 0 of 101400 sampled configurations, expected 7; least height 9000 mm removes 101400 "
            "(101400 alone)");
}

TEST(WorkspaceLimits, BoxHeightAndRadiusHoldOnTheirBoundary) {
  Gantry box;
  box.cell.box = {.lower = {-1.0, -0.5, 0.25}, .upper = {1.5, 2.0, 0.75}};
  for (int axis = 0; axis < 3; ++axis) {
    Vector3d p(0.0, 0.0, 0.5);
    for (const bool upper : {false, true}) {
      const double bound = upper ? box.cell.box.upper[axis] : box.cell.box.lower[axis];
      p[axis] = bound;
      box.expect_holds(p.x(), p.y(), p.z());
      p[axis] = upper ? just_above(bound) : just_below(bound);
      box.expect_violates("workspace box", p.x(), p.y(), p.z());
    }
  }
  Gantry high;
  high.cell.height = 0.5;
  high.expect_holds(0.0, 0.0, 0.5);
  high.expect_violates("least height 500 mm", 0.0, 0.0, just_below(0.5));
  Gantry round;
  round.cell.radius = 5.0;  // from the first axis, which lies along x
  round.expect_holds(7.0, 3.0, -4.0);
  round.expect_violates("least radius 5000 mm", 7.0, 3.0, 4.0 - 1e-14);
}

TEST(WorkspaceLimits, ZonesMayNotEvenBeTouched) {
  Gantry sphere;
  sphere.cell.out_spheres = {{.center = {2.0, 0.0, 0.0}, .radius = 0.5}};
  sphere.expect_violates("keep-out sphere 1", 1.5, 0.0, 0.0);
  sphere.expect_holds(just_below(1.5), 0.0, 0.0);
  Gantry box;
  box.cell.out_boxes = {{.lower = {1.0, -1.0, -1.0}, .upper = {2.0, 1.0, 1.0}}};
  box.expect_violates("keep-out box 1", 1.0, 0.0, 1.0);
  box.expect_holds(just_below(1.0), 0.0, 1.0);
  box.expect_violates("keep-out box 1", 2.0, 0.0, 0.0);
  box.expect_holds(just_above(2.0), 0.0, 0.0);
  // The body too, by its radius.
  for (Gantry* g : {&sphere, &box}) {
    g->cell.body = {{.link = "l3", .frame = 3, .b = {0.0, 0.0, 0.25}, .radius = 0.25}};
  }
  sphere.expect_violates("keep-out sphere 1", 1.25, 0.0, 0.0);
  sphere.expect_holds(just_below(1.25), 0.0, 0.0);
  box.expect_violates("keep-out box 1", 0.75, 0.0, 0.0);
  box.expect_holds(just_below(0.75), 0.0, 0.0);
}

TEST(WorkspaceLimits, ClearanceHoldsAtItsValue) {
  Gantry g;
  g.cell.body = {{.link = "l0", .frame = 0, .b = {0.0, 0.0, 1.0}, .radius = 0.25},
                 {.link = "l3", .frame = 3, .b = {0.0, 0.0, 0.5}, .radius = 0.125}};
  g.cell.clearance = 0.5;
  g.expect_holds(0.875, 0.0, 0.25);
  g.expect_violates("clearance 500 mm", just_below(0.875), 0.0, 0.25);
  g.expect_holds(0.0, 0.0, 1.875);
  g.expect_violates("clearance 500 mm", 0.0, 0.0, just_below(1.875));
}

TEST(WorkspaceLimits, TheTrackersDistanceHoldsAtBothOfItsBounds) {
  Gantry g;
  g.cell.tracker = Tracker{.position = {0.0, 0.0, 1.0}, .least_distance = 1.5, .greatest_distance = 4.0};
  g.expect_holds(1.5, 0.0, 1.0);
  g.expect_violates("distance from the tracker", just_below(1.5), 0.0, 1.0);
  g.expect_holds(0.0, -4.0, 1.0);
  g.expect_violates("distance from the tracker", 0.0, just_below(-4.0), 1.0);
}

TEST(WorkspaceLimits, FacingAnglesHoldUpToTheAcceptance) {
  Gantry g;
  g.cell.facing = {Vector3d(0.0, 0.0, 2.0)};  // of any length
  g.cell.tracker = Tracker{.position = Vector3d::Zero(), .acceptance = 40 * kDegree};
  for (const double around : {0.0, 1.0, 2.5, 4.0}) {
    for (const double beyond : {-1e-9, 1e-9}) {
      const double angle = 40 * kDegree + beyond;
      // Below the tracker, so that the beam leaves the target at this angle to z.
      const Vector3d p =
          -2.0 * Vector3d(std::sin(angle) * std::cos(around), std::sin(angle) * std::sin(around), std::cos(angle));
      if (beyond < 0.0) {
        g.expect_holds(p.x(), p.y(), p.z());
      } else {
        g.expect_violates("acceptance angle 40 deg", p.x(), p.y(), p.z());
      }
    }
  }
}

TEST(WorkspaceLimits, BeamsMayGrazeTheBodyAndSpheresButNoBox) {
  Gantry g;  // the target at the origin, the tracker at x = 4
  g.cell.tracker = Tracker{.position = {4.0, 0.0, 0.0}};
  const auto blocked = [&] { return !g.at(0.0, 0.0, 0.0).empty(); };
  g.cell.body = {{.link = "l0", .frame = 0, .a = {2.0, 0.5, -1.0}, .b = {2.0, 0.5, 1.0}, .radius = 0.5}};
  EXPECT_FALSE(blocked());
  g.cell.body.front().radius = 0.5 + 1e-12;
  EXPECT_TRUE(blocked());
  g.cell.body.clear();
  g.cell.out_spheres = {{.center = {2.0, 0.5, 0.0}, .radius = 0.5}};
  EXPECT_FALSE(blocked());
  g.cell.out_spheres.front().radius = 0.5 + 1e-12;
  EXPECT_TRUE(blocked());
  g.cell.out_spheres.front() = {.center = {4.0, 0.5, 0.0}, .radius = 1.0};  // the tracker stands in it
  EXPECT_FALSE(blocked());
  g.cell.out_spheres.clear();
  g.cell.out_boxes = {{.lower = {1.0, 0.0, -1.0}, .upper = {2.0, 1.0, 1.0}}};
  EXPECT_TRUE(blocked());
  g.cell.out_boxes.front().lower.y() = 1e-12;
  EXPECT_FALSE(blocked());
  g.cell.out_boxes.front() = {.lower = {3.0, -1.0, -1.0}, .upper = {4.0, 1.0, 1.0}};  // the tracker stands on it
  EXPECT_FALSE(blocked());
  g.cell.out_boxes.front().upper.x() = just_below(4.0);
  EXPECT_TRUE(blocked());
}

TEST(WorkspaceLimits, RangesAreKeptWhenJointValuesAreRounded) {
  Gantry g;
  g.cell.ranges = {{-0.13, 0.27}, {0.5, 0.5}, {-0.33, -0.11}};
  const CandidateOptions options{.count = 300, .length_step = 0.1};
  const Eigen::MatrixXd q = candidates(g.robot, g.targets, g.cell, options).joint_values;
  // Multiples of the step, but for what would lie beyond a bound: that is the bound itself.
  const Vector3d least(-0.1, 0.5, -0.3);
  const Vector3d most(0.27, 0.5, -0.11);
  EXPECT_LT((q.rowwise().minCoeff() - least).cwiseAbs().maxCoeff(), 1e-15);
  EXPECT_EQ(q.rowwise().maxCoeff(), most);
}

// Which capsules the segment goes through, by points strewn over both.
std::vector<std::size_t> in_the_way(const Cell& cell, const Scene& now, const Vector3d& from, const Vector3d& to,
                                    double margin) {
  std::vector<std::size_t> found;
  for (std::size_t c = 0; c < cell.body.size(); ++c) {
    double nearest = 1e9;
    for (const Vector3d& axis : now.axes[c]) {
      for (int i = 0; i <= 80; ++i) {
        nearest = std::min(nearest, (from + (to - from) * (i / 80.0) - axis).norm());
      }
    }
    if (nearest < cell.body[c].radius + margin) {
      found.push_back(c);
    }
  }
  return found;
}

TEST(Workspace, EachLinkAloneStopsTheBeam) {
  const Robot robot = testing::fanuc();
  Cell cell;
  cell.ranges = limits_of(robot.joints);
  // A bar on each link, beside its axis: the shapes of a wrist enclose each other.
  for (std::size_t frame = 0; frame <= robot.chain.getNrOfSegments(); ++frame) {
    cell.body.push_back({.link = "frame " + std::to_string(frame),
                         .frame = frame,
                         .a = {0.25, 0.0, 0.0},
                         .b = {0.25, 0.1, 0.3},
                         .radius = 0.05});
  }
  std::vector<bool> tested(cell.body.size(), false);
  Random random(6);
  for (int trial = 0; trial < 4000 && std::find(tested.begin(), tested.end(), false) != tested.end(); ++trial) {
    const Eigen::VectorXd q = random_configurations(cell.ranges, 1, random);
    const Scene now = scene(robot, cell, q);
    const std::size_t wanted = random.bits() % cell.body.size();
    const std::vector<TargetFrame> targets =
        testing::targets_at({{random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6)}});
    const Vector3d target = to_eigen(now.flange) * targets[0].X_FT.translation();
    // A tracker behind the middle of this link.
    const Vector3d middle = now.axes[wanted][20];
    const Vector3d tracker = middle + 3.0 * (middle - target).normalized();
    if (tested[wanted]) {
      continue;
    }
    const auto near = in_the_way(cell, now, tracker, target, 0.03);
    if (near != std::vector<std::size_t>{wanted} || (target - middle).norm() < 1.5 * cell.body[wanted].radius) {
      continue;
    }
    tested[wanted] = true;
    cell.tracker = Tracker{.position = tracker};
    EXPECT_THAT(violated(robot, targets, cell, q), ::testing::ElementsAre("line of sight"))
        << cell.body[wanted].link << " does not stop the beam";
    Cell without = cell;
    without.body.erase(without.body.begin() + static_cast<std::ptrdiff_t>(wanted));
    EXPECT_THAT(violated(robot, targets, without, q), ::testing::IsEmpty())
        << "something beside " << cell.body[wanted].link;
    Cell as_tool = cell;
    as_tool.body[wanted].tool = true;  // which is left to the facing directions
    EXPECT_THAT(violated(robot, targets, as_tool, q), ::testing::IsEmpty()) << cell.body[wanted].link;
  }
  for (std::size_t c = 0; c < tested.size(); ++c) {
    EXPECT_TRUE(tested[c]) << cell.body[c].link << " was never alone in the way";
  }
}

TEST(Workspace, WhatCarriesTheTargetMayEncloseItButOthersMayNot) {
  Gantry g;
  g.cell.tracker = Tracker{.position = {4.0, 0.0, 0.0}};
  g.cell.body = {{.link = "l3", .frame = 3, .radius = 0.5}};  // around the target at the flange's origin
  g.expect_holds(0.0, 0.0, 0.0);
  g.cell.body.front().a = g.cell.body.front().b = Vector3d(1.0, 0.0, 0.0);  // of the flange's link, but beside it
  g.expect_violates("line of sight", 0.0, 0.0, 0.0);
  g.cell.body.front() = {.link = "l2", .frame = 2, .radius = 0.5};  // moves against the flange
  g.expect_violates("line of sight", 0.0, 0.0, 0.0);
}

TEST(Workspace, RefusesCellsThatDoNotFit) {
  const Robot robot = testing::fanuc();
  Cell cell;
  const auto refused = [&] {
    return testing::refusal([&] { candidates(robot, circle_of_targets(), cell, {.count = 1}); });
  };
  const std::string ranges = "the cell's joint ranges do not fit the robot, expected 6 joints";
  EXPECT_EQ(refused(), ranges);
  cell.ranges = limits_of(robot.joints);
  cell.sums = {{.name = "short", .weights = Eigen::VectorXd::Ones(5)}};
  EXPECT_EQ(refused(), ranges);
  cell.sums.clear();
  cell.ranges[2] = {1.0, -1.0};
  EXPECT_EQ(refused(), "joint 'joint_3': its range is empty, expected one within the joint's limits");
  cell.ranges[2] = {0.5, 0.5};
  EXPECT_EQ(refused(), "nothing was refused");
  cell.facing = {Vector3d::UnitX()};
  EXPECT_EQ(refused(), "the cell has 1 facing directions, expected one for each of 3 targets");
  cell.facing.clear();
  cell.body = {{.link = "x", .frame = robot.chain.getNrOfSegments() + 1}};
  EXPECT_EQ(refused(), "the body of link 'x' belongs to no frame of the robot");
  cell.body[0].frame = robot.chain.getNrOfSegments();
  EXPECT_EQ(refused(), "nothing was refused");
}

TEST(Workspace, RefusesCellsOfWhatIsNoNumber) {
  const Robot robot = testing::fanuc();
  Cell sound;
  sound.ranges = limits_of(robot.joints);
  sound.sums = {{.name = "J2 + J3", .weights = Eigen::VectorXd::Unit(6, 1)}};
  sound.height = -3.0;
  sound.radius = 0.0;
  sound.out_spheres = {{.center = {9.0, 9.0, 9.0}, .radius = 0.1}};
  sound.out_boxes = {{.lower = Vector3d::Constant(8.0), .upper = Vector3d::Constant(9.0)}};
  sound.body = {{.link = "flange", .frame = 6, .radius = 0.01}};
  sound.clearance = 0.0;
  sound.tracker = Tracker{.position = {5.0, 0.0, 1.0}};
  sound.facing = std::vector<Vector3d>(3, Vector3d::UnitX());
  const CandidateOptions one{.count = 1};
  EXPECT_NO_THROW(candidates(robot, circle_of_targets(), sound, one));
  const double no_number = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::pair<const char*, std::function<void(Cell&)>>> spoilers = {
      {"weights", [&](Cell& cell) { cell.sums[0].weights[2] = no_number; }},
      {"offset", [&](Cell& cell) { cell.sums[0].offset = no_number; }},
      {"lower bound", [&](Cell& cell) { cell.sums[0].lower = no_number; }},
      {"upper bound", [&](Cell& cell) { cell.sums[0].upper = no_number; }},
      {"box", [&](Cell& cell) { cell.box.upper[1] = no_number; }},
      {"height", [&](Cell& cell) { cell.height = no_number; }},
      {"radius", [&](Cell& cell) { cell.radius = no_number; }},
      {"sphere", [&](Cell& cell) { cell.out_spheres[0].center[0] = no_number; }},
      {"radius of a sphere", [&](Cell& cell) { cell.out_spheres[0].radius = no_number; }},
      {"keep-out box", [&](Cell& cell) { cell.out_boxes[0].lower[2] = no_number; }},
      {"body", [&](Cell& cell) { cell.body[0].b[1] = no_number; }},
      {"radius of the body", [&](Cell& cell) { cell.body[0].radius = no_number; }},
      {"clearance", [&](Cell& cell) { cell.clearance = no_number; }},
      {"tracker", [&](Cell& cell) { cell.tracker->position[0] = no_number; }},
      {"least distance", [&](Cell& cell) { cell.tracker->least_distance = no_number; }},
      {"greatest distance", [&](Cell& cell) { cell.tracker->greatest_distance = no_number; }},
      {"acceptance", [&](Cell& cell) { cell.tracker->acceptance = no_number; }},
      {"facing", [&](Cell& cell) { cell.facing[1][2] = no_number; }},
  };
  for (const auto& [what, spoil] : spoilers) {
    Cell cell = sound;
    spoil(cell);
    EXPECT_THROW(candidates(robot, circle_of_targets(), cell, one), InputError) << what;
    EXPECT_THROW(violated(robot, circle_of_targets(), cell, Eigen::VectorXd::Zero(6)), InputError) << what;
  }
}

}  // namespace
}  // namespace kdl_calibration::workspace_test
