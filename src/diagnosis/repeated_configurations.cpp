#include "diagnosis/repeated_configurations.hpp"

#include <algorithm>
#include <string>
#include <utility>

#include "measurements/same_poses.hpp"

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
  std::vector<AlternativeReading> remarks = {{.cause = Cause::same_configuration, .message = message, .doubt = false}};
  constexpr std::size_t kLookedAt = 20;
  const auto end = twins.begin() + static_cast<std::ptrdiff_t>(std::min(twins.size(), kLookedAt));
  const auto copied = std::find_if(twins.begin(), end, [&](const Twins& two) { return is_copy(measurements, two); });
  if (copied != end) {
    remarks.push_back({.cause = Cause::copied_rows,
                       .message = "test configuration " + label(copied->second) +
                                  " has the very points of train configuration " + label(copied->first) +
                                  ": copied rows are no independent test",
                       .doubt = false});
  }
  return remarks;
}

}  // namespace kdl_calibration
