#include "robot/dh_table.hpp"

#include <fmt/core.h>
#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <cmath>
#include <fstream>
#include <sstream>

#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::dh_table_test {
namespace {

using ::testing::HasSubstr;
using testing::kDegree;

/// a [mm], alpha [deg], d [mm], theta [deg], and whether the joint slides.
struct Line {
  double a = 0.0, alpha = 0.0, d = 0.0, theta = 0.0;
  bool slides = false;
};

struct Published {
  std::string name;
  DhConvention convention;
  std::vector<Line> lines;

  /// Of numbers and, behind those of a joint that slides, an s.
  Published(const std::string& of, DhConvention by, const std::string& table) : name(of), convention(by) {
    std::istringstream rows(table);
    for (std::string row; std::getline(rows, row, ',');) {
      std::istringstream numbers(row);
      Line& line = lines.emplace_back();
      numbers >> line.a >> line.alpha >> line.d >> line.theta;
      line.slides = row.back() == 's';
    }
  }
};

/// The makers' and textbooks' tables.
std::vector<Published> published_tables() {
  using enum DhConvention;
  return {{"UR5", standard, "0 90 89.159 0,-425 0 0 0,-392.25 0 0 0,0 90 109.15 0,0 -90 94.65 0,0 0 82.3 0"},
          {"UR10", standard, "0 90 127.3 0,-612 0 0 0,-572.3 0 0 0,0 90 163.941 0,0 -90 115.7 0,0 0 92.2 0"},
          {"Puma560", standard, "0 90 0 0,431.8 0 0 0,20.3 -90 150.05 0,0 90 431.8 0,0 -90 0 0,0 0 0 0"},
          {"Puma560OfCraig", modified, "0 0 0 0,0 -90 0 0,431.8 0 150.05 0,20.3 -90 431.8 0,0 90 0 0,0 -90 0 0"},
          {"StanfordArm", standard, "0 -90 412 0,0 90 154 0,0 0 0 -90 s,0 -90 0 0,0 90 0 0,0 0 263 0"},
          {"Panda", modified, "0 0 333 0,0 -90 0 0,0 90 316 0,82.5 90 0 0,-82.5 -90 384 0,0 90 0 0,88 90 0 0"}};
}

/// The matrix as Denavit and Hartenberg (1955) and Craig (1986, equation 3.6) print it.
Eigen::Matrix4d printed_matrix(DhConvention convention, double a, double alpha, double d, double theta) {
  const double c = std::cos(theta);
  const double s = std::sin(theta);
  const double ca = std::cos(alpha);
  const double sa = std::sin(alpha);
  Eigen::Matrix4d A;
  if (convention == DhConvention::standard) {
    A << c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s, 0, sa, ca, d, 0, 0, 0, 1;
  } else {
    A << c, -s, 0, a, s * ca, c * ca, -sa, -sa * d, s * sa, c * sa, ca, ca * d, 0, 0, 0, 1;
  }
  return A;
}

Eigen::Matrix4d matrix_of(const KDL::Frame& frame) { return to_eigen(frame).matrix(); }

Eigen::Matrix4d printed_product(const Published& table, const Eigen::VectorXd& q) {
  Eigen::Matrix4d product = Eigen::Matrix4d::Identity();
  for (std::size_t i = 0; i < table.lines.size(); ++i) {
    const Line& line = table.lines[i];
    const double value = q[static_cast<Eigen::Index>(i)];
    product *=
        printed_matrix(table.convention, line.a / 1000, line.alpha * kDegree,
                       line.d / 1000 + (line.slides ? value : 0.0), line.theta * kDegree + (line.slides ? 0.0 : value));
  }
  return product;
}

std::string csv_of(const Published& table) {
  std::string csv = fmt::format("convention,{}\njoint,type,a[mm],alpha[deg],d[mm],theta[deg]\n",
                                table.convention == DhConvention::standard ? "standard" : "modified");
  int number = 0;
  for (const Line& line : table.lines) {
    csv += fmt::format("J{},{},{},{},{},{}\n", ++number, line.slides ? "prismatic" : "", line.a, line.alpha, line.d,
                       line.theta);
  }
  return csv;
}

Robot robot_of(const std::string& text) { return parse_robot(dh_urdf(parse_dh_table(text))); }

TEST(DhTable, IsTheProductOfThePublishedMatrices) {
  for (const Published& table : published_tables()) {
    const std::string csv = csv_of(table);
    const Robot robot = robot_of(csv);
    const Robot from_json = robot_of(dh_json(parse_dh_table(csv)));
    const ErrorModel model = complete_model(robot);
    Random random(3);
    for (int i = 0; i < 50; ++i) {
      const Eigen::VectorXd q = testing::random_joints(model, random);
      const Eigen::Matrix4d expected = printed_product(table, q);
      for (const Robot* each : {&robot, &from_json}) {
        const Eigen::Matrix4d found = matrix_of(testing::kdl_pose(each->chain, q));
        EXPECT_LT((found - expected).cwiseAbs().maxCoeff(), 1e-12) << table.name;
      }
    }
    EXPECT_EQ(robot.joints.size(), table.lines.size());
    EXPECT_EQ(robot.base, "base");
    EXPECT_EQ(robot.tip, "tool0");
    EXPECT_FALSE(robot.tip_joint.empty()) << "the errors of the last link need a joint that carries them";
  }
}

// Puma 560 of Craig: the frame of link i is that of row i, as the book draws it.
TEST(DhTable, LinksOfAModifiedTableHaveItsFrames) {
  const Published puma = published_tables()[3];
  const std::string urdf = dh_urdf(parse_dh_table(csv_of(puma)));
  const Eigen::VectorXd q = Eigen::VectorXd::LinSpaced(6, -1.0, 1.0);
  for (int link = 1; link <= 6; ++link) {
    const Robot part = parse_robot(urdf, {.tip = "link_" + std::to_string(link)});
    Published rows = puma;
    rows.lines.resize(static_cast<std::size_t>(link));
    EXPECT_LT((matrix_of(testing::kdl_pose(part.chain, q.head(link))) - printed_product(rows, q)).cwiseAbs().maxCoeff(),
              1e-14)
        << link;
  }
}

constexpr const char* kBent = R"({"convention": "modified", "note": "by hand",
  "base": {"position": [0.1, 0.2, 0.3], "quaternion_wxyz": [0.5, 0.5, -0.5, 0.5]},
  "joints": [{"joint": "lift", "type": "prismatic", "a[mm]": 10, "alpha[rad]": 0.2, "d[m]": 0.4, "theta[deg]": 30,
              "lower[mm]": -100, "upper[mm]": 500},
             {"joint": "turn", "a[m]": 0.5, "alpha[rad]": 0.001, "beta[rad]": -0.002, "d[m]": 0, "theta[rad]": 0,
              "lower[deg]": -90, "upper[deg]": 180}],
  "tip": {"position": [0, 0, 0.1], "quaternion_wxyz": [0.8, 0, 0.6, 0]}})";

TEST(DhTable, HasFramesBetaAndLimits) {
  const DhTable table = parse_dh_table(kBent);
  const Robot robot = robot_of(kBent);
  const Eigen::Vector2d q(0.3, 0.7);
  Eigen::Isometry3d expected = Eigen::Translation3d(0.1, 0.2, 0.3) * Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5);
  using Turn = Eigen::AngleAxisd;
  using Eigen::Vector3d;
  expected = expected * Eigen::Translation3d(0.01, 0, 0) * Turn(0.2, Vector3d::UnitX()) *
             Turn(30 * kDegree, Vector3d::UnitZ()) * Eigen::Translation3d(0, 0, 0.4 + q[0]) *
             Eigen::Translation3d(0.5, 0, 0) * Turn(0.001, Vector3d::UnitX()) * Turn(-0.002, Vector3d::UnitY()) *
             Turn(q[1], Vector3d::UnitZ()) * Eigen::Translation3d(0, 0, 0.1) * Eigen::Quaterniond(0.8, 0, 0.6, 0);
  EXPECT_LT((matrix_of(testing::kdl_pose(robot.chain, q)) - expected.matrix()).cwiseAbs().maxCoeff(), 1e-14);
  EXPECT_EQ(robot.joints[0].type, JointType::prismatic);
  EXPECT_DOUBLE_EQ(*robot.joints[0].lower, -0.1);
  EXPECT_DOUBLE_EQ(*robot.joints[0].upper, 0.5);
  EXPECT_DOUBLE_EQ(*robot.joints[1].lower, -90 * kDegree);
  EXPECT_EQ(robot.joints[1].velocity, std::nullopt);
  EXPECT_EQ(dh_json(parse_dh_table(dh_json(table))), dh_json(table));
  EXPECT_EQ(dh_urdf(parse_dh_table(dh_json(table))), dh_urdf(table));
}

TEST(DhTable, OfTheGuideIsRead) {
  std::ifstream file(std::string(URDF_DIR) + "/README.md");
  std::string table;
  for (std::string line; std::getline(file, line);) {
    if (line.starts_with("    convention,") || (!table.empty() && line.starts_with("    "))) {
      table += line.substr(4) + "\n";
    } else if (!table.empty()) {
      break;
    }
  }
  const DhTable found = parse_dh_table(table);
  const DhTable expected = parse_dh_table(csv_of(published_tables()[3]));
  ASSERT_EQ(found.rows.size(), expected.rows.size());
  for (std::size_t i = 0; i < expected.rows.size(); ++i) {
    for (const auto value : {&DhRow::a, &DhRow::alpha, &DhRow::d, &DhRow::theta}) {
      EXPECT_EQ(found.rows[i].*value, expected.rows[i].*value) << i;
    }
    EXPECT_TRUE(found.rows[i].lower);
  }
  EXPECT_EQ(found.convention, expected.convention);
}

// A result holds the hash of the URDF's text: another text would refuse the results of before.
TEST(DhTable, HasOneUrdf) {
  EXPECT_EQ(dh_urdf(parse_dh_table("convention,modified\njoint,a[m],alpha[rad],d[m],theta[rad],lower[rad],upper[rad]\n"
                                   "\"a<&\"\"\",0,0,0.5,0,-1,1\n\"b\",0.25,0,0,0,,\n")),
            R"(<?xml version="1.0"?>
<robot name="dh_table">
  <link name="base"/>
  <link name="link_1"/>
  <link name="link_2"/>
  <link name="tool0"/>
  <joint name="a&lt;&amp;&quot;" type="revolute">
    <parent link="base"/>
    <child link="link_1"/>
    <origin xyz="0 0 0.5" rpy="0 0 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="0" velocity="0"/>
  </joint>
  <joint name="b" type="continuous">
    <parent link="link_1"/>
    <child link="link_2"/>
    <origin xyz="0.25 0 0" rpy="0 0 0"/>
    <axis xyz="0 0 1"/>
  </joint>
  <joint name="tool0_fixed_joint" type="fixed">
    <parent link="link_2"/>
    <child link="tool0"/>
    <origin xyz="0 0 0" rpy="0 0 0"/>
  </joint>
</robot>
)");
}

TEST(DhTable, IsReadAsSpreadsheetsSaveIt) {
  const std::string plain = csv_of(published_tables()[0]);
  std::string german = plain;
  std::replace(german.begin(), german.end(), ',', ';');
  std::replace(german.begin(), german.end(), '.', ',');
  const std::string excel = "\xef\xbb\xbf# of the manual\r\n" + plain.substr(0, plain.find('\n')) +
                            ",,,,\r\n,,,,,\r\n" + plain.substr(plain.find('\n') + 1);
  const std::string expected = dh_urdf(parse_dh_table(plain));
  EXPECT_EQ(dh_urdf(parse_dh_table(german)), expected);
  EXPECT_EQ(dh_urdf(parse_dh_table(excel)), expected);
}

TEST(DhTable, MayHaveLongOffsetsThatCancelAndLimitsOfTurns) {
  const Robot robot = robot_of(
      "convention,standard\njoint,a[m],alpha[rad],d[m],theta[rad],lower[rad],upper[rad]\n"
      "J,-0.6,3.1416,300,6.2,-9,9\nK,-0.5,0,299.9,0,,\n");
  EXPECT_EQ(robot.joints[0].upper, 9.0);
}

TEST(DhTable, RefusesWhatItCannotRead) {
  const std::string header =
      "convention,standard\njoint,type,a[mm],alpha[deg],d[mm],theta[deg],lower[deg],upper[deg]\n";
  const auto json = [](const std::string& row, const std::string& more = "") {
    return R"({"convention": "standard", "joints": [{)" + row + "}]" + more + "}";
  };
  const std::string numbers = R"("a[m]": 0, "alpha[rad]": 0, "d[m]": 0, "theta[rad]": 0)";
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"", "DH table: ends early: expected the line convention,standard or convention,modified"},
      {"joint,a[mm]\n", "DH table:1: states no convention: expected the line convention,standard"},
      {"convention,classic\n", "DH table:1: convention: 'classic' is unknown, expected standard or modified"},
      {"convention,standard\n", "ends early: expected a header"},
      {header, "has no rows"},
      {header + "J1,,1,2,3,4,,\nJ1,,1,2,3,4,,\n", "joint name 'J1' is taken"},
      {header + "tool0_fixed_joint,,1,2,3,4,,\n", "'tool0_fixed_joint' is taken"},
      {header + "J1,,1,2,,4,,\n", "DH table:3: no d, expected a number; 0 where there is none"},
      {header + "J1,,1,2,x,4,,\n", "DH table:3: d[mm]: 'x' is no number"},
      {header + "J1,,1,2,1e300,4,,\n", "1e12"},
      {header + "J1,,1,2,3,4,5,,6\n", "in a column without a name"},
      {header + "J1,,1,2,3,4,-5,\n", "DH table:3: one limit alone"},
      {header + "J1,,1,2,3,4,5,-5\n", "lower limit"},
      {header + "J1,screw,1,2,3,4,,\n", "type: 'screw' is unknown, expected revolute or prismatic"},
      {header + "J1,prismatic,1,2,3,4,5,6\n", "lower[deg]: unit 'deg' is not accepted, expected lower[mm] or [m]"},
      {header + ",,1,2,3,4,,\n", "joint"},
      {"convention,standard\njoint,a,alpha[deg],d[mm],theta[deg]\nJ,1,2,3,4\n",
       "a: has no unit, expected a[mm] or [m]"},
      {"convention,standard\njoint,a[in],alpha[deg],d[mm],theta[deg]\nJ,1,2,3,4\n", "unit 'in' is not accepted"},
      {"convention,standard\njoint,a[mm],alpha[mm],d[mm],theta[deg]\nJ,1,2,3,4\n", "expected alpha[deg] or [rad]"},
      {"convention,standard\njoint,a[mm],alpha[rad],d[mm],theta[rad]\nJ,1,90,3,0\n",
       "DH table:3: alpha[rad]: 90 rad is more than a turn: degrees? write alpha[deg]"},
      {"convention,standard\njoint,a[m],alpha[deg],d[m],theta[deg]\nJ,-243.65,90,0,0\n",
       "DH table:3: a[m]: -243.65 m is longer than any robot: millimetres? write a[mm]"},
      {"convention,standard\njoint,a[m],alpha[deg],d[m],theta[deg]\nJ,0,90,151.9,0\nK,0,0,81.9,0\n",
       "the last frame is 172.6 m from the first at joint values of 0.0, farther than that of any robot; d of joint "
       "'J' "
       "is 151.9 m: millimetres? write d[mm]"},
      {"convention,standard\njoint,a[mm],alpha[deg],d[m],theta[deg]\nJ,0,90,30,0\nK,0,90,0,0\nL,0,0,30,0\n",
       "at joint values of 1.0, farther than that of any robot; d of joint 'J' is 30 m"},
      {"convention,standard\njoint,a[m],alpha[deg],d[m],theta[deg]\nJ,21,90,0,0\n",
       "DH table:3: a[m]: 21 m is longer than any robot: millimetres? write a[mm]"},
      {"convention,standard\njoint,a[mm],a[mm]\n", "column 'a[mm]' is there twice"},
      {"convention,standard\njoint,a[mm],a[m],alpha[deg],d[mm],theta[deg]\nJ,1,1,2,3,4\n", "a is there twice"},
      {"convention,standard\njoint,r[mm]\nJ,1\n", "unknown column 'r[mm]', expected joint, type, a, alpha"},
      {"{}", "convention"},
      {R"({"convention": "standard"})", "joints"},
      {json(numbers), "joint"},
      {json(R"("joint": "J", "a[m]": 0, "alpha[rad]": 0, "d[m]": 0)"), "joints[0]: no theta"},
      {json(R"("joint": "J", "a[m]": true, "alpha[rad]": 0, "d[m]": 0)"), "joints[0]: a[m]: expected a finite number"},
      {json(R"("joint": "J", )" + numbers, R"(, "Base": {})"), "unknown key 'Base'"},
      {json(R"("joint": "J", )" + numbers, R"(, "base": {"position": [0, 0, 0], "quaternion_wxyz": [1, 1, 0, 0]})"),
       "base: quaternion_wxyz: expected a quaternion of norm 1"},
  };
  for (const auto& [text, words] : cases) {
    const std::string message = testing::refusal([&text = text] { robot_of(text); });
    EXPECT_THAT(message, HasSubstr(words)) << text;
  }
}

// Two nearly parallel axes of a calibrated arm, as Universal Robots state them: their d cancel.
TEST(DhTable, TakesLargeOffsetsThatCancel) {
  const Robot robot = robot_of(
      "convention,standard\njoint,a[m],alpha[rad],d[m],theta[rad]\nJ,0,1.5707963,0.089,0\nK,-0.425,0.0005,232.1,0\n"
      "L,-0.392,-0.0005,-232.1,0\nM,0,1.5707963,0.109,0\n");
  EXPECT_EQ(robot.joints.size(), 4U);
}

}  // namespace
}  // namespace kdl_calibration::dh_table_test
