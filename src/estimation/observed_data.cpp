#include "estimation/observed_data.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <map>
#include <utility>

#include "estimation/chain_kernel.hpp"
#include "kdl_calibration/joint_effects.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// By their targets' weights, 0 where a target was not measured, and where points are correlated by their information.
std::vector<double> sort_of(const ObservedConfiguration& configuration, std::size_t targets) {
  std::vector<double> sort(targets, 0.0);
  for (const ObservedPoint& point : configuration.points) {
    sort[point.target] = configuration.information ? 1.0 : point.weight;
  }
  if (configuration.information) {
    const MatrixXd& information = *configuration.information;
    sort.insert(sort.end(), information.data(), information.data() + information.size());
  }
  return sort;
}

// Of the points' coordinates along one axis.
MatrixXd information_along(Index axis, const MatrixXd& information) {
  const Index points = information.rows() / 3;
  MatrixXd result(points, points);
  for (Index k = 0; k < points; ++k) {
    for (Index l = 0; l < points; ++l) {
      result(k, l) = information(3 * k + axis, 3 * l + axis);
    }
  }
  return result;
}

// For information that is alike along every axis; false where points that are not correlated would be made of others
// with a loss of digits.
bool separate(LaneGroup& group) {
  constexpr double kMostMixing = 1e4;
  const MatrixXd W = information_along(0, *group.information);
  const MatrixXd U = W.llt().matrixU();
  const VectorXd sums = U.rowwise().sum();
  const MatrixXd mixing = sums.cwiseInverse().asDiagonal() * U;
  if (!(sums.minCoeff() > 0.0 && mixing.cwiseAbs().maxCoeff() < kMostMixing)) {
    return false;
  }
  group.mixing = mixing;
  const VectorXd weights = sums.cwiseAbs2();
  group.weights.assign(weights.begin(), weights.end());
  return true;
}

LaneGroup group_for(const ObservedConfiguration& configuration, Index joints, bool alike_along_axes) {
  LaneGroup group{.targets = {},
                  .weights = {},
                  .mixing = {},
                  .roots = {},
                  .information = configuration.information,
                  .joints = static_cast<std::size_t>(joints),
                  .terms = {},
                  .columns = {},
                  .data = {}};
  for (const ObservedPoint& point : configuration.points) {
    group.targets.push_back(point.target);
    group.weights.push_back(point.weight);
  }
  if (group.information && !(alike_along_axes && separate(group))) {
    for (Index axis = 0; axis < 3; ++axis) {
      group.roots[static_cast<std::size_t>(axis)] = information_along(axis, *group.information).llt().matrixU();
    }
  }
  return group;
}

bool could_be_alike(const Measurements& measurements, const NoiseModel& noise) {
  return !noise.tracker && measurements.orientations.empty() &&
         (measurements.joint_values.array().abs() <= kLargestAngle).all();
}

// False where too few configurations are alike.
bool gather_groups(const ErrorModel& model, const std::vector<std::size_t>& terms, const Measurements& measurements,
                   const ResidualOptions& options, ObservedData& data) {
  Gathering gathering(measurements, options);
  std::map<std::vector<double>, std::size_t> numbers;
  std::size_t number = 0;  // of the last configuration's group
  std::size_t configurations = 0;
  const Index joints = measurements.joint_values.rows();
  VectorXd basis;
  while (const ObservedConfiguration* configuration = gathering.next()) {
    if (data.groups.empty() || !data.groups[number].takes(*configuration)) {
      const auto [found, is_new] =
          numbers.emplace(sort_of(*configuration, measurements.targets.size()), data.groups.size());
      number = found->second;
      if (is_new) {
        data.groups.push_back(group_for(*configuration, joints, options.noise.is_alike_in_every_direction()));
        data.groups.back().terms = terms;
      }
    }
    LaneGroup& group = data.groups[number];
    if (configurations == 0) {  // most often the only group
      const auto blocks = static_cast<std::size_t>((measurements.joint_values.cols() + kLanes - 1) / kLanes);
      group.data.reserve(blocks * group.rows());
    }
    const Index c = configuration->column;
    const auto q = measurements.joint_values.col(c);
    if (!terms.empty()) {
      basis = effect_basis(model, q, column(measurements.signals, c));
    }
    group.append(q, basis, *configuration);
    ++configurations;
    if (data.groups.size() > kLanes && 2 * data.groups.size() > configurations) {
      return false;
    }
  }
  data.totals = gathering.totals();
  return true;
}

}  // namespace

bool LaneGroup::takes(const ObservedConfiguration& configuration) const {
  bool alike = configuration.points.size() == targets.size();
  for (std::size_t k = 0; alike && k < targets.size(); ++k) {
    alike = configuration.points[k].target == targets[k] &&
            (information != nullptr || configuration.points[k].weight == weights[k]);
  }
  return alike && (configuration.information == information ||
                   (configuration.information && information && *configuration.information == *information));
}

void LaneGroup::append(const Eigen::Ref<const VectorXd>& q, const Eigen::Ref<const VectorXd>& basis,
                       const ObservedConfiguration& configuration) {
  const std::size_t lane = configurations % kLanes;
  if (lane == 0) {
    data.resize(data.size() + rows());
  }
  // Through a pointer to its numbers: a vector type's element has no reference.
  auto* const block = reinterpret_cast<double*>(&data[data.size() - rows()]);
  const auto write = [&](std::size_t row, double value) { block[row * kLanes + lane] = value; };
  for (std::size_t i = 0; i < joints; ++i) {
    write(i, q[static_cast<Index>(i)]);
  }
  for (std::size_t k = 0; k < kept(); ++k) {
    const Vector3d kept = mixed(k, [&](std::size_t l) { return configuration.points[l].position; });
    for (std::size_t i = 0; i < 3; ++i) {
      write(joints + 3 * k + i, kept[static_cast<Index>(i)]);
    }
  }
  for (std::size_t t = 0; t < terms.size(); ++t) {
    write(first_term() + t, basis[static_cast<Index>(terms[t])]);
  }
  columns.push_back(configuration.column);
  ++configurations;
}

void LaneGroup::read(std::size_t configuration, VectorXd& q, VectorXd& basis, ObservedConfiguration& points) const {
  basis.resize(static_cast<Index>(terms.size()));
  for (std::size_t t = 0; t < terms.size(); ++t) {
    basis[static_cast<Index>(terms[t])] = at(configuration, first_term() + t);
  }
  q.resize(static_cast<Index>(joints));
  for (std::size_t i = 0; i < joints; ++i) {
    q[static_cast<Index>(i)] = at(configuration, i);
  }
  points.points.resize(targets.size());
  points.information = information;
  for (std::size_t k = targets.size(); k-- > 0;) {  // `mixing` and `roots` are upper triangular
    const std::size_t row = joints + 3 * k;
    ObservedPoint& point = points.points[k];
    point.target = targets[k];
    point.weight = information ? 0.0 : weights[k];
    point.position = Vector3d(at(configuration, row), at(configuration, row + 1), at(configuration, row + 2));
    for (std::size_t l = k + 1; l < mixed_end(k); ++l) {
      point.position -= share(k, l).cwiseProduct(points.points[l].position);
    }
    point.position = point.position.cwiseQuotient(share(k, k));
  }
}

std::vector<Index> ObservedData::columns() const {
  std::vector<Index> result;
  for (const LaneGroup& group : groups) {
    result.insert(result.end(), group.columns.begin(), group.columns.end());
  }
  for (const ObservedConfiguration& configuration : configurations) {
    result.push_back(configuration.column);
  }
  return result;
}

std::vector<std::size_t> terms_in_lanes(const ErrorModel& model, const Unknowns& unknowns) {
  const std::vector<std::size_t>& free = unknowns.effects();
  std::vector<std::pair<std::pair<Index, bool>, std::size_t>> order;
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const bool is_fixed = std::find(free.begin(), free.end(), e) == free.end();
    order.push_back({{motion_entry(model, model.effects[e]), is_fixed}, e});
  }
  std::sort(order.begin(), order.end());
  std::vector<std::size_t> terms;
  terms.reserve(order.size());
  for (const auto& [key, term] : order) {
    terms.push_back(term);
  }
  return terms;
}

ObservedData gathered(const ErrorModel& model, const Unknowns& unknowns, const Measurements& measurements,
                      const ResidualOptions& options) {
  ObservedData data;
  if (could_be_alike(measurements, options.noise) &&
      gather_groups(model, terms_in_lanes(model, unknowns), measurements, options, data)) {
    return data;
  }
  data.groups.clear();
  Gathering gathering(measurements, options);
  while (const ObservedConfiguration* configuration = gathering.next()) {
    data.configurations.push_back(*configuration);
  }
  data.totals = gathering.totals();
  data.joint_values = measurements.joint_values;
  data.effect_basis = effect_basis(model, data.joint_values, measurements.signals);
  return data;
}

}  // namespace kdl_calibration
