#pragma once

// The fitted rows of a set of measurements, gathered configuration by configuration. Not installed.

#include <Eigen/Dense>
#include <cstdint>
#include <memory>
#include <vector>

#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// A target in one configuration: the mean of its repeats and what that is worth.
struct ObservedPoint {
  std::size_t target = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // in W [m]
  double weight = 0.0;                                 // information of each coordinate, where the noise is isotropic
  double orientation_weight = 0.0;                     // 0: a point alone
  Eigen::Matrix3d orientation = Eigen::Matrix3d::Identity();
};

struct ObservedConfiguration {
  Eigen::Index column = 0;            // of the joint values
  std::vector<ObservedPoint> points;  // ascending by target
  /// 3 points x 3 points in W; none where the points' weights say all. Neighbours that are alike share it.
  std::shared_ptr<const Eigen::MatrixXd> information;
};

/// What of the measurements does not depend on the estimate.
struct ObservedTotals {
  long equations = 0;            // measured coordinates, repeats counted each
  long points = 0;               // repeats counted each
  double weight = 0.0;           // sum over the points of a coordinate's mean information
  double cost_of_repeats = 0.0;  // the part of the cost that the means leave out
};

/// The only place that looks at the split, the weight and the repeats of rows. Exact: with the means and their
/// information instead of the rows the cost changes by a constant.
class Gathering {
public:
  /// Keeps references to both.
  Gathering(const Measurements& measurements, const ResidualOptions& options);

  /// The next configuration that has fitted rows, in ascending order, until the next call; nullptr behind the last one.
  /// Throws InputError where the noise of single points is lost beside what they share.
  const ObservedConfiguration* next();
  /// Of all so far.
  const ObservedTotals& totals() const { return totals_; }

private:
  struct PatternRow {
    std::int32_t repeat = 0;  // counted within the configuration
    std::int32_t target = 0;
    double sigma = 0.0;
    double weight = 1.0;
    bool operator==(const PatternRow&) const = default;
  };
  struct Repeat {
    std::size_t begin = 0;  // of its rows
    std::size_t end = 0;
    std::vector<Eigen::Index> coordinates;  // of its points among those of all targets
    Eigen::MatrixXd inverse;                // of its covariance
  };
  /// What was measured in a configuration and what that is worth: the same for all that are alike.
  struct Pattern {
    std::vector<PatternRow> rows;
    std::vector<Repeat> repeats;
    std::vector<Eigen::Index> coordinates;  // of all points
  };

  std::size_t row_at(std::size_t i) const { return order_.empty() ? i : order_[i]; }
  bool is_fitted(std::size_t row) const;
  void add_row(std::size_t row);
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
  std::vector<std::uint32_t> order_;  // of the rows by configuration; empty where they are in order
  std::size_t next_ = 0;
  ObservedTotals totals_;
  ObservedConfiguration configuration_;
  std::vector<std::uint32_t> rows_;    // of the configuration
  std::vector<ObservedPoint> points_;  // of the configuration, by target
  std::vector<bool> seen_;             // which of them there are
  // What many repeats and configurations have in common is factorised and stored once.
  Pattern pattern_;  // of the last configuration
  Eigen::MatrixXd covariance_;
  Eigen::MatrixXd inverse_;
  Eigen::MatrixXd of_repeats_;  // information of the means by the repeats alone
  Eigen::LLT<Eigen::MatrixXd> root_;
  Eigen::VectorXd deviations_;  // of one repeat, from where its points were seen first
  Eigen::VectorXd pulls_;       // the same times its information
  Eigen::VectorXd weighted_;    // sum of these over the repeats, of all targets
};

}  // namespace kdl_calibration
