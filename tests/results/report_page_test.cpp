#include "results/report_page.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>

#include "base/json_tree.hpp"
#include "base/thinned.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "estimation/prediction.hpp"
#include "json_support.hpp"
#include "kdl_calibration/input_error.hpp"
#include "planning/simulation.hpp"
#include "refusal.hpp"
#include "report_page_support.hpp"
#include "results/report_blocks.hpp"
#include "results/result_json.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::report_page_test {
namespace {

using Json = nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr const char* kHostile = "</script><script>document.title='no'</script><!--\"'\xf0\x9f\xa4\x96";

struct Measured {
  Robot robot = fanuc();
  ErrorModel model = complete_model(robot);
  Measurements measurements;
};

// A calibrated FANUC, with so many configurations, and names of its targets.
Measured measured(int configurations, const std::vector<std::string>& targets = {"A", "B", "C"}) {
  Measured result;
  VirtualExperiment experiment({.model = result.model,
                                .targets = published_targets(static_cast<int>(targets.size())),
                                .with_errors = all_parameters(result.model),
                                .random = Random(5)});
  result.measurements = experiment.measure(configurations, {.sigma = 3e-5});
  result.measurements.targets = targets;
  return result;
}

std::string result_of(const Measured& measured, const Provenance& provenance = {}) {
  const CalibrationSettings options{.diagnosis = {.try_readings = false}};  // a page shows none
  return result_json(measured.robot, measured.measurements, calibrate(measured.model, measured.measurements, options),
                     provenance);
}

std::string page_of(const Measured& measured, const std::string& result, bool with_measurements = true,
                    const KnownFrames& known = {}) {
  return calibration_page({.result = result,
                           .source = "result",
                           .robot = &measured.robot,
                           .measurements = with_measurements ? &measured.measurements : nullptr,
                           .known = known,
                           .plan_command = "kdlcal plan"});
}

/// Of the result alone.
std::string page_of(const std::string& result) {
  return calibration_page({.result = result,
                           .source = "r.json",
                           .robot = nullptr,
                           .measurements = nullptr,
                           .known = {},
                           .plan_command = ""});
}

TEST(ReportPage, NamesThatAreMarkupStayText) {
  Measured setting = measured(20, {kHostile, "\u202eright to left", std::string(300, 'x')});
  setting.measurements.configurations[3] = "<img src=x onerror=alert(1)>{{script}}{{data}}";
  const std::string result =
      result_of(setting, {.notes = {{"<b>", "</style>&amp;"}}, .files_read = {}, .files_written = {}});
  const std::string page = page_of(setting, result);
  EXPECT_EQ(occurrences(page, "<script"), 2);
  EXPECT_EQ(occurrences(page, "</script"), 2);
  EXPECT_EQ(occurrences(page, "<img"), 0);
  EXPECT_EQ(occurrences(page, "</style"), 1);
  const Json data = data_of_page(page);
  EXPECT_EQ(data["measured"]["targets"][0], kHostile);
  EXPECT_EQ(data["measured"]["configurations"][3]["name"], "<img src=x onerror=alert(1)>{{script}}{{data}}");
  EXPECT_EQ(data["result"]["provenance"]["notes"]["<b>"], "</style>&amp;");
}

TEST(ReportPage, TakesJsonAlone) {
  const std::string page = report_page("{\"kind\": \"plan\", \"name\": \"a\"}");
  EXPECT_EQ(data_of_page(page)["name"], "a");
  EXPECT_THROW(report_page("{\"kind\": "), InputError);
}

TEST(ReportPage, LoadsNothing) {
  const Measured setting = measured(15);
  std::string page = page_of(setting, result_of(setting));
  EXPECT_THAT(page, HasSubstr("default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"));
  const std::string name_space = "http://www.w3.org/2000/svg";  // a name, which nothing fetches
  EXPECT_EQ(occurrences(page, "http"), 1 + occurrences(page, "http-equiv"));
  EXPECT_THAT(page, HasSubstr(name_space));
  for (const char* loads : {" src=", "@import", "url(", "fetch(", "XMLHttpRequest", "<link", "WebSocket"}) {
    EXPECT_THAT(page, Not(HasSubstr(loads)));
  }
}

TEST(ReportPage, DistributionsHoldTheErrorsBeforeAndAfter) {
  const Measured setting = measured(20);
  const std::string result = result_of(setting);
  const Json data = data_of_page(page_of(setting, result));
  for (const char* when : {"before", "after"}) {
    double squares = 0.0;
    const Json& distribution = data["measured"]["distributions"]["train"][when];
    for (const Json& value : distribution["values"]) {
      squares += value.get<double>() * value.get<double>();
    }
    EXPECT_NEAR(std::sqrt(squares / 60.0), data["result"]["position_error"]["train"][when]["rms"].get<double>(), 1e-12)
        << when;
  }
}

TEST(ReportPage, TheChainOfThePageIsThatOfKdl) {
  const Robot robot = parse_robot(kOddArm);
  const ErrorModel model = complete_model(robot);
  Random random(3);
  const Estimate estimate{
      .errors = random_errors(model, random, 0.01, 0.02),
      .frames = {.bases = {Eigen::Isometry3d(Eigen::Translation3d(0.3, -1.0, 0.2))}, .targets = circle_of_targets()},
      .effects = {}};
  const Json page = Json::parse(reported_robot(robot, model, estimate));
  const Eigen::VectorXd q = random_joints(model, random);
  Eigen::Isometry3d frame = Eigen::Isometry3d::Identity();
  for (const Json& segment : page["segments"]) {
    frame = frame * frame_of(segment["origin"]);
    if (segment.contains("joint")) {
      const auto joint = segment["joint"].get<std::size_t>();
      const Eigen::Vector3d axis = vector_of(segment["axis"]);
      const double value = q[static_cast<Eigen::Index>(joint)];
      if (page["joints"][joint]["type"] == "prismatic") {
        frame.translate(value * axis);
      } else {
        frame.rotate(Eigen::AngleAxisd(value, axis));
      }
    }
  }
  frame = frame * frame_of(page["tip_correction"]);
  EXPECT_LT(difference(to_kdl(frame), kdl_pose(error_chain(model, estimate.errors), q)), 1e-12);
  EXPECT_LT((frame_of(page["base"]).matrix() - estimate.frames.base().matrix()).cwiseAbs().maxCoeff(), 1e-15);
}

TEST(ReportPage, PointsHaveTheirPlaceInTheOrderOfMeasurementWhereThatIsStated) {
  Measured setting = measured(12);
  const ErrorModel& model = setting.model;
  const Estimate estimate = nominal_start(model, setting.measurements);
  const auto points = [&] {
    return Json::parse(reported_measurements(
        {.model = model, .estimate = estimate, .measurements = setting.measurements, .before = nullptr}))["points"];
  };
  EXPECT_FALSE(points()[0].contains("order"));
  const auto rows = static_cast<std::int64_t>(setting.measurements.observations.size());
  for (std::int64_t row = 0; row < rows; ++row) {
    setting.measurements.observations[static_cast<std::size_t>(row)].order = 1000 - row;
  }
  const Json with_order = points();
  ASSERT_EQ(with_order.size(), setting.measurements.observations.size());
  for (const Json& point : with_order) {
    EXPECT_EQ(point["order"], 1000 - point["row"].get<std::int64_t>());
  }
}

TEST(ReportPage, RefusesWhatIsNoResult) {
  for (const char* wrong : {"[]", "no JSON"}) {
    EXPECT_THROW(page_of(wrong), InputError) << wrong;
  }
  const auto said = [](const char* text) {
    Json json = Json::parse(text);
    json["hashes"] = tree::hashes(json);
    return testing::refusal([&] { page_of(json.dump()); });
  };
  EXPECT_THAT(said("{}"), HasSubstr("r.json: has no 'trusted', expected a result that calibrate wrote"));
  EXPECT_THAT(said(R"({"trusted": 1})"), HasSubstr("has no 'parameters'"));
  EXPECT_THAT(said(R"({"trusted": 1, "parameters": []})"), HasSubstr("has no 'position_error'"));
  EXPECT_THAT(said(R"({"trusted": true, "parameters": [], "position_error": {}, "covariance": {"names": ["a", "b"]}})"),
              HasSubstr("r.json"));
}

/// The data of the page of a result that is written by hand.
Json page_data(Json result) {
  for (const char* key : {"parameters", "position_error"}) {
    result[key] = Json::object();
  }
  result["trusted"] = true;
  result["hashes"] = tree::hashes(result);
  return data_of_page(page_of(result.dump()));
}

TEST(ReportPage, HoldsTheInfluenceOfPointsOfUpToAThousandConfigurations) {
  for (const std::size_t count : {1000U, 1001U}) {
    Json result;
    for (std::size_t c = 0; c < count; ++c) {
      result["influence"]["configurations"].push_back({{"cook", c}, {"points", {1, 2}}});
    }
    const Json influence = page_data(result)["result"]["influence"];
    EXPECT_EQ(influence["complete"], count <= 1000);
    ASSERT_EQ(influence["configurations"].size(), count);
    EXPECT_EQ(influence["configurations"][7]["cook"], 7);
    EXPECT_EQ(influence["configurations"][7].contains("points"), count <= 1000);
  }
}

TEST(ReportPage, HoldsTheRowsThatItShows) {
  for (const std::size_t count : {3000U, 3001U}) {
    Json result;
    std::vector<double> distances;
    for (std::size_t row = 0; row < count; ++row) {
      distances.push_back(static_cast<double>((row * 7919) % count));
      result["residuals"]["rows"].push_back({{"repeat", row}, {"distance", distances.back()}});
    }
    result["residuals"]["rows"][5].erase("distance");
    result["residuals"]["rows"][6]["distance"] = nullptr;
    distances[5] = distances[6] = 0.0;
    const Json residuals = page_data(result)["result"]["residuals"];
    const std::vector<std::size_t> shown = shown_rows(distances);
    EXPECT_EQ(residuals["complete"], count <= 3000);
    ASSERT_EQ(residuals["rows"].size(), shown.size());
    for (std::size_t i = 0; i < shown.size(); ++i) {
      ASSERT_EQ(residuals["rows"][i]["repeat"], shown[i]);
    }
  }
  Json largest;
  largest["residuals"]["largest"] = Json::array();
  EXPECT_EQ(page_data(largest)["result"]["residuals"]["complete"], false);
  EXPECT_FALSE(page_data(largest)["result"]["residuals"].contains("rows"));
  EXPECT_FALSE(page_data(Json::object())["result"].contains("residuals"));
}

TEST(ReportPage, HoldsCorrelationsInsteadOfTheCovariance) {
  Json result;
  result["covariance"] = Json::parse(R"({"names": ["a", "b"], "lower_triangle": [[4.0], [1.0, 1.0]]})");
  const Json data = page_data(result);
  EXPECT_EQ(data["correlations"]["strongest"], Json::parse(R"([["a", "b", 0.5]])"));
  EXPECT_FALSE(data["result"].contains("covariance"));
  result["covariance"] = nullptr;
  EXPECT_FALSE(page_data(result).contains("correlations"));
}

TEST(ReportPage, ResidualsBeforeAreOfTheFramesThatWereKnown) {
  const Measured setting = measured(12);
  const std::string result = result_of(setting);
  const KnownFrames known{.bases = {{.X_WB = Eigen::Isometry3d(Eigen::Translation3d(0.001, 0.002, 0.003))}}};
  const Json data = data_of_page(page_of(setting, result, true, known));
  const Estimate before = nominal_start(setting.model, setting.measurements, {.known = known});
  const std::vector<double> errors = position_errors(setting.model, before, setting.measurements);
  for (std::size_t i = 0; i < errors.size(); ++i) {
    EXPECT_NEAR(vector_of(data["measured"]["points"][i]["before"]).norm(), errors[i], 1e-12);
  }
}

TEST(Thinned, KeepsEndsOrderAndEvenSpacing) {
  std::vector<double> values(10'001);
  std::iota(values.begin(), values.end(), 0.0);
  std::shuffle(values.begin(), values.end(), std::mt19937(1));
  const std::vector<double> chosen = thinned(values, 100);
  ASSERT_EQ(chosen.size(), 101U);
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    EXPECT_EQ(chosen[i], 100.0 * static_cast<double>(i));
  }
  EXPECT_THAT(thinned({3.0, 1.0, 2.0}, 100), ::testing::ElementsAre(1.0, 2.0, 3.0));
}

}  // namespace
}  // namespace kdl_calibration::testing::report_page_test
