// What is required of a result, and the command that plans what to measure next.

#include "cli/requirements.hpp"

#include <filesystem>
#include <string>
#include <vector>

#include "cli/plan_command.hpp"
#include "cli_support.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::requirements_test {
namespace {

using cli::Json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

TEST(Requirements, HaveAPathAComparisonAndAValueInSi) {
  for (const auto& [unit, factor] : std::vector<std::pair<std::string, double>>{
           {"m", 1.0}, {"mm", 1e-3}, {"um", 1e-6}, {"rad", 1.0}, {"mrad", 1e-3}, {" deg", kDegree}}) {
    const cli::Requirement requirement = cli::parse_requirement(" parameters.1.value  <= 2.5" + unit + " ");
    EXPECT_EQ(requirement.text, " parameters.1.value  <= 2.5" + unit + " ");
    EXPECT_THAT(requirement.path, ElementsAre("parameters", "1", "value"));
    EXPECT_EQ(requirement.comparison, "<=");
    EXPECT_DOUBLE_EQ(requirement.value, 2.5 * factor) << unit;
  }
  EXPECT_THAT(cli::parse_requirement("rank==3.").path, ElementsAre("rank"));
  EXPECT_EQ(cli::parse_requirement("test.rms>-3e-2mm").value, -3e-5);
  EXPECT_EQ(cli::parse_requirement("test.rms>0").value, 0.0);
  EXPECT_THAT(cli::parse_requirement("effects.circumstances.link_temperatures.link_2<30").path,
              ElementsAre("effects", "circumstances", "link_temperatures", "link_2"));
  const std::string form = "PATH OP VALUE such as 'leave_one_out.rms<=0.25mm'";
  const std::string unit = "a unit behind the number: m, mm, um, rad, mrad or deg";
  for (const auto& [text, expected] : std::vector<std::pair<std::string, std::string>>{
           {"rms", form},
           {"<1", form},
           {"rank.<1", form},
           {"test..rms<1", form},
           {"rank=1", "one of < <= > >= =="},
           {"rank<<1", "one of < <= > >= =="},
           {"rank<", "a number behind <"},
           {"rms>=mm", "a number behind >="},
           {"rank<x1", "a number behind <"},
           {"rms<1kg", "a number alone or with the unit m, mm, um, rad, mrad or deg"},
           {"test.max<=0.4", unit},
           {"noise.sigma<1", unit},
           {"rank<33mm", "no unit, as this is a number"},
           {"leave_one_ot.rms<1mm", "names of a result, and 'leave_one_ot' is none, such as leave_one_out"},
           {"test.rmse<1mm", "names of a result, and 'rmse' is none, such as rms"},
           {"quite.unlike<1mm", "names of a result, and 'quite' is none"},
           {"test.after<1mm", "a number, such as after.rms"}}) {
    EXPECT_EQ(refusal([&, given = text] { cli::parse_requirement(given); }),
              "--require: '" + text + "' is not accepted, expected " + expected);
  }
  EXPECT_THAT(refusal([] { cli::parse_requirement("\xff<1"); }), HasSubstr("expected UTF-8"));
  EXPECT_EQ(cli::parse_requirements({"rank<1", "rank>2"}).at(1).text, "rank>2");
}

// The sources that write the JSON of the commands with --require, as one text.
std::string writers_of_results() {
  namespace fs = std::filesystem;
  const fs::path src = fs::path(PROJECT_DIR) / "src";
  std::vector<fs::path> files = {src / "cli/calibrate.cpp", src / "cli/compare.cpp", src / "cli/validate.cpp"};
  for (const char* wing : {"results", "diagnosis", "calibration"}) {  // the last two name the figures of doubts
    for (const auto& entry : fs::directory_iterator(src / wing)) {
      const std::string stem = entry.path().stem();
      if (entry.path().extension() == ".cpp" && !stem.starts_with("report_") && stem != "saved_calibration") {
        files.push_back(entry.path());
      }
    }
  }
  std::string text;
  for (const fs::path& file : files) {
    text += CommandLine::content(file);
  }
  return text;
}

// The converse, that each number of a result may be required, is a test of calibrate.
TEST(Requirements, KnowNoNameThatNoResultHas) {
  const std::string text = writers_of_results();
  for (const std::string& name : cli::names_in_paths()) {
    if (name != "left_out" && name != "turn_sigma") {  // as the table calls it; a name with another one's end
      EXPECT_TRUE(text.find('"' + name + '"') != std::string::npos) << name;
    }
  }
}

// ISO 14253-1. By hand: 8 configurations of 2 targets, u = hypot(0.4 / sqrt(2 * 8), 0.05) = 0.1118 mm.
TEST(Requirements, KeepTheirLimitsByAGuardBand) {
  const Json json = Json::parse(R"({"targets": [{}, {}], "rank": 5, "input": {"configurations": 8},
    "position_error": {"train": {"before": {"rms": 9}, "after": {"rms": 0.0004, "max": 0.001, "count": 160}},
                       "test": {"after": {"rms": 0.0004, "count": 4}}},
    "new_point": {"configurations": 8, "compensated": 0.0012},
    "predicted_accuracy": {"budget": {"of_assumptions": 0.00005, "coverage_factor": 2, "degrees_of_freedom": 50,
                                      "total": 0.001}},
    "parameters": [{"name": "dq2", "error": 0.002, "std": 0.0001}, {"name": "A.x", "error": 1.0, "std": 0.1}]})");
  const auto met = [&](const std::string& text, double guard = 2.0) {
    return cli::outcomes_of({cli::parse_requirement(text)}, json, guard).at(0).is_met;
  };
  const double u = std::hypot(0.4 / std::sqrt(2.0 * 8.0), 0.05);
  EXPECT_NEAR(cli::outcomes_of({cli::parse_requirement("train.rms<1mm")}, json, 2.0).at(0).uncertainty, u * 1e-3,
              1e-12);
  for (const auto& [text, is_met] : std::vector<std::pair<std::string, bool>>{
           {"train.rms<=0.63mm", true},  // 0.4 + 2 * 0.1118 = 0.6236
           {"train.rms<=0.62mm", false},
           {"train.rms>=0.17mm", true},  // from below as well
           {"train.rms>=0.18mm", false},
           {"test.rms<=0.82mm", true},  // 4 points of 2 targets: 2 configurations, u = hypot(0.2, 0.05)
           {"test.rms<=0.81mm", false},
           {"new_point.compensated<=1.81mm", true},  // 1.2 + 2 * 1.2 / 4
           {"new_point.compensated<=1.79mm", false},
           {"predicted_accuracy.budget.total<=1.21mm", true},  // 1 + 2 * 1 / 10
           {"predicted_accuracy.budget.total<=1.19mm", false},
           {"parameters.0.error<=2.21mm", true},
           {"parameters.0.error<=2.19mm", false},
           {"parameters.dq2.error<=2.21mrad", true},
           {"parameters.dq2.error<=2.19mrad", false},
           {"rank>=5", true}}) {
    EXPECT_EQ(met(text), is_met) << text;
  }
  EXPECT_TRUE(met("train.rms<=0.41mm", 0.0));
  EXPECT_THAT(refusal([&] { met("train.max<=2mm"); }), ::testing::HasSubstr("as --guard needs the uncertainty"));
  EXPECT_THAT(refusal([&] { met("train.rms==0.4mm"); }), ::testing::HasSubstr("expected a limit, as --guard is given"));
}

TEST(Requirements, AreJudgedByTheNumberTheyLeadTo) {
  const Json json = Json::parse(R"({"rank": 33, "weights": [1, 2.5], "count": "5", "condition": null,
    "noise": {"after": {"rms": 0.5}, "before": {"rms": 9}, "count": 7},
    "position_error": {"train": {"after": {"rms": 0.25}}, "test": {"rms": 3}, "leave_one_out": {"rms": 4}},
    "predicted_accuracy": {"budget": {"total": 6}}})");
  const auto fulfilled = [&](const std::string& text) {
    return cli::outcomes_of({cli::parse_requirement(text)}, json).at(0).is_met;
  };
  for (const char* text :
       {"rank==33", "rank<=33", "rank>=33", "rank<33.1", "rank>32.9", "weights.0==1", "weights.1==2.5",
        "noise.rms==0.5m", "noise.after.rms==500mm", "noise.before.rms==9m", "noise.count==7", "train.rms==0.25m",
        "position_error.train.rms==0.25m", "test.rms==3m", "left_out.rms==4m"}) {
    EXPECT_TRUE(fulfilled(text)) << text;
  }
  for (const char* text : {"rank==32", "rank<33", "rank>33", "rank<=32.9", "rank>=33.1", "weights.2>0", "weights.-1>0",
                           "count==5", "condition==0", "iterations>0", "train.max>0"}) {
    EXPECT_FALSE(fulfilled(text)) << text;
  }
  EXPECT_EQ(
      refusal([&] { fulfilled("budget.total<7m"); }),
      "--require: 'budget.total<7m' is not accepted, expected the whole path, which begins with predicted_accuracy.");
  EXPECT_EQ(cli::outcomes_of({cli::parse_requirement("test.max<1m")}, Json::object()).at(0).value,
            "not determined, as no rows are marked as test");
  const std::vector<cli::Judged> outcomes =
      cli::outcomes_of(cli::parse_requirements({"rank<1", "train.rms<1m", "condition<1", "train.rms<=2mm"}), json);
  const std::string rank = "'rank<1' is not fulfilled: the value is 33";
  const std::string none = "'condition<1' is not fulfilled: the value is not determined";
  const std::string rms = "'train.rms<=2mm' is not fulfilled: the value is 250 mm";
  EXPECT_THAT(cli::unfulfilled(outcomes), ElementsAre(rank, none, rms));
  EXPECT_EQ(cli::outcome_lines(outcomes),
            "\nrequired rank<1: 33, NOT met\nrequired train.rms<1m: 0.25 m, met\n"
            "required condition<1: not determined, NOT met\nrequired train.rms<=2mm: 250 mm, NOT met\n");
  EXPECT_EQ(cli::outcome_lines({}), "");
  EXPECT_EQ(cli::judged_json(outcomes)[1],
            (Json{{"text", "train.rms<1m"}, {"value", "0.25 m"}, {"fulfilled", true}, {"message", nullptr}}));
  EXPECT_EQ(cli::judged_json(outcomes)[0],
            (Json{{"text", "rank<1"}, {"value", "33"}, {"fulfilled", false}, {"message", rank}}));
}

TEST(PlanCommandText, TheCommandThatPlansNamesTheFilesOfTheResult) {
  EXPECT_EQ(cli::shell_word("a/b_C-1.0+x=y:@%,z"), "a/b_C-1.0+x=y:@%,z");
  EXPECT_EQ(cli::shell_word(""), "''");
  EXPECT_EQ(cli::shell_word("it's $HOME"), "'it'\\''s $HOME'");
  const Json full = Json::parse(R"({"input": {"urdf": "r.urdf", "base": "b", "tip": "t", "measurements": "my m.csv"},
    "provenance": {"files_read": [{"role": "urdf", "path": "x"}, {"role": "joint-convention", "path": "c.json"},
      {"role": "joints-file", "path": "j.csv"}], "options": {"--point-names": "C{configuration} {target}", "--x": "y"},
      "planned_cell": "--frame world --keep-out-box -1,2,3,4,5,6"}})");
  EXPECT_EQ(cli::plan_command(full),
            "kdlcal plan --urdf r.urdf --base b --tip t --joint-convention c.json --measured 'my m.csv' "
            "--joints-file j.csv --point-names 'C{configuration} {target}' --frame world --keep-out-box -1,2,3,4,5,6 "
            "--add 10 --output plan.csv");
  const std::string least = "kdlcal plan --measured m.csv --add 10 --output plan.csv";
  for (const char* odd :
       {R"({"input": {"measurements": "m.csv"}})",
        R"({"input": {"measurements": "m.csv", "urdf": 5, "base": null}, "provenance": 7})",
        R"({"input": {"measurements": "m.csv"}, "provenance": {"files_read": {"role": "x"}}})",
        R"({"input": {"measurements": "m.csv"}, "provenance": {"options": 3, "planned_cell": "--box $id;x"}})",
        R"({"input": {"measurements": "m.csv"}, "provenance": {"planned_cell": "--output x"}})",
        R"({"input": {"measurements": "m.csv"}, "provenance": {"files_read": [3, {"path": "p"}]}})"}) {
    EXPECT_EQ(cli::plan_command(Json::parse(odd)), least) << odd;
  }
  for (const char* none : {"[]", "5", "{}", R"({"input": 5})", R"({"input": {"urdf": "r"}})",
                           R"({"input": {"measurements": ["m.csv"]}})"}) {
    EXPECT_EQ(cli::plan_command(Json::parse(none)), "") << none;
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::requirements_test
