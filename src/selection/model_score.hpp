#pragma once

// Not installed.

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/group_sizes.hpp"
#include "selection/effect_candidates.hpp"
#include "selection/tried_models.hpp"

namespace kdl_calibration {

/// What a choice of priors and effects is made from. Keeps references.
struct ModelSelectionTask {
  const ErrorModel& model;  ///< rigid
  const Measurements& measurements;
  const Estimate& optimum;  ///< of the rigid model: everything is linearised there
  const Unknowns& free;     ///< of the rigid model
  const ModelSelectionOptions& options;
  const std::vector<std::string>& fix;  ///< patterns of effects that stay out
  double orientation_length = 0.3;      ///< ResidualOptions::orientation_length
  int threads = 0;
  ProgressFunction progress = {};
};

/// The score of a model: evidence, and held-out error by cross-validation.
struct ModelScore {
  bool determined = false;  ///< by the rest of every fold; only then the held-out figures are any
  GroupSizes sizes;
  Groups groups;
  Eigen::MatrixXd information;  ///< J^T J
  double noise = 0.0;           ///< [m] of a coordinate of a mean
  double motion = 0.0;          ///< [m or rad] largest of a joint by all effects
  Eigen::VectorXd squares;      ///< [m^2] of each held-out configuration, summed over its points
  double held_out_rms = std::numeric_limits<double>::infinity();
};

/// Of a group, by its name; 0 where there is none.
double size_of(const ModelScore& score, const std::string& name);

/// The evidence that a model with one more group needs. It is above that of a mere preference, as the best of several
/// groups is likelier by chance.
double evidence_to_accept(const ModelScore& than);

/// The evidence that makes a model likelier than this one.
double evidence_to_prefer(const ModelScore& than);
bool is_likelier(const ModelScore& one, const ModelScore& other);

/// Whether one, where both are determined, leaves no more of a configuration than the other, within a standard error.
bool predicts_as_well(const ModelScore& one, const ModelScore& other);

/// Whether one predicts better by so much that it matters, or where the other cannot.
bool is_clearly_better(const ModelScore& one, const ModelScore& other);

/// [m or rad] What moves a joint by more is no effect but a mistake.
constexpr double kLargestMotion = 0.02;

/// Whether what a model has more makes it predict better, by more than chance, and moves no joint too far.
bool helps(const ModelScore& with, const ModelScore& without);

/// A model that may be chosen: rigid parameters and these terms, with priors for the rigid ones or without.
struct CandidateModel {
  std::vector<EffectTerm> terms;
  std::vector<std::string> names;  ///< of the terms' groups
  bool sized = false;
};

/// Scores models on one set of means.
class ModelScorer {
public:
  /// Keeps references. Where `reports_progress`, the options' progress says what is tried.
  ModelScorer(const ModelSelectionTask& task, const Measurements& means, int threads, bool reports_progress);

  /// Folds are predicted only where the evidence is at least `wanted`.
  ModelScore score_of(const CandidateModel& model, TriedModels& tried,
                      double wanted = -std::numeric_limits<double>::infinity()) const;

  /// Points of targets that one fold alone has: no model is compared by them.
  double not_compared() const { return not_compared_; }

  /// The rigid parameters' own where they are sized, else those of the options.
  Priors priors_of(const ModelScore& score, bool sized) const;

private:
  double motion_of(const Candidate& candidate, const Eigen::VectorXd& values) const;
  void predict_folds(const Candidate& candidate, const LinearRows& rows, const LinearSums& all, ModelScore& score,
                     const std::function<void()>& after_fold) const;

  const ModelSelectionTask& task_;
  const Measurements& means_;
  int threads_;
  bool reports_progress_;
  std::vector<std::vector<Eigen::Index>> folds_;
  double points_ = 0.0;  ///< that models are compared by
  double not_compared_ = 0.0;
};

}  // namespace kdl_calibration
