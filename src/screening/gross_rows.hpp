#pragma once

// Configurations and points with gross errors, whatever their size.
//
//     for (const GrossRow& row : find_gross_rows(problem).rows) std::cout << row.configuration << '\n';

#include <cstddef>
#include <string>
#include <vector>

#include "estimation/identification.hpp"

namespace kdl_calibration {

struct GrossRow {
  std::string configuration;
  std::string target;     ///< empty: the whole configuration
  double distance = 0.0;  ///< [m] from its prediction by the others
};

struct GrossRows {
  std::vector<GrossRow> rows;
  double rms = 0.0;            ///< [m] position residuals with them
  double rms_without = 0.0;    ///< of the others, fitted without them
  bool beyond_chance = false;  ///< whether a decrease was significant, even if the rest fits hardly better
};

/// An explanation of the misfit (rows left out, another reading) counts if it leaves less than this share of it.
constexpr double kMostMisfitLeft = 1.0 / 3.0;

constexpr std::size_t kMostGrossGroups = 20;  ///< that find_gross_rows leaves out

/// The few configurations or points (one of ten at most, up to kMostGrossGroups) without which the others fit more than
/// three times as well. Single coordinates and distances are also reported if they are off by more than ten times the
/// misfit of the others. With the hat matrix H_g = J_g (J^T J)^-1 J_g^T of group g and its residuals e_g, leaving the
/// group out lowers the sum of squares by e_g^T (I - H_g)^-1 e_g (Cook and Weisberg 1982, section 2.2), however far it
/// is off. The group with the largest decrease is taken out and the rest fitted again (forward search), as long as the
/// decrease is beyond chance (F test at 1e-4 over the number of groups). Repeats count as their mean. Nothing where the
/// rest would not determine the unknowns, or where leaving rows out does not make that difference. `problem`: at its
/// optimum.
GrossRows find_gross_rows(const FitProblem& problem);

}  // namespace kdl_calibration
