#include "base/wrapped_text.hpp"

#include <gtest/gtest.h>

namespace kdl_calibration::wrapped_text_test {
namespace {

TEST(WrappedText, BreaksAtBlanksOnlyWhereALineWouldBeTooLong) {
  EXPECT_EQ(wrapped("one two three", 0, 0, 13), "one two three\n");
  EXPECT_EQ(wrapped("one two three", 0, 0, 12), "one two\nthree\n");
  EXPECT_EQ(wrapped("one two three", 0, 0, 7), "one two\nthree\n");
  EXPECT_EQ(wrapped("one two three", 0, 0, 6), "one\ntwo\nthree\n");
  EXPECT_EQ(wrapped("", 0, 0, 6), "\n");
}

TEST(WrappedText, IndentsTheFirstLineAndTheOthers) {
  EXPECT_EQ(wrapped("one two three", 2, 4, 9), "  one two\n    three\n");
  EXPECT_EQ(wrapped("one two three", 2, 4, 8), "  one\n    two\n    three\n");
}

TEST(WrappedText, GivesALongWordALineOfItsOwn) {
  EXPECT_EQ(wrapped("a /very/long/name b", 0, 1, 6), "a\n /very/long/name\n b\n");
}

TEST(WrappedText, CountsCharactersAndNotBytes) {
  EXPECT_EQ(wrapped("\u00e4\u00e4\u00e4 \u00e4\u00e4", 0, 0, 6), "\u00e4\u00e4\u00e4 \u00e4\u00e4\n");
}

}  // namespace
}  // namespace kdl_calibration::wrapped_text_test
