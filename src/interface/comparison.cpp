// Whether a robot has changed between two calibrations. They may hold different parameters, fixed by different gauges,
// and scale their effects differently. So they are compared by what they predict: the positions of three points on the
// flange in configurations that both measured, with the motions of base and tool removed.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "base/decompositions.hpp"
#include "base/distributions.hpp"
#include "base/preconditions.hpp"
#include "base/random.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/prediction.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/validation.hpp"
#include "model/parameters.hpp"
#include "robot/joint_ranges.hpp"
#include "validation/validation.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kConfigurations = 100;
constexpr Index kBase = 6;         // columns
constexpr double kNothing = 1e-6;  // relative size of rounding

// Points that show all that is measured of the targets: three for a frame.
std::vector<TargetFrame> as_points(const std::vector<TargetFrame>& targets) {
  constexpr double kLever = 0.1;  // [m]
  std::vector<TargetFrame> points;
  for (const TargetFrame& target : targets) {
    for (const Vector3d& lever : {Vector3d::Zero().eval(), Vector3d::UnitX().eval(), Vector3d::UnitY().eval()}) {
      if (target.with_orientation || lever.isZero()) {
        points.push_back({.name = std::to_string(points.size())});
        points.back().X_FT.translation() = target.X_FT * (kLever * lever);
      }
    }
  }
  return points;
}

// Torques of the drives are unknown: the arm is compared at zero torque.
DriveSignals unloaded(const MatrixXd& joint_values) {
  return {.approach = {}, .torques = MatrixXd::Zero(joint_values.rows(), joint_values.cols())};
}

// Joint ranges that both results measured, within the limits; the gap between them if they do not overlap.
MatrixXd shared_configurations(const CalibrationParts& before, const CalibrationParts& after) {
  JointRanges ranges = limits_of(before.model.joints);
  for (const JointRanges* measured : {&before.region.joints, &after.region.joints}) {
    for (std::size_t i = 0; i < std::min(ranges.size(), measured->size()); ++i) {
      ranges[i] = std::minmax(
          {std::max(ranges[i].first, (*measured)[i].first), std::min(ranges[i].second, (*measured)[i].second)});
    }
  }
  Random random(1);
  return random_configurations(before.model.joints, ranges, kConfigurations, random);
}

// One model with the geometric errors and effects of both results, the effects of the second behind those of the first.
// Its derivatives are taken at the errors of the first.
struct JoinedModel {
  ErrorModel model;
  VectorXd errors;
  std::size_t effects_before;
  std::vector<std::size_t> geometric;
  MatrixXd joint_values;

  JoinedModel(const CalibrationParts& before, const CalibrationParts& after)
      : model(before.model),
        errors(before.estimate.errors),
        effects_before(model.effects.size()),
        joint_values(shared_configurations(before, after)) {
    const std::vector<EffectTerm>& more = after.model.effects;
    if (!model.effects.empty() && !more.empty() && model.gravity != after.model.gravity) {
      refuse_input("the calibrations have different directions of gravity", "the same in the base frame");
    }
    model = model_at_stations({}, std::move(model));
    model.gravity = more.empty() ? model.gravity : after.model.gravity;
    model.effects.insert(model.effects.end(), more.begin(), more.end());
    std::set<std::size_t> all;
    for (const Unknowns* unknowns : {&before.free, &before.candidates, &after.free, &after.candidates}) {
      all.insert(unknowns->geometric().begin(), unknowns->geometric().end());
    }
    for (std::size_t i = 0; i < model.parameters.size(); ++i) {
      if (model.parameters[i].kind == ParameterKind::joint_offset) {
        all.insert(i);
      }
    }
    geometric.assign(all.begin(), all.end());
  }

  Index size() const { return static_cast<Index>(geometric.size() + model.effects.size()); }

  // Columns of the geometric errors and effects among the unknowns of a result.
  std::vector<Index> columns(const Unknowns& unknowns, bool is_after) const {
    std::vector<Index> result;
    for (const std::size_t index : unknowns.geometric()) {
      result.push_back(std::lower_bound(geometric.begin(), geometric.end(), index) - geometric.begin());
    }
    for (const std::size_t index : unknowns.effects()) {
      result.push_back(static_cast<Index>(geometric.size() + index + (is_after ? effects_before : 0)));
    }
    return result;
  }

  // Derivatives of the points' positions by the base, these columns and the points.
  MatrixXd derivatives(const std::vector<TargetFrame>& points) const {
    const Unknowns all = Unknowns(model, points, frame_parameter_names(points))
                             .with(model, UnknownGroup::geometric, geometric)
                             .with_group(model, UnknownGroup::effects);
    const Estimate at{.errors = errors, .frames = {.targets = points}, .effects = {}};
    const PositionPredictor predictor(model, at, all);
    MatrixXd result(3 * static_cast<Index>(points.size()) * joint_values.cols(), all.size());
    Index row = 0;
    for (Index c = 0; c < joint_values.cols(); ++c) {
      for (const Matrix3Xd& jacobian : predictor.jacobians(joint_values.col(c), unloaded(joint_values.col(c)))) {
        result.middleRows<3>(row) = jacobian;
        row += 3;
      }
    }
    return result;
  }
};

// Removes the span of `columns` from `from`.
MatrixXd without(MatrixXd columns, const MatrixXd& from) {
  if (columns.cols() == 0) {
    return from;
  }
  columns.colwise().normalize();
  const MatrixXd basis = range_basis(columns, kNothing);
  return from - basis * (basis.transpose() * from);
}

// One of the two results.
struct Side {
  const CalibrationParts& parts;
  bool is_after;
  std::vector<Index> columns;
  Unknowns arm;  // its geometric errors and effects

  Side(const CalibrationParts& its_parts, const JoinedModel& joined, bool is_second)
      : parts(its_parts),
        is_after(is_second),
        columns(joined.columns(parts.free, is_second)),
        arm(parts.free.without(UnknownGroup::base).without(UnknownGroup::targets)) {}

  MatrixXd sqrt_covariance() const {
    const Index first = parts.free.range(UnknownGroup::geometric).first;
    const auto [values, vectors] = spectrum(parts.covariance.block(first, first, arm.size(), arm.size()));
    return vectors * values.cwiseMax(0.0).cwiseSqrt().asDiagonal();
  }

  // Predicted positions of the points.
  VectorXd positions(const std::vector<TargetFrame>& points, const MatrixXd& joint_values) const {
    VectorXd result(3 * static_cast<Index>(points.size()) * joint_values.cols());
    Index row = 0;
    for (const Eigen::Isometry3d& X_BF :
         flange_poses(parts.model, parts.estimate, joint_values, unloaded(joint_values))) {
      for (const TargetFrame& point : points) {
        result.segment<3>(row) = X_BF * point.X_FT.translation();
        row += 3;
      }
    }
    return result;
  }

  // Shifts of its estimate, independent of each other. Their outer products add up to its covariance.
  MatrixXd shifts() const {
    const Index first = parts.free.range(UnknownGroup::geometric).first;
    return parts.shifts.size() > 0 ? MatrixXd(parts.shifts.middleRows(first, arm.size())) : sqrt_covariance();
  }
};

// Directions of the predictions that one of the results does not determine.
struct UndeterminedDirections {
  MatrixXd columns;
  std::vector<std::string> names;  // parameters that only the other one determines

  void add(const VectorXd& direction) {
    if (direction.isZero(0.0)) {  // of a base alone
      return;
    }
    columns.conservativeResize(direction.size(), columns.cols() + 1);
    columns.rightCols<1>() = direction;
  }

  // A parameter that only `other` has is not zero in `side`: the parameters there imitate it as well as its targets
  // show. What remains of it is undetermined, as are directions that its measurements do not determine. `J`:
  // derivatives of the flange.
  void add(const JoinedModel& joined, const MatrixXd& J, const Side& side, const Side& other) {
    const Unknowns& free = side.parts.free;
    const MatrixXd T = joined.derivatives(as_points(side.parts.estimate.frames.targets));
    const Index base = free.range(UnknownGroup::base).empty() ? 0 : kBase;
    const Index targets = free.range(UnknownGroup::targets).empty() ? 0 : T.cols() - kBase - joined.size();
    const auto chain = T.middleCols(kBase, joined.size());
    MatrixXd own(T.rows(), static_cast<Index>(side.columns.size()) + base + targets);
    own << chain(Eigen::all, side.columns), T.leftCols(base), T.rightCols(targets);
    const MatrixXd imitation = shortest_solution(own, MatrixXd(chain));
    for (std::size_t i = 0; i < other.columns.size(); ++i) {
      const Index column = other.columns[i];
      if (std::find(side.columns.begin(), side.columns.end(), column) != side.columns.end()) {
        continue;
      }
      const VectorXd by = imitation.col(column);
      const VectorXd left = J.col(column) - J(Eigen::all, side.columns) * by.head(side.arm.size());
      if (left.norm() > kNothing * J.col(column).norm()) {
        add(left);
        names.push_back(other.arm.columns()[i].name);
      }
    }
    const Unknowns candidates = side.parts.candidates.without(UnknownGroup::base).without(UnknownGroup::targets);
    const Index first = side.parts.candidates.range(UnknownGroup::geometric).first;
    for (const auto& direction : side.parts.undetermined.colwise()) {
      add(J(Eigen::all, joined.columns(candidates, side.is_after)) * direction.segment(first, candidates.size()));
    }
  }
};

// Whether both results held the base, or the targets, where it stood. Else it may have moved between them.
bool holds_same_base(const CalibrationParts& before, const CalibrationParts& after) {
  return before.free.range(UnknownGroup::base).empty() && after.free.range(UnknownGroup::base).empty() &&
         before.estimate.frames.base().isApprox(after.estimate.frames.base(), kNothing);
}

bool holds_same_targets(const CalibrationParts& before, const CalibrationParts& after) {
  const std::vector<TargetFrame>& others = after.estimate.frames.targets;
  return before.free.range(UnknownGroup::targets).empty() && after.free.range(UnknownGroup::targets).empty() &&
         std::all_of(others.begin(), others.end(), [&](const TargetFrame& other) {
           const TargetFrame* same = find_target(before.estimate.frames.targets, other.name);
           return same != nullptr && same->X_FT.isApprox(other.X_FT, kNothing);
         });
}

// Positions of the points on the flange, rows by configuration and point, with the motions of base and tool removed
// where these may have moved.
struct Differences {
  MatrixXd J;  // derivatives by the columns of the joined model
  MatrixXd F;  // square root of the covariance of d for white noise: the part of the first result, then of the second
  MatrixXd S;  // shifts of d by groups of configurations of both
  VectorXd d;

  Differences(const JoinedModel& joined, const Side& first, const Side& second) {
    const std::vector<TargetFrame> points = flange_points();
    const MatrixXd D = joined.derivatives(points);
    const Index base = holds_same_base(first.parts, second.parts) ? 0 : kBase;
    const Index tool = holds_same_targets(first.parts, second.parts) ? 0 : D.cols() - kBase - joined.size();
    MatrixXd frames(D.rows(), base + tool);
    frames << D.leftCols(base), D.rightCols(tool);
    MatrixXd all(D.rows(), joined.size() + 1);
    all << D.middleCols(kBase, joined.size()),
        second.positions(points, joined.joint_values) - first.positions(points, joined.joint_values);
    all = without(frames, all);
    J = all.leftCols(joined.size());
    d = all.rightCols<1>();
    F.resize(J.rows(), first.arm.size() + second.arm.size());
    F << J(Eigen::all, first.columns) * first.sqrt_covariance(),
        J(Eigen::all, second.columns) * second.sqrt_covariance();
    const MatrixXd before = first.shifts();
    const MatrixXd after = second.shifts();
    S.resize(J.rows(), before.cols() + after.cols());
    S << J(Eigen::all, first.columns) * before, J(Eigen::all, second.columns) * after;
  }

  static std::vector<TargetFrame> flange_points() { return as_points({{.name = "flange", .with_orientation = true}}); }
};

// W with W F F^T W^T = I on the span of F, without directions that hardly move the flange: with hundreds of effects
// some are certain to a micrometre, and there the choice of the effects differs by more. `size`: squared norm of all.
MatrixXd whitening(const MatrixXd& F, double size) {
  constexpr double kHardly = 1e-2;
  const auto [values, vectors] = spectrum(F.transpose() * F);
  const Index rank = (values.array() > kHardly * kHardly * size).count();
  if (rank == 0) {
    refuse_input("the calibrations determine nothing in common", "measurements of the same joints");
  }
  return values.tail(rank).cwiseInverse().asDiagonal() * (F * vectors.rightCols(rank)).transpose();
}

// d = change + J1 e1 - J2 e2 has the covariance F F^T with F = [J1 C1^(1/2), J2 C2^(1/2)] if the misfit is white noise,
// and chi^2 = d^T (F F^T)^+ d = z^T z with z = W d. For the same parameters this is Delta^T (C1 + C2)^-1 Delta. But a
// misfit is a function of the joint values, so z has the covariance V = sum u u^T of independent shifts u = W S of
// whole configurations. Then z^T z / tr V is about F with h = (tr V)^2 / tr V^2 and nu degrees of freedom (Box 1954).
// The pairs of different shifts estimate tr V^2 without bias, and nu = 2 (tr V)^2 / sum (u^T u)^2.
void test(const VectorXd& z, const MatrixXd& U, Comparison& result) {
  const MatrixXd products = U.transpose() * U;
  const auto k = static_cast<double>(z.size());
  const double trace = std::max(products.trace(), kNothing * k);  // of exact measurements 0
  const double square = trace * trace;
  const double of_single = std::max(products.diagonal().squaredNorm(), kNothing * square);
  const double h = square / std::max(products.squaredNorm() - of_single, square / k);
  result.chi_square = z.squaredNorm();
  result.degrees_of_freedom = k;
  result.misfit_factor = trace / k;
  result.noise_degrees_of_freedom = 2.0 * square / of_single;
  result.p_value = f_upper_tail(result.chi_square / trace, h, result.noise_degrees_of_freedom);
}

// The changes of the first result's parameters that fit z best, the smallest in units of their covariance L L^T.
std::vector<ParameterChange> parameter_changes(const Side& first, const MatrixXd& J, const VectorXd& z,
                                               double misfit_factor) {
  constexpr double kVisible = 1e-3;  // share of the covariance's root
  const MatrixXd L = first.sqrt_covariance();
  const auto [squares, axes] = spectrum((J * L).transpose() * (J * L));
  const Index seen = (squares.array() > kVisible * kVisible).count();
  const MatrixXd inverse = L * axes.rightCols(seen) * squares.tail(seen).cwiseInverse().asDiagonal() *
                           (J * L * axes.rightCols(seen)).transpose();
  const VectorXd changes = inverse * z;
  std::vector<ParameterChange> result;
  for (Index i = 0; i < J.cols(); ++i) {
    const Unknown& unknown = first.arm.columns()[static_cast<std::size_t>(i)];
    const bool is_geometric = unknown.group == UnknownGroup::geometric;
    result.push_back({.name = unknown.name,
                      .joint = is_geometric ? first.parts.model.parameters[unknown.index].joint : "",
                      .unit = !is_geometric    ? ""
                              : unknown.length ? "m"
                                               : "rad",
                      .before = Unknowns::value(first.parts.estimate, unknown),
                      .change = changes[i],
                      .std = inverse.row(i).norm() * std::sqrt(misfit_factor),
                      .explained = std::pow(J.col(i).normalized().dot(z.normalized()), 2)});
  }
  return result;
}

// Zeros of joints that may change without a difference: of the first joint if the base is free, of the last one if the
// targets are.
std::vector<std::string> unseen_zeros(const JoinedModel& joined, const MatrixXd& J) {
  constexpr double kSeen = 100.0;  // sigma for 1 rad or 1 m
  std::vector<std::string> result;
  for (std::size_t i = 0; i < joined.geometric.size(); ++i) {
    const ErrorParameter& parameter = joined.model.parameters[joined.geometric[i]];
    if (parameter.kind == ParameterKind::joint_offset && J.col(static_cast<Index>(i)).norm() < kSeen) {
      result.push_back(parameter.joint);
    }
  }
  return result;
}

// The flange is the first of the points.
void add_flange(const Differences& found, Comparison& result) {
  const auto step = static_cast<Index>(3 * Differences::flange_points().size());
  std::vector<double> distances;
  double variance = 0.0;
  for (Index row = 0; row < found.d.size(); row += step) {
    distances.push_back(found.d.segment<3>(row).norm());
    variance += found.F.middleRows<3>(row).squaredNorm();
  }
  result.flange = error_statistics(distances);
  result.flange_sigma = std::sqrt(result.misfit_factor * variance / static_cast<double>(distances.size()));
}

// The mean of both, or the one that is known.
double mean_of_known(double first, double second) {
  return std::isnan(first) ? second : std::isnan(second) ? first : 0.5 * (first + second);
}

// Both arms at the mean of their temperatures and payloads, or at those of the one that states any.
std::pair<CalibrationParts, CalibrationParts> in_the_same_circumstances(CalibrationParts before,
                                                                        CalibrationParts after) {
  Circumstances& first = before.model.circumstances;
  Circumstances& second = after.model.circumstances;
  Circumstances mean = {.temperature = mean_of_known(first.temperature, second.temperature),
                        .payload = mean_of_known(first.payload, second.payload)};
  for (const MovingJoint& joint : before.model.joints) {
    const auto has_own = [&](const Circumstances& known) {
      return std::any_of(joint.links.begin(), joint.links.end(),
                         [&](const std::string& link) { return known.link_temperatures.contains(link); });
    };
    if (has_own(first) || has_own(second)) {
      mean.link_temperatures[joint.links.back()] =
          mean_of_known(temperature_before(joint, first), temperature_before(joint, second));
    }
  }
  first = mean;
  second = mean;
  return {std::move(before), std::move(after)};
}

bool is_same(const std::string& hash, const std::string& other) { return !hash.empty() && hash == other; }

void require_comparable(const Calibration& calibration, const std::string& which) {
  if (!calibration.trusted()) {
    refuse_input("the " + which + " calibration is not to be trusted",
                 "one that is; a few configurations can only continue an earlier result (--prior-result)");
  }
  const MatrixXd& covariance = calibration.covariance();
  if (covariance.size() == 0 || !covariance.allFinite()) {
    refuse_input("the " + which + " calibration has no covariance", "one of at most 300 parameters");
  }
}

}  // namespace

Comparison compare(const Calibration& before, const Calibration& after) {
  require_comparable(before, "earlier");
  require_comparable(after, "later");
  if (before.parts().robot != after.parts().robot) {
    refuse_input("the calibrations are of different robots", "the same URDF, base and tip");
  }
  if (before.parts().model.kept_axes != after.parts().model.kept_axes) {
    refuse_input("one of the calibrations keeps axes that the other does not", "two with the same option");
  }
  if (after.parts().continues_earlier) {
    refuse_input("the later calibration continues an earlier one", "an independent one");
  }
  const auto [earlier, later] = in_the_same_circumstances(before.parts(), after.parts());
  const JoinedModel joined(earlier, later);
  const Side first(earlier, joined, false);
  const Side second(later, joined, true);
  const Differences found(joined, first, second);
  UndeterminedDirections undetermined;
  undetermined.add(joined, found.J, first, second);
  undetermined.add(joined, found.J, second, first);
  const MatrixXd W = whitening(without(undetermined.columns, found.F), found.F.squaredNorm());
  const VectorXd z = W * found.d;
  const MatrixXd J = W * found.J;
  Comparison result{.unseen_zeros = unseen_zeros(joined, J), .not_compared = undetermined.names};
  result.same_measurements = is_same(before.parts().measurements, after.parts().measurements);
  test(z, W * found.S, result);
  result.parameters = parameter_changes(first, J(Eigen::all, first.columns), z, result.misfit_factor);
  add_flange(found, result);
  return result;
}

}  // namespace kdl_calibration
