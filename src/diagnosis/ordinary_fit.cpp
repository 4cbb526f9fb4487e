#include "diagnosis/ordinary_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/name_pattern.hpp"
#include "base/random.hpp"
#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/descent.hpp"
#include "estimation/least_squares.hpp"
#include "estimation/prediction.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/kept_axes.hpp"
#include "model/parameters.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// Ordinary sizes, 1 sigma.
constexpr double kOrdinaryOffset = 2e-3;  // [rad or m] of a joint's zero
constexpr double kAnywhere = 10.0;        // [m or rad] of a frame of which nothing is known

// The model with all effects that a joint ordinarily has, beside those of the fit or instead of them.
ErrorModel with_usual_effects(ErrorModel model, bool beside_effects) {
  if (!beside_effects) {
    model.effects.clear();
  }
  for (EffectTerm& term : load_and_gain_terms(model)) {
    const auto is_same = [&](const EffectTerm& other) { return other.name == term.name; };
    if (std::none_of(model.effects.begin(), model.effects.end(), is_same)) {
      model.effects.push_back(std::move(term));
    }
  }
  return model;
}

double ordinary_size(const ErrorModel& model, const ErrorParameter& parameter) {
  return parameter.kind == ParameterKind::joint_offset ? kOrdinaryOffset
         : is_length(model, parameter)                 ? kOrdinaryErrors.length
                                                       : kOrdinaryErrors.angle;
}

constexpr std::size_t kMostSampled = 3000;  // configurations

}  // namespace

OrdinaryFit::OrdinaryFit(const FitToDoubt& fit)
    : fit_(fit),
      rows_(training_sample(fit.measurements, kMostSampled)),
      model_(with_usual_effects(with_free_axes(fit.model, fit.estimate.errors).model, fit.beside_effects)),
      estimate_(fit.estimate),
      wide_(Unknowns(model_, fit.estimate.frames.targets, {})
                .with_group(model_, UnknownGroup::base)
                .with_group(model_, UnknownGroup::geometric)
                .with_group(model_, UnknownGroup::effects)
                .with_group(model_, UnknownGroup::targets)),
      stations_(stations_of_configurations(rows_)) {
  estimate_.errors = with_free_axes(fit.model, fit.estimate.errors).errors;
  const Index known = fit.beside_effects ? estimate_.effects.size() : 0;
  estimate_.effects.conservativeResize(std::ssize(model_.effects));
  estimate_.effects.tail(std::ssize(model_.effects) - known).setZero();
  options_.noise = fit.stated;
  double squares = 0.0;
  std::size_t next = 0;
  for (const Vector3d& residual : residuals_of(fit.model, fit.estimate, rows_)) {
    const double factor = rows_.observations[next++].noise.length;
    squares += residual.squaredNorm() / (factor * factor);
  }
  misfit_ = std::sqrt(squares / static_cast<double>(rows_.observations.size()));

  blocks_ = whitened(rows_, wide_).blocks;
  split_into_strata();
  set_sizes();
  const VectorXd doubted =
      turned(LeastSquaresProblem(fit.model, rows_, {}, options_).whitened(fit.estimate).residual.head(blocks_.back()));
  OfStrata squares_of = OfStrata::Zero();
  for (std::size_t row = 0; row < linear_.strata.size(); ++row) {
    const double residual = doubted[static_cast<Index>(row)];
    squares_of[static_cast<Index>(linear_.strata[row])] += residual * residual;
  }
  linear_.doubted_squares = squares_of[0] + squares_of[1];
  const double coordinates = linear_.coordinates.sum();
  const double left = std::max(coordinates - static_cast<double>(fit.unknowns), 1.0);
  linear_.doubted_variance = squares_of / linear_.coordinates.max(1.0) * (coordinates / left);
  linearise();
  // A result with few parameters may have larger errors than the arm: they are far from the ordinary ones.
  constexpr int kMostSteps = 5;
  constexpr double kNear = 0.2;  // of ordinary sizes
  const VectorXd sizes = linear_.sizes.cwiseMax(1e-300);
  for (int pass = 0; pass < kMostSteps; ++pass) {
    const VectorXd step = Explanations(linear_).ordinary_step();
    estimate_ = wide_.moved(Estimate(estimate_), step);
    linearise();
    if (step.cwiseQuotient(sizes).cwiseAbs().maxCoeff() < kNear) {
      break;
    }
  }
  predict();
}

WhitenedSystem OrdinaryFit::whitened(const Measurements& rows, const Unknowns& unknowns) const {
  return LeastSquaresProblem(model_, rows, unknowns, options_).whitened(estimate_);
}

void OrdinaryFit::linearise() {
  const WhitenedSystem system = whitened(rows_, wide_);
  linear_.jacobian = system.jacobian.topRows(blocks_.back());
  linear_.residual = turned(system.residual.head(blocks_.back()));
  turn(linear_.jacobian);
  linear_.values = wide_.values(estimate_);
  for (Index column = 0; column < wide_.size(); ++column) {
    const UnknownGroup group = wide_.columns()[static_cast<std::size_t>(column)].group;
    linear_.values[column] *= group == UnknownGroup::geometric || group == UnknownGroup::effects ? 1.0 : 0.0;
  }
}

// Ordinary lengths, and rounding, are those of an arm of ordinary size.
void OrdinaryFit::set_sizes() {
  constexpr double kRounding = 1e-7;  // [m]
  const double size = size_of_arm(model_);
  linear_.weight = LeastSquaresProblem(model_, rows_, {}, options_).total_weight();
  linear_.least_variance.setConstant(kRounding * size * kRounding * size * linear_.weight / points_);
  linear_.sizes = VectorXd(wide_.size());
  for (Index column = 0; column < wide_.size(); ++column) {
    const Unknown& unknown = wide_.columns()[static_cast<std::size_t>(column)];
    const bool error = unknown.group == UnknownGroup::geometric;
    linear_.is_error.push_back(error);
    linear_.sizes[column] = is_held(unknown)                         ? 0.0
                            : unknown.group == UnknownGroup::effects ? ordinary_size(model_.effects[unknown.index])
                            : error ? ordinary_size(model_, model_.parameters[unknown.index])
                                    : kAnywhere;
    linear_.sizes[column] *= unknown.length ? size : 1.0;
  }
}

// Whether W and the base are no single frame: predictions are then of the arm alone, along the axes of W.
bool OrdinaryFit::has_arm_alone() const { return model_.has_undetermined_bases || estimate_.frames.bases.size() > 1; }

// The points at all places, one after the other, in W.
VectorXd OrdinaryFit::points_of(const ErrorModel& model, const Estimate& estimate) const {
  const Eigen::Isometry3d X_WB = has_arm_alone() ? estimate_.frames.base() : estimate.frames.base();
  const std::vector<TargetFrame>& targets = estimate.frames.targets;
  VectorXd points(3 * std::ssize(targets) * places_.cols());
  Index row = 0;
  for (const Eigen::Isometry3d& X_BF : flange_poses(model, estimate, places_, signals_)) {
    for (const TargetFrame& target : targets) {
      points.segment<3>(row) = X_WB * X_BF * target.X_FT.translation();
      row += 3;
    }
  }
  return points;
}

// Predictions in the measured ranges. A torque is known only where it was measured.
void OrdinaryFit::predict() {
  constexpr int kPredicted = 200;
  Random random(1);
  const bool measured = needs_torques(fit_.model);
  const Measurements sample = training_sample(rows_, kPredicted);
  places_ =
      measured ? sample.joint_values : random_configurations(model_.joints, trained_ranges(rows_), kPredicted, random);
  signals_ = measured ? sample.signals : DriveSignals();
  const PositionPredictor predictor(model_, estimate_, wide_);
  linear_.offset = points_of(model_, estimate_) - points_of(fit_.model, fit_.estimate);
  linear_.predicted = MatrixXd(linear_.offset.size(), wide_.size());
  Index row = 0;
  for (Index place = 0; place < places_.cols(); ++place) {
    for (const auto& jacobian : predictor.jacobians(places_.col(place), column(signals_, place))) {
      linear_.predicted.middleRows<3>(row) = jacobian;
      row += 3;
    }
  }
}

// Which rows are means over the points of a configuration after turn(). Only configurations of several whole points
// are split; all rows of others have the variance of what their points share.
void OrdinaryFit::split_into_strata() {
  struct Of {
    double coordinates = 0.0;
    Index points = 0;
    Index orientations = 0;
    bool whole = true;
  };
  std::vector<Of> all(blocks_.size() - 1);
  for (const Observation& mean : averaged(rows_).observations) {
    Of& own = all[static_cast<std::size_t>(mean.configuration)];
    own.coordinates += dimension(mean.reading);
    own.points += 1;
    own.orientations += has_orientation(mean) ? 1 : 0;
    own.whole = own.whole && is_whole(mean);
    points_ += 1.0;
  }
  linear_.strata.assign(static_cast<std::size_t>(blocks_.back()), RowStratum::shared);
  const auto mark = [&](Index first, Index end, RowStratum stratum) {
    std::fill(linear_.strata.begin() + first, linear_.strata.begin() + end, stratum);
  };
  for (std::size_t c = 0; c < all.size(); ++c) {
    const Of& own = all[c];
    const bool split = own.whole && own.points > 1;
    const Index orientations = blocks_[c + 1] - 3 * own.orientations;
    split_.push_back(split ? own.points : 0);
    if (split) {
      mark(blocks_[c] + 3, orientations, RowStratum::of_points);
    }
    mark(orientations, blocks_[c + 1], RowStratum::orientations);
    linear_.coordinates[0] += split ? 3.0 : own.coordinates;
    linear_.coordinates[1] += split ? own.coordinates - 3.0 : 0.0;
    linear_.coordinates[2] += 3.0 * static_cast<double>(own.orientations);
  }
}

// In place, each configuration's points by an orthogonal transformation: their mean, and differences of each from
// the mean of those before (Helmert).
void OrdinaryFit::turn(MatrixXd& rows) const {
  for (std::size_t c = 0; c + 1 < blocks_.size(); ++c) {
    if (split_[c] == 0) {
      continue;
    }
    const Index m = split_[c];
    MatrixXd H = MatrixXd::Constant(m, m, 1.0 / std::sqrt(static_cast<double>(m)));
    for (Index i = 1; i < m; ++i) {
      const auto n = static_cast<double>(i);
      H.row(i).setZero();
      H.row(i).head(i).setConstant(1.0 / std::sqrt(n * (n + 1.0)));
      H(i, i) = -n / std::sqrt(n * (n + 1.0));
    }
    for (Index axis = 0; axis < 3; ++axis) {
      const auto own = Eigen::seqN(blocks_[c] + axis, m, 3);
      const MatrixXd along = rows(own, Eigen::all);
      rows(own, Eigen::all) = MatrixXd(H * along);
    }
  }
}

VectorXd OrdinaryFit::turned(const VectorXd& rows) const {
  MatrixXd result = rows;
  turn(result);
  return result;
}

bool OrdinaryFit::is_held(const Unknown& unknown) const {
  switch (unknown.group) {
    case UnknownGroup::base:
      return find_base(fit_.known.bases, model_.stations[unknown.index / 6]) != nullptr;
    case UnknownGroup::geometric:
      return std::any_of(fit_.fix.begin(), fit_.fix.end(),
                         [&](const std::string& pattern) { return matches_pattern(pattern, unknown.name); });
    case UnknownGroup::effects:
      return false;
    case UnknownGroup::targets:
      return find_target(fit_.known.targets, estimate_.frames.targets[unknown.index / 6].name) != nullptr;
  }
  return false;
}

MatrixXd OrdinaryFit::unit_columns(UnknownGroup group, const std::vector<std::size_t>& indices) const {
  MatrixXd result = MatrixXd::Zero(wide_.size(), std::ssize(indices));
  for (std::size_t i = 0; i < indices.size(); ++i) {
    result(*wide_.column(group, indices[i]), static_cast<Index>(i)) = 1.0;
  }
  return result;
}

MatrixXd OrdinaryFit::of_base(std::size_t station) const {
  const std::size_t first = 6 * station;
  return unit_columns(UnknownGroup::base, {first, first + 1, first + 2, first + 3, first + 4, first + 5});
}

MatrixXd OrdinaryFit::of_target(std::size_t k) const {
  return unit_columns(UnknownGroup::targets, {6 * k, 6 * k + 1, 6 * k + 2});
}

// A motion of all targets in the flange frame.
MatrixXd OrdinaryFit::of_tool() const {
  MatrixXd result = MatrixXd::Zero(wide_.size(), 6);
  for (std::size_t k = 0; k < estimate_.frames.targets.size(); ++k) {
    const MatrixXd own = of_target(k);
    const Vector3d t = estimate_.frames.targets[k].X_FT.translation();
    for (Index axis = 0; axis < 3; ++axis) {
      result.col(axis) += own.col(axis);
      result.col(3 + axis) += own * Vector3d::Unit(axis).cross(t);
    }
  }
  return result;
}

std::optional<MatrixXd> OrdinaryFit::of_zero(std::size_t joint) const {
  for (std::size_t p = 0; p < model_.parameters.size(); ++p) {
    if (model_.parameters[p].kind == ParameterKind::joint_offset &&
        model_.parameters[p].frame == static_cast<int>(joint)) {
      return unit_columns(UnknownGroup::geometric, {p});
    }
  }
  return std::nullopt;
}

std::vector<std::size_t> OrdinaryFit::effects_of(EffectGroup group) const {
  std::vector<std::size_t> result;
  for (std::size_t d = 0; d < model_.effects.size(); ++d) {
    if (model_.effects[d].group() == group) {
      result.push_back(d);
    }
  }
  return result;
}

MatrixXd OrdinaryFit::disturbed(const Disturbance& disturb) const {
  constexpr double kStep = 1e-3;
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model_, estimate_, rows_);
  Measurements rows = rows_;
  for (Observation& observation : rows.observations) {
    disturb(observation, predicted_point(estimate_, X_BF, observation), kStep);
  }
  return (turned(whitened(rows, {}).residual) - linear_.residual) / kStep;
}

const Eigen::Isometry3d& OrdinaryFit::base_of(const Observation& row) const {
  return estimate_.frames.base(station_of(row));
}

OrdinaryFit::EffectColumns OrdinaryFit::of_effects(const std::vector<EffectTerm>& terms) const {
  constexpr double kStep = 1e-4;  // of a motion
  ErrorModel model = model_;
  model.effects.insert(model.effects.end(), terms.begin(), terms.end());
  Estimate estimate = estimate_;
  estimate.effects = VectorXd::Zero(std::ssize(model.effects));
  estimate.effects.head(estimate_.effects.size()) = estimate_.effects;
  const Unknowns unknowns = Unknowns(model, estimate.frames.targets, {}).with_group(model, UnknownGroup::effects);
  const MatrixXd all =
      LeastSquaresProblem(model, rows_, unknowns, options_).whitened(estimate).jacobian.topRows(blocks_.back());
  EffectColumns result{.rows = MatrixXd(all.rows(), std::ssize(terms)),
                       .points = MatrixXd(linear_.offset.size(), std::ssize(terms))};
  const VectorXd here = points_of(model, estimate);
  for (Index i = 0; i < std::ssize(terms); ++i) {
    const auto effect = static_cast<std::size_t>(estimate_.effects.size() + i);
    result.rows.col(i) = all.col(*unknowns.column(UnknownGroup::effects, effect));
    Estimate moved = estimate;
    moved.effects[static_cast<Index>(effect)] = kStep;
    result.points.col(i) = (points_of(model, moved) - here) / kStep;
  }
  turn(result.rows);
  return result;
}

VectorXd OrdinaryFit::at_points(const Eigen::Matrix3Xd& displacements) const {
  const Index targets = std::ssize(estimate_.frames.targets);
  const Eigen::Matrix3Xd in_world = estimate_.frames.base().linear() * displacements;
  VectorXd points(3 * targets * in_world.cols());
  for (Index i = 0; i < targets * in_world.cols(); ++i) {
    points.segment<3>(3 * i) = in_world.col(i / targets);
  }
  return points;
}

std::vector<Index> OrdinaryFit::columns_of_result() const {
  const std::size_t effects = fit_.beside_effects ? fit_.model.effects.size() : 0;
  std::vector<Index> result;
  for (Index column = 0; column < wide_.size(); ++column) {
    const Unknown& unknown = wide_.columns()[static_cast<std::size_t>(column)];
    const bool is_added = unknown.group == UnknownGroup::effects && unknown.index >= effects;
    if (!is_added && linear_.sizes[column] > 0.0) {
      result.push_back(column);
    }
  }
  return result;
}

double OrdinaryFit::misfit_without_effects(Index columns) const {
  const double coordinates = linear_.coordinates.sum();
  const double left = coordinates - static_cast<double>(fit_.model.effects.size());
  return misfit_ * std::sqrt(std::max((coordinates - static_cast<double>(columns)) / std::max(left, 1.0), 1.0));
}

bool OrdinaryFit::is_seen_from_outside() const {
  constexpr double kOutside = 0.1;  // of the diagonal
  const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model_, estimate_, rows_);
  std::vector<Eigen::AlignedBox3d> boxes(estimate_.frames.bases.size());
  for (const Observation& row : rows_.observations) {
    boxes[station_of(row)].extend(predicted_point(estimate_, X_BF, row));
  }
  return std::none_of(boxes.begin(), boxes.end(), [](const Eigen::AlignedBox3d& points) {
    return points.exteriorDistance(Vector3d(Vector3d::Zero())) < kOutside * points.diagonal().norm();
  });
}

std::size_t OrdinaryFit::station(Index configuration) const {
  return static_cast<std::size_t>(stations_[static_cast<std::size_t>(configuration)]);
}

std::pair<Index, Index> OrdinaryFit::rows_of(Index configuration) const {
  const auto block = static_cast<std::size_t>(configuration);
  return {blocks_[block], blocks_[block + 1] - blocks_[block]};
}

}  // namespace kdl_calibration
