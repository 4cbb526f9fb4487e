#include "planning/arm_body.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <numbers>

#include "base/number_text.hpp"
#include "base/random.hpp"
#include "support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::arm_body_test {
namespace {

using Eigen::Vector3d;

Vector3d random_point(Random& random, double size = 1.0) {
  const double x = random.uniform(-size, size);
  const double y = random.uniform(-size, size);
  return {x, y, random.uniform(-size, size)};
}

std::vector<Vector3d> points_along(const Vector3d& a, const Vector3d& b, int count) {
  std::vector<Vector3d> points;
  for (int i = 0; i <= count; ++i) {
    points.emplace_back(a + (b - a) * (static_cast<double>(i) / count));
  }
  return points;
}

TEST(ArmBody, MeasuresDistancesAsDensePointsDo) {
  Random random(3);
  for (int trial = 0; trial < 200; ++trial) {
    const Vector3d a = random_point(random);
    const Vector3d b = trial % 10 == 0 ? a : random_point(random);
    const Vector3d c = random_point(random);
    const Vector3d d = trial % 7 == 0 ? Vector3d(c + (b - a)) : random_point(random);
    const Vector3d corner = random_point(random);
    const Box box{.lower = corner.cwiseMin(c), .upper = corner.cwiseMax(c)};
    double segments = 1e9;
    double point = 1e9;
    double to_box = 1e9;
    for (const Vector3d& p : points_along(a, b, 300)) {
      point = std::min(point, (p - c).norm());
      to_box = std::min(to_box, (p - p.cwiseMax(box.lower).cwiseMin(box.upper)).norm());
      for (const Vector3d& r : points_along(c, d, 300)) {
        segments = std::min(segments, (p - r).norm());
      }
    }
    const double coarse = 0.02;  // what the points' spacing may cost
    EXPECT_LE(segment_distance(a, b, c, d), segments + 1e-12);
    EXPECT_GE(segment_distance(a, b, c, d), segments - coarse);
    EXPECT_LE(segment_distance(a, b, c), point + 1e-12);
    EXPECT_GE(segment_distance(a, b, c), point - coarse);
    EXPECT_LE(segment_distance(a, b, box), to_box + 1e-12);
    EXPECT_GE(segment_distance(a, b, box), to_box - coarse);
  }
}

TEST(ArmBody, SegmentsThroughABoxHaveNoDistanceFromIt) {
  Random random(4);
  for (int trial = 0; trial < 500; ++trial) {
    const Vector3d corner = random_point(random);
    const Vector3d other = random_point(random);
    const Box box{.lower = corner.cwiseMin(other), .upper = corner.cwiseMax(other)};
    const Vector3d inside = box.lower + random.uniform(0.01, 0.99) * (box.upper - box.lower);
    const Vector3d way = random_point(random, 4.0);
    EXPECT_EQ(segment_distance(inside - random.uniform(0.0, 1.0) * way, inside + way, box), 0.0) << trial;
  }
}

TEST(ArmBody, PutsLinkFramesWhereKdlDoes) {
  for (const Robot& robot : {testing::fanuc(), parse_robot(testing::kOddArm)}) {
    const ErrorModel model = complete_model(robot);
    Random random(1);
    KDL::ChainFkSolverPos_recursive solver(robot.chain);
    for (int trial = 0; trial < 20; ++trial) {
      KDL::JntArray q(static_cast<unsigned>(robot.joints.size()));
      q.data = testing::random_joints(model, random);
      const auto frames = link_frames(robot, q.data);
      ASSERT_EQ(frames.size(), robot.chain.getNrOfSegments() + 1);
      for (unsigned s = 0; s <= robot.chain.getNrOfSegments(); ++s) {
        KDL::Frame expected;
        solver.JntToCart(q, expected, static_cast<int>(s));
        EXPECT_LT(testing::difference(to_kdl(frames[s]), expected), 1e-12);
      }
    }
  }
}

std::string collision(const std::string& shape, const std::string& origin = "") {
  return "<collision>" + origin + "<geometry>" + shape + "</geometry></collision>";
}

Robot with_shapes(const std::string& shapes) {
  return parse_robot("<robot name='r'><link name='a'>" + shapes +
                     "</link><link name='b'/><joint name='j' type='continuous'><parent link='a'/><child link='b'/>"
                     "<axis xyz='0 0 1'/></joint></robot>");
}

double outside(const Capsule& capsule, const Vector3d& p) {
  return segment_distance(capsule.a, capsule.b, p) - capsule.radius;
}

// A capsule along the axis needs at least the radius `reach`. With its ends drawn in by half of that, or to the middle
// of a flat shape, it needs an eighth more and stands out less far beyond the ends.
void expect_tight(const Capsule& capsule, const Eigen::Isometry3d& X, const Vector3d& axis, double half_length,
                  double reach) {
  const Vector3d local_a = X.inverse() * capsule.a;
  const Vector3d local_b = X.inverse() * capsule.b;
  EXPECT_LT((local_a + local_b).norm(), 1e-12) << "off centre";
  EXPECT_LT(local_a.cross(axis).norm(), 1e-12) << "off the axis";
  const double drawn_in = std::min(half_length, 0.5 * reach);
  const double needed = std::sqrt(reach * reach + drawn_in * drawn_in);
  EXPECT_NEAR(capsule.radius, needed, 1e-12);
  EXPECT_NEAR(0.5 * (local_b - local_a).norm() + capsule.radius - half_length, needed - drawn_in, 1e-12);
  EXPECT_LE(capsule.radius, 1.1181 * reach);
}

// Of the farthest of these points: 0 where the capsule touches the shape.
double farthest_outside(const Capsule& capsule, const Eigen::Isometry3d& X, const std::vector<Vector3d>& points) {
  double farthest = -1e9;
  for (const Vector3d& p : points) {
    farthest = std::max(farthest, outside(capsule, X * p));
  }
  return farthest;
}

std::string numbers(const Vector3d& v) { return shortest(v.x()) + " " + shortest(v.y()) + " " + shortest(v.z()); }

TEST(ArmBody, CapsulesTouchTheShapesThatTheyEnclose) {
  Random random(11);
  for (int trial = 0; trial < 60; ++trial) {
    SCOPED_TRACE(trial);
    const Vector3d xyz = random_point(random);
    const Vector3d rpy = random_point(random, 1.5);
    const Eigen::Isometry3d X =
        to_eigen(KDL::Frame(KDL::Rotation::RPY(rpy.x(), rpy.y(), rpy.z()), KDL::Vector(xyz.x(), xyz.y(), xyz.z())));
    const Vector3d half{random.uniform(0.05, 1.0), random.uniform(0.05, 1.0), random.uniform(0.05, 1.0)};
    const double radius = random.uniform(0.05, 0.5);
    const double length = random.uniform(0.05, 2.0);
    const std::string origin = "<origin xyz='" + numbers(xyz) + "' rpy='" + numbers(rpy) + "'/>";
    const ArmBody body = body_from_urdf(with_shapes(
        collision("<box size='" + numbers(2.0 * half) + "'/>", origin) +
        collision("<cylinder radius='" + shortest(radius) + "' length='" + shortest(length) + "'/>", origin) +
        collision("<sphere radius='0.375'/>", origin)));
    ASSERT_EQ(body.capsules.size(), 3U);
    std::vector<Vector3d> corners;
    for (int corner = 0; corner < 8; ++corner) {
      corners.emplace_back(half.cwiseProduct(Vector3d(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1)));
    }
    EXPECT_NEAR(farthest_outside(body.capsules[0], X, corners), 0.0, 1e-12);
    Eigen::Index longest = 0;
    half.maxCoeff(&longest);
    const double reach = std::hypot(half[(longest + 1) % 3], half[(longest + 2) % 3]);
    expect_tight(body.capsules[0], X, Vector3d::Unit(longest), half[longest], reach);
    std::vector<Vector3d> rims;
    for (int k = 0; k < 24; ++k) {
      rims.emplace_back(radius * std::cos(k), radius * std::sin(k), (k % 2 == 0 ? 0.5 : -0.5) * length);
    }
    EXPECT_NEAR(farthest_outside(body.capsules[1], X, rims), 0.0, 1e-12);
    expect_tight(body.capsules[1], X, Vector3d::UnitZ(), 0.5 * length, radius);
    EXPECT_LT((body.capsules[2].a - xyz).norm() + (body.capsules[2].b - xyz).norm(), 1e-15);
    EXPECT_EQ(body.capsules[2].radius, 0.375);
  }
}

TEST(ArmBody, CapsulesOfOneRadiusEndAtTheNextJoint) {
  for (const Robot& robot : {testing::fanuc(), parse_robot(testing::kOddArm)}) {
    const std::vector<Capsule> capsules = body_with_radius(robot, 0.125).capsules;
    const Eigen::VectorXd zero = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(robot.joints.size()));
    const std::vector<Eigen::Isometry3d> frames = link_frames(robot, zero);
    ASSERT_EQ(capsules.size() + 1, frames.size());
    for (std::size_t i = 0; i < capsules.size(); ++i) {
      EXPECT_EQ(capsules[i].frame, i);
      EXPECT_EQ(capsules[i].radius, 0.125);
      EXPECT_FALSE(capsules[i].tool);
      EXPECT_EQ(capsules[i].a, Vector3d::Zero());
      EXPECT_LT((frames[i] * capsules[i].b - frames[i + 1].translation()).norm(), 1e-12) << capsules[i].link;
    }
  }
}

TEST(ArmBody, TheToolReachesFromTheFlangeToEachTarget) {
  const Robot robot = testing::fanuc();
  const std::vector<TargetFrame> targets = testing::targets_at({{0.1, 0.2, 0.3}, {-0.1, 0.0, 0.5}});
  const std::vector<Capsule> tool = tool_body(robot, targets, 0.03);
  ASSERT_EQ(tool.size(), 2U);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(tool[k].frame, robot.chain.getNrOfSegments());
    EXPECT_EQ(tool[k].a, Vector3d::Zero());
    EXPECT_EQ(tool[k].b, targets[k].X_FT.translation());
    EXPECT_EQ(tool[k].radius, 0.03);
    EXPECT_TRUE(tool[k].tool);
  }
}

TEST(ArmBody, ALinkWithAMeshBesideItsOtherShapesIsNamedToo) {
  const ArmBody body = body_from_urdf(
      with_shapes(collision("<sphere radius='0.25'/>") + collision("<mesh filename='package://no/such.stl'/>")));
  ASSERT_EQ(body.capsules.size(), 1U);
  EXPECT_EQ(body.capsules[0].link, "a");
  EXPECT_EQ(body.capsules[0].frame, 0U);
  EXPECT_THAT(body.without_shape, ::testing::ElementsAre("a", "b"));
}

// Three joints that turn about z, x and y; the last one's axis passes the point where the others meet at this distance.
Robot wrist_with_an_offset(double offset, const std::string& last = "revolute") {
  const std::string limit = testing::urdf::limit("-3:3");
  return parse_robot(testing::urdf::serial(
      {{"revolute", "<axis xyz='0 0 1'/>" + limit},
       {"revolute", "<origin xyz='0 " + shortest(offset) + " 0'/><axis xyz='1 0 0'/>" + limit},  // they pass each other
       {last, "<axis xyz='0 1 0'/>" + limit}}));
}

TEST(ArmBody, JointsWhoseAxesMeetWithinAMicrometreAreOneWrist) {
  const std::vector<Capsule> capsules = {{.link = "l0", .frame = 0, .b = {0.0, 0.0, -1.0}},
                                         {.link = "l2", .frame = 2, .b = {0.0, 0.0, 1.0}}};
  // The point between the two axes is half of the offset from each.
  EXPECT_THAT(pairs_to_keep_apart(wrist_with_an_offset(1.9e-6), capsules, 0.0), ::testing::IsEmpty());
  EXPECT_EQ(pairs_to_keep_apart(wrist_with_an_offset(2.1e-6), capsules, 0.0).size(), 1U);
  // What slides joins no wrist.
  const std::vector<Capsule> behind = {{.link = "l1", .frame = 1, .b = {0.0, 0.0, -1.0}},
                                       {.link = "l3", .frame = 3, .b = {0.0, 0.0, 1.0}}};
  EXPECT_THAT(pairs_to_keep_apart(wrist_with_an_offset(0.0), behind, 0.0), ::testing::IsEmpty());
  EXPECT_EQ(pairs_to_keep_apart(wrist_with_an_offset(0.0, "prismatic"), behind, 0.0).size(), 1U);
  // Nor does a tool beside the link that carries the last joint, however far they are apart.
  const std::vector<Capsule> tool = {
      {.link = "l2", .frame = 2, .b = {0.0, 0.0, -1.0}},
      {.link = "tool", .frame = 3, .a = {0.0, 0.0, 4.0}, .b = {0.0, 0.0, 5.0}, .tool = true}};
  EXPECT_THAT(pairs_to_keep_apart(wrist_with_an_offset(0.0), tool, 0.0), ::testing::IsEmpty());
}

// Slides along x, y and z between a point and a sphere. The third one goes half as far as the first one, so they come
// 8 sqrt(1 + 1/4) m apart at most; without that 8 sqrt(2) m.
TEST(ArmBody, AClearanceIsAskedOfPairsThatHaveItInATenthOfTheConfigurations) {
  const auto slide = [](const std::string& axis, const std::string& range, const std::string& mimic = "") {
    return testing::urdf::Part{"prismatic", "<axis xyz='" + axis + "'/>" + testing::urdf::limit(range) + mimic};
  };
  const Robot robot =
      parse_robot(testing::urdf::serial({slide("1 0 0", "-8:8"), slide("0 1 0", "-0.01:0.01"),
                                         slide("0 0 1", "-8:8", "<mimic joint='j1' multiplier='0.5'/>")}));
  const std::vector<Capsule> capsules = {{.link = "l0", .frame = 0}, {.link = "l3", .frame = 3, .radius = 0.25}};
  // The first slide is uniform, so a tenth of the configurations is beyond nine tenths of the way.
  const auto apart = [](double share) { return share * 8.0 * std::sqrt(1.25) - 0.25; };
  EXPECT_EQ(pairs_to_keep_apart(robot, capsules, apart(0.85)).size(), 1U);
  EXPECT_THAT(pairs_to_keep_apart(robot, capsules, apart(0.95)), ::testing::IsEmpty());
}

// A box of 2 x 1 x 1 m in a link that stands at x = 3 m, turned by 90 degrees about z: it covers y from -1 to 1.
TEST(ArmBody, ABoxIsAsFarAwayAsItsSides) {
  const Capsule box{.link = "a",
                    .a = {-0.5, 0.0, 0.0},
                    .b = {0.5, 0.0, 0.0},
                    .radius = 0.9,
                    .box = LinkBox{.X_LB = Eigen::Isometry3d::Identity(), .box = {{-1, -0.5, -0.5}, {1, 0.5, 0.5}}}};
  Eigen::Isometry3d X(Eigen::Translation3d(3.0, 0.0, 0.0));
  X.rotate(Eigen::AngleAxisd(std::numbers::pi / 2.0, Vector3d::UnitZ()));
  const Capsule rod{.link = "b", .a = {0.0, -1.0, 0.0}, .b = {0.0, 1.0, 0.0}, .radius = 0.25};
  const Eigen::Isometry3d Y(Eigen::Translation3d(1.0, 0.0, 0.0));
  EXPECT_NEAR(distance(box, X, rod, Y, 5.0), 1.25, 1e-12);  // 2.5 - 1 - 0.25
  EXPECT_NEAR(distance(rod, Y, box, X, 5.0), 1.25, 1e-12);
  EXPECT_NEAR(distance(box, X, rod, Y, 0.8), 0.85, 1e-12) << "the capsules are apart enough: 2 - 0.9 - 0.25";
  EXPECT_EQ(distance(box, X, rod, Eigen::Isometry3d(Eigen::Translation3d(3.0, 0.0, 0.0)), 5.0), -0.25);
}

TEST(ArmBody, LeavesNeighboursAndTheWristToTheJointLimits) {
  const Robot robot = testing::fanuc();
  std::vector<Capsule> capsules = body_from_urdf(robot).capsules;
  for (const Capsule& capsule : tool_body(robot, {TargetFrame{.name = "A"}}, 0.01)) {
    capsules.push_back(capsule);
  }
  const auto pairs = pairs_to_keep_apart(robot, capsules, 0.0);
  const auto apart = [&](const std::string& first, const std::string& second) {
    return std::any_of(pairs.begin(), pairs.end(), [&](const auto& pair) {
      return capsules[pair.first].link == first && capsules[pair.second].link == second;
    });
  };
  EXPECT_TRUE(apart("base_link", "link_3"));
  EXPECT_TRUE(apart("link_2", "link_4"));
  EXPECT_TRUE(apart("link_1", "link_3"));
  EXPECT_FALSE(apart("link_2", "link_3"));
  EXPECT_FALSE(apart("link_4", "link_6"));
  EXPECT_FALSE(apart("link_3", "link_6"));
  EXPECT_TRUE(apart("link_4", "the tool to target A"));
}

}  // namespace
}  // namespace kdl_calibration::arm_body_test
