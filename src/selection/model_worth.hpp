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
struct ChoiceTask {
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

/// What a model is worth beside others.
struct Worth {
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
double size_of(const Worth& worth, const std::string& name);

/// The evidence that a model with one group more needs: of several that are looked at one is likelier by chance.
double convincing_evidence(const Worth& than);

/// The evidence that makes a model likelier than this one.
double likelier_evidence(const Worth& than);
bool is_likelier(const Worth& one, const Worth& other);

/// Whether one, where both are determined, leaves no more of a configuration than the other, within a standard error.
bool predicts_as_well(const Worth& one, const Worth& other);

/// Whether one predicts better by so much that it matters, or where the other cannot.
bool is_worthwhile(const Worth& one, const Worth& other);

/// [m or rad] What moves a joint by more is no effect but a mistake.
constexpr double kLargestMotion = 0.02;

/// Whether what a model has more makes it predict better, by more than chance, and moves no joint too far.
bool helps(const Worth& with, const Worth& without);

/// A model that may be chosen: rigid parameters and these terms, with priors for the rigid ones or without.
struct ModelInQuestion {
  std::vector<EffectTerm> terms;
  std::vector<std::string> names;  ///< of the terms' groups
  bool sized = false;
};

/// Finds what models are worth on one set of means.
class Appraisal {
public:
  /// Keeps references. Where `is_told`, the options' progress says what is tried.
  Appraisal(const ChoiceTask& task, const Measurements& means, int threads, bool is_told);

  /// Folds are predicted only where the evidence is at least `wanted`.
  Worth worth_of(const ModelInQuestion& model, TriedModels& tried,
                 double wanted = -std::numeric_limits<double>::infinity()) const;

  /// Points of targets that one fold alone has: no model is compared by them.
  double not_compared() const { return not_compared_; }

  /// The rigid parameters' own where they are sized, else those of the options.
  Priors priors_of(const Worth& worth, bool sized) const;

private:
  double motion_of(const Candidate& candidate, const Eigen::VectorXd& values) const;
  void predict_folds(const Candidate& candidate, const LinearRows& rows, const LinearSums& all, Worth& worth,
                     const std::function<void()>& after_fold) const;

  const ChoiceTask& task_;
  const Measurements& means_;
  int threads_;
  bool is_told_;
  std::vector<std::vector<Eigen::Index>> folds_;
  double points_ = 0.0;  ///< that models are compared by
  double not_compared_ = 0.0;
};

}  // namespace kdl_calibration
