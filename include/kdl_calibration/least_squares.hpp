#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <memory>
#include <optional>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/unknowns.hpp"

namespace kdl_calibration {

/// 1 sigma of a tracker's distance and of its transverse error, each a constant plus a part that grows with distance.
/// The measuring frame is the tracker's own: it stands at the origin.
struct TrackerNoise {
  double range = 0.0;                 ///< [m]
  double range_per_metre = 0.0;       ///< [m/m]
  double transverse = 0.0;            ///< [m]
  double transverse_per_metre = 0.0;  ///< [m/m], i.e. [rad]
};

/// The covariance of what was measured. Observations with a sigma of their own keep it for their independent part.
/// Of one repeat of a configuration, with m points, it is the 3m x 3m block
///   blockdiag(independent parts) + common ⊗ (all ones).
/// What the model misses is the same in every repeat: to the covariance of the means over the repeats it adds
///   target_misfit^2 I + misfit^2 (all ones ⊗ I).
struct NoiseModel {
  /// [m] 1 sigma of every coordinate of a point by itself, along the axes of W. Zero, without tracker or common part,
  /// means that only the proportions are known: all rows weigh alike.
  Eigen::Vector3d independent = Eigen::Vector3d::Zero();
  std::optional<TrackerNoise> tracker;               ///< instead of `independent`
  Eigen::Vector3d common = Eigen::Vector3d::Zero();  ///< [m] shared by the points of one repeat, along the axes of W
  double misfit = 0.0;                               ///< [m] per coordinate, shared by the targets of a configuration
  double target_misfit = 0.0;                        ///< [m] per coordinate of each target in each configuration
  double orientation = 0.0;                          ///< [rad] of every component of a measured orientation

  bool is_absolute() const { return tracker.has_value() || !independent.isZero(0.0) || !common.isZero(0.0); }
};

/// Covariance of one measured point by itself, along the axes of W [m^2]; zero where nothing is stated.
Eigen::Matrix3d point_covariance(const NoiseModel& noise, const Observation& observation);

/// Gauss-Newton equations of the whitened residuals e = measured - predicted at one estimate.
struct NormalEquations {
  Eigen::MatrixXd hessian;   ///< sum J^T W J
  Eigen::VectorXd gradient;  ///< sum J^T W e
  double cost = 0.0;         ///< sum e^T W e
};

/// R of information = R^T R, upper triangular; nothing where the columns, scaled to unit norm, are so close to
/// depending on each other that a pivot is below 1e-3: figures made from R keep ten digits.
std::optional<Eigen::MatrixXd> well_conditioned_root(const Eigen::MatrixXd& information);

/// The same before the sum: J and e with W = L L^T multiplied in, J_w = L^T J.
struct WhitenedSystem {
  Eigen::MatrixXd jacobian;  ///< rows x columns; the priors' rows last
  Eigen::VectorXd residual;
  /// First row of each configuration, then the first row of the priors. The rows of a configuration are those of its
  /// points' positions, three each, then those of its orientations.
  std::vector<Eigen::Index> blocks;
};

/// What the uncertainty needs of a whitened system, of a size that the data do not change. With J_c and e_c the rows of
/// configuration c and s(.) the sum over its points (three rows):
struct WhitenedSummary {
  Eigen::MatrixXd triangle;  ///< R of the Jacobian, the priors' rows included; the Jacobian where that has few rows
  Eigen::Index rows = 0;     ///< of the Jacobian, the priors' rows included
  Eigen::Index measured_rows = 0;  ///< without the priors' rows
  Eigen::VectorXd priors;          ///< information that they add to each column
  Eigen::MatrixXd sums;            ///< sum s(J_c)^T s(J_c)
  double squares = 0.0;            ///< sum |e_c|^2
  double squares_of_sums = 0.0;    ///< sum |s(e_c)|^2
  double pairs = 0.0;              ///< pairs of coordinates of two points of one configuration
};
WhitenedSummary summarised(const WhitenedSystem& system);

struct ResidualOptions {
  Priors priors;
  NoiseModel noise;
  std::vector<double> row_weights;  ///< factor on the information of each observation, 0 leaves it out; empty: all 1
  /// [m] where orientations have no sigma: an error of one radian counts as much as this error of position.
  double orientation_length = 0.3;
};

/// The residuals of a set of measurements and their linearisation. Only observations with Split::train take part.
/// Repeats of a configuration are gathered into one block of information, exactly: the cost changes by a constant.
class LeastSquaresProblem {
public:
  LeastSquaresProblem(const ErrorModel& model, const Measurements& measurements, const Unknowns& unknowns,
                      const ResidualOptions& options = {});
  ~LeastSquaresProblem();

  /// One pass over the data at an estimate.
  NormalEquations linearise(const Estimate& estimate) const;
  /// The same into equations that are used again and again. Not for several threads at once: the problem owns the
  /// workspace.
  void linearise(const Estimate& estimate, NormalEquations& equations) const;
  /// The cost alone. Not for several threads at once.
  double cost(const Estimate& estimate) const;
  WhitenedSystem whitened(const Estimate& estimate) const;
  /// As summarised(whitened(estimate)), in constant memory. Above kManyConfigurations configurations that are alike the
  /// triangle is the Cholesky factor of the information where its condition allows that. Not for several threads at
  /// once.
  WhitenedSummary whitened_summary(const Estimate& estimate) const;
  static constexpr std::size_t kManyConfigurations = 3000;

  const ErrorModel& model() const { return model_; }
  const Unknowns& unknowns() const { return unknowns_; }
  Eigen::Index columns() const { return columns_; }
  long equations() const { return equations_; }                ///< measured coordinates, repeats counted each
  long points() const { return points_measured_; }             ///< measured points, repeats counted each
  double cost_of_repeats() const { return cost_of_repeats_; }  ///< the part of the cost that no estimate changes
  /// Sum over the points of 1 / mean variance of a coordinate, all parts of the noise together.
  double total_weight() const { return total_weight_; }

private:
  struct Point {
    std::size_t target = 0;
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    double weight = 0.0;  // where the block of information is diagonal and isotropic
    double orientation_weight = 0.0;
    Eigen::Matrix3d orientation = Eigen::Matrix3d::Identity();
  };
  struct Configuration {
    Eigen::Index column = 0;  // of the joint values
    std::size_t first_point = 0;
    std::size_t end_point = 0;
    std::size_t information = 0;  // index into informations_, where there are any
  };
  struct Block;
  struct Group;      // configurations in which the same points were measured with the same isotropic weights
  struct Workspace;  // of the pass over the groups

  bool gather_groups(const Measurements& measurements, const ResidualOptions& options);
  void prepare(const Estimate& estimate) const;
  void sum_group(const Group& group, const Estimate& estimate, bool cost_only, NormalEquations& equations) const;
  bool summarise_groups(const Estimate& estimate, WhitenedSummary& summary) const;
  void add_sums(const Group& group, const Estimate& estimate, WhitenedSummary& summary) const;
  void linearise(const Estimate& estimate, bool cost_only, NormalEquations& equations) const;
  void sum_blocks(const Estimate& estimate, bool cost_only, NormalEquations& equations) const;
  void whiten(const Block& block, Eigen::MatrixXd& rows) const;
  void gather(const Measurements& measurements, const ResidualOptions& options);
  void gather_isotropic(const Measurements& measurements, const ResidualOptions& options);
  void gather_blocks(const Measurements& measurements, const ResidualOptions& options);
  void add_orientation(const Measurements& measurements, std::size_t row, double weight, Point& point);
  template <class Visitor>
  void visit(const Estimate& estimate, Visitor visitor) const;
  template <class Visitor>
  void visit_priors(Visitor visitor) const;
  void add_priors(const Estimate& estimate, NormalEquations& equations) const;

  const ErrorModel& model_;
  Unknowns unknowns_;
  std::vector<Group> groups_;
  std::unique_ptr<Workspace> workspace_;
  Eigen::MatrixXd joint_values_;
  Eigen::MatrixXd deflection_basis_;
  std::vector<Configuration> configurations_;
  std::vector<Eigen::MatrixXd> informations_;  // 3 points x 3 points in W each; none where the points' weights say all
  std::vector<Point> points_;
  Eigen::VectorXd prior_information_;  // per column
  Eigen::Index chain_columns_ = 0;
  Eigen::Index columns_ = 0;
  long equations_ = 0;
  long points_measured_ = 0;
  double total_weight_ = 0.0;
  double cost_of_repeats_ = 0.0;
};

/// Twists of the free chain columns (base, geometric, deflections) at an estimate; those of the deflections are per
/// unit of the joint's motion and still lack the factor basis(q).
std::vector<ParameterTwist> chain_twists(const ErrorModel& model, const Estimate& estimate, const Unknowns& unknowns);

/// X_BF for each column of `joint_values`, joint deflections included.
std::vector<Eigen::Isometry3d> flange_poses(const ErrorModel& model, const Estimate& estimate,
                                            const Eigen::MatrixXd& joint_values);

/// Jacobians of the predicted positions at one estimate. Keeps references to its arguments.
class PositionPredictor {
public:
  PositionPredictor(const ErrorModel& model, const Estimate& estimate, const Unknowns& unknowns);

  /// Of the position in W of every target at joint values q: 3 x columns each, [m] per unit.
  std::vector<Matrix3Xd> jacobians(const Eigen::VectorXd& q) const;

private:
  const ErrorModel& model_;
  const Estimate& estimate_;
  const Unknowns& unknowns_;
  FoldedChain chain_;
  std::vector<ParameterTwist> twists_;
};

}  // namespace kdl_calibration
