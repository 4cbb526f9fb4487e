#include "estimation/unknowns.hpp"

#include <algorithm>
#include <map>
#include <utility>

#include "model/kinematics.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::VectorXd;

constexpr std::array<UnknownGroup, kUnknownGroups> kGroups = {UnknownGroup::base, UnknownGroup::geometric,
                                                              UnknownGroup::effects, UnknownGroup::targets};
constexpr std::array<int, 6> kNotFree = {-1, -1, -1, -1, -1, -1};

std::size_t number_of(UnknownGroup group) { return static_cast<std::size_t>(group); }

std::vector<Unknown> listed_errors(const ErrorModel& model) {
  std::vector<Unknown> result;
  for (const ErrorParameter& parameter : model.parameters) {
    result.push_back({.name = parameter.name, .length = is_length(model, parameter)});
  }
  return result;
}

std::vector<Unknown> listed_effects(const ErrorModel& model) {
  std::vector<Unknown> result;
  for (const EffectTerm& effect : model.effects) {
    result.push_back({.name = effect.name, .length = is_length(model, effect), .sigma = effect.sigma});
  }
  return result;
}

double prior_of_error(const Priors& priors, const Unknown& error) {
  return error.length ? priors.length : priors.angle;
}

double prior_of_effect(const Priors&, const Unknown& effect) { return effect.sigma; }

// Groups of unknowns that move by addition, with the model's list and prior sigma. A new group needs an entry here and
// in UnknownGroup.
struct Values {
  UnknownGroup group;
  VectorXd Estimate::*values;
  std::vector<Unknown> (*listed)(const ErrorModel&);
  double (*prior)(const Priors&, const Unknown&);
};
constexpr std::array<Values, 2> kValues = {
    {{UnknownGroup::geometric, &Estimate::errors, listed_errors, prior_of_error},
     {UnknownGroup::effects, &Estimate::effects, listed_effects, prior_of_effect}}};

// nullptr for frames, which do not move by addition.
const Values* values_of(UnknownGroup group) {
  const auto* const found =
      std::find_if(kValues.begin(), kValues.end(), [&](const Values& values) { return values.group == group; });
  return found == kValues.end() ? nullptr : found;
}

// Zero if the estimate has no values of the group.
double value_at(const VectorXd& values, std::size_t index) {
  return values.size() == 0 ? 0.0 : values[static_cast<Index>(index)];
}

// All unknowns of a group, in the order of their index.
std::vector<Unknown> listed(UnknownGroup group, const ErrorModel& model, const std::vector<TargetFrame>& targets) {
  if (const Values* values = values_of(group)) {
    std::vector<Unknown> result = values->listed(model);
    for (std::size_t i = 0; i < result.size(); ++i) {
      result[i].group = group;
      result[i].index = i;
    }
    return result;
  }
  std::vector<Unknown> result;
  const auto add_frame = [&](const std::vector<std::string>& names, std::size_t first) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      result.push_back({.group = group, .index = first + i, .name = names[i], .length = i % 6 < 3});
    }
  };
  if (group == UnknownGroup::base) {
    add_frame(base_parameter_names(model), 0);
    return result;
  }
  for (std::size_t k = 0; k < targets.size(); ++k) {
    add_frame(target_parameter_names(targets[k]), 6 * k);
  }
  return result;
}

// The part of a step for one frame.
Vector6d motion_of(const VectorXd& step, const std::array<int, 6>& columns) {
  Vector6d motion = Vector6d::Zero();
  for (std::size_t i = 0; i < 6; ++i) {
    if (columns[i] >= 0) {
      motion[static_cast<Index>(i)] = step[columns[i]];
    }
  }
  return motion;
}

void take_motion(const Vector6d& motion, const std::array<int, 6>& columns, VectorXd& step) {
  for (std::size_t i = 0; i < 6; ++i) {
    if (columns[i] >= 0) {
      step[columns[i]] = motion[static_cast<Index>(i)];
    }
  }
}

}  // namespace

Unknowns::Unknowns(const ErrorModel& model, const std::vector<TargetFrame>& targets,
                   const std::vector<std::string>& names)
    : targets_(targets) {
  std::vector<Unknown> all;
  for (const UnknownGroup group : kGroups) {
    std::vector<Unknown> own = listed(group, model, targets);
    listed_[number_of(group)] = static_cast<Index>(own.size());
    std::move(own.begin(), own.end(), std::back_inserter(all));
  }
  std::map<std::string, std::size_t> places;
  for (std::size_t i = 0; i < all.size(); ++i) {
    places.emplace(all[i].name, i);
  }
  std::vector<Unknown> free;
  for (const std::string& name : names) {
    const auto place = places.find(name);
    if (place == places.end()) {
      parameter_index(model, name);  // throws: neither frame, effect nor parameter
    }
    free.push_back(all[place->second]);
  }
  arrange(std::move(free));
}

void Unknowns::arrange(std::vector<Unknown> unknowns) {
  const auto place = [](const Unknown& unknown) { return std::pair(unknown.group, unknown.index); };
  std::sort(unknowns.begin(), unknowns.end(), [&](const Unknown& a, const Unknown& b) { return place(a) < place(b); });
  const auto end = std::unique(unknowns.begin(), unknowns.end(),
                               [&](const Unknown& a, const Unknown& b) { return place(a) == place(b); });
  unknowns.erase(end, unknowns.end());
  columns_ = std::move(unknowns);
  indices_ = {};
  base_columns_.clear();
  target_columns_.assign(targets_.size(), kNotFree);
  for (std::size_t column = 0; column < columns_.size(); ++column) {
    const auto& [group, index] = place(columns_[column]);
    indices_[number_of(group)].push_back(index);
    if (group == UnknownGroup::base) {
      base_columns_.resize(std::max(base_columns_.size(), index / 6 + 1), kNotFree);
      base_columns_[index / 6][index % 6] = static_cast<int>(column);
    } else if (group == UnknownGroup::targets) {
      target_columns_[index / 6][index % 6] = static_cast<int>(column);
    }
  }
}

Unknowns Unknowns::with(const ErrorModel& model, UnknownGroup group, const std::vector<std::size_t>& indices) const {
  std::vector<TargetFrame> whole_frames = targets_;
  for (TargetFrame& target : whole_frames) {
    target.with_orientation = true;
  }
  const std::vector<Unknown> all = listed(group, model, whole_frames);
  Unknowns result = *this;
  result.listed_[number_of(group)] = static_cast<Index>(all.size());
  std::vector<Unknown> unknowns = without(group).columns_;
  for (const std::size_t index : indices) {
    unknowns.push_back(all[index]);
  }
  result.arrange(std::move(unknowns));
  return result;
}

Unknowns Unknowns::with_group(const ErrorModel& model, UnknownGroup group) const {
  std::vector<std::size_t> indices;
  for (const Unknown& unknown : listed(group, model, targets_)) {
    indices.push_back(unknown.index);
  }
  return with(model, group, indices);
}

Unknowns Unknowns::without(UnknownGroup group) const {
  std::vector<bool> marked;
  for (const Unknown& unknown : columns_) {
    marked.push_back(unknown.group != group);
  }
  return subset(marked);
}

Unknowns Unknowns::subset(const std::vector<bool>& marked) const {
  std::vector<Unknown> kept;
  for (std::size_t column = 0; column < columns_.size(); ++column) {
    if (marked[column]) {
      kept.push_back(columns_[column]);
    }
  }
  Unknowns result = *this;
  result.arrange(std::move(kept));
  return result;
}

std::vector<bool> Unknowns::columns_at_station(std::size_t station) const {
  std::vector<bool> marked;
  for (const Unknown& unknown : columns_) {
    marked.push_back(unknown.group != UnknownGroup::base || unknown.index / 6 == station);
  }
  return marked;
}

Unknowns Unknowns::of_station(std::size_t station) const {
  std::vector<Unknown> own = subset(columns_at_station(station)).columns_;
  for (Unknown& unknown : own) {
    unknown.index -= unknown.group == UnknownGroup::base ? 6 * station : 0;
    unknown.sigma = 0.0;
  }
  Unknowns result = *this;
  result.arrange(std::move(own));
  return result;
}

std::vector<std::string> Unknowns::names() const {
  std::vector<std::string> names;
  for (const Unknown& unknown : columns_) {
    names.push_back(unknown.name);
  }
  return names;
}

std::optional<Index> Unknowns::column(const std::string& name) const {
  const auto found =
      std::find_if(columns_.begin(), columns_.end(), [&](const Unknown& unknown) { return unknown.name == name; });
  return found == columns_.end() ? std::nullopt : std::optional<Index>(found - columns_.begin());
}

std::optional<Index> Unknowns::column(UnknownGroup group, std::size_t index) const {
  const std::vector<std::size_t>& own = of(group);
  const auto found = std::lower_bound(own.begin(), own.end(), index);
  if (found == own.end() || *found != index) {
    return std::nullopt;
  }
  return range(group).first + (found - own.begin());
}

const std::array<int, 6>& Unknowns::base_columns(std::size_t station) const {
  return station < base_columns_.size() ? base_columns_[station] : kNotFree;
}

const std::array<int, 6>& Unknowns::target_columns(std::size_t k) const {
  return k < target_columns_.size() ? target_columns_[k] : kNotFree;
}

ColumnRange Unknowns::range(UnknownGroup group) const {
  ColumnRange result{.first = 0, .count = static_cast<Index>(of(group).size())};
  for (const UnknownGroup before : kGroups) {
    result.first += before < group ? static_cast<Index>(of(before).size()) : 0;
  }
  return result;
}

std::vector<Index> Unknowns::order_of_choice() const {
  std::vector<Index> order;
  for (const bool frames : {true, false}) {
    for (std::size_t column = 0; column < columns_.size(); ++column) {
      if ((values_of(columns_[column].group) == nullptr) == frames) {
        order.push_back(static_cast<Index>(column));
      }
    }
  }
  return order;
}

Estimate Unknowns::moved(const Estimate& estimate, const VectorXd& step) const {
  Estimate result;
  move(estimate, step, result);
  return result;
}

void Unknowns::move(const Estimate& estimate, const VectorXd& step, Estimate& result) const {
  result = estimate;
  for (std::size_t station = 0; station < result.frames.bases.size(); ++station) {
    const Vector6d motion = motion_of(step, base_columns(station));
    Isometry3d& X_WB = result.frames.base(station);
    X_WB.translation() += X_WB.linear() * motion.head<3>();
    X_WB.linear() = X_WB.linear() * rotation_exp(motion.tail<3>());
  }
  for (const Values& group : kValues) {
    VectorXd& values = result.*group.values;
    if (!of(group.group).empty() && values.size() == 0) {
      values = VectorXd::Zero(listed_[number_of(group.group)]);
    }
    Index column = range(group.group).first;
    for (const std::size_t index : of(group.group)) {
      values[static_cast<Index>(index)] += step[column++];
    }
  }
  for (std::size_t k = 0; k < result.frames.targets.size(); ++k) {
    const Vector6d motion = motion_of(step, target_columns(k));
    Isometry3d& X_FT = result.frames.targets[k].X_FT;
    X_FT.translation() += motion.head<3>();
    X_FT.linear() = X_FT.linear() * rotation_exp(motion.tail<3>());
  }
}

VectorXd Unknowns::difference(const Estimate& from, const Estimate& to) const {
  VectorXd step = VectorXd::Zero(size());
  Vector6d motion;
  for (std::size_t station = 0; station < from.frames.bases.size(); ++station) {
    const Isometry3d& first = from.frames.base(station);
    const Isometry3d& second = to.frames.base(station);
    motion << first.linear().transpose() * (second.translation() - first.translation()),
        rotation_log(first.linear().transpose() * second.linear());
    take_motion(motion, base_columns(station), step);
  }
  for (const Values& group : kValues) {
    Index column = range(group.group).first;
    for (const std::size_t index : of(group.group)) {
      step[column++] = value_at(to.*group.values, index) - value_at(from.*group.values, index);
    }
  }
  for (std::size_t k = 0; k < from.frames.targets.size(); ++k) {
    const Isometry3d& first = from.frames.targets[k].X_FT;
    const Isometry3d& second = to.frames.targets[k].X_FT;
    motion << second.translation() - first.translation(), rotation_log(first.linear().transpose() * second.linear());
    take_motion(motion, target_columns(k), step);
  }
  return step;
}

double Unknowns::value(const Estimate& estimate, const Unknown& unknown) {
  if (const Values* group = values_of(unknown.group)) {
    return value_at(estimate.*group->values, unknown.index);
  }
  const bool coordinate = unknown.group == UnknownGroup::targets && unknown.index % 6 < 3;
  return coordinate
             ? estimate.frames.targets[unknown.index / 6].X_FT.translation()[static_cast<Index>(unknown.index % 6)]
             : 0.0;
}

VectorXd Unknowns::values(const Estimate& estimate) const {
  VectorXd result(size());
  std::transform(columns_.begin(), columns_.end(), result.begin(),
                 [&](const Unknown& unknown) { return value(estimate, unknown); });
  return result;
}

VectorXd Unknowns::prior_information(const Priors& priors) const {
  VectorXd information = VectorXd::Zero(size());
  for (std::size_t column = 0; column < columns_.size(); ++column) {
    const Values* const group = values_of(columns_[column].group);
    const double sigma = group == nullptr ? 0.0 : group->prior(priors, columns_[column]);
    information[static_cast<Index>(column)] = sigma > 0.0 ? 1.0 / (sigma * sigma) : 0.0;
  }
  return information;
}

}  // namespace kdl_calibration
