#pragma once

// The rows of measurements that are fitted, and what they say of the joints.

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// The training rows of measurements, with unchanged indices of configurations and targets: the measurements themselves
/// if they have no other rows, else a copy. Keeps a reference to the measurements.
class TrainingRows {
public:
  explicit TrainingRows(const Measurements& measurements);
  explicit TrainingRows(Measurements&&) = delete;

  const Measurements& operator*() const { return apart_ ? *apart_ : all_; }
  /// Those that they were taken from.
  const Measurements& all() const { return all_; }
  /// Whether there are rows of another split.
  bool has_others() const { return apart_.has_value(); }
  /// Selects the training rows' values from those of all rows; empty for an empty list.
  std::vector<double> values_of(std::vector<double> of_all) const;
  /// Expands the training rows' values to all rows, the others getting `other`; empty for an empty list.
  std::vector<double> values_among_all(std::vector<double> values, double other) const;

private:
  const Measurements& all_;
  std::optional<Measurements> apart_;
};

/// Whether each configuration has rows of this split.
std::vector<bool> configurations_with(Split split, const Measurements& measurements);
/// Whether each configuration has training rows.
std::vector<bool> trained_configurations(const Measurements& measurements);

/// The training rows of at most so many configurations, evenly spaced over those that have some.
Measurements training_sample(const Measurements& measurements, std::size_t most_configurations);

/// The directions from which the joints approached each configuration (see DriveSignals); empty if the order is
/// unknown. Consecutive observations of one configuration are one visit.
Eigen::MatrixXd approach_directions(const Measurements& measurements);

/// Least and largest value of each joint in the training rows; least above largest if there are none.
JointRanges trained_ranges(const Measurements& measurements);

}  // namespace kdl_calibration
