#include "base/text.hpp"

#include <gtest/gtest.h>

#include "base/number_text.hpp"

namespace kdl_calibration::text_test {
namespace {

TEST(Text, ShowsWhatNoTerminalObeys) {
  EXPECT_EQ(printable("joint_2"), "joint_2");
  EXPECT_EQ(printable("a\x1b[2J"), "a\\x1b[2J");
  EXPECT_EQ(printable("a\tb\n"), "a\\x09b\\x0a");
  EXPECT_EQ(printable("\x7f"), "\\x7f");
  EXPECT_EQ(printable("Gelenk \xc3\xa4"), "Gelenk \xc3\xa4") << "UTF-8 stays";
  EXPECT_EQ(printable("Gelenk \xe4"), "Gelenk \\xe4") << "Latin-1 is none";
  EXPECT_EQ(shown("x"), "'x'");
}

TEST(Text, ShowsTheBeginningOfWhatIsLong) {
  EXPECT_EQ(printable(std::string(40, 'x')), std::string(40, 'x'));
  EXPECT_EQ(printable(std::string(41, 'x')), std::string(40, 'x') + "...");
  EXPECT_EQ(printable(std::string(39, 'x') + "\xc3\xa4y"), std::string(39, 'x') + "...") << "half a character";
}

// An umlaut has two bytes in UTF-8. A cut between them would leave half a character.
TEST(Text, ShortensBetweenCharacters) {
  const std::string text =
      "Gelenk \xc3\xa4u\xc3\x9f"
      "en";
  EXPECT_EQ(shortened(text, text.size()), text);
  EXPECT_EQ(shortened(text, 7), "Gelenk ...");
  EXPECT_EQ(shortened(text, 8), "Gelenk ...") << "inside the first umlaut";
  EXPECT_EQ(shortened(text, 9), "Gelenk \xc3\xa4...");
  EXPECT_EQ(shortened("\xe2\x82\xac!", 2), "...") << "inside a character of three bytes";
  for (std::size_t longest = 0; longest < text.size(); ++longest) {
    EXPECT_TRUE(is_utf8(shortened(text, longest))) << longest;
  }
}

TEST(Text, OfALineHasNoBreaks) {
  EXPECT_EQ(one_line("a\nb\rc\td\x1b"), "a b c d\\x1b");
  EXPECT_EQ(escaped("a\nb\tc\rd"), "a\nb\tc\\x0dd");
  EXPECT_EQ(escaped("\xc3\xa4"), "\xc3\xa4") << "UTF-8 stays";
  EXPECT_EQ(one_line("\xe4.csv\n"), "\\xe4.csv ") << "Latin-1 is none";
}

TEST(Text, IsPaddedToSoManyBytes) {
  EXPECT_EQ(padded("abc", 5), "abc  ");
  EXPECT_EQ(padded("abc", 2), "abc");
  EXPECT_EQ(padded("\xc3\xa4", 3), "\xc3\xa4 ");
}

TEST(NumberText, HasNoNegativeZero) {
  EXPECT_EQ(shortest(-0.0), "0");
  EXPECT_EQ(shortest(-0.1), "-0.1");
  EXPECT_EQ(shortest(1.0 / 3.0), "0.3333333333333333");
  EXPECT_EQ(fixed(-0.0004, 3), "0.000");
  EXPECT_EQ(fixed(-0.0006, 3), "-0.001");
  EXPECT_EQ(fixed(12.34567, 3), "12.346");
}

}  // namespace
}  // namespace kdl_calibration::text_test
