#include "results/calibrated_urdf.hpp"

#include <cstddef>

#include "base/preconditions.hpp"
#include "calibration/calibration_result.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/error_chains.hpp"

namespace kdl_calibration {

std::vector<OriginCorrection> origin_corrections(const ErrorModel& model, const Eigen::VectorXd& errors) {
  require_count("errors", errors.size(), model.parameters.size());
  require_finite("an error", errors.allFinite());
  std::vector<OriginCorrection> corrections;
  for (int frame = 0; frame <= static_cast<int>(model.joints.size()); ++frame) {
    const KDL::Frame correction = frame_correction(model, errors, frame);
    if (to_eigen(correction).matrix() == Eigen::Matrix4d::Identity()) {  // KDL's comparison has a tolerance of 1e-6
      continue;
    }
    const bool tip = frame == static_cast<int>(model.joints.size());
    const std::string& joint = tip ? model.tip_joint : model.joints[static_cast<std::size_t>(frame)].name;
    if (joint.empty()) {
      throw InputError("the errors of the last link cannot be exported: no fixed joint between joint '" +
                       model.joints.back().name + "' and the tip carries them");
    }
    corrections.push_back({.joint = joint, .correction = correction});
  }
  return corrections;
}

std::string calibrated_urdf(const Robot& robot, const ErrorModel& model, const Eigen::VectorXd& errors) {
  return corrected_urdf(robot.urdf, origin_corrections(model, errors));
}

std::string calibrated_urdf(const Robot& robot, const CalibrationResult& calibration) {
  return calibration.exported.nominal_kept
             ? robot.urdf
             : calibrated_urdf(robot, calibration.model, calibration.exported.estimate.errors);
}

}  // namespace kdl_calibration
