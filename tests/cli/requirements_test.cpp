// What is required of a result, and the command that plans what to measure next.

#include "cli/requirements.hpp"

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
           {"", 1.0}, {"m", 1.0}, {"mm", 1e-3}, {"um", 1e-6}, {"rad", 1.0}, {"mrad", 1e-3}, {" deg", kDegree}}) {
    const cli::Requirement requirement = cli::parse_requirement(" a.bc.1  <= 2.5" + unit + " ");
    EXPECT_EQ(requirement.text, " a.bc.1  <= 2.5" + unit + " ");
    EXPECT_THAT(requirement.path, ElementsAre("a", "bc", "1"));
    EXPECT_EQ(requirement.comparison, "<=");
    EXPECT_DOUBLE_EQ(requirement.value, 2.5 * factor) << unit;
  }
  EXPECT_THAT(cli::parse_requirement("rms==3.").path, ElementsAre("rms"));
  EXPECT_EQ(cli::parse_requirement("rms>-3e-2mm").value, -3e-5);
  const std::string form = "PATH OP VALUE such as 'leave_one_out.rms<=0.25mm'";
  for (const auto& [text, expected] :
       std::vector<std::pair<std::string, std::string>>{{"rms", form},
                                                        {"<1", form},
                                                        {"a.<1", form},
                                                        {"a..b<1", form},
                                                        {"a=1", "one of < <= > >= =="},
                                                        {"a<<1", "one of < <= > >= =="},
                                                        {"a<", "a number behind <"},
                                                        {"a>=mm", "a number behind >="},
                                                        {"a<x1", "a number behind <"},
                                                        {"a<1kg",
                                                         "a number alone or with the unit m, mm, um, rad, "
                                                         "mrad or deg"}}) {
    EXPECT_EQ(refusal([&, given = text] { cli::parse_requirement(given); }),
              "--require: '" + text + "' is not accepted, expected " + expected);
  }
  EXPECT_THAT(refusal([] { cli::parse_requirement("\xff<1"); }), HasSubstr("expected UTF-8"));
  EXPECT_EQ(cli::parse_requirements({"a<1", "b>2"}).at(1).text, "b>2");
}

TEST(Requirements, AreJudgedByTheNumberTheyLeadTo) {
  const Json json = Json::parse(R"({"rank": 33, "list": [1, 2.5], "text": "5", "none": null,
    "fit": {"after": {"rms": 0.5}, "before": {"rms": 9}, "count": 7},
    "position_error": {"train": {"after": {"rms": 0.25}}, "test": {"rms": 3}}})");
  const auto fulfilled = [&](const std::string& text) {
    return cli::outcomes_of({cli::parse_requirement(text)}, json).at(0).message.empty();
  };
  for (const char* text : {"rank==33", "rank<=33", "rank>=33", "rank<33.1", "rank>32.9", "list.0==1", "list.1==2.5",
                           "fit.rms==0.5", "fit.after.rms==0.5", "fit.before.rms==9", "fit.count==7", "train.rms==0.25",
                           "position_error.train.rms==0.25", "test.rms==3"}) {
    EXPECT_TRUE(fulfilled(text)) << text;
  }
  for (const char* text : {"rank==32", "rank<33", "rank>33", "rank<=32.9", "rank>=33.1", "list.2>0", "list.-1>0",
                           "list.x>0", "text==5", "none==0", "fit==0", "nothing>0", "rank.after==33", "train.max>0"}) {
    EXPECT_FALSE(fulfilled(text)) << text;
  }
  const std::vector<cli::Judged> outcomes =
      cli::outcomes_of(cli::parse_requirements({"rank<1", "rank>1", "none<1"}), json);
  const std::string rank = "'rank<1' is not fulfilled: the value is 33";
  const std::string none = "'none<1' is not fulfilled: the value is not determined";
  EXPECT_THAT(cli::unfulfilled(outcomes), ElementsAre(rank, none));
  EXPECT_EQ(cli::judged_json(outcomes), Json::array({{{"text", "rank<1"}, {"fulfilled", false}, {"message", rank}},
                                                     {{"text", "rank>1"}, {"fulfilled", true}, {"message", nullptr}},
                                                     {{"text", "none<1"}, {"fulfilled", false}, {"message", none}}}));
}

TEST(PlanCommandText, TheCommandThatPlansNamesTheFilesOfTheResult) {
  EXPECT_EQ(cli::shell_word("a/b_C-1.0+x=y:@%,z"), "a/b_C-1.0+x=y:@%,z");
  EXPECT_EQ(cli::shell_word(""), "''");
  EXPECT_EQ(cli::shell_word("it's $HOME"), "'it'\\''s $HOME'");
  const Json full = Json::parse(R"({"input": {"urdf": "r.urdf", "base": "b", "tip": "t", "measurements": "my m.csv"},
    "provenance": {"files_read": [{"role": "urdf", "path": "x"}, {"role": "joint-convention", "path": "c.json"}]}})");
  EXPECT_EQ(cli::plan_command(full),
            "kdlcal plan --urdf r.urdf --base b --tip t --joint-convention c.json --measured 'my m.csv' --add 10 "
            "--output plan.csv");
  const std::string least = "kdlcal plan --measured m.csv --add 10 --output plan.csv";
  for (const char* odd :
       {R"({"input": {"measurements": "m.csv"}})",
        R"({"input": {"measurements": "m.csv", "urdf": 5, "base": null}, "provenance": 7})",
        R"({"input": {"measurements": "m.csv"}, "provenance": {"files_read": {"role": "x"}}})",
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
