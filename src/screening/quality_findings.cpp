#include "screening/quality_findings.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <tuple>
#include <utility>

#include "base/number_text.hpp"
#include "base/robust_statistics.hpp"

namespace kdl_calibration {

using Eigen::Vector3d;

namespace {

std::string millimetres(double metres) {
  const double value = metres * 1e3;
  const int digits = std::abs(value) >= 0.95 ? 1 : (std::abs(value) >= 0.095 ? 2 : 4);
  return fixed(value, digits) + " mm";
}

std::string listed(const std::vector<std::string>& names, const std::string& last) {
  std::string text;
  for (std::size_t i = 0; i < names.size(); ++i) {
    text += (i == 0 ? "" : (i + 1 < names.size() ? ", " : " " + last + " ")) + names[i];
  }
  return text;
}

std::string where(const QualityFinding& finding, bool every_repeat, bool always) {
  std::string text = "configuration " + finding.configuration;
  if (finding.repeat != 0 && (always || !every_repeat)) {
    text += ", repeat " + std::to_string(finding.repeat);
  }
  return text;
}

// `all`: the finding concerns all targets of the configuration.
std::string describe(const QualityFinding& finding, bool all) {
  const std::string& first = finding.targets.front();
  const bool bound = finding.offset.isZero(0.0);
  const std::string about = (bound ? "at least " : "about ") + millimetres(finding.amount);
  const std::string several = finding.repeat == 0 ? " in every repeat" : "";
  switch (finding.kind) {
    case QualityKind::slipped_target:
      return "target " + listed(finding.targets, "or") + " slipped by " + about + " after configuration " +
             finding.configuration;
    case QualityKind::swapped_targets:
      return "targets " + listed(finding.targets, "and") + " are swapped in " + where(finding, all, false);
    case QualityKind::mistaken_target:
      return "target " + first + " in " + where(finding, all, false) + " lies where target " + finding.targets.back() +
             " is";
    case QualityKind::mistyped_coordinate:
      return "target " + first + " in " + where(finding, all, true) + ": " + finding.axis + " is off by about " +
             millimetres(finding.offset[finding.axis - 'x']) + several;
    case QualityKind::displaced_point:
      return "target " + listed(finding.targets, "or") + " in " + where(finding, all, true) + " is off by " + about +
             several;
    case QualityKind::displaced_configuration:
      return "targets " + listed(finding.targets, "and") + " in " + where(finding, all, false) + " are off by up to " +
             millimetres(finding.amount) + "; are its joint values right?";
  }
  return {};
}

}  // namespace

std::vector<Group> groups_of(const Measurements& measurements) {
  const auto key = [&](std::size_t row) {
    const Observation& observation = measurements.observations[row];
    return std::pair(observation.configuration, observation.repeat);
  };
  std::vector<std::size_t> rows(measurements.observations.size());
  std::iota(rows.begin(), rows.end(), std::size_t{0});
  std::stable_sort(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  std::vector<Group> groups;
  for (auto first = rows.begin(); first != rows.end();) {
    const auto end = std::find_if(first, rows.end(), [&](std::size_t row) { return key(row) != key(*first); });
    groups.push_back({.configuration = key(*first).first, .repeat = key(*first).second, .rows = {first, end}});
    first = end;
  }
  return groups;
}

std::vector<double> relative_sigmas(const Measurements& measurements) {
  std::vector<double> sigmas;
  for (const Observation& observation : measurements.observations) {
    sigmas.push_back(observation.sigma);
  }
  const bool stated = std::all_of(sigmas.begin(), sigmas.end(), [](double sigma) { return sigma > 0.0; });
  const double middle = median(sigmas);
  for (std::size_t row = 0; row < sigmas.size(); ++row) {
    sigmas[row] = (stated ? sigmas[row] / middle : 1.0) * measurements.observations[row].noise.length;
  }
  return sigmas;
}

std::vector<QualityFinding> put_together(const Measurements& measurements, const std::vector<Group>& groups,
                                         std::vector<Found> all_found) {
  std::map<int, std::size_t> repeats;
  for (const Group& group : groups) {
    ++repeats[group.configuration];
  }
  std::map<std::tuple<int, QualityKind, std::vector<std::string>, char>, std::vector<QualityFinding>> alike;
  for (Found& found : all_found) {
    found.finding.configuration = measurements.configurations[static_cast<std::size_t>(found.configuration)];
    const QualityFinding& finding = found.finding;
    alike[{found.configuration, finding.kind, finding.targets, finding.axis}].push_back(finding);
  }
  std::vector<QualityFinding> result;
  for (auto& [key, findings] : alike) {
    const bool all = findings.size() == repeats[std::get<0>(key)];
    if (all && findings.size() > 1) {
      QualityFinding& whole = findings.front();
      for (std::size_t i = 1; i < findings.size(); ++i) {
        whole.amount += findings[i].amount;
        whole.offset += findings[i].offset;
      }
      whole.amount /= static_cast<double>(findings.size());
      whole.offset /= static_cast<double>(findings.size());
      whole.repeat = 0;
      findings.resize(1);
    }
    for (QualityFinding& finding : findings) {
      finding.message = describe(finding, all);
      result.push_back(std::move(finding));
    }
  }
  return result;
}

QualityFinding slip(const Measurements& measurements, int last_before, const std::set<std::size_t>& targets,
                    double amount, const Vector3d& offset) {
  QualityFinding finding{.kind = QualityKind::slipped_target,
                         .configuration = measurements.configurations[static_cast<std::size_t>(last_before)],
                         .amount = amount,
                         .offset = offset};
  for (const std::size_t target : targets) {
    finding.targets.push_back(measurements.targets[target]);
  }
  finding.message = describe(finding, true);
  return finding;
}

std::size_t target_of(const Measurements& measurements, std::size_t row) {
  return static_cast<std::size_t>(measurements.observations[row].target);
}

Found found_in(const Measurements& measurements, const Group& group, QualityKind kind, std::vector<std::size_t> rows) {
  std::sort(rows.begin(), rows.end(),
            [&](std::size_t a, std::size_t b) { return target_of(measurements, a) < target_of(measurements, b); });
  Found found{.configuration = group.configuration, .rows = std::move(rows)};
  found.finding.kind = kind;
  found.finding.repeat = group.repeat;
  for (const std::size_t row : found.rows) {
    found.finding.targets.push_back(measurements.targets[target_of(measurements, row)]);
  }
  return found;
}

}  // namespace kdl_calibration
