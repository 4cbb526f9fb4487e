#include "kdl_calibration/convention_trial.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "base/parallel.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/mimic.hpp"
#include "kdl_calibration/prediction.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// The joint values of the file, and the convention that made them the URDF's.
struct Reading {
  MatrixXd matrix;
  VectorXd offset;
};

ConventionTrial trial(std::string description, const MatrixXd& controller_values, const Reading& reading) {
  return {.description = std::move(description),
          .rms = kInfinity,
          .joint_values = (reading.matrix * controller_values).colwise() + reading.offset};
}

std::string named(const JointConvention& convention) {
  return "the convention " + std::filesystem::path(convention.name).filename().string();
}

bool same_reading(const ConventionTrial& a, const ConventionTrial& b) {
  return (a.joint_values - b.joint_values).isZero(1e-12);
}

// The convention's rows as the independent joints, its columns as those of `used`; nothing for other joints.
std::optional<Reading> reading_of(const JointConvention& convention, const std::vector<std::string>& joints,
                                  const JointConvention* used) {
  const auto known = [&](const std::string& name) {
    return std::find(convention.urdf_joints.begin(), convention.urdf_joints.end(), name) !=
           convention.urdf_joints.end();
  };
  if (convention.urdf_joints.size() != joints.size() || !std::all_of(joints.begin(), joints.end(), known)) {
    return std::nullopt;
  }
  const JointConvention ordered = matched_convention(convention, joints);
  Reading reading{.matrix = ordered.matrix, .offset = ordered.offset};
  if (used != nullptr) {
    for (std::size_t j = 0; j < used->controller_joints.size(); ++j) {
      const auto found =
          std::find(ordered.controller_joints.begin(), ordered.controller_joints.end(), used->controller_joints[j]);
      if (found == ordered.controller_joints.end()) {
        return std::nullopt;
      }
      reading.matrix.col(static_cast<Index>(j)) = ordered.matrix.col(found - ordered.controller_joints.begin());
    }
  }
  return reading;
}

std::vector<ConventionTrial> readings(const std::vector<std::string>& names, const MatrixXd& joint_values,
                                      const JointConvention* used, const std::vector<JointConvention>& others) {
  const auto joints = static_cast<Index>(names.size());
  Reading present{.matrix = MatrixXd::Identity(joints, joints), .offset = VectorXd::Zero(joints)};
  if (used != nullptr) {
    const JointConvention ordered = matched_convention(*used, names);
    present = {.matrix = ordered.matrix, .offset = ordered.offset};
  }
  const MatrixXd controller = present.matrix.partialPivLu().solve(joint_values.colwise() - present.offset);
  std::vector<ConventionTrial> trials = {
      trial(used != nullptr ? named(*used) : "the joint values as they are", controller, present)};
  trials.front().present = true;
  const auto consider = [&](ConventionTrial candidate) {
    if (std::none_of(trials.begin(), trials.end(), [&](const auto& other) { return same_reading(other, candidate); })) {
      trials.push_back(std::move(candidate));
    }
  };
  for (const JointConvention& other : others) {
    if (const auto reading = reading_of(other, names, used)) {
      consider(trial(named(other), controller, *reading));
    }
  }
  if (used != nullptr) {
    consider(trial("the joint values as they are", controller,
                   {.matrix = MatrixXd::Identity(joints, joints), .offset = VectorXd::Zero(joints)}));
  }
  for (Index j = 0; j < joints; ++j) {
    Reading flipped = present;
    flipped.matrix.row(j) *= -1.0;
    consider(trial(names[static_cast<std::size_t>(j)] + " with the opposite sign", controller, flipped));
  }
  for (Index j = 0; used != nullptr && j < joints; ++j) {
    Reading flipped = present;
    flipped.matrix.col(j) *= -1.0;
    consider(
        trial("the controller's " + used->controller_joints[static_cast<std::size_t>(j)] + " with the opposite sign",
              controller, flipped));
  }
  return trials;
}

// Errors that no robot has: with enough of them a wrong reading may fit, e.g. the fifth joint's opposite sign as half a
// turn of the fourth and the sixth.
bool plausible(const ErrorModel& model, const VectorXd& errors) {
  constexpr double kLargestLength = 0.05;  // [m]
  constexpr double kLargestAngle = 0.35;   // [rad]
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const double limit = is_length(model, model.parameters[p]) ? kLargestLength : kLargestAngle;
    if (!(std::abs(errors[static_cast<Index>(p)]) < limit)) {
      return false;
    }
  }
  return true;
}

double rms_of(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements.joint_values);
  double sum = 0.0;
  double count = 0.0;
  for (const Observation& observation : measurements.observations) {
    if (observation.split == Split::train) {
      sum += (observation.position - predicted_point(estimate, X_BF, observation)).squaredNorm();
      count += 1.0;
    }
  }
  const double rms = std::sqrt(sum / count);
  return std::isfinite(rms) ? rms : kInfinity;
}

}  // namespace

std::vector<ConventionTrial> try_conventions(const ErrorModel& model, const Measurements& measurements,
                                             const Unknowns& free, const JointConvention* used,
                                             const std::vector<JointConvention>& others,
                                             const ConventionOptions& options) {
  std::vector<ConventionTrial> trials =
      readings(independent_joint_names(model.joints), independent_joint_values(model.joints, measurements.joint_values),
               used, others);
  parallel_for(trials.size(), options.threads, [&](std::size_t i) {
    Measurements reread = measurements;
    trials[i].joint_values = all_joint_values(model.joints, trials[i].joint_values);
    reread.joint_values = trials[i].joint_values;
    const Estimate start = nominal_start(model, reread, options.registration);
    trials[i].rms = rms_of(model, reread, start);
    const Identification fit = identify_jointly(model, reread, start, free, options.joint);
    if (plausible(model, fit.estimate.errors)) {
      trials[i].rms = std::min(trials[i].rms, rms_of(model, reread, fit.estimate));
    }
  });
  std::stable_sort(trials.begin(), trials.end(),
                   [](const ConventionTrial& a, const ConventionTrial& b) { return a.rms < b.rms; });
  return trials;
}

std::optional<ConventionTrial> better_convention(const std::vector<ConventionTrial>& trials, double factor) {
  const auto present =
      std::find_if(trials.begin(), trials.end(), [](const ConventionTrial& trial) { return trial.present; });
  if (present == trials.end() || trials.front().present || !(trials.front().rms < factor * present->rms)) {
    return std::nullopt;
  }
  return trials.front();
}

}  // namespace kdl_calibration
