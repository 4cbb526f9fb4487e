#pragma once

// Everything that is public. Functions throw InputError for bad input, in one line: what, where, what was expected.

#include "kdl_calibration/accuracy.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/doubt.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/kinematic_export.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/measuring_plan.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "kdl_calibration/report_page.hpp"
#include "kdl_calibration/result_file.hpp"
#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/simulation.hpp"
#include "kdl_calibration/validation.hpp"
#include "kdl_calibration/version.hpp"
