// Joint conventions with offsets, couplings and factors, and columns in another order: every subcommand does with a
// controller's values what it does with the URDF's values, converted here by hand.

#include <Eigen/LU>
#include <charconv>

#include "cli_options_support.hpp"
#include "kdl_calibration/measurements.hpp"
#include "planning/measuring_plan.hpp"

namespace kdl_calibration::testing::kdlcal_conventions_test {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

std::string text_of_number(double value) { return Json(value).dump(); }

/// "v1,v2,..." of these values.
std::string list_of(const Eigen::VectorXd& values) {
  std::string text;
  for (const double value : values) {
    text += (text.empty() ? "" : ",") + text_of_number(value);
  }
  return text;
}

/// The controller of kFanucCoupled, by hand: A6 ... A1 for q1 ... q6.
Eigen::VectorXd controller_of(const Eigen::VectorXd& q) {
  const double a1 = q[0] - 0.1;
  const double a2 = -(q[1] + 0.2);
  const double a3 = q[2] - 0.3 - a2;
  const double a4 = -(q[3] + 0.4);
  const double a5 = q[4] - 0.5 - 0.5 * a4;
  const double a6 = -(q[5] + 0.6) / 2.0;
  return Eigen::Matrix<double, 6, 1>(a6, a5, a4, a3, a2, a1);
}

class Conventions : public OptionsOfKdlcal {
protected:
  void SetUp() override {
    OptionsOfKdlcal::SetUp();
    write("coupled.json", kFanucCoupled);
    static const Measurements measured = measured_fanuc({.sigma = 2e-5}, false);
    write("m.csv", measurements_csv(measured));
    write("c.csv", converted(measured, 1.0, ""));
    write("degrees.csv", converted(measured, 1.0 / kDegree, "[deg]"));
  }

  /// The same rows with the controller's columns.
  static std::string converted(Measurements measurements, double unit, const std::string& header) {
    for (Eigen::Index c = 0; c < measurements.joint_values.cols(); ++c) {
      measurements.joint_values.col(c) = unit * controller_of(measurements.joint_values.col(c));
    }
    measurements.joint_units.clear();
    measurements.joints = {"A6", "A5", "A4", "A3", "A2", "A1"};
    std::string text = measurements_csv(measurements);
    for (const std::string& name : measurements.joints) {
      text.replace(text.find(name), 2, name + header);
    }
    return text;
  }

  Json json(const Words& arguments) { return run_json(arguments); }

  const Words with = {"--joint-convention", "coupled.json"};
};

TEST_F(Conventions, FitWhatTheUrdfsValuesGive) {
  write("asked.csv", "configuration,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\nx,0.1,0.2,0.3,0.4,0.5,0.6\n");
  const Eigen::VectorXd asked = controller_of(Eigen::Matrix<double, 6, 1>(0.1, 0.2, 0.3, 0.4, 0.5, 0.6));
  write("asked_c.csv", "configuration,A6,A5,A4,A3,A2,A1\nx," + list_of(asked) + "\n");
  const Words command = {"calibrate", "--threads", "1", "--leave-one-out", "--json"};
  const Json expected = json(command + Words{"--measurements", "m.csv", "--predict-at", "asked.csv"});
  EXPECT_LT(expected["position_error"]["test"]["after"]["rms"], 2e-4);
  for (const std::string file : {"c.csv", "degrees.csv"}) {
    Json found = json(command + with + Words{"--measurements", file, "--predict-at", "asked_c.csv"});
    found["input"]["measurements"] = "m.csv";
    for (const char* part :
         {"input", "termination", "rank", "targets", "base", "position_error", "model", "warnings"}) {
      expect_near(expected[part], found[part], 1e-9, file + " " + part);
    }
    // Errors of numbers that were rounded in the file, spread by the condition of the fit.
    expect_near(expected["parameters"], found["parameters"], 1e-10, file);
    expect_near(expected["position_error"]["train"], found["position_error"]["train"], 1e-12, file);
    expect_near(expected["predicted_accuracy"]["asked"], found["predicted_accuracy"]["asked"], 1e-10, file);
  }
}

TEST_F(Conventions, AreThoseOfWhatIsValidated) {
  const Json expected = json({"validate", "--measurements", "m.csv", "--json"});
  for (const std::string file : {"c.csv", "degrees.csv"}) {
    expect_near(expected, json(Words{"validate", "--measurements", file, "--json"} + with), 1e-12, file);
  }
}

TEST_F(Conventions, TurnTheFlangeAndTheAxesAlike) {
  const Eigen::VectorXd q = Eigen::Matrix<double, 6, 1>(0.3, -0.2, 0.5, 1.0, -1.0, 2.0);
  for (const std::string subcommand : {"fk", "jacobian"}) {
    const Json expected = json({subcommand, "--json", "--joints", list_of(q)});
    expect_near(expected, json(Words{subcommand, "--json", "--joints", list_of(controller_of(q))} + with), 1e-12);
    const std::string degrees = list_of(controller_of(q) / kDegree);
    expect_near(expected, json(Words{subcommand, "--json", "--degrees", "--joints", degrees} + with), 1e-12);
  }
}

// ---- plan ----------------------------------------------------------------------------------------------------------

const Words kSmallPlan = {"plan", "--configurations", "10", "--candidates", "60", "--workspace", "20", "--starts", "1"};

class PlannedConventions : public Conventions {
protected:
  /// The same plan from what a controller says and from what the URDF says.
  void expect_same_plan(const Words& controllers, const Words& urdfs) {
    const Words plan = kSmallPlan + Words{"--threads", "1", "--json"};
    Json found = json(plan + with + controllers);
    Json expected = json(plan + urdfs);
    ASSERT_EQ(found["candidates"]["refused"].size(), expected["candidates"]["refused"].size());
    for (std::size_t i = 0; i < found["candidates"]["refused"].size(); ++i) {
      found["candidates"]["refused"][i].erase("constraint");  // which bears the name that was given
      expected["candidates"]["refused"][i].erase("constraint");
    }
    expect_near(expected, found, 1e-9, ::testing::PrintToString(controllers));
    EXPECT_GT(differences(expected, run_once(plan).json).size(), 0U) << "the option has no effect";
  }

  static std::string range(const std::string& name, double lower, double upper) {
    return name + "=" + text_of_number(lower) + ":" + text_of_number(upper);
  }
};

constexpr double kTenth = 0.1 / kDegree;  // of a radian

TEST_F(PlannedConventions, HomeIsTheControllers) {
  const Eigen::VectorXd q = Eigen::Matrix<double, 6, 1>(90.0, 30.0, -20.0, 10.0, -90.0, 170.0) * kDegree;
  expect_same_plan({"--home", list_of(controller_of(q) / kDegree)}, {"--home", list_of(q / kDegree)});
}

TEST_F(PlannedConventions, FilesAreTheControllers) {
  const Measurements tasks = parse_configurations(
      "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n0.1,0.2,0.3,0.4,0.5,0.6\n-0.1,0.3,0,0.2,1,-2\n",
      joint_names(fanuc()));
  write("tasks.csv", "joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n" + list_of(tasks.joint_values.col(0)) + "\n" +
                         list_of(tasks.joint_values.col(1)) + "\n");
  write("tasks_c.csv", "A6,A5,A4,A3,A2,A1\n" + list_of(controller_of(tasks.joint_values.col(0))) + "\n" +
                           list_of(controller_of(tasks.joint_values.col(1))) + "\n");
  write("t.json", R"({"targets": [{"name": "A", "position": [0.1, 0, 0]}, {"name": "B", "position": [0, 0, 0.1]},
    {"name": "C", "position": [0.1, 0, 0.1]}]})");
  expect_same_plan({"--tasks", "tasks_c.csv", "--measured", "c.csv", "--target-file", "t.json"},
                   {"--tasks", "tasks.csv", "--measured", "m.csv", "--target-file", "t.json"});
}

TEST_F(PlannedConventions, ThePlanIsDrivenWhereItWasPlanned) {
  const Json plan = json(kSmallPlan + Words{"--output", "plan.csv", "--json"} + with);
  std::istringstream lines(text_of("plan.csv"));
  std::size_t row = 0;
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line.front() == '#' || line.find("configuration") == 0) {
      continue;
    }
    // configuration,target,A6[deg] ... A1[deg]; three rows of each configuration
    std::istringstream fields(line);
    std::string field;
    std::getline(fields, field, ',');
    std::getline(fields, field, ',');
    Eigen::VectorXd driven(6);
    for (double& value : driven) {
      std::getline(fields, field, ',');
      value = std::stod(field) * kDegree;
    }
    const std::vector<double> joints = plan["configurations"].at(row / 3)["joints"];
    const Eigen::VectorXd expected = controller_of(Eigen::Map<const Eigen::VectorXd>(joints.data(), 6));
    EXPECT_LT((driven - expected).cwiseAbs().maxCoeff(), 1e-10) << line;
    ++row;
  }
  EXPECT_EQ(row, 30U);

  ASSERT_EQ(run(Words{"simulate", "--plan", "plan.csv", "--noise", "1e-5", "--output", "driven.csv"} + with).status, 0);
  const JointConvention coupled = read_joint_convention(directory / "coupled.json");
  const Measurements driven = read_measurements(directory / "driven.csv", joint_names(fanuc()), &coupled);
  for (std::size_t c = 0; c < 10; ++c) {
    const std::vector<double> joints = plan["configurations"][c]["joints"];
    EXPECT_LT(
        (driven.joint_values.col(static_cast<Eigen::Index>(c)) - Eigen::Map<const Eigen::VectorXd>(joints.data(), 6))
            .cwiseAbs()
            .maxCoeff(),
        1e-10);
  }
}

// ---- A slide -------------------------------------------------------------------------------------------------------

/// The controller counts the slide first, in the other direction, and from another place.
constexpr const char* kSlideFirst = R"({"controller_joints": ["S", "K", "T", "E", "W"],
  "urdf_joints": ["turn", "slide", "skew", "elbow", "wrist"],
  "matrix": [[0,0,1,0,0], [-1,0,0,0,0], [0,1,0,0,0], [0,0,0,1,0], [0,0,0,0,1]],
  "offset": [0.1, 0.05, -0.2, 0.3, -0.4]})";

class SlideConventions : public PlannedConventions {
protected:
  void SetUp() override {
    PlannedConventions::SetUp();
    write("odd.urdf", kOddArm);
    write("coupled.json", kSlideFirst);
  }
};

TEST_F(SlideConventions, HomeOfASlideIsInMillimetresWhereverTheControllerCountsIt) {
  // slide = -S + 0.05, turn = T + 0.1
  const double degree = 1.0 / kDegree;
  expect_same_plan({"--urdf", "odd.urdf", "--home",
                    "-200," + text_of_number(10.0 + 0.2 * degree) + "," + text_of_number(30.0 - 0.1 * degree) + "," +
                        text_of_number(20.0 - 0.3 * degree) + "," + text_of_number(-20.0 + 0.4 * degree)},
                   {"--urdf", "odd.urdf", "--home", "30,250,10,20,-20"});
}

TEST_F(SlideConventions, TheUnitsOfAPlanFollowTheControllersJoints) {
  ASSERT_EQ(run(kSmallPlan + Words{"--urdf", "odd.urdf", "--output", "plan.csv"} + with).status, 0);
  EXPECT_THAT(text_of("plan.csv"), HasSubstr("S[mm],K[deg],T[deg],E[deg],W[deg]"));
}

// ---- Names that both sides use -------------------------------------------------------------------------------------

TEST_F(PlannedConventions, NamesThatBothSidesUseAreTheControllers) {
  write("coupled.json", R"({"controller_joints": ["joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"],
    "urdf_joints": ["joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"],
    "matrix": [[-1,0,0,0,0,0],[0,1,0,0,0,0],[0,0,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,0,1]],
    "offset": [0.1,0,0,0,0,0]})");
  expect_same_plan({"--joint-range", "joint_1=-20:40"},
                   {"--joint-range", range("joint_1", -40.0 + kTenth, 20.0 + kTenth)});
}

// ---- A wrong one ---------------------------------------------------------------------------------------------------

TEST_F(Conventions, TheRightOneIsNamedWhereAnOffsetHasTheWrongSign) {
  std::string wrong = kFanucCoupled;
  const std::string offset = "-0.4, 0.5";
  wrong.replace(wrong.find(offset), offset.size(), "0.4, 0.5");
  write("wrong.json", wrong);
  const Outcome outcome = run({"validate", "--measurements", "c.csv", "--joint-convention", "wrong.json"});
  EXPECT_EQ(outcome.status, 1) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("coupled.json"));
  const Outcome right = run(Words{"validate", "--measurements", "c.csv"} + with);
  EXPECT_EQ(right.status, 0);
  EXPECT_THAT(right.err, Not(HasSubstr("coupled.json")));

  // A fit finds the offset as one of joint 4: what was read is 0.8 rad more than what was meant. No robot is off by
  // that.
  const auto joint_4 = [&](const std::string& convention, int status) {
    const Outcome fitted = run({"calibrate", "--measurements", "c.csv", "--json", "--joint-convention", convention,
                                "--effects", "none", "--prior", "none"});
    EXPECT_EQ(fitted.status, status) << fitted.err;
    const Json result = Json::parse(fitted.out);
    for (const Json& parameter : result["parameters"]) {
      if (parameter["name"] == "dq4") {
        return parameter["error"].get<double>();
      }
    }
    return 0.0;
  };
  EXPECT_NEAR(joint_4("wrong.json", 1) - joint_4("coupled.json", 0), -0.8, 1e-6);
}

}  // namespace
}  // namespace kdl_calibration::testing::kdlcal_conventions_test
