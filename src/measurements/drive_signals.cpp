#include "measurements/drive_signals.hpp"

#include <fmt/core.h>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;

const char* to_string(Circumstance circumstance) {
  return circumstance == Circumstance::temperature ? "temperature" : "payload";
}

CircumstanceRange range_of(const DriveSignals& signals, Circumstance circumstance, const std::vector<bool>& which) {
  CircumstanceRange range;
  double sum = 0.0;
  double count = 0.0;
  for (Index c = 0; c < signals.circumstances.cols(); ++c) {
    const double value = signals.circumstances(static_cast<Index>(circumstance), c);
    if (which[static_cast<std::size_t>(c)] && !std::isnan(value)) {
      range.lower = std::fmin(range.lower, value);
      range.upper = std::fmax(range.upper, value);
      sum += value;
      count += 1.0;
    }
  }
  range.mean = sum / count;  // NaN if none is known
  return range;
}

bool is_stated(const DriveSignals& signals, Circumstance circumstance) {
  const MatrixXd& stated = signals.circumstances;
  return stated.size() > 0 && !stated.row(static_cast<Index>(circumstance)).array().isNaN().all();
}

bool has_torques(const DriveSignals& signals, Index joint) {
  return signals.torques.size() > 0 && !signals.torques.row(joint).array().isNaN().all();
}

std::pair<double, double> possible_range(Circumstance circumstance) {
  return circumstance == Circumstance::temperature ? std::pair{-273.15, 1000.0} : std::pair{0.0, 1e5};
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
  const MatrixXd& around = signals.circumstances;
  if (around.size() > 0 && (around.rows() != kCircumstances || around.cols() != joint_values.cols())) {
    return size(around) + " circumstances" + what + ", expected 2 x " + std::to_string(joint_values.cols()) +
           ", temperature and payload of each configuration";
  }
  for (Index row = 0; row < around.rows(); ++row) {
    const auto [least, most] = possible_range(static_cast<Circumstance>(row));
    if ((around.row(row).array() < least).any() || (around.row(row).array() > most).any()) {
      return std::string("an impossible ") + to_string(static_cast<Circumstance>(row)) + what +
             fmt::format(", expected {} to {} and NaN where none is known", least, most);
    }
  }
  return {};
}

DriveSignals columns(const DriveSignals& signals, const std::vector<Index>& which) {
  const auto of = [&](const MatrixXd& matrix) {
    return matrix.size() == 0 ? MatrixXd() : MatrixXd(matrix(Eigen::all, which));
  };
  return {.approach = of(signals.approach), .torques = of(signals.torques), .circumstances = of(signals.circumstances)};
}

DriveSignals column(const DriveSignals& signals, Index which) {
  const auto of = [&](const MatrixXd& matrix) { return matrix.size() == 0 ? MatrixXd() : MatrixXd(matrix.col(which)); };
  return {.approach = of(signals.approach), .torques = of(signals.torques), .circumstances = of(signals.circumstances)};
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
  return {.approach = both(first.approach, second.approach),
          .torques = both(first.torques, second.torques),
          .circumstances = both(first.circumstances, second.circumstances)};
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
