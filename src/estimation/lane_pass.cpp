#include "estimation/lane_pass.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "base/parallel.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/lane_input.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// Orders the kernel's columns, those that turn first.
void order_columns(LaneWorkspace& work) {
  work.order.clear();
  for (const bool turning : {true, false}) {
    for (std::size_t i = 0; i < work.twists.size(); ++i) {
      if (work.twists[i].angular.isZero(0.0) != turning) {
        work.order.push_back(i);
      }
    }
    if (turning) {
      work.input.turning = work.order.size();
    }
  }
  work.input.columns.clear();
  for (const std::size_t i : work.order) {
    work.input.columns.push_back(numbers_of(work.twists[i], work.twists[i].frame + 1));
  }
}

// Index of the entry (a, b) of a symmetric n x n matrix whose upper triangle is stored row by row. Row i has n - i
// entries, from the diagonal on.
std::size_t place_in_triangle(std::size_t a, std::size_t b, std::size_t n) {
  const auto [row, column] = std::minmax(a, b);
  return row * (2 * n - row + 1) / 2 + (column - row);
}

// Entry (a, b) of the normal equations, for coordinate c of target l (a = 3 l + c) and d of target m (b = 3 m + d),
// from the sums of chain_kernel.hpp. Each row j of the root U of the information adds
//   own roots:  g_jl,c g_jm,d, whose sum over rows and configurations is `turned`
//   by axis:    U_jl,x U_jm,x r_xc r_xd for each axis x, together sum_x (U_x^T U_x)_lm T_x,cd, T_x = sum r_x r_x^T
double product_of_targets(const LaneGroup& group, const ChainKernelSums& sums, std::size_t a, std::size_t b) {
  if (group.own_roots) {
    return sums.turned[place_in_triangle(a, b, 3 * group.targets.size())];
  }
  double product = 0.0;
  for (std::size_t x = 0; x < 3; ++x) {
    const MatrixXd& U = group.roots[x];
    const double* const T = &sums.turned[6 * x];
    product +=
        U.col(static_cast<Index>(a / 3)).dot(U.col(static_cast<Index>(b / 3))) * T[place_in_triangle(a % 3, b % 3, 3)];
  }
  return product;
}

}  // namespace

bool has_summary(const LaneGroup& group) { return !group.own_roots && group.orientations() == 0; }

LanePass::LanePass(const ErrorModel& model, const Unknowns& unknowns, const std::vector<LaneGroup>& groups, int threads)
    : model_(model),
      unknowns_(unknowns),
      groups_(groups),
      folder_(model, unknowns.geometric()),
      terms_(terms_in_lanes(model, unknowns)),
      motions_(motions_of(model, unknowns, terms_)),
      threads_(threads) {
  const std::vector<ParameterTwist> base = base_twists();
  for (const std::size_t i : unknowns.of(UnknownGroup::base)) {
    twists_.push_back(base[i % 6]);
  }
  twists_.resize(twists_.size() + unknowns.geometric().size());
  const std::vector<std::size_t>& free = unknowns.effects();
  const auto first = static_cast<std::size_t>(unknowns.range(UnknownGroup::effects).first);
  for (const ChainMotion& motion : motions_) {
    for (std::size_t t = motion.first; t < motion.first + motion.free; ++t) {
      const auto found = std::find(free.begin(), free.end(), terms_[t]);
      term_columns_.push_back(first + static_cast<std::size_t>(found - free.begin()));
    }
  }
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

// Prepares the input common to all groups: the chain and its columns at an estimate.
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
  work.input.base = numbers_of(estimate.frames.base().linear(), estimate.frames.base().translation());
  set_motions(estimate, work);
}

namespace {

// The directions of links that grow, by the present errors.
void turn_stretches(const FoldedChain& chain, std::vector<ChainMotion>& motions) {
  const std::size_t first = 3 * chain.prismatic.size();
  for (ChainMotion& motion : motions) {
    if (motion.entry >= first) {
      const std::size_t joint = motion.entry - first;
      const Vector3d along = chain.links[joint].linear().transpose() * chain.stretches[joint];
      motion.column.linear = {along.x(), along.y(), along.z()};
    }
  }
}

}  // namespace

// No motions if all effects are zero and fixed.
void LanePass::set_motions(const Estimate& estimate, LaneWorkspace& work) const {
  const bool moved = estimate.effects.size() != 0 && !estimate.effects.isZero(0.0);
  work.input.values.assign(terms_.size(), 0.0);
  work.input.motions.clear();
  work.input.tilts = false;
  work.input.stretches.clear();
  if (!moved && unknowns_.effects().empty()) {
    return;
  }
  work.input.motions = motions_;
  for (std::size_t t = 0; moved && t < terms_.size(); ++t) {
    work.input.values[t] = estimate.effects[static_cast<Index>(terms_[t])];
  }
  work.input.tilts = std::cmp_greater(motion_size(model_), model_.joints.size());
  if (std::cmp_equal(motion_size(model_), 4 * model_.joints.size())) {
    for (const Vector3d& along : work.chain.stretches) {
      work.input.stretches.push_back({along.x(), along.y(), along.z()});
    }
    turn_stretches(work.chain, work.input.motions);
  }
  work.order.insert(work.order.end(), term_columns_.begin(), term_columns_.end());
}

// Computes the kernel's sums over one group; returns the sum of its points' weights.
double LanePass::sum(const LaneGroup& group, const Estimate& estimate, bool cost_only, LaneWorkspace& work) const {
  ChainKernelInput& input = work.input;
  const KeptFrame kept = set_kept(group, estimate, input);
  input.flange = numbers_of(Matrix3d::Identity(), kept.centre);
  const Isometry3d& last = work.chain.links.back();
  input.links.back() = numbers_of(last.linear(), last * kept.centre);
  input.data = group.data.data();
  input.configurations = group.configurations;
  sum_strands(cost_only, work);
  return kept.weight;
}

// Sums large groups in parts that do not depend on the number of threads.
void LanePass::sum_strands(bool cost_only, LaneWorkspace& work) const {
  constexpr std::size_t kStrands = 8;
  constexpr std::size_t kLeast = 2048;       // least configurations of a strand
  constexpr std::size_t kMostColumns = 500;  // above it strands need too much memory
  const ChainKernelInput& input = work.input;
  if (input.configurations < kStrands * kLeast || work.order.size() > kMostColumns) {
    sum_chain(input, cost_only, work.sums);
    return;
  }
  const std::size_t blocks = (input.configurations + kLanes - 1) / kLanes;
  const std::size_t of_strand = (blocks + kStrands - 1) / kStrands;
  work.strands.resize(kStrands);
  parallel_for(kStrands, threads_, [&](std::size_t s) {
    LaneStrand& strand = work.strands[s];
    strand.input = input;
    strand.input.data += s * of_strand * input.rows();
    strand.input.configurations = std::min(input.configurations - s * of_strand * kLanes, of_strand * kLanes);
    sum_chain(strand.input, cost_only, strand.sums);
  });
  std::swap(work.sums, work.strands.front().sums);
  for (std::size_t s = 1; s < kStrands; ++s) {
    kdl_calibration::add(work.strands[s].sums, work.sums);
  }
}

void LanePass::add_group(const LaneGroup& group, double weight, const LaneWorkspace& work,
                         NormalEquations& equations) const {
  add_gram(weight, work, equations.hessian);
  for (std::size_t i = 0; i < work.order.size(); ++i) {
    equations.gradient[static_cast<Index>(work.order[i])] += work.sums.gradient[i];
  }
  if (group.in_rows()) {
    add_targets_of_rows(group, work, equations);
  } else {
    add_targets(group, work, equations);
  }
  add_orientations(group, work, equations);
}

void LanePass::add_targets(const LaneGroup& group, const LaneWorkspace& work, NormalEquations& equations) const {
  const ChainKernelSums& sums = work.sums;
  const std::size_t width = work.input.width();
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    const std::array<double, 3>& t = work.input.points[k];
    visit_targets(group, k, [&](Index column, std::size_t c, double share) {
      const std::size_t d = (c + 1) % 3;
      const std::size_t e = (c + 2) % 3;
      for (std::size_t i = 0; i < work.order.size(); ++i) {  // coordinate c of w_k (v + a x t_k)
        const double* const v = &sums.coupling[width * i];
        const double* const a = v + 3;
        const double coupling = group.weights[k] * (v[c] + (a[d] * t[e] - a[e] * t[d]));
        equations.hessian(static_cast<Index>(work.order[i]), column) += share * coupling;
      }
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

void LanePass::add_targets_of_rows(const LaneGroup& group, const LaneWorkspace& work,
                                   NormalEquations& equations) const {
  const std::size_t coordinates = 3 * group.targets.size();
  const std::size_t width = work.input.width();
  const auto column_of = [&](std::size_t k) { return Index{unknowns_.target_columns(group.targets[k / 3])[k % 3]}; };
  for (std::size_t k = 0; k < coordinates; ++k) {
    const Index column = column_of(k);
    if (column < 0) {
      continue;
    }
    equations.gradient[column] += work.sums.force[k];
    for (std::size_t i = 0; i < work.order.size(); ++i) {
      equations.hessian(static_cast<Index>(work.order[i]), column) += work.sums.coupling[width * i + k];
    }
    for (std::size_t l = 0; l < coordinates; ++l) {
      if (column_of(l) >= 0) {
        equations.hessian(column, column_of(l)) += product_of_targets(group, work.sums, k, l);
      }
    }
  }
}

// Adds the measured orientations: among each other, and with all columns that turn them.
void LanePass::add_orientations(const LaneGroup& group, const LaneWorkspace& work, NormalEquations& equations) const {
  const ChainKernelInput& input = work.input;
  std::size_t next = 0;
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    if (group.orientation_weight(k) == 0.0) {
      continue;
    }
    const Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> R_PT(input.oriented[next].data());
    const double* const force = &work.sums.force[3 * (input.targets() + next)];
    for (std::size_t c = 0; c < 3; ++c) {
      const Index column = unknowns_.target_columns(group.targets[k])[3 + c];
      if (column < 0) {
        continue;
      }
      equations.gradient[column] += force[c];
      equations.hessian(column, column) += work.sums.weights[next];
      for (std::size_t i = 0; i < work.order.size(); ++i) {
        const Vector3d turn(&work.sums.coupling[input.width() * i + input.width_of_positions() + 3 * next]);
        equations.hessian(static_cast<Index>(work.order[i]), column) += R_PT.col(static_cast<Index>(c)).dot(turn);
      }
    }
    ++next;
  }
}

// Adds the products of columns and terms, to both triangles.
void LanePass::add_gram(double weight, const LaneWorkspace& work, MatrixXd& hessian) const {
  const auto add = [&](std::size_t i, std::size_t j, double product) {
    const auto a = static_cast<Index>(work.order[i]);
    const auto b = static_cast<Index>(work.order[j]);
    hessian(a, b) += weight * product;
    if (a != b) {
      hessian(b, a) += weight * product;
    }
  };
  const double* gram = work.sums.gram.data();
  const std::size_t columns = work.input.columns.size();
  for (std::size_t i = 0; i < columns; ++i) {
    for (std::size_t j = i; j < columns; ++j) {
      add(i, j, *gram++);
    }
  }
  const double* spread = work.sums.spread.data();
  std::size_t own = columns;
  for (std::size_t m = 0; m < work.input.motions.size(); ++m) {
    const std::size_t own_end = own + work.input.motions[m].free;
    for (std::size_t j = 0; j < columns; ++j) {
      for (std::size_t k = own; k < own_end; ++k) {
        add(k, j, *spread++);
      }
    }
    std::size_t other = own;
    for (std::size_t n = m; n < work.input.motions.size(); ++n) {
      const std::size_t other_end = other + work.input.motions[n].free;
      for (std::size_t k = own; k < own_end; ++k) {
        for (std::size_t l = n == m ? k : other; l < other_end; ++l) {
          add(k, l, *spread++);
        }
      }
      other = other_end;
    }
    own = own_end;
  }
}

// Calls visitor(column, coordinate, share) for each free target coordinate in the stored point `k`.
template <class Visitor>
void LanePass::visit_targets(const LaneGroup& group, std::size_t k, Visitor visitor) const {
  for (std::size_t l = k; l < group.mixed_end(k); ++l) {
    for (std::size_t c = 0; c < 3; ++c) {
      if (const int column = unknowns_.target_columns(group.targets[l])[c]; column >= 0) {
        visitor(static_cast<Index>(column), c, group.share(k, l).x());
      }
    }
  }
}

void LanePass::add_sums(const LaneGroup& group, const Estimate& estimate, LaneWorkspace& work,
                        WhitenedSummary& summary) const {
  const std::size_t points = group.targets.size();
  summary.pairs += static_cast<double>(group.configurations) * 3.0 * static_cast<double>(points * (points - 1)) / 2.0;
  summary.measured_rows += static_cast<Index>(3 * points * group.configurations);
  const Index columns = unknowns_.size();
  NormalEquations own{.hessian = MatrixXd::Zero(columns, columns), .gradient = VectorXd::Zero(columns)};
  if (group.by_axis()) {
    const LaneGroup sums = sums_by_axis(group);
    add_group(sums, sum(sums, estimate, false, work), work, own);
    summary.squares_of_sums += work.sums.cost;
    const Index chain = unknowns_.chain().count;
    own.hessian.bottomLeftCorner(columns - chain, chain) =
        own.hessian.topRightCorner(chain, columns - chain).transpose();
    summary.sums += own.hessian;
  } else {
    add_sums_of_points(group, estimate, work, own, summary);
  }
}

void LanePass::add_sums_of_points(const LaneGroup& group, const Estimate& estimate, LaneWorkspace& work,
                                  NormalEquations& own, WhitenedSummary& summary) const {
  const LaneMeans means = means_of(group, estimate);
  Estimate at_mean = estimate;
  at_mean.frames.targets[0].X_FT.translation() = means.target;
  const Index chain = unknowns_.chain().count;
  add_group(means.group, sum(means.group, at_mean, false, work), work, own);
  const std::size_t points = group.targets.size();
  const auto count = static_cast<double>(group.configurations);
  summary.squares_of_sums += work.sums.cost;
  summary.sums.topLeftCorner(chain, chain) += own.hessian.topLeftCorner(chain, chain);
  // Square root of a target's weight in the sum over the points.
  const auto root = [&](std::size_t l) {
    double sum = 0.0;
    for (std::size_t k = 0; k < points; ++k) {
      sum += std::sqrt(group.weights[k]) * group.share(k, l).x();
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
        const double value = means.W * root(l) * work.sums.coupling[6 * i + c];
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
