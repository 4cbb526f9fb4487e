#pragma once

// The position errors of a geometry: base and targets are registered, nothing else is fitted.

#include <Eigen/Geometry>
#include <vector>

#include "estimation/registration.hpp"
#include "kdl_calibration/accuracy.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Degrees of freedom of the registration of base and targets.
struct Freedom {
  int unknowns = 0;
  int undetermined = 0;  ///< unknowns that the measurements do not determine
  int coordinates = 0;   ///< coordinates of distinct points
  int configurations = 0;
  int points = 0;     ///< coordinates of one point for each configuration: its targets share the error of the arm
  int of_points = 0;  ///< unknowns of these: bases, and one target if any is unknown

  int spent() const { return unknowns - undetermined; }
  int left() const { return coordinates - spent(); }
  /// Factor on the RMS of the registered points that corrects for the degrees of freedom used by base and targets.
  double correction() const;
  /// The upper 95 % limit of the true RMS is so many times that of the registered points. Infinite without degrees of
  /// freedom.
  double upper_95() const;
};

struct RegisteredErrors {
  ErrorStatistics all;
  ErrorStatistics train;
  ErrorStatistics test;
  /// Of the means of repeats; none without repeats.
  std::optional<ErrorStatistics> all_means;
  std::optional<ErrorStatistics> train_means;
  std::optional<ErrorStatistics> test_means;
  Iso9283 iso;  ///< over all rows
  Registration registration;
  Freedom freedom;
  Freedom of_test;  ///< of the test rows, if others were registered
};

/// Whether there are only test rows, to which base and targets are then registered.
bool has_only_test_rows(const Measurements& measurements);
/// The measurements; if there are only test rows, with these as training rows.
Measurements rows_to_register(Measurements measurements);

/// Errors at `measurements`, with base and targets registered to rows_to_register(measurements). `X_BF` holds one
/// flange pose per configuration. Throws InputError if base and targets take all coordinates.
RegisteredErrors registered_errors(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                   const Measurements& to_register, const KnownFrames& known);

}  // namespace kdl_calibration
