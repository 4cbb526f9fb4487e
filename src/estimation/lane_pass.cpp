#include "estimation/lane_pass.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

FrameNumbers numbers_of(const Matrix3d& R, const Vector3d& p) {
  return {R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2), p.x(), p.y(), p.z()};
}

// L of the positive semidefinite S = L L^T; columns of a singular S are zero.
std::array<double, 6> root_of(const Matrix3d& S) {
  Matrix3d L = Matrix3d::Zero();
  for (Index j = 0; j < 3; ++j) {
    const double pivot = S(j, j) - L.row(j).squaredNorm();
    if (pivot <= 1e-15 * S.trace()) {
      continue;
    }
    L(j, j) = std::sqrt(pivot);
    for (Index i = j + 1; i < 3; ++i) {
      L(i, j) = (S(i, j) - L.row(i).head(j).dot(L.row(j).head(j))) / L(j, j);
    }
  }
  return {L(0, 0), L(1, 0), L(1, 1), L(2, 0), L(2, 1), L(2, 2)};
}

// The kernel's columns: those that turn come first.
void order_columns(LaneWorkspace& work) {
  const std::size_t columns = work.twists.size();
  work.order.clear();
  for (const bool turning : {true, false}) {
    for (std::size_t i = 0; i < columns; ++i) {
      if (work.twists[i].angular.isZero(0.0) != turning) {
        work.order.push_back(i);
      }
    }
    if (turning) {
      work.input.turning = work.order.size();
    }
  }
  work.input.columns.resize(columns);
  for (std::size_t i = 0; i < columns; ++i) {
    const ParameterTwist& twist = work.twists[work.order[i]];
    work.input.columns[i] = {.frame = twist.frame + 1,
                             .moves = !twist.linear.isZero(0.0),
                             .turns = i < work.input.turning,
                             .linear = {twist.linear.x(), twist.linear.y(), twist.linear.z()},
                             .angular = {twist.angular.x(), twist.angular.y(), twist.angular.z()}};
  }
}

// Where the kept point `k` is expected in the flange frame.
Vector3d kept_target(const LaneGroup& group, std::size_t k, const Estimate& estimate) {
  return group.mixed(k,
                     [&](std::size_t l) -> Vector3d { return estimate.targets[group.targets[l]].X_FT.translation(); });
}

// sum sqrt(w_k): the weight of the mean of the points with the weights sqrt(w_k), and the group of these means. The sum
// of sqrt(w_k) e_k over the points is W (z - t) for such a single point.
struct LaneMeans {
  double W = 0.0;
  Vector3d target = Vector3d::Zero();
  LaneGroup group;
};

LaneMeans means_of(const LaneGroup& group, const Estimate& estimate) {
  const std::size_t points = group.targets.size();
  LaneMeans means;
  for (std::size_t k = 0; k < points; ++k) {
    means.W += std::sqrt(group.weights[k]);
    means.target += std::sqrt(group.weights[k]) * kept_target(group, k, estimate);
  }
  means.target /= means.W;
  const std::size_t joints = group.joints;
  const std::size_t blocks = group.data.size() / group.rows();
  means.group = {.targets = {0},
                 .weights = {means.W * means.W},
                 .mixing = {},
                 .information = {},
                 .joints = joints,
                 .configurations = group.configurations,
                 .data = std::vector<LaneRow>(blocks * (joints + 3))};
  for (std::size_t block = 0; block < blocks; ++block) {
    const LaneRow* from = &group.data[block * group.rows()];
    LaneRow* to = &means.group.data[block * (joints + 3)];
    std::copy_n(from, joints, to);
    for (std::size_t k = 0; k < points; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        to[joints + c].lanes += std::sqrt(group.weights[k]) / means.W * from[joints + 3 * k + c].lanes;
      }
    }
  }
  return means;
}

}  // namespace

LanePass::LanePass(const ErrorModel& model, const Unknowns& unknowns, const std::vector<LaneGroup>& groups)
    : unknowns_(unknowns), groups_(groups), folder_(model, unknowns.geometric()) {
  const std::vector<ParameterTwist> base = base_twists();
  for (const std::size_t i : unknowns.of(UnknownGroup::base)) {
    twists_.push_back(base[i]);
  }
  twists_.resize(twists_.size() + unknowns.geometric().size());
}

void LanePass::add(const Estimate& estimate, LaneWorkspace& workspace, NormalEquations& equations) const {
  prepare(estimate, workspace);
  for (const LaneGroup& group : groups_) {
    const double weight = sum(group, estimate, false, workspace);
    equations.cost += workspace.sums.cost;
    add_group(group, weight, workspace, equations);
  }
}

double LanePass::cost(const Estimate& estimate, LaneWorkspace& workspace) const {
  prepare(estimate, workspace);
  double cost = 0.0;
  for (const LaneGroup& group : groups_) {
    sum(group, estimate, true, workspace);
    cost += workspace.sums.cost;
  }
  return cost;
}

void LanePass::summarise(const Estimate& estimate, LaneWorkspace& workspace, WhitenedSummary& summary) const {
  prepare(estimate, workspace);
  for (const LaneGroup& group : groups_) {
    sum(group, estimate, true, workspace);
    summary.squares += workspace.sums.cost;
    add_sums(group, estimate, workspace, summary);
  }
}

// What the groups have in common at an estimate: the chain and its columns.
void LanePass::prepare(const Estimate& estimate, LaneWorkspace& work) const {
  work.chain = folder_.shape();
  work.twists = twists_;
  folder_.fold(estimate.errors, work.chain, work.twists, twists_.size() - unknowns_.geometric().size());
  order_columns(work);
  work.input.prismatic.assign(work.chain.prismatic.begin(), work.chain.prismatic.end());
  work.input.links.clear();
  for (const Isometry3d& link : work.chain.links) {
    work.input.links.push_back(numbers_of(link.linear(), link.translation()));
  }
  work.input.base = numbers_of(estimate.X_WB.linear(), estimate.X_WB.translation());
}

// The kernel's sums over one group; gives the weight of its points together.
double LanePass::sum(const LaneGroup& group, const Estimate& estimate, bool cost_only, LaneWorkspace& work) const {
  ChainKernelInput& input = work.input;
  double weight = 0.0;
  Vector3d centre = Vector3d::Zero();
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    weight += group.weights[k];
    centre += group.weights[k] * kept_target(group, k, estimate);
  }
  centre /= weight;
  Matrix3d spread = Matrix3d::Zero();
  input.points.resize(group.targets.size());
  input.weights = group.weights;
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    const Vector3d t = kept_target(group, k, estimate) - centre;
    spread += group.weights[k] / weight * (t.squaredNorm() * Matrix3d::Identity() - t * t.transpose());
    input.points[k] = {t.x(), t.y(), t.z()};
  }
  input.root = root_of(spread);
  input.flange = numbers_of(Matrix3d::Identity(), centre);
  const Isometry3d& last = work.chain.links.back();
  input.links.back() = numbers_of(last.linear(), last * centre);
  input.data = group.data.data();
  input.configurations = group.configurations;
  sum_chain(input, cost_only, work.sums);
  return weight;
}

void LanePass::add_group(const LaneGroup& group, double weight, const LaneWorkspace& work,
                         NormalEquations& equations) const {
  const ChainKernelSums& sums = work.sums;
  const double* gram = sums.gram.data();
  for (std::size_t i = 0; i < work.order.size(); ++i) {
    const auto a = static_cast<Index>(work.order[i]);
    equations.gradient[a] += sums.gradient[i];
    for (std::size_t j = i; j < work.order.size(); ++j) {
      const auto b = static_cast<Index>(work.order[j]);
      const double value = weight * *gram++;
      equations.hessian(a, b) += value;
      if (a != b) {
        equations.hessian(b, a) += value;
      }
    }
    const Vector3d v(&sums.twist[6 * i]);
    const Vector3d w(&sums.twist[6 * i + 3]);
    for (std::size_t k = 0; k < group.targets.size(); ++k) {
      const Vector3d coupling = group.weights[k] * (v + w.cross(Vector3d(work.input.points[k].data())));
      visit_targets(group, k, [&](Index column, std::size_t c, double share) {
        equations.hessian(a, column) += share * coupling[static_cast<Index>(c)];
      });
    }
  }
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    visit_targets(group, k, [&](Index column, std::size_t c, double share) {
      equations.gradient[column] += share * sums.force[3 * k + c];
      visit_targets(group, k, [&](Index other, std::size_t of_other, double share_of_other) {
        if (c == of_other) {
          equations.hessian(column, other) +=
              static_cast<double>(group.configurations) * group.weights[k] * share * share_of_other;
        }
      });
    });
  }
}

// Calls visitor(column, coordinate, share) for each free coordinate of the targets in the kept point `k`.
template <class Visitor>
void LanePass::visit_targets(const LaneGroup& group, std::size_t k, Visitor visitor) const {
  for (std::size_t l = k; l < group.mixed_end(k); ++l) {
    for (std::size_t c = 0; c < 3; ++c) {
      if (const int column = unknowns_.target_columns(group.targets[l])[c]; column >= 0) {
        visitor(static_cast<Index>(column), c, group.share(k, l));
      }
    }
  }
}

void LanePass::add_sums(const LaneGroup& group, const Estimate& estimate, LaneWorkspace& work,
                        WhitenedSummary& summary) const {
  const LaneMeans means = means_of(group, estimate);
  Estimate at_mean = estimate;
  at_mean.targets[0].X_FT.translation() = means.target;
  const Index columns = unknowns_.size();
  const Index chain = unknowns_.chain().count;
  NormalEquations own{.hessian = MatrixXd::Zero(columns, columns), .gradient = VectorXd::Zero(columns)};
  add_group(means.group, sum(means.group, at_mean, false, work), work, own);
  const std::size_t points = group.targets.size();
  const auto count = static_cast<double>(group.configurations);
  summary.squares_of_sums += work.sums.cost;
  summary.pairs += count * 3.0 * static_cast<double>(points * (points - 1)) / 2.0;
  summary.measured_rows += static_cast<Index>(3 * points * group.configurations);
  summary.sums.topLeftCorner(chain, chain) += own.hessian.topLeftCorner(chain, chain);
  // The root of a target's weight in the sum over the points.
  const auto root = [&](std::size_t l) {
    double sum = 0.0;
    for (std::size_t k = 0; k < points; ++k) {
      sum += std::sqrt(group.weights[k]) * group.share(k, l);
    }
    return sum;
  };
  for (std::size_t l = 0; l < points; ++l) {
    for (std::size_t c = 0; c < 3; ++c) {
      const int column = unknowns_.target_columns(group.targets[l])[c];
      if (column < 0) {
        continue;
      }
      for (std::size_t i = 0; i < work.order.size(); ++i) {
        const auto a = static_cast<Index>(work.order[i]);
        const double value = means.W * root(l) * work.sums.twist[6 * i + c];
        summary.sums(a, column) += value;
        summary.sums(column, a) += value;
      }
      for (std::size_t m = 0; m < points; ++m) {
        if (const int other = unknowns_.target_columns(group.targets[m])[c]; other >= 0) {
          summary.sums(column, other) += count * root(l) * root(m);
        }
      }
    }
  }
}

}  // namespace kdl_calibration
