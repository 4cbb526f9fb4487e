#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "estimation/least_squares.hpp"
#include "estimation/registration.hpp"
#include "estimation/residual_options.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/training_rows.hpp"

namespace kdl_calibration {

enum class Termination {
  converged,        ///< the last step moved the predicted points by less than the tolerance
  iteration_limit,  ///< not converged within the iterations
  stalled,          ///< no step reduces the misfit but the gradient does not vanish, or a trial misses its goal
  rank_deficient,   ///< converged, but some parameters are not determined by the measurements
  diverged          ///< not finite, or implausibly large errors
};
std::string to_string(Termination termination);

struct Identification {
  Termination termination = Termination::iteration_limit;
  std::string message = "not run";
  int iterations = 0;
  Estimate estimate;
  double rms = 0.0;                 ///< [m] weighted 3D residual over the fitted points, repeats included
  std::vector<double> rms_history;  ///< [m] before each iteration or round (two-step)
  /// Two-step only: the observed ratio of successive parameter changes (geometric mean), the factor of linear
  /// convergence; 0 where fewer than three rounds were run.
  double convergence_factor = 0.0;
};

/// Whether a fit ended where its gradient vanishes.
bool has_converged(const Identification& found);

/// Puts the iterations of an earlier fit before those of the one that continues it.
void prepend_history(const Identification& earlier, Identification& later);

/// Zero errors, with base and targets registered.
Estimate nominal_start(const ErrorModel& model, const Measurements& measurements,
                       const RegistrationOptions& options = {});

struct JointOptions {
  int max_iterations = kJointIterations;
  double step_tolerance = 1e-11;  ///< [m] RMS motion of the predicted points below which a step counts as converged
  /// [m] a misfit (Identification::rms) that a trial fit must reach to matter. From the sixth iteration on, the fit
  /// ends as stalled unless the excess over it halves within three iterations.
  double goal = std::numeric_limits<double>::infinity();
  ResidualOptions residuals;
};

/// Estimates all parameters together by Gauss-Newton steps. A step that is too long or has a gain ratio below 0.5
/// switches to regularised steps. These have a trust region and a prior of the usual errors (3 mm, 5 mrad; targets 0.1
/// m about the flange), scaled by the misfit. The prior fades as the misfit falls and is zero at the end. No step
/// increases the cost beyond rounding. Converged: a plain step moves the predicted points by less than the tolerance.
/// Throws InputError if there are fewer equations than unknowns.
Identification identify_jointly(const ErrorModel& model, const Measurements& measurements, const Estimate& start,
                                const Unknowns& free, const JointOptions& options = {});

/// Options of a fit, also used for its repetitions.
struct FitOptions {
  Loss loss = Loss::none;
  JointOptions joint;
  std::function<void()> after_fit;  ///< called by `fit` after each fit, from any thread; for progress
};

/// A fit: model, measurements, start, unknowns and options. Keeps references to the first two.
struct FitProblem {
  const ErrorModel& model;
  const Measurements& measurements;
  Estimate start;
  Unknowns free;
  FitOptions options = {};
};
/// The same with other measurements, to which a reference is kept.
FitProblem with_measurements(const FitProblem& problem, const Measurements& measurements);

/// The problem restricted to the training rows and their weights. Keeps the references of the given problem.
class TrainingProblem {
public:
  explicit TrainingProblem(const FitProblem& problem);
  TrainingProblem(const TrainingProblem&) = delete;
  TrainingProblem& operator=(const TrainingProblem&) = delete;

  const FitProblem& operator*() const { return problem_; }
  const TrainingRows& rows() const { return rows_; }

private:
  TrainingRows rows_;
  FitProblem problem_;
};

/// identify_jointly, or identify_robustly with a robust loss.
Identification fit(const FitProblem& problem);

struct RobustIdentification {
  Identification fit;
  std::vector<double> weights;    ///< of each observation: 1 full, 0 ignored; 1 for test rows
  std::vector<double> distances;  ///< r of each observation
  double scale = 0.0;             ///< unit of r: 1 means exactly the stated noise
};

/// Zero weights are raised to this, so that a target without other rows stays determined.
constexpr double kLeastRobustWeight = 1e-9;

/// identify_jointly with iteratively reweighted rows. The scale is the median of the whitened residuals over that of
/// the chi distribution, updated in each round; Tukey starts from the Huber estimate.
RobustIdentification identify_robustly(const FitProblem& problem);

}  // namespace kdl_calibration
