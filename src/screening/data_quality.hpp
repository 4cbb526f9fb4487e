#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "estimation/identification.hpp"
#include "estimation/registration.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

enum class QualityKind : std::uint8_t {
  slipped_target,          ///< displaced on the tool in all later configurations
  swapped_targets,         ///< the named targets were measured under each other's names
  mistaken_target,         ///< the row of the first target lies where the second one is
  mistyped_coordinate,     ///< one coordinate alone is off
  displaced_point,         ///< off along several axes, or along unknown axes
  displaced_configuration  ///< all targets off, one by five times its limit: wrong joint values
};
std::string to_string(QualityKind kind);

/// Something wrong with the measurements themselves.
struct QualityFinding {
  QualityKind kind = QualityKind::displaced_point;
  std::string configuration;         ///< label; for a slip the last one before it
  int repeat = 0;                    ///< 0: all repeats of the configuration (slip: of all later ones)
  std::vector<std::string> targets;  ///< several for displaced_point and slipped_target: one of them is wrong
  char axis = ' ';                   ///< of mistyped_coordinate: 'x', 'y' or 'z' in W
  double amount = 0.0;               ///< [m] size of the displacement; a lower bound if from distances alone
  /// [m] the displacement: for a slip in the flange frame, else in W; zero if found from distances alone.
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  std::string message;  ///< one line for the user
};

/// Thresholds. Sigma, the standard deviation of the noise, is the root mean square of the values within three times
/// 1.4826 median absolute deviations, corrected for that limit and for the parameters fitted. The limit of a value is t
/// sigma. t is Student's two-sided quantile (of the norm of three components for slips of points). Its level is
/// `false_alarm` over the number of values compared (Bonferroni), with 0.8 degrees of freedom per value.
struct QualityOptions {
  double false_alarm = 1e-6;   ///< probability of any finding in a whole set of Gaussian data, per check; real data
                               ///< have heavier tails, and typing errors are far beyond
  double noise_floor = 1e-9;   ///< [m] smallest sigma, for data without noise
  double smallest_slip = 3.0;  ///< in sigma of one configuration; a model misfit can imitate smaller slips
  int segment = 3;             ///< least configurations on either side of a slip, of 10 at least in all
};
constexpr QualityOptions kQuality{};

/// Checks the distances between targets, which are constant on a rigid tool. Needs no robot. Displacements are lower
/// bounds. If the distances cannot decide between two targets, both are named. Slips normal to the plane of the targets
/// and swaps that preserve all distances go unnoticed. All rows are checked, train and test.
std::vector<QualityFinding> check_distances(const Measurements& measurements);

/// Checks the residuals of a preliminary fit. Wrong rows must not have spoiled it: use identify_robustly, or a fit from
/// a near start. Slips are searched in the residuals of each target in the flange frame, in order of the
/// configurations, with the medians over the repeats: binary segmentation (Scott and Knott 1974) by the largest
/// difference of winsorised means, located by the smallest sum of absolute deviations. Then each row's residual is
/// checked along the axes of W. Sigma is pooled over targets and axes; rows with a stated sigma count in proportion to
/// it. Test rows are checked too, against the larger of the scatter of the train rows and their own. A robust fit may
/// have ignored a row of high leverage h, so the limits are divided by sqrt(1 - h). h is 2.5 times the mean p / n, for
/// p unknowns (base, targets, nonzero errors and effects) and n equations (repeats counted once). Empty if that factor
/// exceeds 5: with so few measurements a robust fit may follow any of them.
std::vector<QualityFinding> check_residuals(const ErrorModel& model, const Measurements& measurements,
                                            const Estimate& estimate);

/// Both checks: the findings of the residuals, then those of the distances for other targets and configurations.
std::vector<QualityFinding> check_measurements(const ErrorModel& model, const Measurements& measurements,
                                               const Estimate& estimate);

}  // namespace kdl_calibration
