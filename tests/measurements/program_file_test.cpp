#include "measurements/program_file.hpp"

#include <gmock/gmock.h>

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "base/random.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::program_file_test {
namespace {

using Eigen::Index;
using ::testing::HasSubstr;
using testing::kDegree;

const std::string kJoints = "joint_1[deg],joint_2[deg],joint_3[deg],joint_4[deg],joint_5[deg],joint_6[deg]";

class Program : public ::testing::Test {
protected:
  static const Robot& robot() {
    static const Robot fanuc = testing::fanuc();
    return fanuc;
  }

  ProgramFile opened(const std::string& text, FileContent content = FileContent::poses,
                     OrientationReading orientation = OrientationReading::usual) {
    file_ = std::filesystem::temp_directory_path() / ("program_file_test_" + std::to_string(::getpid()) + ".csv");
    std::ofstream(file_, std::ios::binary) << text;
    return {file_, robot(), nullptr, content, orientation};
  }
  ~Program() override { std::filesystem::remove(file_); }

  std::string fault(const std::string& text, FileContent content = FileContent::poses) {
    return testing::refusal([&] {
      ProgramFile file = opened(text, content);
      const std::vector<ProgramLine> lines = file.next(10);
      file.points(lines);
    });
  }

  std::filesystem::path file_;
};

Eigen::Quaterniond near(const Eigen::Quaterniond& q, Random& random, double angle) {
  const Eigen::Vector3d axis(random.normal(), random.normal(), random.normal());
  return q * Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis.normalized()));
}

// Orientations over more than a turn, at the gimbal's lock and as a half turn.
TEST_F(Program, StatesOtherPosesInTheSameFormAsNearAsPossible) {
  const std::vector<std::string> forms = {
      "x[mm],y[mm],z[mm],W[deg],P[deg],R[deg]\n1500,-20,700,179.99,0.01,-170\n1500,-20,700,200,-300,10\n"
      "1500,-20,700,30,90,40\n1500,-20,700,30,-89.9999,400\n1500,-20,700,0,100,0\n",
      "X[mm],Y[mm],Z[mm],A[deg],B[deg],C[deg]\n1500,-20,700,-170,0.01,180\n1500,-20,700,30,90,-40\n",
      "x,y,z,roll,pitch,yaw\n1.5,-0.02,0.7,3.14,-1.2,-3.1\n",
      "x,y,z,rx,ry,rz\n1.5,0,0.7,0,3.1415,0\n1.5,0,0.7,2,-2,3\n1.5,0,0.7,0,0,0\n1.5,0,0.7,0,0,5\n",
      "x,y,z,qw,qx,qy,qz\n1.5,0,0.7,-0.6,0,0.8,0\n1.5,0,0.7,0,0,0,1\n"};
  Random random(1);
  for (const std::string& text : forms) {
    const std::string head = text.substr(0, text.find('\n') + 1);
    ProgramFile file = opened(text);
    const std::vector<ProgramLine> lines = file.next(100);
    const ProgramPoints asked = file.points(lines);
    EXPECT_EQ(file.head(), head);
    ProgramPoints commanded = asked;
    for (Eigen::Isometry3d& pose : commanded.poses) {
      pose.translation() += Eigen::Vector3d(1e-3, -2e-3, 3e-3);
      pose.linear() = near(Eigen::Quaterniond(pose.linear()), random, 1e-3).toRotationMatrix();
    }
    for (const ProgramPoints& points : {asked, commanded}) {
      const std::string written = file.text(lines, points);
      ProgramFile again = opened(head + written);
      const std::vector<ProgramLine> rows = again.next(100);
      const ProgramPoints read = again.points(rows);
      ASSERT_EQ(read.poses.size(), points.poses.size());
      for (std::size_t i = 0; i < read.poses.size(); ++i) {
        EXPECT_LT((read.poses[i].matrix() - points.poses[i].matrix()).cwiseAbs().maxCoeff(), 1e-14) << rows[i].text;
      }
    }
  }
}

std::vector<double> numbers_of(const std::string& line) {
  std::vector<double> numbers;
  std::istringstream cells(line);
  for (std::string cell; std::getline(cells, cell, ',');) {
    numbers.push_back(std::stod(cell));
  }
  return numbers;
}

TEST_F(Program, KeepsTheNumbersOfAnOrientationThatStays) {
  const std::string rows =
      "1,2,3,179.99,0.01,-170\n1,2,3,200,-80,10\n1,2,3,30,90,40\n1,2,3,30,-89.99,400\n1,2,3,0,100,0\n1,2,3,-190,-120,"
      "7\n";
  ProgramFile file = opened("x,y,z,W[deg],P[deg],R[deg]\n" + rows);
  for (const ProgramLine& line : file.next(10)) {
    const std::vector<double> asked = numbers_of(line.text);
    const std::vector<double> written = numbers_of(file.text({&line, 1}, file.points({&line, 1})));
    for (std::size_t i = 0; i < asked.size(); ++i) {
      EXPECT_NEAR(written[i], asked[i], 1e-7) << line.text;
    }
  }
}

// Half turns, a lock of each form, and angles over more than a turn.
TEST_F(Program, StatesOtherPosesInEachReadingAsNearAsPossible) {
  const std::string rows = "1,2,3,180,0,90\n1,2,3,-170,90,20\n1,2,3,30,-89.9999,400\n1,2,3,10,100,-20\n1,2,3,1,2,3\n";
  Random random(2);
  for (const std::string columns : {"rx[deg],ry[deg],rz[deg]", "A[deg],B[deg],C[deg]"}) {
    for (const std::string& word : orientation_words()) {
      const std::string head = "x,y,z," + columns + "\n";
      const auto read = [&](const std::string& text) {
        return opened(head + text, FileContent::poses, orientation_reading(word));
      };
      ProgramFile file = read(rows);
      const std::vector<ProgramLine> lines = file.next(100);
      const ProgramPoints asked = file.points(lines);
      EXPECT_EQ(file.text(lines, asked), rows) << columns << word;
      ProgramPoints commanded = asked;
      for (Eigen::Isometry3d& pose : commanded.poses) {
        pose.linear() = near(Eigen::Quaterniond(pose.linear()), random, 1e-3).toRotationMatrix();
      }
      ProgramFile again = read(file.text(lines, commanded));
      const std::vector<ProgramLine> written = again.next(100);
      const ProgramPoints found = again.points(written);
      for (std::size_t i = 0; i < lines.size(); ++i) {
        EXPECT_LT((found.poses[i].matrix() - commanded.poses[i].matrix()).norm(), 1e-13) << word << written[i].text;
      }
    }
  }
}

// A KUKA at B = 90 degrees: A and C describe the same turn. One below the pendant's last digit leaves them alone.
TEST_F(Program, KeepsTheSplitOfAnglesAtTheLock) {
  ProgramFile file = opened("x,y,z,A[deg],B[deg],C[deg]\n1,2,3,30,90,-40\n");
  const std::vector<ProgramLine> lines = file.next(1);
  ProgramPoints points = file.points(lines);
  points.poses[0].linear() =
      (Eigen::Quaterniond(points.poses[0].linear()) * Eigen::AngleAxisd(4e-7, Eigen::Vector3d(0.6, 0.0, 0.8)))
          .toRotationMatrix();
  std::istringstream cells(file.text(lines, points));
  const std::vector<double> asked = {1, 2, 3, 30, 90, -40};
  for (const double value : asked) {
    std::string cell;
    std::getline(cells, cell, ',');
    EXPECT_NEAR(std::stod(cell), value, 1e-4);
  }
}

TEST_F(Program, RefusesAnglesInDegreesThatMayBeSeveralThings) {
  const std::string text = "x,y,z,Rx[deg],Ry[deg],Rz[deg]\n1,2,3,180,0,90\n";
  EXPECT_THAT(fault(text), HasSubstr(":1: rx, ry, rz in degrees may be a rotation vector or angles: expected "
                                     "--orientation fixed-xyz (Yaskawa, Kinova), moving-xyz"));
  EXPECT_THAT(fault("x,y,z,rx,ry,rz\n,,,rad,rad,deg\n1,2,3,1,0,9\n"), HasSubstr("--orientation"));
  EXPECT_EQ(opened("x,y,z,rx,ry,rz\n1,2,3,1,0,1\n").orientations(), "orientations from rx, ry, rz as rotation-vector");
  EXPECT_EQ(opened(text, FileContent::poses, OrientationReading::fixed_xyz).orientations(),
            "orientations from rx, ry, rz as fixed-xyz");
  EXPECT_EQ(opened("x,y,z,qw,qx,qy,qz\n1,2,3,1,0,0,0\n").orientations(), "");
}

TEST_F(Program, HasPointsThatDoNotDependOnThePieces) {
  std::string text = "configuration;" + kJoints + "\n";
  std::replace(text.begin(), text.end(), ',', ';');
  for (int i = 0; i < 7; ++i) {
    text += "c" + std::to_string(i) + ";" + std::to_string(i) + ",5;10;20;30;40;50\n# a comment\n";
  }
  ProgramFile whole = opened(text, FileContent::configurations);
  const std::vector<ProgramLine> all = whole.next(100);
  ASSERT_EQ(all.size(), 7U);
  EXPECT_GT(whole.share(), 0.4);  // comments are not counted
  EXPECT_LE(whole.share(), 1.0);
  const ProgramPoints points = whole.points(all);
  EXPECT_TRUE(points.poses.empty());
  EXPECT_NEAR(points.joint_values(0, 3), 3.5 * kDegree, 1e-15);
  EXPECT_EQ(whole.label(all[4]), "c4");
  ProgramFile pieces = opened(text, FileContent::configurations);
  Index column = 0;
  std::string written;
  for (std::vector<ProgramLine> lines = pieces.next(3); !lines.empty(); lines = pieces.next(3)) {
    const ProgramPoints some = pieces.points(lines);
    EXPECT_EQ(some.joint_values, points.joint_values.middleCols(column, some.joint_values.cols()));
    column += some.joint_values.cols();
    written += pieces.text(lines, some);
  }
  EXPECT_EQ(column, 7);
  EXPECT_EQ(written, whole.text(all, points));
  EXPECT_THAT(written, HasSubstr("c3;3,5;"));
}

TEST_F(Program, OfPosesMayStateJointValues) {
  ProgramFile without = opened("x,y,z,rx,ry,rz\n1,0,1,0,0,1\n");
  EXPECT_FALSE(without.states_joints());
  ProgramFile with = opened("pose," + kJoints + ",x,y,z,rx,ry,rz\n7,1,2,3,4,5,6,1,0,1,0,0,1\n");
  EXPECT_TRUE(with.states_joints());
  const std::vector<ProgramLine> lines = with.next(1);
  EXPECT_NEAR(with.points(lines).joint_values(5, 0), 6.0 * kDegree, 1e-15);
  EXPECT_EQ(with.label(lines[0]), "7");
}

TEST_F(Program, RefusesWhatIsNoProgram) {
  EXPECT_THAT(fault("x,y,z\n1,2,3\n"), HasSubstr(":1: missing column an orientation: expected x, y, z and"));
  EXPECT_THAT(fault("x,y,rx,ry,rz\n1,2,3,4,5\n"), HasSubstr("missing column z"));
  EXPECT_THAT(fault("x,y,z,rx,ry,rz,joint_1\n1,2,3,4,5,6,7\n"), HasSubstr("missing columns joint_2"));
  EXPECT_THAT(fault("x,y,z,rx,ry,rz\n1,2,3,,,\n"), HasSubstr(":2: the orientation is empty"));
  EXPECT_THAT(fault("x,y,z,rx,ry,rz\n1,,3,1,1,1\n"), HasSubstr(":2: y '' is empty"));
  EXPECT_THAT(fault("x,y,z,rx,ry,rz\n1500,0,700,1,1,1\n"), HasSubstr("millimetres? write x[mm]"));
  EXPECT_THAT(fault("x,y,z,W,P,R\n1,0,1,1,1,1\n"), HasSubstr("write W[deg]"));
  EXPECT_THAT(
      fault("joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n10,20,30,40,50,60\n", FileContent::configurations),
      HasSubstr("degrees? write joint_2[deg]"));
  EXPECT_THAT(fault("joint_1,joint_2\n1,2\n", FileContent::configurations), HasSubstr("missing columns joint_3"));
}

}  // namespace
}  // namespace kdl_calibration::program_file_test
