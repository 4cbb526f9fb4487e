#pragma once

// Which single mistake explains the residuals of a fit: detection and identification of Baarda (1968) and Teunissen
// (Testing theory, 2000), beside geometric errors of ordinary size.
//
// At its end the fit is e = J x + noise, whitened. An alternative adds a few columns C beside J. With P the projector
// onto what J, and the ordinary sizes of x as further equations, do not explain,
//   g = (C^T P C)^-1 C^T P e   and   e^T P C g
// are its estimate and the squares that it explains.

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

namespace kdl_calibration {

/// Rows whose noise has one variance, which every alternative estimates anew: a moved base looks like a misfit that the
/// points of a configuration share.
enum class RowStratum : std::uint8_t {
  shared,       ///< means over the points of a configuration
  of_points,    ///< their deviations from it
  orientations  ///< measured ones
};
constexpr std::size_t kStrata = 3;
using OfStrata = Eigen::Array<double, static_cast<int>(kStrata), 1>;

struct LinearisedFit {
  Eigen::MatrixXd jacobian;                    ///< rows x columns, with equal noise within a stratum
  Eigen::VectorXd residual;                    ///< measured minus predicted
  std::vector<RowStratum> strata;              ///< of the rows
  OfStrata coordinates = OfStrata::Zero();     ///< measured ones of each: the rows' degrees of freedom
  OfStrata least_variance = OfStrata::Zero();  ///< below it residuals are rounding
  /// By the residuals and the degrees of freedom of the result that is doubted. They hold where ordinary errors leave
  /// too few degrees of freedom.
  OfStrata doubted_variance = OfStrata::Zero();
  /// Ordinary 1 sigma of each column, some metres or radians for frames of which nothing is known; 0 holds a column.
  Eigen::VectorXd sizes;
  std::vector<bool> is_error;    ///< whether the value of a column says how crude the arm is
  Eigen::VectorXd values;        ///< of the columns at present
  double weight = 1.0;           ///< sum of the information of a coordinate over the points [1/m^2]
  double doubted_squares = 0.0;  ///< of the positions' residuals of the result that is doubted
  Eigen::VectorXd offset;        ///< [m] of the predicted points from those of the result that is doubted
  Eigen::MatrixXd predicted;     ///< d(predicted points in the base) / d(columns): 3 points x columns [m per unit]
};

/// What the columns C = J B + C' add to the normal equations, by stratum. Any B will do: where J nearly spans C, as for
/// a factor on all lengths beside free lengths, products of C itself would lose what only the ordinary sizes of B tell.
struct AlternativeSums {
  Eigen::MatrixXd B = {};                      ///< columns x columns of C; empty: zero
  std::array<Eigen::MatrixXd, kStrata> cross;  ///< J^T C'
  std::array<Eigen::MatrixXd, kStrata> own;    ///< C'^T C'
  Eigen::MatrixXd size = {};                   ///< C^T C of positions, all strata together
  std::array<Eigen::VectorXd, kStrata> right;  ///< C'^T e
};

/// What moves if the alternative is right.
struct AlternativeMotion {
  /// Columns of J whose values the alternative changes, as combinations: columns x columns of C. Empty for a mistake in
  /// the measurement, which moves no robot.
  Eigen::MatrixXd of_robot = {};
  /// [m] of the predicted points, where the alternative moves the arm by itself: 3 points x columns of C. Else empty.
  Eigen::MatrixXd of_points = {};
  bool in_part = false;  ///< whether the robot has moved for only some of the rows: before and after are predicted
};

struct Explained {
  Eigen::VectorXd estimate;         ///< g, in the units of C
  Eigen::MatrixXd covariance = {};  ///< of g, with the noise that is left; 0 in directions that do not show
  double evidence = 0.0;            ///< logarithm of the likelihood ratio, less what the number of its columns costs
  double p_value = 1.0;             ///< of one trial, by an F test
  double share_left = 1.0;          ///< of `doubted_squares`
  double size = 0.0;                ///< [m] RMS of C g over the measured points
  double moves = 0.0;               ///< [m] RMS change of the predicted points
};

/// The smallest mistake that a test at some level would show with some power, in the direction of its columns that
/// shows least for its size at the measured points, and what it does if it stays hidden (Baarda 1968: minimal
/// detectable bias and external reliability).
struct Detectable {
  Eigen::VectorXd estimate;  ///< in the units of C
  double size = 0.0;         ///< [m] RMS of C g over the measured points
  double moves = 0.0;        ///< [m] RMS error of the predicted points
};

/// Tests alternatives beside one fit.
class Explanations {
public:
  /// Keeps a reference.
  explicit Explanations(const LinearisedFit& fit);

  /// The step of all columns to the most likely values without an alternative.
  Eigen::VectorXd ordinary_step() const;
  /// Of columns in all rows.
  AlternativeSums sums(const Eigen::MatrixXd& C) const;
  /// Of columns that are zero in all but some consecutive rows.
  AlternativeSums sums_of_rows(const Eigen::MatrixXd& C, Eigen::Index first) const;
  /// The evidence with the weights of the fit without alternatives, for a choice among many.
  double first_evidence(const AlternativeSums& sums) const;
  /// With weights that follow from the alternative itself: its residuals give the noise, its errors the size of the
  /// arm's.
  Explained explained(const AlternativeSums& sums, const AlternativeMotion& motion) const;
  /// By an F test at this level with this power, with the noise and the size of errors that the fit has without
  /// alternatives. None if no mistake shows.
  std::optional<Detectable> detectable(const AlternativeSums& sums, const AlternativeMotion& motion, double level,
                                       double power) const;

private:
  struct Weights {
    OfStrata variance = OfStrata::Ones();
    double size = 1.0;  // factor on the ordinary sizes of errors
  };
  struct Equations;
  struct Solution;
  AlternativeSums nothing() const;
  bool is_error(Eigen::Index free) const;
  Eigen::MatrixXd inverse_root(const OfStrata& variance, const Eigen::VectorXd& per_size) const;
  Equations equations(const Weights& weights) const;
  struct Gain;
  Gain gain(const AlternativeSums& sums, const Equations& equations) const;
  Solution solution(const AlternativeSums& sums, const Equations& equations) const;
  Equations with_freedom(const Weights& weights, const OfStrata& before) const;
  Equations weighed(const AlternativeSums& sums, Equations result) const;
  Weights fitted(const Solution& solution, const Equations& equations) const;
  double moved(const Eigen::VectorXd& before, const AlternativeMotion& motion, const Eigen::VectorXd& estimate) const;

  const LinearisedFit& fit_;
  std::vector<Eigen::Index> free_;                 // columns that are not held
  std::array<Eigen::MatrixXd, kStrata> root_;      // R of J
  std::array<Eigen::MatrixXd, kStrata> gram_;      // R^T R
  std::array<Eigen::VectorXd, kStrata> gradient_;  // J^T e
  OfStrata squares_ = OfStrata::Zero();
  std::shared_ptr<const Equations> without_;  // any alternative
};

}  // namespace kdl_calibration
