#include "diagnosis/order_check.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "base/decompositions.hpp"
#include "base/distributions.hpp"
#include "effects/effect_terms.hpp"
#include "estimation/linear_system.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;

// The rows that were measured together, in the order of measurement.
std::vector<std::vector<std::size_t>> visits_of(const Measurements& measurements) {
  std::map<std::pair<int, int>, std::vector<std::size_t>> rows_of;
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Observation& observation = measurements.observations[row];
    rows_of[{observation.configuration, observation.repeat}].push_back(row);
  }
  std::vector<std::vector<std::size_t>> visits;
  visits.reserve(rows_of.size());
  for (auto& [key, rows] : rows_of) {
    visits.push_back(std::move(rows));
  }
  const auto when = [&](const std::vector<std::size_t>& rows) {
    return measurements.observations[rows.front()].order.value_or(static_cast<std::int64_t>(rows.front()));
  };
  std::stable_sort(visits.begin(), visits.end(), [&](const auto& a, const auto& b) { return when(a) < when(b); });
  return visits;
}

// Sums over visits of a linear least squares problem with six more columns that are zero before a visit.
struct OrderSums {
  explicit OrderSums(Index columns) : cross(MatrixXd::Zero(columns, 6)), own(Matrix6::Zero()), right(Vector6::Zero()) {}
  void add(const MatrixXd& jacobian, const Eigen::Matrix<double, 3, 6>& columns, const Vector3d& residual) {
    cross += jacobian.transpose() * columns;
    own += columns.transpose() * columns;
    right += columns.transpose() * residual;
  }
  MatrixXd cross;
  Matrix6 own;
  Vector6 right;
};

struct Gain {
  double squares = 0.0;
  double freedom = 0.0;
  Vector6 step = Vector6::Zero();
};

// Residuals and Jacobians of all rows, to which columns of steps are added.
class OrderedResiduals {
public:
  OrderedResiduals(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                   const Unknowns& free)
      : measurements_(measurements), visits_(visits_of(measurements)) {
    const PositionPredictor predictor(model, estimate, free);
    const Unknowns base_alone(model, estimate.frames.targets, base_parameter_names(model));
    const PositionPredictor of_base(model, estimate, base_alone);
    const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements);
    jacobians_.resize(X_BF.size());
    base_.resize(X_BF.size());
    for (std::size_t c = 0; c < X_BF.size(); ++c) {
      poses_.push_back(estimate.frames.base() * X_BF[c]);
      jacobians_[c] = predictor.jacobians(measurements, static_cast<Index>(c), 0);
      base_[c] = of_base.jacobians(measurements, static_cast<Index>(c), 0);
    }
    gather(estimate);
  }

  Index visits() const { return static_cast<Index>(visits_.size()); }
  double squares() const { return squares_; }
  double freedom() const { return freedom_; }
  double points() const { return points_; }
  // Degrees of freedom of the configurations' misfits (three each, shared by points and repeats), minus parameters
  // other than targets.
  double freedom_of_configurations(double targets) const {
    std::set<int> configurations;
    for (const std::vector<std::size_t>& visit : visits_) {
      configurations.insert(observation(visit.front()).configuration);
    }
    const double taken = std::max(3.0 * points_ - freedom_ - 3.0 * targets, 0.0);
    return std::min(3.0 * static_cast<double>(configurations.size()) - taken, freedom_);
  }
  int configuration(Index visit) const { return observation(rows(visit).front()).configuration; }
  const std::vector<std::size_t>& rows(Index visit) const { return visits_[static_cast<std::size_t>(visit)]; }
  const Observation& observation(std::size_t row) const { return measurements_.observations[row]; }
  Index columns() const { return columns_; }

  // Derivatives of a row's point by the base's six coordinates, or by one target's three.
  Eigen::Matrix<double, 3, 6> base_columns(std::size_t row) const {
    const Observation& o = observation(row);
    return base_[static_cast<std::size_t>(o.configuration)][static_cast<std::size_t>(o.target)];
  }
  Eigen::Matrix<double, 3, 6> target_columns(std::size_t row, int target) const {
    const Observation& o = observation(row);
    Eigen::Matrix<double, 3, 6> result = Eigen::Matrix<double, 3, 6>::Zero();
    if (o.target == target) {
      result.leftCols<3>() = poses_[static_cast<std::size_t>(o.configuration)].linear();
    }
    return result;
  }
  void add(std::size_t row, const Eigen::Matrix<double, 3, 6>& columns, OrderSums& sums) const {
    const Observation& o = observation(row);
    sums.add(jacobians_[static_cast<std::size_t>(o.configuration)][static_cast<std::size_t>(o.target)], columns,
             residuals_[row]);
  }

  // Decrease of the residual squares by columns with these sums, added to all others.
  Gain gain(const OrderSums& sums) const {
    constexpr double kNothing = 1e-6;  // relative to the columns' own norm
    const MatrixXd rooted = root_ * sums.cross;
    const Matrix6 own = sums.own - rooted.transpose() * rooted;
    const Vector6 right = sums.right - rooted.transpose() * root_right_;
    const Vector6 scale = unit_scale_of_information(sums.own);
    const auto [values, vectors] = spectrum(scale.asDiagonal() * own * scale.asDiagonal());
    Gain result;
    for (Index i = 0; i < 6; ++i) {
      if (values[i] > kNothing) {
        const Vector6 direction = scale.asDiagonal() * vectors.col(i);
        const double along = direction.dot(right);
        result.squares += along * along / values[i];
        result.step += along / values[i] * direction;
        result.freedom += 1.0;
      }
    }
    return result;
  }

private:
  void gather(const Estimate& estimate) {
    residuals_.resize(measurements_.observations.size(), Vector3d::Zero());
    columns_ = jacobians_.empty() || jacobians_.front().empty() ? 0 : jacobians_.front().front().cols();
    MatrixXd H = MatrixXd::Zero(columns_, columns_);
    VectorXd g = VectorXd::Zero(columns_);
    double sum = 0.0;
    for (const std::vector<std::size_t>& rows : visits_) {
      for (const std::size_t row : rows) {
        const Observation& o = observation(row);
        const auto c = static_cast<std::size_t>(o.configuration);
        const auto k = static_cast<std::size_t>(o.target);
        residuals_[row] = o.position() - poses_[c] * estimate.frames.targets[k].X_FT.translation();
        H.selfadjointView<Eigen::Lower>().rankUpdate(jacobians_[c][k].transpose());
        g += jacobians_[c][k].transpose() * residuals_[row];
        sum += residuals_[row].squaredNorm();
        points_ += 1.0;
      }
    }
    root_ = root_of_inverse(MatrixXd(H.selfadjointView<Eigen::Lower>()));
    root_right_ = root_ * g;
    squares_ = std::max(sum - root_right_.squaredNorm(), 0.0);
    freedom_ = 3.0 * points_ - static_cast<double>(root_.rows());
  }

  // root^T root is the pseudo-inverse of the information; rank x columns.
  static MatrixXd root_of_inverse(const MatrixXd& information) {
    if (information.size() == 0) {  // Eigen cannot decompose a matrix without columns
      return information;
    }
    const VectorXd scale = unit_scale_of_information(information);
    const auto [values, vectors] = spectrum(scale.asDiagonal() * information * scale.asDiagonal());
    constexpr double kDetermined = 1e-10;
    const Index rank = (values.array() > kDetermined).count();
    return values.tail(rank).cwiseSqrt().cwiseInverse().asDiagonal() * vectors.rightCols(rank).transpose() *
           scale.asDiagonal();
  }

  const Measurements& measurements_;
  std::vector<std::vector<std::size_t>> visits_;
  std::vector<Eigen::Isometry3d> poses_;           // X_WF
  std::vector<std::vector<Matrix3Xd>> jacobians_;  // by configuration and target
  std::vector<std::vector<Matrix3Xd>> base_;
  std::vector<Vector3d> residuals_;
  MatrixXd root_;        // root_^T root_ is the inverse of J^T J
  VectorXd root_right_;  // root_ J^T e
  Index columns_ = 0;
  double squares_ = 0.0;
  double freedom_ = 0.0;
  double points_ = 0.0;
};

constexpr double kFalseAlarm = 1e-5;

// p-value of the gain if there is only a misfit shared by all points of a configuration.
double chance(const OrderedResiduals& residuals, double freedom, const Gain& gain) {
  const double rest = freedom - gain.freedom;
  const double left = std::max(residuals.squares() - gain.squares, 1e-12 * residuals.squares());
  constexpr double kFewest = 5.0;  // degrees of freedom of the rest
  if (rest < kFewest || !(gain.freedom > 0.0) || !(left > 0.0)) {
    return 1.0;
  }
  return f_upper_tail(gain.squares / gain.freedom / left * rest, gain.freedom, rest);
}

struct Candidate {
  OrderFinding finding;
  Gain gain;
  double chance = 1.0;
};

// A hypothesis: a drift of the base, or a step of the base or of a target before a visit.
struct Trial {
  OrderFinding::Kind kind = OrderFinding::Kind::drift_of_base;
  int target = -1;
  Index visit = 0;
};

void keep_better(const OrderedResiduals& residuals, double freedom, const Trial& trial, const Gain& gain,
                 Candidate& best) {
  // If both p-values underflow, the larger gain decides.
  const double p = chance(residuals, freedom, gain);
  if (p < best.chance || (p == best.chance && gain.squares > best.gain.squares)) {
    best.chance = p;
    best.gain = gain;
    best.finding.kind = trial.kind;
    best.finding.target = trial.target;
    best.finding.last_before = trial.visit > 0 ? residuals.configuration(trial.visit - 1) : -1;
  }
}

// Sums over measured points, for their covariance.
struct Spread {
  double count = 0.0;
  Vector3d sum = Vector3d::Zero();
  Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();

  void add(const Vector3d& p, double sign = 1.0) {
    count += sign;
    sum += sign * p;
    squares += sign * p * p.transpose();
  }
  // [m] 1 sigma across the best line through the points. Zero for points at one place or on a line: they do not
  // determine a pose of the base.
  double beside_line() const {
    const Eigen::Matrix3d covariance = squares / count - sum * sum.transpose() / (count * count);
    return std::sqrt(std::max(eigenvalues(covariance)[1], 0.0));
  }
};

// For each visit, whether the points before it and the points from it on both determine a pose of the base.
std::vector<bool> both_parts_tell_a_base(const OrderedResiduals& residuals) {
  constexpr double kShare = 0.05;  // relative to the spread of all points
  const Vector3d origin = residuals.observation(residuals.rows(0).front()).position();
  Spread all;
  for (Index visit = 0; visit < residuals.visits(); ++visit) {
    for (const std::size_t row : residuals.rows(visit)) {
      all.add(residuals.observation(row).position() - origin);
    }
  }
  const double least = kShare * all.beside_line();
  Spread before;
  Spread behind = all;
  std::vector<bool> result;
  for (Index visit = 0; visit < residuals.visits(); ++visit) {
    result.push_back(visit > 0 && before.beside_line() > least && behind.beside_line() > least);
    for (const std::size_t row : residuals.rows(visit)) {
      before.add(residuals.observation(row).position() - origin);
      behind.add(residuals.observation(row).position() - origin, -1.0);
    }
  }
  return result;
}

// RMS motion [m] of the points after the step, or of all at the end of a drift.
double moved_points(const OrderedResiduals& residuals, const Candidate& found) {
  double sum = 0.0;
  double count = 0.0;
  for (Index visit = 0; visit < residuals.visits(); ++visit) {
    for (const std::size_t row : residuals.rows(visit)) {
      const bool target = found.finding.kind == OrderFinding::Kind::step_of_target;
      const auto columns = target ? residuals.target_columns(row, found.finding.target) : residuals.base_columns(row);
      sum += (columns * found.gain.step).squaredNorm();
      count += target && residuals.observation(row).target != found.finding.target ? 0.0 : 1.0;
    }
  }
  return count > 0.0 ? std::sqrt(sum / count) : 0.0;
}

Candidate best_candidate(const OrderedResiduals& residuals, int targets) {
  constexpr Index kFewest = 2;  // visits on either side of a step
  Candidate best;
  std::vector<OrderSums> of_target(static_cast<std::size_t>(targets), OrderSums(residuals.columns()));
  OrderSums of_base(residuals.columns());
  OrderSums drift(residuals.columns());
  const Index visits = residuals.visits();
  const double freedom = residuals.freedom_of_configurations(targets);
  const std::vector<bool> tells_bases = both_parts_tell_a_base(residuals);
  double most_of_one = 0.0;  // largest decrease of the squares by leaving out one visit
  for (Index visit = visits - 1; visit > 0; --visit) {
    const double time = static_cast<double>(visit) / static_cast<double>(visits - 1);
    OrderSums alone(residuals.columns());
    for (const std::size_t row : residuals.rows(visit)) {
      const Eigen::Matrix<double, 3, 6> columns = residuals.base_columns(row);
      residuals.add(row, columns, of_base);
      residuals.add(row, time * columns, drift);
      const int target = residuals.observation(row).target;
      residuals.add(row, residuals.target_columns(row, target), of_target[static_cast<std::size_t>(target)]);
      residuals.add(row, columns, alone);
    }
    most_of_one = std::max(most_of_one, residuals.gain(alone).squares);
    if (visit < kFewest || visits - visit < kFewest) {
      continue;
    }
    if (tells_bases[static_cast<std::size_t>(visit)]) {
      keep_better(residuals, freedom, {.kind = OrderFinding::Kind::step_of_base, .visit = visit},
                  residuals.gain(of_base), best);
    }
    for (int target = 0; target < targets; ++target) {
      keep_better(residuals, freedom, {OrderFinding::Kind::step_of_target, target, visit},
                  residuals.gain(of_target[static_cast<std::size_t>(target)]), best);
    }
  }
  keep_better(residuals, freedom, {}, residuals.gain(drift), best);
  return best.gain.squares > most_of_one ? best : Candidate();
}

// Model and estimate with effects of gravity and gains, all free, if the data leave enough freedom.
struct ModelWithEffects {
  ErrorModel model;
  Estimate estimate;
  Unknowns free;
};

ModelWithEffects with_free_effects(const ErrorModel& model, const Measurements& measurements, const Estimate& estimate,
                                   const Unknowns& free) {
  ModelWithEffects result{.model = model, .estimate = estimate, .free = free};
  if (result.model.effects.empty()) {
    result.model.effects = load_and_gain_terms(model);
    result.estimate.effects = VectorXd::Zero(static_cast<Index>(result.model.effects.size()));
  } else if (estimate.effects.size() == 0) {
    result.estimate.effects = VectorXd::Zero(static_cast<Index>(result.model.effects.size()));
  }
  result.free = free.with_group(result.model, UnknownGroup::effects);
  constexpr double kRest = 1.5;  // least number of equations per column
  const auto cells =
      static_cast<double>(measurements.joint_values.cols()) * static_cast<double>(measurements.targets.size());
  if (3.0 * cells < kRest * static_cast<double>(result.free.size())) {
    result.free = free;
  }
  return result;
}

}  // namespace

namespace {

std::optional<OrderFinding> best_finding(const ErrorModel& model, const Measurements& measurements,
                                         const Estimate& estimate, const Unknowns& free, double least_share) {
  const OrderedResiduals residuals(model, measurements, estimate, free);
  const auto targets = static_cast<int>(measurements.targets.size());
  if (residuals.visits() < 5 || !(residuals.freedom() > 0.0) || !(residuals.squares() > 0.0)) {
    return std::nullopt;
  }
  Candidate best = best_candidate(residuals, targets);
  best.finding.share = best.gain.squares / residuals.squares();
  const double places = static_cast<double>(residuals.visits()) * (1.0 + targets);
  if (best.chance * places > kFalseAlarm || best.finding.share < least_share) {
    return std::nullopt;
  }
  best.finding.translation = best.gain.step.head<3>();
  best.finding.rotation = best.gain.step.tail<3>();
  best.finding.moved = moved_points(residuals, best);
  best.finding.left = std::sqrt(std::max(residuals.squares() - best.gain.squares, 0.0) / residuals.points());
  return best.finding;
}

}  // namespace

std::optional<OrderFinding> check_order(const ErrorModel& model, const Measurements& measurements,
                                        const Estimate& estimate, const Unknowns& free) {
  constexpr double kLeastShare = 0.4;
  constexpr double kLeastShareToLook = 0.25;  // of that share, without effects in the model
  if (!best_finding(model, measurements, estimate, free, kLeastShareToLook * kLeastShare)) {
    return std::nullopt;
  }
  const ModelWithEffects wide = with_free_effects(model, measurements, estimate, free);
  return best_finding(wide.model, measurements, wide.estimate, wide.free, kLeastShare);
}

}  // namespace kdl_calibration
