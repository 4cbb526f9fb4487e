// kdlcal compare and calibrate --prior-result: their output, status and refusals.

#include <fmt/format.h>
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "base/sha256.hpp"
#include "cli_options_support.hpp"
#include "kdl_calibration/result_file.hpp"
#include "kdl_calibration/validation.hpp"
#include "printed_text.hpp"
#include "report_page_support.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::compare_test {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

class Compare : public CommandLine {
protected:
  // One robot in two campaigns. Before the second one something has hit joint 2, so it moves by 1 mrad more than it
  // says.
  void SetUp() override {
    CommandLine::SetUp();
    succeed(words_of(
        "simulate --configurations 60 --noise 3e-5 --length-sigma 0.001 --angle-sigma 0.001 --output all.csv"));
    std::vector<std::vector<std::string>> rows = cells_of(text_of("all.csv"));
    const auto joint =
        static_cast<std::size_t>(std::find(rows[0].begin(), rows[0].end(), "joint_2[rad]") - rows[0].begin());
    const auto line = [&](std::size_t i) { return fmt::format("{}\n", fmt::join(rows[i], ",")); };
    std::string a = line(0);
    std::string b = a;
    for (std::size_t i = 1; i < rows.size(); ++i) {
      if (i > 90) {
        rows[i].at(joint) = fmt::format("{:.17g}", std::stod(rows[i].at(joint)) - 1e-3);
      }
      (i > 90 ? b : a) += line(i);
    }
    for (const auto& [name, text] : {std::pair{"a", a}, std::pair{"b", b}}) {
      write(name + std::string(".csv"), text);
      succeed({"calibrate", "--measurements", name + std::string(".csv"), "--effects", "none", "--prior", "none",
               "--result", name + std::string(".json")});
    }
  }
};

TEST_F(Compare, SaysWhatTheLibraryFinds) {
  const Outcome outcome = run({"compare", "a.json", "b.json", "--json"});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  const Json json = Json::parse(outcome.out);
  const Robot robot = fanuc();
  const Comparison expected =
      compare(load_calibration(directory / "a.json", robot), load_calibration(directory / "b.json", robot));
  EXPECT_EQ(json["p_value"], expected.p_value);
  EXPECT_EQ(json["changed"], true);
  EXPECT_EQ(json["flange"]["sigma"], expected.flange_sigma);
  EXPECT_EQ(json["parameters"].size(), expected.parameters.size());
  for (std::size_t i = 0; i < expected.parameters.size(); ++i) {
    const Json& parameter = json["parameters"][i];
    EXPECT_EQ(parameter["change"], expected.parameters[i].change);
    EXPECT_EQ(parameter["explained"], expected.parameters[i].explained);
    EXPECT_EQ(parameter["unit"], parameter["name"].get<std::string>().starts_with("T") ? "m" : "rad");
  }
  const Outcome written = run({"compare", "a.json", "b.json", "--report", "c.html", "--json"});
  const Json page = data_of_page(text_of("c.html"));
  EXPECT_EQ(page["kind"], "comparison");
  EXPECT_EQ(page["result"]["parameters"], json["parameters"]);
  EXPECT_EQ(page["result"]["provenance"]["files_read"][1]["sha256"], sha256(text_of("a.json")));
  const Outcome table = run({"compare", "a.json", "b.json", "--require", "p_value>=0.001"});
  EXPECT_EQ(table.status, 1);
  EXPECT_THAT(table.out, AllOf(HasSubstr("the robot has changed (p = "), HasSubstr("\n  dq2, joint_2 ")));
  const Outcome same = run({"compare", "a.json", "a.json", "--require", "p_value>=0.001"});
  EXPECT_EQ(same.status, 0) << same.err;
  EXPECT_THAT(same.out, HasSubstr("no change found (p = 1;"));
  EXPECT_THAT(same.out, Not(HasSubstr("largest changes")));
  EXPECT_THAT(same.out, HasSubstr("a changed zero does not show in joint_1, joint_6"));
  EXPECT_THAT(same.err, HasSubstr("both results are of the same measurements"));
  EXPECT_EQ(outcome.err, "");
}

TEST_F(Compare, APriorResultIsContinuedAndNotComparedAgain) {
  const Words few = {"calibrate", "--measurements", "b.csv", "--prior-result", "a.json"};
  const Outcome outcome = run(few + Words{"--result", "c.json", "--json"});
  EXPECT_EQ(outcome.status, 0) << outcome.err;
  const std::string said = run(few).out;
  EXPECT_THAT(said, HasSubstr("Changed since the earlier result (p = "));
  EXPECT_THAT(said, HasSubstr("joint_6: a"));
  const Json json = json_of("c.json");
  EXPECT_LT(json["prior_result"]["p_value"], 1e-3);
  EXPECT_EQ(json["prior_result"]["changes"][0]["name"], "dq2");
  EXPECT_EQ(json["prior_result"]["unseen_zeros"], Json({"joint_1", "joint_6"}));
  EXPECT_NEAR(json["prior_result"]["changes"][0]["change"], 1e-3, 1e-4);
  EXPECT_THAT(json["warnings"], Contains(HasSubstr("the robot has changed since the earlier result")));
  expect_refused({"compare", "a.json", "c.json"}, {"continues an earlier one"});
  expect_refused(few + Words{"--fix", "dq2"}, {"--prior-result", "no fix beside it"});
  expect_refused(few + Words{"--prior", "auto"}, {"--prior-result", "no prior beside it"});
  expect_refused({"calibrate", "--measurements", "b.csv", "--prior-result", "none.json"}, {"none.json"});
  expect_refused({"compare", "a.json"}, {"after"});
}

}  // namespace
}  // namespace kdl_calibration::testing::compare_test
