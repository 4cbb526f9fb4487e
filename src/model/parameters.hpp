#pragma once

// Names, kinds and axes of the parameters of a model. Indices in the model must be sound, see check(ErrorModel).

#include <cstddef>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"

namespace kdl_calibration {

/// Whether the parameter is a length [m] rather than an angle [rad].
bool is_length(const ErrorModel& model, const ErrorParameter& parameter);
/// Whether the effect moves its joint along its axis [m] rather than turning it [rad].
bool is_length(const ErrorModel& model, const EffectTerm& term);

/// Typical 1 sigma of this error of an uncalibrated arm: 3 mm or 5 mrad.
double usual_error(const ErrorModel& model, const ErrorParameter& parameter);

/// Unit axis of its motion, in the frame of the joint's origin.
KDL::Vector parameter_axis(const ErrorModel& model, const ErrorParameter& parameter);

/// Index of the parameter with this name. Throws InputError if there is none.
std::size_t parameter_index(const ErrorModel& model, const std::string& name);

/// The target with this name; a null pointer if there is none.
const TargetFrame* find_target(const std::vector<TargetFrame>& targets, const std::string& name);

/// The pose of the base at this station; a null pointer if there is none.
const Eigen::Isometry3d* find_base(const std::vector<StationBase>& bases, const std::string& station);

/// The model with the stations of these measurements, if they are several or measured single coordinates, which may
/// leave the base undetermined without any consequence for the arm.
ErrorModel model_at_stations(const Measurements& measurements, ErrorModel model);

/// Names "base.Tx" … "base.Rz".
const std::vector<std::string>& base_parameter_names();
/// The same of each station, "base[A].Tx", if the model has several.
std::vector<std::string> base_parameter_names(const ErrorModel& model);
/// Whether the name is one of these.
bool is_of_station(const std::string& name);
/// The other names.
std::vector<std::string> without_stations(std::vector<std::string> names);
/// Names "A.x", "A.y", "A.z", and "A.Rx" … where the orientation is measured.
std::vector<std::string> target_parameter_names(const TargetFrame& target);
/// Names of the base (or bases), then of all targets.
std::vector<std::string> frame_parameter_names(const std::vector<TargetFrame>& targets,
                                               std::vector<std::string> names = base_parameter_names());

/// [m] sum of the link lengths, base included.
double arm_length(const ErrorModel& model);
/// [m] largest distance of the flange from the first joint: sum of the link lengths without the base, and of the
/// travels of prismatic joints with both limits.
double reach(const ErrorModel& model);

}  // namespace kdl_calibration
