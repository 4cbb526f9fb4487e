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

  /// What the first one's held-out error hides, for the folds it was chosen by are those it is judged by: how many
  /// times larger the held-out RMS becomes where the best is chosen without the configurations that judge it. At
  /// least 1. 2,000 seeded drawings of configurations choose, those that were not drawn judge (bootstrap bias corrected
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
