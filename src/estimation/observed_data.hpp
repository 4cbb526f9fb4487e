#pragma once

// Gathered measurements in the form that the passes read.

#include <Eigen/Core>
#include <array>
#include <memory>
#include <vector>

#include "estimation/chain_kernel.hpp"
#include "estimation/observed_points.hpp"
#include "estimation/residual_options.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

/// Configurations with the same measured points and weights, stored for the kernel. Correlated points with isotropic
/// information W = U^T U (U upper triangular) are stored as uncorrelated ones: mixing = S^-1 U, with the row sums of U
/// in S, transforms points z and targets t to points with independent errors and weights S^2. This preserves the
/// equations because the rows of `mixing` sum to 1. If the noise differs between axes, rows of U for each axis replace
/// the points. If the configurations share only the points, each stores its own U.
struct LaneGroup {
  std::vector<std::size_t> targets;
  std::vector<double> weights;           // of each stored point
  Eigen::MatrixXd mixing;                // stored points x points; empty if they are the same
  std::array<Eigen::MatrixXd, 3> roots;  // stored rows x points, along x, y and z of W; or empty
  /// 3 · points x 3 · points, see ObservedConfiguration.
  std::shared_ptr<const Eigen::MatrixXd> information;
  bool own_roots = false;  // whether each configuration stores its root in the data
  bool coupled = false;    // whether the roots couple the points
  /// Weight of each target's orientation, 0 if not measured, 1 for own roots; empty if none was measured.
  std::vector<double> orientation_weights;
  std::size_t joints = 0;
  std::vector<std::size_t> terms;  // as terms_in_lanes()
  std::size_t configurations = 0;
  std::vector<Eigen::Index> columns;  // of each configuration in the measurements
  std::vector<LaneRow> data;          // see ChainKernelInput::data

  // Layout of a block of kLanes configurations.
  std::size_t rows() const { return first_term() + terms.size(); }
  std::size_t first_root() const { return joints + 3 * kept(); }
  std::size_t first_orientation() const { return first_root() + (own_roots ? root_rows(targets.size(), coupled) : 0); }
  std::size_t first_term() const { return first_orientation() + kOrientationRows * orientations(); }
  double orientation_weight(std::size_t k) const { return orientation_weights.empty() ? 0.0 : orientation_weights[k]; }
  std::size_t orientations() const;
  bool by_axis() const { return roots[0].size() != 0; }
  bool in_rows() const { return by_axis() || own_roots; }
  /// Number of stored points or, by axis, rows.
  std::size_t kept() const { return by_axis() ? static_cast<std::size_t>(roots[0].rows()) : targets.size(); }
  double at(std::size_t configuration, std::size_t row) const {
    return data[configuration / kLanes * rows() + row].lanes[configuration % kLanes];
  }
  bool takes(const ObservedConfiguration& configuration) const;
  /// Stored point `k` combines points k … mixed_end(k) - 1, because `mixing` and `roots` are upper triangular.
  std::size_t mixed_end(std::size_t k) const { return mixing.size() == 0 && !by_axis() ? k + 1 : targets.size(); }
  /// Coefficient of point `l` >= k in stored point `k`, along each axis.
  Eigen::Vector3d share(std::size_t k, std::size_t l) const {
    const auto row = static_cast<Eigen::Index>(k);
    const auto point = static_cast<Eigen::Index>(l);
    if (by_axis()) {
      return {roots[0](row, point), roots[1](row, point), roots[2](row, point)};
    }
    return Eigen::Vector3d::Constant(mixing.size() == 0 ? (k == l ? 1.0 : 0.0) : mixing(row, point));
  }
  /// Stored point `k` for points at position_of(l).
  template <class PositionOf>
  Eigen::Vector3d mixed(std::size_t k, PositionOf position_of) const {
    if (mixing.size() == 0 && !by_axis()) {
      return position_of(k);
    }
    Eigen::Vector3d sum = share(k, k).cwiseProduct(Eigen::Vector3d(position_of(k)));
    for (std::size_t l = k + 1; l < mixed_end(k); ++l) {
      sum += share(k, l).cwiseProduct(Eigen::Vector3d(position_of(l)));
    }
    return sum;
  }
  /// `basis`: basis(q) of the model's effects.
  void append(const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::Ref<const Eigen::VectorXd>& basis,
              const ObservedConfiguration& configuration);
  /// Reads the joint values, the basis and the points of one configuration.
  void read(std::size_t configuration, Eigen::VectorXd& q, Eigen::VectorXd& basis, ObservedConfiguration& points) const;

private:
  /// One past the last stored column of a root's row.
  Eigen::Index root_end(Eigen::Index row) const;
  Eigen::MatrixXd information_at(std::size_t configuration) const;
  void read_orientations(std::size_t configuration, ObservedConfiguration& points) const;
};

/// The fitted configurations: all in groups, or all one by one.
struct ObservedData {
  ObservedTotals totals;
  std::vector<LaneGroup> groups;
  std::vector<ObservedConfiguration> configurations;
  // For configurations one by one: joints x N, and basis(q) of the effects, effects x N.
  Eigen::MatrixXd joint_values;
  Eigen::MatrixXd effect_basis;

  /// The configurations' columns in the measurements, in the order of the passes.
  std::vector<Eigen::Index> columns() const;
};

/// Indices of the model's effects, sorted by motion, within a motion free ones first.
std::vector<std::size_t> terms_in_lanes(const ErrorModel& model, const Unknowns& unknowns);

/// Groups the configurations if all joint values are within kLargestAngle, all rows are whole points and enough
/// configurations are alike, else keeps them one by one.
ObservedData gathered(const ErrorModel& model, const Unknowns& unknowns, const Measurements& measurements,
                      const ResidualOptions& options);

}  // namespace kdl_calibration
