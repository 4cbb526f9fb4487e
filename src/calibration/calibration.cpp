#include "kdl_calibration/calibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <set>
#include <utility>

#include "base/f_distribution.hpp"
#include "base/text.hpp"
#include "calibration/parameter_choice.hpp"
#include "calibration/variance_components.hpp"
#include "calibration/whole_fit.hpp"
#include "kdl_calibration/covariance.hpp"
#include "kdl_calibration/deflection.hpp"
#include "kdl_calibration/influence.hpp"
#include "kdl_calibration/input_check.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_ranges.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/lack_of_fit.hpp"
#include "kdl_calibration/noise_components.hpp"
#include "kdl_calibration/observability.hpp"
#include "kdl_calibration/random.hpp"
#include "kdl_calibration/reduction.hpp"

namespace kdl_calibration {
namespace {

std::string rounded(double value) {
  std::array<char, 32> text{};  // in any locale
  const auto result = std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::general, 4);
  return {text.data(), result.ptr};
}

void require_training_rows(const Measurements& measurements) {
  const bool any = std::any_of(measurements.observations.begin(), measurements.observations.end(),
                               [](const Observation& observation) { return observation.split == Split::train; });
  if (!any) {
    throw InputError(measurements.source + ": no rows to fit; expected rows whose split is 'train'");
  }
}

bool any_sigma(const Measurements& measurements) {
  return std::any_of(measurements.observations.begin(), measurements.observations.end(),
                     [](const Observation& observation) { return observation.sigma > 0.0; });
}

bool has_split(const Measurements& measurements, Split split) {
  return std::any_of(measurements.observations.begin(), measurements.observations.end(),
                     [&](const Observation& observation) { return observation.split == split; });
}

// Position and rotation vector of a frame as six parameters.
void add_frame_parameters(const std::vector<std::string>& names, const Eigen::Isometry3d& frame,
                          std::vector<ParameterEstimate>& parameters) {
  const Eigen::Vector3d rotation = rotation_log(frame.linear());
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto axis = static_cast<Eigen::Index>(i % 3);
    const double value = i < 3 ? frame.translation()[axis] : rotation[axis];
    parameters.push_back({.name = names[i],
                          .joint = {},
                          .kind = i < 3 ? "translation" : "rotation",
                          .axis = std::string(1, static_cast<char>('x' + axis)),
                          .value = value,
                          .error = 0.0});
  }
}

// Of the link that a parameter belongs to; where its frames coincide, that of a mean link.
double link_length(const ErrorModel& model, const ErrorParameter& parameter) {
  const auto length = [&](std::size_t frame) {
    return (frame < model.joints.size() ? model.joints[frame].origin.p : model.tip_origin.p).Norm();
  };
  double reach = 0.0;
  for (std::size_t frame = 0; frame <= model.joints.size(); ++frame) {
    reach += length(frame);
  }
  constexpr double kNoLink = 0.1;  // of a mean link
  const double mean = reach / static_cast<double>(model.joints.size() + 1);
  const double own = length(static_cast<std::size_t>(parameter.frame));
  return own > kNoLink * mean ? own : mean;
}

// Whether the uncertainty is so large that nothing is known: a length to more than its link, an angle to half a radian.
bool is_unknown(const ErrorModel& model, const ParameterEstimate& estimate) {
  constexpr double kAngle = 0.5;
  const auto found = std::find_if(model.parameters.begin(), model.parameters.end(),
                                  [&](const ErrorParameter& parameter) { return parameter.name == estimate.name; });
  return found != model.parameters.end() &&
         estimate.std > (is_length(model, *found) ? link_length(model, *found) : kAngle);
}

std::vector<ParameterEstimate> parameter_estimates(const ErrorModel& model, const Calibration& calibration) {
  const Estimate& estimate = calibration.identification.estimate;
  std::vector<ParameterEstimate> all;
  add_frame_parameters(base_parameter_names(), estimate.X_WB, all);
  for (const TargetFrame& target : estimate.targets) {
    add_frame_parameters(target_parameter_names(target), target.X_FT, all);
  }
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const ErrorParameter& parameter = model.parameters[p];
    const double error = estimate.errors[static_cast<Eigen::Index>(p)];
    all.push_back({.name = parameter.name,
                   .joint = parameter.joint,
                   .kind = to_string(parameter.kind),
                   .axis = parameter.axis == 'q' ? "" : std::string(1, parameter.axis),
                   .nominal = parameter.nominal,
                   .value = parameter.nominal + error,
                   .error = error});
  }
  for (std::size_t d = 0; d < model.deflections.size() && estimate.deflections.size() > 0; ++d) {
    const double value = estimate.deflections[static_cast<Eigen::Index>(d)];
    all.push_back({.name = model.deflections[d].name,
                   .joint = model.deflections[d].joint,
                   .kind = "deflection",
                   .axis = {},
                   .value = value,
                   .error = value});
  }
  const std::vector<std::string> columns = column_names(model, estimate.targets, calibration.free);
  std::set<std::string> gauge;
  for (const GaugeParameter& parameter : calibration.reduction.gauge) {
    gauge.insert(parameter.name);
  }
  const std::set<std::string> held(calibration.fixed_by_gauge.begin(), calibration.fixed_by_gauge.end());
  const std::set<std::string> kept(calibration.reduction.kept.begin(), calibration.reduction.kept.end());
  std::vector<ParameterEstimate> parameters;
  for (ParameterEstimate& parameter : all) {
    const auto column = std::find(columns.begin(), columns.end(), parameter.name);
    const bool estimated = column != columns.end();
    parameter.gauge = gauge.count(parameter.name) > 0 || held.count(parameter.name) > 0;
    if (estimated) {
      const auto c = column - columns.begin();
      parameter.std = std::sqrt(calibration.covariance(c, c));
      parameter.identifiable = std::isfinite(parameter.std) && !is_unknown(model, parameter);
    }
    const bool known_frame = parameter.joint.empty() && parameter.name.find('.') != std::string::npos;
    if (estimated || parameter.gauge || known_frame || parameter.error != 0.0 || kept.count(parameter.name) > 0) {
      parameters.push_back(std::move(parameter));
    }
  }
  return parameters;
}

// An uncertainty beyond the link itself makes the answer one that does not determine its parameters.
void doubt_unknown_parameters(Calibration& result) {
  std::vector<std::string> unknown;
  for (const ParameterEstimate& parameter : result.parameters) {
    if (is_unknown(result.model, parameter)) {
      unknown.push_back(parameter.name);
    }
  }
  if (!unknown.empty() && result.identification.termination == Termination::converged) {
    result.identification.termination = Termination::rank_deficient;
    result.identification.message =
        "converged, but the measurements do not determine all parameters: the uncertainty exceeds the link itself "
        "for " +
        comma_separated(unknown);
  }
}

// The model with the deflections that may take part.
ErrorModel with_candidates(const ErrorModel& model, const CalibrationOptions& options) {
  ErrorModel result = model;
  result.deflections.clear();
  const auto add = [&](Use use, const std::vector<Deflection>& candidates) {
    if (use != Use::no) {
      result.deflections.insert(result.deflections.end(), candidates.begin(), candidates.end());
    }
  };
  add(options.gravity, gravity_deflections(model));
  add(options.joint_gain, gain_deflections(model));
  return result;
}

std::vector<bool> choices(Use use) {
  return use == Use::automatic ? std::vector<bool>{false, true} : std::vector<bool>{use == Use::yes};
}

bool choice_is_open(const CalibrationOptions& options) {
  return options.automatic_priors || options.gravity == Use::automatic || options.joint_gain == Use::automatic;
}

ModelOptions model_options(const CalibrationOptions& options) {
  return {.priors = options.automatic_priors ? prior_sizes() : std::vector<Priors>{options.priors},
          .gravity = choices(options.gravity),
          .gain = choices(options.joint_gain)};
}

bool has_priors(const Priors& priors) { return priors.length > 0.0 || priors.angle > 0.0 || priors.deflection > 0.0; }

// Of the repeats' scatter, the least that is taken as the noise of single points along an axis.
constexpr double kLeastShareOfRepeats = 1e-3;

NoiseModel noise_model(const Measurements& measurements, const CalibrationOptions& options) {
  if (!options.noise_from_repeats) {
    return options.noise;
  }
  const RepeatNoise repeats = noise_from_repeats(measurements);
  if (repeats.degrees_of_freedom == 0.0) {
    throw InputError(measurements.source + ": --noise repeats needs configurations that were measured more than once");
  }
  if (!(repeats.independent.minCoeff() > kLeastShareOfRepeats * repeats.total.maxCoeff())) {
    throw InputError(measurements.source +
                     ": --noise repeats: the repeats of single points do not vary along every axis; state the noise by "
                     "--noise-independent");
  }
  NoiseModel noise = options.noise;
  noise.independent = repeats.independent;
  noise.common = repeats.common;
  if (!(noise.orientation > 0.0)) {
    noise.orientation = repeats.orientation;
  }
  return noise;
}

// A sigma in radians says something only beside one in metres.
void require_comparable_orientations(const Measurements& measurements, const CalibrationOptions& options) {
  if (!(options.noise.orientation > 0.0)) {
    return;
  }
  if (measurements.orientations.empty()) {
    throw InputError(measurements.source + ": no row has a quaternion, which --orientation-sigma is about");
  }
  const bool every_row = std::all_of(measurements.observations.begin(), measurements.observations.end(),
                                     [](const Observation& observation) { return observation.sigma > 0.0; });
  if (!options.noise.is_absolute() && !options.noise_from_repeats && !every_row) {
    throw InputError(
        "--orientation-sigma: needs the positions' as well: --noise-independent, --noise-tracker, "
        "--noise repeats or a sigma in every row");
  }
}

// Priors and residuals must be on one scale. Where nothing states the noise, the residuals of the fit without priors
// do, the drift and the misfit of the model included.
void make_absolute(const ErrorModel& model, const Measurements& measurements, const Estimate& start,
                   const FreeParameters& free, FitOptions& options) {
  const LeastSquaresProblem problem(model, measurements, free, options.joint.residuals);
  const Identification plain = identify_jointly(model, measurements, start, free, options.joint);
  const double freedom = static_cast<double>(problem.equations() - problem.columns());
  const double variance = problem.linearise(plain.estimate).cost / std::max(freedom, 1.0);
  options.joint.residuals.noise.independent.setConstant(std::max(std::sqrt(variance), 1e-9));
}

constexpr double kMisfitCertain = 1e-3;  // p-value below which the fit counts as worse than the stated noise

// Noise and covariance of the result.
void assess_noise(const Measurements& measurements, const FitOptions& fit_options, bool stated,
                  const CalibrationOptions& options, const LeastSquaresProblem& problem, const WhitenedSummary& system,
                  const NormalEquations& equations, Calibration& result) {
  NoiseReport& noise = result.noise;
  const int rank = result.identifiability.rank;
  const NoiseModel& model = fit_options.joint.residuals.noise;
  noise.degrees_of_freedom = static_cast<double>(problem.equations() - rank);
  const RepeatNoise repeats = noise_from_repeats(measurements);
  if (repeats.degrees_of_freedom > 0.0) {
    noise.repeats = repeats;
  }
  const double mean_weight = problem.total_weight() / static_cast<double>(problem.points());
  const double reduced = noise.degrees_of_freedom > 0.0 ? equations.cost / noise.degrees_of_freedom : 0.0;
  if (stated) {
    noise.model = options.noise_from_repeats ? "repeats" : "stated";
    noise.independent = model.independent;
    noise.common = model.common;
    noise.sigma = std::sqrt(1.0 / mean_weight);
    const bool worse = reduced > 1.0 && f_upper_tail(reduced, noise.degrees_of_freedom, 1e9) < kMisfitCertain;
    noise.variance_factor = worse ? reduced : 1.0;
    result.covariance = covariance(system.triangle, noise.variance_factor);
    return;
  }
  noise.model = "residuals";
  noise.sigma = std::sqrt(reduced / mean_weight);
  // Of the means: what repeats average out does not count, what a configuration has in common does.
  const double cells = static_cast<double>(system.measured_rows) / 3.0;
  const double unit_weight = problem.total_weight() / cells;
  const ResidualNoise components = noise_from_residuals(system, rank, unit_weight);
  noise.independent.setConstant(components.independent);
  noise.common.setConstant(components.common);
  result.covariance = measurements.orientations.empty() ? covariance(system, components, unit_weight)
                                                        : covariance(system.triangle, reduced);
}

std::optional<LackOfFit> lack_of_fit(const ErrorModel& model, const Measurements& measurements,
                                     const Estimate& estimate, const FreeParameters& free, const FitOptions& options) {
  const RepeatNoise repeats = noise_from_repeats(measurements);
  if (repeats.degrees_of_freedom == 0.0 || !(repeats.total.minCoeff() > 0.0)) {
    return std::nullopt;
  }
  JointOptions whitened = options.joint;
  whitened.residuals.noise = {};
  whitened.residuals.noise.independent = repeats.independent.cwiseMax(kLeastShareOfRepeats * repeats.total.maxCoeff());
  whitened.residuals.noise.common = repeats.common;
  whitened.residuals.noise.orientation = options.joint.residuals.noise.orientation;
  Measurements without_sigma = measurements;
  for (Observation& observation : without_sigma.observations) {
    observation.sigma = 0.0;
  }
  const LeastSquaresProblem problem(model, without_sigma, free, whitened.residuals);
  const Identification found = identify_jointly(model, without_sigma, estimate, free, whitened);
  const double coordinates = static_cast<double>(problem.whitened_summary(found.estimate).measured_rows);
  LackOfFit result;
  result.degrees_of_freedom = coordinates - static_cast<double>(problem.columns());
  result.repeat_degrees_of_freedom = 3.0 * repeats.degrees_of_freedom;
  if (result.degrees_of_freedom <= 0.0) {
    return std::nullopt;
  }
  const double cost = problem.linearise(found.estimate).cost - problem.cost_of_repeats();
  result.f = cost / result.degrees_of_freedom;
  result.p_value = f_upper_tail(result.f, result.degrees_of_freedom, result.repeat_degrees_of_freedom);
  result.explained_by_joint = explained_by_joints(model, estimate, measurements);
  return result;
}

std::vector<double> listed_values(const Eigen::MatrixXd& matrix) {
  return {matrix.data(), matrix.data() + matrix.size()};
}

// Predictions and their uncertainty, infinite where what was fixed by the gauge matters.
class UncertainPredictor {
public:
  UncertainPredictor(const Calibration& calibration, const Eigen::MatrixXd& triangle_of_candidates)
      : calibration_(calibration),
        estimate_(calibration.identification.estimate),
        undetermined_(undetermined_directions(triangle_of_candidates)),
        free_(calibration.model, estimate_, calibration.free),
        candidates_(calibration.model, estimate_, calibration.candidates) {}

  // Of every target [m^2] in W.
  std::vector<Eigen::Matrix3d> covariances(const Eigen::VectorXd& q) const {
    std::vector<Eigen::Matrix3d> result;
    for (const Matrix3Xd& jacobian : free_.jacobians(q)) {
      result.emplace_back(jacobian * calibration_.covariance * jacobian.transpose());
    }
    if (undetermined_.cols() > 0) {
      const std::vector<Matrix3Xd> jacobians = candidates_.jacobians(q);
      for (std::size_t k = 0; k < result.size(); ++k) {
        if (!determines(jacobians[k])) {
          result[k] = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity()).asDiagonal();
        }
      }
    }
    return result;
  }

  // 3D 1 sigma [m], targets x N
  Eigen::MatrixXd sigmas(const Eigen::MatrixXd& joint_values) const {
    Eigen::MatrixXd result(static_cast<Eigen::Index>(estimate_.targets.size()), joint_values.cols());
    for (Eigen::Index c = 0; c < joint_values.cols(); ++c) {
      Eigen::Index k = 0;
      for (const Eigen::Matrix3d& covariance : covariances(joint_values.col(c))) {
        result(k++, c) = std::sqrt(covariance.trace());
      }
    }
    return result;
  }

  std::vector<PredictedPoint> points(const Configurations& asked) const {
    std::vector<PredictedPoint> result;
    if (asked.names.empty()) {
      return result;
    }
    const auto X_BF = flange_poses(calibration_.model, estimate_, asked.joint_values);
    for (std::size_t c = 0; c < asked.names.size(); ++c) {
      const auto all = covariances(asked.joint_values.col(static_cast<Eigen::Index>(c)));
      for (std::size_t k = 0; k < estimate_.targets.size(); ++k) {
        PredictedPoint& point = result.emplace_back();
        point.configuration = asked.names[c];
        point.target = estimate_.targets[k].name;
        point.position = X_BF[c] * estimate_.targets[k].X_FT.translation();
        point.position_W = estimate_.X_WB * point.position;
        point.std = all[k].diagonal().cwiseSqrt();
        point.sigma = std::sqrt(all[k].trace());
        point.radius_95 = std::isfinite(point.sigma) ? radius_of_probability(all[k]) : point.sigma;
      }
    }
    return result;
  }

private:
  bool determines(const Matrix3Xd& jacobian) const {
    constexpr double kNothing = 1e-6;
    const Eigen::ArrayXd sizes = (jacobian.cwiseAbs() * undetermined_.cwiseAbs()).colwise().sum().transpose();
    const Eigen::ArrayXd effects = (jacobian * undetermined_).colwise().norm().transpose();
    return (effects <= kNothing * sizes).all();
  }

  const Calibration& calibration_;
  const Estimate& estimate_;
  Eigen::MatrixXd undetermined_;
  PositionPredictor free_;
  PositionPredictor candidates_;
};

constexpr int kWorkspaceSamples = 1000;

PredictedAccuracy predicted_accuracy(const Measurements& measurements, const CalibrationOptions& options,
                                     const Eigen::MatrixXd& triangle_of_candidates, const Calibration& calibration) {
  const ErrorModel& model = calibration.model;
  Random random(1);
  const Eigen::MatrixXd workspace =
      random_configurations(model.joints, limits_of(model.joints), kWorkspaceSamples, random);
  PredictedAccuracy result;
  const UncertainPredictor predictor(calibration, triangle_of_candidates);
  result.asked = predictor.points(options.predict_at);
  if (!calibration.covariance.diagonal().allFinite()) {
    return result;
  }
  const Estimate& estimate = calibration.identification.estimate;
  const Eigen::Index most = std::min<Eigen::Index>(measurements.joint_values.cols(), kWorkspaceSamples);
  const Eigen::MatrixXd there = predictor.sigmas(measurements.joint_values.leftCols(most));
  if (there.allFinite()) {
    result.measured = error_statistics(listed_values(there));
  }
  const Eigen::MatrixXd everywhere = predictor.sigmas(workspace);
  if (!everywhere.allFinite()) {
    return result;
  }
  result.workspace = error_statistics(listed_values(everywhere));
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, workspace);
  std::map<std::array<double, 3>, WorkspaceCell> cells;  // doubles: a large robot has more cubes than an int counts
  for (Eigen::Index c = 0; c < workspace.cols(); ++c) {
    const Eigen::Vector3d cube = (X_BF[static_cast<std::size_t>(c)].translation() / result.cell).array().floor();
    WorkspaceCell& cell = cells[{cube.x(), cube.y(), cube.z()}];
    cell.centre = (cube.array() + 0.5) * result.cell;
    cell.mean = (cell.mean * cell.count + everywhere.col(c).mean()) / (cell.count + 1);
    cell.max = std::max(cell.max, everywhere.col(c).maxCoeff());
    ++cell.count;
  }
  for (const auto& [cube, cell] : cells) {
    result.cells.push_back(cell);
  }
  return result;
}

void add_warnings(const ErrorModel& model, const Measurements& measurements, const std::string& ambiguity,
                  Calibration& calibration) {
  std::vector<std::string>& warnings = calibration.warnings;
  const Identification& found = calibration.identification;
  if (found.termination != Termination::converged) {
    warnings.push_back("the answer is not to be trusted: " + found.message);
  }
  for (const std::vector<std::string>& group : calibration.identifiability.tied) {
    warnings.push_back(group.size() == 1 ? "the measurements do not depend on " + group.front()
                                         : "the measurements cannot tell apart: " + comma_separated(group));
  }
  if (!calibration.fixed_by_gauge.empty()) {
    warnings.push_back("fixed by gauge: " + comma_separated(calibration.fixed_by_gauge) +
                       " (errors at zero, frames as registered); predictions hold where it was measured, single "
                       "parameters do not");
  }
  for (const QualityFinding& finding : calibration.findings) {
    warnings.push_back("measurements: " + finding.message);
  }
  for (const Suspicion& suspicion : calibration.suspicions) {
    warnings.push_back(suspicion.message);
  }
  if (!ambiguity.empty()) {
    warnings.push_back("registration: " + ambiguity);
  }
  if (const int outside = configurations_outside_limits(model, measurements); outside > 0) {
    warnings.push_back(std::to_string(outside) + " of " + std::to_string(measurements.joint_values.cols()) +
                       " configurations have joint values outside the limits of the URDF");
  }
  if (calibration.noise.variance_factor > 1.0) {
    warnings.push_back("the residuals are " + rounded(std::sqrt(calibration.noise.variance_factor)) +
                       " times the stated noise; the uncertainties were scaled up by that");
  }
  if (calibration.lack_of_fit && calibration.lack_of_fit->p_value < kMisfitCertain) {
    warnings.push_back("lack of fit: the residuals are larger than the scatter of the repeats explains");
  }
  if (calibration.absurd()) {
    warnings.push_back("a misfit of " + rounded(calibration.train.after.rms * 1e3) +
                       " mm is more than geometric errors explain; is the joint convention right?");
  }
}

}  // namespace

namespace {

constexpr double kLeastWeight = 1e-9;  // as identify_robustly, so that nothing becomes undetermined by a weight
constexpr Eigen::Index kMostConfigurationsJudged = 5000;  // one by one
constexpr std::size_t kMostRowsScreened = 20000;          // beyond that only the distances between targets are checked

// Takes away what joints that give way under gravity or have a gain explain: a finding has to stand beside those too.
void keep_beside_deflections(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                             const FreeParameters& free, std::vector<QualityFinding>& found) {
  constexpr long kEquations = 2;  // for every column
  ErrorModel wide = model;
  wide.deflections = gravity_deflections(model);
  const std::vector<Deflection> gains = gain_deflections(model);
  wide.deflections.insert(wide.deflections.end(), gains.begin(), gains.end());
  FreeParameters all = free;
  all.deflections.resize(wide.deflections.size());
  std::iota(all.deflections.begin(), all.deflections.end(), std::size_t{0});
  Estimate start = estimate;
  start.deflections = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(wide.deflections.size()));
  const LeastSquaresProblem problem(wide, measurements, all);
  if (problem.equations() < kEquations * problem.columns()) {
    return;
  }
  const RobustIdentification fit = identify_robustly(wide, measurements, start, all, Loss::tukey);
  if (fit.fit.termination != Termination::converged) {
    return;
  }
  const std::vector<QualityFinding> again = check_measurements(wide, measurements, fit.fit.estimate);
  std::erase_if(found, [&](const QualityFinding& finding) {
    return std::none_of(again.begin(), again.end(), [&](const QualityFinding& other) {
      return other.kind == finding.kind && other.targets == finding.targets;
    });
  });
}

// What is wrong with the measurements themselves, by the distances between targets and by a preliminary fit that
// survives it.
std::vector<QualityFinding> findings(const ErrorModel& model, const Measurements& measurements, const Estimate& start,
                                     const FreeParameters& free) {
  const auto enough_equations = [&] {
    const LeastSquaresProblem problem(model, measurements, free);
    return problem.equations() >= problem.columns();
  };
  if (measurements.observations.size() > kMostRowsScreened || !enough_equations()) {
    return check_distances(measurements);
  }
  const RobustIdentification preliminary = identify_robustly(model, measurements, start, free, Loss::tukey);
  if (preliminary.fit.termination != Termination::converged) {
    return check_distances(measurements);
  }
  std::vector<QualityFinding> found = check_measurements(model, measurements, preliminary.fit.estimate);
  if (!found.empty()) {
    keep_beside_deflections(model, measurements, preliminary.fit.estimate, free, found);
  }
  return found;
}

// The best that a URDF can carry where deflections were fitted: a fit without them, with the priors that are best for
// it.
Estimate rigid_fit(const Measurements& measurements, const Estimate& start, const FitOptions& fit_options,
                   const Calibration& result) {
  const auto rigid = std::find_if(result.tried.begin(), result.tried.end(),
                                  [](const ModelOption& option) { return !option.gravity && !option.gain; });
  const Priors priors = rigid != result.tried.end() ? rigid->priors : result.priors;
  return fit(result.model, measurements, start, with_deflections(result.model, result.free, {}),
             with_priors(fit_options, priors))
      .estimate;
}

// Everything that is compared with the measurements.
void validate_result(const Measurements& measurements, const Estimate& start, const FitOptions& fit_options,
                     const CalibrationOptions& options, const RegistrationOptions& registration_options,
                     Calibration& result) {
  const Estimate& estimate = result.identification.estimate;
  const bool deflects = !result.free.deflections.empty();
  const Estimate rigid = deflects ? rigid_fit(measurements, start, fit_options, result) : estimate;
  result.rigid_errors = rigid.errors;
  const auto poses_of = [&](const Estimate& e) { return flange_poses(result.model, e, measurements.joint_values); };
  const std::vector<Eigen::Isometry3d> X_BF_before = poses_of(start);
  const std::vector<Eigen::Isometry3d> X_BF_after = poses_of(estimate);
  const auto compare = [&](Rows rows) {
    BeforeAfter pair{.before = error_statistics(position_errors(X_BF_before, start, measurements, rows)),
                     .after = error_statistics(position_errors(X_BF_after, estimate, measurements, rows)),
                     .rigid = std::nullopt};
    if (deflects) {
      pair.rigid = error_statistics(position_errors(result.model, rigid, measurements, rows));
    }
    return pair;
  };
  result.train = compare(Rows::train);
  if (has_split(measurements, Split::test)) {
    result.test = compare(Rows::test);
    result.iso_test_before = iso_9283(X_BF_before, start, measurements, Rows::test);
    result.iso_test_after = iso_9283(X_BF_after, estimate, measurements, Rows::test);
  }
  result.iso_before = iso_9283(X_BF_before, start, measurements);
  result.iso_after = iso_9283(X_BF_after, estimate, measurements);
  if (options.leave_one_out) {
    const HoldOut before = leave_one_configuration_out_nominal(result.model, measurements, registration_options);
    const HoldOut after =
        leave_one_configuration_out(result.model, measurements, estimate, result.free, fit_options, options.threads);
    result.leave_one_out = BeforeAfter{.before = error_statistics(before.distances),
                                       .after = error_statistics(after.distances),
                                       .rigid = std::nullopt};
    if (after.not_converged > 0) {
      result.warnings.push_back(std::to_string(after.not_converged) + " of " + std::to_string(after.refits) +
                                " leave-one-out fits did not converge");
    }
    if (options.nested && choice_is_open(options)) {
      result.nested_leave_one_out =
          error_statistics(nested_leave_one_out(result.model, measurements, start, result.free, model_options(options),
                                                fit_options, options.threads)
                               .distances);
    }
  }
  if (options.k_fold > 1) {
    result.k_fold =
        error_statistics(cross_validate(result.model, measurements, estimate, result.free,
                                        make_folds(measurements, options.k_fold), fit_options, options.threads)
                             .distances);
  }
}

// What the whole of the data may be taken for. Where the base moved no target is accused of it.
void suspect(const Measurements& measurements, const CalibrationOptions& options,
             const RegistrationOptions& registration_options, Calibration& result) {
  if (!options.try_readings) {
    return;
  }
  result.suspicions = suspicions(result.model, measurements, result.identification.estimate, result.free,
                                 {.registration = registration_options,
                                  .used = options.convention ? &*options.convention : nullptr,
                                  .others = options.other_conventions,
                                  .threads = options.threads});
  const bool moved = std::any_of(result.suspicions.begin(), result.suspicions.end(), [](const Suspicion& suspicion) {
    return suspicion.cause == "moved_base" || suspicion.cause == "drift";
  });
  if (moved) {
    std::erase_if(result.findings,
                  [](const QualityFinding& finding) { return finding.kind == QualityKind::slipped_target; });
  }
}

// Tells how many of the refits are done.
std::function<void()> counted_fits(const Measurements& measurements, const CalibrationOptions& options) {
  if (!options.progress) {
    return {};
  }
  const std::size_t configurations = make_folds(measurements, 0).size();
  const std::size_t choice = choice_is_open(options) ? fits_to_choose(measurements, model_options(options)) : 0;
  std::size_t total =
      choice + (options.leave_one_out ? configurations : 0) + static_cast<std::size_t>(std::max(options.k_fold, 0));
  if (options.leave_one_out && options.nested) {
    total += configurations * (choice + 1);
  }
  struct Count {
    std::mutex mutex;
    std::size_t done = 0;
  };
  return [count = std::make_shared<Count>(), total, progress = options.progress] {
    const std::lock_guard lock(count->mutex);
    ++count->done;
    progress(static_cast<double>(count->done) / static_cast<double>(std::max<std::size_t>(total, 1)));
  };
}

}  // namespace

Calibration calibrate(const ErrorModel& model, const Measurements& measurements, const CalibrationOptions& options) {
  const RegistrationOptions registration_options{.known_base = options.known_base,
                                                 .known_targets = options.known_targets};
  check(measurements, model);
  check(registration_options);
  check({.priors = options.priors, .noise = options.noise, .row_weights = {}}, measurements);
  require_training_rows(measurements);
  require_comparable_orientations(measurements, options);
  const Eigen::VectorXd nominal = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  const Registration registration = register_base_and_targets(
      flange_poses(folded(model, nominal), measurements.joint_values), measurements, registration_options);

  Calibration result;
  result.model = with_candidates(model, options);
  const Estimate start{
      .errors = nominal,
      .X_WB = registration.X_WB,
      .targets = registration.targets,
      .deflections = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(result.model.deflections.size()))};
  ParameterChoice choice = choose_parameters(model, start.targets, options);
  result.free = free_parameters(model, start.targets, choice.free);
  if (choice.free.empty()) {
    throw InputError(
        "--fix: leaves nothing to estimate of base, targets and geometric errors; kdlcal validate predicts without a "
        "fit");
  }
  result.findings = findings(result.model, measurements, start, result.free);

  FitOptions fit_options{.loss = options.loss, .joint = {}, .after_fit = counted_fits(measurements, options)};
  fit_options.joint.residuals.noise = noise_model(measurements, options);
  fit_options.joint.max_iterations = options.iterations > 0 ? options.iterations : fit_options.joint.max_iterations;
  ResidualOptions& weighed = fit_options.joint.residuals;
  if (options.method == Method::joint && !measurements.orientations.empty() && !(weighed.noise.orientation > 0.0)) {
    const FitTask task{.model = result.model,
                       .measurements = measurements,
                       .start = start,
                       .options = options,
                       .fit_options = fit_options};
    weighed.orientation_length = orientation_length_of_residuals(task, result.free);
    result.noise.orientation_length = weighed.orientation_length;
  }
  const bool stated = fit_options.joint.residuals.noise.is_absolute() || any_sigma(measurements);
  ModelOption chosen{
      .priors = options.priors, .gravity = options.gravity == Use::yes, .gain = options.joint_gain == Use::yes};
  if (options.method == Method::joint && !stated && (options.automatic_priors || has_priors(options.priors))) {
    make_absolute(result.model, measurements, start, result.free, fit_options);
  }
  if (options.method == Method::joint && choice_is_open(options)) {
    result.tried = choose_model(result.model, measurements, start, result.free, model_options(options), fit_options,
                                options.threads);
    chosen = result.tried.front();
  }
  result.priors = chosen.priors;
  result.free = with_deflections(result.model, result.free, chosen);
  fit_options = with_priors(fit_options, chosen.priors);
  WholeFit fitted = fit_whole({.model = result.model,
                               .measurements = measurements,
                               .start = start,
                               .options = options,
                               .fit_options = fit_options},
                              choice, result.free);
  result.identification = std::move(fitted.identification);
  result.weights = std::move(fitted.weights);
  result.reduction = std::move(fitted.reduction);
  result.candidates = std::move(fitted.candidates);
  result.free = std::move(fitted.free);

  const Estimate& estimate = result.identification.estimate;
  ResidualOptions residuals = fit_options.joint.residuals;
  residuals.row_weights = result.weights;
  for (double& weight : residuals.row_weights) {
    weight = std::max(weight, kLeastWeight);
  }
  const LeastSquaresProblem problem(result.model, measurements, result.free, residuals);
  const WhitenedSummary system = problem.whitened_summary(estimate);
  const std::vector<std::string> candidates = column_names(result.model, estimate.targets, result.candidates);
  Eigen::MatrixXd triangle_of_candidates = system.triangle;
  if (!same_parameters(result.free, result.candidates)) {
    const std::vector<std::string> kept = column_names(result.model, estimate.targets, result.free);
    std::copy_if(candidates.begin(), candidates.end(), std::back_inserter(result.fixed_by_gauge),
                 [&](const std::string& name) { return std::find(kept.begin(), kept.end(), name) == kept.end(); });
    triangle_of_candidates = LeastSquaresProblem(result.model, measurements, result.candidates, residuals)
                                 .whitened_summary(estimate)
                                 .triangle;
  }
  result.identifiability = identifiability(triangle_of_candidates, candidates);
  result.observability =
      observability_indices(system.triangle, static_cast<Eigen::Index>(make_folds(measurements, 0).size()));
  if (result.identification.termination == Termination::converged &&
      (result.identifiability.rank < result.identifiability.columns || !result.fixed_by_gauge.empty())) {
    result.identification.termination = Termination::rank_deficient;
    result.identification.message =
        "converged, but the measurements do not determine all parameters" +
        (result.fixed_by_gauge.empty() ? std::string()
                                       : ": " + std::to_string(result.fixed_by_gauge.size()) + " were fixed by gauge");
  }
  assess_noise(measurements, fit_options, stated, options, problem, system, problem.linearise(estimate), result);
  result.parameters = parameter_estimates(result.model, result);
  doubt_unknown_parameters(result);
  validate_result(measurements, start, fit_options, options, registration_options, result);
  result.lack_of_fit = lack_of_fit(result.model, measurements, estimate, result.free, fit_options);
  result.predicted = predicted_accuracy(measurements, options, triangle_of_candidates, result);
  if (measurements.joint_values.cols() <= kMostConfigurationsJudged) {
    result.influence = influence(result.model, measurements, estimate, result.free, residuals, system.triangle);
  }
  suspect(measurements, options, registration_options, result);
  result.difference_to_kdl = difference_to_kdl(model, estimate.errors, measurements.joint_values);
  add_warnings(model, measurements, registration.message, result);
  return result;
}

std::vector<OriginCorrection> origin_corrections(const ErrorModel& model, const Eigen::VectorXd& errors) {
  if (errors.size() != static_cast<Eigen::Index>(model.parameters.size()) || !errors.allFinite()) {
    throw InputError("corrections of joint origins: " + std::to_string(errors.size()) + " errors, expected " +
                     std::to_string(model.parameters.size()) + " that are finite");
  }
  std::vector<OriginCorrection> corrections;
  for (int frame = 0; frame <= static_cast<int>(model.joints.size()); ++frame) {
    const KDL::Frame correction = frame_correction(model, errors, frame);
    if (correction == KDL::Frame::Identity()) {
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

std::string calibrated_urdf(const Robot& robot, const Calibration& calibration) {
  return calibrated_urdf(robot, calibration.model, calibration.rigid_errors);
}

int configurations_outside_limits(const ErrorModel& model, const Measurements& measurements) {
  int outside = 0;
  for (Eigen::Index c = 0; c < measurements.joint_values.cols(); ++c) {
    bool inside = true;
    for (std::size_t i = 0; i < model.joints.size(); ++i) {
      const double value = measurements.joint_values(static_cast<Eigen::Index>(i), c);
      const double slack = 1e-9;
      inside = inside && !(value < model.joints[i].lower.value_or(value) - slack) &&
               !(value > model.joints[i].upper.value_or(value) + slack);
    }
    outside += inside ? 0 : 1;
  }
  return outside;
}

}  // namespace kdl_calibration
