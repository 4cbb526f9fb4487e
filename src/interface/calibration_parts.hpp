#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "calibration/calibration_result.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "results/saved_calibration.hpp"

namespace kdl_calibration {

/// Throws InputError for another number of joint values, values that are not finite and a mimic joint that does not
/// follow its leader.
void require_joint_values(const Eigen::Ref<const Eigen::VectorXd>& q, const std::vector<MovingJoint>& joints);
/// Hash of the rows, joint values, signals and names: of all that a fit reads.
std::string hash_of(const Measurements& measurements);
/// Throws InputError if the joints are not those of the URDF text: errors would go into a text that they do not fit.
void require_as_parsed(const Robot& robot);
/// Throws InputError if a configuration has train and test rows: what is known of the one is no test of the other.
void require_one_split(const Measurements& measurements);
/// Throws InputError if a temperature or payload that effects of the model depend on is not stated, or not of each
/// configuration.
void require_circumstances(const Measurements& measurements, const ErrorModel& model);
/// Throws InputError for temperatures of links that the robot does not have, and of two that are fixed to each other.
void require_links(const Measurements& measurements, const Robot& robot);
/// Throws InputError if the calibration is one of another robot.
void require_same_robot(const Robot& robot, const Calibration& calibration);
/// Throws InputError for a convention that is not of these joints, and for another one that is not whole.
void require_conventions(const DiagnosisOptions& options, const std::vector<MovingJoint>& joints);
/// The arm as the URDF says.
PredictionBasis nominal_basis(const Robot& robot);
/// The fit that calibrate() summarises. Throws InputError as calibrate() does.
CalibrationResult fit(const Robot& robot, const Measurements& measurements, const CalibrationOptions& options);
/// The fit behind a calibration. Throws InputError if that was read from a file, or for another robot or other
/// measurements.
const CalibrationResult& fit_of(const Robot& robot, const Measurements& measurements, const Calibration& calibration);

}  // namespace kdl_calibration
