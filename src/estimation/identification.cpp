#include "estimation/identification.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/preconditions.hpp"
#include "base/robust_statistics.hpp"
#include "estimation/descent.hpp"
#include "estimation/input_check.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Vector3d;
using Eigen::VectorXd;

}  // namespace

std::string to_string(Termination termination) {
  switch (termination) {
    case Termination::converged:
      return "converged";
    case Termination::iteration_limit:
      return "iteration_limit";
    case Termination::stalled:
      return "stalled";
    case Termination::rank_deficient:
      return "rank_deficient";
    case Termination::diverged:
      return "diverged";
  }
  return "unknown";
}

Estimate nominal_start(const ErrorModel& model, const Measurements& measurements, const RegistrationOptions& options) {
  check(measurements, model);
  Estimate start;
  start.errors = VectorXd::Zero(static_cast<Index>(model.parameters.size()));
  const Registration registration = register_base_and_targets(
      flange_poses(folded(model, start.errors), measurements.joint_values), measurements, options);
  start.frames = registration.frames;
  return start;
}

namespace {

// An earlier result leaves base and targets unknown.
void require_enough_equations(const LeastSquaresProblem& problem, const ResidualOptions& options,
                              const std::string& source) {
  const Index unknowns = problem.columns() - (options.earlier ? std::ssize(options.earlier->names) : 0);
  if (problem.equations() < unknowns) {
    throw InputError(fmt::format(
        "{}: too few measurements: {} measured coordinates for {} unknowns; at least {} are needed ({} whole points)",
        source, problem.equations(), unknowns, unknowns, (unknowns + 2) / 3));
  }
}

}  // namespace

Identification identify_jointly(const ErrorModel& model, const Measurements& measurements, const Estimate& start,
                                const Unknowns& free, const JointOptions& options) {
  check(start, model, measurements);
  const LeastSquaresProblem problem(model, measurements, free, options.residuals);
  require_enough_equations(problem, options.residuals, measurements.source);
  return descend(problem, start, options);
}

// ---- robust estimate -----------------------------------------------------------------------------------------------

namespace {

constexpr double kHuber = 2.5;
constexpr double kTukey = 7.0;
constexpr double kMedianChi3 = 1.5381722544550522;  // median of the chi distribution with three degrees of freedom
constexpr int kReweightings = 50;
constexpr double kSmallStep = 0.05;  // relative to the misfit

double robust_weight(Loss loss, double r) {
  switch (loss) {
    case Loss::none:
      return 1.0;
    case Loss::huber:
      return r <= kHuber ? 1.0 : kHuber / r;
    case Loss::tukey: {
      const double t = 1.0 - (r / kTukey) * (r / kTukey);
      return r < kTukey ? t * t : 0.0;
    }
  }
  return 1.0;
}

// Position residual of every row in units of its sigma (in metres if none is stated).
std::vector<double> row_distances(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                                  const NoiseModel& noise) {
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements);
  std::vector<double> distances;
  distances.reserve(measurements.observations.size());
  for (const Observation& o : measurements.observations) {
    const Eigen::Matrix3d information =
        (point_covariance(noise, o) + Eigen::Matrix3d(noise.common.cwiseAbs2().asDiagonal())).inverse();
    const Vector3d e = measured_minus_predicted(o, estimate, X_BF);
    distances.push_back(information.allFinite() ? std::sqrt(e.dot(information * e)) : e.norm());
  }
  return distances;
}

}  // namespace

FitProblem with_measurements(const FitProblem& problem, const Measurements& measurements) {
  return {.model = problem.model,
          .measurements = measurements,
          .start = problem.start,
          .free = problem.free,
          .options = problem.options};
}

TrainingProblem::TrainingProblem(const FitProblem& problem)
    : rows_(problem.measurements), problem_(with_measurements(problem, *rows_)) {
  std::vector<double>& weights = problem_.options.joint.residuals.row_weights;
  weights = rows_.values_of(std::move(weights));
}

bool has_converged(const Identification& found) {
  return found.termination == Termination::converged || found.termination == Termination::rank_deficient;
}

void prepend_history(const Identification& earlier, Identification& later) {
  later.iterations += earlier.iterations;
  later.rms_history.insert(later.rms_history.begin(), earlier.rms_history.begin(), earlier.rms_history.end());
}

Identification fit(const FitProblem& problem) {
  Identification found =
      problem.options.loss == Loss::none
          ? identify_jointly(problem.model, problem.measurements, problem.start, problem.free, problem.options.joint)
          : identify_robustly(problem).fit;
  if (problem.options.after_fit) {
    problem.options.after_fit();
  }
  return found;
}

namespace {

// Robust fit of training rows.
RobustIdentification reweighted_fit(const FitProblem& problem) {
  const Measurements& measurements = problem.measurements;
  const Loss loss = problem.options.loss;
  const JointOptions& options = problem.options.joint;
  RobustIdentification result;
  result.fit = identify_jointly(problem.model, measurements, problem.start, problem.free, options);
  result.weights.assign(measurements.observations.size(), 1.0);
  JointOptions reweighted = options;
  const auto update = [&](Loss current) {
    result.distances = row_distances(problem.model, measurements, result.fit.estimate, options.residuals.noise);
    result.scale = std::max(median(result.distances) / kMedianChi3, 1e-12);
    double change = 0.0;
    for (std::size_t row = 0; row < result.weights.size(); ++row) {
      result.distances[row] /= result.scale;
      const double weight = robust_weight(current, result.distances[row]);
      change = std::max(change, std::abs(weight - result.weights[row]));
      result.weights[row] = weight;
    }
    return change;
  };
  const std::vector<Loss> stages =
      loss == Loss::tukey ? std::vector<Loss>{Loss::huber, Loss::tukey} : std::vector<Loss>{loss};
  for (const Loss stage : stages) {
    bool followed = true;  // whether the fit was continued to its end
    for (int round = 0; round < kReweightings && loss != Loss::none; ++round) {
      const bool settled = update(stage) < 1e-6;
      if (settled && followed) {
        break;
      }
      // While the weights change, a fit ends at a step that is small relative to the misfit.
      followed = settled;
      reweighted.step_tolerance =
          settled ? options.step_tolerance : std::max(options.step_tolerance, kSmallStep * result.fit.rms);
      reweighted.residuals.row_weights = result.weights;
      for (double& weight : reweighted.residuals.row_weights) {
        weight = std::max(weight, kLeastRobustWeight);
      }
      const Identification before = std::move(result.fit);
      result.fit = identify_jointly(problem.model, measurements, before.estimate, problem.free, reweighted);
      prepend_history(before, result.fit);
    }
  }
  if (loss == Loss::none) {
    update(loss);
  }
  return result;
}

}  // namespace

RobustIdentification identify_robustly(const FitProblem& problem) {
  const TrainingProblem training(problem);
  RobustIdentification result = reweighted_fit(*training);
  result.weights = training.rows().values_among_all(std::move(result.weights), 1.0);
  if (training.rows().has_others()) {
    result.distances =
        row_distances(problem.model, problem.measurements, result.fit.estimate, problem.options.joint.residuals.noise);
    for (double& distance : result.distances) {
      distance /= result.scale;
    }
  }
  return result;
}

}  // namespace kdl_calibration
