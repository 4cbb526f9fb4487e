#pragma once

// The fitted rows of a set of measurements, gathered configuration by configuration.

#include <Eigen/Dense>
#include <cstdint>
#include <memory>
#include <vector>

#include "estimation/residual_options.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// A target in one configuration: the mean of its repeats and its information.
struct ObservedPoint {
  std::size_t target = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();     // in W [m]; with a distance the anchor
  double weight = 0.0;                                    // information of each coordinate, for isotropic noise
  double distance = 0.0;                                  // [m] with information `weight`; 0: not measured
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();  // of single coordinates, in W
  Eigen::Matrix3d directions = Eigen::Matrix3d::Zero();   // the projector onto those that it determines
  double orientation_weight = 0.0;                        // 0: orientation not measured
  Eigen::Matrix3d orientation = Eigen::Matrix3d::Identity();
};

struct ObservedConfiguration {
  Eigen::Index column = 0;            // of the joint values
  std::vector<ObservedPoint> points;  // ascending by target
  /// 3 · points x 3 · points in W; null if the points' weights suffice. Shared by equal consecutive configurations.
  std::shared_ptr<const Eigen::MatrixXd> information;
  bool by_point = false;  // single coordinates or distances: each point has its own information, which is singular
};

/// Figures of the measurements independent of the estimate.
struct ObservedTotals {
  long equations = 0;            // measured coordinates, including repeats
  long points = 0;               // measured points, including repeats
  double weight = 0.0;           // sum of the mean information of a coordinate over the points
  double cost_of_repeats = 0.0;  // the cost minus that of the means
};

/// Combines repeats to means. Only this class reads the split, weight and repeat of rows. Exact: using means and their
/// information changes the cost by a constant.
class Gathering {
public:
  /// Keeps references to its arguments.
  Gathering(const Measurements& measurements, const ResidualOptions& options);

  /// The next configuration with fitted rows, in ascending order, valid until the next call; nullptr after the last
  /// one. Throws InputError if the independent noise is negligible beside the common part.
  const ObservedConfiguration* next();
  /// Totals of all configurations so far.
  const ObservedTotals& totals() const { return totals_; }

private:
  struct PatternRow {
    std::int32_t repeat = 0;  // index within the configuration
    std::int32_t target = 0;
    double sigma = 0.0;
    float factor = 1.0F;
    double weight = 1.0;
    bool operator==(const PatternRow&) const = default;
  };
  struct Repeat {
    std::size_t begin = 0;  // first of its rows
    std::size_t end = 0;
    std::vector<Eigen::Index> coordinates;  // of its points, among the coordinates of all targets
    Eigen::MatrixXd inverse;                // inverse of its covariance
  };
  /// Structure and information of a configuration, shared by all equal ones.
  struct Pattern {
    std::vector<PatternRow> rows;
    std::vector<Repeat> repeats;
    std::vector<Eigen::Index> coordinates;  // of all points
  };

  std::size_t row_at(std::size_t i) const { return order_.empty() ? i : order_[i]; }
  bool is_fitted(std::size_t row) const;
  void add_row(std::size_t row);
  void add_coordinates(std::size_t row);
  void add_repeats();
  void sort_by_repeat();
  PatternRow pattern_row(std::size_t i, const PatternRow& before) const;
  bool is_like_the_last() const;
  void describe_repeats();
  void add_orientation(std::size_t row, double position_information, ObservedPoint& point);
  void take_means();
  void take_seen_points();
  const Eigen::MatrixXd& inverse_of(const Eigen::MatrixXd& covariance);

  const Measurements& measurements_;
  const ResidualOptions& options_;
  const bool isotropic_;
  std::vector<std::uint32_t> order_;  // rows sorted by configuration; empty if already sorted
  std::size_t next_ = 0;
  ObservedTotals totals_;
  ObservedConfiguration configuration_;
  std::vector<std::uint32_t> rows_;    // rows of the present configuration
  std::vector<ObservedPoint> points_;  // of the present configuration, by target
  std::vector<bool> seen_;             // targets seen in it
  bool single_coordinates_ = false;    // whether some row is no whole point
  // Covariances common to many repeats and configurations are factorised once.
  Pattern pattern_;  // of the previous configuration
  Eigen::MatrixXd covariance_;
  Eigen::MatrixXd inverse_;
  Eigen::MatrixXd of_repeats_;  // information of the means from the repeats only
  Eigen::LLT<Eigen::MatrixXd> root_;
  Eigen::VectorXd deviations_;  // of one repeat from the first repeat of its points
  Eigen::VectorXd pulls_;       // information of the repeat times `deviations_`
  Eigen::VectorXd weighted_;    // sum of `pulls_` over the repeats, for all targets
};

}  // namespace kdl_calibration
