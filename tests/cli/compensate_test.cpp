// kdlcal compensate: its file, its summary, its options, and what it refuses.

#include <kdl/chainiksolverpos_lma.hpp>

#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "cli/frames.hpp"
#include "cli_options_support.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/result_file.hpp"
#include "printed_text.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::compensate_test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

const std::string kPendant = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json";
const Words kCompensate = {"compensate", "--result", "r.json", "--joints", "p.csv", "--output", "o.csv"};

// A name with a comma, two units, a straight wrist in the last row.
constexpr const char* kProgram =
    "# a program\nconfiguration,joint_1[deg],joint_2[deg],joint_3[rad],joint_4[deg],joint_5[deg],joint_6[deg],target\n"
    "1,10,-20,0.3,40,50,60,\"a, b\"\n2,-10,20,-0.1,-40,-50,-60,b\n3,0,10,0.2,30,0.01,20,c\n";

class Compensate : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    write_calibration();
    write("p.csv", kProgram);
  }

  Calibration calibration() { return load_calibration(directory / "r.json", fanuc()); }
};

TEST_F(Compensate, WritesTheSameColumnsWithTheValuesOfTheLibrary) {
  const Outcome outcome = run(kCompensate + Words{"--json"});
  EXPECT_EQ(outcome.status, 1) << outcome.err;  // the last row is at a straight wrist
  const std::vector<std::string> lines = lines_of(text_of("o.csv"));
  ASSERT_EQ(lines.size(), 5U);
  EXPECT_EQ(lines[0], "# compensated " + sha256(text_of("r.json")));
  EXPECT_EQ(lines[1], lines_of(kProgram)[1]);
  EXPECT_THAT(lines[2], AllOf(StartsWith("1,"), HasSubstr(",\"a, b\"")));
  EXPECT_THAT(lines[4], ::testing::EndsWith(",c"));
  const Measurements asked = read_configurations(fanuc(), directory / "p.csv");
  const Measurements commanded = read_configurations(fanuc(), directory / "o.csv");
  const Compensator compensator(calibration());
  const Json said = Json::parse(outcome.out);
  double largest = 0.0;
  for (Eigen::Index c = 0; c < 3; ++c) {
    const CompensatedPoint point = compensator.solve(asked.joint_values.col(c));
    EXPECT_LT((commanded.joint_values.col(c) - point.joint_values).cwiseAbs().maxCoeff(), 1e-15);
    EXPECT_EQ(point.status, c == 2 ? CompensationStatus::position_only : CompensationStatus::exact);
    largest = std::max(largest, std::abs(point.joint_values[1] - asked.joint_values(1, c)));
  }
  EXPECT_EQ(said["points"], 3);
  EXPECT_EQ(said["status"]["exact"], 2);
  EXPECT_EQ(said["status"]["position_only"], 1);
  EXPECT_EQ(said["largest_change"][1]["joint"], "joint_2");
  EXPECT_NEAR(said["largest_change"][1]["change"].get<double>(), largest, 1e-15);
  ASSERT_EQ(said["not_exact"].size(), 1U);
  EXPECT_EQ(said["not_exact"][0]["configuration"], "3");
  EXPECT_EQ(said["largest_orientation_error"], said["not_exact"][0]["orientation_error"]);
}

TEST_F(Compensate, IsTrustedWhereEveryPointIsExact) {
  write("p.csv", "configuration,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n1,0.1,-0.2,0.3,0.4,0.5,0.6\n");
  const Outcome outcome = run(kCompensate);
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_THAT(outcome.out, AllOf(HasSubstr("exact                          1\n"), HasSubstr("joint_6"),
                                 HasSubstr("at most 0.0000 mm and 0.0000 mrad")));
}

// Degrees of the pendant, with the separator and the decimal mark of a spreadsheet; each column in its own unit.
TEST_F(Compensate, KeepsTheConventionTheSeparatorAndTheDecimalMark) {
  write("p.csv",
        "configuration;J1;J2;J3;J4;J5;J6\n;deg;deg;deg;deg;deg;rad\nA;10;20;-30;40;50;0,5\nB;10;20,5;-30;40;50;1\n");
  const Outcome outcome = run(kCompensate + Words{"--joint-convention", kPendant});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  const std::vector<std::string> lines = lines_of(text_of("o.csv"));
  ASSERT_EQ(lines.size(), 5U);
  EXPECT_EQ(lines[2], ";deg;deg;deg;deg;deg;rad");
  EXPECT_EQ(std::count(lines[3].begin(), lines[3].end(), ','), 6);
  const JointConvention pendant = read_joint_convention(kPendant);
  const Measurements asked = read_configurations(fanuc(), directory / "p.csv", &pendant);
  const Measurements commanded = read_configurations(fanuc(), directory / "o.csv", &pendant);
  const Compensator compensator(calibration());
  Eigen::VectorXd largest = Eigen::VectorXd::Zero(6);  // of the pendant's joints, two of which are coupled
  for (Eigen::Index c = 0; c < 2; ++c) {
    const CompensatedPoint point = compensator.solve(asked.joint_values.col(c));
    EXPECT_LT((commanded.joint_values.col(c) - point.joint_values).cwiseAbs().maxCoeff(), 1e-14);
    largest = largest.cwiseMax((pendant.matrix.inverse() * point.change).cwiseAbs());
  }
  const Json said = Json::parse(run(kCompensate + Words{"--joint-convention", kPendant, "--json", "--force"}).out);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(said["largest_change"][i]["joint"], "J" + std::to_string(i + 1));
    EXPECT_NEAR(said["largest_change"][i]["change"].get<double>(), largest[static_cast<Eigen::Index>(i)], 1e-14);
  }
}

TEST_F(Compensate, LeavesOtherCellsAsTheyAre) {
  write("p.csv",
        "configuration;joint_1;joint_2;joint_3;joint_4;joint_5;joint_6;target;x;y;z\n"
        "A;0,1;0,2;0,3;0,4;0,5;0,6;'=B;-0,25;1,5;-2\n");
  succeed(kCompensate);
  EXPECT_THAT(text_of("o.csv"), ::testing::EndsWith(";'=B;\"-0,25\";\"1,5\";-2\n"));
}

// ---- Poses ---------------------------------------------------------------------------------------------------------

constexpr const char* kPoses = "configuration,X[mm],Y[mm],Z[mm],W[deg],P[deg],R[deg]";
const Words kOfPoses = {"compensate", "--result", "r.json", "--poses", "p.csv", "--output", "o.csv"};

std::string joined(const std::vector<double>& numbers) {
  std::string text;
  for (const double number : numbers) {
    text += "," + shortest(number);
  }
  return text;
}

// As a FANUC states it.
std::string in_wpr(const Eigen::Isometry3d& X) {
  double w = 0.0;
  double p = 0.0;
  double r = 0.0;
  to_kdl(X).M.GetRPY(w, p, r);
  const Eigen::Vector3d mm = 1e3 * X.translation();
  return joined({mm.x(), mm.y(), mm.z(), w / kDegree, p / kDegree, r / kDegree});
}

// The poses in a file of commands.
std::vector<Eigen::Isometry3d> poses_in(const std::string& text) {
  std::vector<Eigen::Isometry3d> poses;
  for (const std::vector<std::string>& cells : cells_of(text)) {
    if (cells.size() >= 7 && cells[0] != "configuration") {
      const auto mm = [&](std::size_t i) { return 1e-3 * std::stod(cells[i]); };
      const auto degrees = [&](std::size_t i) { return kDegree * std::stod(cells[i]); };
      poses.push_back(to_eigen(
          KDL::Frame(KDL::Rotation::RPY(degrees(4), degrees(5), degrees(6)), KDL::Vector(mm(1), mm(2), mm(3)))));
    }
  }
  return poses;
}

// What the controller does: by KDL, joint values of the nominal robot near `start` at which its flange is there.
Eigen::VectorXd set_by_controller(const Eigen::Isometry3d& X_BF, const Eigen::VectorXd& start) {
  KDL::ChainIkSolverPos_LMA solver(fanuc().chain, Eigen::Matrix<double, 6, 1>::Ones(), 1e-12);
  KDL::JntArray from(6);
  from.data = start;
  KDL::JntArray q(6);
  solver.CartToJnt(from, to_kdl(X_BF), q);
  return q.data;
}

const std::vector<Eigen::VectorXd> kAsked = {Eigen::VectorXd{{0.1, -0.2, 0.3, 0.4, 0.5, 0.6}},
                                             Eigen::VectorXd{{0.15, -0.25, 0.3, 0.4, 0.6, 0.6}},
                                             Eigen::VectorXd{{-0.4, 0.2, 0.1, -0.3, 0.9, 0.2}}};

Eigen::Isometry3d nominal_at(const Eigen::VectorXd& q) { return to_eigen(kdl_pose(fanuc().chain, q)); }

TEST_F(Compensate, BringsTheToolWhereTheProgramsPosesAre) {
  const Eigen::Isometry3d X_BU =
      Eigen::Translation3d(0.3, 1.5, 0.2) * Eigen::Isometry3d(Eigen::AngleAxisd(0.4, Eigen::Vector3d::UnitZ()));
  const Eigen::Isometry3d X_FT =
      Eigen::Translation3d(0.05, 0.3, 0.0) * Eigen::Isometry3d(Eigen::AngleAxisd(-0.7, Eigen::Vector3d::UnitX()));
  write("f.json", Json{{"user", cli::frame_json(X_BU)}, {"tool", cli::frame_json(X_FT)}}.dump());
  const CalibratedArm arm = calibration().arm();
  for (const bool framed : {false, true}) {
    for (const bool seeded : {false, true}) {
      std::string text = std::string(kPoses) + (seeded ? ",joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n" : "\n");
      for (std::size_t i = 0; i < kAsked.size(); ++i) {
        const Eigen::Isometry3d X = nominal_at(kAsked[i]);
        text += std::to_string(i + 1) + in_wpr(framed ? X_BU.inverse() * X * X_FT : X);
        const Eigen::VectorXd seed = kAsked[i].array() + 0.05;
        text += (seeded ? joined({seed.begin(), seed.end()}) : "") + "\n";
      }
      write("p.csv", text);
      const Outcome outcome = run(kOfPoses + Words{"--force"} + (framed ? Words{"--frames", "f.json"} : Words{}));
      // Elsewhere an error of 1 mm and 1 mrad asks for another correction.
      EXPECT_EQ(outcome.status, seeded ? 0 : 1) << outcome.err << outcome.out;
      EXPECT_EQ(outcome.err.find("has no joint values") == std::string::npos, seeded);
      if (!seeded) {
        const Outcome near = run(kOfPoses + Words{"--force", "--near", "6,-11,17,23,29,34"} +
                                 (framed ? Words{"--frames", "f.json"} : Words{}));
        EXPECT_EQ(near.status, 0) << near.err;
        EXPECT_THAT(near.err, ::testing::Not(HasSubstr("has no joint values")));
      }
      const std::string commands = text_of("o.csv");
      EXPECT_EQ(lines_of(commands)[1], lines_of(text)[0]);
      const std::vector<Eigen::Isometry3d> commanded = poses_in(commands);
      ASSERT_EQ(commanded.size(), kAsked.size());
      for (std::size_t i = 0; i < kAsked.size(); ++i) {
        const Eigen::Isometry3d flange = framed ? X_BU * commanded[i] * X_FT.inverse() : commanded[i];
        const Eigen::VectorXd q = set_by_controller(flange, kAsked[i]);
        const Eigen::Isometry3d asked = nominal_at(kAsked[i]);
        EXPECT_GT((flange.translation() - asked.translation()).norm(), 1e-4);
        EXPECT_LT((arm.flange_pose(q).matrix() - asked.matrix()).cwiseAbs().maxCoeff(), 2e-6);  // that of KDL's solver
      }
      if (seeded) {
        const Measurements joints = read_configurations(fanuc(), directory / "o.csv");
        EXPECT_LT((arm.flange_pose(joints.joint_values.col(2)).matrix() - nominal_at(kAsked[2]).matrix()).norm(), 1e-9);
        EXPECT_LT((nominal_at(joints.joint_values.col(2)).matrix() -
                   (framed ? X_BU * commanded[2] * X_FT.inverse() : commanded[2]).matrix())
                      .cwiseAbs()
                      .maxCoeff(),
                  1e-12);
      }
    }
  }
}

// As the pendant shows it: in its world, of its faceplate, beside its joint values. In base and flange the same numbers
// are another pose.
TEST_F(Compensate, TakesPosesAsAControllerShowsThem) {
  const std::string controller = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_controller.json";
  const Eigen::Isometry3d X_BW =
      Eigen::Translation3d(0.0, 0.0, 0.67) * Eigen::AngleAxisd(90.0 * kDegree, Eigen::Vector3d::UnitZ());
  const Eigen::Isometry3d X_FP(
      Eigen::Quaterniond(0.5, -0.5, -0.5, -0.5));  // its z along axis 6, its x along the flange's z
  const Eigen::VectorXd& q = kAsked[1];
  const JointConvention pendant = read_joint_convention(kPendant);
  const Eigen::VectorXd shown = pendant.matrix.inverse() * (q - pendant.offset);
  const std::string pose = in_wpr(X_BW.inverse() * nominal_at(q) * X_FP);
  const auto row = [&](double off) {
    const Eigen::VectorXd J = shown.array() + off;
    write("p.csv", std::string(kPoses) + ",J1[rad],J2[rad],J3[rad],J4[rad],J5[rad],J6[rad]\nP1" + pose +
                       joined({J.begin(), J.end()}) + "\n");
  };
  const Words as_shown = kOfPoses + Words{"--force", "--controller", controller};
  row(0.02);
  const Outcome right = run(as_shown);
  EXPECT_EQ(right.status, 0) << right.err;
  EXPECT_THAT(right.out, ::testing::Not(HasSubstr("poses of flange")));
  const Eigen::Isometry3d flange = X_BW * poses_in(text_of("o.csv"))[0] * X_FP.inverse();
  EXPECT_LT((calibration().arm().flange_pose(set_by_controller(flange, q)).matrix() - nominal_at(q).matrix())
                .cwiseAbs()
                .maxCoeff(),
            2e-6);
  // Without joint columns those of --near are the pendant's as well.
  write("n.csv", std::string(kPoses) + "\nP1" + pose + "\n");
  const Eigen::VectorXd near = shown / kDegree;
  Words from_near = as_shown + Words{"--near", joined({near.begin(), near.end()}).substr(1)};
  from_near[4] = "n.csv";
  EXPECT_EQ(run(from_near).status, 0);
  EXPECT_LT((poses_in(text_of("o.csv"))[0].matrix() - (X_BW.inverse() * flange * X_FP).matrix()).norm(), 1e-9);

  row(0.02);
  const Outcome wrong = run(kOfPoses + Words{"--force", "--joint-convention", kPendant});
  EXPECT_EQ(wrong.status, 1);
  EXPECT_THAT(wrong.err, AllOf(HasSubstr("p.csv: in 1 of 1 rows the joint values stand elsewhere than the pose, first "
                                         "'P1': "),
                               HasSubstr("--controller")));
  row(1.0);
  EXPECT_EQ(run(as_shown).status, 1);
  write("f.json", Json{{"user", cli::frame_json(X_BW)}}.dump());
  expect_refused(as_shown + Words{"--frames", "f.json"}, {"--controller", "--frames"});
  expect_refused(kCompensate + Words{"--controller", controller}, {"--controller", "--joints"});
}

// Joints 4 and 6 half way between both wrists: the other one is about as near.
TEST_F(Compensate, SaysWhereAnotherWayIsAboutAsNear) {
  write("p.csv",
        std::string(kPoses) + "\nP1" + in_wpr(nominal_at(kAsked[0])) + "\nP2" + in_wpr(nominal_at(kAsked[1])) + "\n");
  const Outcome close = run(kOfPoses + Words{"--near", "5.7,-11.5,17.2,108.9,2.9,-45.8"});
  EXPECT_EQ(close.status, 0) << close.err;
  EXPECT_THAT(close.err,
              AllOf(HasSubstr("at 1 of 2 poses, first 'P1', another way"), HasSubstr(" mm away: add joint")));
  const Eigen::VectorXd q = set_by_controller(poses_in(text_of("o.csv"))[0], kAsked[0]);
  EXPECT_LT((calibration().arm().flange_pose(q).matrix() - nominal_at(kAsked[0]).matrix()).cwiseAbs().maxCoeff(), 2e-6);
  const Outcome clear = run(kOfPoses + Words{"--force", "--near", "6,-11,17,23,29,34"});
  EXPECT_EQ(clear.err.find("another way"), std::string::npos) << clear.err;
}

// Yaskawa and Kinova name angles about fixed axes so, Staubli about moving ones.
TEST_F(Compensate, AsksWhatAnglesInDegreesAre) {
  const auto commands = [&](const std::string& columns, const std::string& angles, const Words& options) {
    write("p.csv", "configuration,X[mm],Y[mm],Z[mm]," + columns + "\nP1,300,1500,900," + angles + "\n");
    return run(kOfPoses + Words{"--force", "--near", "10,0,0,0,10,0"} + options);
  };
  const Outcome refused = commands("Rx[deg],Ry[deg],Rz[deg]", "180,0,90", {});
  EXPECT_EQ(refused.status, 2);
  EXPECT_THAT(refused.err, HasSubstr("p.csv:1: rx, ry, rz in degrees may be"));
  EXPECT_FALSE(std::filesystem::exists(directory / "o.csv"));
  // Rz(90) Rx(180) = Rx(180) Rz(-90), a half turn about (1, 1, 0).
  const std::vector<std::pair<std::string, std::string>> same = {
      {"fixed-xyz", "180,0,90"},
      {"moving-xyz", "180,0,-90"},
      {"rotation-vector", "127.27922061357856,127.27922061357856,0"}};
  const Outcome by_name = commands("roll[deg],pitch[deg],yaw[deg]", "180,0,90", {});
  ASSERT_NE(by_name.status, 2) << by_name.err;
  const Eigen::Isometry3d expected = poses_in(text_of("o.csv"))[0];
  EXPECT_THAT(by_name.out, HasSubstr("read: orientations from roll, pitch, yaw as fixed-xyz\n"));
  for (const auto& [word, angles] : same) {
    const Outcome outcome = commands("Rx[deg],Ry[deg],Rz[deg]", angles, {"--orientation", word});
    EXPECT_EQ(outcome.status, by_name.status) << outcome.err;
    EXPECT_THAT(outcome.out, HasSubstr("read: orientations from rx, ry, rz as " + word + "\n"));
    const std::vector<std::string> cells = cells_of(text_of("o.csv")).back();
    const KDL::Vector v(kDegree * std::stod(cells[4]), kDegree * std::stod(cells[5]), kDegree * std::stod(cells[6]));
    const KDL::Rotation moving = KDL::Rotation::RotX(v.x()) * KDL::Rotation::RotY(v.y()) * KDL::Rotation::RotZ(v.z());
    const KDL::Rotation R = word == "fixed-xyz"    ? KDL::Rotation::RPY(v.x(), v.y(), v.z())
                            : word == "moving-xyz" ? moving
                                                   : KDL::Rotation::Rot(v, v.Norm());
    EXPECT_TRUE(KDL::Equal(R, to_kdl(expected).M, 1e-9)) << word;
  }
  EXPECT_EQ(Json::parse(commands("rx,ry,rz", "0,1,0", {"--json"}).out)["read"],
            "orientations from rx, ry, rz as rotation-vector");
  EXPECT_TRUE(Json::parse(commands("qw,qx,qy,qz", "0,1,0,0", {"--json"}).out)["read"].is_null());
  EXPECT_THAT(commands("qw,qx,qy,qz", "0,1,0,0", {"--orientation", "fixed-xyz"}).err,
              HasSubstr("no three numbers of an orientation are there to be read as fixed-xyz"));
  EXPECT_THAT(commands("rx,ry,rz", "0,1,0", {"--orientation", "euler"}).err, HasSubstr("moving-zyx"));
}

TEST_F(Compensate, LeavesPosesThatTheNominalRobotDoesNotReachAsTheyAre) {
  write("p.csv", std::string(kPoses) + "\n1" + in_wpr(nominal_at(kAsked[0])) + "\n2,9000,0,700,10,20,30\n");
  const Outcome outcome = run(kOfPoses + Words{"--json"});
  EXPECT_EQ(outcome.status, 1);
  EXPECT_EQ(Json::parse(outcome.out)["not_exact"][0]["configuration"], "2");
  EXPECT_LT((poses_in(text_of("o.csv"))[1].matrix() - poses_in(text_of("p.csv"))[1].matrix()).norm(), 1e-12);
}

TEST_F(Compensate, SaysHowFarStraightLinesAreOff) {
  write("p.csv",
        "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n0.1,-0.2,0.3,0.4,0.5,0.6\n"
        "0.11,-0.2,0.3,0.4,0.5,0.6\n0.9,0.3,-0.1,0.4,0.7,0.6\n");
  const Outcome outcome = run(kCompensate + Words{"--linear", "--json"});
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("1 of 2 straight lines are off"), HasSubstr("to configuration '3'")));
  const Json lines = Json::parse(outcome.out)["lines"];
  EXPECT_EQ(lines["to"], "3");
  // The controller's straight line between the last two commands, at its middle.
  const Measurements asked = read_configurations(fanuc(), directory / "p.csv");
  const Measurements commanded = read_configurations(fanuc(), directory / "o.csv");
  const auto middle = [](const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
    Eigen::Isometry3d X(Eigen::Quaterniond(a.linear()).slerp(0.5, Eigen::Quaterniond(b.linear())));
    X.translation() = 0.5 * (a.translation() + b.translation());
    return X;
  };
  const auto at = [&](const Measurements& rows, Eigen::Index row) { return nominal_at(rows.joint_values.col(row)); };
  const Eigen::VectorXd q = set_by_controller(middle(at(commanded, 1), at(commanded, 2)),
                                              0.5 * (asked.joint_values.col(1) + asked.joint_values.col(2)));
  const double off =
      (calibration().arm().flange_pose(q).translation() - middle(at(asked, 1), at(asked, 2)).translation()).norm();
  EXPECT_GT(off, 1e-4);
  const Outcome coarse = run(kCompensate + Words{"--linear=1000", "--json", "--force"});
  EXPECT_EQ(coarse.err.find("straight lines"), std::string::npos);
  EXPECT_EQ(Json::parse(coarse.out)["lines"]["tolerance"], 1.0);
  EXPECT_NEAR(lines["largest_deviation"].get<double>(), off, 0.1 * off);
  write("p.csv",
        "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n0.1,-0.2,0.3,0.4,0.5,0.6\n"
        "0.101,-0.2,0.3,0.4,0.5,0.6\n");
  EXPECT_EQ(run(kCompensate + Words{"--linear", "--force"}).err.find("straight lines"), std::string::npos);
}

TEST_F(Compensate, KeepsThePositionWhereAsked) {
  write("p.csv", "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n0.1,-0.2,0.3,0.4,0.5,0.6\n");
  const Words bounded = kCompensate + Words{"--most-change", "0.1", "--json", "--force"};
  const Json least_squares = Json::parse(run(bounded).out);
  const Json position_first = Json::parse(run(bounded + Words{"--position-first"}).out);
  EXPECT_GT(least_squares["largest_position_error"], 1e-5);
  EXPECT_EQ(least_squares["status"]["unreachable"], 1);
  EXPECT_LT(position_first["largest_position_error"], 1e-9);
  EXPECT_EQ(position_first["status"]["position_only"], 1);
}

TEST_F(Compensate, SaysHowWellEachPointIsKnown) {
  run(kCompensate + Words{"--predict", "known.csv"});
  const std::vector<Words> rows = cells_of(text_of("known.csv"));
  ASSERT_EQ(rows.size(), 4U);
  EXPECT_THAT(rows[0], ElementsAre("configuration", "status", "position_error[m]", "orientation_error[rad]", "sigma[m]",
                                   "radius_95[m]", "outside"));
  EXPECT_EQ(rows[3].at(1), "position_only");
  const Measurements commanded = read_configurations(fanuc(), directory / "o.csv");
  double sigma = 0.0;
  double radius = 0.0;
  for (const char* target : {"A", "B", "C"}) {
    const PredictedPoint point = calibration().arm().predict(commanded.joint_values.col(0), target);
    sigma = std::max(sigma, std::sqrt(point.covariance.trace()));
    radius = std::max(radius, point.radius_95);
  }
  ASSERT_EQ(rows[1].size(), 7U);
  EXPECT_NEAR(std::stod(rows[1][4]), sigma, 1e-15);
  EXPECT_NEAR(std::stod(rows[1][5]), radius, 1e-15);
  EXPECT_EQ(rows[1][6], "false");
}

TEST_F(Compensate, WarnsOfWhatTheCalibrationNotedOtherwise) {
  Json noted = json_of("r.json");
  noted["provenance"]["notes"] = {{"payload", "165"}, {"gripper", "none"}};
  write("r.json", noted.dump());
  const Outcome outcome = run(kCompensate + Words{"--note", "payload=80", "--note", "gripper=none", "--note", "x=1"});
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("made with 'payload' \"165\", not '80'"), HasSubstr("does not note 'x'"),
                                 ::testing::Not(HasSubstr("gripper"))));
  expect_refused(kCompensate + Words{"--note", "payload", "--force"}, {"--note", "key=value"});
}

TEST_F(Compensate, WarnsOfAnotherConventionThanTheCalibrations) {
  const std::string serial = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_serial.json";
  succeed(words_of("simulate --configurations 20 --noise 3e-5 --output s.csv --joint-convention " + serial));
  succeed(words_of("calibrate --measurements s.csv --effects none --result s.json --joint-convention " + serial));
  write("p.csv", "configuration,J1[deg],J2[deg],J3[deg],J4[deg],J5[deg],J6[deg]\n1,5,10,15,20,25,30\n");
  for (const char* option : {"--result", "--after"}) {
    const Words bare = words_of("plan --configurations 12 --candidates 100 --starts 1 --force --output o.csv");
    EXPECT_THAT(run(bare + Words{option, "s.json"}).err, HasSubstr("s.json was made with --joint-convention"));
  }
  for (const auto& [convention, warns] : {std::pair{serial, false}, {kPendant, true}}) {
    const std::string with = " --joint-convention " + convention;
    for (const std::string& command :
         {"compensate --result s.json --joints p.csv --force --output o.csv" + with,
          "frames --result s.json --user-touches p.csv --force --output o.json" + with,
          "plan --result s.json --configurations 12 --candidates 100 --starts 1 --force --output o.csv" + with,
          "plan --after s.json --candidates 100 --starts 1 --force --output o.csv" + with,
          "validate --result s.json --measurements s.csv" + with}) {
      EXPECT_EQ(run(words_of(command)).err.find("s.json was made with another one than '" + kPendant + "'") !=
                    std::string::npos,
                warns)
          << command;
    }
  }
}

TEST_F(Compensate, WarnsOfPointsBeyondTheMeasuredJointValues) {
  write("p.csv",
        "pose,joint_1[deg],joint_2,joint_3,joint_4,joint_5,joint_6\na,10,-0.2,0.3,0.4,0.5,0.6\n"
        "b,200,-0.2,0.3,0.4,0.5,0.6\n");
  const Outcome outcome = run(kCompensate + Words{"--json"});
  EXPECT_EQ(Json::parse(outcome.out)["outside"], 1);
  EXPECT_THAT(outcome.err, HasSubstr("1 of 2 points are outside the joint values that were measured, first "
                                     "configuration 'b'"));
}

TEST_F(Compensate, WarnsOfATemperatureFarFromTheMeasured) {
  succeed(
      words_of("simulate --configurations 40 --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 --effects drift "
               "--output t.csv"));
  succeed(words_of("calibrate --measurements t.csv --effects drift --result t.json"));
  const double mean = json_of("t.json")["effects"]["circumstances"]["temperature"].get<double>();
  const auto said = [&](double temperature) {
    return run(words_of("compensate --result t.json --joints p.csv --output o.csv --force --temperature " +
                        shortest(temperature)))
        .err;
  };
  EXPECT_THAT(said(mean + 1.0), ::testing::Not(HasSubstr("degC")));
  EXPECT_THAT(said(600.0), HasSubstr("600 degC is far from what was measured: the calibration may be wrong there"));
}

// The virtual arm that warms up, with a sensor on link_2 that shows the temperature of all.
TEST_F(Compensate, TakesTheTemperatureOfALink) {
  succeed(
      words_of("simulate --configurations 40 --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 --effects drift "
               "--output t.csv"));
  std::string with_sensor;
  for (const std::string& line : lines_of(text_of("t.csv"))) {
    const std::size_t payload = line.rfind(',');
    const std::size_t temperature = line.rfind(',', payload - 1) + 1;
    const std::string cell = line.substr(temperature, payload - temperature);
    with_sensor += line + "," + (cell == "temperature[degC]" ? "temperature_link_2[degC]" : cell) + "\n";
  }
  write("l.csv", with_sensor);
  succeed(words_of("calibrate --measurements l.csv --effects drift --result l.json"));
  const Json stated = json_of("l.json")["effects"]["circumstances"];
  const double mean = stated["link_temperatures"]["link_2"].get<double>();
  EXPECT_NEAR(stated["temperature"].get<double>(), mean, 1e-9);
  const Words compensate = words_of("compensate --result l.json --joints p.csv --output o.csv --force");
  const auto written_at = [&](const Words& options) {
    run(compensate + options);
    return text_of("o.csv");
  };
  const std::string at_mean = written_at({});
  EXPECT_EQ(written_at({"--temperature", "link_2=" + shortest(mean)}), at_mean);
  EXPECT_NE(written_at({"--temperature", "link_2=32"}), at_mean);
  EXPECT_NE(written_at({"--temperature", "32"}), written_at({"--temperature", "link_2=32"}));
  EXPECT_EQ(written_at({"--temperature", "32", "--temperature", "link_2=32"}), written_at({"--temperature", "32"}));
  EXPECT_EQ(written_at({"--temperature", "link_2=20", "--temperature", "32"}),
            written_at({"--temperature", "32", "--temperature", "link_2=20"}));
  const auto said = [&](const std::string& asked) { return run(compensate + Words{"--temperature", asked}).err; };
  EXPECT_THAT(said("link_2=" + shortest(mean + 1.0)), ::testing::Not(HasSubstr("degC")));
  EXPECT_THAT(said("link_2=600"),
              HasSubstr("link_2 at 600 degC is far from what was measured: the calibration may be wrong there"));
  write("o.csv", "as it was");
  const auto refused = [&](const Words& options, const Words& words) {
    expect_refused(compensate + options, words);
    EXPECT_EQ(text_of("o.csv"), "as it was");
  };
  refused({"--temperature", "link_9=30"},
          {"temperature of 'link_9': no effect of this calibration depends on it, expected that of ", "link_2"});
  for (const std::string wrong : {"link_2=warm", "link_2=", "=30", "link_2=5000", "warm", ""}) {
    refused(
        {"--temperature", wrong},
        {"--temperature", "'" + wrong + "' is not accepted, expected a number from -273.15 to 1000, or LINK=NUMBER"});
  }
  refused({"--temperature", "link_2=30", "--temperature", "link_2=31"},
          {"--temperature: 'link_2' is there twice, expected each once"});
  refused({"--temperature", "30", "--temperature", "31"}, {"--temperature: that of the arm is there twice"});
  std::string unknown = text_of("l.csv");
  write("u.csv", unknown.replace(unknown.find("temperature_link_2"), 18, "temperature_link_9"));
  expect_refused(
      words_of("calibrate --measurements u.csv --result u.json"),
      {"u.csv:1: temperature of 'link_9', which is no link of the chain: expected some of base_link, link_1, "
       "link_2, link_3, link_4, link_5, link_6, flange"});
  expect_refused(words_of("validate --result l.json --measurements m.csv"),
                 {"m.csv: no temperature, expected the column that the effects of the result depend on"});
}

TEST_F(Compensate, RefusesPosesThatDependOnWhatIsNotDetermined) {
  succeed(
      words_of("simulate --joint-ranges -90:90,-60:50,-60:60,40:40,-90:90,-180:180 --noise 1e-5 --length-sigma 0.001 "
               "--angle-sigma 0.001 --output m.csv --force"));
  succeed(words_of("calibrate --measurements m.csv --result r.json --force --effects none --prior none"));
  const std::string head = "joint_1[deg],joint_2[deg],joint_3[deg],joint_4[deg],joint_5[deg],joint_6[deg]\n";
  write("p.csv", head + "10,20,30,40,50,60\n");
  EXPECT_EQ(run(kCompensate).status, 0);
  write("p.csv", head + "10,20,30,40,50,60\n10,20,30,0,50,60\n");
  expect_refused(kCompensate + Words{"--force"}, {"configuration '2'", "do not determine", "plan --measured"});
}

TEST_F(Compensate, HelpSaysFirstWhatPosesMean) {
  std::string help = run({"compensate", "--help"}).out;
  std::replace(help.begin(), help.end(), '\n', ' ');
  EXPECT_LT(help.find("touched up"), help.find("--result"));
  EXPECT_LT(help.find("user and tool frames"), help.find("--result"));
}

TEST_F(Compensate, RefusesWhatItMustNotCompensate) {
  ASSERT_EQ(run(kCompensate).status, 1);
  const std::string before = text_of("o.csv");
  write("commands.csv", before);
  run({"simulate", "--noise", "3e-5", "--output", "n.csv"});
  ASSERT_EQ(
      run(words_of("calibrate --measurements n.csv --effects none --prior none --iterations 1 --result doubted.json"))
          .status,
      1);
  write("other.urdf", fanuc().urdf + "\n");
  const auto with = [](std::size_t place, const std::string& value) {
    Words words = kCompensate + Words{"--force"};
    words[place] = value;
    return words;
  };
  expect_refused(kCompensate, {"--output", "o.csv", "--force"});
  expect_refused(with(4, "commands.csv"), {"commands.csv:1", "compensated already"});
  expect_refused(with(2, "doubted.json"), {"not to be trusted"});
  expect_refused(with(4, "none.csv"), {"none.csv"});
  expect_refused(with(6, "p.csv"), {"--output", "p.csv"});
  expect_refused(kCompensate + Words{"--force", "--urdf", "other.urdf"}, {"r.json", "hash"});
  expect_refused(kCompensate + Words{"--force", "--most-change", "0"}, {"--most-change", "degrees"});
  expect_refused({"compensate", "--result", "r.json", "--output", "x.csv"}, {"--joints", "--poses"});
  expect_refused(kCompensate + Words{"--poses", "p.csv"}, {"--joints", "--poses"});
  write("f.json", "{}");
  expect_refused(kCompensate + Words{"--force", "--frames", "f.json"}, {"f.json", "\"user\" or \"tool\""});
  write("empty.csv", "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n");
  expect_refused(with(4, "empty.csv"), {"empty.csv", "no rows"});
  EXPECT_EQ(text_of("o.csv"), before);
}

}  // namespace
}  // namespace kdl_calibration::testing::compensate_test
