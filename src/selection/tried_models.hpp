#pragma once

// Not installed.

#include <Eigen/Core>
#include <string>
#include <vector>

#include "kdl_calibration/model_selection.hpp"

namespace kdl_calibration {

/// The models that a choice was made among, on the same folds.
class TriedModels {
public:
  /// `squares`: [m^2] of each held-out configuration; of no size where no fold was predicted.
  void add(ModelOption option, Eigen::VectorXd squares);
  /// The one with these effects, among the sized or those that are not, comes first, the others by what they predict.
  void put_first(const std::vector<std::string>& effects, bool sized);

  /// The optimism of the selection: the ratio of the held-out RMS of models that were selected without the
  /// configurations that test them to that of the selected model, at least 1. The folds that select a model also test
  /// it, so its own held-out error is too small. 2,000 seeded drawings of configurations select, the configurations
  /// that were not drawn test (bootstrap bias corrected cross-validation, Tsamardinos, Greasidou and Borboudakis 2018).
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
