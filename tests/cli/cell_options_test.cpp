// What the options of a cell mean, word by word: joints and sums of them, zones, the tracker, the body.

#include "cli/cell_options.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <limits>

#include "cli_support.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "refusal.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::testing::cell_options_test {
namespace {

using cli::CellArguments;
using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Two joints of which one has a name that begins as the other's.
constexpr const char* kNamesakes = R"(<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
  <joint name="j1" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
  <joint name="j11" type="continuous"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/></joint></robot>)";

Cell cell_of(const CellArguments& arguments, const Robot& robot, const JointConvention* convention = nullptr,
             const cli::FacingTargets& targets = {}) {
  return cli::cell(arguments, robot, targets, convention);
}

bool holds(const Cell& cell, const VectorXd& q) {
  for (Index i = 0; i < q.size(); ++i) {
    const auto& [lower, upper] = cell.ranges[static_cast<std::size_t>(i)];
    if (q[i] < lower || q[i] > upper) {
      return false;
    }
  }
  return std::all_of(cell.sums.begin(), cell.sums.end(), [&](const JointSum& sum) {
    const double value = sum.weights.dot(q) + sum.offset;
    return value >= sum.lower && value <= sum.upper;
  });
}

/// What a range says of joint values, written out: the value in degrees or millimetres, and its bounds.
struct RangeCase {
  std::string text;
  std::function<double(const VectorXd& q, const VectorXd& c)> value;
  double lower = -kInfinity;
  double upper = kInfinity;
  std::size_t sums = 0;
};

void expect_means(const RangeCase& range, const Robot& robot, const JointConvention* convention) {
  const Cell cell = cell_of({.joint_ranges = {range.text}}, robot, convention);
  ASSERT_EQ(cell.sums.size(), range.sums) << range.text;
  if (range.sums > 0) {
    EXPECT_EQ(cell.sums[0].name, range.text.substr(0, range.text.find('=')));
  }
  const JointRanges limits = limits_of(robot.joints);
  Random random(5);
  int inside = 0;
  constexpr int kTrials = 400;
  for (int trial = 0; trial < kTrials; ++trial) {
    const VectorXd q = random_configurations(robot.joints, limits, 1, random);
    const VectorXd c =
        convention == nullptr ? q : VectorXd(convention->matrix.partialPivLu().solve(q - convention->offset));
    const double value = range.value(q, c);
    const bool expected = value >= range.lower && value <= range.upper;
    ASSERT_EQ(holds(cell, q), expected) << range.text << " at " << value;
    inside += expected ? 1 : 0;
  }
  EXPECT_TRUE(inside > kTrials / 20 && inside < kTrials) << range.text << " should hold at times, holds " << inside;
}

double deg(double radians) { return radians / kDegree; }
double mm(double metres) { return metres * 1e3; }

TEST(CellOptions, JointRangesAreOfTheUrdfsJointsAndTheirSums) {
  const Robot robot = parse_robot(kOddArm);
  for (const RangeCase& range : std::vector<RangeCase>{
           {"turn=-20:70", [](auto&q, auto&) { return deg(q[0]); }, -20.0, 70.0},
           {"slide=-100:250", [](auto&q, auto&) { return mm(q[1]); }, -100.0, 250.0},
           {"elbow=:15", [](auto&q, auto&) { return deg(q[3]); }, -kInfinity, 15.0},
           {"wrist=-40:", [](auto&q, auto&) { return deg(q[4]); }, -40.0},
           {"-wrist=-40:10", [](auto&q, auto&) { return deg(-q[4]); }, -40.0, 10.0},
           {"turn+elbow=-50:60", [](auto&q, auto&) { return deg(q[0] + q[3]); }, -50.0, 60.0, 1},
           {"turn-elbow+wrist=-50:90", [](auto&q, auto&) { return deg(q[0] - q[3] + q[4]); }, -50.0, 90.0, 1},
           {"elbow+elbow=-50:60", [](auto&q, auto&) { return deg(2.0 * q[3]); }, -50.0, 60.0},
       }) {
    expect_means(range, robot, nullptr);
  }
}

TEST(CellOptions, JointRangesAreOfTheControllersJointsBehindAConvention) {
  const Robot robot = parse_robot(kOddArm);
  const JointConvention convention = matched_convention(parse_joint_convention(kOddArmCoupled), joint_names(robot));
  for (const RangeCase& range : std::vector<RangeCase>{
           {"S=-100:250", [](auto&, auto&c) { return mm(c[0]); }, -100.0, 250.0},
           {"A1=-20:70", [](auto&, auto&c) { return deg(c[1]); }, -20.0, 70.0},
           {"A4=-20:30", [](auto&, auto&c) { return deg(c[4]); }, -20.0, 30.0},
           {"A2=-20:130", [](auto&, auto&c) { return deg(c[2]); }, -20.0, 130.0, 1},
           {"A3=-90:90", [](auto&, auto&c) { return deg(c[3]); }, -90.0, 90.0, 1},
           {"A2-A3=-50:40", [](auto&, auto&c) { return deg(c[2] - c[3]); }, -50.0, 40.0},  // the elbow alone
           {"A1+elbow=-50:60", [](auto&q, auto&c) { return deg(c[1] + q[3]); }, -50.0, 60.0, 1},
           {"elbow=-50:60", [](auto&q, auto&) { return deg(q[3]); }, -50.0, 60.0},
       }) {
    expect_means(range, robot, &convention);
  }
}

TEST(CellOptions, PlacesAreTurnedIntoTheBase) {
  Eigen::Isometry3d X_BW = Eigen::Isometry3d::Identity();
  X_BW.linear() << 0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0;  // x along the base's y
  X_BW.translation() = Vector3d(0.1, 0.2, 0.7);
  const Robot robot = parse_robot(kOddArm);
  const auto in_world = [&](const Eigen::Isometry3d& frame) {
    return cli::cell({.box = "1,2,3,4,5,6",
                      .least_height = 0.5,
                      .out_spheres = {"1,2,3,0.5"},
                      .out_boxes = {"-1,-2,-3,1,2,4"},
                      .arm_radius = 0.1,
                      .tracker = "3,1,0"},
                     robot, {}, nullptr, frame);
  };
  const Cell cell = in_world(X_BW);
  EXPECT_EQ(cell.box.lower, Vector3d(0.1 - 5.0, 0.2 + 1.0, 0.7 + 3.0));
  EXPECT_EQ(cell.box.upper, Vector3d(0.1 - 2.0, 0.2 + 4.0, 0.7 + 6.0));
  EXPECT_EQ(cell.out_boxes.at(0).lower, Vector3d(0.1 - 2.0, 0.2 - 1.0, 0.7 - 3.0));
  EXPECT_EQ(cell.out_boxes.at(0).upper, Vector3d(0.1 + 2.0, 0.2 + 1.0, 0.7 + 4.0));
  EXPECT_EQ(cell.out_spheres.at(0).center, Vector3d(0.1 - 2.0, 0.2 + 1.0, 0.7 + 3.0));
  EXPECT_EQ(cell.tracker->position, Vector3d(0.1 - 1.0, 0.2 + 3.0, 0.7));
  EXPECT_DOUBLE_EQ(*cell.height, 1.2);
  EXPECT_REFUSED("--frame: the controller's world is turned against the base by more than right angles",
                 in_world(X_BW * Eigen::AngleAxisd(0.1, Vector3d::UnitZ())));
  EXPECT_REFUSED("--frame", in_world(X_BW * Eigen::AngleAxisd(kDegree * 90.0, Vector3d::UnitX())));
}

TEST(CellOptions, AFollowersRangeIsThatOfItsLeader) {
  const Robot robot =
      parse_robot(urdf::with_mimic(kOddArm, "wrist", R"(joint="elbow" multiplier="-0.5" offset="0.1")"));
  expect_means({"wrist=-20:30", [](auto& q, auto&) { return deg(q[4]); }, -20.0, 30.0}, robot, nullptr);
  expect_means({"elbow-wrist=-20:60", [](auto& q, auto&) { return deg(q[3] - q[4]); }, -20.0, 60.0}, robot, nullptr);
  const JointConvention convention{.name = "c",
                                   .controller_joints = {"T", "S", "K", "E"},
                                   .urdf_joints = {"turn", "slide", "skew", "elbow"},
                                   .matrix = Eigen::Vector4d(1.0, 1.0, 1.0, -1.0).asDiagonal(),
                                   .offset = Eigen::Vector4d(0.0, 0.0, 0.0, 0.2)};
  const Cell cell = cell_of({.joint_ranges = {"E=-30:40"}}, robot, &convention);
  EXPECT_NEAR(cell.ranges[3].first, 0.2 - 40.0 * kDegree, 1e-15);
  EXPECT_NEAR(cell.ranges[3].second, 0.2 + 30.0 * kDegree, 1e-15);
}

TEST(CellOptions, TheLongestNameStandsAndRangesOfOneJointNarrowEachOther) {
  const Robot robot = parse_robot(kNamesakes);
  const Cell cell = cell_of({.joint_ranges = {"j11=-10:20", "j1=5:50", "j11=-30:15", "j1+j11=-40:40"}}, robot);
  EXPECT_NEAR(cell.ranges[0].first, 5.0 * kDegree, 1e-15);
  EXPECT_NEAR(cell.ranges[0].second, 50.0 * kDegree, 1e-15);
  EXPECT_NEAR(cell.ranges[1].first, -10.0 * kDegree, 1e-15);
  EXPECT_NEAR(cell.ranges[1].second, 15.0 * kDegree, 1e-15);
  ASSERT_EQ(cell.sums.size(), 1U);
  EXPECT_EQ(cell.sums[0].name, "j1+j11");
  EXPECT_EQ(cell.sums[0].weights, Eigen::Vector2d(1.0, 1.0));
  EXPECT_NEAR(cell.sums[0].lower, -40.0 * kDegree, 1e-15);
  EXPECT_NEAR(cell.sums[0].upper, 40.0 * kDegree, 1e-15);
  // A range of one value is one.
  EXPECT_EQ(cell_of({.joint_ranges = {"j1=30:30"}}, robot).ranges[0].first, 30.0 * kDegree);
}

TEST(CellOptions, RangesThatAreNoneAreRefusedWithWhatWasExpected) {
  const Robot robot = parse_robot(kOddArm);
  const std::string range = "NAME=lower:upper in degrees (mm for lengths), NAME a joint or a sum such as turn+wrist";
  const std::string sum = "a sum of angles or of lengths";
  const std::string open = "a range that the joint's limits and the other ranges leave open";
  const std::map<std::string, Words> refused = {
      {range, words_of("turn =1:2 turn=1 turn=a:2 turn=1:b turn=2:1 turn=nan:1 turns=1:2 turn+=1:2 turnelbow=1:2 "
                       "turn*elbow=1:2")},
      {sum, {"turn+slide=1:2", "turn-turn=1:2"}},
      {open, {"elbow=120:130"}}};
  for (const auto& [expected, texts] : refused) {
    for (const std::string& text : texts) {
      EXPECT_EQ(refusal([&] { cell_of({.joint_ranges = {text}}, robot); }),
                "--joint-range: '" + text + "' is out of place, expected " + expected);
    }
  }
  EXPECT_EQ(refusal([&] {
              cell_of({.joint_ranges = {"turn=0:10", "turn=11:20"}}, robot);
            }),
            "--joint-range: 'turn=11:20' is out of place, expected " + open);
}

TEST(CellOptions, EachOptionIsItsPartOfTheCell) {
  const Robot robot = fanuc();
  const cli::FacingTargets targets{.targets = targets_at({{0.1, 0.2, 0.3}}), .facing = {Vector3d(0.0, 1.0, 2.0)}};
  CLI::App app;
  CellArguments arguments;
  cli::add_cell_options(app, arguments);
  std::vector<std::string> words = words_of(
      "--box=1,-2,3,4,5,6.5 --least-height=0.25 --least-radius=0.75 --keep-out-sphere=1,2,3,0.5 "
      "--keep-out-sphere=-4,5,-6,0.25 --keep-out-box=0,0,0,1,1,1 --keep-out-box=-1,-2,-3,1,2,3 --clearance=0.0625 "
      "--arm-radius=0.125 --tool-radius=0.03 --tracker=7,-8,9 --distance-range=1.5:6 --acceptance-angle=30 "
      "--joint-range=joint_1=-10:20 --joint-range=joint_2+joint_3=-30:40");
  std::reverse(words.begin(), words.end());  // as CLI11 wants them
  app.parse(words);
  const Cell cell = cell_of(arguments, robot, nullptr, targets);
  EXPECT_NEAR(cell.ranges[0].second, 20.0 * kDegree, 1e-15);
  ASSERT_EQ(cell.sums.size(), 1U);
  EXPECT_NEAR(cell.sums[0].upper, 40.0 * kDegree, 1e-15);
  EXPECT_EQ(cell.box.lower, Vector3d(1.0, -2.0, 3.0));
  EXPECT_EQ(cell.box.upper, Vector3d(4.0, 5.0, 6.5));
  EXPECT_EQ(cell.height, 0.25);
  EXPECT_EQ(cell.radius, 0.75);
  ASSERT_EQ(cell.out_spheres.size(), 2U);
  EXPECT_EQ(cell.out_spheres[0].center, Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(cell.out_spheres[0].radius, 0.5);
  EXPECT_EQ(cell.out_spheres[1].center, Vector3d(-4.0, 5.0, -6.0));
  EXPECT_EQ(cell.out_spheres[1].radius, 0.25);
  ASSERT_EQ(cell.out_boxes.size(), 2U);
  EXPECT_EQ(cell.out_boxes[0].upper, Vector3d(1.0, 1.0, 1.0));
  EXPECT_EQ(cell.out_boxes[1].lower, Vector3d(-1.0, -2.0, -3.0));
  EXPECT_EQ(cell.out_boxes[1].upper, Vector3d(1.0, 2.0, 3.0));
  EXPECT_EQ(cell.clearance, 0.0625);
  ASSERT_EQ(cell.body.size(), robot.chain.getNrOfSegments() + 1);
  for (std::size_t i = 0; i + 1 < cell.body.size(); ++i) {
    EXPECT_EQ(cell.body[i].radius, 0.125) << i;
    EXPECT_FALSE(cell.body[i].tool) << i;
  }
  EXPECT_TRUE(cell.body.back().tool);
  EXPECT_EQ(cell.body.back().radius, 0.03);
  EXPECT_EQ(cell.body.back().b, Vector3d(0.1, 0.2, 0.3));
  ASSERT_TRUE(cell.tracker);
  EXPECT_EQ(cell.tracker->position, Vector3d(7.0, -8.0, 9.0));
  EXPECT_EQ(cell.tracker->least_distance, 1.5);
  EXPECT_EQ(cell.tracker->greatest_distance, 6.0);
  EXPECT_DOUBLE_EQ(cell.tracker->acceptance, 30.0 * kDegree);
  EXPECT_THAT(cell.facing, ElementsAre(Vector3d(0.0, 1.0, 2.0)));

  const Cell open = cell_of({}, robot);
  EXPECT_EQ(open.ranges, limits_of(robot.joints));
  EXPECT_THAT(open.sums, IsEmpty());
  EXPECT_EQ(open.box.lower, Vector3d::Constant(-kInfinity));
  EXPECT_FALSE(open.height || open.radius || open.clearance || open.tracker);
  const Tracker seen = *cell_of({.arm_radius = 0.1, .tracker = "1,2,3", .distance_range = ":5"}, robot).tracker;
  EXPECT_EQ(seen.least_distance, 0.0);
  EXPECT_EQ(seen.greatest_distance, 5.0);
  EXPECT_EQ(seen.acceptance, Tracker{}.acceptance);
}

TEST(CellOptions, TheBodyCountsWhereAnythingIsKeptClearOfIt) {
  const Robot robot = fanuc();
  EXPECT_THAT(cell_of({.box = "0,0,0,1,1,1", .least_height = 0.1, .least_radius = 0.1}, robot).body, IsEmpty());
  const std::size_t shapes = body_from_urdf(robot).capsules.size();
  ASSERT_NE(shapes, robot.chain.getNrOfSegments());
  const cli::FacingTargets targets{.targets = targets_at({{0.1, 0.0, 0.0}, {0.2, 0.0, 0.0}}), .facing = {}};
  const auto parts = [&](const CellArguments& arguments) {
    return cell_of(arguments, robot, nullptr, targets).body.size();
  };
  EXPECT_EQ(parts({.clearance = 0.1}), shapes + 2);
  EXPECT_EQ(parts({.tracker = "1,2,3"}), shapes + 2);
  EXPECT_EQ(parts({.out_spheres = {"1,2,3,1"}}), shapes + 2);
  EXPECT_EQ(parts({.out_boxes = {"1,2,3,1,2,3"}}), shapes + 2);
  EXPECT_EQ(parts({.arm_radius = 0.1}), robot.chain.getNrOfSegments() + 2);
}

TEST(CellOptions, LinksWithoutAShapeAreNamedButForTheTip) {
  const Robot robot = parse_robot(kNamesakes);
  const auto warning = [&](const CellArguments& arguments) { return said_by([&] { cell_of(arguments, robot); }); };
  EXPECT_EQ(warning({.clearance = 0.1}),
            "kdlcal: warning: links without boxes, cylinders or spheres are not kept clear of anything: a, b; "
            "--arm-radius gives all links a shape\n");
  EXPECT_EQ(warning({.clearance = 0.1, .arm_radius = 0.1}), "");
  EXPECT_EQ(warning({.least_height = 0.1}), "");
}

TEST(CellOptions, WhatIsOfTheTrackerNeedsItsPosition) {
  const Robot robot = fanuc();
  const std::string needed = ": needs the tracker's position, expected --tracker x,y,z";
  EXPECT_EQ(refusal([&] { cell_of({.distance_range = "1:2"}, robot); }), "--distance-range" + needed);
  EXPECT_EQ(refusal([&] { cell_of({.acceptance_deg = 30.0}, robot); }), "--acceptance-angle" + needed);
}

TEST(CellOptions, ListsOfNumbersHaveAsManyAsAreExpected) {
  EXPECT_THAT(cli::numbers("--home", "1,-2.5,+3e2", 3, "three"), ElementsAre(1.0, -2.5, 300.0));
  EXPECT_THAT(cli::numbers("--home", "7", 1, "one"), ElementsAre(7.0));
  for (const std::string text : {"", "1,2", "1,2,3,4", "1,,3", "1,2,3,", ",1,2", "1;2;3", "1,2,x", "1,2,nan"}) {
    EXPECT_EQ(refusal([&] { cli::numbers("--home", text, 3, "three of them"); }),
              "--home: '" + text + "' is out of place, expected three of them");
  }
  const Robot robot = fanuc();
  const std::string box = "' is out of place, expected xmin,ymin,zmin,xmax,ymax,zmax in metres";
  EXPECT_EQ(refusal([&] { cell_of({.box = "1,1,1,0,2,2"}, robot); }), "--box: '1,1,1,0,2,2" + box);
  EXPECT_EQ(refusal([&] { cell_of({.box = "1,1,1,2,2,0"}, robot); }), "--box: '1,1,1,2,2,0" + box);
  EXPECT_EQ(refusal([&] { cell_of({.out_boxes = {"1,2"}}, robot); }), "--keep-out-box: '1,2" + box);
  for (const std::string text : {"1,2,3", "1,2,3,-0.1"}) {
    EXPECT_EQ(
        refusal([&] { cell_of({.out_spheres = {text}}, robot); }),
        "--keep-out-sphere: '" + text + "' is out of place, expected x,y,z,radius in metres, the radius 0 or more");
  }
  EXPECT_EQ(refusal([&] { cell_of({.arm_radius = 0.1, .tracker = "1,2"}, robot); }),
            "--tracker: '1,2' is out of place, expected x,y,z in metres");
  EXPECT_EQ(refusal([&] { cell_of({.arm_radius = 0.1, .tracker = "1,2,3", .distance_range = "5:1"}, robot); }),
            "--distance-range: '5:1' is out of place, expected least:greatest in metres");
}

TEST(CellOptions, TargetsMayFaceADirection) {
  const auto read = [](const std::string& facing) {
    return cli::facing_targets_of(
        cli::json_of(R"({"targets": [{"name": "A", "position": [1, 2, 3]}, {"name": "B", "position": [4, 5, 6])" +
                         facing + "}]}",
                     "t.json"),
        "t.json");
  };
  EXPECT_THAT(read("").facing, ElementsAre(Vector3d::Zero(), Vector3d::Zero()));
  const cli::FacingTargets targets = read(R"(, "facing": [0.5, -1, 2])");
  ASSERT_EQ(targets.targets.size(), 2U);
  EXPECT_EQ(targets.targets[1].name, "B");
  EXPECT_EQ(targets.targets[1].X_FT.translation(), Vector3d(4.0, 5.0, 6.0));
  EXPECT_THAT(targets.facing, ElementsAre(Vector3d::Zero(), Vector3d(0.5, -1.0, 2.0)));
  for (const char* wrong : {"[0, 0, 0]", "[1, 2]", "[1, 2, 3, 4]", "[1, 2, \"3\"]", "5", "null", "{\"x\": 1}"}) {
    EXPECT_EQ(refusal([&] { read(std::string(", \"facing\": ") + wrong); }),
              "t.json: targets[1]: facing: expected three numbers that are not all zero")
        << wrong;
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::cell_options_test
