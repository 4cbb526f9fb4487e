#pragma once

// Shared by the checks of distances and of residuals: groups of rows, and messages of findings.

#include <cstddef>
#include <set>
#include <vector>

#include "screening/data_quality.hpp"

namespace kdl_calibration {

/// Rows measured together.
struct Group {
  int configuration = 0;
  int repeat = 0;
  std::vector<std::size_t> rows;
};

/// A finding and its rows, before findings of repeats are merged.
struct Found {
  QualityFinding finding;
  int configuration = 0;
  std::vector<std::size_t> rows;  // rows responsible for it
};

std::vector<Group> groups_of(const Measurements& measurements);

/// Each row's stated sigma over their median; 1 unless all rows state one.
std::vector<double> relative_sigmas(const Measurements& measurements);

/// Merges findings that all repeats of a configuration have in common.
std::vector<QualityFinding> put_together(const Measurements& measurements, const std::vector<Group>& groups,
                                         std::vector<Found> all_found);

QualityFinding slip(const Measurements& measurements, int last_before, const std::set<std::size_t>& targets,
                    double amount, const Eigen::Vector3d& offset);

std::size_t target_of(const Measurements& measurements, std::size_t row);

Found found_in(const Measurements& measurements, const Group& group, QualityKind kind, std::vector<std::size_t> rows);

}  // namespace kdl_calibration
