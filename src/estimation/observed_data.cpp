#include "estimation/observed_data.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "effects/joint_effects.hpp"
#include "estimation/chain_kernel.hpp"
#include "estimation/residual_options.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

// Condition for configurations in one group.
enum class Alike {
  weights,  // same points and weights
  points,   // same points, each configuration with its own root of the information
};

bool is_coupled(const ObservedConfiguration& configuration) {
  if (!configuration.information) {
    return false;
  }
  const MatrixXd& information = *configuration.information;
  for (Index k = 3; k < information.cols(); k += 3) {
    if (!information.block(0, k, k, 3).isZero(0.0)) {
      return true;
    }
  }
  return false;
}

// Key of a configuration's group: weights of the targets (0 if not measured) and of their orientations, and the
// information of correlated points.
std::vector<double> group_key(const ObservedConfiguration& configuration, std::size_t targets, Alike alike) {
  std::vector<double> sort(2 * targets, 0.0);
  const bool weights = alike == Alike::weights;
  for (const ObservedPoint& point : configuration.points) {
    sort[2 * point.target] = configuration.information || !weights ? 1.0 : point.weight;
    sort[2 * point.target + 1] = weights || point.orientation_weight == 0.0 ? point.orientation_weight : 1.0;
  }
  if (!weights) {
    sort.push_back(is_coupled(configuration) ? 1.0 : 0.0);
  } else if (configuration.information) {
    const MatrixXd& information = *configuration.information;
    sort.insert(sort.end(), information.data(), information.data() + information.size());
  }
  return sort;
}

// Upper triangular root of a configuration's information.
MatrixXd root_of_information(const ObservedConfiguration& configuration) {
  if (configuration.information) {
    return configuration.information->llt().matrixU();
  }
  const auto points = static_cast<Index>(configuration.points.size());
  MatrixXd root = MatrixXd::Zero(3 * points, 3 * points);
  for (Index k = 0; k < points; ++k) {
    root.diagonal().segment<3>(3 * k).setConstant(std::sqrt(configuration.points[static_cast<std::size_t>(k)].weight));
  }
  return root;
}

// Information of the points' coordinates along one axis.
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

// Transforms points with isotropic information to uncorrelated ones; false if that would lose digits.
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

LaneGroup group_for(const ObservedConfiguration& configuration, Alike alike, const NoiseModel& noise) {
  LaneGroup group{.targets = {},
                  .weights = {},
                  .mixing = {},
                  .roots = {},
                  .information = configuration.information,
                  .own_roots = alike == Alike::points,
                  .orientation_weights = {},
                  .terms = {},
                  .columns = {},
                  .data = {}};
  for (const ObservedPoint& point : configuration.points) {
    const bool is_oriented = point.orientation_weight > 0.0;
    group.targets.push_back(point.target);
    group.weights.push_back(point.weight);
    group.orientation_weights.push_back(is_oriented && group.own_roots ? 1.0 : point.orientation_weight);
  }
  if (group.orientations() == 0) {
    group.orientation_weights.clear();
  }
  if (group.own_roots) {
    group.coupled = is_coupled(configuration);
  } else if (group.information && !(noise.is_alike_in_every_direction() && separate(group))) {
    for (Index axis = 0; axis < 3; ++axis) {
      group.roots[static_cast<std::size_t>(axis)] = information_along(axis, *group.information).llt().matrixU();
    }
  }
  return group;
}

// Writes one lane of a block row by row, through a pointer because elements of vector types have no reference.
class LaneWriter {
public:
  LaneWriter(LaneRow& first, std::size_t lane) : next_(reinterpret_cast<double*>(&first) + lane) {}
  void write(double value) {
    *next_ = value;
    next_ += kLanes;
  }

private:
  double* next_;
};

struct GatheringTask {
  const ErrorModel& model;
  const std::vector<std::size_t> terms;
  const Measurements& measurements;
  const ResidualOptions& options;
};

// False if too few configurations are alike.
bool gather_groups(const GatheringTask& task, Alike alike, ObservedData& data) {
  const Measurements& measurements = task.measurements;
  data.groups.clear();
  Gathering gathering(measurements, task.options);
  std::map<std::vector<double>, std::size_t> numbers;
  std::size_t number = 0;  // index of the last configuration's group
  std::size_t configurations = 0;
  const Index joints = measurements.joint_values.rows();
  VectorXd basis;
  while (const ObservedConfiguration* configuration = gathering.next()) {
    if (data.groups.empty() || !data.groups[number].takes(*configuration)) {
      const auto [found, is_new] =
          numbers.emplace(group_key(*configuration, measurements.targets.size(), alike), data.groups.size());
      number = found->second;
      if (is_new) {
        data.groups.push_back(group_for(*configuration, alike, task.options.noise));
        data.groups.back().joints = static_cast<std::size_t>(joints);
        data.groups.back().terms = task.terms;
      }
    }
    LaneGroup& group = data.groups[number];
    if (configurations == 0) {  // usually the only group
      const auto blocks = static_cast<std::size_t>((measurements.joint_values.cols() + kLanes - 1) / kLanes);
      group.data.reserve(blocks * group.rows());
    }
    const Index c = configuration->column;
    const auto q = measurements.joint_values.col(c);
    if (!task.terms.empty()) {
      basis = effect_basis(task.model, q, column(measurements.signals, c));
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

std::size_t LaneGroup::orientations() const {
  return static_cast<std::size_t>(std::count_if(orientation_weights.begin(), orientation_weights.end(),
                                                [](double weight) { return weight > 0.0; }));
}

bool LaneGroup::takes(const ObservedConfiguration& configuration) const {
  bool alike = configuration.points.size() == targets.size();
  for (std::size_t k = 0; alike && k < targets.size(); ++k) {
    const ObservedPoint& point = configuration.points[k];
    alike = point.target == targets[k] && (own_roots ? (point.orientation_weight > 0.0) == (orientation_weight(k) > 0.0)
                                                     : (information != nullptr || point.weight == weights[k]) &&
                                                           point.orientation_weight == orientation_weight(k));
  }
  if (!alike || own_roots) {
    return alike && is_coupled(configuration) == coupled;
  }
  return configuration.information == information ||
         (configuration.information && information && *configuration.information == *information);
}

void LaneGroup::append(const Eigen::Ref<const VectorXd>& q, const Eigen::Ref<const VectorXd>& basis,
                       const ObservedConfiguration& configuration) {
  const std::size_t lane = configurations % kLanes;
  if (lane == 0) {
    data.resize(data.size() + rows());
  }
  LaneWriter writer(data[data.size() - rows()], lane);
  const auto write_all = [&](const auto& values) {
    std::for_each(values.begin(), values.end(), [&](double value) { writer.write(value); });
  };
  write_all(q);
  for (std::size_t k = 0; k < kept(); ++k) {
    write_all(mixed(k, [&](std::size_t l) { return configuration.points[l].position; }));
  }
  if (own_roots) {
    const MatrixXd root = root_of_information(configuration);
    for (Index row = 0; row < root.rows(); ++row) {
      write_all(root.row(row).segment(row, root_end(row) - row));
    }
  }
  for (const ObservedPoint& point : configuration.points) {
    if (point.orientation_weight > 0.0) {
      write_all(point.orientation.reshaped<Eigen::RowMajor>());
      writer.write(point.orientation_weight);
    }
  }
  for (const std::size_t term : terms) {
    writer.write(basis[static_cast<Index>(term)]);
  }
  columns.push_back(configuration.column);
  ++configurations;
}

Index LaneGroup::root_end(Index row) const {
  return coupled ? static_cast<Index>(3 * targets.size()) : row - row % 3 + 3;
}

MatrixXd LaneGroup::information_at(std::size_t configuration) const {
  const auto size = static_cast<Index>(3 * targets.size());
  MatrixXd root = MatrixXd::Zero(size, size);
  std::size_t next = first_root();
  for (Index row = 0; row < size; ++row) {
    for (Index column = row; column < root_end(row); ++column) {
      root(row, column) = at(configuration, next++);
    }
  }
  return root.transpose() * root;
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
  points.information = own_roots ? std::make_shared<const MatrixXd>(information_at(configuration)) : information;
  for (std::size_t k = targets.size(); k-- > 0;) {  // `mixing` and `roots` are upper triangular
    const std::size_t row = joints + 3 * k;
    ObservedPoint& point = points.points[k];
    point.target = targets[k];
    point.weight = points.information ? 0.0 : weights[k];
    point.position = Vector3d(at(configuration, row), at(configuration, row + 1), at(configuration, row + 2));
    for (std::size_t l = k + 1; l < mixed_end(k); ++l) {
      point.position -= share(k, l).cwiseProduct(points.points[l].position);
    }
    point.position = point.position.cwiseQuotient(share(k, k));
  }
  read_orientations(configuration, points);
}

void LaneGroup::read_orientations(std::size_t configuration, ObservedConfiguration& points) const {
  std::size_t next = first_orientation();
  for (std::size_t k = 0; k < targets.size(); ++k) {
    ObservedPoint& point = points.points[k];
    point.orientation_weight = 0.0;
    if (orientation_weight(k) > 0.0) {
      for (Index i = 0; i < 9; ++i) {
        point.orientation(i / 3, i % 3) = at(configuration, next++);
      }
      point.orientation_weight = at(configuration, next++);
    }
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
  const GatheringTask task{model, terms_in_lanes(model, unknowns), measurements, options};
  if (!has_single_coordinates(measurements) && (measurements.joint_values.array().abs() <= kLargestAngle).all() &&
      ((!options.noise.tracker && gather_groups(task, Alike::weights, data)) ||
       gather_groups(task, Alike::points, data))) {
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
