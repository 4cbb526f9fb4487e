#include "estimation/joint_registration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "base/decompositions.hpp"
#include "estimation/point_registration.hpp"
#include "estimation/prediction.hpp"
#include "estimation/scaled_solver.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// X_WB from training rows that are all distances: the centre c in B of the sphere about each anchor a, with the targets
// as they are known or at the flange, |p - c|^2 = d^2 or 2 p c - |c|^2 = |p|^2 - d^2; then the motion from all c to a.
Isometry3d base_from_distances(const std::vector<Isometry3d>& X_BF, const Measurements& training,
                               const std::vector<TargetFrame>& targets) {
  std::map<std::array<double, 3>, std::vector<std::size_t>> of_anchor;
  for (std::size_t row = 0; row < training.observations.size(); ++row) {
    const Vector3d& a = training.observations[row].position();
    of_anchor[{a.x(), a.y(), a.z()}].push_back(row);
  }
  Eigen::Matrix3Xd in_base(3, of_anchor.size());
  Eigen::Matrix3Xd in_world(3, of_anchor.size());
  Index anchor = 0;
  for (const auto& [position, rows] : of_anchor) {
    MatrixXd A(rows.size(), 4);
    VectorXd b(rows.size());
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const Observation& o = training.observations[rows[i]];
      const Vector3d p = X_BF[static_cast<std::size_t>(o.configuration)] *
                         targets[static_cast<std::size_t>(o.target)].X_FT.translation();
      const auto k = static_cast<Index>(i);
      A.row(k) << 2.0 * p.transpose(), -1.0;
      b[k] = p.squaredNorm() - std::pow(std::get<Distance>(o.reading).length, 2);
    }
    in_base.col(anchor) = shortest_solution(A, b).head<3>();
    in_world.col(anchor++) = Vector3d(position[0], position[1], position[2]);
  }
  return rigid_motion(in_base, in_world);
}

}  // namespace

JointRegistration::JointRegistration(const std::vector<Isometry3d>& X_BF, const Measurements& training,
                                     const RegistrationOptions& options)
    : X_BF_(X_BF), training_(training), options_(options) {
  for (const std::string& station : training.stations) {
    is_known_.push_back(find_base(options.known.bases, station) != nullptr);
  }
  bases_ = is_known_.size();
  for (const std::string& target : training.targets) {
    is_known_.push_back(find_target(options.known.targets, target) != nullptr);
  }
}

double JointRegistration::fit(Frames& frames, int steps) const {
  constexpr double kLeastDamping = 1e-9;  // undetermined directions stay as they are
  constexpr double kSettled = 1e-13;      // of the squared length of a step
  double damping = kLeastDamping;
  ScaledSolver solver;
  NormalEquations equations = linearise(frames);
  for (int step = 0; step < steps && damping < 1e12; ++step) {
    solver.solve(equations.hessian, damping * equations.hessian.diagonal(), equations.gradient);
    const VectorXd& move = solver.solution();
    const Frames next = moved(frames, move);
    NormalEquations there = linearise(next);
    if (!(there.cost <= equations.cost * (1.0 + 1e-12))) {
      damping = std::max(10.0 * damping, 1e-6);
      continue;
    }
    frames = next;
    equations = std::move(there);
    damping = std::max(0.1 * damping, kLeastDamping);
    if (move.squaredNorm() < kSettled * kSettled) {
      break;
    }
  }
  return equations.cost;
}

void JointRegistration::place(Frames& frames) const {
  constexpr double kRidge = 1e-6;
  const NormalEquations equations = linearise(frames);
  std::vector<Index> columns;
  for (Index column = 0; column < equations.gradient.size(); ++column) {
    if (column % 6 < 3) {
      columns.push_back(column);
    }
  }
  MatrixXd information = equations.hessian(columns, columns);
  information.diagonal().array() += kRidge * information.trace();
  const VectorXd gradient = equations.gradient(columns);
  const VectorXd places = information.ldlt().solve(gradient);
  VectorXd step = VectorXd::Zero(equations.gradient.size());
  for (std::size_t i = 0; i < columns.size(); ++i) {
    step[columns[i]] = places[static_cast<Index>(i)];
  }
  frames = moved(frames, step);
}

int JointRegistration::count_undetermined_directions(const Frames& frames) const {
  constexpr double kNothing = 1e-10;
  const MatrixXd information = linearise(frames).hessian;
  const VectorXd scale = unit_scale_of_information(information);
  const VectorXd values = eigenvalues(scale.asDiagonal() * information * scale.asDiagonal());
  const auto determined = (values.array() > kNothing).count();
  Index unknowns = 0;
  for (std::size_t frame = 0; frame < is_known_.size(); ++frame) {
    unknowns += is_known_[frame] ? 0 : frame < bases_ ? 6 : 3;
  }
  return static_cast<int>(std::max<Index>(unknowns - determined, 0));
}

// Residual and Jacobian of a point or orientation, by its base and its target.
void JointRegistration::add(const Vector3d& residual, const Eigen::Matrix<double, 3, 12>& jacobian, double weight,
                            const std::array<Index, 2>& first, NormalEquations& equations) const {
  equations.cost += weight * residual.squaredNorm();
  const Eigen::Matrix<double, 12, 12> information = weight * jacobian.transpose() * jacobian;
  const Eigen::Matrix<double, 12, 1> gradient = weight * jacobian.transpose() * residual;
  for (Index a = 0; a < 2; ++a) {
    const Index row = first[static_cast<std::size_t>(a)];
    if (is_known_[static_cast<std::size_t>(row / 6)]) {
      continue;
    }
    equations.gradient.segment<6>(row) += gradient.segment<6>(6 * a);
    for (Index b = 0; b < 2; ++b) {
      const Index column = first[static_cast<std::size_t>(b)];
      if (!is_known_[static_cast<std::size_t>(column / 6)]) {
        equations.hessian.block<6, 6>(row, column) += information.block<6, 6>(6 * a, 6 * b);
      }
    }
  }
}

NormalEquations JointRegistration::linearise(const Frames& frames) const {
  const auto size = static_cast<Index>(6 * is_known_.size());
  NormalEquations equations{.hessian = MatrixXd::Zero(size, size), .gradient = VectorXd::Zero(size)};
  for (const Observation& o : training_.observations) {
    const auto target = static_cast<std::size_t>(o.target);
    const std::array<Index, 2> first = {static_cast<Index>(6 * station_of(o)),
                                        static_cast<Index>(6 * (bases_ + target))};
    const Isometry3d& X_WB = frames.base(station_of(o));
    const Isometry3d X_BT = X_BF_[static_cast<std::size_t>(o.configuration)] * frames.targets[target].X_FT;
    const Matrix3d R_WF = X_WB.linear() * X_BF_[static_cast<std::size_t>(o.configuration)].linear();
    const double weight = o.sigma > 0.0 ? 1.0 / (o.sigma * o.sigma) : 1.0;
    Eigen::Matrix<double, 3, 12> jacobian;
    jacobian << X_WB.linear(), -X_WB.linear() * skew(X_BT.translation()), R_WF, Matrix3d::Zero();
    Isometry3d X_WT = X_WB * X_BT;
    X_WT.translation() = X_WB * X_BT.translation();  // rounded as in predicted_point
    const Residual residual = kdl_calibration::residual(o.reading, X_WT);
    jacobian = residual.directions * Eigen::Matrix<double, 3, 12>(jacobian);
    add(residual.position, jacobian, weight, first, equations);
    if (!residual.rotation) {
      continue;
    }
    jacobian << Matrix3d::Zero(), X_BT.linear().transpose(), Matrix3d::Zero(), Matrix3d::Identity();
    add(*residual.rotation, jacobian, weight * options_.orientation_length * options_.orientation_length, first,
        equations);
  }
  return equations;
}

Frames JointRegistration::moved(const Frames& frames, const VectorXd& step) const {
  Frames result = frames;
  const auto stations = static_cast<Index>(bases_);
  for (Index frame = 0; frame < static_cast<Index>(is_known_.size()); ++frame) {
    const Vector3d linear = step.segment<3>(6 * frame);
    const Matrix3d turn = rotation_exp(step.segment<3>(6 * frame + 3));
    const bool is_base = frame < stations;
    Isometry3d& X = is_base ? result.base(static_cast<std::size_t>(frame))
                            : result.targets[static_cast<std::size_t>(frame - stations)].X_FT;
    X.translation() += is_base ? Vector3d(X.linear() * linear) : linear;
    X.linear() = X.linear() * turn;
  }
  return result;
}

Registration register_readings(const std::vector<Isometry3d>& X_BF, const Measurements& training,
                               const RegistrationOptions& options) {
  constexpr int kFewSteps = 10;
  const JointRegistration joint(X_BF, training, options);
  Frames start;
  for (const std::string& name : training.targets) {
    const TargetFrame* const known = find_target(options.known.targets, name);
    start.targets.push_back(known != nullptr ? *known : TargetFrame{.name = name});
  }
  Frames best = start;
  double least = std::numeric_limits<double>::infinity();
  std::vector<Isometry3d> bases;
  const bool distances = std::all_of(training.observations.begin(), training.observations.end(), is_distance);
  if (const Isometry3d* X_WB = find_base(options.known.bases, training.stations.front()); X_WB != nullptr) {
    bases.push_back(*X_WB);
  } else if (distances) {
    bases.push_back(base_from_distances(X_BF, training, start.targets));
  } else {
    for (const Matrix3d& R : cube_rotations()) {
      bases.emplace_back(R);
    }
  }
  for (const Isometry3d& X_WB : bases) {
    Frames tried = start;
    tried.base() = X_WB;
    if (!distances) {
      joint.place(tried);
    }
    const double cost = joint.fit(tried, kFewSteps);
    if (cost < least) {
      least = cost;
      best = tried;
    }
  }
  joint.fit(best);
  Registration result;
  result.frames = best;
  result.undetermined = joint.count_undetermined_directions(best);
  return result;
}

}  // namespace kdl_calibration
