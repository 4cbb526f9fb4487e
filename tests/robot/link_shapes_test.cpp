#include "robot/link_shapes.hpp"

#include <gmock/gmock.h>

#include "refusal.hpp"

namespace kdl_calibration::link_shapes_test {
namespace {

using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Kind = LinkShape::Kind;

std::string shaped(const std::string& kind, const std::string& geometry, const std::string& origin = "") {
  return "<" + kind + ">" + origin + "<geometry>" + geometry + "</geometry></" + kind + ">";
}

/// Two links of a chain with this in the first of them, and a link beside it.
Robot robot_with(const std::string& content, const std::string& beside = "") {
  Robot robot = parse_robot(
      "<robot name='r'><link name='a'/><link name='b'/><link name='c'/>"
      "<joint name='j' type='continuous'><parent link='a'/><child link='b'/></joint>"
      "<joint name='k' type='fixed'><parent link='a'/><child link='c'/></joint></robot>",
      {.base = "a", .tip = "b"}, "r.urdf");
  robot.urdf = "<robot name='r'><link name='a'>" + content + "</link><link name='b'/><link/><link name='c'>" + beside +
               "</link></robot>";
  return robot;
}

std::string fault(const std::string& content) {
  return testing::refusal([&] { link_shapes(robot_with(content)); });
}

TEST(LinkShapes, AreThoseOfCollisionsInTheOrderOfTheUrdf) {
  const std::vector<LinkShape> shapes = link_shapes(
      robot_with(shaped("visual", "<sphere radius='9'/>") +
                     shaped("collision", "<box size=' 1 +2\t3'/>", "<origin xyz='1 2 3'/>") +
                     shaped("collision", "<cylinder radius='0.5' length='4'/>", "<origin rpy='0.3 -0.2 0.9'/>") +
                     shaped("collision", "<sphere radius='0.25'/>") +
                     shaped("collision", "<mesh filename='m'/>", "<origin xyz='7 7 7'/>") + "<collision/>",
                 shaped("collision", "<sphere radius='9'/>")));
  ASSERT_EQ(shapes.size(), 5U);
  const std::vector<Kind> kinds = {Kind::box, Kind::cylinder, Kind::sphere, Kind::mesh, Kind::mesh};
  const std::vector<Vector3d> sizes = {{1, 2, 3}, {0.5, 0, 4}, {0.25, 0, 0}, {0, 0, 0}, {0, 0, 0}};
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    EXPECT_EQ(shapes[i].kind, kinds[i]) << i;
    EXPECT_EQ(shapes[i].size, sizes[i]) << i;
    EXPECT_EQ(shapes[i].link, "a") << i;
    EXPECT_EQ(shapes[i].X_LS.translation(), i == 0 ? Vector3d(1, 2, 3) : Vector3d(0, 0, 0)) << i;
  }
  const Eigen::Matrix3d turned =
      (Eigen::AngleAxisd(0.9, Vector3d::UnitZ()) * Eigen::AngleAxisd(-0.2, Vector3d::UnitY()) *
       Eigen::AngleAxisd(0.3, Vector3d::UnitX()))
          .toRotationMatrix();
  EXPECT_LT((shapes[1].X_LS.linear() - turned).norm(), 1e-15);
}

TEST(LinkShapes, AreVisualOnesWhereALinkHasNoOthers) {
  const std::vector<LinkShape> shapes = link_shapes(robot_with(shaped("visual", "<sphere radius='9'/>")));
  ASSERT_EQ(shapes.size(), 1U);
  EXPECT_EQ(shapes[0].size.x(), 9.0);
  EXPECT_THAT(link_names(robot_with("")), ElementsAre("a", "b"));
}

TEST(LinkShapes, OfNoSizeAreRefused) {
  for (const std::string bad : {"1 0 1", "1 1 -1", "0 1 1"}) {
    EXPECT_EQ(fault(shaped("collision", "<box size='" + bad + "'/>")),
              "r.urdf: collision of link 'a': expected a shape with positive sizes");
  }
  for (const std::string bad :
       {"size='1 2'", "size='1 2 x'", "size='1 inf 2'", "size='nan 1 1'", "", "size='1e999 1 1'"}) {
    EXPECT_EQ(fault(shaped("visual", "<box " + bad + "/>")),
              "r.urdf: visual of link 'a': box size: expected 3 finite numbers")
        << bad;
  }
  EXPECT_THAT(fault(shaped("visual", "<cylinder radius='0' length='1'/>")), HasSubstr("positive sizes"));
  EXPECT_THAT(fault(shaped("visual", "<cylinder radius='1'/>")), HasSubstr("cylinder length: expected 1 finite"));
  EXPECT_THAT(fault(shaped("visual", "<cylinder length='1'/>")), HasSubstr("cylinder radius: expected 1 finite"));
  EXPECT_THAT(fault(shaped("visual", "<sphere/>")), HasSubstr("sphere radius: expected 1 finite"));
  EXPECT_THAT(fault(shaped("visual", "<sphere radius='1'/>", "<origin xyz='1 2'/>")), HasSubstr("xyz: expected 3"));
  EXPECT_THAT(fault(shaped("visual", "<sphere radius='1'/>", "<origin rpy='1 2'/>")), HasSubstr("rpy: expected 3"));
}

}  // namespace
}  // namespace kdl_calibration::link_shapes_test
