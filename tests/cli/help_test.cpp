// Words in messages and help.

#include "cli/help.hpp"

#include <memory>

#include "cli/progress.hpp"
#include "cli/text.hpp"
#include "cli_support.hpp"

namespace kdl_calibration::testing::help_test {
namespace {

TEST(Help, NumbersAreReadWhole) {
  for (const auto& [text, value] : std::vector<std::pair<std::string, double>>{
           {"1", 1.0}, {"+2.5", 2.5}, {"-2.5", -2.5}, {"+3e-1", 0.3}, {"-0", 0.0}, {"1e300", 1e300}, {".5", 0.5}}) {
    ASSERT_TRUE(cli::parsed_number(text)) << text;
    EXPECT_EQ(*cli::parsed_number(text), value) << text;
  }
  for (const char* text : {"", "+", "-", "+-1", "++1", "-+1", "1 ", " 1", "1x", "0x1", "nan", "inf", "1e999", "1,5"}) {
    EXPECT_FALSE(cli::parsed_number(text)) << text;
  }
}

TEST(Help, EachSortOfMessageHasItsBeginning) {
  EXPECT_EQ(said_by([] { cli::warn("two\nlines"); }), "kdlcal: warning: two lines\n");
  EXPECT_EQ(said_by([] { cli::print_doubt("x"); }), "kdlcal: not to be trusted: x\n");
  EXPECT_EQ(said_by([] { cli::print_requirement("x"); }), "kdlcal: required: x\n");
}

TEST(Help, ProgressIsALineInTenSecondsAtMostWhereNobodyLooks) {
  double now = 0.0;
  const std::string said = said_by([&] {
    cli::Progress stages({}, [&] { return now; });
    cli::Progress share("choosing", [&] { return now; });
    for (const double time : {0.0, 9.9, 10.0, 19.9, 21.0, 30.0, 31.0}) {
      now = time;
      stages(time < 20.0 ? "trying gain" : "leave-one-out", static_cast<std::size_t>(time), 40);
    }
    share(0.405);
  });
  EXPECT_EQ(said,
            "kdlcal: trying gain: 10/40 done\nkdlcal: leave-one-out: 21/40 done\nkdlcal: leave-one-out: 31/40 done\n"
            "kdlcal: choosing: 40 % done\n");
}

TEST(Help, TheNearestWordHasTheFewestLettersChanged) {
  const std::vector<std::string> words = {"calibrate", "validate", "plan", "model"};
  for (const auto& [mistyped, expected] : std::vector<std::pair<std::string, std::string>>{{"calibrat", "calibrate"},
                                                                                           {"calibraet", "calibrate"},
                                                                                           {"caliXbrate", "calibrate"},
                                                                                           {"cXlibXate", "calibrate"},
                                                                                           {"vlidate", "validate"},
                                                                                           {"plna", "plan"},
                                                                                           {"plan", "plan"},
                                                                                           {"modle", "model"},
                                                                                           {"pXXn", ""},
                                                                                           {"", ""},
                                                                                           {"something", ""}}) {
    EXPECT_EQ(cli::nearest(mistyped, words), expected) << mistyped;
  }
  EXPECT_EQ(cli::nearest("ab", {"abc", "abd"}), "abc") << "the first of several";
}

TEST(Help, HelpPutsDescriptionsInAColumnOrBelowALongName) {
  CLI::App app;
  const auto formatter = std::make_shared<cli::HelpFormatter>();
  const std::string description = "What this is, in so many words that they do not fit into what is left of a line";
  const std::string lines =
      "What this is, in so many words that they do not\n" + std::string(30, ' ') + "fit into what is left of a line\n";
  ASSERT_EQ(formatter->get_column_width(), 30U);
  for (const std::size_t letters : {1U, 24U, 25U, 40U}) {
    const std::string name = "--" + std::string(letters, 'x');
    const std::string shown = formatter->make_option(app.add_flag(name, description), false);
    const std::string gap = letters < 25 ? std::string(26 - letters, ' ') : "\n" + std::string(30, ' ');
    EXPECT_EQ(shown, "  " + name + gap + lines) << letters << " letters";
  }
  EXPECT_EQ(formatter->make_description(&app), "");
  EXPECT_EQ(formatter->make_description(app.description("Few words")), "Few words\n");
  cli::add_group(app, "Letters", {"--x"});
  EXPECT_EQ(app.get_option("--x")->get_group(), "Letters");
  EXPECT_NE(app.get_option("--" + std::string(24, 'x'))->get_group(), "Letters");
}

}  // namespace
}  // namespace kdl_calibration::testing::help_test
