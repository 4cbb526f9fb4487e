#pragma once

#include <fmt/core.h>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/explanations.hpp"
#include "kdl_calibration/doubt.hpp"

namespace kdl_calibration {

/// An alternative, and how it is said.
struct MistakeTrial {
  Cause cause = Cause::scale;
  std::string subject = {};  ///< what it concerns, in words
  std::vector<Subject> subjects = {};
  const char* unit = "";  ///< of its estimate, if that is a single number: "mm" for [m], "mrad", or "%" of a factor
  double scale = 1.0;     ///< divides its estimate, if that is a single number
  AlternativeSums sums = {};
  AlternativeMotion motion = {};
  std::function<std::string(const Explained&)> words = {};
  double largest = std::numeric_limits<double>::infinity();  ///< estimate for which it is linear
  double least = 0.0;                                        ///< estimate that is not in the uncertainties already
  std::optional<std::string> alone = std::nullopt;           ///< label of the only configuration that it concerns
  bool is_mistake = true;  ///< false: an unusual arm. A mistake that explains less is not reported
};

/// The best of several trials by their first evidence, and how many there were.
struct MistakeFamily {
  double trials = 0.0;
  double evidence = -1e300;
  std::optional<MistakeTrial> best;
  std::vector<MistakeTrial> listed;  ///< for DetectableMistake

  template <class MakeTrial>
  void add(const Explanations& explanations, const AlternativeSums& sums, MakeTrial trial, bool is_listed = true) {
    trials += 1.0;
    const double here = explanations.first_evidence(sums);
    if (here > evidence) {
      evidence = here;
      best = trial();
      best->sums = sums;
    }
    if (is_listed) {
      listed.push_back(trial());
      listed.back().sums = sums;
    }
  }
};

/// "1.23 mm"
inline std::string said_length(double metres) { return fmt::format("{:.3g} mm", metres * 1e3); }

}  // namespace kdl_calibration
