#pragma once

#include <gmock/gmock.h>

#include <string>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::testing {

/// What the call is refused with; says so where it is not.
template <class Call>
std::string refusal(Call&& call) {
  try {
    call();
  } catch (const InputError& error) {
    return error.what();
  }
  return "nothing was refused";
}

}  // namespace kdl_calibration::testing

/// That the call, which stands last since it may hold commas, is refused with a message that matches.
#define EXPECT_REFUSED_WITH(matcher, ...) \
  EXPECT_THAT(::kdl_calibration::testing::refusal([&] { static_cast<void>(__VA_ARGS__); }), matcher) << #__VA_ARGS__

/// The same with these words in the message.
#define EXPECT_REFUSED(words, ...) EXPECT_REFUSED_WITH(::testing::HasSubstr(words), __VA_ARGS__)
