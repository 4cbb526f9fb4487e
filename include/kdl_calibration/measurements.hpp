#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/drive_signals.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

enum class Split : std::uint8_t { train, test };

/// The stated unit of a joint's values; without one they are in rad or m, depending on the joint's type.
enum class JointUnit : std::uint8_t { unstated, radian, metre };

/// One measured point (or pose, see Measurements::orientations) of one target in one configuration.
struct Observation {
  Eigen::Vector3d position;        ///< [m] in the measuring device's frame W
  double sigma = 0.0;              ///< [m] 1 sigma per coordinate; 0 if the file states none
  std::int32_t configuration = 0;  ///< column of Measurements::joint_values
  std::int32_t target = 0;         ///< index into Measurements::targets
  std::int32_t repeat = 1;         ///< observations of one configuration with the same repeat were taken together
  Split split = Split::train;
};

/// The orientation of an observation without measured orientation: NaN in all four coefficients.
Eigen::Quaterniond point_alone();
/// Whether this is point_alone().
bool is_point(const Eigen::Quaterniond& orientation);

/// A set of measurements. Configurations and targets are numbered in their order of first appearance.
struct Measurements {
  std::string source;                       ///< file name, for messages
  std::vector<std::string> joints;          ///< URDF names of the moving joints, base to tip
  Eigen::MatrixXd joint_values;             ///< joints x configurations, in the URDF's convention [rad] or [m]
  std::vector<std::string> configurations;  ///< labels
  std::vector<std::string> targets;         ///< names of the points on the tool
  std::vector<Observation> observations;    ///< in the order of the file
  /// Orientation of the target's frame in W, one per observation; point_alone() if not measured. Empty if only points
  /// were measured.
  std::vector<Eigen::Quaterniond> orientations;
  /// Position of each observation in the order of driving; empty if unknown.
  std::vector<std::int64_t> order;
  /// One per joint, or empty if unknown. The reader fills it from the header's units, unless a joint convention is
  /// used.
  std::vector<JointUnit> joint_units;
  std::string remark;    ///< how the reader interpreted the file, in one line; empty if as usual
  DriveSignals signals;  ///< of the configurations; from the columns tau_<joint> and order
};

/// Clears the list if no entry is a measured orientation.
void drop_unused_orientations(std::vector<Eigen::Quaterniond>& orientations);

/// The observations that satisfy `keep`. Joints and targets stay as they are, even targets without observations, so
/// that their indices stay valid. Configurations without observations are dropped; the others keep their order.
Measurements subset(const Measurements& measurements, const std::function<bool(const Observation&)>& keep);

/// The measurements without some configurations ("12") or points of them ("12:A"), which `remark` names. Throws
/// InputError if a name matches nothing or nothing is left.
Measurements without_rows(const Measurements& measurements, const std::vector<std::string>& names);

/// One observation per configuration and target, ordered so: the mean over the repeats, with repeat 1. Its sigma is
/// that of a mean of independent values, sqrt(sum sigma^2) / n, and 0 if one of the rows states none; its order is that
/// of the first row. The mean of the measured orientations is the eigenvector of the largest eigenvalue of sum q q^T
/// (Markley, Cheng, Crassidis and Oshman 2007, eq. 13), with the sign nearest to the first.
Measurements averaged(const Measurements& measurements);

/// The training rows of measurements, with unchanged indices of configurations and targets: the measurements themselves
/// if they have no other rows, else a copy. Keeps a reference to the measurements.
class TrainingRows {
public:
  explicit TrainingRows(const Measurements& measurements);
  explicit TrainingRows(Measurements&&) = delete;

  const Measurements& operator*() const { return apart_ ? *apart_ : all_; }
  /// Whether there are rows of another split.
  bool has_others() const { return apart_.has_value(); }
  /// Selects the training rows' values from those of all rows; empty for an empty list.
  std::vector<double> values_of(std::vector<double> of_all) const;
  /// Expands the training rows' values to all rows, the others getting `other`; empty for an empty list.
  std::vector<double> among_all(std::vector<double> values, double other) const;

private:
  const Measurements& all_;
  std::optional<Measurements> apart_;
};

/// Whether each configuration has training rows.
std::vector<bool> trained_configurations(const Measurements& measurements);

/// The training rows of at most so many configurations, evenly spaced over those that have some.
Measurements training_sample(const Measurements& measurements, std::size_t most_configurations);

/// The directions from which the joints approached each configuration (see DriveSignals); empty if the order is
/// unknown. Consecutive observations of one configuration are one visit.
Eigen::MatrixXd approach_directions(const Measurements& measurements);

/// Least and largest value of each joint in the training rows; least above largest if there are none.
JointRanges trained_ranges(const Measurements& measurements);

/// The measurements of `first`, then those of `second`; joints and targets must be the same. Orientations of either are
/// kept, order and signals only if both have them.
Measurements joined(const Measurements& first, const Measurements& second);

}  // namespace kdl_calibration
