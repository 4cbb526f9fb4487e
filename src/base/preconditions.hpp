#pragma once

// Checks of preconditions that types do not express.

#include <concepts>
#include <string>
#include <utility>

namespace kdl_calibration {

/// Throws InputError: `what`, then `expected`.
[[noreturn]] void refuse_input(const std::string& what, const std::string& expected);

/// Throws InputError if the number of `what` is not the expected one.
template <std::integral Count, std::integral Expected>
void require_count(const char* what, Count count, Expected expected) {
  if (!std::cmp_equal(count, expected)) {
    refuse_input(std::to_string(count) + " " + what, std::to_string(expected));
  }
}

/// Throws InputError if there are fewer than `least` of `what`.
template <std::integral Count, std::integral Least>
void require_at_least(const char* what, Count count, Least least) {
  if (std::cmp_less(count, least)) {
    refuse_input(std::to_string(count) + " " + what, "at least " + std::to_string(least));
  }
}

/// Throws InputError if the index of `what` is not within 0 to count - 1.
template <std::integral Index, std::integral Count>
void require_index(const char* what, Index index, Count count) {
  if (std::cmp_less(index, 0) || !std::cmp_less(index, count)) {
    refuse_input(std::string(what) + " " + std::to_string(index) + " is not there",
                 "an index below " + std::to_string(count));
  }
}

template <class Indices, std::integral Count>
void require_indices(const char* what, const Indices& indices, Count count) {
  for (const auto index : indices) {
    require_index(what, index, count);
  }
}

/// Throws InputError if a standard deviation, length or weight is negative, not finite or above 1e12.
void require_sigma(const char* what, double sigma);

/// Throws InputError if `are_finite` is false.
void require_finite(const char* what, bool are_finite);

/// Throws InputError if the function is empty; `what` names it.
template <class Function>
void require_function(const char* what, const Function& function) {
  if (!function) {
    refuse_input(std::string(what) + " is empty", "a function");
  }
}

}  // namespace kdl_calibration
