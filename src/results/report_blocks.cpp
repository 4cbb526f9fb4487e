#include "results/report_blocks.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <utility>

#include "base/decompositions.hpp"
#include "base/number_range.hpp"
#include "base/thinned.hpp"
#include "calibration/parameter_estimates.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/prediction.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "model/error_chains.hpp"
#include "robot/link_shapes.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Vector3d;

constexpr std::size_t kLargestShown = 200;
constexpr std::size_t kMostCorrelated = 14;  // most parameters in the matrix
constexpr std::size_t kStrongestPairs = 12;

// The first three rows of the homogeneous matrix, row by row.
const char* type_name(JointType type) {
  return type == JointType::prismatic ? "prismatic" : type == JointType::revolute ? "revolute" : "continuous";
}

Json joints_json(const ErrorModel& model) {
  Json joints = Json::array();
  for (const MovingJoint& joint : model.joints) {
    joints.push_back({{"name", joint.name},
                      {"type", type_name(joint.type)},
                      {"lower", joint.lower ? Json(*joint.lower) : Json(nullptr)},
                      {"upper", joint.upper ? Json(*joint.upper) : Json(nullptr)}});
  }
  return joints;
}

// Link by link from the base: its frame in the previous one at zero joint values, and the axis of its motion. A link's
// errors follow the origin of the joint at its far end.
Json segments_json(const Robot& robot, const ErrorModel& model, const Estimate& estimate) {
  Json segments = Json::array();
  int joint = 0;
  for (unsigned s = 0; s < robot.chain.getNrOfSegments(); ++s) {
    const KDL::Segment& segment = robot.chain.getSegment(s);
    Json entry = {{"link", segment.getName()}};
    KDL::Frame origin = segment.pose(0.0);
    if (segment.getJoint().getType() != KDL::Joint::Fixed) {
      const MovingJoint& moving = model.joints[static_cast<std::size_t>(joint)];
      origin = origin * frame_correction(model, estimate.errors, joint);
      entry["joint"] = joint++;
      const Eigen::Matrix3d turn = z_onto(to_eigen(moving.axis));
      entry["axis"] = array(to_eigen(moving.axis));
      entry["across"] = {array(turn.col(0)), array(turn.col(1))};
    }
    entry["origin"] = frame12(to_eigen(origin));
    segments.push_back(entry);
  }
  return segments;
}

// Without valid shapes in the URDF the arm is drawn as a skeleton.
Json shapes_json(const Robot& robot) {
  const std::vector<std::string> names = link_names(robot);
  Json shapes = Json::array();
  try {
    for (const LinkShape& shape : link_shapes(robot)) {
      if (shape.kind != LinkShape::Kind::mesh) {
        const char* kind = shape.kind == LinkShape::Kind::box        ? "box"
                           : shape.kind == LinkShape::Kind::cylinder ? "cylinder"
                                                                     : "sphere";
        const auto link = std::find(names.begin(), names.end(), shape.link) - names.begin();
        shapes.push_back({{"link", link}, {"kind", kind}, {"frame", frame12(shape.X_LS)}, {"size", array(shape.size)}});
      }
    }
  } catch (const InputError&) {
    return Json::array();
  }
  return shapes;
}

// The measured points [m] in W. Coordinates that were not measured are those of the predicted point.
std::vector<Vector3d> shown_points(const ErrorModel& model, const Estimate& estimate,
                                   const Measurements& measurements) {
  std::vector<Vector3d> result;
  for (const Observation& observation : measurements.observations) {
    result.push_back(observation.position());
  }
  if (has_single_coordinates(measurements)) {
    const std::vector<Eigen::Isometry3d> X_BF = flange_poses(model, estimate, measurements);
    for (std::size_t row = 0; row < result.size(); ++row) {
      result[row] = predicted_point(estimate, X_BF, measurements.observations[row]) +
                    measured_minus_predicted(measurements.observations[row], estimate, X_BF);
    }
  }
  return result;
}

// From W of the observation's station to W of the first, in which the page shows all points.
Eigen::Isometry3d to_first_station(const Estimate& estimate, const Observation& observation) {
  return observation.station == 0 ? Eigen::Isometry3d::Identity()
                                  : estimate.frames.base() * estimate.frames.base(station_of(observation)).inverse();
}

std::vector<double> norms(const std::vector<Vector3d>& vectors) {
  std::vector<double> result(vectors.size());
  std::transform(vectors.begin(), vectors.end(), result.begin(), [](const Vector3d& v) { return v.norm(); });
  return result;
}

Json distributions_json(const Measurements& measurements, const std::vector<double>& before,
                        const std::vector<double>& after) {
  Json result = Json::object();
  for (const auto& [name, split] : {std::pair{"train", Split::train}, std::pair{"test", Split::test}}) {
    const auto of = [&, wanted = split](const std::vector<double>& distances) {
      std::vector<double> chosen;
      for (std::size_t i = 0; i < distances.size(); ++i) {
        if (measurements.observations[i].split == wanted) {
          chosen.push_back(distances[i]);
        }
      }
      return distribution_json(std::move(chosen));
    };
    const Json own = of(after);
    if (own["count"] != 0) {
      result[name] = {{"after", own}};
      if (!before.empty()) {
        result[name]["before"] = of(before);
      }
    }
  }
  return result;
}

Json numbers_json(const Eigen::VectorXd& values) { return Json(std::vector<double>(values.begin(), values.end())); }

Json of_controller(const JointConvention& convention, const std::vector<MovingJoint>& joints) {
  constexpr double kRounding = 1e-9;
  const std::vector<std::size_t> independent = independent_joints(joints);
  const Eigen::MatrixXd inverse = convention.matrix.inverse();
  Eigen::MatrixXd limits(static_cast<Index>(joints.size()), 2);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    limits.row(static_cast<Index>(j)) << joints[j].lower.value_or(kInfinity), joints[j].upper.value_or(kInfinity);
  }
  limits = (independent_joint_values(joints, limits).colwise() - convention.offset).eval();
  Json result = Json::array();
  for (Index i = 0; i < inverse.rows(); ++i) {
    Index of = 0;
    inverse.row(i).cwiseAbs().maxCoeff(&of);
    Json parts = Json::object();
    for (Index k = 0; k < inverse.cols(); ++k) {
      if (std::abs(inverse(i, k)) > kRounding) {
        parts[convention.urdf_joints[static_cast<std::size_t>(k)]] = inverse(i, k);
      }
    }
    const bool alone = parts.size() == 1;  // else the limits depend on other joints
    const Eigen::RowVector2d own = inverse(i, of) * limits.row(of);
    result.push_back({{"name", convention.controller_joints[static_cast<std::size_t>(i)]},
                      {"type", type_name(joints[independent[static_cast<std::size_t>(of)]].type)},
                      {"urdf", parts},
                      {"constant", -inverse.row(i).dot(convention.offset)},
                      {"lower", alone ? finite_or_null(own.minCoeff()) : Json(nullptr)},
                      {"upper", alone ? finite_or_null(own.maxCoeff()) : Json(nullptr)}});
  }
  return result;
}

// Measured region for which the page states accuracy: joint ranges, and the box of the measured points parallel to the
// axes of the controller's world, else of the base. From the fitted rows, or all rows if none was fitted.
void add_reach(const ReportedMeasurements& reported, const std::vector<Vector3d>& measured,
               const Eigen::MatrixXd& joint_values, Json& result) {
  const Estimate& estimate = reported.estimate;
  const Eigen::Isometry3d X_KW =
      (estimate.frames.base() * reported.X_BK.value_or(Eigen::Isometry3d::Identity())).inverse();
  const std::vector<Observation>& rows = reported.measurements.observations;
  const auto is_fitted = [](const Observation& observation) { return observation.split == Split::train; };
  const bool any_fitted = std::any_of(rows.begin(), rows.end(), is_fitted);
  Eigen::AlignedBox3d box;
  Eigen::VectorXd lower = Eigen::VectorXd::Constant(joint_values.rows(), kInfinity);
  Eigen::VectorXd upper = -lower;
  for (std::size_t row = 0; row < rows.size(); ++row) {
    const Observation& observation = rows[row];
    if (any_fitted && !is_fitted(observation)) {
      continue;
    }
    box.extend(X_KW * (to_first_station(estimate, observation) * measured[row]));
    lower = lower.cwiseMin(joint_values.col(observation.configuration));
    upper = upper.cwiseMax(joint_values.col(observation.configuration));
  }
  Json ranges = Json::array();
  for (Index j = 0; j < lower.size(); ++j) {
    ranges.push_back(lower[j] <= upper[j] ? Json::array({lower[j], upper[j]}) : Json(nullptr));
  }
  result["ranges"] = ranges;
  result["region"] = box.isEmpty() ? Json(nullptr) : Json{{"lower", array(box.min())}, {"upper", array(box.max())}};
}

}  // namespace

ShownJoints shown_joints(const ErrorModel& model, const Eigen::MatrixXd& q,
                         const std::optional<JointConvention>& given) {
  if (!given) {
    return {.joints = joints_json(model), .values = q};
  }
  const JointConvention convention = matched_convention(*given, independent_joint_names(model.joints));
  return {
      .joints = of_controller(convention, model.joints),
      .values = solution(convention.matrix, independent_joint_values(model.joints, q).colwise() - convention.offset)};
}

Json robot_block(const Robot& robot, const ErrorModel& model, const Estimate& estimate) {
  Json targets = Json::array();
  for (const TargetFrame& target : estimate.frames.targets) {
    targets.push_back({{"name", target.name}, {"position", array(target.X_FT.translation())}});
  }
  const auto count = static_cast<int>(model.joints.size());
  return {{"name", robot.name},
          {"base_link", robot.base},
          {"tip_link", robot.tip},
          {"joints", joints_json(model)},
          {"segments", segments_json(robot, model, estimate)},
          {"tip_correction", frame12(to_eigen(frame_correction(model, estimate.errors, count)))},
          {"shapes", shapes_json(robot)},
          {"base", frame12(estimate.frames.base())},
          {"targets", targets}};
}

namespace {

// A configuration's joint values: of the URDF, of the controller, and with effects.
Json configuration_json(const ReportedMeasurements& reported, const ShownJoints& known, std::int32_t configuration) {
  const Measurements& measurements = reported.measurements;
  const Eigen::VectorXd& effects = reported.estimate.effects;
  const Eigen::VectorXd q = measurements.joint_values.col(configuration);
  Json result = {{"name", measurements.configurations[static_cast<std::size_t>(configuration)]},
                 {"joint_values", numbers_json(q)}};
  if (reported.convention) {
    result["controller"] = numbers_json(known.values.col(configuration));
  }
  if (effects.size() > 0 && !effects.isZero(0.0)) {
    const DriveSignals signals = column(measurements.signals, configuration);
    result["effective"] = numbers_json(effective_joint_values(reported.model, effects, q, signals));
  }
  return result;
}

}  // namespace

Json measurements_block(const ReportedMeasurements& reported) {
  const Measurements& measurements = reported.measurements;
  const std::vector<Vector3d> after = residuals_of(reported.model, reported.estimate, measurements);
  const std::vector<Vector3d> measured = shown_points(reported.model, reported.estimate, measurements);
  std::vector<Vector3d> before;
  if (reported.before != nullptr) {
    before = residuals_of(reported.model, *reported.before, measurements);
  }
  const std::vector<double> distances = norms(after);
  const std::vector<std::size_t> shown = shown_rows(distances);
  const ShownJoints known = shown_joints(reported.model, measurements.joint_values, reported.convention);

  std::vector<int> number(measurements.configurations.size(), -1);  // index of each configuration on the page
  Json configurations = Json::array();
  Json points = Json::array();
  for (const std::size_t row : shown) {
    const Observation& observation = measurements.observations[row];
    const auto c = static_cast<std::size_t>(observation.configuration);
    if (number[c] < 0) {
      number[c] = static_cast<int>(configurations.size());
      configurations.push_back(configuration_json(reported, known, observation.configuration));
    }
    const Eigen::Isometry3d to_first = to_first_station(reported.estimate, observation);
    points.push_back({{"row", row},
                      {"configuration", number[c]},
                      {"target", observation.target},
                      {"repeat", observation.repeat},
                      {"test", observation.split == Split::test},
                      {"measured", array(to_first * measured[row])},
                      {"residual", array(to_first.linear() * after[row])}});
    if (measurements.stations.size() > 1) {
      points.back()["station"] = measurements.stations[station_of(observation)];
    }
    if (observation.order) {
      points.back()["order"] = *observation.order;
    }
    if (!before.empty()) {
      points.back()["before"] = array(to_first.linear() * before[row]);
    }
  }
  Json result = {{"targets", measurements.targets},
                 {"world", reported.X_BK ? frame12(*reported.X_BK) : Json(nullptr)},
                 {"rows", measurements.observations.size()},
                 {"all_configurations", measurements.joint_values.cols()},
                 {"complete", shown.size() == measurements.observations.size()},
                 {"joints", known.joints},
                 {"configurations", configurations},
                 {"points", points},
                 {"distributions", distributions_json(measurements, norms(before), distances)}};
  add_reach(reported, measured, known.values, result);
  return result;
}

std::vector<std::size_t> shown_rows(const std::vector<double>& distances) {
  const std::size_t count = distances.size();
  std::vector<std::size_t> rows(count);
  std::iota(rows.begin(), rows.end(), std::size_t{0});
  if (count <= kMostPointsOfPage) {
    return rows;
  }
  const auto end = rows.begin() + kLargestShown;
  std::partial_sort(rows.begin(), end, rows.end(), [&](std::size_t a, std::size_t b) {
    return distances[a] != distances[b] ? distances[a] > distances[b] : a < b;
  });
  std::set<std::size_t> chosen(rows.begin(), end);
  constexpr std::size_t kEven = kMostPointsOfPage - kLargestShown;
  for (std::size_t i = 0; i < kEven; ++i) {
    chosen.insert(i * count / kEven);
  }
  return {chosen.begin(), chosen.end()};
}

Json distribution_json(std::vector<double> values) {
  const std::size_t count = values.size();
  return {{"count", count}, {"values", thinned(std::move(values))}};
}

namespace {

double slowest(const std::vector<EffectTerm>& terms, const std::vector<Index>& members) {
  double times = kInfinity;
  for (const Index member : members) {
    times = std::min(times, std::get<Sinusoid>(terms[static_cast<std::size_t>(member)].function).times);
  }
  return times;
}

// Ascending values of the joint at the fitted configurations.
std::vector<double> fitted_values(const Measurements& measurements, Index joint) {
  const std::vector<bool> trained = trained_configurations(measurements);
  std::vector<double> values;
  for (std::size_t c = 0; c < trained.size(); ++c) {
    if (trained[c]) {
      values.push_back(measurements.joint_values(joint, static_cast<Index>(c)));
    }
  }
  std::sort(values.begin(), values.end());
  return values;
}

bool any_within(const std::vector<double>& ascending, double value, double reach) {
  const auto next = std::lower_bound(ascending.begin(), ascending.end(), value - reach);
  return next != ascending.end() && *next <= value + reach;
}

int curve_points(EffectGroup group) { return group == EffectGroup::ripple || group == EffectGroup::tables ? 301 : 61; }

bool any_withheld(const std::vector<EffectTerm>& terms, const std::vector<Index>& members, double value) {
  return std::any_of(members.begin(), members.end(),
                     [&](Index member) { return is_withheld(terms[static_cast<std::size_t>(member)], value); });
}

// Limits the range to three periods in its middle: with more, the curve's points would show an aliased frequency.
void show_swings(double times, double& lower, double& upper) {
  const double middle = 0.5 * (lower + upper);
  const double half = std::min(0.5 * (upper - lower), 3.0 * std::numbers::pi / times);
  lower = middle - half;
  upper = middle + half;
}

}  // namespace

Json effects_block(const CalibrationParts& saved, const Measurements& measurements) {
  Json curves = Json::array();
  const std::vector<EffectTerm>& terms = saved.model.effects;
  const JointRanges ranges = trained_ranges(measurements);
  Eigen::VectorXd middle(static_cast<Index>(ranges.size()));
  for (std::size_t j = 0; j < ranges.size(); ++j) {
    middle[static_cast<Index>(j)] = 0.5 * (ranges[j].first + ranges[j].second);
  }
  const ColumnRange columns = saved.free.range(UnknownGroup::effects);
  const bool known = saved.covariance.size() > 0 && columns.count == static_cast<Index>(terms.size());
  for (const auto& [key, members] : terms_by_motion(saved.model)) {
    const auto& [group, joint, axis] = key;
    auto [lower, upper] = ranges[static_cast<std::size_t>(joint)];
    constexpr std::array kOfOthers = {EffectGroup::torque, EffectGroup::coupling, EffectGroup::expansion,
                                      EffectGroup::drift, EffectGroup::payload};  // no functions of the joint's value
    if (!(lower <= upper) || std::find(kOfOthers.begin(), kOfOthers.end(), group) != kOfOthers.end()) {
      continue;
    }
    const std::vector<double> fitted = fitted_values(measurements, joint);
    const double reach = 0.1 * (upper - lower);
    if (group == EffectGroup::ripple) {
      show_swings(slowest(terms, members), lower, upper);
    }
    const int points = curve_points(group);
    const DriveSignals unloaded{.approach = {}, .torques = Eigen::MatrixXd::Zero(middle.size(), points)};
    Eigen::MatrixXd q = middle.replicate(1, points);
    q.row(joint) = Eigen::RowVectorXd::LinSpaced(points, lower, upper);
    const Eigen::MatrixXd basis = effect_basis(saved.model, q, unloaded)(members, Eigen::all);
    const Eigen::RowVectorXd along = Eigen::VectorXd(saved.estimate.effects(members)).transpose() * basis;
    Eigen::MatrixXd covariance;
    if (known) {
      covariance = saved.covariance.block(columns.first, columns.first, columns.count, columns.count)(members, members);
    }
    Json curve = Json::array();
    for (Index i = 0; i < points; ++i) {
      const bool measured = any_within(fitted, q(joint, i), reach) && !any_withheld(terms, members, q(joint, i));
      const double variance = known ? basis.col(i).dot(covariance * basis.col(i)) : kInfinity;
      const bool has_band = measured && std::isfinite(variance);
      curve.push_back({q(joint, i), measured ? Json(along[i]) : Json(nullptr),
                       has_band ? Json(half_width_95(std::sqrt(variance), kInfinity)) : Json(nullptr)});
    }
    curves.push_back({{"group", to_string(group)},
                      {"about", to_string(axis)},
                      {"joint", terms[static_cast<std::size_t>(members.front())].joint},
                      {"joint_index", joint},
                      {"terms", members.size()},
                      {"curve", curve}});
  }
  return curves;
}

Json correlations_block(const Json& covariance) {
  const Json& names = covariance.at("names");
  const Json& rows = covariance.at(covariance.contains("matrix") ? "matrix" : "lower_triangle");
  const auto entry = [&](std::size_t r, std::size_t c) { return rows.at(std::max(r, c)).at(std::min(r, c)); };
  const auto correlation = [&](std::size_t r, std::size_t c) {
    const Json value = entry(r, c);
    const Json own = entry(r, r);
    const Json other = entry(c, c);
    const bool known = value.is_number() && own.is_number() && other.is_number();
    const double product = known ? own.get<double>() * other.get<double>() : 0.0;
    return product > 0.0 ? value.get<double>() / std::sqrt(product) : 0.0;
  };
  struct Pair {
    std::size_t first;
    std::size_t second;
    double value;
  };
  std::vector<Pair> pairs;
  for (std::size_t r = 0; r < names.size(); ++r) {
    for (std::size_t c = 0; c < r; ++c) {
      pairs.push_back({.first = c, .second = r, .value = correlation(r, c)});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(),
                   [](const Pair& a, const Pair& b) { return std::abs(a.value) > std::abs(b.value); });
  std::set<std::size_t> shown;
  Json strongest = Json::array();
  for (std::size_t i = 0; i < pairs.size() && (i < kStrongestPairs || shown.size() < kMostCorrelated); ++i) {
    if (i < kStrongestPairs) {
      strongest.push_back({names[pairs[i].first], names[pairs[i].second], pairs[i].value});
    }
    for (const std::size_t index : {pairs[i].first, pairs[i].second}) {
      if (shown.size() < kMostCorrelated) {
        shown.insert(index);
      }
    }
  }
  Json matrix = Json::array();
  Json labels = Json::array();
  for (const std::size_t r : shown) {
    labels.push_back(names[r]);
    Json row = Json::array();
    for (const std::size_t c : shown) {
      row.push_back(r == c ? 1.0 : correlation(r, c));
    }
    matrix.push_back(row);
  }
  return {{"names", labels}, {"matrix", matrix}, {"strongest", strongest}};
}

}  // namespace kdl_calibration
