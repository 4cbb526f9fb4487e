#include "screening/data_quality.hpp"

#include <algorithm>
#include <utility>

namespace kdl_calibration {
namespace {

// Whether both findings concern the same target at the same place.
bool same_matter(const QualityFinding& residual, const QualityFinding& distance) {
  const bool slips = residual.kind == QualityKind::slipped_target;
  if (slips != (distance.kind == QualityKind::slipped_target) ||
      (!slips && residual.configuration != distance.configuration) ||
      (!slips && residual.repeat != 0 && distance.repeat != 0 && residual.repeat != distance.repeat)) {
    return false;
  }
  return std::any_of(distance.targets.begin(), distance.targets.end(), [&](const std::string& name) {
    return std::find(residual.targets.begin(), residual.targets.end(), name) != residual.targets.end();
  });
}

}  // namespace

std::string to_string(QualityKind kind) {
  switch (kind) {
    case QualityKind::slipped_target:
      return "slipped_target";
    case QualityKind::swapped_targets:
      return "swapped_targets";
    case QualityKind::mistaken_target:
      return "mistaken_target";
    case QualityKind::mistyped_coordinate:
      return "mistyped_coordinate";
    case QualityKind::displaced_point:
      return "displaced_point";
    case QualityKind::displaced_configuration:
      return "displaced_configuration";
  }
  return "unknown";
}

std::vector<QualityFinding> check_measurements(const ErrorModel& model, const Measurements& measurements,
                                               const Estimate& estimate) {
  std::vector<QualityFinding> findings = check_residuals(model, measurements, estimate);
  const std::size_t of_residuals = findings.size();
  for (QualityFinding& finding : check_distances(measurements)) {
    const bool named = std::any_of(findings.begin(), findings.begin() + static_cast<std::ptrdiff_t>(of_residuals),
                                   [&](const QualityFinding& other) { return same_matter(other, finding); });
    if (!named) {
      findings.push_back(std::move(finding));
    }
  }
  return findings;
}

}  // namespace kdl_calibration
