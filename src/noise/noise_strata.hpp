#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "estimation/residual_options.hpp"
#include "noise/noise_parts.hpp"

namespace kdl_calibration {

/// A stratum: independent combinations of measured coordinates with the common variance
///   lambda = known + coefficients . variances,
/// and their sums over the Jacobian J: information J^T J, gradient J^T e and squares e^T e.
struct Stratum {
  bool predicted = false;  // by the model; else deviations independent of the parameters, without information
  Eigen::MatrixXd information;
  Eigen::VectorXd gradient;
  double squares = 0.0;
  double count = 0.0;
  NoiseParts::Variances coefficients = NoiseParts::Variances::Zero();
  double known = 0.0;
  std::size_t station = 0;  // if strata are by station
  double summed = 0.0;      // configurations summed in coefficients and known, until divided to means
  Eigen::MatrixXd pending;  // rows whose products are added together
  Eigen::VectorXd factors;  // of these rows
  Eigen::Index count_of_pending = 0;

  void add_row(const Eigen::RowVectorXd& row, double residual, double factor);
  /// Adds to the information the rows that are still pending. Call it after the last row.
  void complete();
  void add_pending();
  bool is_of_orientations() const { return coefficients[NoiseParts::kOrientation] != 0.0; }
  /// Factor on the variance of the instrument: on the stated one, which is known, else on the independent part.
  double of_instrument() const { return known > 0.0 ? known : coefficients.segment<3>(NoiseParts::kIndependent).sum(); }
  /// Whether it holds means of positions.
  bool is_of_means() const { return predicted && !is_of_orientations(); }
};

/// The rows of one target in one configuration.
struct MeasuredCell {
  std::int32_t target = 0;
  double weight = 0.0;  // sum of its rows' weights; the number of repeats if all weights are 1
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Vector3d known = Eigen::Vector3d::Zero();  // stated variances of the mean
  double orientations = 0.0;
  std::vector<std::size_t> rows;
};

/// Residual means of one configuration's targets.
struct Means {
  std::vector<Matrix3Xd> jacobians;
  std::vector<Eigen::Vector3d> residuals;  // [m] in W
  double inverse_weight = 0.0;             // mean over the targets
  Eigen::Vector3d known = Eigen::Vector3d::Zero();
};

/// Which of the unstated parts to estimate. `beside_instruments`: without those of each point and orientation.
enum class PartsAsked { all, without_misfits, of_repeats, beside_instruments };

/// Sums a set of training rows (their split is ignored) to strata. Rows count by their weight. Stated noise is a known
/// variance and is not estimated. The strata are by station if asked, or if the stations' noise differs. Of single
/// coordinates and distances all of a station are one stratum. Keeps references.
class NoiseStrata {
public:
  NoiseStrata(const Measurements& measurements, const ResidualOptions& options, bool by_station = false);

  /// Adds residuals of the means and their Jacobians at one estimate.
  void add_means(const ErrorModel& model, const Estimate& estimate, const Unknowns& free);

  std::vector<Stratum> finished() const;

  /// Whether the independent part is stated.
  bool stated() const { return stated_; }
  /// Degrees of freedom of the repeats per axis; 0 without repeats.
  double repeat_freedom() const { return repeat_freedom_; }
  /// Stated variance [m^2] of a point along the axes of W, mean over the rows.
  Eigen::Vector3d mean_known() const;
  /// Selection matrix with one column for each unknown variance. Parts that share a variance share a column.
  Eigen::MatrixXd unknown_parts(PartsAsked asked) const;

private:
  using Key = std::array<long, 4>;  // of kind, and the station

  double weight(std::size_t row) const { return options_.row_weight(row); }
  const Observation& first_row(const std::vector<MeasuredCell>& cells) const;
  /// Of these kinds, at the station of the cells.
  Stratum& stratum(std::map<Key, Stratum>& strata, std::array<long, 3> kinds, const Observation& row) const;
  void add_repeats(const std::vector<MeasuredCell>& cells);
  void add_means(const Means& means, const Observation& row);
  void add_coordinates(const WhitenedSystem& system);
  void add_orientations(const WhitenedSystem& system);

  const Measurements& measurements_;
  const ResidualOptions& options_;
  const bool stated_;
  const bool by_station_;
  std::map<std::int32_t, std::vector<MeasuredCell>> configurations_;
  std::map<Key, Stratum> means_;
  std::map<Key, Stratum> deviations_;
  std::map<Key, Stratum> repeats_;
  Eigen::Vector3d known_sum_ = Eigen::Vector3d::Zero();
  double known_rows_ = 0.0;
  double repeat_freedom_ = 0.0;
  bool several_targets_ = false;
  bool several_in_a_repeat_ = false;  // so that common and independent parts are separable
};

/// At most 2,000 configurations, evenly spaced.
struct NoiseSample {
  Measurements measurements;
  ResidualOptions options;
  double share = 1.0;  ///< share of all configurations
};
NoiseSample sampled(const Measurements& measurements, const ResidualOptions& options);

}  // namespace kdl_calibration
