#include "kdl_calibration/least_squares.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <numeric>
#include <optional>
#include <tuple>
#include <utility>

#include "estimation/chain_kernel.hpp"
#include "kdl_calibration/deflection.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

double row_weight(const ResidualOptions& options, std::size_t row) {
  return options.row_weights.empty() ? 1.0 : options.row_weights[row];
}

// Rows that are held out, or whose weight is zero, are as good as not there.
bool is_fitted(const Measurements& measurements, const ResidualOptions& options, std::size_t row) {
  return measurements.observations[row].split == Split::train && row_weight(options, row) > 0.0;
}

bool has_orientation(const Measurements& measurements, std::size_t row) {
  return !measurements.orientations.empty() && !std::isnan(measurements.orientations[row].w());
}

bool is_isotropic(const NoiseModel& noise) {
  const bool equal = noise.independent.isConstant(noise.independent.x(), 0.0);
  const bool no_misfit = noise.misfit == 0.0 && noise.target_misfit == 0.0;
  return equal && noise.common.isZero(0.0) && no_misfit && !noise.tracker;
}

double orientation_weight(const ResidualOptions& options, double position_weight) {
  const double sigma = options.noise.orientation;
  return sigma > 0.0 ? 1.0 / (sigma * sigma)
                     : position_weight * options.orientation_length * options.orientation_length;
}

}  // namespace

Matrix3d point_covariance(const NoiseModel& noise, const Observation& observation) {
  if (observation.sigma > 0.0) {
    return observation.sigma * observation.sigma * Matrix3d::Identity();
  }
  if (noise.tracker) {
    const double distance = observation.position.norm();
    const double range = noise.tracker->range + noise.tracker->range_per_metre * distance;
    const double transverse = noise.tracker->transverse + noise.tracker->transverse_per_metre * distance;
    const Vector3d line = distance > 0.0 ? Vector3d(observation.position / distance) : Vector3d::UnitZ();
    const Matrix3d along = line * line.transpose();
    return range * range * along + transverse * transverse * (Matrix3d::Identity() - along);
  }
  return noise.independent.cwiseAbs2().asDiagonal();
}

struct LeastSquaresProblem::Group {
  std::vector<std::size_t> targets;
  std::vector<double> weights;
  std::size_t configurations = 0;
  std::size_t rows = 0;       // of a block: joints, then three per target
  std::vector<LaneRow> data;  // see ChainKernelInput::data

  // Value `row` of configuration `c`.
  double& at(std::size_t c, std::size_t row) {
    return reinterpret_cast<double*>(&data[c / kLanes * rows + row])[c % kLanes];
  }
  double at(std::size_t c, std::size_t row) const { return data[c / kLanes * rows + row].lanes[c % kLanes]; }
};

// One configuration, linearised in the flange frame. Rows: three per measured position, three per orientation.
//   residual = measured - predicted,  motion of the predicted points per flange twist = twist_rows (rows x 6),
//   per target parameter = unit, so that row r belongs to the target column `columns[r]` (-1: fixed).
struct LeastSquaresProblem::Block {
  Matrix6Xd jacobian;  // of the chain columns
  VectorXd residual;
  Eigen::Matrix<double, Eigen::Dynamic, 6> twist_rows;
  MatrixXd information;
  std::vector<int> columns;
};

struct LeastSquaresProblem::Workspace {
  ChainFolder folder;
  FoldedChain chain;
  std::vector<ParameterTwist> twists;  // of base and geometric columns
  std::vector<std::size_t> order;      // of the kernel's columns: those that turn come first
  ChainKernelInput input;
  ChainKernelSums sums;
  // Of the pass over the blocks.
  Block block;
  Eigen::Matrix<double, 6, Eigen::Dynamic> weighted_rows;
  Eigen::Matrix<double, Eigen::Dynamic, 6> transposed_jacobian;
  VectorXd force;
};

LeastSquaresProblem::~LeastSquaresProblem() = default;

LeastSquaresProblem::LeastSquaresProblem(const ErrorModel& model, const Measurements& measurements,
                                         const Unknowns& unknowns, const ResidualOptions& options)
    : model_(model),
      unknowns_(unknowns),
      workspace_(new Workspace{.folder = ChainFolder(model, unknowns.geometric()),
                               .chain = {},
                               .twists = {},
                               .order = {},
                               .input = {},
                               .sums = {},
                               .block = {},
                               .weighted_rows = {},
                               .transposed_jacobian = {},
                               .force = {}}) {
  chain_columns_ = unknowns.chain().count;
  columns_ = unknowns.size();
  prior_information_ = unknowns.prior_information(options.priors);
  const std::vector<ParameterTwist> base = base_twists();
  for (const std::size_t i : unknowns.of(UnknownGroup::base)) {
    workspace_->twists.push_back(base[i]);
  }
  workspace_->twists.resize(workspace_->twists.size() + unknowns.geometric().size());
  workspace_->chain = workspace_->folder.shape();
  gather(measurements, options);
}

void LeastSquaresProblem::gather(const Measurements& measurements, const ResidualOptions& options) {
  if (is_isotropic(options.noise) && gather_groups(measurements, options)) {
    return;
  }
  joint_values_ = measurements.joint_values;
  deflection_basis_ = deflection_basis(model_, joint_values_);
  if (is_isotropic(options.noise)) {
    gather_isotropic(measurements, options);
  } else {
    gather_blocks(measurements, options);
  }
}

namespace {

// The rows sorted by configuration; empty where they already are.
std::vector<std::uint32_t> order_of_configurations(const Measurements& measurements) {
  const std::vector<Observation>& rows = measurements.observations;
  std::vector<std::uint32_t> order;
  const auto by_configuration = [](const Observation& a, const Observation& b) {
    return a.configuration < b.configuration;
  };
  if (!std::is_sorted(rows.begin(), rows.end(), by_configuration)) {
    order.resize(rows.size());
    std::iota(order.begin(), order.end(), 0U);
    std::stable_sort(order.begin(), order.end(),
                     [&](std::uint32_t a, std::uint32_t b) { return by_configuration(rows[a], rows[b]); });
  }
  return order;
}

}  // namespace

// Independent rows of equal sigma in every direction and points alone: as gather_isotropic, but configurations that
// are alike are stored side by side. False where that is not possible or not worth while.
bool LeastSquaresProblem::gather_groups(const Measurements& measurements, const ResidualOptions& options) {
  const bool in_range = (measurements.joint_values.array().abs() <= kLargestAngle).all();
  if (!measurements.orientations.empty() || !unknowns_.deflections().empty() || !in_range) {
    return false;
  }
  const std::size_t targets = measurements.targets.size();
  const auto joints = static_cast<std::size_t>(measurements.joint_values.rows());
  const std::vector<std::uint32_t> order = order_of_configurations(measurements);
  const auto weight_of = [&](std::size_t row) {
    const double stated = measurements.observations[row].sigma;
    const double sigma = stated > 0.0 ? stated : options.noise.independent.x();
    return row_weight(options, row) * (sigma > 0.0 ? 1.0 / (sigma * sigma) : 1.0);
  };
  // Calls visit(configuration) with what is fitted of it in `rows`, until that returns false.
  std::vector<std::size_t> rows;
  const auto for_configurations = [&](const auto& visit) {
    for (std::size_t i = 0; i < measurements.observations.size();) {
      rows.clear();
      const std::int32_t configuration = measurements.observations[order.empty() ? i : order[i]].configuration;
      for (; i < measurements.observations.size(); ++i) {
        const std::size_t row = order.empty() ? i : order[i];
        if (measurements.observations[row].configuration != configuration) {
          break;
        }
        if (is_fitted(measurements, options, row)) {
          rows.push_back(row);
        }
      }
      if (!rows.empty() && !visit(static_cast<std::size_t>(configuration))) {
        return false;
      }
    }
    return true;
  };

  // Configurations whose targets have the same weights are alike.
  std::map<std::vector<double>, std::size_t> numbers;
  std::vector<std::uint32_t> group_of;  // of each configuration, in the order of the visit
  std::vector<double> weights(targets);
  std::vector<double> last;
  const bool alike = for_configurations([&](std::size_t) {
    std::fill(weights.begin(), weights.end(), 0.0);
    for (const std::size_t row : rows) {
      weights[static_cast<std::size_t>(measurements.observations[row].target)] += weight_of(row);
    }
    group_of.push_back(weights == last
                           ? group_of.back()
                           : static_cast<std::uint32_t>(numbers.emplace(weights, numbers.size()).first->second));
    last = weights;
    return numbers.size() <= kLanes || 2 * numbers.size() <= group_of.size();
  });
  if (!alike) {
    return false;
  }
  groups_.resize(numbers.size());
  for (const std::uint32_t g : group_of) {
    ++groups_[g].configurations;
  }
  for (const auto& [own, g] : numbers) {
    Group& group = groups_[g];
    for (std::size_t k = 0; k < targets; ++k) {
      if (own[k] > 0.0) {
        group.targets.push_back(k);
        group.weights.push_back(own[k]);
      }
    }
    group.rows = joints + 3 * group.targets.size();
    group.data.resize((group.configurations + kLanes - 1) / kLanes * group.rows);
  }

  // Running weighted means and sums of squares about them (West 1979).
  std::vector<std::size_t> filled(groups_.size(), 0);
  std::size_t visited = 0;
  for_configurations([&](std::size_t c) {
    const std::uint32_t g = group_of[visited++];
    Group& group = groups_[g];
    const std::size_t number = filled[g]++;
    for (std::size_t i = 0; i < joints; ++i) {
      group.at(number, i) = measurements.joint_values(static_cast<Index>(i), static_cast<Index>(c));
    }
    std::fill(weights.begin(), weights.end(), 0.0);
    for (const std::size_t row : rows) {
      const Observation& observation = measurements.observations[row];
      const auto target = static_cast<std::size_t>(observation.target);
      const auto found = std::find(group.targets.begin(), group.targets.end(), target);
      const std::size_t first = joints + 3 * static_cast<std::size_t>(found - group.targets.begin());
      double& sum = weights[target];
      const double weight = weight_of(row);
      double squares = 0.0;
      for (std::size_t i = 0; i < 3; ++i) {
        double& mean = group.at(number, first + i);
        const double deviation = observation.position[static_cast<Index>(i)] - mean;
        mean += deviation * (weight / (sum + weight));
        squares += deviation * deviation;
      }
      cost_of_repeats_ += squares * weight * sum / (sum + weight);
      sum += weight;
      equations_ += 3;
      points_measured_ += 1;
      total_weight_ += weight;
    }
    return true;
  });
  return true;
}

// The mean of close rotations: along the geodesic by the new one's share.
void LeastSquaresProblem::add_orientation(const Measurements& measurements, std::size_t row, double weight,
                                          Point& point) {
  const Matrix3d Z = measurements.orientations[row].toRotationMatrix();
  if (point.orientation_weight == 0.0) {
    point.orientation = Z;
  } else {
    const double share = weight / (point.orientation_weight + weight);
    const Vector3d deviation = rotation_log(point.orientation.transpose() * Z);
    cost_of_repeats_ += deviation.squaredNorm() * share * point.orientation_weight;
    point.orientation = point.orientation * rotation_exp(share * deviation);
  }
  point.orientation_weight += weight;
  equations_ += 3;
}

// Independent rows of equal sigma in every direction: a weighted mean per target and configuration.
void LeastSquaresProblem::gather_isotropic(const Measurements& measurements, const ResidualOptions& options) {
  const std::size_t targets = measurements.targets.size();
  const auto count = static_cast<std::size_t>(measurements.joint_values.cols());
  std::vector<Point> cells(count * targets);
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Observation& observation = measurements.observations[row];
    if (!is_fitted(measurements, options, row)) {
      continue;
    }
    const auto target = static_cast<std::size_t>(observation.target);
    Point& cell = cells[static_cast<std::size_t>(observation.configuration) * targets + target];
    const double sigma = observation.sigma > 0.0 ? observation.sigma : options.noise.independent.x();
    const double information = sigma > 0.0 ? 1.0 / (sigma * sigma) : 1.0;
    const double weight = row_weight(options, row) * information;
    // Running weighted mean and sum of squares about it (West 1979).
    const Vector3d deviation = observation.position - cell.position;
    cell.target = target;
    cell.position += deviation * (weight / (cell.weight + weight));
    cost_of_repeats_ += deviation.squaredNorm() * weight * cell.weight / (cell.weight + weight);
    cell.weight += weight;
    equations_ += 3;
    points_measured_ += 1;
    total_weight_ += weight;
    if (has_orientation(measurements, row)) {
      add_orientation(measurements, row, row_weight(options, row) * orientation_weight(options, information), cell);
    }
  }
  for (std::size_t c = 0; c < count; ++c) {
    Configuration configuration{.column = static_cast<Index>(c), .first_point = points_.size(), .end_point = 0};
    for (std::size_t k = 0; k < targets; ++k) {
      if (cells[c * targets + k].weight > 0.0) {
        points_.push_back(cells[c * targets + k]);
      }
    }
    configuration.end_point = points_.size();
    if (configuration.end_point > configuration.first_point) {
      configurations_.push_back(std::move(configuration));
    }
  }
}

namespace {

// Nothing where a coordinate has next to no variance of its own beside what the others of its repeat tell of it: no
// digits are left then.
std::optional<MatrixXd> inverse_covariance(const MatrixXd& covariance) {
  constexpr double kLeastOwnShare = 1e-12;
  const Eigen::LLT<MatrixXd> root(covariance);
  const VectorXd own_share = root.matrixLLT().diagonal().cwiseAbs2().cwiseQuotient(covariance.diagonal());
  if (root.info() != Eigen::Success || !(own_share.minCoeff() > kLeastOwnShare)) {
    return std::nullopt;
  }
  return root.solve(MatrixXd::Identity(covariance.rows(), covariance.cols()));
}

// Information of the means of one configuration's targets, 3 coordinates each, with what the model misses added to
// their covariance.
MatrixXd with_misfit(const MatrixXd& information, const NoiseModel& noise) {
  if (noise.misfit == 0.0 && noise.target_misfit == 0.0) {
    return information;
  }
  const Index size = information.rows();
  const MatrixXd unit = MatrixXd::Identity(size, size);
  const Eigen::LLT<MatrixXd> root(information);
  MatrixXd covariance = root.solve(unit) + noise.target_misfit * noise.target_misfit * unit;
  covariance += noise.misfit * noise.misfit * Matrix3d::Identity().replicate(size / 3, size / 3);
  return Eigen::LLT<MatrixXd>(covariance).solve(unit);
}

}  // namespace

// Any covariance: the information of every repeat, a block over its points, is added up per configuration. With
// W = sum W_r and the mean z = W^-1 sum W_r z_r, sum (z_r - f)^T W_r (z_r - f) = (z - f)^T W (z - f) + constant. All z
// are counted from the first repeat of their target: the constant is a small difference of squares.
void LeastSquaresProblem::gather_blocks(const Measurements& measurements, const ResidualOptions& options) {
  std::vector<std::size_t> rows;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    if (is_fitted(measurements, options, row)) {
      rows.push_back(row);
    }
  }
  const auto key = [&](std::size_t row) {
    const Observation& o = measurements.observations[row];
    return std::tuple(o.configuration, o.repeat, o.target);
  };
  std::stable_sort(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });

  // What many repeats and configurations have in common is factorised and stored once.
  MatrixXd known_covariance;
  MatrixXd inverse;
  MatrixXd known_information;
  Eigen::LLT<MatrixXd> root;

  const auto targets = static_cast<Index>(measurements.targets.size());
  const Matrix3d common = options.noise.common.cwiseAbs2().asDiagonal();
  const double misfit = 3.0 * (std::pow(options.noise.misfit, 2) + std::pow(options.noise.target_misfit, 2));
  for (auto begin = rows.cbegin(); begin != rows.cend();) {
    const std::int32_t c = measurements.observations[*begin].configuration;
    MatrixXd information = MatrixXd::Zero(3 * targets, 3 * targets);
    VectorXd weighted = VectorXd::Zero(3 * targets);
    double squares = 0.0;
    std::vector<Point> cells(measurements.targets.size());
    std::vector<bool> seen(measurements.targets.size(), false);
    while (begin != rows.cend() && measurements.observations[*begin].configuration == c) {
      const std::int32_t repeat = measurements.observations[*begin].repeat;
      const auto end = std::find_if(begin, rows.cend(), [&](std::size_t row) {
        return measurements.observations[row].configuration != c || measurements.observations[row].repeat != repeat;
      });
      std::vector<Index> coordinates;
      VectorXd z(3 * (end - begin));
      MatrixXd covariance = common.replicate(end - begin, end - begin);
      for (auto row = begin; row != end; ++row) {
        const Observation& observation = measurements.observations[*row];
        const Matrix3d own = point_covariance(options.noise, observation);
        const Index i = 3 * (row - begin);
        const auto target = static_cast<std::size_t>(observation.target);
        if (!seen[target]) {
          cells[target].position = observation.position;
          seen[target] = true;
        }
        z.segment<3>(i) = observation.position - cells[target].position;
        covariance.block<3, 3>(i, i) += own / row_weight(options, *row);
        const Index first = 3 * observation.target;
        coordinates.insert(coordinates.end(), {first, first + 1, first + 2});
        equations_ += 3;
        points_measured_ += 1;
        total_weight_ += 3.0 / (covariance.block<3, 3>(i, i).trace() + misfit);
        if (has_orientation(measurements, *row)) {
          const double mean = 3.0 / own.trace();
          add_orientation(measurements, *row, row_weight(options, *row) * orientation_weight(options, mean),
                          cells[target]);
        }
      }
      begin = end;
      if (covariance.size() != known_covariance.size() || covariance != known_covariance) {
        std::optional<MatrixXd> found = inverse_covariance(covariance);
        if (!found) {
          throw InputError(measurements.source + ": configuration '" +
                           measurements.configurations[static_cast<std::size_t>(c)] +
                           "': the noise of single points is too small, expected more than a millionth of what they "
                           "share, along every axis");
        }
        inverse = std::move(*found);
        known_covariance = covariance;
      }
      information(coordinates, coordinates) += inverse;
      weighted(coordinates) += inverse * z;
      squares += z.dot(inverse * z);
    }

    Configuration configuration{.column = c, .first_point = points_.size(), .end_point = 0};
    std::vector<Index> measured;
    for (std::size_t k = 0; k < seen.size(); ++k) {
      if (seen[k]) {
        const auto first = static_cast<Index>(3 * k);
        measured.insert(measured.end(), {first, first + 1, first + 2});
        cells[k].target = k;
        points_.push_back(cells[k]);
      }
    }
    configuration.end_point = points_.size();
    const MatrixXd of_measured = information(measured, measured);
    if (informations_.empty() || of_measured.size() != known_information.size() || of_measured != known_information) {
      known_information = of_measured;
      informations_.push_back(with_misfit(of_measured, options.noise));
      root.compute(of_measured);
    }
    configuration.information = informations_.size() - 1;
    const VectorXd mean = root.solve(VectorXd(weighted(measured)));
    cost_of_repeats_ += squares - mean.dot(weighted(measured));
    for (std::size_t i = configuration.first_point; i < configuration.end_point; ++i) {
      points_[i].position += mean.segment<3>(static_cast<Index>(3 * (i - configuration.first_point)));
    }
    configurations_.push_back(configuration);
  }
}

std::vector<ParameterTwist> chain_twists(const ErrorModel& model, const Estimate& estimate, const Unknowns& unknowns) {
  std::vector<ParameterTwist> twists;
  const std::vector<ParameterTwist> base = base_twists();
  for (const std::size_t i : unknowns.of(UnknownGroup::base)) {
    twists.push_back(base[i]);
  }
  const std::vector<ParameterTwist> geometric = parameter_twists(model, estimate.errors, unknowns.geometric());
  twists.insert(twists.end(), geometric.begin(), geometric.end());
  for (const std::size_t d : unknowns.deflections()) {
    const int joint = model.deflections[d].index;
    const bool prismatic = model.joints[static_cast<std::size_t>(joint)].type == JointType::prismatic;
    ParameterTwist& twist = twists.emplace_back();
    twist.frame = joint;
    (prismatic ? twist.linear : twist.angular) = Vector3d::UnitZ();  // the folded chain's joints move along z
  }
  return twists;
}

std::vector<Isometry3d> flange_poses(const ErrorModel& model, const Estimate& estimate, const MatrixXd& joint_values) {
  return flange_poses(folded(model, estimate.errors), deflected(model, estimate.deflections, joint_values));
}

template <class Visitor>
void LeastSquaresProblem::visit(const Estimate& estimate, Visitor visitor) const {
  const FoldedChain chain = folded(model_, estimate.errors);
  const std::vector<ParameterTwist> twists = chain_twists(model_, estimate, unknowns_);
  Block& block = workspace_->block;
  const auto visit_one = [&](const auto& q, const Configuration& configuration, const std::vector<Point>& among) {
    const Isometry3d X_BF = flange_jacobian(chain, twists, q, block.jacobian);
    Index deflection_column = unknowns_.range(UnknownGroup::deflections).first;
    for (const std::size_t d : unknowns_.deflections()) {
      block.jacobian.col(deflection_column++) *= deflection_basis_(static_cast<Index>(d), configuration.column);
    }
    const Isometry3d X_FW = (estimate.X_WB * X_BF).inverse();
    const auto points = static_cast<Index>(configuration.end_point - configuration.first_point);
    Index oriented = 0;
    for (std::size_t i = configuration.first_point; i < configuration.end_point; ++i) {
      oriented += among[i].orientation_weight > 0.0 ? 1 : 0;
    }
    const Index rows = 3 * (points + oriented);
    block.residual.resize(rows);
    block.twist_rows.setZero(rows, 6);
    block.information.setZero(rows, rows);
    block.columns.assign(static_cast<std::size_t>(rows), -1);
    Index orientation_row = 3 * points;
    for (Index i = 0; i < points; ++i) {
      const Point& point = among[configuration.first_point + static_cast<std::size_t>(i)];
      const Isometry3d& X_FT = estimate.targets[point.target].X_FT;
      block.residual.segment<3>(3 * i) = X_FW * point.position - X_FT.translation();
      block.twist_rows.middleRows<3>(3 * i) << Matrix3d::Identity(), -skew(X_FT.translation());
      std::copy_n(unknowns_.target_columns(point.target).begin(), 3, block.columns.begin() + 3 * i);
      block.information.block<3, 3>(3 * i, 3 * i).diagonal().setConstant(point.weight);
      if (point.orientation_weight > 0.0) {
        // Rotation vector from predicted to measured, in the target's frame. Its exact derivative differs from the
        // identity by half the residual, which changes neither the gradient (J^-1 e = e) nor the optimum.
        block.residual.segment<3>(orientation_row) =
            rotation_log(X_FT.linear().transpose() * X_FW.linear() * point.orientation);
        block.twist_rows.block<3, 3>(orientation_row, 3) = X_FT.linear().transpose();
        std::copy_n(unknowns_.target_columns(point.target).begin() + 3, 3, block.columns.begin() + orientation_row);
        block.information.block<3, 3>(orientation_row, orientation_row)
            .diagonal()
            .setConstant(point.orientation_weight);
        orientation_row += 3;
      }
    }
    if (!informations_.empty()) {  // given in W, needed in F
      const MatrixXd& given = informations_[configuration.information];
      for (Index a = 0; a < points; ++a) {
        for (Index b = 0; b < points; ++b) {
          block.information.block<3, 3>(3 * a, 3 * b) =
              X_FW.linear() * given.block<3, 3>(3 * a, 3 * b) * X_FW.linear().transpose();
        }
      }
    }
    visitor(block);
  };
  for (const Group& group : groups_) {
    std::vector<Point> points(group.targets.size());
    const Configuration configuration{.column = 0, .first_point = 0, .end_point = points.size()};
    const std::size_t joints = model_.joints.size();
    MatrixXd q(joints, 1);
    for (std::size_t c = 0; c < group.configurations; ++c) {
      for (std::size_t i = 0; i < joints; ++i) {
        q(static_cast<Index>(i), 0) = group.at(c, i);
      }
      for (std::size_t k = 0; k < points.size(); ++k) {
        const std::size_t row = joints + 3 * k;
        points[k].target = group.targets[k];
        points[k].weight = group.weights[k];
        points[k].position = Vector3d(group.at(c, row), group.at(c, row + 1), group.at(c, row + 2));
      }
      visit_one(deflected(model_, estimate.deflections, q).col(0), configuration, points);
    }
  }
  const MatrixXd joints = deflected(model_, estimate.deflections, joint_values_);
  for (const Configuration& configuration : configurations_) {
    visit_one(joints.col(configuration.column), configuration, points_);
  }
}

// Calls visitor(column, information) for each prior that there is.
template <class Visitor>
void LeastSquaresProblem::visit_priors(Visitor visitor) const {
  for (Index column = 0; column < columns_; ++column) {
    if (prior_information_[column] > 0.0) {
      visitor(column, prior_information_[column]);
    }
  }
}

void LeastSquaresProblem::add_priors(const Estimate& estimate, NormalEquations& equations) const {
  visit_priors([&](Index column, double weight) {
    const double value = Unknowns::value(estimate, unknowns_.columns()[static_cast<std::size_t>(column)]);
    equations.hessian(column, column) += weight;
    equations.gradient[column] -= weight * value;
    equations.cost += weight * value * value;
  });
}

NormalEquations LeastSquaresProblem::linearise(const Estimate& estimate) const {
  NormalEquations equations;
  linearise(estimate, equations);
  return equations;
}

void LeastSquaresProblem::linearise(const Estimate& estimate, NormalEquations& equations) const {
  linearise(estimate, false, equations);
}

double LeastSquaresProblem::cost(const Estimate& estimate) const {
  NormalEquations equations;
  linearise(estimate, true, equations);
  return equations.cost;
}

void LeastSquaresProblem::linearise(const Estimate& estimate, bool cost_only, NormalEquations& equations) const {
  const bool rigid = estimate.deflections.size() == 0 || estimate.deflections.isZero(0.0);
  const bool side_by_side = !groups_.empty() && rigid;
  equations.hessian.setZero(columns_, columns_);
  equations.gradient.setZero(columns_);
  equations.cost = cost_of_repeats_;
  if (side_by_side) {
    prepare(estimate);
    for (const Group& group : groups_) {
      sum_group(group, estimate, cost_only, equations);
    }
  } else {
    sum_blocks(estimate, cost_only, equations);
  }
  add_priors(estimate, equations);
  equations.hessian.bottomLeftCorner(columns_ - chain_columns_, chain_columns_) =
      equations.hessian.topRightCorner(chain_columns_, columns_ - chain_columns_).transpose();
}

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

}  // namespace

// What the groups have in common at an estimate: the chain and its columns.
void LeastSquaresProblem::prepare(const Estimate& estimate) const {
  Workspace& work = *workspace_;
  const std::size_t columns = work.twists.size();
  work.folder.fold(estimate.errors, work.chain, work.twists, columns - unknowns_.geometric().size());
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
  work.input.prismatic.assign(work.chain.prismatic.begin(), work.chain.prismatic.end());
  work.input.links.clear();
  for (const Isometry3d& link : work.chain.links) {
    work.input.links.push_back(numbers_of(link.linear(), link.translation()));
  }
  work.input.base = numbers_of(estimate.X_WB.linear(), estimate.X_WB.translation());
}

void LeastSquaresProblem::sum_group(const Group& group, const Estimate& estimate, bool cost_only,
                                    NormalEquations& equations) const {
  ChainKernelInput& input = workspace_->input;
  ChainKernelSums& sums = workspace_->sums;
  const std::vector<std::size_t>& order = workspace_->order;
  double weight = 0.0;
  Vector3d centre = Vector3d::Zero();
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    weight += group.weights[k];
    centre += group.weights[k] * estimate.targets[group.targets[k]].X_FT.translation();
  }
  centre /= weight;
  Matrix3d spread = Matrix3d::Zero();
  input.points.resize(group.targets.size());
  input.weights = group.weights;
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    const Vector3d t = estimate.targets[group.targets[k]].X_FT.translation() - centre;
    spread += group.weights[k] / weight * (t.squaredNorm() * Matrix3d::Identity() - t * t.transpose());
    input.points[k] = {t.x(), t.y(), t.z()};
  }
  input.root = root_of(spread);
  input.flange = numbers_of(Matrix3d::Identity(), centre);
  const Isometry3d& last = workspace_->chain.links.back();
  input.links.back() = numbers_of(last.linear(), last * centre);
  input.data = group.data.data();
  input.configurations = group.configurations;
  sum_chain(input, cost_only, sums);
  equations.cost += sums.cost;
  if (cost_only) {
    return;
  }

  const double* gram = sums.gram.data();
  for (std::size_t i = 0; i < order.size(); ++i) {
    const auto a = static_cast<Index>(order[i]);
    equations.gradient[a] += sums.gradient[i];
    for (std::size_t j = i; j < order.size(); ++j) {
      const auto b = static_cast<Index>(order[j]);
      const double value = weight * *gram++;
      equations.hessian(a, b) += value;
      if (a != b) {
        equations.hessian(b, a) += value;
      }
    }
    const Vector3d v(&sums.twist[6 * i]);
    const Vector3d w(&sums.twist[6 * i + 3]);
    for (std::size_t k = 0; k < group.targets.size(); ++k) {
      const Vector3d coupling = group.weights[k] * (v + w.cross(Vector3d(input.points[k].data())));
      for (std::size_t c = 0; c < 3; ++c) {
        if (const int column = unknowns_.target_columns(group.targets[k])[c]; column >= 0) {
          equations.hessian(a, column) += coupling[static_cast<Index>(c)];
        }
      }
    }
  }
  for (std::size_t k = 0; k < group.targets.size(); ++k) {
    for (std::size_t c = 0; c < 3; ++c) {
      if (const int column = unknowns_.target_columns(group.targets[k])[c]; column >= 0) {
        equations.gradient[column] += sums.force[3 * k + c];
        equations.hessian(column, column) += static_cast<double>(group.configurations) * group.weights[k];
      }
    }
  }
}

void LeastSquaresProblem::sum_blocks(const Estimate& estimate, bool cost_only, NormalEquations& equations) const {
  Eigen::Matrix<double, 6, Eigen::Dynamic>& weighted_rows = workspace_->weighted_rows;
  Eigen::Matrix<double, Eigen::Dynamic, 6>& Jt = workspace_->transposed_jacobian;
  VectorXd& force = workspace_->force;
  auto chain_hessian = equations.hessian.topLeftCorner(chain_columns_, chain_columns_);
  visit(estimate, [&](const Block& block) {
    force.resize(block.residual.size());
    force.noalias() = block.information.lazyProduct(block.residual);
    equations.cost += block.residual.dot(force);
    if (cost_only) {
      return;
    }
    weighted_rows.resize(6, block.residual.size());
    weighted_rows.noalias() = block.twist_rows.transpose().lazyProduct(block.information);
    const Matrix6d flange_information = weighted_rows.lazyProduct(block.twist_rows);
    const Vector6d wrench = weighted_rows.lazyProduct(block.residual);
    Jt = block.jacobian.transpose();
    equations.gradient.head(chain_columns_).noalias() += Jt.lazyProduct(wrench);
    for (Index column = 0; column < chain_columns_; ++column) {  // the upper triangle
      const Vector6d weighted_column = flange_information.lazyProduct(block.jacobian.col(column));
      chain_hessian.col(column).head(column + 1).noalias() += Jt.topRows(column + 1).lazyProduct(weighted_column);
    }
    for (std::size_t a = 0; a < block.columns.size(); ++a) {
      const Index column = block.columns[a];
      if (column < 0) {
        continue;
      }
      const auto row = static_cast<Index>(a);
      equations.gradient[column] += force[row];
      equations.hessian.col(column).head(chain_columns_).noalias() += Jt.lazyProduct(weighted_rows.col(row));
      for (std::size_t b = 0; b < block.columns.size(); ++b) {
        if (block.columns[b] >= 0) {
          equations.hessian(block.columns[b], column) += block.information(static_cast<Index>(b), row);
        }
      }
    }
  });
  chain_hessian.triangularView<Eigen::StrictlyLower>() = chain_hessian.transpose();
}

// Jacobian and, as last column, residual of a configuration, with the root of its information multiplied in.
void LeastSquaresProblem::whiten(const Block& block, MatrixXd& rows) const {
  rows.setZero(block.residual.size(), columns_ + 1);
  rows.leftCols(chain_columns_).noalias() = block.twist_rows * block.jacobian;
  for (std::size_t a = 0; a < block.columns.size(); ++a) {
    if (block.columns[a] >= 0) {
      rows(static_cast<Index>(a), block.columns[a]) += 1.0;
    }
  }
  rows.rightCols<1>() = block.residual;
  rows = block.information.llt().matrixU() * MatrixXd(rows);
}

WhitenedSystem LeastSquaresProblem::whitened(const Estimate& estimate) const {
  std::vector<MatrixXd> blocks;
  Index rows = 0;
  visit(estimate, [&](const Block& block) {
    whiten(block, blocks.emplace_back());
    rows += blocks.back().rows();
  });
  Index priors = 0;
  visit_priors([&](Index, double) { ++priors; });
  WhitenedSystem system{
      .jacobian = MatrixXd::Zero(rows + priors, columns_), .residual = VectorXd::Zero(rows + priors), .blocks = {}};
  Index row = 0;
  for (const MatrixXd& block : blocks) {
    system.blocks.push_back(row);
    system.jacobian.middleRows(row, block.rows()) = block.leftCols(columns_);
    system.residual.segment(row, block.rows()) = block.rightCols<1>();
    row += block.rows();
  }
  system.blocks.push_back(row);
  visit_priors([&](Index column, double weight) {
    const double value = Unknowns::value(estimate, unknowns_.columns()[static_cast<std::size_t>(column)]);
    system.jacobian(row, column) = std::sqrt(weight);
    system.residual[row++] = -std::sqrt(weight) * value;
  });
  return system;
}

namespace {

// Sums up rows that come configuration by configuration. Some hundred at a time are made a triangle, together with the
// triangle of those before them, so that the memory is constant.
class RowSummary {
public:
  explicit RowSummary(Index columns) : columns_(columns), rows_(columns + kRowsAtOnce, columns), sum_(3, columns) {
    summary_.priors = VectorXd::Zero(columns);
    summary_.sums = MatrixXd::Zero(columns, columns);
  }

  void add_configuration(const Eigen::Ref<const MatrixXd>& jacobian, const Eigen::Ref<const VectorXd>& residual) {
    append(jacobian);
    const Index points = residual.size() / 3;
    sum_.setZero();
    for (Index i = 0; i < points; ++i) {
      sum_ += jacobian.middleRows<3>(3 * i);
    }
    summary_.sums.noalias() += sum_.transpose() * sum_;
    const Eigen::Map<const Matrix3Xd> e(residual.data(), 3, points);
    summary_.squares += e.squaredNorm();
    summary_.squares_of_sums += e.rowwise().sum().squaredNorm();
    summary_.pairs += 3.0 * static_cast<double>(points * (points - 1)) / 2.0;
    summary_.measured_rows += residual.size();
  }

  void add_prior(const Eigen::Ref<const MatrixXd>& row) {
    append(row);
    summary_.priors += row.transpose().cwiseAbs2();
  }

  WhitenedSummary finish() {
    make_triangle();
    summary_.triangle = rows_.topRows(filled_);
    return std::move(summary_);
  }

private:
  static constexpr Index kRowsAtOnce = 512;

  void append(const Eigen::Ref<const MatrixXd>& rows) {
    if (filled_ + rows.rows() > rows_.rows()) {
      make_triangle();
      rows_.conservativeResize(std::max(rows_.rows(), filled_ + rows.rows()), Eigen::NoChange);
    }
    rows_.middleRows(filled_, rows.rows()) = rows;
    filled_ += rows.rows();
    summary_.rows += rows.rows();
  }

  void make_triangle() {
    if (filled_ > columns_) {
      const Eigen::HouseholderQR<MatrixXd> factors(rows_.topRows(filled_));
      rows_.topRows(columns_) = MatrixXd(factors.matrixQR().topRows(columns_).triangularView<Eigen::Upper>());
      filled_ = columns_;
    }
  }

  Index columns_;
  MatrixXd rows_;
  Index filled_ = 0;
  MatrixXd sum_;
  WhitenedSummary summary_;
};

}  // namespace

WhitenedSummary summarised(const WhitenedSystem& system) {
  RowSummary summary(system.jacobian.cols());
  for (std::size_t b = 0; b + 1 < system.blocks.size(); ++b) {
    const Index first = system.blocks[b];
    const Index count = system.blocks[b + 1] - first;
    summary.add_configuration(system.jacobian.middleRows(first, count), system.residual.segment(first, count));
  }
  for (Index row = system.blocks.back(); row < system.jacobian.rows(); ++row) {
    summary.add_prior(system.jacobian.row(row));
  }
  return summary.finish();
}

std::optional<MatrixXd> well_conditioned_root(const MatrixXd& information) {
  constexpr double kSmallestPivot = 1e-3;
  const VectorXd norms = information.diagonal().cwiseSqrt();
  if (!(norms.minCoeff() > 0.0)) {
    return std::nullopt;
  }
  const VectorXd inverse = norms.cwiseInverse();
  const Eigen::LLT<MatrixXd> root(inverse.asDiagonal() * information * inverse.asDiagonal());
  if (root.info() != Eigen::Success || !(root.matrixLLT().diagonal().minCoeff() > kSmallestPivot)) {
    return std::nullopt;
  }
  return MatrixXd(root.matrixU()) * norms.asDiagonal();
}

WhitenedSummary LeastSquaresProblem::whitened_summary(const Estimate& estimate) const {
  WhitenedSummary of_groups;
  if (summarise_groups(estimate, of_groups)) {
    return of_groups;
  }
  RowSummary summary(columns_);
  MatrixXd rows;
  visit(estimate, [&](const Block& block) {
    whiten(block, rows);
    summary.add_configuration(rows.leftCols(columns_), rows.col(columns_));
  });
  visit_priors([&](Index column, double weight) {
    summary.add_prior(std::sqrt(weight) * Eigen::RowVectorXd::Unit(columns_, column));
  });
  return summary.finish();
}

// False where there are few configurations, or where the information is too badly conditioned for its root.
bool LeastSquaresProblem::summarise_groups(const Estimate& estimate, WhitenedSummary& summary) const {
  std::size_t configurations = 0;
  for (const Group& group : groups_) {
    configurations += group.configurations;
  }
  const bool rigid = estimate.deflections.size() == 0 || estimate.deflections.isZero(0.0);
  if (configurations <= kManyConfigurations || !rigid) {
    return false;
  }
  NormalEquations equations;
  linearise(estimate, equations);
  std::optional<MatrixXd> root = well_conditioned_root(equations.hessian);
  if (!root) {
    return false;
  }
  summary.triangle = std::move(*root);
  summary.priors = VectorXd::Zero(columns_);
  visit_priors([&](Index column, double weight) {
    summary.priors[column] = weight;
    summary.rows += 1;
  });
  summary.sums = MatrixXd::Zero(columns_, columns_);
  for (const Group& group : groups_) {
    NormalEquations own{.hessian = MatrixXd::Zero(columns_, columns_), .gradient = VectorXd::Zero(columns_)};
    sum_group(group, estimate, true, own);
    summary.squares += own.cost;
    add_sums(group, estimate, summary);
  }
  summary.rows += summary.measured_rows;
  return true;
}

// The sum over the points of sqrt(w_k) e_k is W (z - t), W = sum sqrt(w_k), for a single point: the mean with the
// weights sqrt(w_k).
void LeastSquaresProblem::add_sums(const Group& group, const Estimate& estimate, WhitenedSummary& summary) const {
  const std::size_t points = group.targets.size();
  const std::size_t joints = group.rows - 3 * points;
  const auto count = static_cast<double>(group.configurations);
  double W = 0.0;
  Vector3d mean = Vector3d::Zero();
  for (std::size_t k = 0; k < points; ++k) {
    W += std::sqrt(group.weights[k]);
    mean += std::sqrt(group.weights[k]) * estimate.targets[group.targets[k]].X_FT.translation();
  }
  Group single{.targets = {0},
               .weights = {W * W},
               .configurations = group.configurations,
               .rows = joints + 3,
               .data = std::vector<LaneRow>(group.data.size() / group.rows * (joints + 3))};
  for (std::size_t block = 0; block < group.data.size() / group.rows; ++block) {
    const LaneRow* from = &group.data[block * group.rows];
    LaneRow* to = &single.data[block * single.rows];
    std::copy_n(from, joints, to);
    for (std::size_t k = 0; k < points; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        to[joints + c].lanes += std::sqrt(group.weights[k]) / W * from[joints + 3 * k + c].lanes;
      }
    }
  }
  Estimate single_estimate = estimate;
  single_estimate.targets[0].X_FT.translation() = mean / W;
  NormalEquations own{.hessian = MatrixXd::Zero(columns_, columns_), .gradient = VectorXd::Zero(columns_)};
  sum_group(single, single_estimate, false, own);
  summary.squares_of_sums += own.cost;
  summary.pairs += count * 3.0 * static_cast<double>(points * (points - 1)) / 2.0;
  summary.measured_rows += static_cast<Index>(3 * points * group.configurations);
  summary.sums.topLeftCorner(chain_columns_, chain_columns_) +=
      own.hessian.topLeftCorner(chain_columns_, chain_columns_);
  for (std::size_t k = 0; k < points; ++k) {
    for (std::size_t c = 0; c < 3; ++c) {
      const int column = unknowns_.target_columns(group.targets[k])[c];
      if (column < 0) {
        continue;
      }
      for (std::size_t i = 0; i < workspace_->order.size(); ++i) {
        const auto a = static_cast<Index>(workspace_->order[i]);
        const double value = W * std::sqrt(group.weights[k]) * workspace_->sums.twist[6 * i + c];
        summary.sums(a, column) += value;
        summary.sums(column, a) += value;
      }
      for (std::size_t l = 0; l < points; ++l) {
        if (const int other = unknowns_.target_columns(group.targets[l])[c]; other >= 0) {
          summary.sums(column, other) += count * std::sqrt(group.weights[k] * group.weights[l]);
        }
      }
    }
  }
}

PositionPredictor::PositionPredictor(const ErrorModel& model, const Estimate& estimate, const Unknowns& unknowns)
    : model_(model),
      estimate_(estimate),
      unknowns_(unknowns),
      chain_(folded(model, estimate.errors)),
      twists_(chain_twists(model, estimate, unknowns)) {}

std::vector<Matrix3Xd> PositionPredictor::jacobians(const VectorXd& q) const {
  const MatrixXd joints = deflected(model_, estimate_.deflections, q);
  Matrix6Xd chain;
  const Matrix3d R_WF = estimate_.X_WB.linear() * flange_jacobian(chain_, twists_, joints.col(0), chain).linear();
  if (!unknowns_.deflections().empty()) {
    const MatrixXd basis = deflection_basis(model_, q);
    Index column = unknowns_.range(UnknownGroup::deflections).first;
    for (const std::size_t d : unknowns_.deflections()) {
      chain.col(column++) *= basis(static_cast<Index>(d), 0);
    }
  }
  std::vector<Matrix3Xd> jacobians;
  for (std::size_t k = 0; k < estimate_.targets.size(); ++k) {
    Matrix3Xd& jacobian = jacobians.emplace_back(Matrix3Xd::Zero(3, unknowns_.size()));
    jacobian.leftCols(chain.cols()) =
        R_WF * (chain.topRows<3>() - skew(estimate_.targets[k].X_FT.translation()) * chain.bottomRows<3>());
    for (std::size_t i = 0; i < 3; ++i) {
      if (const int column = unknowns_.target_columns(k)[i]; column >= 0) {
        jacobian.col(column) = R_WF.col(static_cast<Index>(i));
      }
    }
  }
  return jacobians;
}

}  // namespace kdl_calibration
