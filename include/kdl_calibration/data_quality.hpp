#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"

namespace kdl_calibration {

enum class QualityKind : std::uint8_t {
  slipped_target,          ///< it sits elsewhere on the tool in all configurations behind the one named
  swapped_targets,         ///< each of the targets named was measured under the name of another one of them
  mistaken_target,         ///< the row of the first target lies where the second one is
  mistyped_coordinate,     ///< one coordinate alone is off
  displaced_point,         ///< off along several axes, or along axes that the distances do not tell
  displaced_configuration  ///< all targets are off by five times as much as a single one may: joint values
};
std::string to_string(QualityKind kind);

/// Something wrong with the measurements themselves.
struct QualityFinding {
  QualityKind kind = QualityKind::displaced_point;
  std::string configuration;         ///< label; of a slip the last one before it
  int repeat = 0;                    ///< 0: all repeats of the configuration (of a slip: all behind it)
  std::vector<std::string> targets;  ///< of displaced_point and slipped_target: one of these where they are several
  char axis = ' ';                   ///< of a mistyped coordinate: 'x', 'y' or 'z' in W
  double amount = 0.0;               ///< [m] size of the displacement; from distances alone a lower bound
  /// [m] the displacement: of a slip in the flange frame, else in W; zero where only distances tell.
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();
  std::string message;  ///< one line for people
};

/// Thresholds. Sigma, the standard deviation of the noise, is the root mean square of the values within three times
/// 1.4826 median absolute deviations, corrected for that limit and for the parameters fitted. A value is out where it
/// exceeds t sigma: t is Student's two-sided quantile (for slips of points the same of the norm of three components) at
/// `false_alarm` over the number of values compared (Bonferroni), with 0.8 degrees of freedom per value to spare.
struct QualityOptions {
  double false_alarm = 1e-6;   ///< probability of any finding in a whole set of Gaussian data, per check; real data
                               ///< have heavier tails, and typing errors are far beyond
  double noise_floor = 1e-9;   ///< [m] smallest sigma, for data without noise
  double smallest_slip = 3.0;  ///< in sigma of one configuration; what a model misfit may imitate is no slip
  int segment = 3;             ///< a slip leaves at least that many configurations on either side, of 10 at least
};

/// What the distances between targets tell, which a rigid tool keeps constant over all configurations and repeats. No
/// robot is needed. Displacements are lower bounds; where two targets share the blame both are named. Blind to slips
/// across the plane of the targets and to swaps that leave all distances alike. All rows are checked, train and test.
std::vector<QualityFinding> check_distances(const Measurements& measurements, const QualityOptions& options = {});

/// What the residuals of a preliminary fit tell. The fit must have survived the defects: identify_robustly, or one
/// whose start was near. Slips are looked for in the residuals of each target in the flange frame, in order of the
/// configurations, with the medians over the repeats: binary segmentation (Scott and Knott 1974) by the largest
/// difference of winsorised means, located by the smallest sum of absolute deviations. Then each row's residual is
/// checked along the axes of W. Sigma is pooled over targets and axes; rows with a stated sigma count in proportion to
/// it. Test rows are checked too, against the larger of the scatter of the train rows and their own. As a robust fit
/// may have left out a row that weighs much, the limits are those of a leverage h of 2.5 times the mean one, p / n for
/// p unknowns and n equations (repeats counted once), i.e. larger by 1 / sqrt(1 - h); errors and effects that are
/// not zero count as unknowns, base and targets always. Empty where that exceeds 5: with so few measurements a robust
/// fit may follow any of them. Throws InputError where the estimate has another number of targets.
std::vector<QualityFinding> check_residuals(const ErrorModel& model, const Measurements& measurements,
                                            const Estimate& estimate, const QualityOptions& options = {});

/// Both: the findings of the residuals, and those of the distances that concern no target and configuration (or slip)
/// already named.
std::vector<QualityFinding> check_measurements(const ErrorModel& model, const Measurements& measurements,
                                               const Estimate& estimate, const QualityOptions& options = {});

}  // namespace kdl_calibration
