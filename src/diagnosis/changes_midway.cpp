#include "diagnosis/changes_midway.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cstdint>
#include <iterator>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "base/text.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// The rows of one configuration's repeat, in the order of measurement.
struct Visit {
  Index configuration = 0;
  double share = 0.0;        // of the configuration's rows
  double coordinates = 0.0;  // measured
  std::vector<std::size_t> targets;
};

std::vector<Visit> visits_of(const Measurements& measurements) {
  struct Rows {
    std::int64_t when = 0;
    Visit visit;
  };
  std::map<std::pair<int, int>, Rows> found;
  std::vector<double> rows_of(measurements.configurations.size(), 0.0);
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Observation& o = measurements.observations[row];
    const auto when = o.order.value_or(static_cast<std::int64_t>(row));
    auto [place, is_new] = found.try_emplace({o.configuration, o.repeat}, Rows{.when = when, .visit = {}});
    place->second.visit.configuration = o.configuration;
    place->second.visit.targets.push_back(static_cast<std::size_t>(o.target));
    place->second.visit.coordinates += dimension(o.reading);
    rows_of[static_cast<std::size_t>(o.configuration)] += 1.0;
  }
  std::vector<Rows> sorted;
  for (auto& [key, rows] : found) {
    rows.visit.share = static_cast<double>(rows.visit.targets.size()) / rows_of[static_cast<std::size_t>(key.first)];
    sorted.push_back(std::move(rows));
  }
  std::stable_sort(sorted.begin(), sorted.end(), [](const Rows& a, const Rows& b) { return a.when < b.when; });
  std::vector<Visit> result;
  for (Rows& rows : sorted) {
    result.push_back(std::move(rows.visit));
  }
  return result;
}

// Something that may have changed: the columns that it moves.
struct Changeable {
  Cause cause = Cause::moved_base;
  MatrixXd columns;     // columns of J x k
  std::string subject;  // "the base", "target A", …
  std::vector<Subject> subjects = {};
  const char* unit = "mrad";                          // of a single column, in thousandths
  std::optional<std::size_t> target = std::nullopt;   // counted in visits of that target alone
  std::optional<std::size_t> station = std::nullopt;  // … of that station alone
};

// Of each joint the sag under the mass that is nearest to the tip: the last of its loads.
std::vector<std::size_t> payload_effects(const OrdinaryFit& fit) {
  std::map<std::int32_t, std::size_t> last;
  for (const std::size_t d : fit.effects_of(EffectGroup::gravity)) {
    last[fit.model().effects[d].index] = d;
  }
  std::vector<std::size_t> result;
  for (const auto& [joint, effect] : last) {
    result.push_back(effect);
  }
  return result;
}

std::vector<Changeable> changeable(const OrdinaryFit& fit) {
  std::vector<Changeable> result;
  for (std::size_t station = 0; station < fit.rows().stations.size(); ++station) {
    result.push_back({.cause = Cause::moved_base,
                      .columns = fit.of_base(station),
                      .subject = fit.rows().stations.size() > 1
                                     ? "the base at station " + shown(fit.rows().stations[station])
                                     : "the base",
                      .subjects = {{SubjectKind::station, fit.rows().stations[station]}},
                      .station = station});
  }
  for (std::size_t k = 0; k < fit.rows().targets.size(); ++k) {
    result.push_back({.cause = Cause::moved_target,
                      .columns = fit.of_target(k),
                      .subject = "target " + shown(fit.rows().targets[k]),
                      .subjects = {{SubjectKind::target, fit.rows().targets[k]}},
                      .target = k});
  }
  if (fit.rows().targets.size() > 1) {
    result.push_back({.cause = Cause::moved_target,
                      .columns = fit.of_tool(),
                      .subject = "the tool",
                      .subjects = subjects_named(SubjectKind::target, fit.rows().targets)});
  }
  for (std::size_t joint = 0; joint < fit.model().joints.size(); ++joint) {
    if (const std::optional<MatrixXd> M = fit.of_zero(joint)) {
      result.push_back({.cause = Cause::joint_zero_changed,
                        .columns = *M,
                        .subject = "the zero of " + fit.model().joints[joint].name,
                        .subjects = {{SubjectKind::joint, fit.model().joints[joint].name}},
                        .unit = fit.model().joints[joint].type == JointType::prismatic ? "mm" : "mrad"});
    }
  }
  if (const std::vector<std::size_t> loads = payload_effects(fit); !loads.empty()) {
    result.push_back({.cause = Cause::payload_changed,
                      .columns = fit.unit_columns(UnknownGroup::effects, loads),
                      .subject = "the payload"});
  }
  return result;
}

// Sums over the visits from a place on, or with other weights: those of J itself, from which any columns follow.
class ChangeSums {
public:
  explicit ChangeSums(Index columns) {
    information_.fill(MatrixXd::Zero(columns, columns));
    squares_.fill(MatrixXd::Zero(columns, columns));
    gradient_.fill(VectorXd::Zero(columns));
  }
  // The weight of a configuration, the rows from `first` on, grows from `before` to `after`.
  void add(const LinearisedFit& fit, Index first, Index count, double before, double after) {
    for (Index row = first; row < first + count;) {
      const RowStratum stratum = fit.strata[static_cast<std::size_t>(row)];
      Index end = row + 1;
      while (end < first + count && fit.strata[static_cast<std::size_t>(end)] == stratum) {
        ++end;
      }
      const auto s = static_cast<std::size_t>(stratum);
      const auto J = fit.jacobian.middleRows(row, end - row);
      const MatrixXd own = J.transpose() * J;
      information_[s] += (after - before) * own;
      squares_[s] += (after * after - before * before) * own;
      gradient_[s] += (after - before) * (J.transpose() * fit.residual.segment(row, end - row));
      row = end;
    }
  }
  // Of J M, whose M has few rows that are not zero.
  AlternativeSums of(const MatrixXd& M) const {
    std::vector<Index> few;
    for (Index row = 0; row < M.rows(); ++row) {
      if (!M.row(row).isZero(0.0)) {
        few.push_back(row);
      }
    }
    const MatrixXd of_few = M(few, Eigen::all);
    AlternativeSums result;
    for (std::size_t s = 0; s < kStrata; ++s) {
      result.cross[s] = information_[s](Eigen::all, few) * of_few;
      result.own[s] = of_few.transpose() * squares_[s](few, few) * of_few;
      result.right[s] = of_few.transpose() * gradient_[s](few);
    }
    result.size = result.own[0] + result.own[1];
    return result;
  }

private:
  std::array<MatrixXd, kStrata> information_;
  std::array<MatrixXd, kStrata> squares_;
  std::array<VectorXd, kStrata> gradient_;
};

bool is_of(const OrdinaryFit& fit, const Visit& visit, const Changeable& what) {
  return (!what.target || std::find(visit.targets.begin(), visit.targets.end(), *what.target) != visit.targets.end()) &&
         (!what.station || fit.station(visit.configuration) == *what.station);
}

// Visits and coordinates that something can move.
struct Seen {
  std::size_t visits = 0;
  double coordinates = 0.0;

  void add(const OrdinaryFit& fit, const Visit& visit, const Changeable& what) {
    if (is_of(fit, visit, what)) {
      ++visits;
      coordinates += visit.coordinates / (what.target ? static_cast<double>(visit.targets.size()) : 1.0);
    }
  }
};

bool suffice(const Seen& all, const Seen& after, const Changeable& what) {
  constexpr std::size_t kFewest = 2;       // visits on either side
  constexpr double kFewestOfColumn = 2.0;  // coordinates on either side
  return std::min(all.visits - after.visits, after.visits) >= kFewest &&
         std::min(after.coordinates, all.coordinates - after.coordinates) >=
             kFewestOfColumn * static_cast<double>(what.columns.cols());
}

std::string order_words(const Measurements& rows) {
  return has_order(rows) ? "" : " if the file is in the order of measurement";
}

MistakeTrial change_trial(const OrdinaryFit& fit, const Changeable& what, Index last) {
  const bool moves_robot = what.cause != Cause::moved_base;
  const std::string& before = fit.rows().configurations[static_cast<std::size_t>(last)];
  std::vector<Subject> subjects = what.subjects;
  subjects.push_back({SubjectKind::configuration, before});
  return {.cause = what.cause,
          .subject = what.subject + " changed halfway",
          .subjects = std::move(subjects),
          .unit = what.columns.cols() == 1 ? what.unit : "",
          .motion = {.of_robot = moves_robot ? what.columns : MatrixXd(), .in_part = true},
          .words = [&fit, what, before](const Explained& found) {
            const std::string size = what.cause == Cause::payload_changed ? ""
                                     : found.estimate.size() >= 3
                                         ? " by " + said_length(found.estimate.head<3>().norm())
                                         : fmt::format(" by {:.3g} {}", found.estimate[0] * 1e3, what.unit);
            return fmt::format("{} changed{} after configuration {}{}", what.subject, size, before,
                               order_words(fit.rows()));
          }};
}

MistakeTrial drift_trial(const OrdinaryFit& fit, std::size_t station) {
  return {.cause = Cause::drift,
          .subject = "the base drifts",
          .subjects = {{SubjectKind::station, fit.rows().stations[station]}},
          .words = [&fit](const Explained& found) {
            return fmt::format("a base that drifts against the measuring device, by {} and {:.2g} mrad in all{}",
                               said_length(found.estimate.head<3>().norm()), found.estimate.tail<3>().norm() * 1e3,
                               order_words(fit.rows()));
          }};
}

// One configuration, or one target in it.
void try_alone(const OrdinaryFit& fit, const Explanations& explanations, Index configuration, MistakeFamily& family) {
  const auto [first, count] = fit.rows_of(configuration);
  std::vector<MatrixXd> columns = {fit.of_base(fit.station(configuration))};
  for (std::size_t k = 0; k < fit.rows().targets.size(); ++k) {
    columns.push_back(fit.of_target(k));
  }
  for (const MatrixXd& M : columns) {
    family.add(
        explanations, explanations.sums_of_rows(fit.linear().jacobian.middleRows(first, count) * M, first),
        [&] { return MistakeTrial{.alone = fit.rows().configurations[static_cast<std::size_t>(configuration)]}; },
        false);
  }
}

// More sag than is ordinary, from the first visit on, is no change.
void try_more_sag(const OrdinaryFit& fit, const Explanations& explanations, const ChangeSums& in_all,
                  std::vector<MistakeFamily>& changes) {
  for (const std::vector<std::size_t>& effects : {payload_effects(fit), fit.effects_of(EffectGroup::gravity)}) {
    if (!effects.empty()) {
      changes.emplace_back().add(
          explanations, in_all.of(fit.unit_columns(UnknownGroup::effects, effects)),
          [] { return MistakeTrial{.is_mistake = false}; }, false);
    }
  }
}

}  // namespace

void try_changes(const OrdinaryFit& fit, const Explanations& explanations, std::vector<MistakeFamily>& families) {
  constexpr std::size_t kMostPlaces = 300;
  constexpr double kWhole = 1.0 - 1e-9;  // share of a configuration's rows
  const std::vector<Visit> visits = visits_of(fit.rows());
  const std::vector<Changeable> all = changeable(fit);
  std::vector<Seen> in_all(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    for (const Visit& visit : visits) {
      in_all[i].add(fit, visit, all[i]);
    }
  }
  std::vector<MistakeFamily> changes(all.size());
  std::vector<Seen> after(all.size());
  MistakeFamily alone;
  std::vector<ChangeSums> drift(fit.rows().stations.size(), ChangeSums(fit.columns()));
  VectorXd weight = VectorXd::Zero(fit.rows().joint_values.cols());
  ChangeSums from_here(fit.columns());
  const std::size_t spacing = visits.size() / kMostPlaces + 1;
  for (std::size_t v = visits.size(); v-- > 0;) {
    const Visit& visit = visits[v];
    const Index c = visit.configuration;
    const auto [first, count] = fit.rows_of(c);
    from_here.add(fit.linear(), first, count, weight[c], weight[c] + visit.share);
    weight[c] += visit.share;
    if (weight[c] > kWhole) {
      try_alone(fit, explanations, c, alone);
      drift[fit.station(c)].add(
          fit.linear(), first, count, 0.0,
          static_cast<double>(v) / static_cast<double>(std::max<std::size_t>(visits.size(), 2) - 1));
    }
    for (std::size_t i = 0; i < all.size(); ++i) {
      after[i].add(fit, visit, all[i]);
      if (v % spacing == 0 && is_of(fit, visit, all[i]) && suffice(in_all[i], after[i], all[i])) {
        const bool is_halfway = 2 * after[i].visits >= in_all[i].visits && changes[i].listed.empty();
        changes[i].add(
            explanations, from_here.of(all[i].columns),
            [&] { return change_trial(fit, all[i], visits[v - 1].configuration); }, is_halfway);
      }
    }
  }
  for (std::size_t station = 0; station < drift.size(); ++station) {
    MistakeFamily& family = changes.emplace_back();
    family.add(explanations, drift[station].of(fit.of_base(station)), [&] { return drift_trial(fit, station); });
  }
  try_more_sag(fit, explanations, from_here, changes);
  changes.push_back(std::move(alone));
  std::move(changes.begin(), changes.end(), std::back_inserter(families));
}

}  // namespace kdl_calibration
