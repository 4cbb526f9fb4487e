#include "planning/experiment.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "base/parallel.hpp"
#include "estimation/input_check.hpp"
#include "estimation/registration.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/readings.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "planning/point_rows.hpp"
#include "uncertainty/observability.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kFeatureBlock = 64;  // configurations whose features fit into the cache

MatrixXd symmetric(const MatrixXd& matrix) { return 0.5 * (matrix + matrix.transpose()); }

// Inverts the information; false if it is not positive definite beyond rounding.
bool invert(const MatrixXd& information, MatrixXd& covariance) {
  const VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
  if (!scale.allFinite()) {
    return false;
  }
  const Eigen::LLT<MatrixXd> llt(scale.asDiagonal() * information * scale.asDiagonal());
  if (llt.info() != Eigen::Success || llt.matrixLLT().diagonal().cwiseAbs2().minCoeff() < 1e-13) {
    return false;
  }
  covariance = scale.asDiagonal() * llt.solve(MatrixXd::Identity(scale.size(), scale.size())) * scale.asDiagonal();
  return true;
}

}  // namespace

NoiseModel noise_model(const PointNoise& noise) {
  return {.independent = Eigen::Vector3d::Constant(noise.sigma),
          .tracker = noise.tracker,
          .common = Eigen::Vector3d::Constant(noise.configuration_sigma)};
}

Experiment nominal_experiment(const ErrorModel& model, const std::vector<TargetFrame>& targets, const PointNoise& noise,
                              const Priors& priors) {
  Experiment experiment{.model = model_at_stations({}, model),
                        .errors = {},
                        .targets = targets,
                        .free = {},
                        .noise = noise,
                        .priors = priors};
  if (targets.empty()) {
    throw InputError("no targets to measure, expected at least one");
  }
  if (!(noise.sigma > 0.0) || !(noise.configuration_sigma >= 0.0)) {
    throw InputError("the noise of a measured coordinate must be positive");
  }
  for (TargetFrame& target : experiment.targets) {
    target.with_orientation = false;
  }
  experiment.errors = VectorXd::Zero(static_cast<Index>(model.parameters.size()));
  const Reduction reduction = reduced_model(model, experiment.targets);
  experiment.free = Unknowns(model, experiment.targets, reduction.kept);
  return experiment;
}

Index columns(const Experiment& experiment) { return experiment.free.size(); }

MatrixXd prior_information(const Experiment& experiment) {
  return experiment.free.prior_information(experiment.priors).asDiagonal();
}

MatrixXd information(const Experiment& experiment, const MatrixXd& joint_values) {
  const PointRows rows(experiment);
  MatrixXd M = MatrixXd::Zero(rows.columns(), rows.columns());
  for (Index c = 0; c < joint_values.cols(); ++c) {
    const MatrixXd A = rows.whitened(joint_values.col(c));
    M.noalias() += A.transpose() * A;
  }
  return symmetric(M);
}

MatrixXd information(const Experiment& experiment, const Measurements& measurements) {
  check(measurements, experiment.model);
  if (measurements.stations.size() > 1) {
    throw InputError(
        fmt::format("{}: {} stations, expected one for a plan", measurements.source, measurements.stations.size()));
  }
  Measurements matched = without_orientations(measurements);
  std::vector<std::int32_t> target_of;
  for (const std::string& name : measurements.targets) {
    const TargetFrame* const found = find_target(experiment.targets, name);
    if (found == nullptr) {
      throw InputError(measurements.source + ": target '" + name + "' is not a target of the plan");
    }
    target_of.push_back(static_cast<std::int32_t>(found - experiment.targets.data()));
  }
  for (Observation& observation : matched.observations) {
    observation.target = target_of[static_cast<std::size_t>(observation.target)];
  }
  matched.targets.clear();
  for (const TargetFrame& target : experiment.targets) {
    matched.targets.push_back(target.name);
  }
  Estimate estimate{.errors = experiment.errors, .frames = {.targets = experiment.targets}, .effects = {}};
  estimate.effects = VectorXd::Zero(static_cast<Index>(experiment.model.effects.size()));
  if (experiment.noise.tracker) {
    estimate.frames.base() =
        register_base_and_targets(flange_poses(folded(experiment.model, experiment.errors), matched.joint_values),
                                  matched, {.known = {.targets = experiment.targets}})
            .frames.base();
  }
  const LeastSquaresProblem problem(experiment.model, matched, experiment.free,
                                    {.noise = noise_model(experiment.noise)});
  return symmetric(problem.linearise(estimate).hessian);
}

namespace {

// Indices and covariances of the regular information matrices, in the basis of `rows` after the call.
struct Regular {
  std::vector<std::size_t> places;
  std::vector<MatrixXd> covariances;
};

Regular regular_ones(const std::vector<MatrixXd>& informations, PointRows& rows) {
  Regular result;
  bool changed = false;
  for (std::size_t k = 0; k < informations.size(); ++k) {
    MatrixXd covariance;
    // The first regular one defines the basis, so that nearly dependent columns lose no digits in packing.
    changed = changed || rows.change_basis(informations[k]);
    if (changed && invert(rows.in_basis(informations[k]), covariance)) {
      result.places.push_back(k);
      result.covariances.push_back(covariance);
    }
  }
  return result;
}

// Trace of a predicted point's covariance: per target a matrix of joint_values.cols() x covariances.
std::vector<MatrixXd> predicted_variances(const PointRows& rows, const std::vector<MatrixXd>& covariances,
                                          const MatrixXd& joint_values, int threads) {
  const Index T = rows.targets();
  const auto K = static_cast<Index>(covariances.size());
  const Index features = feature_count(rows.chain_columns());
  std::vector<MatrixXd> weights;
  MatrixXd constants(T, K);
  for (Index t = 0; t < T; ++t) {
    MatrixXd& of_target = weights.emplace_back(features, K);
    for (Index k = 0; k < K; ++k) {
      const PackedForm form = packed_form(rows.target_blocks()[static_cast<std::size_t>(t)],
                                          covariances[static_cast<std::size_t>(k)], rows.chain_columns());
      of_target.col(k) = form.weights;
      constants(t, k) = form.constant;
    }
  }
  std::vector<MatrixXd> variances(static_cast<std::size_t>(T), MatrixXd(joint_values.cols(), K));
  parallel_blocks(
      static_cast<std::size_t>(joint_values.cols()), kFeatureBlock, threads, [&](std::size_t first, std::size_t end) {
        const auto n = static_cast<Index>(end - first);
        std::vector<Matrix6Xd> jacobians;
        for (std::size_t i = first; i < end; ++i) {
          jacobians.push_back(rows.jacobian(joint_values.col(static_cast<Index>(i))));
        }
        Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor> packed(n, features);
        for (std::size_t t = 0; t < variances.size(); ++t) {
          const MatrixXd& S = rows.target_blocks()[t].S;
          const Matrix6d P = S.transpose() * S;
          for (Index i = 0; i < n; ++i) {
            pack_features(jacobians[static_cast<std::size_t>(i)], P, packed.row(i));
          }
          variances[t].middleRows(static_cast<Index>(first), n).noalias() = packed * weights[t];
          variances[t].middleRows(static_cast<Index>(first), n).rowwise() += constants.row(static_cast<Index>(t));
        }
      });
  return variances;
}

Prediction prediction_of(const std::vector<MatrixXd>& variances, Index k) {
  std::vector<double> sigmas;
  VectorXd mean = VectorXd::Zero(variances.front().rows());
  for (const MatrixXd& of_target : variances) {
    const VectorXd variance = of_target.col(k).cwiseMax(0.0);
    mean += variance / static_cast<double>(variances.size());
    for (const double v : variance) {
      sigmas.push_back(std::sqrt(v));
    }
  }
  return {.sigma = error_statistics(std::move(sigmas)),
          .worst_configuration = std::sqrt(mean.size() > 0 ? mean.maxCoeff() : 0.0)};
}

}  // namespace

std::vector<Prediction> predicted(const Experiment& experiment, const std::vector<MatrixXd>& informations,
                                  const MatrixXd& joint_values, int threads) {
  PointRows rows(experiment);
  const Regular regular = regular_ones(informations, rows);
  const std::vector<MatrixXd> variances = predicted_variances(rows, regular.covariances, joint_values, threads);
  const double none = std::numeric_limits<double>::infinity();
  std::vector<Prediction> predictions(
      informations.size(),
      {.sigma = {.mean = none, .rms = none, .p95 = none, .max = none}, .worst_configuration = none});
  parallel_for(regular.places.size(), threads, [&](std::size_t k) {
    predictions[regular.places[k]] = prediction_of(variances, static_cast<Index>(k));
  });
  return predictions;
}

Prediction predicted(const Experiment& experiment, const MatrixXd& information, const MatrixXd& joint_values,
                     int threads) {
  return predicted(experiment, std::vector<MatrixXd>{information}, joint_values, threads).front();
}

Prediction mean_of(const std::vector<Prediction>& predictions) {
  Prediction mean;
  const auto count = static_cast<double>(predictions.size());
  for (const Prediction& prediction : predictions) {
    mean.sigma.mean += prediction.sigma.mean / count;
    mean.sigma.p95 += prediction.sigma.p95 / count;
    mean.sigma.max += prediction.sigma.max / count;
    mean.worst_configuration += prediction.worst_configuration / count;
  }
  return mean;
}

double floor_of_worst_configuration(const Experiment& experiment, int count) {
  const auto points = static_cast<double>(experiment.targets.size()) * count;
  return experiment.noise.sigma * std::sqrt(static_cast<double>(columns(experiment)) / points);
}

ObservabilityIndices observability_indices(const Experiment& experiment, const MatrixXd& joint_values) {
  return observability_indices(PointRows(experiment).stacked(joint_values), joint_values.cols());
}

}  // namespace kdl_calibration
