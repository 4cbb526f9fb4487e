#pragma once

// What functions ask of what they are given where its type does not say so. Not installed.

#include <concepts>
#include <string>
#include <utility>

namespace kdl_calibration {

/// Throws InputError: `what`, then `expected`.
[[noreturn]] void refuse_input(const std::string& what, const std::string& expected);

/// Throws InputError where there are not as many of `what` as expected.
template <std::integral Count, std::integral Expected>
void require_count(const char* what, Count count, Expected expected) {
  if (!std::cmp_equal(count, expected)) {
    refuse_input(std::to_string(count) + " " + what, std::to_string(expected));
  }
}

/// Throws InputError where there are fewer of `what` than `least`.
template <std::integral Count, std::integral Least>
void require_at_least(const char* what, Count count, Least least) {
  if (std::cmp_less(count, least)) {
    refuse_input(std::to_string(count) + " " + what, "at least " + std::to_string(least));
  }
}

/// Throws InputError where the index of `what` is none of 0 to count - 1.
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

/// Throws InputError where a standard deviation, a length or a weight is negative or not finite.
void require_sigma(const char* what, double sigma);

/// Throws InputError where numbers of `what` are not finite: `are_finite` says whether they are.
void require_finite(const char* what, bool are_finite);

/// Throws InputError where a function that `what` needs is empty.
template <class Function>
void require_function(const char* what, const Function& function) {
  if (!function) {
    refuse_input(std::string(what) + " is empty", "a function");
  }
}

}  // namespace kdl_calibration
