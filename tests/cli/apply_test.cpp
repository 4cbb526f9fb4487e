// A result after its joint zero offsets were entered on the controller.

#include <algorithm>
#include <cmath>
#include <iomanip>
#include <sstream>

#include "base/sha256.hpp"
#include "cli_support.hpp"

namespace kdl_calibration::testing::apply_test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

constexpr const char* kEntered = "joint,added,unit\njoint_2,0.25,deg\njoint_5,-2e-3,rad\n";

class Apply : public CommandLine {
protected:
  void SetUp() override {
    CommandLine::SetUp();
    succeed(
        words_of("simulate --configurations 25 --test-configurations 20 --noise 3e-5 --seed 3 --length-sigma 0.001 "
                 "--angle-sigma 0.001 --output m.csv"));
    succeed(words_of("calibrate --measurements m.csv --effects none --prior none --result r.json"));
    write("entered.csv", kEntered);
  }

  Json validated(const std::string& result, const std::string& measurements) {
    const Outcome outcome = run({"validate", "--result", result, "--measurements", measurements, "--json"});
    return Json::parse(outcome.out)["position_error"]["all"];
  }

  // The measurements with joint values as they are displayed after the entry.
  std::string after_entry() const {
    std::istringstream lines(text_of("m.csv"));
    std::ostringstream result;
    result << std::setprecision(17);
    std::string line;
    std::vector<std::string> header;
    while (std::getline(lines, line)) {
      std::vector<std::string> fields;
      std::istringstream cells(line);
      for (std::string cell; std::getline(cells, cell, ',');) {
        fields.push_back(cell);
      }
      if (header.empty() && line.front() != '#') {
        header = fields;
      } else if (line.front() != '#') {
        for (std::size_t i = 0; i < fields.size(); ++i) {
          const double shift = header.at(i) == "joint_2[rad]"   ? 0.25 * std::acos(-1.0) / 180.0
                               : header.at(i) == "joint_5[rad]" ? -2e-3
                                                                : 0.0;
          if (shift != 0.0) {
            std::ostringstream moved;
            moved << std::setprecision(17) << std::stod(fields[i]) + shift;
            fields[i] = moved.str();
          }
        }
      }
      for (std::size_t i = 0; i < fields.size(); ++i) {
        result << (i == 0 ? "" : ",") << fields[i];
      }
      result << "\n";
    }
    return result.str();
  }
};

TEST_F(Apply, PredictsWhatIsMeasuredAfterTheEntryAsWellAsBefore) {
  succeed(words_of("apply --result r.json --mastering-entered entered.csv --output a.json --output-urdf a.urdf"));
  write("later.csv", after_entry());
  const Json before = validated("r.json", "m.csv");
  const Json after = validated("a.json", "later.csv");
  EXPECT_NEAR(after["rms"].get<double>(), before["rms"].get<double>(), 1e-9);
  EXPECT_GT(validated("r.json", "later.csv")["rms"].get<double>(), 10.0 * before["rms"].get<double>());
  const Json result = json_of("a.json");
  EXPECT_EQ(result["exported_urdf"]["sha256"], sha256(text_of("a.urdf")));
  EXPECT_EQ(result["mastering_entered"]["sha256_of_earlier_result"], sha256(text_of("r.json")));
  const Outcome urdf = run(words_of("validate --urdf a.urdf --measurements later.csv --json"));
  EXPECT_NEAR(Json::parse(urdf.out)["position_error"]["all"]["rms"].get<double>(), before["rms"].get<double>(), 1e-6);
}

TEST_F(Apply, WarnsOfAnEntryThatPutsAZeroFurtherOff) {
  const std::string convention = " --joint-convention " + std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json";
  succeed(
      words_of("simulate --configurations 25 --noise 3e-5 --seed 3 --length-sigma 0.001 --angle-sigma 0.001 "
               "--output p.csv" +
               convention));
  succeed(words_of("calibrate --measurements p.csv --effects none --prior none --result p.json" + convention));
  double asked = 0.0;
  const Json result = json_of("p.json");
  for (const Json& joint : result["joint_offsets"]["joints"]) {
    asked = joint["joint"] == "J3" ? joint["add"].get<double>() : asked;
  }
  ASSERT_GT(std::abs(asked), 1e-5);
  const auto entered = [&](double value) {
    std::ostringstream text;
    text << "joint;added;unit\nJ3;" << std::setprecision(17) << value << ";rad\n";
    std::string csv = text.str();
    std::replace(csv.begin(), csv.end(), '.', ',');
    write("entered.csv", csv);
    return run(words_of("apply --result p.json --mastering-entered entered.csv --output a.json --force" + convention))
        .err;
  };
  EXPECT_THAT(entered(asked), ::testing::Not(HasSubstr("J3")));
  EXPECT_THAT(entered(-asked), HasSubstr("its zero is further off than before"));
  EXPECT_THAT(entered(0.3), HasSubstr("J3: 17.19 deg were entered where the result says to add"));
}

TEST_F(Apply, RefusesWhatWouldMixTheRobotBeforeAndAfterTheEntry) {
  succeed(words_of("apply --result r.json --mastering-entered entered.csv --output a.json"));
  EXPECT_THAT(run(words_of("report --result a.json --measurements m.csv --output a.html")).err,
              HasSubstr("were taken before the mastering was entered"));
  EXPECT_THAT(run(words_of("validate --result a.json --measurements m.csv")).err,
              HasSubstr("--measurements: were taken before the mastering of a.json was entered"));
  succeed(words_of("report --result a.json --output a.html"));
  succeed(words_of("apply --result r.json --mastering-entered entered.csv --output c.json --output-urdf c.urdf"));
  write("weld.ls", "/PROG  T\n/MN\n/POS\n/END\n");
  EXPECT_THAT(run(words_of("compensate --result c.json --urdf c.urdf --program weld.ls --output c.ls")).err,
              HasSubstr("expected the URDF that was calibrated, not a corrected one"));
  EXPECT_THAT(run(words_of("apply --result a.json --mastering-entered entered.csv --output d.json")).err,
              HasSubstr("a.json is the result after entered.csv already"));
  for (const char* results : {"r.json a.json", "a.json r.json"}) {
    const Outcome compared = run(words_of(std::string("compare ") + results));
    EXPECT_EQ(compared.status, 2) << results;
    EXPECT_THAT(compared.err, HasSubstr("a.json: is r.json after its mastering was entered"));
  }
  EXPECT_THAT(run(words_of("apply --result r.json --mastering-entered entered.csv --output r.json --force")).err,
              HasSubstr("r.json"));
  for (const auto& [text, said] : std::vector<std::pair<std::string, std::string>>{
           {"joint,added\njoint_2,1\n", "entered.csv:1: the header is another one, expected joint,added,unit"},
           {"joint,added,unit\nJ2,1,deg\n", "'J2' is no joint of the controller, expected one of joint_1"},
           {"joint,added,unit\njoint_2,1,deg\njoint_2,1,deg\n", "entered.csv:3: 'joint_2' is there twice"},
           {"joint,added,unit\njoint_2,a,deg\n", "entered.csv:2: 'a deg' is not accepted, expected a number and deg"},
           {"joint,added,unit\njoint_2,1,mm\n", "'joint_2' is a length, expected deg or rad"},
           {"joint,added,unit\n", "has no joint"}}) {
    write("entered.csv", text);
    const Outcome outcome = run(words_of("apply --result r.json --mastering-entered entered.csv --output b.json"));
    EXPECT_EQ(outcome.status, 2) << text;
    EXPECT_THAT(outcome.err, HasSubstr(said));
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::apply_test
