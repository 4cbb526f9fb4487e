#pragma once

#include <gtest/gtest.h>

#include <sstream>
#include <string>

namespace kdl_calibration::testing {

/// A figure for the test's report (--gtest_output=xml).
template <class Value>
void record(const std::string& name, const Value& value) {
  std::ostringstream text;
  text << value;
  ::testing::Test::RecordProperty(name, text.str());
}

}  // namespace kdl_calibration::testing
