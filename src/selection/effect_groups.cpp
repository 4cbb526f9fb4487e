#include "selection/effect_groups.hpp"

#include <map>

#include "effects/joint_effects.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;

// What a stated temperature or payload does shows as early as sag. With fewer configurations sag would pass for it.
const std::map<EffectGroup, Index>& least_configurations() {
  static const std::map<EffectGroup, Index> least = {
      {EffectGroup::gravity, 12},  {EffectGroup::transverse, 60}, {EffectGroup::gain, 20},
      {EffectGroup::backlash, 20}, {EffectGroup::harmonics, 20},  {EffectGroup::tables, kLeastForTables},
      {EffectGroup::coupling, 20}, {EffectGroup::expansion, 12},  {EffectGroup::drift, 12},
      {EffectGroup::payload, 12}};
  return least;
}

bool is_possible(EffectGroup group, const DriveSignals& signals) {
  const std::optional<Circumstance> needed = needed_circumstance(group);
  return !needed || is_stated_of_any_link(signals, *needed);
}

}  // namespace

std::vector<EffectGroup> groups_allowed(Index configurations, const DriveSignals& signals) {
  std::vector<EffectGroup> result;
  for (const auto& [group, needed] : least_configurations()) {
    if (configurations >= needed && is_possible(group, signals)) {
      result.push_back(group);
    }
  }
  return result;
}

std::vector<NotTried> groups_not_allowed(Index configurations, const DriveSignals& signals) {
  std::map<Index, std::string> groups;
  const auto add = [&](EffectGroup group, Index needed) {
    if (configurations < needed && is_possible(group, signals)) {
      std::string& names = groups[needed];
      names += (names.empty() ? "" : ", ") + std::string(to_string(group));
    }
  };
  for (const auto& [group, needed] : least_configurations()) {
    add(group, needed);
  }
  add(EffectGroup::ripple, kLeastForRipple);
  std::vector<NotTried> result;
  for (const auto& [needed, names] : groups) {
    result.push_back({.what = names, .why = std::to_string(needed) + " configurations needed"});
  }
  return result;
}

}  // namespace kdl_calibration
