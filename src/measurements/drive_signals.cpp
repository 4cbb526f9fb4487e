#include "kdl_calibration/drive_signals.hpp"

#include <cmath>
#include <limits>

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;

DriveSignals columns(const DriveSignals& signals, const std::vector<Index>& which) {
  const auto of = [&](const MatrixXd& matrix) {
    return matrix.size() == 0 ? MatrixXd() : MatrixXd(matrix(Eigen::all, which));
  };
  return {.approach = of(signals.approach), .torques = of(signals.torques)};
}

DriveSignals column(const DriveSignals& signals, Index which) { return columns(signals, {which}); }

DriveSignals side_by_side(const DriveSignals& first, const DriveSignals& second) {
  const auto both = [](const MatrixXd& left, const MatrixXd& right) {
    MatrixXd result;
    if (left.size() > 0 && right.size() > 0) {
      result.resize(left.rows(), left.cols() + right.cols());
      result << left, right;
    }
    return result;
  };
  return {.approach = both(first.approach, second.approach), .torques = both(first.torques, second.torques)};
}

MatrixXd directions_of_motion(const MatrixXd& stops) {
  constexpr double kLeastMotion = 1e-6;  // [rad or m]
  MatrixXd result = MatrixXd::Constant(stops.rows(), stops.cols(), std::numeric_limits<double>::quiet_NaN());
  for (Index c = 1; c < stops.cols(); ++c) {
    for (Index j = 0; j < stops.rows(); ++j) {
      const double motion = stops(j, c) - stops(j, c - 1);
      result(j, c) = std::abs(motion) > kLeastMotion ? std::copysign(1.0, motion) : result(j, c - 1);
    }
  }
  return result;
}

}  // namespace kdl_calibration
