// What the pages of plans, runs and validations hold, against what they are made from.

#include "cli/report_pages.hpp"

#include <gmock/gmock.h>

#include <set>

#include "cli/truth_report.hpp"
#include "report_page_support.hpp"
#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::report_pages_test {
namespace {

using Json = nlohmann::json;
using Eigen::Index;

const cli::PageFacts kSetup = {{"robot", "an arm"}, {"seed", "7"}};

/// What every page has.
Json expect_page(const std::string& page, const std::string& kind, const Json& result) {
  Json data = data_of_page(page);
  EXPECT_EQ(data["kind"], kind);
  EXPECT_EQ(data["software"], (Json{{"name", "kdl_calibration"}, {"version", KDL_CALIBRATION_VERSION}}));
  EXPECT_TRUE(data["result"] == result) << data["result"];
  return data;
}

void expect_place(const Json& place, const Robot& robot, const Eigen::VectorXd& q, const std::string& what) {
  const KDL::Vector flange = kdl_pose(robot.chain, q).p;
  ASSERT_EQ(place.size(), 3U) << what;
  for (int axis = 0; axis < 3; ++axis) {
    ASSERT_NEAR(place[static_cast<std::size_t>(axis)].get<double>(), flange[axis], 1e-12) << what << ", axis " << axis;
  }
}

TEST(PagesOfKdlcal, OfAPlanShowChosenAndOtherPlacesTheTrackerAndWhatFewerWouldGive) {
  PlanRequest request;
  request.robot = fanuc();
  request.targets = published_targets(2);
  request.cell.ranges = limits_of(request.robot.joints);
  request.cell.tracker = Tracker{.position = {9.0, -8.0, 7.0}};
  request.count = 9;
  request.candidates = 1600;
  request.workspace = 40;
  request.starts = 1;
  request.threads = 1;
  const Plan plan = make_plan(request);
  const Json data =
      expect_page(cli::plan_page({{"x", 1}}, {.request = request, .plan = plan, .setup = kSetup}), "plan", {{"x", 1}});
  EXPECT_EQ(data["setup"], Json::parse(R"([["robot", "an arm"], ["seed", "7"]])"));
  EXPECT_EQ(data["tracker"], Json::parse("[9.0, -8.0, 7.0]"));
  EXPECT_EQ(data["robot"]["targets"].size(), 2U);
  ASSERT_EQ(data["configurations"].size(), 9U);
  ASSERT_EQ(data["chosen"].size(), 9U);
  for (std::size_t c = 0; c < 9; ++c) {
    const Eigen::VectorXd q = plan.sheet.joint_values.col(static_cast<Index>(c));
    EXPECT_EQ(data["configurations"][c]["name"], plan.sheet.configurations[c]);
    EXPECT_EQ(data["configurations"][c]["joint_values"], Json(std::vector<double>(q.begin(), q.end())));
    expect_place(data["chosen"][c], request.robot, q, "chosen");
  }
  const std::set<Index> chosen(plan.selection.chosen.begin(), plan.selection.chosen.end());
  // 1,500 of the 1,600, evenly spaced, but for those that were chosen.
  EXPECT_GE(data["rejected"].size(), 1500U - 9U);
  EXPECT_LE(data["rejected"].size(), 1500U);
  expect_place(data["rejected"][0], request.robot, plan.drawn.joint_values.col(chosen.count(0) == 0 ? 0 : 1), "first");
  expect_place(data["rejected"].back(), request.robot,
               plan.drawn.joint_values.col(chosen.count(1598) == 0 ? 1598 : 1597), "last");
  const std::vector<CountedAccuracy> counted = accuracy_by_count(request, plan);
  ASSERT_EQ(data["by_count"].size(), counted.size());
  for (std::size_t k = 0; k < counted.size(); ++k) {
    const auto finite = [](double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); };
    EXPECT_EQ(
        data["by_count"][k],
        (Json{{"count", counted[k].count}, {"plan", finite(counted[k].plan)}, {"random", finite(counted[k].random)}}));
  }
  request.cell.tracker.reset();
  const JointConvention pendant = read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json");
  const Json other = expect_page(
      cli::plan_page({}, {.request = request, .plan = plan, .setup = {}, .convention = &pendant}), "plan", {});
  EXPECT_FALSE(other.contains("tracker"));
  EXPECT_EQ(other["joints"][2]["name"], "J3");
  const Json& first = other["configurations"][0];  // q3 = J3 + J2, q2 = -J2
  EXPECT_NEAR(first["controller"][2], first["joint_values"][2].get<double>() + first["joint_values"][1].get<double>(),
              1e-12);
}

TEST(PagesOfKdlcal, OfTheTwoStepProcedureShowTheOtherRoundsToo) {
  const Json other = {{"rounds", 5}};
  const Json data = expect_page(cli::two_step_page({{"a", 1}}, other, kSetup), "two_step", {{"a", 1}});
  EXPECT_EQ(data["other"], other);
  EXPECT_EQ(data["setup"][1], Json::parse(R"(["seed", "7"])"));
}

TEST(PagesOfKdlcal, OfAValidationShowRobotMeasurementsAndWhatIsDoubted) {
  VirtualExperiment arm;
  const Measurements measured = arm.measure(5, {.sigma = 1e-5});
  const Robot robot = fanuc();
  const Estimate estimate = nominal_start(arm.model, measured);
  const cli::ValidationPage page{.result = {{"y", 2}},
                                 .robot = robot,
                                 .reported = {.model = arm.model, .estimate = estimate, .measurements = measured},
                                 .warnings = {"w"},
                                 .requirements = {{{"text", "r<1"}, {"fulfilled", false}}},
                                 .doubts = {"d", "e", "f"}};
  const Json data = expect_page(cli::validation_page(page), "validation", {{"y", 2}});
  EXPECT_EQ(data["warnings"], Json(page.warnings));
  EXPECT_EQ(data["requirements"][0]["text"], "r<1");
  EXPECT_EQ(data["doubts"], Json(page.doubts));
  EXPECT_TRUE(data["robot"] == Json::parse(reported_robot(robot, arm.model, estimate)));
  EXPECT_TRUE(data["measured"] == Json::parse(reported_measurements(page.reported)));
  EXPECT_EQ(data["measured"]["points"].size(), 15U);
}

}  // namespace
}  // namespace kdl_calibration::testing::report_pages_test
