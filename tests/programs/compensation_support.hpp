#pragma once

// Arms with errors, and programs that are compensated for them.

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "base/random.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/error_model.hpp"
#include "programs/compensated_program.hpp"
#include "programs/program_language.hpp"
#include "support.hpp"

namespace kdl_calibration::testing {

/// A trusted calibration that found these errors.
inline Calibration calibration_of(const ErrorModel& model, const Eigen::VectorXd& errors) {
  CalibrationParts parts;
  parts.model = model;
  parts.estimate.errors = parts.urdf_errors = errors;
  parts.verdict = Verdict::trusted;
  return Calibration(std::make_shared<CalibrationParts>(std::move(parts)));
}

/// One with random errors of this size [m and rad].
inline Calibration bent(const Robot& robot, double size, std::uint64_t seed) {
  const ErrorModel model = complete_model(robot);
  Random random(seed);
  return calibration_of(model, random_errors(model, random, size, size));
}

/// The program in the language of its text.
inline CompensatedProgram compensated(const Robot& robot, const Compensator& compensator, const Controller& controller,
                                      const std::vector<ProgramText>& texts, const CompensatedJoints& near = {}) {
  return compensated_program(
      {.robot = robot, .compensator = compensator, .controller = controller, .language = language_of(texts.front())},
      texts, near);
}

inline Eigen::Isometry3d by_kdl(const KDL::Chain& chain, const Eigen::VectorXd& q) {
  return to_eigen(kdl_pose(chain, q));
}

}  // namespace kdl_calibration::testing
