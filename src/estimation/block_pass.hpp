#pragma once

// The reference pass: any noise, any unknowns, one configuration after the other.

#include <Eigen/Core>
#include <vector>

#include "effects/joint_effects.hpp"
#include "estimation/linear_system.hpp"
#include "estimation/observed_data.hpp"
#include "estimation/prediction.hpp"

namespace kdl_calibration {

/// One configuration, linearised in the flange frame. Rows: three per measured position, three per orientation.
///   residual = measured - predicted,  motion of the predicted points per flange twist = twist_rows (rows x 6),
///   per target parameter = 1, and row r belongs to the target column `columns[r]` (-1: fixed).
///
/// Effects on the same joint have columns of one twist times each effect's basis value. So `twists` holds every twist
/// once, and chain column c is twists.col(twist_of[c]) · factors[c].
struct Block {
  Matrix6Xd twists;
  std::vector<Eigen::Index> twist_of;
  Eigen::VectorXd factors;
  Eigen::VectorXd residual;
  Eigen::Matrix<double, Eigen::Dynamic, 6> twist_rows;
  Eigen::MatrixXd information;
  bool by_point = false;  // see ObservedConfiguration
  std::vector<int> columns;
};

/// Linearises configurations at one estimate. Keeps references to its arguments.
class BlockLinearisation {
public:
  BlockLinearisation(const ErrorModel& model, const Unknowns& unknowns, const Estimate& estimate);

  /// Linearises at joint values q, effects included. `basis`: basis(q) of the model's effects if some are free.
  void at(const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::Ref<const Eigen::VectorXd>& basis,
          const ObservedConfiguration& configuration, Block& block) const;

private:
  void add_position(const ObservedPoint& point, const Eigen::Isometry3d& X_FW, Eigen::Index row, Block& block) const;
  void add_orientation(const ObservedPoint& point, const Eigen::Isometry3d& X_FW, Eigen::Index row, Block& block) const;

  const Unknowns& unknowns_;
  const Estimate& estimate_;
  FoldedChain chain_;
  std::vector<ParameterTwist> twists_;  // each once
  std::vector<Eigen::Index> twist_of_;
};

/// Buffers of a pass over the blocks, for one thread.
struct BlockWorkspace {
  Block block;
  Eigen::Matrix<double, 6, Eigen::Dynamic> weighted_rows;
  Eigen::Matrix<double, Eigen::Dynamic, 6> transposed_twists;
  Eigen::VectorXd products;  ///< of one column with all twists
  Eigen::VectorXd force;
};

/// Whitened Jacobian of a configuration with its residual as last column. A point with single coordinates has one row
/// for each direction that they determine.
void whiten(const Block& block, Eigen::Index columns, Eigen::MatrixXd& rows);

class BlockPass {
public:
  /// Keeps references to its arguments.
  BlockPass(const ErrorModel& model, const Unknowns& unknowns, const ObservedData& data)
      : model_(model), unknowns_(unknowns), data_(data) {}

  /// Calls visitor(block) for each configuration.
  template <class Visitor>
  void visit(const Estimate& estimate, Block& block, Visitor visitor) const {
    const BlockLinearisation linearisation(model_, unknowns_, estimate);
    Eigen::VectorXd q;
    Eigen::VectorXd basis;
    ObservedConfiguration alike;
    for (const LaneGroup& group : data_.groups) {
      for (std::size_t c = 0; c < group.configurations; ++c) {
        group.read(c, q, basis, alike);
        linearisation.at(effective_joint_values(model_, estimate.effects, q, basis).col(0), basis, alike, block);
        visitor(block);
      }
    }
    if (data_.configurations.empty()) {
      return;
    }
    const Eigen::MatrixXd joints =
        effective_joint_values(model_, estimate.effects, data_.joint_values, data_.effect_basis);
    for (const ObservedConfiguration& configuration : data_.configurations) {
      const Eigen::Index c = configuration.column;
      linearisation.at(joints.col(c), data_.effect_basis.col(c), configuration, block);
      visitor(block);
    }
  }

  /// Adds all configurations: both triangles of the chain's block, and the upper block of chain and targets.
  void add(const Estimate& estimate, BlockWorkspace& workspace, NormalEquations& equations) const;
  /// sum e^T W e.
  double cost(const Estimate& estimate, BlockWorkspace& workspace) const;

private:
  void add_block(BlockWorkspace& workspace, NormalEquations& equations) const;

  const ErrorModel& model_;
  const Unknowns& unknowns_;
  const ObservedData& data_;
};

}  // namespace kdl_calibration
