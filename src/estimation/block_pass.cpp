#include "estimation/block_pass.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <map>

#include "measurements/readings.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

Index oriented_points(const ObservedConfiguration& configuration) {
  return std::count_if(configuration.points.begin(), configuration.points.end(),
                       [](const ObservedPoint& point) { return point.orientation_weight > 0.0; });
}

// Transforms the information of the points' positions from W to F.
void turn_information(const MatrixXd& given, const Matrix3d& R_FW, MatrixXd& information) {
  for (Index a = 0; a < given.rows(); a += 3) {
    for (Index b = 0; b < given.cols(); b += 3) {
      information.block<3, 3>(a, b) = R_FW * given.block<3, 3>(a, b) * R_FW.transpose();
    }
  }
}

// Whitens the rows of points with single coordinates.
void whiten_by_point(const MatrixXd& information, MatrixXd& rows) {
  Index count = 0;
  for (Index first = 0; first < information.rows(); first += 3) {
    const Matrix3Xd R = root_of_directions(information.block<3, 3>(first, first));
    const MatrixXd own = R.transpose() * rows.middleRows<3>(first);
    rows.middleRows(count, own.rows()) = own;
    count += own.rows();
  }
  rows.conservativeResize(count, Eigen::NoChange);
}

}  // namespace

BlockLinearisation::BlockLinearisation(const ErrorModel& model, const Unknowns& unknowns, const Estimate& estimate)
    : unknowns_(unknowns), estimate_(estimate), chain_(folded(model, estimate.errors)) {
  const std::vector<ParameterTwist> all = chain_twists(model, chain_, estimate.errors, unknowns);
  const ColumnRange effects = unknowns.range(UnknownGroup::effects);
  std::map<Index, Index> of_entry;
  for (std::size_t column = 0; column < all.size(); ++column) {
    const auto next = static_cast<Index>(twists_.size());
    Index twist = next;
    if (const Index effect = static_cast<Index>(column) - effects.first; effect >= 0 && effect < effects.count) {
      const EffectTerm& term = model.effects[unknowns.effects()[static_cast<std::size_t>(effect)]];
      twist = of_entry.emplace(motion_entry(model, term), next).first->second;
    }
    twist_of_.push_back(twist);
    if (twist == next) {
      twists_.push_back(all[column]);
    }
  }
}

void BlockLinearisation::at(const Eigen::Ref<const VectorXd>& q, const Eigen::Ref<const VectorXd>& basis,
                            const ObservedConfiguration& configuration, Block& block) const {
  const Isometry3d X_BF = flange_jacobian(chain_, twists_, q, block.twists);
  block.twist_of = twist_of_;
  block.factors.setOnes(static_cast<Index>(twist_of_.size()));
  Index effect_column = unknowns_.range(UnknownGroup::effects).first;
  for (const std::size_t d : unknowns_.effects()) {
    block.factors[effect_column++] = basis[static_cast<Index>(d)];
  }
  const Isometry3d X_FW = (estimate_.frames.base() * X_BF).inverse();
  const auto points = static_cast<Index>(configuration.points.size());
  const Index rows = 3 * (points + oriented_points(configuration));
  block.residual.resize(rows);
  block.twist_rows.setZero(rows, 6);
  block.information.setZero(rows, rows);
  block.columns.assign(static_cast<std::size_t>(rows), -1);
  block.by_point = configuration.by_point;
  Index position_row = 0;
  Index orientation_row = 3 * points;
  for (const ObservedPoint& point : configuration.points) {
    add_position(point, X_FW, position_row, block);
    position_row += 3;
    if (point.orientation_weight > 0.0) {
      add_orientation(point, X_FW, orientation_row, block);
      orientation_row += 3;
    }
  }
  if (configuration.information) {
    turn_information(*configuration.information, X_FW.linear(), block.information);
  }
}

void BlockLinearisation::add_position(const ObservedPoint& point, const Isometry3d& X_FW, Index row,
                                      Block& block) const {
  const Isometry3d& X_FT = estimate_.frames.targets[point.target].X_FT;
  const Vector3d difference = X_FW * point.position - X_FT.translation();
  block.residual.segment<3>(row) = difference;
  block.twist_rows.middleRows<3>(row) << Matrix3d::Identity(), -skew(X_FT.translation());
  std::copy_n(unknowns_.target_columns(point.target).begin(), 3, block.columns.begin() + row);
  auto information = block.information.block<3, 3>(row, row);
  if (point.distance > 0.0) {
    const Vector3d n = -from_anchor(Vector3d::Zero(), difference);
    block.residual.segment<3>(row) = (point.distance - difference.norm()) * n;
    information = point.weight * n * n.transpose();
  } else if (block.by_point) {
    const Matrix3d R_FW = X_FW.linear();
    block.residual.segment<3>(row) = R_FW * (point.directions * (R_FW.transpose() * difference));
    information = R_FW * point.information * R_FW.transpose();
  } else {
    information.diagonal().setConstant(point.weight);
  }
}

// Rotation vector from predicted to measured, in the target's frame. Its exact derivative differs from the identity by
// half the residual, which changes neither the gradient (J^-1 e = e) nor the optimum.
void BlockLinearisation::add_orientation(const ObservedPoint& point, const Isometry3d& X_FW, Index row,
                                         Block& block) const {
  const Isometry3d& X_FT = estimate_.frames.targets[point.target].X_FT;
  block.residual.segment<3>(row) = rotation_log(X_FT.linear().transpose() * X_FW.linear() * point.orientation);
  block.twist_rows.block<3, 3>(row, 3) = X_FT.linear().transpose();
  std::copy_n(unknowns_.target_columns(point.target).begin() + 3, 3, block.columns.begin() + row);
  block.information.block<3, 3>(row, row).diagonal().setConstant(point.orientation_weight);
}

void whiten(const Block& block, Index columns, MatrixXd& rows) {
  rows.setZero(block.residual.size(), columns + 1);
  const MatrixXd of_twists = block.twist_rows * block.twists;
  for (std::size_t column = 0; column < block.twist_of.size(); ++column) {
    const auto at = static_cast<Index>(column);
    rows.col(at) = block.factors[at] * of_twists.col(block.twist_of[column]);
  }
  for (std::size_t a = 0; a < block.columns.size(); ++a) {
    if (block.columns[a] >= 0) {
      rows(static_cast<Index>(a), block.columns[a]) += 1.0;
    }
  }
  rows.rightCols<1>() = block.residual;
  if (block.by_point) {
    whiten_by_point(block.information, rows);
  } else {
    rows = block.information.llt().matrixU() * MatrixXd(rows);
  }
}

double BlockPass::cost(const Estimate& estimate, BlockWorkspace& workspace) const {
  VectorXd& force = workspace.force;
  double cost = 0.0;
  visit(estimate, workspace.block, [&](const Block& block) {
    force.resize(block.residual.size());
    force.noalias() = block.information.lazyProduct(block.residual);
    cost += block.residual.dot(force);
  });
  return cost;
}

void BlockPass::add(const Estimate& estimate, BlockWorkspace& workspace, NormalEquations& equations) const {
  visit(estimate, workspace.block, [&](const Block&) { add_block(workspace, equations); });
  const Index chain = unknowns_.chain().count;
  auto chain_hessian = equations.hessian.topLeftCorner(chain, chain);
  chain_hessian.triangularView<Eigen::StrictlyLower>() = chain_hessian.transpose();
}

void BlockPass::add_block(BlockWorkspace& workspace, NormalEquations& equations) const {
  const Block& block = workspace.block;
  Matrix6Xd& weighted_rows = workspace.weighted_rows;
  Eigen::Matrix<double, Eigen::Dynamic, 6>& Tt = workspace.transposed_twists;
  VectorXd& products = workspace.products;
  VectorXd& force = workspace.force;
  const Index chain = unknowns_.chain().count;
  auto chain_hessian = equations.hessian.topLeftCorner(chain, chain);
  force.resize(block.residual.size());
  force.noalias() = block.information.lazyProduct(block.residual);
  equations.cost += block.residual.dot(force);
  weighted_rows.resize(6, block.residual.size());
  weighted_rows.noalias() = block.twist_rows.transpose().lazyProduct(block.information);
  const Matrix6d flange_information = weighted_rows.lazyProduct(block.twist_rows);
  const Vector6d wrench = weighted_rows.lazyProduct(block.residual);
  Tt = block.twists.transpose();
  products.resize(Tt.rows());
  const ColumnRange effects = unknowns_.range(UnknownGroup::effects);
  const Index rigid = effects.empty() ? chain : effects.first;  // columns with their own twist
  // Adds Tt · vector, spread over the columns of each twist, to the first `count` of `sums`.
  const auto add_spread = [&](const Vector6d& vector, Index count, auto&& sums) {
    const Index needed = count <= rigid ? count : Tt.rows();
    products.head(needed).noalias() = Tt.topRows(needed).lazyProduct(vector);
    const Index own = std::min(count, rigid);
    sums.head(own) += products.head(own);
    for (Index first = own; first < count;) {
      const Index twist = block.twist_of[static_cast<std::size_t>(first)];
      Index end = first + 1;
      while (end < count && block.twist_of[static_cast<std::size_t>(end)] == twist) {
        ++end;
      }
      sums.segment(first, end - first).noalias() += products[twist] * block.factors.segment(first, end - first);
      first = end;
    }
  };
  add_spread(wrench, chain, equations.gradient);
  for (Index column = 0; column < chain; ++column) {  // the upper triangle
    const Index twist = block.twist_of[static_cast<std::size_t>(column)];
    const Vector6d weighted_column = flange_information.lazyProduct(block.twists.col(twist)) * block.factors[column];
    add_spread(weighted_column, column + 1, chain_hessian.col(column));
  }
  for (std::size_t a = 0; a < block.columns.size(); ++a) {
    const Index column = block.columns[a];
    if (column < 0) {
      continue;
    }
    const auto row = static_cast<Index>(a);
    equations.gradient[column] += force[row];
    add_spread(weighted_rows.col(row), chain, equations.hessian.col(column));
    for (std::size_t b = 0; b < block.columns.size(); ++b) {
      if (block.columns[b] >= 0) {
        equations.hessian(block.columns[b], column) += block.information(static_cast<Index>(b), row);
      }
    }
  }
}

}  // namespace kdl_calibration
