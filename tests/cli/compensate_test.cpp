// kdlcal compensate: its file, its summary, its options, and what it refuses.

#include "base/sha256.hpp"
#include "cli_options_support.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/result_file.hpp"
#include "printed_text.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::compensate_test {
namespace {

using ::testing::AllOf;
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
    write("r.json", result());
    write("p.csv", kProgram);
  }

  // Of a calibration of a virtual robot, which takes a while.
  std::string result() {
    static const std::string text = [this] {
      EXPECT_EQ(
          run({"simulate", "--noise", "3e-5", "--length-sigma", "0.001", "--angle-sigma", "0.001", "--output", "m.csv"})
              .status,
          0);
      EXPECT_EQ(
          run({"calibrate", "--measurements", "m.csv", "--effects", "none", "--prior", "none", "--result", "r.json"})
              .status,
          0);
      return text_of("r.json");
    }();
    return text;
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
  for (Eigen::Index c = 0; c < 2; ++c) {
    const CompensatedPoint point = compensator.solve(asked.joint_values.col(c));
    EXPECT_LT((commanded.joint_values.col(c) - point.joint_values).cwiseAbs().maxCoeff(), 1e-14);
  }
}

TEST_F(Compensate, LeavesOtherCellsAsTheyAre) {
  write("p.csv",
        "configuration;joint_1;joint_2;joint_3;joint_4;joint_5;joint_6;target;x;y;z\n"
        "A;0,1;0,2;0,3;0,4;0,5;0,6;'=B;-0,25;1,5;-2\n");
  ASSERT_EQ(run(kCompensate).status, 0);
  EXPECT_THAT(text_of("o.csv"), ::testing::EndsWith(";'=B;\"-0,25\";\"1,5\";-2\n"));
}

TEST_F(Compensate, ChangesNoJointByMoreThanAllowed) {
  for (const double most : {0.01, 1.0}) {
    run(kCompensate + Words{"--force", "--most-change", std::to_string(most)});
    const Eigen::MatrixXd changes = read_configurations(fanuc(), directory / "o.csv").joint_values -
                                    read_configurations(fanuc(), directory / "p.csv").joint_values;
    EXPECT_NEAR(changes.cwiseAbs().maxCoeff(), most * kDegree, 1e-14);
  }
}

TEST_F(Compensate, HelpSaysFirstWhatPosesMean) {
  const std::string help = run({"compensate", "--help"}).out;
  EXPECT_LT(help.find("touched up"), help.find("--result"));
  EXPECT_LT(help.find("user and tool frames"), help.find("--result"));
}

TEST_F(Compensate, RefusesWhatItMustNotCompensate) {
  ASSERT_EQ(run(kCompensate).status, 1);
  const std::string before = text_of("o.csv");
  write("commands.csv", before);
  run({"simulate", "--noise", "3e-5", "--output", "n.csv"});
  ASSERT_EQ(run({"calibrate", "--measurements", "n.csv", "--effects", "none", "--prior", "none", "--iterations", "1",
                 "--result", "doubted.json"})
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
  expect_refused({"compensate", "--result", "r.json", "--output", "x.csv"}, {"--joints", "required"});
  EXPECT_EQ(text_of("o.csv"), before);
}

}  // namespace
}  // namespace kdl_calibration::testing::compensate_test
