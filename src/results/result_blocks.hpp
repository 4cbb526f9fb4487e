#pragma once

// Blocks of the result: JSON, and words that the table shares with it.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "results/result_json.hpp"

namespace kdl_calibration {

using Json = nlohmann::ordered_json;

Json array(const Eigen::Vector3d& v);
Json quaternion(const Eigen::Matrix3d& R);     ///< w x y z, w not negative
Json frame12(const Eigen::Isometry3d& frame);  ///< the first three rows, one after the other
/// The value, or null if not finite, as JSON has no infinity: not determined.
Json finite_or_null(double value);
/// "count", "mean", "rms", "p95", "max", "std"; null if the count is 0.
Json statistics_json(const ErrorStatistics& statistics);

/// Up to kMostColumns columns, else null: {"names", "lower_triangle", "matrix"}.
constexpr std::size_t kMostColumns = 300;
Json covariance_json(const CalibrationResult& calibration);

/// Measured minus predicted point of every row in W, up to kMostRows; above, the kLargestRows largest.
constexpr std::size_t kMostRows = 5000;
constexpr std::size_t kLargestRows = 200;
Json residuals_json(const Measurements& measurements, const CalibrationResult& calibration);

/// Left-out points and their predictions, null if more than kMostRows: {"configuration", "target", "distance"}.
Json held_out_points_json(const Measurements& measurements, const CalibrationResult& calibration);

/// Which axes were kept, and what the calibration with free axes leaves.
Json kept_axes_json(const CalibrationResult& calibration);
/// Accuracy of the exported URDF without effects.
Json exported_urdf_json(const Robot& robot, const CalibrationResult& calibration);

/// "gravity, gain (20 configurations needed); tables (50 configurations needed)"
std::string in_words(const std::vector<NotTried>& choices);

/// Whether a remark says how the measurements were read or treated, and asks for no action.
bool is_information(Cause cause);

Json files_json(const std::vector<HashedFile>& files);
Json provenance_json(const Provenance& provenance);

}  // namespace kdl_calibration
