#include "noise/pseudo_values.hpp"

#include <cmath>

#include "estimation/prediction.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "measurements/training_rows.hpp"

namespace kdl_calibration {
namespace {

constexpr double kUncountedWeight = 1e-6;

// A third of the divergence of w(r) r in three dimensions, w + r w' / 3, where the loss gives the weight w.
double slope(Loss loss, double w) {
  switch (loss) {
    case Loss::none:
      break;
    case Loss::huber:  // w = k / r
      return w < 1.0 ? 2.0 / 3.0 * w : 1.0;
    case Loss::tukey: {  // w = t^2, t = 1 - (r / k)^2
      const double t = std::sqrt(w);
      return t * t - 4.0 / 3.0 * t * (1.0 - t);
    }
  }
  return 1.0;
}

}  // namespace

PseudoValues pseudo_values(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                           Loss loss, const std::vector<double>& weights) {
  const TrainingRows training(measurements);
  const std::vector<double> of_training = training.values_of(weights);
  PseudoValues result{.measurements = *training, .row_weights = {}};
  double sum = 0.0;
  for (const double weight : of_training) {
    const bool counts = weight > kUncountedWeight;
    sum += counts ? slope(loss, weight) : 0.0;
    result.rows += counts ? 1.0 : 0.0;
    result.row_weights.push_back(counts ? 1.0 : kUncountedWeight);
  }
  const double B = result.rows > 0.0 ? sum / result.rows : 1.0;
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, *training);
  for (std::size_t row = 0; row < of_training.size(); ++row) {
    Observation& o = result.measurements.observations[row];
    const Eigen::Vector3d predicted = predicted_point(estimate, X_BF, o);
    o.position() = predicted + of_training[row] / B * (o.position() - predicted);
  }
  return result;
}

}  // namespace kdl_calibration
