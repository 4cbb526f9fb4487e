#pragma once

// JSON blocks that a page shows beside a result.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "results/report_page.hpp"
#include "results/result_blocks.hpp"
#include "results/saved_calibration.hpp"

namespace kdl_calibration {

/// The joints and their values (joints x configurations) as people know them: the controller's, else the URDF's.
struct ShownJoints {
  Json joints;
  Eigen::MatrixXd values;
};
ShownJoints shown_joints(const ErrorModel& model, const Eigen::MatrixXd& q,
                         const std::optional<JointConvention>& given);

Json robot_block(const Robot& robot, const ErrorModel& model, const Estimate& estimate);
Json measurements_block(const ReportedMeasurements& reported);

/// Indices of the rows to show on a page: all or, above kMostPointsOfPage, evenly spaced ones and the largest;
/// ascending.
std::vector<std::size_t> shown_rows(const std::vector<double>& distances);

/// {"count", "values"}: the values in ascending order, thinned if there are many.
Json distribution_json(std::vector<double> values);

/// Effect of each group on each joint over its measured range, other joints at mid-range, with its 95 % band: [joint
/// value, effect, half width of the band] [rad] or [m]. The effect is null where no fitted joint value is within a
/// tenth of the range, and where a table is withheld.
Json effects_block(const CalibrationParts& saved, const Measurements& measurements);

/// The strongest correlations of a covariance {"names", "matrix"}, or "lower_triangle" in older files, and the matrix
/// of the parameters in them.
Json correlations_block(const Json& covariance);

}  // namespace kdl_calibration
