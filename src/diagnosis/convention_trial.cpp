#include "diagnosis/convention_trial.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <numbers>
#include <utility>

#include "base/counted_fits.hpp"
#include "base/decompositions.hpp"
#include "base/degree.hpp"
#include "base/number_range.hpp"
#include "base/parallel.hpp"
#include "diagnosis/trial_fit.hpp"
#include "estimation/point_registration.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// A possible true unit of a joint value, with the factor that converts the value as read.
struct Unit {
  bool angle;
  double factor;
  const char* words;
};

constexpr std::array kUnits = {Unit{true, kDegree, "in degrees, read as radians"},
                               Unit{true, 1.0 / kDegree, "in radians, read as degrees"},
                               Unit{true, 0.9, "in gradians, read as degrees"},
                               Unit{true, 0.9 * kDegree, "in gradians, read as radians"},
                               Unit{true, 0.001, "in milliradians, read as radians"},
                               Unit{true, 2.0 * std::numbers::pi, "in turns, read as radians"},
                               Unit{true, 360.0, "in turns, read as degrees"},
                               Unit{false, 0.001, "in millimetres, read as metres"},
                               Unit{false, 1000.0, "in metres, read as millimetres"},
                               Unit{false, 0.01, "in centimetres, read as metres"},
                               Unit{false, 10.0, "in centimetres, read as millimetres"},
                               Unit{false, 0.0254, "in inches, read as metres"},
                               Unit{false, 25.4, "in inches, read as millimetres"}};

// The joint values of the file and the convention that converts them.
struct JointReading {
  MatrixXd matrix;
  VectorXd offset;
};

ConventionTrial trial(std::optional<Cause> cause, std::string description, const MatrixXd& controller_values,
                      const JointReading& reading) {
  return {.cause = cause,
          .description = std::move(description),
          .registered = kInfinity,
          .rms = kInfinity,
          .joint_values = (reading.matrix * controller_values).colwise() + reading.offset};
}

std::string named(const JointConvention& convention) {
  return "the convention " + std::filesystem::path(convention.name).filename().string();
}

bool same_reading(const ConventionTrial& a, const ConventionTrial& b) {
  return (a.joint_values - b.joint_values).isZero(1e-12);
}

// The convention with rows ordered as the independent joints and columns as in `used`; empty for other joints.
std::optional<JointReading> reading_of(const JointConvention& convention, const std::vector<std::string>& joints,
                                       const JointConvention* used) {
  const auto known = [&](const std::string& name) {
    return std::find(convention.urdf_joints.begin(), convention.urdf_joints.end(), name) !=
           convention.urdf_joints.end();
  };
  if (convention.urdf_joints.size() != joints.size() || !std::all_of(joints.begin(), joints.end(), known)) {
    return std::nullopt;
  }
  const JointConvention ordered = matched_convention(convention, joints);
  JointReading reading{.matrix = ordered.matrix, .offset = ordered.offset};
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

// Collects distinct readings of the controller's joint values.
class Readings {
public:
  Readings(const std::vector<MovingJoint>& joints, const MatrixXd& joint_values, const JointConvention* used)
      : names_(independent_joint_names(joints)), used_(used) {
    for (const std::size_t i : independent_joints(joints)) {
      joints_.push_back(joints[i]);
    }
    present_ = as_they_are();
    if (used != nullptr) {
      const JointConvention ordered = matched_convention(*used, names_);
      present_ = {.matrix = ordered.matrix, .offset = ordered.offset};
    }
    parallel_ = parallel_to_the_one_before(joints);
    controller_ = solution(present_.matrix, joint_values.colwise() - present_.offset);
    trials_.push_back(
        trial(std::nullopt, used != nullptr ? named(*used) : "the joint values as they are", controller_, present_));
    trials_.front().present = true;
  }

  std::vector<ConventionTrial> all(const std::vector<JointConvention>& others) && {
    add_conventions(others);
    add_signs();
    add_units();
    add_couplings();
    add_exchanges();
    add_rest();
    return std::move(trials_);
  }

private:
  Index joint_count() const { return static_cast<Index>(names_.size()); }
  const std::string& name(Index j) const { return names_[static_cast<std::size_t>(j)]; }
  // Name of the controller's joint `j` in the convention used.
  std::string column(Index j) const {
    return used_ != nullptr ? used_->controller_joints[static_cast<std::size_t>(j)] : std::string();
  }
  bool turns(Index j) const { return joints_[static_cast<std::size_t>(j)].type != JointType::prismatic; }
  JointReading as_they_are() const {
    return {.matrix = MatrixXd::Identity(joint_count(), joint_count()), .offset = VectorXd::Zero(joint_count())};
  }

  // For each independent joint, whether the previous joint is independent too and both have parallel axes.
  static std::vector<bool> parallel_to_the_one_before(const std::vector<MovingJoint>& joints) {
    constexpr double kParallel = 1e-3;  // [rad]
    std::vector<bool> result;
    for (const std::size_t i : independent_joints(joints)) {
      const bool pair = i > 0 && !joints[i - 1].mimic && joints[i].type != JointType::prismatic &&
                        joints[i - 1].type != JointType::prismatic;
      result.push_back(pair && (joints[i - 1].axis * (joints[i].origin.M * joints[i].axis)).Norm() < kParallel);
    }
    return result;
  }

  void consider(ConventionTrial candidate, const std::vector<std::string>& joints = {}) {
    candidate.joints = subjects_named(SubjectKind::joint, joints);
    if (std::none_of(trials_.begin(), trials_.end(),
                     [&](const ConventionTrial& other) { return same_reading(other, candidate); })) {
      trials_.push_back(std::move(candidate));
    }
  }

  // Considers the URDF's values as read, multiplied by a matrix.
  void consider(Cause cause, std::string description, const std::vector<std::string>& joints, const MatrixXd& change) {
    consider(trial(cause, std::move(description), controller_,
                   {.matrix = change * present_.matrix, .offset = present_.offset}),
             joints);
  }

  // The same for the controller's values, if a convention couples joints.
  void consider_columns(Cause cause, const std::string& description, const std::vector<std::string>& joints,
                        const MatrixXd& change) {
    if (used_ != nullptr) {
      consider(trial(cause, "the controller's " + description, controller_,
                     {.matrix = present_.matrix * change, .offset = present_.offset}),
               joints);
    }
  }

  void add_conventions(const std::vector<JointConvention>& others) {
    for (const JointConvention& other : others) {
      if (const auto reading = reading_of(other, names_, used_)) {
        consider(trial(Cause::joint_convention, named(other), controller_, *reading));
      }
    }
    if (used_ != nullptr) {
      consider(trial(Cause::joint_convention, "the joint values as they are", controller_, as_they_are()));
    }
  }

  void add_signs() {
    for (Index j = 0; j < joint_count(); ++j) {
      MatrixXd change = as_they_are().matrix;
      change(j, j) = -1.0;
      consider(Cause::joint_sign, name(j) + " with the opposite sign", {name(j)}, change);
      consider_columns(Cause::joint_sign, column(j) + " with the opposite sign", {column(j)}, change);
    }
  }

  void add_units() {
    for (const Unit& unit : kUnits) {
      VectorXd every = VectorXd::Ones(joint_count());
      std::vector<std::string> turning;
      for (Index j = 0; j < joint_count(); ++j) {
        if (turns(j) == unit.angle) {
          VectorXd one = VectorXd::Ones(joint_count());
          one[j] = unit.factor;
          every[j] = unit.factor;
          turning.push_back(name(j));
          consider(Cause::joint_unit, name(j) + " " + unit.words, {name(j)}, one.asDiagonal());
          consider_columns(Cause::joint_unit, column(j) + " " + unit.words, {column(j)}, one.asDiagonal());
        }
      }
      if (unit.angle) {
        consider(Cause::joint_unit, std::string("all joint angles ") + unit.words, turning, every.asDiagonal());
      }
    }
  }

  // A joint value relative to the horizontal, as with parallelogram arms.
  void add_couplings() {
    for (Index j = 1; j < joint_count(); ++j) {
      for (const double sign : {1.0, -1.0}) {
        if (parallel_[static_cast<std::size_t>(j)]) {
          MatrixXd change = as_they_are().matrix;
          change(j, j - 1) = sign;
          consider(Cause::joint_convention, name(j) + (sign > 0.0 ? " + " : " - ") + name(j - 1) + " for " + name(j),
                   {name(j), name(j - 1)}, change);
        }
      }
    }
  }

  // The joint was at rest during measurement, at zero or at its first value, although the file's values change.
  void add_rest() {
    for (Index j = 0; j < joint_count(); ++j) {
      for (const double at : {0.0, controller_.cols() > 0 ? (present_.matrix * controller_.col(0))[j] : 0.0}) {
        JointReading reading = present_;
        reading.matrix.row(j).setZero();
        reading.offset[j] += at;
        const std::string where = at == 0.0 ? " at rest at zero" : " at rest at its first value";
        consider(trial(Cause::joint_at_rest, name(j) + where + " in every row", controller_, reading), {name(j)});
      }
    }
  }

  void add_exchanges() {
    constexpr Index kMostJoints = 10;  // up to which all pairs are tried
    for (Index j = 0; joint_count() <= kMostJoints && j < joint_count(); ++j) {
      for (Index k = j + 1; k < joint_count(); ++k) {
        MatrixXd change = as_they_are().matrix;
        change.row(j).swap(change.row(k));
        consider(Cause::joint_columns, name(j) + " and " + name(k) + " exchanged", {name(j), name(k)}, change);
        consider_columns(Cause::joint_columns, column(j) + " and " + column(k) + " exchanged", {column(j), column(k)},
                         change);
      }
    }
    const MatrixXd reversed = as_they_are().matrix.rowwise().reverse();
    consider(Cause::joint_columns, "the joints in reversed order", names_, reversed);
    if (used_ != nullptr) {
      consider_columns(Cause::joint_columns, "joints in reversed order", used_->controller_joints, reversed);
    }
  }

  std::vector<std::string> names_;
  std::vector<MovingJoint> joints_;
  std::vector<bool> parallel_;
  const JointConvention* used_;
  JointReading present_;
  MatrixXd controller_;
  std::vector<ConventionTrial> trials_;
};

}  // namespace

std::vector<ConventionTrial> try_conventions(const ErrorModel& model, const Measurements& measurements,
                                             const Unknowns& free, const ConventionOptions& options) {
  std::vector<ConventionTrial> trials =
      Readings(model.joints, independent_joint_values(model.joints, measurements.joint_values), options.used)
          .all(options.others);
  const TrialFit fit{.model = model, .free = free, .registration = options.registration, .joint = options.joint};
  const TrainingRows training(measurements);
  const auto reread = [&](std::size_t i) {
    Measurements result = *training;
    result.joint_values = trials[i].joint_values;
    return result;
  };
  std::vector<Estimate> starts(trials.size());
  const auto registered = [&](std::size_t i, const Measurements& as_read) {
    starts[i] = nominal_start(model, as_read, options.registration);
    return rms_of(model, as_read, starts[i]);
  };
  for (ConventionTrial& one : trials) {
    one.joint_values = all_joint_values(model.joints, one.joint_values);
  }
  trials.front().registered = registered(0, reread(0));  // the present reading is the first
  const double hopeless = kWorthAFit * trials.front().registered;
  const FoldedChain nominal = folded(model, VectorXd::Zero(static_cast<Index>(model.parameters.size())));
  const std::function<void()> done =
      counted_fits(options.progress, "trying other readings of the joints", 2 * trials.size() - 1);
  parallel_for(trials.size() - 1, options.threads, [&](std::size_t others) {
    const std::size_t i = others + 1;
    const Measurements as_read = reread(i);
    const double least = least_misfit(flange_poses(nominal, as_read.joint_values), as_read);
    trials[i].registered = least > hopeless ? least : registered(i, as_read);
    if (done) {
      done();
    }
  });
  const auto nearest = std::min_element(trials.begin(), trials.end(),
                                        [](const auto& a, const auto& b) { return a.registered < b.registered; });
  const double limit = std::min(hopeless, kWorthAFitBesideTheNearest * nearest->registered);
  parallel_for(trials.size(), options.threads, [&](std::size_t i) {
    trials[i].rms = trials[i].registered;
    if (trials[i].present || trials[i].registered < limit) {
      trials[i].rms = fitted_rms(fit, reread(i), starts[i]);
    }
    if (done) {
      done();
    }
  });
  std::stable_sort(trials.begin(), trials.end(),
                   [](const ConventionTrial& a, const ConventionTrial& b) { return a.rms < b.rms; });
  return trials;
}

}  // namespace kdl_calibration
