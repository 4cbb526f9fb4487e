#include "estimation/lane_input.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "effects/joint_effects.hpp"
#include "estimation/prediction.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Vector3d;

namespace {

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

KeptFrame set_points(const LaneGroup& group, const Estimate& estimate, ChainKernelInput& input) {
  KeptFrame kept{.weight = 0.0};
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    kept.weight += group.weights[k];
    kept.centre += group.weights[k] * kept_target(group, k, estimate);
  }
  kept.centre /= kept.weight;
  const double turns = std::accumulate(group.orientation_weights.begin(), group.orientation_weights.end(), 0.0);
  Matrix3d spread = turns / kept.weight * Matrix3d::Identity();
  input.points.resize(group.targets.size());
  input.weights = group.weights;
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    const Vector3d t = kept_target(group, k, estimate) - kept.centre;
    spread += group.weights[k] / kept.weight * (t.squaredNorm() * Matrix3d::Identity() - t * t.transpose());
    input.points[k] = {t.x(), t.y(), t.z()};
  }
  input.root = root_of(spread);
  return kept;
}

// Weighted mean of the targets and sum of their weights.
KeptFrame middle_of(const LaneGroup& group, const Estimate& estimate) {
  KeptFrame kept;
  for (const std::size_t target : group.targets) {
    kept.centre += estimate.frames.targets[target].X_FT.translation() / static_cast<double>(group.targets.size());
  }
  return kept;
}

KeptFrame set_own_rows(const LaneGroup& group, const Estimate& estimate, ChainKernelInput& input) {
  KeptFrame kept = middle_of(group, estimate);
  input.points.resize(group.targets.size());
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    const Vector3d t = estimate.frames.targets[group.targets[k]].X_FT.translation() - kept.centre;
    input.points[k] = {t.x(), t.y(), t.z()};
  }
  return kept;
}

KeptFrame set_rows(const LaneGroup& group, const Estimate& estimate, ChainKernelInput& input) {
  const std::size_t targets = group.targets.size();
  KeptFrame kept = middle_of(group, estimate);
  input.points.clear();
  input.kept.assign(3 * group.kept(), {});
  input.pulls.assign(3 * targets, {});
  input.shares.resize(input.kept.size() * targets);
  const auto add = [](double share, const Vector3d& t, AxisRow& row) {
    row.sum += share;
    for (std::size_t c = 0; c < 3; ++c) {
      row.target[c] += share * t[static_cast<Index>(c)];
    }
  };
  for (std::size_t row = 0; row < input.kept.size(); ++row) {
    for (std::size_t l = 0; l < targets; ++l) {
      const double share = group.roots[row % 3](static_cast<Index>(row / 3), static_cast<Index>(l));
      input.shares[row * targets + l] = share;
      add(share, estimate.frames.targets[group.targets[l]].X_FT.translation() - kept.centre, input.kept[row]);
    }
    for (std::size_t l = 0; l < targets; ++l) {
      const double share = input.shares[row * targets + l];
      AxisRow& pull = input.pulls[3 * l + row % 3];
      pull.sum += share * input.kept[row].sum;
      for (std::size_t c = 0; c < 3; ++c) {
        pull.target[c] += share * input.kept[row].target[c];
      }
    }
  }
  return kept;
}

// A group with the joints and terms of another, without its data.
LaneGroup emptied(const LaneGroup& group) {
  LaneGroup empty;
  empty.joints = group.joints;
  empty.terms = group.terms;
  empty.configurations = group.configurations;
  return empty;
}

// Calls visitor(from, to) for the rows of each block of a group and of a reduced group. Copies joint values and terms.
template <class Visitor>
void visit_blocks(const LaneGroup& group, LaneGroup& reduced, Visitor visitor) {
  const std::size_t blocks = group.data.size() / group.rows();
  reduced.data.resize(blocks * reduced.rows());
  for (std::size_t block = 0; block < blocks; ++block) {
    const LaneRow* const from = &group.data[block * group.rows()];
    LaneRow* const to = &reduced.data[block * reduced.rows()];
    std::copy_n(from, group.joints, to);
    std::copy_n(from + group.first_term(), group.terms.size(), to + reduced.first_term());
    visitor(from + group.joints, to + group.joints);
  }
}

}  // namespace

FrameNumbers numbers_of(const Matrix3d& R, const Vector3d& p) {
  return {R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2), p.x(), p.y(), p.z()};
}

ChainColumn numbers_of(const ParameterTwist& twist, int frame) {
  return {.frame = frame,
          .moves = !twist.linear.isZero(0.0),
          .turns = !twist.angular.isZero(0.0),
          .linear = {twist.linear.x(), twist.linear.y(), twist.linear.z()},
          .angular = {twist.angular.x(), twist.angular.y(), twist.angular.z()}};
}

std::vector<ChainMotion> motions_of(const ErrorModel& model, const Unknowns& unknowns,
                                    const std::vector<std::size_t>& terms) {
  const auto joints = static_cast<int>(model.joints.size());
  const bool tilts = std::cmp_greater(motion_size(model), joints);
  const std::vector<std::size_t>& free = unknowns.effects();
  const FoldedChain nominal = folded(model, Eigen::VectorXd::Zero(std::ssize(model.parameters)));
  std::vector<ChainMotion> motions;
  for (std::size_t t = 0; t < terms.size(); ++t) {
    const EffectTerm& term = model.effects[terms[t]];
    const auto entry = static_cast<std::size_t>(motion_entry(model, term));
    if (motions.empty() || motions.back().entry != entry) {
      const ParameterTwist twist = effect_twist(nominal, term);
      const int frame = twist.frame + (tilts && twist.tilted ? joints + 2 : 1);
      motions.push_back({.entry = entry, .column = numbers_of(twist, frame), .first = t, .free = 0, .last = t});
    }
    motions.back().last = t + 1;
    if (std::find(free.begin(), free.end(), terms[t]) != free.end()) {
      ++motions.back().free;
    }
  }
  return motions;
}

Vector3d kept_target(const LaneGroup& group, std::size_t k, const Estimate& estimate) {
  return group.mixed(
      k, [&](std::size_t l) -> Vector3d { return estimate.frames.targets[group.targets[l]].X_FT.translation(); });
}

KeptFrame set_kept(const LaneGroup& group, const Estimate& estimate, ChainKernelInput& input) {
  input.kept.clear();
  input.pulls.clear();
  input.own_roots = group.own_roots;
  input.coupled = group.coupled;
  input.oriented.clear();
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    if (group.orientation_weight(k) > 0.0) {
      const Matrix3d& R = estimate.frames.targets[group.targets[k]].X_FT.linear();
      input.oriented.push_back({R(0, 0), R(0, 1), R(0, 2), R(1, 0), R(1, 1), R(1, 2), R(2, 0), R(2, 1), R(2, 2)});
    }
  }
  if (group.own_roots) {
    return set_own_rows(group, estimate, input);
  }
  return group.by_axis() ? set_rows(group, estimate, input) : set_points(group, estimate, input);
}

LaneGroup sums_by_axis(const LaneGroup& group) {
  LaneGroup sums = emptied(group);
  sums.targets = group.targets;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    sums.roots[axis] = group.roots[axis].colwise().sum();
  }
  visit_blocks(group, sums, [&](const LaneRow* from, LaneRow* to) {
    for (std::size_t row = 0; row < 3 * group.kept(); ++row) {
      to[row % 3].lanes += from[row].lanes;
    }
  });
  return sums;
}

LaneMeans means_of(const LaneGroup& group, const Estimate& estimate) {
  const std::size_t points = group.targets.size();
  LaneMeans means;
  for (std::size_t k = 0; k < points; ++k) {
    means.W += std::sqrt(group.weights[k]);
    means.target += std::sqrt(group.weights[k]) * kept_target(group, k, estimate);
  }
  means.target /= means.W;
  means.group = emptied(group);
  means.group.targets = {0};
  means.group.weights = {means.W * means.W};
  visit_blocks(group, means.group, [&](const LaneRow* from, LaneRow* to) {
    for (std::size_t k = 0; k < points; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        to[c].lanes += std::sqrt(group.weights[k]) / means.W * from[3 * k + c].lanes;
      }
    }
  });
  return means;
}

}  // namespace kdl_calibration
