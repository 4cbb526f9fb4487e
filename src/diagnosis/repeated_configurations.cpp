#include "diagnosis/repeated_configurations.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <tuple>
#include <utility>

#include "base/distributions.hpp"
#include "base/text.hpp"
#include "diagnosis/mistake_trial.hpp"
#include "estimation/prediction.hpp"
#include "measurements/readings.hpp"
#include "measurements/same_poses.hpp"
#include "measurements/stations.hpp"
#include "model/kinematics.hpp"
#include "screening/gross_rows.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;

using Twins = std::pair<Index, Index>;

std::vector<bool> tested_configurations(const Measurements& measurements, std::size_t configurations) {
  std::vector<bool> tested(configurations, false);
  for (const Observation& observation : measurements.observations) {
    if (observation.split == Split::test) {
      tested[static_cast<std::size_t>(observation.configuration)] = true;
    }
  }
  return tested;
}

// Consecutive configurations among those with the same joint values. Where one of the two is for tests, it is second.
std::vector<Twins> twins_of(const Measurements& measurements, const std::vector<bool>& tested) {
  const std::vector<Index> first = first_at_same_pose(measurements.joint_values);
  std::vector<Twins> twins;
  std::vector<Index> last = first;  // latest one with the pose of the first
  for (std::size_t c = 0; c < first.size(); ++c) {
    const auto own = static_cast<Index>(c);
    if (first[c] == own) {
      continue;
    }
    Index& before = last[static_cast<std::size_t>(first[c])];
    const bool exchanged = tested[static_cast<std::size_t>(before)] && !tested[c];
    twins.emplace_back(exchanged ? own : before, exchanged ? before : own);
    before = own;
  }
  return twins;
}

// Whether a test row of the second configuration has the very point of a train row of the first.
bool is_copy(const Measurements& measurements, const Twins& twins) {
  const auto& rows = measurements.observations;
  return std::any_of(rows.begin(), rows.end(), [&](const Observation& test) {
    return test.split == Split::test && test.configuration == twins.second &&
           std::any_of(rows.begin(), rows.end(), [&](const Observation& train) {
             return train.split == Split::train && train.configuration == twins.first && train.target == test.target &&
                    train.position() == test.position();
           });
  });
}

}  // namespace

std::vector<AlternativeReading> repeated_configurations(const Measurements& measurements) {
  const std::vector<bool> tested =
      tested_configurations(measurements, static_cast<std::size_t>(measurements.joint_values.cols()));
  const std::vector<Twins> twins = twins_of(measurements, tested);
  if (twins.empty()) {
    return {};
  }
  const auto label = [&](Index c) { return measurements.configurations[static_cast<std::size_t>(c)]; };
  const std::string more = twins.size() > 1 ? " (and " + std::to_string(twins.size() - 1) + " more)" : std::string();
  const auto [one, other] = twins.front();
  const std::string message = tested[static_cast<std::size_t>(other)]
                                  ? "test configuration " + label(other) + " is at the pose of train configuration " +
                                        label(one) + more + ": that is no independent test"
                                  : "configurations " + label(one) + " and " + label(other) + more +
                                        " are at the same pose: they are left out together";
  const auto both = [&](const Twins& two) {
    return subjects_named(SubjectKind::configuration, {label(two.first), label(two.second)});
  };
  std::vector<AlternativeReading> remarks = {{.cause = Cause::same_configuration,
                                              .subjects = both(twins.front()),
                                              .figures = {{"count", static_cast<double>(twins.size())}},
                                              .message = message,
                                              .doubt = false}};
  constexpr std::size_t kLookedAt = 20;
  const auto end = twins.begin() + static_cast<std::ptrdiff_t>(std::min(twins.size(), kLookedAt));
  const auto copied = std::find_if(twins.begin(), end, [&](const Twins& two) { return is_copy(measurements, two); });
  if (copied != end) {
    remarks.push_back({.cause = Cause::copied_rows,
                       .subjects = both(*copied),
                       .message = "test configuration " + label(copied->second) +
                                  " has the very points of train configuration " + label(copied->first) +
                                  ": copied rows are no independent test",
                       .doubt = false});
  }
  return remarks;
}

namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Rows of a later repeat that have one in the first, with their difference in W.
struct Differences {
  std::vector<Vector3d> in_W;
  std::vector<Vector3d> points;  // in W
  std::vector<Eigen::Matrix3d> R_WF;
};

// A displacement by least squares of d = A x.
struct Displacement {
  VectorXd x;
  bool explains = false;
};

Displacement displacement(const MatrixXd& A, const VectorXd& d) {
  constexpr double kByChance = 1e-6;
  constexpr double kRounding = 1e-7;  // [m]
  const auto freedom = static_cast<double>(A.rows() - A.cols());
  Displacement found{.x = A.colPivHouseholderQr().solve(d)};
  const double all = d.squaredNorm();
  const double left = std::max((d - A * found.x).squaredNorm(), 1e-300);
  const auto columns = static_cast<double>(A.cols());
  found.explains = freedom > columns && all > static_cast<double>(A.rows()) * kRounding * kRounding &&
                   left < kMostMisfitLeft * kMostMisfitLeft * all &&
                   f_upper_tail((all - left) / columns / (left / freedom), columns, freedom) < kByChance;
  return found;
}

// A motion v + w x p in W, or a constant on the flange.
Displacement displacement_of(const Differences& rows, bool on_flange) {
  const auto count = static_cast<Index>(rows.in_W.size());
  MatrixXd A(3 * count, on_flange ? 3 : 6);
  VectorXd d(3 * count);
  for (Index i = 0; i < count; ++i) {
    const auto row = static_cast<std::size_t>(i);
    d.segment<3>(3 * i) = rows.in_W[row];
    if (on_flange) {
      A.middleRows<3>(3 * i) = rows.R_WF[row];
      continue;
    }
    A.block<3, 3>(3 * i, 0).setIdentity();
    A.block<3, 3>(3 * i, 3) = -skew(rows.points[row]);
  }
  return displacement(A, d);
}

// Of each station, target and later repeat.
using AllDifferences = std::map<std::tuple<std::size_t, int, int>, Differences>;

AllDifferences differences(const ErrorModel& model, const Measurements& measurements, const Estimate& fit) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, fit, measurements);
  std::map<std::pair<int, int>, const Observation*> first;
  AllDifferences all;
  for (const Observation& o : measurements.observations) {
    if (o.split != Split::train || !is_whole(o)) {
      continue;
    }
    const auto [found, is_new] = first.try_emplace({o.configuration, o.target}, &o);
    if (!is_new && o.repeat != found->second->repeat) {
      const std::size_t station = station_of(o);
      Differences& rows = all[{station, o.repeat, o.target}];
      rows.in_W.emplace_back(o.position() - found->second->position());
      rows.points.push_back(o.position());
      rows.R_WF.emplace_back(fit.frames.base(station).linear() *
                             X_BF[static_cast<std::size_t>(o.configuration)].linear());
    }
  }
  return all;
}

std::vector<std::string> all_shown(std::vector<std::string> names) {
  std::transform(names.begin(), names.end(), names.begin(), [](const std::string& name) { return shown(name); });
  return names;
}

}  // namespace

std::optional<AlternativeReading> moved_between_repeats(const ErrorModel& model, const Measurements& measurements,
                                                        const Estimate& fit) {
  std::map<std::pair<std::size_t, int>, Differences> of_stations;
  std::vector<std::string> moved;
  int repeat = 0;
  double largest = 0.0;
  for (const auto& [key, rows] : differences(model, measurements, fit)) {
    const auto [station, number, target] = key;
    Differences& all = of_stations[{station, number}];
    all.in_W.insert(all.in_W.end(), rows.in_W.begin(), rows.in_W.end());
    all.points.insert(all.points.end(), rows.points.begin(), rows.points.end());
    if (const Displacement found = displacement_of(rows, true); found.explains && (moved.empty() || number == repeat)) {
      moved.push_back(measurements.targets[static_cast<std::size_t>(target)]);
      repeat = number;
      largest = std::max(largest, found.x.norm());
    }
  }
  const auto said = [](const AlternativeReading& found, const std::string& what, int number) {
    std::vector<NamedFigure> figures = found.figures;
    figures.push_back({"repeat", static_cast<double>(number)});
    return AlternativeReading{
        .cause = found.cause,
        .subjects = found.subjects,
        .figures = std::move(figures),
        .message = fmt::format("in repeat {} {} than in the first one of the same configurations; they are no repeats: "
                               "calibrate with one part",
                               number, what)};
  };
  for (const auto& [key, rows] : of_stations) {
    if (const Displacement found = displacement_of(rows, false); found.explains) {
      const double step = found.x.head<3>().norm();
      const double turn = found.x.tail<3>().norm();
      return said({.cause = Cause::moved_base,
                   .subjects = {{SubjectKind::station, measurements.stations[key.first]}},
                   .figures = {{"estimate", step}, {"turn", turn}}},
                  fmt::format("the base or the measuring device stands elsewhere (by {} and {:.3g} mrad)",
                              said_length(step), turn * 1e3),
                  key.second);
    }
  }
  if (moved.empty()) {
    return std::nullopt;
  }
  return said({.cause = Cause::moved_target,
               .subjects = subjects_named(SubjectKind::target, moved),
               .figures = {{"estimate", largest}}},
              (moved.size() == 1 ? "target " : "targets ") + comma_separated(all_shown(moved)) +
                  (moved.size() == 1 ? " is" : " are") + " elsewhere on the flange (by " + said_length(largest) + ")",
              repeat);
}

}  // namespace kdl_calibration
