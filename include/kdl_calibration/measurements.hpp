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

/// The unit that a joint's values are known to have; unstated values are taken as rad or m, as the joint's type says.
enum class JointUnit : std::uint8_t { unstated, radian, metre };

/// One measured point (or pose, see Measurements::orientations) of one target in one configuration.
struct Observation {
  Eigen::Vector3d position;        ///< [m] in the measuring device's frame W
  double sigma = 0.0;              ///< [m] 1 sigma per coordinate; 0 where the file states none
  std::int32_t configuration = 0;  ///< column of Measurements::joint_values
  std::int32_t target = 0;         ///< index into Measurements::targets
  std::int32_t repeat = 1;         ///< observations of one configuration with the same repeat were taken together
  Split split = Split::train;
};

/// The orientation of an observation that measured a point alone: NaN in all four coefficients.
Eigen::Quaterniond point_alone();
/// Whether this is one.
bool is_point(const Eigen::Quaterniond& orientation);

/// What was measured. Configurations and targets are numbered in their order of first appearance.
struct Measurements {
  std::string source;                       ///< file name, for messages
  std::vector<std::string> joints;          ///< URDF names of the moving joints, base to tip
  Eigen::MatrixXd joint_values;             ///< joints x configurations, in the URDF's convention [rad] or [m]
  std::vector<std::string> configurations;  ///< labels
  std::vector<std::string> targets;         ///< names of the points on the tool
  std::vector<Observation> observations;    ///< in the order of the file
  /// Empty where only points were measured, else one per observation: orientation of the target's frame in W.
  /// An observation that measured a point alone holds NaN in all four coefficients.
  std::vector<Eigen::Quaterniond> orientations;
  /// Empty where nothing is known, else one per observation: its place in the order in which the arm was driven.
  std::vector<std::int64_t> order;
  /// Empty where nothing is known, else one per joint. The reader fills it from the header's units where the columns
  /// bear the URDF's joint names, and leaves it empty behind a joint convention.
  std::vector<JointUnit> joint_units;
  std::string remark;    ///< what the reader recognised and made of rows, in one line; empty where nothing
  DriveSignals signals;  ///< of the configurations; the reader fills them from the columns tau_<joint> and order
};

/// Points alone have no orientations at all: clears those that hold nothing else.
void drop_unused_orientations(std::vector<Eigen::Quaterniond>& orientations);

/// The observations that satisfy `keep`. Joints and targets stay as they are, even targets without observations, so
/// that their numbers mean the same; configurations left without observations are dropped and the others keep their
/// order.
Measurements subset(const Measurements& measurements, const std::function<bool(const Observation&)>& keep);

/// The measurements without some configurations ("12") or points of them ("12:A"), which `remark` names. Throws
/// InputError where nothing is called so or nothing is left.
Measurements without_rows(const Measurements& measurements, const std::vector<std::string>& names);

/// One observation per configuration and target, ordered so: the mean over the repeats, with repeat 1. Its sigma is
/// that of a mean of independent values, sqrt(sum sigma^2) / n, and 0 where one of the rows states none; its order is
/// that of the first row. Orientations
/// are averaged over the rows that have one: the mean is the eigenvector of the largest eigenvalue of sum q q^T
/// (Markley, Cheng, Crassidis and Oshman 2007, eq. 13), on the side of the first.
Measurements averaged(const Measurements& measurements);

/// The training rows of measurements, with all configurations and targets under their numbers: the measurements
/// themselves where there are no other rows, else a copy. Keeps a reference to the measurements.
class TrainingRows {
public:
  explicit TrainingRows(const Measurements& measurements);
  explicit TrainingRows(Measurements&&) = delete;

  const Measurements& operator*() const { return apart_ ? *apart_ : all_; }
  /// Whether there are rows of another split.
  bool has_others() const { return apart_.has_value(); }
  /// Of the values of all rows those of the training rows; of no values none.
  std::vector<double> values_of(std::vector<double> of_all) const;
  /// The values of the training rows among all rows, of which the others get `other`; of no values none.
  std::vector<double> among_all(std::vector<double> values, double other) const;

private:
  const Measurements& all_;
  std::optional<Measurements> apart_;
};

/// Of each configuration, whether it has training rows.
std::vector<bool> trained_configurations(const Measurements& measurements);

/// The training rows of at most so many configurations, evenly spaced over those that have any.
Measurements training_sample(const Measurements& measurements, std::size_t most_configurations);

/// The directions from which the joints came to each configuration where the order of the observations is known (see
/// DriveSignals), else empty. Observations of one configuration that follow each other are one visit.
Eigen::MatrixXd approach_directions(const Measurements& measurements);

/// Least and largest value of each joint in the training rows; the least above the largest where there are none.
JointRanges trained_ranges(const Measurements& measurements);

/// The measurements of `second` behind those of `first`; same joints and targets. Where only one of them has
/// orientations the rows of the other are points alone; the order is lost unless both have one, and so are signals.
Measurements joined(const Measurements& first, const Measurements& second);

}  // namespace kdl_calibration
