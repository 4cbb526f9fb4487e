#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/least_squares.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/registration.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

enum class Termination {
  converged,        ///< the last step moved the predicted points by less than the tolerance
  iteration_limit,  ///< still moving
  stalled,          ///< no step reduces the misfit although the gradient does not vanish; or a trial is in vain
  rank_deficient,   ///< converged, but some parameters are not determined by the measurements
  diverged          ///< not finite, or errors beyond any robot's
};
std::string to_string(Termination termination);

struct Identification {
  Termination termination = Termination::iteration_limit;
  std::string message = "not run";
  int iterations = 0;
  Estimate estimate;
  double rms = 0.0;                 ///< [m] weighted 3D residual over the fitted points, repeats included
  std::vector<double> rms_history;  ///< [m] before each iteration; of each round of the two-step procedure its misfit
  /// Two-step only: the observed ratio of successive parameter changes (geometric mean), the factor of linear
  /// convergence; 0 where fewer than three rounds were run.
  double convergence_factor = 0.0;
};

/// Whether a fit ended where its gradient vanishes.
bool arrived(const Identification& found);

/// Zero errors, with base and targets registered to them.
Estimate nominal_start(const ErrorModel& model, const Measurements& measurements,
                       const RegistrationOptions& options = {});

struct JointOptions {
  int max_iterations = 50;
  double step_tolerance = 1e-11;  ///< [m] RMS motion of the predicted points by a step that counts as none
  /// [m] as Identification::rms. For trials, which matter below that alone and get there soon if at all: from the sixth
  /// iteration on one ends as stalled that has not halved within three what lies above it.
  double goal = std::numeric_limits<double>::infinity();
  ResidualOptions residuals;
};

/// All parameters at once by Gauss-Newton steps. The first ones are plain; where one does not take off half of what it
/// promised, or goes beyond reason, the errors have a prior of the size that is usual of an arm (3 mm, 5 mrad; targets
/// 0.1 m about the flange) in units of the present misfit, which fades as the misfit falls and is gone at the end, and
/// a trust region in the same metric. No step that increases the cost is taken, but for its rounding. Converged means
/// that a plain step, and with it the scaled gradient, moves the predicted points by less than the tolerance. Throws
/// InputError where there are fewer equations than unknowns.
Identification identify_jointly(const ErrorModel& model, const Measurements& measurements, const Estimate& start,
                                const Unknowns& free, const JointOptions& options = {});

/// How much a residual counts that is large beside the others. With r the whitened 3D residual of a point's position
/// over its scale, the weight is 1 (none), min(1, 2.5/r) (Huber 1964) or (1 - (r/7)^2)^2 below r = 7 and 0 beyond
/// (Beaton and Tukey 1974). The constants leave more than 95 % of the information of clean normal data in three
/// dimensions.
enum class Loss { none, huber, tukey };

/// How a fit is done wherever it is repeated.
struct FitOptions {
  Loss loss = Loss::none;
  JointOptions joint;
  std::function<void()> after_fit;  ///< called by `fit` behind each, from any thread; for progress
};

/// A fit: what of which model is fitted to which measurements, from where and how. Keeps references to the first two.
struct FitProblem {
  const ErrorModel& model;
  const Measurements& measurements;
  Estimate start;
  Unknowns free;
  FitOptions options = {};
};
/// The same with other measurements, to which a reference is kept.
FitProblem with_measurements(const FitProblem& problem, const Measurements& measurements);

/// The problem of the training rows alone, without the weights of other rows. Keeps references to what the problem
/// does.
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

/// identify_jointly, or identify_robustly where there is a loss.
Identification fit(const FitProblem& problem);

struct RobustIdentification {
  Identification fit;
  std::vector<double> weights;    ///< of each observation: 1 full, 0 ignored; 1 for test rows
  std::vector<double> distances;  ///< r of each observation
  double scale = 0.0;             ///< r counts in units of this: 1 would be exactly the stated noise
};

/// identify_jointly with iteratively reweighted rows. The scale is the median of the whitened residuals over that of
/// the chi distribution, found anew in each round; Tukey starts from the Huber estimate.
RobustIdentification identify_robustly(const FitProblem& problem);

}  // namespace kdl_calibration
