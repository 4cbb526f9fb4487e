// Joint conventions with offsets, couplings and factors, and columns in another order: every subcommand does with a
// controller's values what it does with the URDF's values, converted here by hand.

#include "cli_options_support.hpp"
#include "kdl_calibration/measurements.hpp"
#include "planning/measuring_plan.hpp"

namespace kdl_calibration::testing::kdlcal_conventions_test {
namespace {

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

TEST_F(PlannedConventions, NamesThatBothSidesUseAreTheControllers) {
  write("coupled.json", R"({"controller_joints": ["joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"],
    "urdf_joints": ["joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"],
    "matrix": [[-1,0,0,0,0,0],[0,1,0,0,0,0],[0,0,1,0,0,0],[0,0,0,1,0,0],[0,0,0,0,1,0],[0,0,0,0,0,1]],
    "offset": [0.1,0,0,0,0,0]})");
  expect_same_plan({"--joint-range", "joint_1=-20:40"},
                   {"--joint-range", range("joint_1", -40.0 + kTenth, 20.0 + kTenth)});
}

}  // namespace
}  // namespace kdl_calibration::testing::kdlcal_conventions_test
