// The page for people: which subcommands write it, by which rules, and what it refuses.

#include "base/sha256.hpp"
#include "cli_support.hpp"
#include "report_page_support.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::report_test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

class PageOfKdlcal : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    const Outcome outcome =
        run(words_of("simulate --configurations 20 --test-configurations 5 --noise 3e-5 --seed 3 --length-sigma 0.001 "
                     "--angle-sigma 0.001 --output m.csv --truth truth.json"));
    ASSERT_EQ(outcome.status, 0) << outcome.err;
  }

  void calibrate_with_page() {
    const Outcome outcome = run(
        words_of("calibrate --measurements m.csv --output c.urdf --result r.json --report c.html --note serial=R1"));
    ASSERT_EQ(outcome.status, 0) << outcome.err;
  }

  Json page(const std::string& name) const { return data_of_page(text_of(name)); }

  const std::string urdf = std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf";
};

TEST_F(PageOfKdlcal, IsMadeAgainFromTheResultWithoutAFit) {
  calibrate_with_page();
  Json expected = json_of("r.json");
  expected.erase("covariance");
  expected.erase("hashes");
  expected["residuals"]["complete"] = true;
  expected["influence"]["complete"] = true;
  EXPECT_EQ(page("c.html")["result"], expected);
  const std::string source = page("c.html")["result"]["input"]["urdf"];
  const Outcome outcome =
      run({"report", "--result", "r.json", "--urdf", source, "--measurements", "m.csv", "--output", "again.html"});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  EXPECT_EQ(outcome.out, "Written: again.html\n");
  EXPECT_TRUE(text_of("again.html") == text_of("c.html"));
}

TEST_F(PageOfKdlcal, IsMadeAgainWithTheFramesThatWereKnown) {
  const Words measured = {"--urdf",       urdf,         "--measurements",  "m.csv",
                          "--known-base", "truth.json", "--known-targets", "truth.json"};
  succeed(words_of("calibrate --effects none --prior none --result r.json --report c.html") + measured);
  succeed(words_of("report --result r.json --output again.html") + measured);
  EXPECT_TRUE(text_of("again.html") == text_of("c.html"));
}

TEST_F(PageOfKdlcal, WithoutRobotAndMeasurementsSaysWhatIsMissing) {
  calibrate_with_page();
  EXPECT_EQ(page("c.html")["missing"], Json::object());
  succeed({"report", "--result", "r.json", "--output", "alone.html"});
  const Json alone = page("alone.html");
  EXPECT_THAT(alone["missing"]["robot"], HasSubstr("URDF"));
  EXPECT_THAT(alone["missing"]["measurements"], HasSubstr("measurements"));
  succeed({"report", "--result", "r.json", "--urdf", urdf, "--output", "robot.html"});
  const Json of_robot = page("robot.html");
  EXPECT_TRUE(of_robot.contains("robot"));
  EXPECT_FALSE(of_robot.contains("measured") || of_robot.contains("effects") || of_robot["missing"].contains("robot"));
  EXPECT_THAT(of_robot["missing"]["measurements"], HasSubstr("measurements"));
}

TEST_F(PageOfKdlcal, NamesTheCommandThatPlansWhatComesNext) {
  write("with space.csv", text_of("m.csv"));
  succeed({"calibrate", "--measurements", "with space.csv", "--report", "c.html"});
  const std::string command = page("c.html")["plan_command"];
  EXPECT_THAT(command, HasSubstr("kdlcal plan --urdf "));
  EXPECT_THAT(command, HasSubstr(" --measured 'with space.csv' --add 10 --output plan.csv"));
}

TEST_F(PageOfKdlcal, OfAnotherRobotOrOtherMeasurementsIsRefused) {
  calibrate_with_page();
  expect_refused({"report", "--result", "r.json", "--urdf", "c.urdf", "--output", "x.html"}, {"c.urdf", "hash"});
  write("odd.urdf", testing::kOddArm);  // with other links
  expect_refused({"report", "--result", "r.json", "--urdf", "odd.urdf", "--output", "x.html"}, {"odd.urdf", "hash"});
  write("other.csv", text_of("m.csv") + "# more\n");
  expect_refused({"report", "--result", "r.json", "--urdf", urdf, "--measurements", "other.csv", "--output", "x.html"},
                 {"--measurements", "other.csv", "hash"});
  expect_refused({"report", "--result", "m.csv", "--output", "x.html"}, {"m.csv", "JSON"});
  expect_refused({"report", "--result", "truth.json", "--output", "x.html"}, {"truth.json", "calibrate"});
  expect_refused({"report", "--result", "r.json", "--urdf", urdf, "--measurements", "m.csv", "--joint-convention",
                  std::string(URDF_DIR) + "/none.json", "--output", "x.html"},
                 {"none.json"});
}

TEST_F(PageOfKdlcal, AsksForTheJointConventionThatTheResultWasMadeWith) {
  const std::string convention = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_serial.json";
  std::string csv = text_of("m.csv");
  for (int joint = 1; joint <= 6; ++joint) {
    const std::string urdf_name = "joint_" + std::to_string(joint);
    csv.replace(csv.find(urdf_name), urdf_name.size(), "J" + std::to_string(joint));
  }
  write("j.csv", csv);
  ASSERT_LE(
      run({"calibrate", "--measurements", "j.csv", "--joint-convention", convention, "--result", "r.json"}).status, 1);
  expect_refused({"report", "--result", "r.json", "--urdf", urdf, "--measurements", "j.csv", "--output", "x.html"},
                 {"--joint-convention", "r.json"});
}

TEST_F(PageOfKdlcal, OfAValidationHasItsNumbers) {
  calibrate_with_page();
  const Json printed =
      run_json({"validate", "--urdf", "c.urdf", "--measurements", "m.csv", "--report", "v.html", "--json"});
  const Json data = page("v.html");
  EXPECT_EQ(data["kind"], "validation");
  EXPECT_EQ(data["result"]["position_error"], printed["position_error"]);
  EXPECT_EQ(data["doubts"], Json::array());
  EXPECT_EQ(data["measured"]["points"].size(), 75U);
  EXPECT_EQ(
      data["result"]["input"],
      (Json{
          {"urdf", "c.urdf"}, {"base", "base_link"}, {"tip", "flange"}, {"configurations", 25}, {"observations", 75}}));
  const Json& files = data["result"]["provenance"]["files_read"];
  ASSERT_EQ(files.size(), 2U);
  EXPECT_EQ(files[0], (Json{{"role", "urdf"}, {"path", "c.urdf"}, {"sha256", sha256(text_of("c.urdf"))}}));
  EXPECT_EQ(files[1], (Json{{"role", "measurements"}, {"path", "m.csv"}, {"sha256", sha256(text_of("m.csv"))}}));
  // No point was measured twice: the accuracy of ISO 9283 is the error of each.
  EXPECT_EQ(data["result"]["iso_9283"]["accuracy"]["count"], 75);
  EXPECT_NEAR(data["result"]["iso_9283"]["accuracy"]["rms"], printed["position_error"]["all"]["rms"], 1e-12);
  EXPECT_TRUE(data["result"]["iso_9283"]["repeatability"].is_null());
  expect_refused({"validate", "--urdf", "c.urdf", "--measurements", "m.csv", "--report", "v.html"},
                 {"--report", "v.html", "--force"});
  expect_refused({"validate", "--result", "r.json", "--truth", "truth.json", "--report", "t.html"},
                 {"--report", "--truth"});
  const Outcome missed =
      run(words_of("validate --urdf c.urdf --measurements m.csv --report w.html --require all.rms<=0.001mm"));
  EXPECT_EQ(missed.status, 1);
  EXPECT_EQ(page("w.html")["requirements"][0]["text"], "all.rms<=0.001mm");
  EXPECT_EQ(page("w.html")["requirements"][0]["fulfilled"], false);
}

TEST_F(PageOfKdlcal, OfMonteCarloRunsHasTheirErrorsAndThePrediction) {
  const Words words = words_of(
      "simulate --configurations 20 --noise 3e-5 --monte-carlo 20 --seed 4 --length-sigma 0.0003 --angle-sigma 0.0003");
  const Json printed = run_json(words + Words{"--report", "m.html", "--json"});
  const Json data = page("m.html");
  EXPECT_EQ(data["kind"], "monte_carlo");
  EXPECT_EQ(data["result"], printed);
  for (const auto& [shown, key] :
       {std::pair{"all", "all"}, std::pair{"means", "mean_of_run"}, std::pair{"maxima", "max_of_run"}}) {
    const Json& distribution = data["distributions"][shown];
    EXPECT_EQ(distribution["count"], printed["held_out_error"][key]["count"]) << shown;
    EXPECT_EQ(distribution["values"].back(), printed["held_out_error"][key]["max"]) << shown;
  }
  EXPECT_EQ(data["distributions"]["maxima"]["values"].size(), 20U);
  EXPECT_EQ(data["predicted"]["count"], data["predicted"]["values"].size());
  EXPECT_EQ(data["setup"], Json::parse(R"([["robot", "fanuc_r2000ic_165f"], ["configurations", "20"], ["targets", "3"],
    ["noise", "0.0300 mm of a coordinate, 1 sigma"],
    ["true errors", "lengths 0.300 mm, angles 0.0172 deg, 1 sigma"], ["seed", "4"]])"));
  double squares = 0.0;
  for (const Json& sigma : data["predicted"]["values"]) {
    squares += sigma.get<double>() * sigma.get<double>();
  }
  const double predicted = std::sqrt(squares / static_cast<double>(data["predicted"]["values"].size()));
  EXPECT_NEAR(predicted / printed["held_out_error"]["all"]["rms"].get<double>(), 1.0, 0.25);
  expect_refused({"simulate", "--report", "x.html"}, {"--report", "--monte-carlo", "--two-step"});
}

}  // namespace
}  // namespace kdl_calibration::testing::report_test
