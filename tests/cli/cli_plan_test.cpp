#include <array>
#include <cmath>

#include "cli_options_support.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::cli_plan_test {
namespace {

using ::testing::HasSubstr;

class PlanCommand : public CommandLine {
protected:
  const std::vector<std::string> quick = {"plan", "--candidates", "100", "--workspace", "50", "--starts", "2"};

  std::vector<std::string> with(std::vector<std::string> more) const {
    std::vector<std::string> arguments = quick;
    arguments.insert(arguments.end(), more.begin(), more.end());
    return arguments;
  }
};

TEST_F(PlanCommand, PlansAnExperimentThatCalibrates) {
  const std::string convention = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json";
  const Outcome plan = run(
      with({"--configurations", "20", "--least-height", "0.2", "--least-radius", "0.7", "--joint-range", "J3=-80:90",
            "--joint-range", "joint_5=-100:100", "--joint-convention", convention, "--output", "plan.csv"}));
  ASSERT_EQ(plan.status, 0) << plan.err;
  EXPECT_THAT(plan.out, HasSubstr(" exchanges"));
  EXPECT_THAT(plan.out, HasSubstr("range of J3 removes "));
  EXPECT_THAT(plan.out, HasSubstr("the least that any plan could promise"));
  EXPECT_THAT(text_of("plan.csv"), HasSubstr("configuration,target,J1[deg],J2[deg]"));
  EXPECT_THAT(text_of("plan.csv"), HasSubstr("home pose"));
  expect_refused({"calibrate", "--measurements", "plan.csv", "--joint-convention", convention},
                 {"plan.csv:4: x[m]", "empty"});

  // Drive the plan on a virtual robot, and calibrate it.
  const Outcome simulated = run({"simulate", "--plan", "plan.csv", "--joint-convention", convention, "--noise", "3e-5",
                                 "--test-configurations", "20", "--output", "m.csv"});
  ASSERT_EQ(simulated.status, 0) << simulated.err;
  EXPECT_THAT(simulated.out, HasSubstr("20 configurations to fit"));
  const Outcome calibrated = run({"calibrate", "--measurements", "m.csv", "--result", "result.json"});
  ASSERT_EQ(calibrated.status, 0) << calibrated.err;
  EXPECT_LT(json_of("result.json")["position_error"]["test"]["after"]["mean"].get<double>(), 1e-4);

  // And plan what to measure on top of that.
  const nlohmann::json added = run_json(with({"--measured", "m.csv", "--add", "5", "--noise", "3e-5", "--json"}));
  ASSERT_EQ(added["configurations"].size(), 5U);
  EXPECT_TRUE(added["sigma"]["floor"].is_null());
  EXPECT_EQ(added["configurations"][0]["configuration"], "41");
}

// What a result knows is what the measurements that it came from tell, up to the 3 degrees between the
// geometries at which they are linearised.
TEST_F(PlanCommand, PlansOnTopOfAResultAsOnTopOfItsMeasurements) {
  ASSERT_EQ(run({"simulate", "--configurations", "15", "--noise", "3e-5", "--output", "m.csv"}).status, 0);
  const Outcome calibrated =
      run({"calibrate", "--measurements", "m.csv", "--noise-independent", "3e-5", "--result", "result.json"});
  ASSERT_EQ(calibrated.status, 0) << calibrated.err;
  const auto planned_on = [&](const std::string& option, const std::string& file) {
    return run_json({"plan", "--candidates", "80", "--workspace", "30", "--starts", "2", option, file, "--add", "5",
                     "--noise", "3e-5", "--json"});
  };
  const nlohmann::json on_measured = planned_on("--measured", "m.csv");
  const nlohmann::json on_result = planned_on("--result", "result.json");
  EXPECT_EQ(on_result["parameters"], 33);
  EXPECT_EQ(on_result["configurations"].size(), 5U);
  EXPECT_TRUE(on_result["sigma"]["floor"].is_null());
  for (const char* figure : {"mean", "p95", "max"}) {
    const double measured = on_measured["sigma"]["plan"][figure];
    EXPECT_NEAR(on_result["sigma"]["plan"][figure].get<double>() / measured, 1.0, 0.05) << figure;
    const double random = on_measured["sigma"]["random"][figure];
    EXPECT_NEAR(on_result["sigma"]["random"][figure].get<double>() / random, 1.0, 0.05) << figure;
  }
  expect_refused(with({"--measured", "m.csv", "--result", "result.json"}),
                 {"--result", "--measured", "one of the two"});
  expect_refused(with({"--result", "result.json", "--monte-carlo", "2"}), {"--monte-carlo", "--measured FILE"});
}

TEST_F(PlanCommand, ReportsInJson) {
  const nlohmann::json plan = run_json(with({"--json", "--criterion", "I", "--monte-carlo", "3"}));
  EXPECT_EQ(plan["criterion"], "I");
  EXPECT_EQ(plan["parameters"], 33);
  EXPECT_EQ(plan["configurations"].size(), 30U);
  EXPECT_EQ(plan["configurations"][0]["joints"].size(), 6U);
  EXPECT_GT(plan["exchanges"], 0);
  EXPECT_GT(plan["d_efficiency"], 0.5);
  for (const char* index : {"O1", "O2", "O3", "O4", "O5"}) {
    EXPECT_GT(plan["observability"][index], 0.0) << index;
  }
  const auto& sigma = plan["sigma"];
  EXPECT_NEAR(sigma["floor"].get<double>(), 3e-5 * std::sqrt(33.0 / 90.0), 1e-12);
  EXPECT_GE(sigma["plan"]["worst_configuration_rms"], sigma["floor"]);
  EXPECT_LT(sigma["plan"]["mean"], sigma["random"]["mean"]);
  EXPECT_EQ(plan["monte_carlo"]["runs"], 3);
}

TEST_F(PlanCommand, PlansForATrackersOwnNoise) {
  const std::vector<std::string> tracker = {"--noise-tracker", "1e-5,0,3e-5,8e-6", "--tracker", "4,1,0.5"};
  std::vector<std::string> arguments =
      with({"--configurations", "16", "--configuration-noise", "2e-5", "--monte-carlo", "10", "--json"});
  arguments.insert(arguments.end(), tracker.begin(), tracker.end());
  const nlohmann::json plan = run_json(arguments);
  EXPECT_TRUE(plan["sigma"]["floor"].is_null());
  const double promised = plan["sigma"]["plan"]["mean"];
  const double tried = plan["monte_carlo"]["rms_of_point_mean"];
  EXPECT_NEAR(tried / promised, 1.0, 0.1);  // 10 runs of 33 parameters: 6 %
  EXPECT_EQ(plan["monte_carlo"]["not_trusted"], 0);
  expect_refused(with({"--noise-tracker", "1e-5,0,3e-5,8e-6"}), {"--noise-tracker", "--tracker x,y,z"});
  expect_refused(with({"--noise-tracker", "1e-5,0", "--tracker", "4,1,0.5"}), {"--noise-tracker", "expected 4"});
}

TEST_F(PlanCommand, KeepsEveryPlannedConfigurationWithinTheConstraints) {
  const std::vector<std::array<double, 3>> points = {{0.1, 0.2, 0.0}, {-0.05, 0.2, 0.0866}, {-0.05, 0.2, -0.0866}};
  nlohmann::json targets = {{"targets", nlohmann::json::array()}};
  for (std::size_t k = 0; k < points.size(); ++k) {
    targets["targets"].push_back({{"name", std::to_string(k)}, {"position", points[k]}});
  }
  write("targets.json", targets.dump());
  const nlohmann::json plan = run_json(with(
      {"--json", "--target-file", "targets.json", "--least-height", "0.2", "--least-radius", "0.7", "--joint-range",
       "joint_3=-150:150", "--joint-range", "joint_2+joint_3=-80:90", "--joint-range", "joint_1=-100:120"}));
  const Robot robot = fanuc();
  ASSERT_EQ(plan["configurations"].size(), 30U);
  for (const auto& configuration : plan["configurations"]) {
    const auto joints = configuration["joints"].get<std::vector<double>>();
    const Eigen::Map<const Eigen::VectorXd> q(joints.data(), 6);
    for (std::size_t i = 0; i < 6; ++i) {
      EXPECT_GE(joints[i], *robot.joints[i].lower);
      EXPECT_LE(joints[i], *robot.joints[i].upper);
    }
    EXPECT_GE(joints[0], -100 * kDegree - 1e-12);
    EXPECT_LE(joints[0], 120 * kDegree + 1e-12);
    EXPECT_LE(std::abs(joints[2]), 150 * kDegree + 1e-12);
    EXPECT_GE(joints[1] + joints[2], -80 * kDegree - 1e-12);
    EXPECT_LE(joints[1] + joints[2], 90 * kDegree + 1e-12);
    const KDL::Frame flange = kdl_pose(robot.chain, q);
    for (const auto& point : points) {
      const KDL::Vector p = flange * KDL::Vector(point[0], point[1], point[2]);
      EXPECT_GE(p.z(), 0.2);
      EXPECT_GE(std::hypot(p.x(), p.y()), 0.7);
    }
  }
}

TEST_F(PlanCommand, IsTheSameOnAnyNumberOfThreads) {
  write(kArm, arm().urdf);
  const Words command = {"plan", "--urdf",      kArm, "--candidates",     "100", "--workspace", "50", "--starts",
                         "3",    "--criterion", "G",  "--configurations", "8",   "--json"};
  const Outcome one = run(command + Words{"--threads", "1"});
  EXPECT_EQ(one.status, 0) << one.err;
  EXPECT_EQ(one.out, run(command + Words{"--threads", "3"}).out);
  EXPECT_NE(one.out, run(command + Words{"--seed", "2"}).out);
}

TEST_F(PlanCommand, TakesACellATrackerAndFacingTargets) {
  write("targets.json", R"({"targets": [{"name": "A", "position": [0.1, 0.2, 0], "facing": [0, 1, 0]},
      {"name": "B", "position": [-0.05, 0.2, 0.0866], "facing": [0, 1, 0]}, {"name": "C", "position": [0, 0.2, -0.1]}]})");
  const nlohmann::json plan = run_json(
      with(words_of("--json --configurations 10 --target-file targets.json --tracker 4,2,1 --acceptance-angle 60 "
                    "--distance-range 1:6 --box -3,-3,0,3,3,3 --keep-out-sphere 2,2,0,0.5 --keep-out-sphere -2,0,0,0.5 "
                    "--keep-out-box -3,-3,0,-1,-1,1 --clearance 0.05 --tool-radius 0.02 --home 0,0,0,0,-90,0")));
  std::vector<std::string> names;
  for (const auto& entry : plan["candidates"]["refused"]) {
    names.push_back(entry["constraint"]);
    EXPECT_GT(entry["samples"], 0) << names.back();
  }
  EXPECT_THAT(names, ::testing::ElementsAre("workspace box", "keep-out sphere 1", "keep-out sphere 2", "keep-out box 1",
                                            "clearance 50 mm", "distance from the tracker", "acceptance angle 60 deg",
                                            "line of sight"));
}

TEST_F(PlanCommand, ReachesAnAccuracyWithAsFewAsPossible) {
  write(kArm, arm().urdf);
  const nlohmann::json plan = run_json(with({"--urdf", kArm, "--accuracy", "0.05", "--json"}));
  EXPECT_LE(plan["sigma"]["plan"]["mean"], 0.05e-3);
  EXPECT_LT(plan["configurations"].size(), 20U);
  expect_refused(with({"--urdf", kArm, "--accuracy", "0.001", "--configurations", "12"}),
                 {"accuracy cannot be reached", "12 config"});
}

TEST_F(PlanCommand, RefusesWhatItCannotPlan) {
  expect_refused(with({"--configurations", "3"}), {"expected at least 4 configurations"});
  expect_refused(with({"--least-height", "9", "--output", "plan.csv"}),
                 {"the constraints leave 0 of", "least height 9000 mm removes"});
  expect_refused(with({"--joint-range", "joint_9=0:1"}), {"--joint-range", "joint_9=0:1", "expected"});
  expect_refused(with({"--joint-range", "joint_1=5:1"}), {"--joint-range", "joint_1=5:1"});
  expect_refused(with({"--joint-range", "joint_2=170:180"}), {"--joint-range", "limits"});
  expect_refused(with({"--keep-out-sphere", "1,2,3"}), {"--keep-out-sphere", "1,2,3", "x,y,z,radius"});
  expect_refused(with({"--acceptance-angle", "30"}), {"--acceptance-angle", "--tracker"});
  expect_refused(with({"--add", "3"}), {"--add", "--measured"});
  expect_refused(with({"--criterion", "A"}), {"--criterion", "D, G, I"});
  expect_refused(with({"--noise", "0"}), {"--noise"});
  expect_refused(with({"--home", "1,2"}), {"--home", "6 joint values"});
}

TEST_F(PlanCommand, SimulatesManyExperiments) {
  const std::vector<std::string> command = {
      "simulate", "--monte-carlo", "3",     "--configurations", "10",    "--noise", "3e-5",     "--test-configurations",
      "10",       "--angle-sigma", "0.001", "--length-sigma",   "0.001", "--json",  "--threads"};
  std::vector<std::string> one = command;
  one.emplace_back("1");
  std::vector<std::string> two = command;
  two.emplace_back("2");
  const Outcome first = run(one);
  ASSERT_EQ(first.status, 0) << first.err;
  EXPECT_EQ(first.out, run(two).out);
  const auto json = nlohmann::json::parse(first.out);
  EXPECT_EQ(json["runs"], 3);
  EXPECT_EQ(json["held_out_error"]["all"]["count"], 3 * 10 * 3);
  EXPECT_EQ(json["held_out_error"]["mean_of_run"]["count"], 3);
  EXPECT_LT(json["held_out_error"]["all"]["rms"], 1e-4);
  expect_refused({"simulate", "--monte-carlo", "2", "--output", "m.csv"}, {"--monte-carlo"});
}

}  // namespace
}  // namespace kdl_calibration::testing::cli_plan_test
