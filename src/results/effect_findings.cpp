#include "results/effect_findings.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include "base/number_text.hpp"
#include "effects/joint_effects.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

constexpr double kLeastMotion = 1e-7;  // [rad or m] smaller motions are ignored

// Two significant digits without an exponent, at most six decimals.
std::string in_digits(double value) {
  const int decimals = value > 0.0 ? std::clamp(1 - static_cast<int>(std::floor(std::log10(value))), 0, 6) : 0;
  std::string digits = fixed(value, decimals);
  if (decimals > 0) {
    digits.erase(digits.find_last_not_of('0') + 1);
    digits.erase(digits.find_last_not_of('.') + 1);
  }
  return digits;
}

std::string amount(double value, bool length) {
  return in_digits(length ? value * 1e3 : value * 180.0 / std::numbers::pi) + (length ? " mm" : " degrees");
}

// Periods per turn of the strongest harmonic.
std::string times_a_turn(const CalibrationResult& calibration, const EffectMotion& motion) {
  std::map<double, double> squares;
  for (const Eigen::Index place : motion.terms) {
    const EffectTerm& term = calibration.model.effects[static_cast<std::size_t>(place)];
    const double amplitude = calibration.fit.identification.estimate.effects[place] / term.scale;
    squares[std::get<Sinusoid>(term.function).times] += amplitude * amplitude;
  }
  const auto strongest = std::max_element(squares.begin(), squares.end(),
                                          [](const auto& a, const auto& b) { return a.second < b.second; });
  const double times = strongest->first;
  return times == 1.0 ? "once" : times == 2.0 ? "twice" : fmt::format("{:.4g} times", times);
}

bool is_mostly_of_approach(const CalibrationResult& calibration, const EffectMotion& motion) {
  double by_approach = 0.0;
  double by_load = 0.0;
  for (const Eigen::Index place : motion.terms) {
    const EffectTerm& term = calibration.model.effects[static_cast<std::size_t>(place)];
    const bool approach = std::holds_alternative<ApproachSide>(term.function);
    (approach ? by_approach : by_load) += std::abs(calibration.fit.identification.estimate.effects[place]);
  }
  return by_approach > by_load;
}

std::string in_words(const CalibrationResult& calibration, const EffectMotion& motion) {
  const MovingJoint& joint = calibration.model.joints[static_cast<std::size_t>(motion.by.joint)];
  const bool length = motion.is_length(calibration.model);
  const std::string most = amount(motion.largest(), length);
  switch (motion.by.group) {
    case EffectGroup::gravity:
      return joint.name + " deflects by up to " + most + " under the arm's weight";
    case EffectGroup::transverse:
      return joint.name + " tilts by up to " + most + " across its axis under the arm's weight";
    case EffectGroup::gain: {
      const Eigen::Index term = motion.terms.front();
      const double share = calibration.fit.identification.estimate.effects[term] /
                           calibration.model.effects[static_cast<std::size_t>(term)].scale;
      return joint.name + " moves " + in_digits(std::abs(share) * 100.0) + " % " +
             (share > 0.0 ? "further" : "less far") + " than it is told";
    }
    case EffectGroup::backlash:
      return joint.name + " has a play of " + amount(motion.highest - motion.lowest, length) +
             (is_mostly_of_approach(calibration, motion) ? " between coming from one side and from the other"
                                                         : " between one side of its load and the other");
    case EffectGroup::harmonics:
      return joint.name + " swings by up to " + most + ", mostly " + times_a_turn(calibration, motion) + " a turn";
    case EffectGroup::ripple:
      return joint.name + " ripples by up to " + most + ", mostly " + times_a_turn(calibration, motion) + " a turn";
    case EffectGroup::tables:
      return joint.name + " is off by up to " + most + " along its range";
    case EffectGroup::torque:
      return joint.name + " deflects by up to " + most + " under its measured torque";
    case EffectGroup::coupling:
      return joint.name + " moves by up to " + most + " with the joints before it";
    case EffectGroup::expansion:
      return "the link before " + joint.name + " grew and shrank by up to " + most + " with the temperature";
    case EffectGroup::drift:
      return joint.name + " drifted by up to " + most + " with the temperature";
    case EffectGroup::payload:
      return joint.name + " deflects by up to " + most + " under the payload";
    case EffectGroup::own: {
      const EffectTerm& term = calibration.model.effects[static_cast<std::size_t>(motion.terms.front())];
      return joint.name + " moves by up to " + most + " by " + std::get<OwnFunction>(term.function).effect;
    }
  }
  return {};
}

// [m^2] Mean square held-out error with the first `count` of the chosen groups.
std::optional<double> left_with(const std::vector<ModelOption>& tried, std::size_t count) {
  const ModelOption& chosen = tried.front();
  const std::vector<std::string> names(chosen.effects.begin(),
                                       chosen.effects.begin() + static_cast<std::ptrdiff_t>(count));
  const auto found = std::find_if(tried.begin(), tried.end(), [&](const ModelOption& option) {
    return option.sized == chosen.sized && option.effects == names && std::isfinite(option.held_out_rms);
  });
  return found != tried.end() ? std::optional(found->held_out_rms * found->held_out_rms) : std::nullopt;
}

std::string explained_by(const std::vector<ModelOption>& tried, const std::string& group) {
  if (tried.empty()) {
    return {};
  }
  const std::vector<std::string>& chosen = tried.front().effects;
  const auto place = static_cast<std::size_t>(std::find(chosen.begin(), chosen.end(), group) - chosen.begin());
  if (place == chosen.size()) {
    return {};
  }
  const std::optional<double> all = left_with(tried, 0);
  const std::optional<double> before = left_with(tried, place);
  const std::optional<double> after = left_with(tried, place + 1);
  if (!all || !before || !after || !(*all > 0.0)) {
    return {};
  }
  const double share = std::round(100.0 * (*before - *after) / *all);
  return share > 0.0 ? "; that explains " + in_digits(share) + " % of what geometry leaves" : "";
}

}  // namespace

double EffectMotion::largest() const { return std::max(std::abs(lowest), std::abs(highest)); }

bool EffectMotion::is_length(const ErrorModel& model) const {
  return kdl_calibration::is_length(model, model.effects[static_cast<std::size_t>(terms.front())]);
}

std::vector<EffectMotion> effect_motions(const CalibrationResult& calibration, const Measurements& measurements) {
  std::vector<EffectMotion> result;
  if (calibration.model.effects.empty()) {
    return result;
  }
  const Eigen::MatrixXd basis = effect_basis(calibration.model, measurements.joint_values, measurements.signals);
  const Eigen::VectorXd& values = calibration.fit.identification.estimate.effects;
  for (const auto& [key, terms] : terms_by_motion(calibration.model)) {
    const Eigen::RowVectorXd motion = values(terms).transpose() * basis(terms, Eigen::all);
    result.push_back({.by = key, .terms = terms, .lowest = motion.minCoeff(), .highest = motion.maxCoeff()});
  }
  return result;
}

std::vector<std::string> effect_findings(const CalibrationResult& calibration,
                                         const std::vector<EffectMotion>& motions) {
  std::map<EffectGroup, EffectMotion> most;
  for (const EffectMotion& motion : motions) {
    if (motion.largest() < kLeastMotion) {
      continue;
    }
    const auto [found, is_new] = most.try_emplace(motion.by.group, motion);
    if (!is_new && motion.largest() > found->second.largest()) {
      found->second = motion;
    }
  }
  std::vector<std::string> result;
  result.reserve(most.size());
  for (const auto& [group, motion] : most) {
    result.push_back(in_words(calibration, motion) + explained_by(calibration.selection.tried, to_string(group)));
  }
  return result;
}

}  // namespace kdl_calibration
