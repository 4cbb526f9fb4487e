#include <gmock/gmock.h>

#include <fmt/core.h>
#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <kdl/chainiksolverpos_lma.hpp>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "programs/compensation_support.hpp"
#include "programs/krl_program.hpp"
#include "programs/program_language.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::krl_compensation_test {
namespace {

using Eigen::AngleAxisd;
using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::IsSupersetOf;
using testing::kDegree;
using ::testing::SizeIs;

// A KR 6 R900 as ROS-Industrial describes it: axes 1, 4 and 6 turn as the controller counts.
const Robot& kr6() {
  static const Robot robot = [] {
    const auto joint = [](int number, const char* origin, const char* axis, double lower, double upper) {
      return fmt::format(R"(<link name="link_{0}"/><joint name="joint_a{0}" type="revolute"><parent link="link_{1}"/>
        <child link="link_{0}"/><origin xyz="{2}"/><axis xyz="{3}"/>
        <limit lower="{4}" upper="{5}" effort="1" velocity="1"/></joint>)",
                         number, number - 1, origin, axis, lower * kDegree, upper * kDegree);
    };
    return parse_robot(R"(<robot name="kr6"><link name="link_0"/><link name="base"/><link name="tool0"/>
        <joint name="to_base" type="fixed"><parent link="link_0"/><child link="base"/></joint>)" +
                           joint(1, "0 0 0.4", "0 0 -1", -170, 170) + joint(2, "0.025 0 0", "0 1 0", -190, 45) +
                           joint(3, "0.455 0 0", "0 1 0", -120, 156) + joint(4, "0 0 0.035", "-1 0 0", -185, 185) +
                           joint(5, "0.42 0 0", "0 1 0", -120, 120) + joint(6, "0.08 0 0", "-1 0 0", -350, 350) +
                           R"(<joint name="to_tool0" type="fixed"><parent link="link_6"/><child link="tool0"/>
        <origin rpy="0 1.5707963267948966 0"/></joint></robot>)",
                       {.base = "link_0", .tip = "tool0"}, "kr6.urdf");
  }();
  return robot;
}

Isometry3d nominal(const VectorXd& q) { return to_eigen(testing::kdl_pose(kr6().chain, q)); }

Calibration bent(double size, std::uint64_t seed = 5) { return testing::bent(kr6(), size, seed); }

CompensatedProgram compensated(const Calibration& found, const std::vector<ProgramText>& texts,
                               const ProgramFrames& frames = {}) {
  Controller controller = controller_of_links(kr6());
  controller.frames = frames;
  return testing::compensated(kr6(), Compensator(found), controller, texts);
}

VectorXd six(double a, double b, double c, double d, double e, double f) {
  return (VectorXd(6) << a, b, c, d, e, f).finished() * kDegree;
}

// {X, Y, Z [mm], A, B, C [deg]} of a frame: Rz(A) Ry(B) Rx(C), written out.
std::array<double, 6> numbers_of(const Isometry3d& frame) {
  const Eigen::Matrix3d& r = frame.linear();
  return {1e3 * frame.translation().x(),
          1e3 * frame.translation().y(),
          1e3 * frame.translation().z(),
          std::atan2(r(1, 0), r(0, 0)) / kDegree,
          std::atan2(-r(2, 0), std::hypot(r(2, 1), r(2, 2))) / kDegree,
          std::atan2(r(2, 1), r(2, 2)) / kDegree};
}

std::string pose_text(const Isometry3d& frame, const std::string& separator = ",") {
  constexpr std::array kNames = {"X", "Y", "Z", "A", "B", "C"};
  const std::array<double, 6> n = numbers_of(frame);
  std::string text;
  for (std::size_t i = 0; i < n.size(); ++i) {
    text += fmt::format("{}{} {:.7f}", i == 0 ? "" : separator, kNames[i], n[i]);
  }
  return text;
}

std::string axes_text(const VectorXd& q) {
  std::string text;
  for (int i = 0; i < 6; ++i) {
    text += fmt::format("{}A{} {:.7f}", i == 0 ? "" : ",", i + 1, q[i] / kDegree);
  }
  return text;
}

// S by the geometry of the arm: the wrist in the plane of axis 1, the forearm against the upper arm, and axis 5.
int status(const VectorXd& q) {
  const double direction = q[1] + q[2];
  const double wrist = 0.025 + 0.455 * std::cos(q[1]) + 0.42 * std::cos(direction) + 0.035 * std::sin(direction);
  const double stretched = std::atan2(0.035, 0.42);
  return (wrist < 0.0 ? 1 : 0) + (q[2] > stretched ? 2 : 0) + (q[4] < 0.0 ? 4 : 0);
}

int turn(const VectorXd& q) {
  int result = 0;
  for (int i = 0; i < 6; ++i) {
    result += q[i] < 0.0 ? 1 << i : 0;
  }
  return result;
}

std::string status_text(const VectorXd& q) { return fmt::format(",S {},T {}", status(q), turn(q)); }

Isometry3d frame_of(const std::vector<double>& n) {
  return Eigen::Translation3d(1e-3 * Vector3d(n[0], n[1], n[2])) * AngleAxisd(n[3] * kDegree, Vector3d::UnitZ()) *
         AngleAxisd(n[4] * kDegree, Vector3d::UnitY()) * AngleAxisd(n[5] * kDegree, Vector3d::UnitX());
}

std::vector<double> values_of(const ProgramPoint& point) {
  std::vector<double> values;
  for (const NumberField& field : point.fields) {
    values.push_back(field.value);
  }
  return values;
}

// The joint values that the controller drives to for a flange pose next to `q`.
VectorXd driven(const Isometry3d& flange, const VectorXd& q) {
  KDL::ChainIkSolverPos_LMA ik(kr6().chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-12);
  KDL::JntArray seed(6);
  seed.data = q;
  KDL::JntArray result(6);
  EXPECT_GE(ik.CartToJnt(seed, to_kdl(flange), result), 0);
  return result.data;
}

// [m] of the calibrated flange at these joint values from the nominal one at `asked`.
double miss(const Calibration& found, const VectorXd& commanded, const VectorXd& asked) {
  return (to_eigen(testing::kdl_pose(found.urdf_chain(), commanded)).translation() - nominal(asked).translation())
      .norm();
}

double distance_of_turn(const Calibration& found, const VectorXd& commanded, const VectorXd& asked) {
  const Isometry3d reached = to_eigen(testing::kdl_pose(found.urdf_chain(), commanded));
  return AngleAxisd(reached.linear().transpose() * nominal(asked).linear()).angle();
}

const VectorXd kHome = six(0, -90, 90, 0, 0, 0);
const VectorXd kAsked = six(25, -70, 95, 40, 35, -60);

// What a controller shows at home: A 0, B 90, C 0, S 2, T 2.
TEST(KrlCompensation, HasThePosesAndWordsOfTheController) {
  const std::array<double, 6> home = numbers_of(nominal(kHome));
  EXPECT_NEAR(home[0], 25 + 420 + 80, 1e-9);
  EXPECT_NEAR(home[2], 400 + 455 + 35, 1e-9);
  EXPECT_LT((nominal(kHome).linear() - AngleAxisd(90 * kDegree, Vector3d::UnitY()).toRotationMatrix()).norm(), 1e-12);
  EXPECT_EQ(status(kHome), 2);
  EXPECT_EQ(turn(kHome), 2);
}

struct Notation {
  const char* name;
  bool is_joints;
  std::vector<ProgramText> (*texts)(const VectorXd& q, const Isometry3d& base, const Isometry3d& tool);
};

Isometry3d programmed(const VectorXd& q, const Isometry3d& base, const Isometry3d& tool) {
  return base.inverse() * nominal(q) * tool;
}

std::string in_routine(const std::string& lines) { return "DEF TEST()\nBAS(#INITMOV,0)\n" + lines + "END\n"; }

const std::vector<Notation>& notations() {
  static const std::vector<Notation> all = {
      {"axes in the motion", true,
       [](const VectorXd& q, const Isometry3d&, const Isometry3d&) {
         return std::vector<ProgramText>{{"a.src", in_routine("PTP {E6AXIS: " + axes_text(q) + ",E1 0} C_PTP\n")}};
       }},
      {"axes in the data list", true,
       [](const VectorXd& q, const Isometry3d&, const Isometry3d&) {
         return std::vector<ProgramText>{{"a.src", in_routine("PTP XA\n")},
                                         {"a.dat", "DEFDAT TEST\nE6AXIS XA={" + axes_text(q) + ",E1 0.0}\nENDDAT\n"}};
       }},
      {"pose in the motion", false,
       [](const VectorXd& q, const Isometry3d& base, const Isometry3d& tool) {
         return std::vector<ProgramText>{
             {"a.src",
              in_routine("$TOOL={" + pose_text(tool) + "}\n$BASE={FRAME: " + pose_text(base, ", ") +
                         "}\nPTP {E6POS: " + pose_text(programmed(q, base, tool), ", ") + status_text(q) + "}\n")}};
       }},
      {"pose with binary words", false,
       [](const VectorXd& q, const Isometry3d& base, const Isometry3d& tool) {
         return std::vector<ProgramText>{
             {"a.src", in_routine("TOOL_DATA[7]={" + pose_text(tool) + "}\n$TOOL=TOOL_DATA[7]\n$BASE={" +
                                  pose_text(base) + "}\nPTP {" + pose_text(programmed(q, base, tool)) +
                                  fmt::format(",S 'B{:03b}',T 'B{:06b}'}}\n", status(q), turn(q)))}};
       }},
      {"taught pose", false,
       [](const VectorXd& q, const Isometry3d& base, const Isometry3d& tool) {
         return std::vector<ProgramText>{
             {"a.src", in_routine("FDAT_ACT=FP1\nBAS(#PTP_PARAMS,100)\nPTP XP1 C_DIS\n")},
             {"a.dat", "DEFDAT TEST PUBLIC\r\nDECL E6POS XP1={" + pose_text(programmed(q, base, tool)) +
                           status_text(q) + ",E1 0.0,E2 0.0,E3 0.0,E4 0.0,E5 0.0,E6 0.0}\r\n" +
                           "DECL FDAT FP1={TOOL_NO 3,BASE_NO 4,IPO_FRAME #BASE,POINT2[] \" \",TQ_STATE FALSE}\r\n"
                           "ENDDAT\r\n"}};
       }},
      {"spline", false,
       [](const VectorXd& q, const Isometry3d& base, const Isometry3d& tool) {
         return std::vector<ProgramText>{
             {"a.src", in_routine("SLIN {" + pose_text(programmed(q, base, tool)) + status_text(q) +
                                  "} WITH $VEL=SVEL_CP(2.0, , L1), $TOOL=STOOL(3), $BASE=SBASE(4) C_Spl\n")}};
       }},
      {"straight motion without words", false,
       [](const VectorXd& q, const Isometry3d& base, const Isometry3d& tool) {
         const VectorXd near = q + VectorXd::Constant(6, 0.02);
         return std::vector<ProgramText>{
             {"a.src", in_routine("BAS(#TOOL,3)\nBAS(#BASE,4)\nPTP {" + axes_text(near) + "}\nLIN {" +
                                  pose_text(programmed(q, base, tool)) + "} C_DIS\n")}};
       }},
  };
  return all;
}

VectorXd random_joints(Random& random) {
  const std::array<double, 6> lower = {-165, -185, -115, -180, -115, -345};
  const std::array<double, 6> upper = {165, 40, 150, 180, 115, 345};
  for (;;) {
    VectorXd q(6);
    for (int i = 0; i < 6; ++i) {
      const auto k = static_cast<std::size_t>(i);
      q[i] = (lower[k] + (upper[k] - lower[k]) * random.uniform()) * kDegree;
    }
    const double direction = q[1] + q[2];
    const double wrist = 0.025 + 0.455 * std::cos(q[1]) + 0.42 * std::cos(direction) + 0.035 * std::sin(direction);
    // Away from the singularities, near which a small error moves the joints far.
    if (std::abs(wrist) > 0.15 && std::abs(q[2] - std::atan2(0.035, 0.42)) > 0.4 && std::abs(q[4]) > 0.3) {
      return q;
    }
  }
}

Isometry3d random_frame(Random& random) {
  const auto number = [&](double most) { return most * (2.0 * random.uniform() - 1.0); };
  return frame_of({number(300), number(300), number(300), number(180), number(80), number(180)});
}

// Random points in every notation: at the joint values that the controller finds for what is written, the calibrated
// arm is where the nominal one was asked to be.
TEST(KrlCompensation, BringsTheCalibratedArmWhereTheNominalOneWouldBe) {
  Random random(11);
  int turned = 0;
  for (int i = 0; i < 20; ++i) {
    const Calibration found = bent(1e-3, static_cast<std::uint64_t>(i) + 1);
    const Isometry3d base = random_frame(random);
    const Isometry3d tool = random_frame(random);
    const ProgramFrames frames{.user = {{"4", base}}, .tool = {{"3", tool}}};
    const VectorXd q = random_joints(random);
    for (const Notation& notation : notations()) {
      SCOPED_TRACE(fmt::format("{} {}", notation.name, i));
      const std::vector<ProgramText> texts = notation.texts(q, base, tool);
      const CompensatedProgram result = compensated(found, texts, frames);
      ASSERT_THAT(result.texts, SizeIs(texts.size()));
      ASSERT_TRUE(result.positions.back().written);
      std::vector<ProgramText> written = texts;
      for (std::size_t k = 0; k < texts.size(); ++k) {
        written[k].text = result.texts[k];
      }
      const ProgramPoint point = kuka_krl().parse(written).points.back();
      const std::vector<double> n = values_of(point);
      const VectorXd commanded =
          notation.is_joints ? six(n[0], n[1], n[2], n[3], n[4], n[5]) : driven(base * frame_of(n) * tool.inverse(), q);
      EXPECT_LT((commanded - q).norm(), 0.1);
      EXPECT_LT(miss(found, commanded, q), 1e-7);
      EXPECT_LT(distance_of_turn(found, commanded, q), 1e-6);
      EXPECT_GT(miss(found, q, q), 1e-4);
      if (!point.turn_fields.empty()) {
        EXPECT_EQ(static_cast<int>(point.turn_fields[0].value), turn(commanded));
        turned += turn(commanded) == turn(q) ? 0 : 1;
      }
    }
  }
  EXPECT_EQ(turned, 0) << "none of these stands next to zero";
}

TEST(KrlCompensation, RewritesTurnWhereAnAxisCrossesZero) {
  int rewritten = 0;
  for (std::uint64_t seed = 1; seed < 9; ++seed) {
    const Calibration found = bent(3e-3, seed);
    for (const double sign : {1.0, -1.0}) {
      VectorXd q = kAsked;
      q[3] = sign * 1e-4;
      const std::string line = "PTP {" + pose_text(nominal(q)) + status_text(q) + "}\n";
      const std::vector<ProgramText> texts = {{"a.src", in_routine("BAS(#TOOL,0)\n" + line)}};
      const CompensatedProgram result = compensated(found, texts);
      const ProgramPoint point = kuka_krl().parse({{"a.src", result.texts[0]}}).points.at(0);
      const std::vector<double> n = values_of(point);
      const VectorXd commanded = driven(frame_of(n), q);
      EXPECT_EQ(static_cast<int>(point.turn_fields[0].value), turn(commanded)) << seed;
      EXPECT_LT(miss(found, commanded, q), 1e-7);
      rewritten += turn(commanded) == turn(q) ? 0 : 1;
    }
  }
  EXPECT_GT(rewritten, 4);
  EXPECT_LT(rewritten, 12);
}

bool is_within_limits(const VectorXd& q) {
  for (std::size_t i = 0; i < 6; ++i) {
    const MovingJoint& joint = kr6().joints[i];
    const double value = q[static_cast<Eigen::Index>(i)];
    if (value < *joint.lower || value > *joint.upper) {
      return false;
    }
  }
  return true;
}

TEST(KrlCompensation, TellsTheBranchesOfAPoseApart) {
  const Calibration found = bent(1e-3);
  const Isometry3d pose = nominal(kAsked);
  KDL::ChainIkSolverPos_LMA ik(kr6().chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-12);
  Random random(2);
  std::set<int> branches;
  for (int i = 0; i < 2000; ++i) {
    KDL::JntArray seed(6);
    seed.data = random_joints(random);
    KDL::JntArray q(6);
    if (ik.CartToJnt(seed, to_kdl(pose), q) < 0 || !is_within_limits(q.data) ||
        !branches.insert(status(q.data)).second) {
      continue;
    }
    const CompensatedProgram result = compensated(
        found, {{"a.src", in_routine("BAS(#TOOL,0)\nPTP {" + pose_text(pose) + status_text(q.data) + "}\n")}});
    EXPECT_TRUE(result.positions.at(0).written);
    const ProgramPoint point = kuka_krl().parse({{"a.src", result.texts[0]}}).points.at(0);
    EXPECT_LT(miss(found, driven(frame_of(values_of(point)), q.data), q.data), 1e-7) << status(q.data);
  }
  EXPECT_THAT(branches, IsSupersetOf({2, 6}));
  EXPECT_GE(branches.size(), 4U);
}

TEST(KrlCompensation, KeepsEveryByteWithoutErrors) {
  const std::string src = "&ACCESS RVP\r\n" + in_routine("PTP {" + axes_text(kAsked) + "} ; \xE4\r\nLIN XP1\n");
  const std::string dat = "DEFDAT TEST\nPOS XP1={" + pose_text(nominal(kAsked)) + status_text(kAsked) +
                          ",E1 0.0}\n; LIN\nTOOL_DATA[1]={X 0,Y 0,Z 0,A 0,B 0,C 0}\nENDDAT\n";
  const CompensatedProgram result = compensated(bent(0.0), {{"a.src", src}, {"a.dat", dat}});
  EXPECT_THAT(result.texts, ElementsAre(src, dat));
  EXPECT_THAT(result.positions, SizeIs(2));
  EXPECT_THAT(result.warnings, IsEmpty());
}

TEST(KrlCompensation, NamesFramesThatAreNotKnown) {
  const std::string pose = "{" + pose_text(nominal(kAsked)) + status_text(kAsked) + "}\n";
  const Calibration found = bent(0.0);
  EXPECT_REFUSED("a.src:3: PTP {...} in line 3: $BASE is not stated, expected the frame of the pose",
                 compensated(found, {{"a.src", "DEF A()\nBAS(#TOOL,0)\nPTP " + pose + "END\n"}}));
  EXPECT_REFUSED("a.src:3: PTP {...} in line 3: $TOOL 1 is not known, expected it in --frames",
                 compensated(found, {{"a.src", in_routine("PTP " + pose)}}));
}

TEST(KrlCompensation, IsToldFromTheText) {
  EXPECT_EQ(language_of({.source = "a", .text = "&ACCESS RVP\nDEF a( )\nmovej(x)\nEND\n"}).name, "KUKA KRL");
  EXPECT_EQ(language_of({.source = "a", .text = "def a(x): # (\n  movej(x)\nend\n"}).name, "URScript");
}

}  // namespace
}  // namespace kdl_calibration::krl_compensation_test
