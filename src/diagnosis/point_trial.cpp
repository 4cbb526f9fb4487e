#include "diagnosis/point_trial.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "measurements/readings.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

const Eigen::Isometry3d& pose_of(const std::vector<Eigen::Isometry3d>& X_BF, const Observation& observation) {
  return X_BF[static_cast<std::size_t>(observation.configuration)];
}

Vector3d centroid(const Measurements& measurements) {
  Vector3d sum = Vector3d::Zero();
  for (const Observation& observation : measurements.observations) {
    sum += observation.position();
  }
  return sum / static_cast<double>(std::max<std::size_t>(measurements.observations.size(), 1));
}

// Adds a point to the normal equations H x = g of A (column by column), c and the targets.
void add_equations(const Eigen::Isometry3d& X_BF, const Vector3d& z, Index target, MatrixXd& H, VectorXd& g) {
  Eigen::Matrix<double, 3, 15> rows;
  for (Index axis = 0; axis < 3; ++axis) {
    rows.middleCols<3>(3 * axis) = z[axis] * Matrix3d::Identity();
  }
  rows.middleCols<3>(9) = -Matrix3d::Identity();
  rows.rightCols<3>() = -X_BF.linear();
  const Eigen::Matrix<double, 15, 15> block = rows.transpose() * rows;
  const Eigen::Matrix<double, 15, 1> right = rows.transpose() * X_BF.translation();
  const Index column = 12 + 3 * target;
  H.topLeftCorner<12, 12>() += block.topLeftCorner<12, 12>();
  H.block<12, 3>(0, column) += block.topRightCorner<12, 3>();
  H.block<3, 12>(column, 0) += block.bottomLeftCorner<3, 12>();
  H.block<3, 3>(column, column) += block.bottomRightCorner<3, 3>();
  g.head<12>() += right.head<12>();
  g.segment<3>(column) += right.tail<3>();
}

}  // namespace

Measurements mirrored(Measurements measurements) {
  for (Observation& observation : measurements.observations) {
    observation.position().x() = -observation.position().x();
  }
  return without_orientations(std::move(measurements));
}

std::optional<Measurements> with_poses_inverted(Measurements measurements) {
  if (!std::all_of(measurements.observations.begin(), measurements.observations.end(), has_orientation)) {
    return std::nullopt;
  }
  for (Observation& observation : measurements.observations) {
    observation.reading = Point{-(observation.orientation()->conjugate() * observation.position())};
  }
  return measurements;
}

Measurements divided(Measurements measurements, const Vector3d& factors) {
  for (Observation& observation : measurements.observations) {
    observation.position() = observation.position().cwiseQuotient(factors);
  }
  return measurements;
}

std::optional<Vector3d> coordinate_scales(const std::vector<Eigen::Isometry3d>& X_BF,
                                          const Measurements& measurements) {
  const Vector3d centre = centroid(measurements);
  Vector3d spread = Vector3d::Zero();
  for (const Observation& observation : measurements.observations) {
    spread += (observation.position() - centre).cwiseAbs2();
  }
  spread = (spread / static_cast<double>(std::max<std::size_t>(measurements.observations.size(), 1))).cwiseSqrt();
  if (!(spread.minCoeff() > 0.0)) {
    return std::nullopt;
  }
  const Index unknowns = 12 + 3 * static_cast<Index>(measurements.targets.size());
  MatrixXd H = MatrixXd::Zero(unknowns, unknowns);
  VectorXd g = VectorXd::Zero(unknowns);
  for (const Observation& observation : measurements.observations) {
    add_equations(pose_of(X_BF, observation), (observation.position() - centre).cwiseQuotient(spread),
                  observation.target, H, g);
  }
  H.diagonal().array() += 1e-12 * H.diagonal().maxCoeff();  // regularised for targets without rows and for a single
                                                            // configuration
  const VectorXd x = H.ldlt().solve(g);
  Vector3d scales;
  for (Index axis = 0; axis < 3; ++axis) {
    scales[axis] = spread[axis] / x.segment<3>(3 * axis).norm();
  }
  return scales.allFinite() && scales.minCoeff() > 0.0 ? std::optional(scales) : std::nullopt;
}

std::string units_of_factor(double factor) {
  constexpr double kSame = 0.03;
  struct Units {
    double factor;
    const char* words;
  };
  static constexpr std::array kUnits = {
      Units{1000.0, "millimetres read as metres"},         Units{100.0, "centimetres read as metres"},
      Units{1.0 / 0.0254, "inches read as metres"},        Units{1.0 / 0.3048, "feet read as metres"},
      Units{0.001, "metres read as millimetres"},          Units{0.1, "centimetres read as millimetres"},
      Units{0.001 / 0.0254, "inches read as millimetres"}, Units{0.001 / 0.3048, "feet read as millimetres"}};
  for (const Units& units : kUnits) {
    if (std::abs(factor / units.factor - 1.0) < kSame) {
      return units.words;
    }
  }
  return {};
}

double rounding_of(const Measurements& measurements) {
  constexpr double kExact = 1e-3;  // of the step
  for (const double step : {1e-4, 1e-5, 1e-6}) {
    const bool is_multiple = std::all_of(measurements.observations.begin(), measurements.observations.end(),
                                         [&](const Observation& observation) {
                                           const Eigen::Array3d steps = observation.position() / step;
                                           return ((steps - steps.round()).abs() < kExact).all();
                                         });
    if (is_multiple) {
      return step;
    }
  }
  return 0.0;
}

Motion motion(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements) {
  const std::size_t targets = measurements.targets.size();
  std::vector<double> counts(targets);
  std::vector<Vector3d> points(targets, Vector3d::Zero());
  std::vector<Vector3d> flanges(targets, Vector3d::Zero());
  for (const Observation& observation : measurements.observations) {
    const auto k = static_cast<std::size_t>(observation.target);
    counts[k] += 1.0;
    points[k] += observation.position();
    flanges[k] += pose_of(X_BF, observation).translation();
  }
  Motion sum;
  for (const Observation& observation : measurements.observations) {
    const auto k = static_cast<std::size_t>(observation.target);
    sum.points += (observation.position() - points[k] / counts[k]).squaredNorm();
    sum.flange += (pose_of(X_BF, observation).translation() - flanges[k] / counts[k]).squaredNorm();
  }
  const auto count = static_cast<double>(std::max<std::size_t>(measurements.observations.size(), 1));
  return {.points = std::sqrt(sum.points / count), .flange = std::sqrt(sum.flange / count)};
}

namespace {

constexpr int kFewestConfigurations = 12;

Measurements with_names_exchanged(Measurements measurements, int first, int second, int from) {
  for (Observation& observation : measurements.observations) {
    const bool either = observation.target == first || observation.target == second;
    if (either && observation.configuration >= from) {
      observation.target = observation.target == first ? second : first;
    }
  }
  return measurements;
}

// Per configuration: squared distances of two targets' points from their own predictions minus those from each other's.
// Positive if they are exchanged.
std::vector<double> nearer_to_each_other(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                         const Registration& registration, int first, int second) {
  std::vector<double> result(X_BF.size(), 0.0);
  const auto place = [&](const Eigen::Isometry3d& pose, int target) {
    return Vector3d(registration.frames.base() *
                    (pose * registration.frames.targets[static_cast<std::size_t>(target)].X_FT.translation()));
  };
  for (const Observation& observation : measurements.observations) {
    if (observation.target == first || observation.target == second) {
      const Eigen::Isometry3d& pose = pose_of(X_BF, observation);
      const int other = observation.target == first ? second : first;
      result[static_cast<std::size_t>(observation.configuration)] +=
          (observation.position() - place(pose, observation.target)).squaredNorm() -
          (observation.position() - place(pose, other)).squaredNorm();
    }
  }
  return result;
}

// The configuration at which `values` change from negative to positive (`behind`) or back; empty if either side is not
// clear.
std::optional<int> change_of_sign(const std::vector<double>& values, bool behind) {
  constexpr double kClear = 0.9;  // share of the configurations on either side
  const auto count = static_cast<int>(values.size());
  const auto exchanged = [&](int c) { return values[static_cast<std::size_t>(c)] > 0.0; };
  int right = 0;
  for (int c = 0; c < count; ++c) {
    right += exchanged(c) == behind ? 1 : 0;
  }
  int best = 0;
  int most = 0;
  for (int from = 0; from <= count; ++from) {  // exchanged from there on, or before it
    if (right > most) {
      most = right;
      best = from;
    }
    if (from < count) {
      right += exchanged(from) == behind ? -1 : 1;
    }
  }
  const bool both_sides = best >= 3 && best <= count - 3;
  return both_sides && most >= kClear * count ? std::optional(best) : std::nullopt;
}

}  // namespace

std::optional<Exchange> exchanged_targets(const std::vector<Eigen::Isometry3d>& X_BF, const Measurements& measurements,
                                          const RegistrationOptions& options) {
  const auto count = static_cast<int>(X_BF.size());
  const auto targets = static_cast<int>(measurements.targets.size());
  if (count < kFewestConfigurations || targets < 2) {
    return std::nullopt;
  }
  for (const bool from_front : {true, false}) {
    Measurements reference = without_order(without_orientations(measurements));
    std::erase_if(reference.observations, [&](const Observation& observation) {
      return from_front ? observation.configuration >= count / 3 : observation.configuration < count - count / 3;
    });
    const Registration registration = register_base_and_targets(X_BF, reference, options);
    for (int first = 0; first < targets; ++first) {
      for (int second = first + 1; second < targets; ++second) {
        const auto from =
            change_of_sign(nearer_to_each_other(X_BF, measurements, registration, first, second), from_front);
        if (from) {
          return Exchange{.first = first,
                          .second = second,
                          .from = *from,
                          .repaired = with_names_exchanged(measurements, first, second, *from)};
        }
      }
    }
  }
  return std::nullopt;
}

}  // namespace kdl_calibration
