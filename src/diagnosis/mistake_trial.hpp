#pragma once

#include <fmt/core.h>
#include <functional>
#include <limits>
#include <optional>
#include <string>

#include "diagnosis/explanations.hpp"
#include "kdl_calibration/accuracy.hpp"

namespace kdl_calibration {

/// An alternative, and how it is said.
struct MistakeTrial {
  Cause cause = Cause::scale;
  AlternativeSums sums = {};
  AlternativeMotion motion = {};
  std::function<std::string(const Explained&)> words = {};
  double largest = std::numeric_limits<double>::infinity();  ///< estimate for which it is linear
  std::optional<std::string> alone = std::nullopt;           ///< label of the only configuration that it concerns
};

/// The best of several trials by their first evidence, and how many there were.
struct MistakeFamily {
  double trials = 0.0;
  double evidence = -1e300;
  std::optional<MistakeTrial> best;

  template <class MakeTrial>
  void add(const Explanations& explanations, const AlternativeSums& sums, MakeTrial trial) {
    trials += 1.0;
    if (const double here = explanations.first_evidence(sums); here > evidence) {
      evidence = here;
      best = trial();
      best->sums = sums;
    }
  }
};

/// "1.23 mm"
inline std::string said_length(double metres) { return fmt::format("{:.3g} mm", metres * 1e3); }

}  // namespace kdl_calibration
