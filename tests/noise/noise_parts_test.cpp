// The parts of the noise: their likelihood against the dense one written out, and what they promise by Monte Carlo.

#include "noise/noise_parts.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/distributions.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/identification.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "noise/noise_components.hpp"
#include "planning/simulation.hpp"
#include "record.hpp"
#include "robot/joint_ranges.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::noise_parts_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kMicrometre = 1e-6;
// [m] Of the measured R-2000iC/165F: what the points of a repeat share, and what each has alone.
const Vector3d kOfRepeat = Vector3d(58, 59, 31) * kMicrometre;
const Vector3d kOfPoint = Vector3d::Constant(11 * kMicrometre);

// True sizes [m] of the parts, and how much is measured.
struct Truth {
  std::string name;
  int configurations = 30;
  int targets = 3;
  int repeats = 1;
  double misfit = 0.0;
  double target_misfit = 0.0;
  Vector3d common = Vector3d::Zero();
  Vector3d independent = Vector3d::Constant(30 * kMicrometre);
  NoiseModel stated = {};
  std::optional<TrackerNoise> tracker = std::nullopt;  // instead of `independent`
  Priors priors = {};                                  // stated as they are
  bool automatic = false;                              // priors and effects are chosen
  Loss loss = Loss::none;
  double outliers = 0.0;           // share of the rows, moved by 20 sigma along every axis
  double orientation_sigma = 0.0;  // [rad] where orientations are measured
  double swing = 0.0;              // [rad] joint 3 is off by this times sin(2 q3), which no parameter explains
};

struct Trial : testing::VirtualExperiment {
  Measurements measured;
};

Trial trial(const ErrorModel& model, const Truth& truth, std::uint64_t seed) {
  const std::vector<TargetFrame> targets = published_targets(truth.targets);
  Trial result{
      testing::VirtualExperiment({.model = model,
                                  .targets = truth.orientation_sigma > 0.0 ? testing::as_frames(targets) : targets,
                                  .ranges = published_ranges,
                                  .random = Random(97, seed)}),
      {}};
  Random& random = result.random;
  const MatrixXd q = result.configurations(truth.configurations);
  MatrixXd real = q;
  real.row(2).array() += truth.swing * (2.0 * q.row(2).array()).sin();
  result.measured = result.measure(
      real, {.orientation_sigma = truth.orientation_sigma, .repeats = truth.repeats, .tracker = truth.tracker});
  result.measured.joint_values = q;
  std::map<int, Vector3d> of_configuration;
  std::map<std::pair<int, int>, Vector3d> of_target;
  std::map<std::pair<int, int>, Vector3d> of_repeat;
  for (Observation& o : result.measured.observations) {
    o.sigma = 0.0;
    const auto draw = [&](auto& among, const auto& key, double sigma) {
      const auto [place, is_new] = among.try_emplace(key, Vector3d::Zero());
      if (is_new) {
        place->second = sigma * normal_vector(random);
      }
      return place->second;
    };
    o.position() += draw(of_configuration, o.configuration, truth.misfit);
    o.position() += draw(of_target, std::pair(o.configuration, o.target), truth.target_misfit);
    o.position() += draw(of_repeat, std::pair(o.configuration, o.repeat), 1.0).cwiseProduct(truth.common);
    o.position() += normal_vector(random).cwiseProduct(truth.independent);
    if (truth.outliers > 0.0 && random.uniform(0.0, 1.0) < truth.outliers) {
      o.position() += 20.0 * truth.independent;
    }
  }
  return result;
}

Estimate fitted(const ErrorModel& model, const Measurements& measured, const Unknowns& free) {
  return identify_jointly(model, measured, nominal_start(model, measured), free).estimate;
}

// -2 log of the restricted likelihood of all rows, each repeat one of its own, with the whole covariance written out.
class DenseLikelihood {
public:
  DenseLikelihood(const ErrorModel& model, const Measurements& measured, const Estimate& estimate, const Unknowns& free)
      : measured_(measured) {
    const PositionPredictor predictor(model, estimate, free);
    const auto X_BF = flange_poses(model, estimate, measured.joint_values);
    const auto rows = static_cast<Index>(3 * measured.observations.size());
    residual_.resize(rows);
    for (std::size_t i = 0; i < measured.observations.size(); ++i) {
      const Observation& o = measured.observations[i];
      const auto k = static_cast<std::size_t>(o.target);
      const MatrixXd J = predictor.jacobians(measured.joint_values.col(o.configuration))[k];
      if (jacobian_.size() == 0) {
        jacobian_.resize(rows, J.cols());
      }
      const auto first = static_cast<Index>(3 * i);
      jacobian_.middleRows<3>(first) = J;
      residual_.segment<3>(first) =
          o.position() - estimate.frames.base() * (X_BF[static_cast<std::size_t>(o.configuration)] *
                                                   estimate.frames.targets[k].X_FT.translation());
    }
  }

  /// Information of the columns before anything was measured. What is known of them is that they are nominal.
  void add_priors(const VectorXd& information, const Unknowns& free, const Estimate& estimate) {
    prior_ = information;
    value_.resize(information.size());
    for (Index c = 0; c < value_.size(); ++c) {
      value_[c] = prior_[c] > 0.0 ? Unknowns::value(estimate, free.columns()[static_cast<std::size_t>(c)]) : 0.0;
    }
  }

  const MatrixXd& jacobian() const { return jacobian_; }
  const VectorXd& residual() const { return residual_; }

  // Of all rows.
  MatrixXd covariance(const NoiseParts::Variances& parts) const {
    const Index n = residual_.size();
    MatrixXd V = MatrixXd::Zero(n, n);
    for (Index i = 0; i < n; ++i) {
      for (Index j = i % 3; j < n; j += 3) {
        const Observation& a = measured_.observations[static_cast<std::size_t>(i / 3)];
        const Observation& b = measured_.observations[static_cast<std::size_t>(j / 3)];
        if (a.configuration != b.configuration) {
          continue;
        }
        const bool target = a.target == b.target;
        const bool repeat = a.repeat == b.repeat;
        V(i, j) = parts[0] + (target ? parts[1] : 0.0) + (repeat ? parts[2 + i % 3] : 0.0) +
                  (target && repeat ? parts[5 + i % 3] : 0.0);
      }
    }
    return V;
  }

  double operator()(const NoiseParts::Variances& parts) const {
    const Eigen::LLT<MatrixXd> root(covariance(parts));
    const MatrixXd J = root.matrixL().solve(jacobian_);
    const VectorXd e = root.matrixL().solve(residual_);
    const VectorXd scale = J.colwise().norm().cwiseInverse();
    MatrixXd normal = J.transpose() * J;
    VectorXd moment = J.transpose() * e;
    double of_priors = 0.0;
    if (prior_.size() > 0) {
      normal += prior_.asDiagonal();
      moment -= prior_.cwiseProduct(value_);
      of_priors = value_.dot(prior_.cwiseProduct(value_));
    }
    const Eigen::LLT<MatrixXd> information(MatrixXd(scale.asDiagonal() * normal * scale.asDiagonal()));
    const VectorXd g = scale.asDiagonal() * moment;
    const auto log_det = [](const Eigen::LLT<MatrixXd>& l) {
      return 2.0 * l.matrixLLT().diagonal().array().log().sum();
    };
    return log_det(root) + log_det(information) - 2.0 * scale.array().log().sum() + e.squaredNorm() + of_priors -
           g.dot(information.solve(g));
  }

private:
  const Measurements& measured_;
  MatrixXd jacobian_;
  VectorXd residual_;
  VectorXd prior_;
  VectorXd value_;
};

/// At these variances, of which the `isotropic` ones are one for all axes.
void expect_least(const DenseLikelihood& minus_two_log, const NoiseParts& parts, bool isotropic,
                  const std::string& what, bool some_are_stated = false) {
  const double best = minus_two_log(parts.variances);
  for (Index k = 0; k < 8; ++k) {
    if (!parts.estimated[static_cast<std::size_t>(k)]) {
      EXPECT_TRUE(some_are_stated || parts.variances[k] == 0.0) << what << k;
      continue;
    }
    for (const double factor : {0.9, 1.1}) {
      NoiseParts::Variances other = parts.variances;
      if (isotropic && k >= 2) {
        const Index first = k < 5 ? 2 : 5;
        other.segment<3>(first) *= factor;
      } else {
        other[k] = std::max(other[k] * factor, other[k] + (factor - 1.0) * 1e-11);
      }
      if (other[k] >= 0.0 && other[k] != parts.variances[k]) {
        EXPECT_GT(minus_two_log(other), best - 1e-6) << what << ", part " << k << " times " << factor;
      }
    }
  }
}

TEST(NoiseParts, AreTheMaximumOfTheRestrictedLikelihoodWrittenOut) {
  const ErrorModel model = complete_model(testing::fanuc());
  for (const Truth& truth :
       {Truth{.name = "one target", .configurations = 20, .targets = 1},
        Truth{.name = "several targets", .configurations = 15, .misfit = 60 * kMicrometre},
        Truth{.name = "repeats of one target", .configurations = 14, .targets = 1, .repeats = 3, .target_misfit = 5e-5},
        Truth{.name = "everything",
        .configurations = 14,
        .repeats = 3,
        .misfit = 80 * kMicrometre,
        .target_misfit = 60 * kMicrometre,
        .common = Vector3d(40, 60, 50) * kMicrometre},
        Truth{.name = "swing",
        .configurations = 14,
        .repeats = 3,
        .common = kOfRepeat,
        .independent = kOfPoint,
        .swing = 0.001}}) {
    const Trial t = trial(model, truth, 3);
    const Estimate estimate = fitted(model, t.measured, t.free);
    const NoiseParts parts = estimate_noise(model, t.measured, estimate, t.free, {});
    ASSERT_TRUE(parts.converged) << truth.name;
    const DenseLikelihood minus_two_log(model, t.measured, estimate, t.free);
    expect_least(minus_two_log, parts, truth.repeats == 1 || truth.targets == 1, truth.name);
  }
}

// What no parameter explains is far above the noise of the repeats: these must not vanish beside it.
TEST(NoiseParts, KeepWhatRepeatsShowBesideAMisfitOfAnotherKind) {
  const ErrorModel model = complete_model(testing::fanuc());
  for (const int targets : {1, 3}) {
    for (std::uint64_t seed = 1; seed <= 2; ++seed) {
      const Trial t = trial(model,
                            {.configurations = 20,
                             .targets = targets,
                             .repeats = 3,
                             .common = kOfRepeat,
                             .independent = kOfPoint,
                             .swing = 0.001},
                            seed);
      const Unknowns& free = t.free;
      const RepeatNoise repeats = noise_from_repeats(t.measured);
      for (const Estimate& estimate : {fitted(model, t.measured, free), nominal_start(model, t.measured)}) {
        const NoiseParts parts = estimate_noise(model, t.measured, estimate, free, {});
        ASSERT_TRUE(parts.converged) << targets << ", " << seed;
        const Vector3d own = (parts.common() + parts.independent()).cwiseSqrt();
        for (Index axis = 0; axis < 3; ++axis) {
          EXPECT_NEAR(own[axis] / repeats.total[axis], 1.0, 0.1) << targets << ", " << seed << ", axis " << axis;
        }
        EXPECT_GT(parts.misfit() + parts.target_misfit(), 1e-8) << targets << ", " << seed;  // [m^2]
      }
    }
  }
}

FitProblem plain_problem(const ErrorModel& model, const Measurements& measured, const Unknowns& free) {
  return {.model = model, .measurements = measured, .start = fitted(model, measured, free), .free = free};
}

/// Of so many configurations nothing is told of a misfit, and each draw says so.
void expect_no_misfit(int configurations, int draws, double freedom) {
  testing::VirtualExperiment experiment;
  for (int draw = 0; draw < draws; ++draw) {
    const Measurements measured = testing::without_sigmas(experiment.measure(configurations, {.sigma = 3e-5}));
    const CalibrationResult found = calibrate(
        experiment.model, measured, {.validation = {.held_out = false}, .diagnosis = {.try_readings = false}});
    EXPECT_EQ(found.noise.misfit, 0.0) << draw;
    EXPECT_NEAR(found.noise.sigma, 3e-5, 2.5e-5) << draw;
    EXPECT_NEAR(found.noise.degrees_of_freedom, freedom, 0.1) << draw;
  }
}

// Of five configurations the parameters use up all 15 coordinates that the targets share: whatever these had in common
// would leave the same residuals.
TEST(NoiseParts, ThatTheParametersUseUpAreZero) { expect_no_misfit(5, 2, 12.0); }

// Of six they leave less than half a degree of freedom, which tells nothing of a misfit.
TEST(NoiseParts, ThatTheParametersNearlyUseUpAreZero) { expect_no_misfit(6, 4, 21.0); }

TEST(NoiseParts, OfOneKindBesideEqualWeightsAreTheMeanSquareOfTheResiduals) {
  const ErrorModel model = complete_model(testing::fanuc());
  const Trial t = trial(model, {.configurations = 20, .targets = 1}, 3);
  const FitProblem problem = plain_problem(model, t.measured, t.free);
  const NoiseParts parts = noise_beside_weights(problem, {}, true);
  ASSERT_TRUE(parts.converged);
  const DenseLikelihood dense(model, t.measured, problem.start, t.free);
  const double freedom = static_cast<double>(dense.jacobian().rows() - dense.jacobian().cols());
  EXPECT_NEAR(parts.independent().x() * freedom / dense.residual().squaredNorm(), 1.0, 1e-6);
  EXPECT_NEAR(parts.degrees_of_freedom, freedom, 1e-3);
  EXPECT_NEAR(parts.freedom_of_point(), freedom, 1e-3);
}

TEST(NoiseParts, BesideEqualWeightsGiveTheColumnsTheCovarianceThatTheyHave) {
  const ErrorModel model = complete_model(testing::fanuc());
  const Trial t = trial(model,
                        {.configurations = 20,
                         .repeats = 3,
                         .misfit = 1e-4,
                         .target_misfit = 5e-5,
                         .common = kOfRepeat,
                         .independent = kOfPoint},
                        5);
  const FitProblem problem = plain_problem(model, t.measured, t.free);
  const NoiseParts parts = noise_beside_weights(problem, {}, true);
  ASSERT_TRUE(parts.converged);
  const DenseLikelihood dense(model, t.measured, problem.start, t.free);
  const MatrixXd& J = dense.jacobian();
  const MatrixXd scatter = J.transpose() * dense.covariance(parts.variances) * J;
  EXPECT_LT((parts.scatter - scatter).norm(), 1e-9 * scatter.norm());
  for (Index k = 0; k < NoiseParts::kOrientation; ++k) {
    NoiseParts::Variances one = NoiseParts::Variances::Zero();
    one[k] = 1.0;
    const MatrixXd expected = J.transpose() * dense.covariance(one) * J;
    EXPECT_LT((parts.sensitivity[static_cast<std::size_t>(k)] - expected).norm(), 1e-9 * expected.norm()) << k;
  }
}

TEST(NoisePartsLongRun, BesideEqualWeightsAreRightOnAverage) {
  constexpr int kRuns = 100;
  const ErrorModel model = complete_model(testing::fanuc());
  NoiseParts::Variances truth = NoiseParts::Variances::Zero();
  truth << 1e-8, 2.5e-9, 3.4e-9, 3.4e-9, 1e-9, 4e-10, 4e-10, 4e-10, 0.0;
  NoiseParts::Variances mean = NoiseParts::Variances::Zero();
  for (int run = 0; run < kRuns; ++run) {
    const Trial t = trial(model,
                          {.configurations = 20,
                           .repeats = 3,
                           .misfit = 1e-4,
                           .target_misfit = 5e-5,
                           .common = truth.segment<3>(NoiseParts::kCommon).cwiseSqrt(),
                           .independent = Vector3d::Constant(2e-5)},
                          static_cast<std::uint64_t>(run));
    const NoiseParts parts = noise_beside_weights(plain_problem(model, t.measured, t.free), {}, true);
    ASSERT_TRUE(parts.converged);
    mean += parts.variances / kRuns;
  }
  for (Index k = 0; k < NoiseParts::kOrientation; ++k) {
    EXPECT_NEAR(mean[k] / truth[k], 1.0, 0.1) << k;
  }
}

// Held-out points are as uncertain as the result says, whatever the unit of the weights.
TEST(NoiseParts, AndEqualWeightsGiveOneKindOfNoiseTheSameRadius) {
  const ErrorModel model = complete_model(testing::fanuc());
  const Trial t = trial(model, {.configurations = 50}, 7);
  CalibrationSettings options{.diagnosis = {.try_readings = false}};
  options.predict_at = {.names = {"there"}, .joint_values = t.measured.joint_values.leftCols(1)};
  const CalibrationResult by_parts = calibrate(model, t.measured, options);
  options.noise.weights = Weights::equal;
  const CalibrationResult equal = calibrate(model, t.measured, options);
  EXPECT_NEAR(equal.uncertainty.predicted.region.radius_factor / by_parts.uncertainty.predicted.region.radius_factor,
              1.0, 0.02);
  EXPECT_NEAR(equal.uncertainty.predicted.asked[0].radius_95 / by_parts.uncertainty.predicted.asked[0].radius_95, 1.0,
              0.02);
  EXPECT_EQ(equal.uncertainty.predicted.asked[0].outside, by_parts.uncertainty.predicted.asked[0].outside);
}

// What 95 % intervals and radii hold, over runs with a truth of their own.
struct Coverage {
  double intervals = 0.0;
  double radius = 0.0;
  double sigma_ratio = 0.0;  // mean of the estimated total over the true one
};

double truly(const ParameterEstimate& p, const ErrorModel& model, const Estimate& truth) {
  if (effect_group(p.name.substr(0, p.name.find('.')))) {
    return 0.0;
  }
  if (p.name.rfind("base.", 0) != 0 && !p.joint.empty()) {
    return p.nominal + truth.errors[static_cast<Index>(parameter_index(model, p.name))];
  }
  const bool base = p.name.rfind("base.", 0) == 0;
  const Eigen::Isometry3d& X =
      base ? truth.frames.base() : truth.frames.targets[static_cast<std::size_t>(p.name[0] - 'A')].X_FT;
  return (p.kind == ParameterKind::translation ? Vector3d(X.translation()) : rotation_log(X.linear()))[p.axis[0] - 'x'];
}

Vector3d measured_at(const Vector3d& place, const Truth& truth, Random& random) {
  Vector3d real = place + truth.misfit * normal_vector(random) + truth.target_misfit * normal_vector(random);
  real += normal_vector(random).cwiseProduct(truth.common) + normal_vector(random).cwiseProduct(truth.independent);
  if (truth.tracker) {
    const Observation there{.reading = Point{real}};
    const Eigen::LLT<Eigen::Matrix3d> root(point_covariance({.tracker = truth.tracker}, there));
    real += root.matrixL() * normal_vector(random);
  }
  return real;
}

Coverage coverage(const Truth& truth, int runs) {
  const ErrorModel model = complete_model(testing::fanuc());
  Coverage result;
  double intervals = 0.0;
  double points = 0.0;
  for (int run = 0; run < runs; ++run) {
    const Trial t = trial(model, truth, static_cast<std::uint64_t>(run));
    CalibrationSettings options;
    options.noise.stated = truth.stated;
    options.selection.priors = truth.priors;
    options.selection.automatic_priors = truth.automatic;
    options.selection.effects.automatic = truth.automatic;
    options.estimator.loss = truth.loss;
    options.threads = 1;
    options.validation.held_out = truth.automatic;
    options.diagnosis.try_readings = false;
    Random random(41, static_cast<std::uint64_t>(run));
    const MatrixXd fresh = random_configurations(t.ranges, 10, random);
    options.predict_at.joint_values = fresh;
    for (int i = 0; i < 10; ++i) {
      options.predict_at.names.push_back(std::to_string(i));
    }
    const CalibrationResult found = calibrate(model, t.measured, options);
    for (const ParameterEstimate& p : found.uncertainty.parameters) {
      if (!p.identifiable) {
        continue;
      }
      const double true_value = truly(p, model, t.robot.truth);
      result.intervals += std::abs(p.value - true_value) <= t_critical_95(p.degrees_of_freedom) * p.std ? 1.0 : 0.0;
      intervals += 1.0;
    }
    const auto X_BF = flange_poses(model, t.robot.truth, fresh);
    for (std::size_t i = 0; i < found.uncertainty.predicted.asked.size(); ++i) {
      const AskedPoint& point = found.uncertainty.predicted.asked[i];
      const auto count = static_cast<std::size_t>(truth.targets);
      const Vector3d place = t.robot.truth.frames.targets[i % count].X_FT.translation();
      const Vector3d real = measured_at(t.robot.truth.frames.base() * (X_BF[i / count] * place), truth, random);
      result.radius += (real - point.position_W).norm() <= point.radius_95 ? 1.0 : 0.0;
      points += 1.0;
    }
    if (truth.tracker) {
      continue;
    }
    const double total = truth.misfit * truth.misfit + truth.target_misfit * truth.target_misfit +
                         (truth.common.squaredNorm() + truth.independent.squaredNorm()) / 3.0;
    result.sigma_ratio += found.noise.sigma / std::sqrt(total) / runs;
  }
  result.intervals /= intervals;
  result.radius /= points;
  return result;
}

std::vector<Truth> truths() {
  const NoiseModel stated{.independent = Vector3d::Constant(30 * kMicrometre)};
  const TrackerNoise tracker{.range = 1e-5, .transverse = 5 * kMicrometre, .transverse_per_metre = 2e-5};
  std::vector<Truth> all = {
      {.name = "30 x 3"},
      {.name = "30 x 3 stated", .stated = stated},
      {.name = "12 x 3", .configurations = 12},
      {.name = "12 x 3 stated", .configurations = 12, .stated = stated},
      {.name = "10 x 1", .configurations = 10, .targets = 1},
      {.name = "common", .common = kOfRepeat, .independent = kOfPoint},
      {.name = "tracker", .independent = Vector3d::Zero(), .stated = {.tracker = tracker}, .tracker = tracker},
      {.name = "30 x 3 automatic", .automatic = true},
      {.name = "right priors", .priors = {.length = 0.001, .angle = 0.001}},
      {.name = "poses", .orientation_sigma = 2e-4},
      {.name = "Huber", .loss = Loss::huber},
      {.name = "Tukey", .loss = Loss::tukey},
      {.name = "Huber, outliers", .loss = Loss::huber, .outliers = 0.05},
      {.name = "Tukey, outliers", .loss = Loss::tukey, .outliers = 0.05}};
  for (const int repeats : {2, 3, 10}) {
    const std::string name = std::to_string(repeats) + " repeats";
    all.push_back({.name = name, .repeats = repeats, .common = kOfRepeat, .independent = kOfPoint});
    all.push_back(all.back());
    all.back().name = name + ", misfit";
    all.back().misfit = 1e-4;
    all.back().target_misfit = 5e-5;
  }
  return all;
}

TEST(NoiseParts, AreThoseOfTheResidualsWhereNothingIsFree) {
  testing::VirtualExperiment experiment;
  const Unknowns none(experiment.model, experiment.targets, {});
  const Measurements measured = testing::without_sigmas(experiment.measure(200, {.sigma = 3e-5, .repeats = 2}));
  const NoiseParts found = estimate_noise(experiment.model, measured, experiment.robot.truth, none, {});
  EXPECT_NEAR(found.degrees_of_freedom, 3.0 * 600.0, 1e-6) << "of the means";
  EXPECT_NEAR(found.independent().mean(), 9e-10, 1e-10);
  EXPECT_LT(found.misfit() + found.target_misfit() + found.common().mean(), 1e-10);
}

NoiseParts made_parts() {
  NoiseParts parts;
  parts.variances << 4.0, 9.0, 16.0, 25.0, 36.0, 49.0, 1e-9, 81.0, 100.0;
  return parts;
}

TEST(NoiseParts, MakeANoiseModelOfWhatIsEstimated) {
  const NoiseModel stated{.independent = Vector3d(0.1, 0.2, 0.3),
                          .common = Vector3d(0.4, 0.5, 0.6),
                          .misfit = 0.7,
                          .target_misfit = 0.8,
                          .orientation = 0.9};
  NoiseParts parts = made_parts();
  parts.estimated = {true, true, false, true, true, false, true, true, false};
  const NoiseModel kept = parts.model(stated);
  EXPECT_EQ(kept.misfit, 2.0);
  EXPECT_EQ(kept.target_misfit, 3.0);
  EXPECT_EQ(kept.common, stated.common);
  EXPECT_EQ(kept.independent, stated.independent);
  EXPECT_EQ(kept.orientation, 0.9);
  parts.estimated = {false, true, true, false, false, false, false, false, false};
  EXPECT_EQ(parts.model(stated).common, Vector3d(4.0, 5.0, 6.0));
  EXPECT_EQ(parts.model(stated).independent, stated.independent);
  EXPECT_EQ(parts.model(stated).misfit, 2.0);
  parts.estimated = {true, false, false, true, true, true, false, false, false};
  EXPECT_EQ(parts.model(stated).common, stated.common);
  // A millionth of the mean variance of a point: (16 + 25 + 36 + 49 + 81) / 3 + 13.
  const double least = std::sqrt(1e-6 * (207.0 / 3.0 + 13.0));
  EXPECT_LT((parts.model(stated).independent - Vector3d(7.0, least, 9.0)).norm(), 1e-12);
  EXPECT_EQ(parts.model(stated).orientation, 0.9);
  parts.estimated = {true, true, true, true, true, true, true, true, true};
  EXPECT_EQ(parts.model(stated).orientation, 10.0);
  parts.estimated = {false, false, false, false, false, false, false, false, true};
  EXPECT_EQ(parts.model(stated).orientation, 10.0);
  EXPECT_EQ(parts.model(stated).independent, stated.independent);
}

TEST(NoiseParts, AddUpToThePoint) {
  const NoiseParts parts = made_parts();
  const Eigen::Matrix3d expected = Vector3d(78.0, 38.0 + 1e-9, 130.0).asDiagonal();
  EXPECT_LT((parts.point() - expected).norm(), 1e-12);
}

// An estimate s^2 of n degrees of freedom has the variance 2 s^4 / n.
TEST(NoiseParts, HaveTheDegreesOfFreedomOfTheirCovariance) {
  NoiseParts parts = made_parts();
  EXPECT_EQ(parts.freedom(3.0, NoiseParts::Variances::Ones()), std::numeric_limits<double>::infinity());
  EXPECT_EQ(parts.freedom_of_point(), std::numeric_limits<double>::infinity());
  for (const double n : {1.0, 12.5, 300.0}) {
    parts.covariance.setZero();
    parts.covariance(1, 1) = 2.0 * 9.0 * 9.0 / n;
    EXPECT_NEAR(parts.freedom(9.0, NoiseParts::Variances::Unit(1)), n, 1e-9 * n);
    const double point = 78.0 + 38.0 + 130.0;  // of which three times this part
    EXPECT_NEAR(parts.freedom_of_point(), n * std::pow(point / 27.0, 2), 1e-6 * n);
  }
}

/// Two or more repeats of some configurations, with and without orientations, and an estimate with errors.
struct Small {
  testing::VirtualExperiment experiment;
  Measurements measured;
  Unknowns free;
  Estimate estimate;

  explicit Small(int configurations, bool poses = false, int targets = 3, int repeats = 2)
      : experiment({.targets = poses ? testing::as_frames(published_targets(targets)) : published_targets(targets),
                    .ranges = published_ranges}),
        measured(testing::without_sigmas(experiment.measure(configurations, {.sigma = 3e-5,
                                                                             .orientation_sigma = poses ? 2e-4 : 0.0,
                                                                             .repeats = repeats,
                                                                             .common = Vector3d(2e-5, 3e-5, 4e-5)}))),
        free(experiment.model, experiment.targets, names()),
        estimate(experiment.robot.truth) {
    Random random(5);
    std::map<int, Vector3d> of_configuration;
    for (Observation& o : measured.observations) {
      o.position() += 5e-5 * of_configuration.try_emplace(o.configuration, normal_vector(random)).first->second +
                      2e-5 * normal_vector(random);
    }
    estimate = identify_jointly(experiment.model, measured, estimate, free).estimate;
  }

  std::vector<std::string> names() const {
    std::vector<std::string> result = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"};
    const std::vector<std::string> kept = experiment.free.names();
    result.insert(result.end(), kept.begin() + 8, kept.begin() + 12);
    result.insert(result.end(), {"A.x", "A.y"});
    return result;
  }
};

TEST(NoiseParts, BesidePriorsAreTheMaximumOfTheRestrictedLikelihoodWrittenOut) {
  const Small small(12, false, 3, 3);
  ResidualOptions options{.priors = {.length = 3e-4, .angle = 2e-4}};
  DenseLikelihood dense(small.experiment.model, small.measured, small.estimate, small.free);
  dense.add_priors(small.free.prior_information(options.priors), small.free, small.estimate);
  const NoiseParts parts = estimate_noise(small.experiment.model, small.measured, small.estimate, small.free, options);
  ASSERT_TRUE(parts.converged);
  expect_least(dense, parts, false, "priors");
  const NoiseParts without = estimate_noise(small.experiment.model, small.measured, small.estimate, small.free, {});
  EXPECT_GT((without.variances - parts.variances).norm(), 1e-3 * parts.variances.norm()) << "they change nothing";
}

// What is stated is not estimated, and the rest is what is most likely beside it.
TEST(NoiseParts, OfWhichOneIsStatedTheOthersAreMostLikelyBesideIt) {
  const Small small(12, false, 3, 3);
  const Vector3d common(2e-5, 3e-5, 4e-5);
  ResidualOptions options;
  options.noise.common = common;
  const NoiseParts parts = estimate_noise(small.experiment.model, small.measured, small.estimate, small.free, options);
  ASSERT_TRUE(parts.converged);
  for (Index axis = 0; axis < 3; ++axis) {
    EXPECT_FALSE(parts.estimated[static_cast<std::size_t>(2 + axis)]);
    EXPECT_NEAR(parts.variances[2 + axis], common[axis] * common[axis], 1e-15);
  }
  const DenseLikelihood dense(small.experiment.model, small.measured, small.estimate, small.free);
  expect_least(dense, parts, false, "the common part is stated", true);
}

// Whatever the unit of the weights.
TEST(NoiseParts, BesideWeightsDoNotDependOnTheirUnit) {
  const Small small(12, true);
  FitProblem fit{.model = small.experiment.model,
                 .measurements = small.measured,
                 .start = small.estimate,
                 .free = small.free,
                 .options = {}};
  const auto with = [&](double unit) {
    ResidualOptions& residuals = fit.options.joint.residuals;
    residuals.noise.independent = unit * Vector3d(2e-5, 3e-5, 4e-5);
    residuals.noise.common = unit * Vector3d(5e-5, 6e-5, 7e-5);
    residuals.noise.orientation = unit * 4e-4;
    return noise_beside_weights(fit, {}, true);
  };
  const NoiseParts one = with(1.0);
  const NoiseParts ten = with(10.0);
  ASSERT_TRUE(one.converged);
  EXPECT_LT((ten.variances - one.variances).norm(), 1e-9 * one.variances.norm());
  EXPECT_NEAR(ten.degrees_of_freedom / one.degrees_of_freedom, 1.0, 1e-6);
  const NoiseModel all{
      .independent = Vector3d::Constant(1e-5), .common = Vector3d::Constant(2e-5), .orientation = 1e-4};
  EXPECT_FALSE(noise_beside_weights(fit, all, false).converged) << "nothing is left to find";
}

TEST(NoiseParts, OfOneUnknownAreFoundToo) {
  const Small small(12, false, 1, 1);
  const NoiseParts found = estimate_noise(small.experiment.model, small.measured, small.estimate, small.free, {});
  EXPECT_TRUE(found.converged);
  EXPECT_FALSE(found.estimates_misfit());
}

// One kind of rows. Residuals of half the stated variance are no misfit; those of twice that are one.
TEST(NoiseParts, HaveAMisfitWhereTheResidualsAreClearlyAboveWhatIsStated) {
  const Small small(20, false, 1, 1);
  const DenseLikelihood dense(small.experiment.model, small.measured, small.estimate, small.free);
  const double freedom = static_cast<double>(dense.jacobian().rows() - dense.jacobian().cols());
  for (const auto& [ratio, expected] : {std::pair{0.5, false}, std::pair{2.5, true}}) {
    ResidualOptions options;
    options.noise.independent.setConstant(std::sqrt(dense.residual().squaredNorm() / freedom / ratio));
    const NoiseParts found =
        estimate_noise(small.experiment.model, small.measured, small.estimate, small.free, options);
    EXPECT_EQ(found.converged, expected) << ratio;
    EXPECT_EQ(found.target_misfit() > 0.0, expected) << ratio;
  }
}

// More than 2,000 configurations are represented by as many, and what these say counts for all.
TEST(NoiseParts, OfManyConfigurationsAreThoseOfASample) {
  testing::VirtualExperiment experiment({.targets = published_targets(1), .ranges = published_ranges});
  const Measurements measured = testing::without_sigmas(experiment.measure(2500, {.sigma = 3e-5}));
  const Measurements first = subset(measured, [](const Observation& o) { return o.configuration < 2000; });
  const auto parts = [&](const Measurements& of) {
    return estimate_noise(experiment.model, of, experiment.robot.truth, experiment.free, {});
  };
  const NoiseParts all = parts(measured);
  const NoiseParts some = parts(first);
  EXPECT_NEAR(std::sqrt((all.independent().mean() + all.misfit() + all.target_misfit())), 3e-5, 1e-6);
  EXPECT_NEAR(all.degrees_of_freedom / some.degrees_of_freedom, 1.25, 0.01);
}

TEST(NoiseParts, AreThoseOfTheTrainingRows) {
  const Small small(12);
  const FitProblem fit = {
      .model = small.experiment.model, .measurements = small.measured, .start = small.estimate, .free = small.free};
  Measurements more = small.measured;
  for (const std::size_t row : {0U, 5U, 9U}) {
    Observation other = more.observations[row];
    other.split = Split::test;
    other.repeat += 10;
    other.position().x() += 0.1;
    more.observations.push_back(other);
  }
  const NoiseParts expected = estimate_noise(fit.model, small.measured, fit.start, fit.free, {});
  EXPECT_EQ(estimate_noise(fit.model, more, fit.start, fit.free, {}).variances, expected.variances);
  EXPECT_EQ(noise_beside_weights(with_measurements(fit, more), {}, true).variances,
            noise_beside_weights(fit, {}, true).variances);
}

void expect_coverage(const std::vector<Truth>& sorts, int runs, double tolerance) {
  for (const Truth& truth : sorts) {
    const Coverage found = coverage(truth, runs);
    testing::record(truth.name + ", intervals", found.intervals);
    testing::record(truth.name + ", radius", found.radius);
    testing::record(truth.name + ", sigma ratio", found.sigma_ratio);
    EXPECT_NEAR(found.intervals, 0.95, 0.015 + tolerance) << truth.name;
    if (truth.targets > 1) {
      EXPECT_NEAR(found.radius, 0.955, 0.02 + tolerance) << truth.name;
    }
  }
}

TEST(NoiseParts, CoverWhatTheyPromise) {
  std::vector<Truth> sorts = truths();
  const std::set<std::string> some = {"12 x 3 stated", "2 repeats", "3 repeats, misfit"};
  sorts.erase(
      std::remove_if(sorts.begin(), sorts.end(), [&](const Truth& truth) { return some.count(truth.name) == 0; }),
      sorts.end());
  ASSERT_EQ(sorts.size(), some.size());
  expect_coverage(sorts, 6, 0.04);
}

TEST(NoisePartsLongRun, CoverWhatTheyPromise) { expect_coverage(truths(), 10, 0.04); }

TEST(NoisePartsCampaign, CoverWhatTheyPromise) { expect_coverage(truths(), 100, 0.012); }

}  // namespace
}  // namespace kdl_calibration::noise_parts_test
