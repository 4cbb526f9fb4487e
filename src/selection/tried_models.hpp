#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "selection/model_selection.hpp"

namespace kdl_calibration {

/// The models compared in a selection, on the same folds.
class TriedModels {
public:
  /// `squares`: [m^2] of each held-out configuration; empty if no fold was predicted.
  void add(ModelOption option, Eigen::VectorXd squares);
  /// Moves the model with these effects and this `sized` to the front and sorts the others by held-out error.
  void put_first(const std::vector<std::string>& effects, bool sized);

  /// The optimism of the selection: the held-out RMS of models selected without their test configurations, over that of
  /// the selected model, at least 1. The folds that select a model also test it, so its own held-out error is too
  /// small. In 2,000 seeded resamples the drawn configurations select and the others test (bootstrap bias corrected
  /// cross-validation, Tsamardinos, Greasidou and Borboudakis 2018).
  double optimism() const;

  std::vector<ModelOption> options() const;

private:
  struct Tried {
    ModelOption option;
    Eigen::VectorXd squares;
  };
  std::vector<Tried> tried_;
};

}  // namespace kdl_calibration
