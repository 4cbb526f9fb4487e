#pragma once

// What was gathered of a set of measurements, in plain structs that the passes read. Not installed.

#include <Eigen/Core>
#include <array>
#include <memory>
#include <vector>

#include "estimation/chain_kernel.hpp"
#include "estimation/observed_points.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// Configurations in which the same points were measured with the same weights, side by side. Points whose errors are
/// correlated and alike in every direction, with information W = U^T U of them (U upper triangular), are kept as others
/// that are not correlated: mixing = S^-1 U with the sums of U's rows in S makes of the points z of a configuration,
/// and of the targets' t, those with errors of their own and weights S^2, as the rows of `mixing` add up to 1. Where
/// the noise is another along each axis, rows of U for each of them take the place of points. Where the configurations
/// have nothing but the points in common, each keeps its own U beside them.
struct LaneGroup {
  std::vector<std::size_t> targets;
  std::vector<double> weights;           // of each point that is kept
  Eigen::MatrixXd mixing;                // points that are kept x points; empty where they are the same
  std::array<Eigen::MatrixXd, 3> roots;  // rows that are kept x points, along x, y and z of W; else empty
  /// 3 points x 3 points, see ObservedConfiguration.
  std::shared_ptr<const Eigen::MatrixXd> information;
  bool own_roots = false;  // of the information, in the data
  bool coupled = false;    // whether these couple the points
  /// Of each target, 0 where it was not measured, with own roots 1 instead of others; empty where none was.
  std::vector<double> orientation_weights;
  std::size_t joints = 0;
  std::vector<std::size_t> terms;  // as terms_in_lanes()
  std::size_t configurations = 0;
  std::vector<Eigen::Index> columns;  // of each configuration, in the measurements
  std::vector<LaneRow> data;          // see ChainKernelInput::data

  // Of a block of kLanes configurations.
  std::size_t rows() const { return first_term() + terms.size(); }
  std::size_t first_root() const { return joints + 3 * kept(); }
  std::size_t first_orientation() const { return first_root() + (own_roots ? root_rows(targets.size(), coupled) : 0); }
  std::size_t first_term() const { return first_orientation() + kOrientationRows * orientations(); }
  double orientation_weight(std::size_t k) const { return orientation_weights.empty() ? 0.0 : orientation_weights[k]; }
  std::size_t orientations() const;
  bool by_axis() const { return roots[0].size() != 0; }
  bool in_rows() const { return by_axis() || own_roots; }
  /// Points or, by axis, rows.
  std::size_t kept() const { return by_axis() ? static_cast<std::size_t>(roots[0].rows()) : targets.size(); }
  double at(std::size_t configuration, std::size_t row) const {
    return data[configuration / kLanes * rows() + row].lanes[configuration % kLanes];
  }
  bool takes(const ObservedConfiguration& configuration) const;
  /// What is kept as `k` is made of the points k … mixed_end(k) - 1, as `mixing` and `roots` are upper triangular.
  std::size_t mixed_end(std::size_t k) const { return mixing.size() == 0 && !by_axis() ? k + 1 : targets.size(); }
  /// Share of the point `l`, l >= k, in what is kept as `k`, along each axis.
  Eigen::Vector3d share(std::size_t k, std::size_t l) const {
    const auto row = static_cast<Eigen::Index>(k);
    const auto point = static_cast<Eigen::Index>(l);
    if (by_axis()) {
      return {roots[0](row, point), roots[1](row, point), roots[2](row, point)};
    }
    return Eigen::Vector3d::Constant(mixing.size() == 0 ? (k == l ? 1.0 : 0.0) : mixing(row, point));
  }
  /// Of positions position_of(l) what is kept as `k`.
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
  /// `basis`: what the model's effects are worth there.
  void append(const Eigen::Ref<const Eigen::VectorXd>& q, const Eigen::Ref<const Eigen::VectorXd>& basis,
              const ObservedConfiguration& configuration);
  /// The joint values, the basis and the points of one.
  void read(std::size_t configuration, Eigen::VectorXd& q, Eigen::VectorXd& basis, ObservedConfiguration& points) const;

private:
  /// Behind the last column that is kept of a root's row.
  Eigen::Index root_end(Eigen::Index row) const;
  Eigen::MatrixXd information_at(std::size_t configuration) const;
  void read_orientations(std::size_t configuration, ObservedConfiguration& points) const;
};

/// Every configuration that is fitted stands in one of the groups, or all of them stand one by one.
struct ObservedData {
  ObservedTotals totals;
  std::vector<LaneGroup> groups;
  std::vector<ObservedConfiguration> configurations;
  // Of the configurations one by one: joints x N, and basis(q) of the model's effects x N.
  Eigen::MatrixXd joint_values;
  Eigen::MatrixXd effect_basis;

  /// The configurations' columns in the measurements, in the order in which passes come to them.
  std::vector<Eigen::Index> columns() const;
};

/// The model's effects, those of one motion together, those that are free before those that are not.
std::vector<std::size_t> terms_in_lanes(const ErrorModel& model, const Unknowns& unknowns);

/// Groups are worth while, and possible, where points alone were measured, no axis's noise knows of another's, and few
/// of the configurations differ in what was measured of them.
ObservedData gathered(const ErrorModel& model, const Unknowns& unknowns, const Measurements& measurements,
                      const ResidualOptions& options);

}  // namespace kdl_calibration
