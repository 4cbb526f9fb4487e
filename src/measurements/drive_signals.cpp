#include "measurements/drive_signals.hpp"

#include <fmt/core.h>
#include <cmath>
#include <limits>
#include <utility>

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;

bool has_torques(const DriveSignals& signals, Index joint) {
  return signals.torques.size() > 0 && !signals.torques.row(joint).array().isNaN().all();
}

std::string fault_of(const DriveSignals& signals, const MatrixXd& joint_values, const std::string& what) {
  const auto size = [](const MatrixXd& matrix) { return fmt::format("{} x {}", matrix.rows(), matrix.cols()); };
  for (const auto& [name, values] :
       {std::pair{"directions of approach", &signals.approach}, std::pair{"torques", &signals.torques}}) {
    if (values->size() == 0) {
      continue;
    }
    if (values->rows() != joint_values.rows() || values->cols() != joint_values.cols()) {
      return size(*values) + " " + name + what + ", expected " + size(joint_values) + ", one for each joint value";
    }
    if (values->array().isInf().any()) {
      return std::string(name) + what + " that are infinite, expected NaN where none is known";
    }
  }
  return {};
}

DriveSignals columns(const DriveSignals& signals, const std::vector<Index>& which) {
  const auto of = [&](const MatrixXd& matrix) {
    return matrix.size() == 0 ? MatrixXd() : MatrixXd(matrix(Eigen::all, which));
  };
  return {.approach = of(signals.approach), .torques = of(signals.torques)};
}

DriveSignals column(const DriveSignals& signals, Index which) {
  const auto of = [&](const MatrixXd& matrix) { return matrix.size() == 0 ? MatrixXd() : MatrixXd(matrix.col(which)); };
  return {.approach = of(signals.approach), .torques = of(signals.torques)};
}

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
