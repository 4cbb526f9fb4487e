// kdlcal export and import, and robots of DH tables: what is written is the same arm again.

#include "cli_options_support.hpp"
#include "ur10.hpp"

namespace kdl_calibration::testing::export_test {
namespace {

using ::testing::HasSubstr;

class ExportOfKdlcal : public OptionsOfKdlcal {
protected:
  void SetUp() override {
    OptionsOfKdlcal::SetUp();
    write("m.csv", measurements_csv(measured_fanuc({.sigma = 2e-5}, false)));
    calibrate({}, "");
  }

  /// Writes <name>c.urdf and <name>r.json.
  void calibrate(const Words& robot, const std::string& name) {
    const Outcome outcome = run(Words{"calibrate", "--measurements", "m.csv", "--effects", "none", "--prior", "none",
                                      "--output", name + "c.urdf", "--result", name + "r.json"} +
                                robot);
    ASSERT_EQ(outcome.status, 0) << outcome.err;
  }

  std::string exported(const std::string& format, const Words& more = {}) {
    const Outcome outcome = run(Words{"export", "--result", "r.json", "--format", format} + more);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    return outcome.out;
  }

  Json tip(const Words& robot, const std::string& joints = "0.3,-0.2,0.5,1,-1,2") {
    const Outcome outcome = run(Words{"fk", "--joints", joints, "--json"} + robot);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    Json frame = Json::parse(outcome.out)["frames"].back();
    frame.erase("name");
    return frame;
  }
};

TEST_F(ExportOfKdlcal, IsTheCalibratedArmInEveryFormat) {
  const Json expected = tip({"--urdf", "c.urdf"});
  for (const std::string format : {"dh", "mdh"}) {
    write("table.json", exported(format));
    EXPECT_EQ(Json::parse(text_of("table.json"))["convention"], format == "dh" ? "standard" : "modified");
    expect_near(tip({"--dh", "table.json"}), expected, 1e-12);
  }
  EXPECT_EQ(exported("urdf"), text_of("c.urdf"));
  EXPECT_THAT(exported("xacro-yaml"), HasSubstr("\"joint_2\": {xyz: \""));
  const std::string csv = exported("csv");
  const Json result = Json::parse(text_of("r.json"));
  int known = 0;
  for (const Json& p : result["parameters"]) {
    const std::string name = p["name"];
    if (name.find('.') == std::string::npos) {
      EXPECT_THAT(csv, HasSubstr("\n" + name + ",")) << csv;
      ++known;
    }
  }
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), known + 1) << csv;
  EXPECT_EQ(run({"export", "--result", "r.json", "--format", "mdh", "--output", "t.json"}).out, "Written: t.json\n");
  EXPECT_EQ(text_of("t.json"), exported("mdh"));
}

TEST_F(ExportOfKdlcal, HasTheOpwParametersOfAnArmThatKeptItsAngles) {
  const Outcome refused = run(words_of("export --result r.json --format opw"));
  EXPECT_EQ(refused.status, 2);
  EXPECT_THAT(refused.err, HasSubstr("no arm of OPW kinematics"));
  ASSERT_NE(run(words_of("calibrate --measurements m.csv --effects none --keep-axes=angles --result kept.json")).status,
            2);
  const Outcome outcome = run(words_of("export --result kept.json --format opw"));
  ASSERT_EQ(outcome.status, 0) << outcome.err;
  const std::string key = "  c3: ";  // along axis 4, from axis 3 to the wrist
  ASSERT_THAT(outcome.out, HasSubstr(key));
  const double c3 = std::stod(outcome.out.substr(outcome.out.find(key) + key.size()));
  const Json kept = Json::parse(text_of("kept.json"));
  const auto is_length = [](const Json& p) { return p["name"] == "Ty3"; };
  const auto length = std::find_if(kept["parameters"].begin(), kept["parameters"].end(), is_length);
  EXPECT_NEAR(c3, (*length)["value"].get<double>(), 1e-12);
}

TEST_F(ExportOfKdlcal, SaysThatEffectsAreMissing) {
  const Outcome outcome =
      run(words_of("calibrate --measurements m.csv --effects gain --prior none --result r.json --force"));
  ASSERT_NE(outcome.status, 2) << outcome.err;
  const std::string note = "Effects were found. This is the geometry of a rigid arm, fitted without them.";
  for (const std::string format : {"dh", "mdh", "xacro-yaml", "csv"}) {
    EXPECT_THAT(run({"export", "--result", "r.json", "--format", format}).out, HasSubstr(note)) << format;
  }
}

// The table is another model of the same arm: the rows are predicted as well.
TEST_F(ExportOfKdlcal, ARobotOfADhTableIsCalibratedAndExported) {
  write("dh.json", dh_of(fanuc()));
  calibrate({"--dh", "dh.json"}, "dh_");
  const Json by_urdf = Json::parse(text_of("r.json"));
  const Json by_dh = Json::parse(text_of("dh_r.json"));
  expect_near(by_dh["position_error"]["test"]["after"], by_urdf["position_error"]["test"]["after"], 1e-6);
  const Json expected = tip({"--urdf", "dh_c.urdf"});
  expect_near(tip({"--dh", "dh.json", "--result", "dh_r.json"}), expected, 1e-12);
  const Outcome outcome = run({"export", "--dh", "dh.json", "--result", "dh_r.json", "--format", "dh"});
  write("table.json", outcome.out);
  expect_near(tip({"--dh", "table.json"}), expected, 1e-12);
  const Outcome page =
      run({"report", "--dh", "dh.json", "--result", "dh_r.json", "--measurements", "m.csv", "--output", "p.html"});
  EXPECT_EQ(page.status, 0) << page.err;
  EXPECT_THAT(text_of("p.html"), HasSubstr("kdlcal plan --dh dh.json"));
  expect_refused({"report", "--dh", "table.json", "--result", "dh_r.json", "--output", "q.html"}, {"hash"});
}

TEST_F(ExportOfKdlcal, OfAUniversalRobotIsItsDescription) {
  write("ur10.urdf", kUr10);
  write("calibration.conf", kUrCalibration);
  const Outcome imported = run({"import", "--ur-calibration", "calibration.conf", "--urdf", "ur10.urdf"});
  ASSERT_EQ(imported.status, 0) << imported.err;
  write("ur10c.urdf", imported.out);
  EXPECT_EQ(run({"import", "--ur-calibration", "calibration.conf", "--urdf", "ur10.urdf", "--output", "u.urdf"}).out,
            "Written: u.urdf\n");
  EXPECT_EQ(text_of("u.urdf"), imported.out);
  succeed(words_of("simulate --urdf ur10c.urdf --length-sigma 0 --angle-sigma 0 --output u.csv --truth t.json"));
  const Outcome outcome = run({"calibrate", "--urdf", "ur10.urdf", "--measurements", "u.csv", "--result", "u.json"});
  ASSERT_NE(outcome.status, 2) << outcome.err;
  const Outcome yaml =
      run({"export", "--urdf", "ur10.urdf", "--result", "u.json", "--format", "ur-yaml", "--output", "u.yaml"});
  EXPECT_EQ(yaml.status, 0) << yaml.err;
  EXPECT_THAT(text_of("u.yaml"), HasSubstr("kinematics:\n  shoulder:\n    x: "));
  const Words again = {"import", "--ur-calibration", "u.yaml", "--urdf", "ur10.urdf", "--output", "again.urdf"};
  EXPECT_EQ(run(again).out, "Written: again.urdf\n");
  succeed({"export", "--urdf", "ur10.urdf", "--result", "u.json", "--format", "urdf", "--output", "calibrated.urdf"});
  expect_near(tip({"--urdf", "again.urdf"}), tip({"--urdf", "calibrated.urdf"}), 1e-14);
}

TEST_F(ExportOfKdlcal, RefusesWhatItCannotExport) {
  write("dh.csv", "convention,standard\njoint,a[mm],alpha[deg],d[mm],theta[deg]\nJ1,1,2,x,4\n");
  write("c.conf", kUrCalibration);
  const Words from = {"export", "--result", "r.json", "--format"};
  const std::vector<std::pair<Words, std::vector<std::string>>> cases = {
      {from + Words{"ur-yaml"}, {"is no Universal Robot", "shoulder_pan_joint"}},
      {from + Words{"step"}, {"--format", "'step'", "mdh"}},
      {{"export", "--result", "r.json"}, {"--format", "required"}},
      {{"export", "--format", "dh"}, {"--result", "--format urdf gives the nominal robot"}},
      {from + Words{"dh", "--urdf", "c.urdf"}, {"r.json", "was not made with c.urdf"}},
      {from + Words{"dh", "--output", "c.urdf"}, {"c.urdf", "--force"}},
      {from + Words{"dh", "--output", "r.json", "--force"}, {"r.json"}},
      {from + Words{"dh", "--dh", "dh.csv"}, {"dh.csv:3: d[mm]: 'x' is no number"}},
      {from + Words{"dh", "--dh", "dh.csv", "--urdf", "c.urdf"}, {"--dh", "--urdf"}},
      {{"fk", "--dh", "none.csv", "--joints", "1"}, {"none.csv"}},
      {{"import", "--ur-calibration", "c.conf"}, {"is no Universal Robot"}},
  };
  for (const auto& [words, expected] : cases) {
    expect_refused(words, expected);
  }
  EXPECT_EQ(run({"export", "--format", "urdf"}).out, fanuc().urdf);
}

}  // namespace
}  // namespace kdl_calibration::testing::export_test
