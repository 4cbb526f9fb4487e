#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "estimation/residual_options.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "selection/effect_candidates.hpp"
#include "selection/group_sizes.hpp"
#include "selection/tried_models.hpp"

namespace kdl_calibration {

/// Input of the selection of priors and effects. Keeps references.
struct ModelSelectionTask {
  const ErrorModel& model;  ///< rigid
  const Measurements& measurements;
  const Estimate& optimum;  ///< of the rigid model; the point of linearisation
  const Unknowns& free;     ///< of the rigid model
  const ModelSelectionOptions& options;
  const std::vector<std::string>& fix;             ///< patterns of excluded effects
  double orientation_length = kOrientationLength;  ///< ResidualOptions::orientation_length
  int threads = 0;
  ProgressFunction progress = {};
};

/// The score of a model: evidence, and held-out error by cross-validation.
struct ModelScore {
  bool determined = false;  ///< whether every fold's rest determines it; else there are no held-out figures
  GroupSizes sizes;
  Groups groups;
  double noise = 0.0;       ///< [m] of a coordinate of a mean
  double motion = 0.0;      ///< [m or rad] largest motion of a joint due to effects
  Eigen::VectorXd squares;  ///< [m^2] of each held-out configuration, summed over its points
  double held_out_rms = std::numeric_limits<double>::infinity();
};

/// Size of the named group; 0 if absent.
double size_of(const ModelScore& score, const std::string& name);

/// The evidence required of a model with one more group. It exceeds evidence_to_prefer, because the best of several
/// groups gains evidence by chance.
double evidence_to_accept(const ModelScore& than);

/// The evidence required to prefer a model to this one.
double evidence_to_prefer(const ModelScore& than);
bool is_likelier(const ModelScore& one, const ModelScore& other);

/// For determined models: whether one's held-out error is at most the other's, within a standard error.
bool predicts_as_well(const ModelScore& one, const ModelScore& other);

/// Share of the other's held-out RMS below which a model predicts clearly better.
constexpr double kClearlyBetter = 0.98;
/// Whether one predicts clearly better, or the other is not determined.
bool is_clearly_better(const ModelScore& one, const ModelScore& other);

/// [m or rad] Largest motion of a joint that counts as an effect; above it the input is wrong.
constexpr double kLargestMotion = 0.02;

/// Whether the additional terms clearly improve the prediction, by over a standard error, and move no joint too far.
bool helps(const ModelScore& with, const ModelScore& without);

/// A model that may be chosen: rigid parameters, with or without priors, and these terms.
struct CandidateModel {
  std::vector<EffectTerm> terms;
  std::vector<std::string> names;  ///< names of the terms' groups
  bool sized = false;
};

/// Scores models on one set of means.
class ModelScorer {
public:
  /// Keeps references. `reports_progress`: whether to call the options' progress.
  ModelScorer(const ModelSelectionTask& task, const Measurements& means, int threads, bool reports_progress);

  /// Folds are predicted only if the evidence is at least `wanted`.
  ModelScore score_of(const CandidateModel& model, TriedModels& tried,
                      double wanted = -std::numeric_limits<double>::infinity()) const;

  /// Number of points whose target occurs in one fold only: not compared.
  double not_compared() const { return not_compared_; }

  /// The estimated sizes of the rigid parameters if `sized`, else the options' priors.
  Priors priors_of(const ModelScore& score, bool sized) const;

private:
  double motion_of(const Candidate& candidate, const LinearRows& rows, const Eigen::VectorXd& values) const;
  struct Sums {
    LinearSums all;
    std::vector<LinearSums> folds;  ///< see folds_with_rest()
  };
  Sums sums_by_folds(const LinearRows& rows) const;
  void predict_folds(const Candidate& candidate, const LinearRows& rows, Sums sums, ModelScore& score,
                     const std::function<void()>& after_fold) const;

  const ModelSelectionTask& task_;
  const Measurements& means_;
  int threads_;
  bool reports_progress_;
  std::vector<std::vector<Eigen::Index>> folds_;
  double points_ = 0.0;  ///< number of compared points
  double not_compared_ = 0.0;
};

}  // namespace kdl_calibration
