#include "results/saved_calibration.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <set>
#include <utility>

#include "base/json_tree.hpp"
#include "base/number_range.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "estimation/input_check.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/kept_axes.hpp"
#include "model/parameters.hpp"
#include "results/effects_json.hpp"

namespace kdl_calibration {
namespace {

using tree::elements;
using tree::has;
using tree::member;
using tree::Node;
using tree::number;

void require_same_robot(const Node& top, const Robot& robot) {
  if (!has(top, "input")) {
    return;
  }
  const Node input = member(top, "input");
  if (has(input, "sha256") && tree::name(member(input, "sha256")) != sha256(robot.urdf)) {
    throw InputError(top.where + ": was not made with " + robot.source +
                     ": its hash is another one; expected the URDF that was calibrated, not a corrected one");
  }
  for (const auto& [key, link] : {std::pair{"base", robot.base}, std::pair{"tip", robot.tip}}) {
    if (has(input, key) && tree::name(member(input, key)) != link) {
      throw InputError(top.where + ": input: " + key + " is '" + tree::name(member(input, key)) +
                       "', expected that of this robot, '" + link + "'");
    }
  }
}

// The elements of a list that may be absent or empty.
std::vector<Node> optional_elements(const Node& object, const std::string& key) {
  return has(object, key) && !member(object, key).json.empty() ? elements(member(object, key)) : std::vector<Node>();
}

// Null stands for infinity: not determined.
double number_or_infinity(const Node& node) { return node.json.is_null() ? kInfinity : number(node); }

// A number of 0 or more; null stands for infinity.
double not_negative(const Node& node) {
  const double value = number_or_infinity(node);
  if (!(value >= 0.0)) {
    fail(node, "a number of 0 or more");
  }
  return value;
}

std::vector<TargetFrame> targets_of(const Node& top) {
  std::vector<TargetFrame> targets;
  for (const Node& node : elements(member(top, "targets"))) {
    targets.push_back(target_of(node));
  }
  return targets;
}

// Consistency check for files without hashes, such as a truth or a result of version 0.1.0.
void require_sound(const Node& parameter, double error, bool is_angle) {
  constexpr double kRounding = 1e-9;
  constexpr double kTurn = 2.0 * std::numbers::pi;
  if (is_angle && std::abs(error) > kTurn) {
    fail(member(parameter, "error"), "an angle of at most a turn, in radians");
  }
  if (has(parameter, "value") && has(parameter, "nominal") &&
      !(std::abs(number(member(parameter, "value")) - number(member(parameter, "nominal")) - error) <= kRounding)) {
    fail(member(parameter, "value"), "the sum of \"nominal\" and \"error\"");
  }
}

// Reads the errors and effects; gives the effects' degrees of freedom.
std::vector<double> read_parameters(const Node& top, std::span<const OwnEffect> own, CalibrationParts& saved) {
  saved.estimate.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(saved.model.parameters.size()));
  std::set<std::string> names;
  for (const Node& node : elements(member(top, "parameters"))) {
    const std::string name = tree::name(member(node, "name"));
    if (name.find('.') != std::string::npos) {  // base and targets are in separate blocks
      continue;
    }
    const auto known = std::find_if(saved.model.parameters.begin(), saved.model.parameters.end(),
                                    [&](const ErrorParameter& parameter) { return parameter.name == name; });
    if (known == saved.model.parameters.end()) {
      throw InputError(node.where + ": this robot has no parameter '" + name +
                       "', expected the result of the same URDF, base and tip");
    }
    if (!names.insert(name).second) {
      throw InputError(node.where + ": parameter '" + name + "' is there twice, expected each once");
    }
    const double error = number(member(node, "error"));
    if (!has(top, "hashes")) {
      require_sound(node, error, !is_length(saved.model, *known));
    }
    saved.estimate.errors[known - saved.model.parameters.begin()] = error;
  }
  if (!has(top, "effects")) {
    return {};
  }
  SavedEffects effects = read_effects(member(top, "effects"), saved.model, own);
  saved.model.gravity = effects.gravity;
  saved.model.circumstances = effects.circumstances;
  for (const EffectTerm& term : effects.terms) {
    if (const auto* const payload = std::get_if<PayloadTorque>(&term.function)) {
      saved.model.payload_centre = payload->centre;
      saved.model.payload_centres = payload->centres;
    }
  }
  saved.model.effects = std::move(effects.terms);
  saved.estimate.effects = std::move(effects.values);
  return std::move(effects.degrees_of_freedom);
}

// No covariance exceeds what its two variances allow, beyond rounding.
void require_correlations(const Eigen::MatrixXd& covariance, const std::vector<Node>& rows) {
  constexpr double kRounding = 1e-6;
  const Eigen::ArrayXd sigma = covariance.diagonal().array().sqrt();
  for (Eigen::Index r = 0; r < covariance.rows(); ++r) {
    for (Eigen::Index c = 0; c < r; ++c) {
      if (std::isfinite(covariance(r, c)) && !(std::abs(covariance(r, c)) <= (1.0 + kRounding) * sigma[r] * sigma[c])) {
        fail(rows[static_cast<std::size_t>(r)], "covariances within the variances");
      }
    }
  }
}

// A list of that many numbers.
Eigen::VectorXd numbers_of(const Node& list, std::size_t count) {
  const std::vector<Node> numbers = elements(list);
  if (numbers.size() != count) {
    fail(list, "a number for each name");
  }
  Eigen::VectorXd result(static_cast<Eigen::Index>(count));
  std::transform(numbers.begin(), numbers.end(), result.begin(), [](const Node& node) { return number(node); });
  return result;
}

// {"names": […], "matrix": [[…], …]}; null is an infinite variance. Files of version 0.1 hold the lower triangle.
void read_covariance(const Node& block, CalibrationParts& saved) {
  std::vector<std::string> names;
  for (const Node& node : elements(member(block, "names"))) {
    names.push_back(tree::name(node));
  }
  saved.free = Unknowns(saved.model, saved.estimate.frames.targets, names);
  if (saved.free.names() != names) {
    fail(member(block, "names"), "the parameters in the order base, geometry, effects, targets");
  }
  const bool full = has(block, "matrix");
  const Node matrix = member(block, full ? "matrix" : "lower_triangle");
  const std::vector<Node> rows = elements(matrix);
  const auto size = static_cast<Eigen::Index>(names.size());
  if (rows.size() != names.size()) {
    fail(matrix, "a row for each name");
  }
  saved.covariance.resize(size, size);
  for (Eigen::Index r = 0; r < size; ++r) {
    const std::vector<Node> row = elements(rows[static_cast<std::size_t>(r)]);
    const Eigen::Index count = full ? size : r + 1;
    if (static_cast<Eigen::Index>(row.size()) != count) {
      fail(rows[static_cast<std::size_t>(r)], std::to_string(count) + " numbers");
    }
    for (Eigen::Index c = 0; c < count; ++c) {
      const Node& value = row[static_cast<std::size_t>(c)];
      const double read = number_or_infinity(value);
      if (r == c && read < 0.0) {
        fail(value, "a variance, 0 or more");
      }
      if (c < r && full && read != saved.covariance(c, r)) {
        fail(value, "the number of row " + std::to_string(c) + ", column " + std::to_string(r));
      }
      saved.covariance(r, c) = saved.covariance(c, r) = read;
    }
  }
  require_correlations(saved.covariance, rows);
  const std::vector<Node> shifts = optional_elements(block, "shifts");
  saved.shifts.resize(size, static_cast<Eigen::Index>(shifts.size()));
  for (std::size_t i = 0; i < shifts.size(); ++i) {
    saved.shifts.col(static_cast<Eigen::Index>(i)) = numbers_of(shifts[i], names.size());
  }
}

std::vector<Subject> subjects_of(const Node& doubt) {
  std::vector<Subject> subjects;
  for (const Node& node : optional_elements(doubt, "subjects")) {
    const Node kind = member(node, "kind");
    const std::optional<SubjectKind> known = subject_kind_named(tree::name(kind));
    if (!known) {
      fail(kind, "a kind of subject that calibrate writes");
    }
    subjects.push_back({.kind = *known, .name = tree::name(member(node, "name"))});
  }
  return subjects;
}

std::vector<NamedFigure> figures_of(const Node& doubt) {
  std::vector<NamedFigure> figures;
  if (has(doubt, "figures")) {
    const Node block = member(doubt, "figures");
    for (const auto& [name, value] : block.json.items()) {
      if (!value.is_null() && !value.is_number()) {
        fail(member(block, name), "a number or null");
      }
      figures.push_back({.name = name, .value = value.is_null() ? kInfinity : value.get<double>()});
    }
  }
  return figures;
}

// A doubt or a remark; its message is elsewhere if it is a remark.
Doubt doubt_of(const Node& node, const std::string& message) {
  const std::string name = tree::name(member(node, "cause"));
  const std::optional<Cause> cause = cause_named(name);
  if (!cause) {
    throw InputError(node.where + ": cause: " + shown(name) + " is unknown, expected one that calibrate writes");
  }
  return {.cause = *cause, .subjects = subjects_of(node), .figures = figures_of(node), .message = message};
}

Doubt doubt_of(const Node& node) { return doubt_of(node, tree::name(member(node, "message"))); }

// Files of version 0.1 state the warnings alone.
void read_remarks(const Node& top, CalibrationParts& saved) {
  for (const Node& node : optional_elements(top, "warnings")) {
    saved.warnings.push_back(tree::name(node));
  }
  if (!has(top, "remarks")) {
    return;
  }
  const std::vector<Node> remarks = optional_elements(top, "remarks");
  if (remarks.size() != saved.warnings.size()) {
    fail(member(top, "remarks"), "one for each warning");
  }
  for (std::size_t i = 0; i < remarks.size(); ++i) {
    saved.remarks.push_back(doubt_of(remarks[i], saved.warnings[i]));
  }
}

void read_verdict(const Node& top, CalibrationParts& saved) {
  const bool trusted = has(top, "trusted") && tree::truth(member(top, "trusted"));
  saved.verdict = trusted ? Verdict::trusted : Verdict::not_trusted;
  for (const Node& node : optional_elements(top, "doubts")) {
    saved.doubts.push_back(doubt_of(node));
  }
  if (trusted && !saved.doubts.empty()) {
    fail(member(top, "trusted"), "false, as there are doubts");
  }
  if (has(top, "reservation")) {
    saved.verdict = Verdict::trusted_where_measured;
    saved.doubts.push_back(doubt_of(member(top, "reservation")));
  }
  read_remarks(top, saved);
}

ParameterEstimate estimate_of(const Node& node) {
  ParameterEstimate result{.name = tree::name(member(node, "name"))};
  const Node joint = member(node, "joint");
  result.joint = joint.json.is_null() ? "" : tree::name(joint);
  const std::string kind = tree::name(member(node, "kind"));
  for (const ParameterKind each : {ParameterKind::joint_offset, ParameterKind::translation, ParameterKind::rotation}) {
    result.kind = kind == to_string(each) ? each : result.kind;
  }
  const Node axis = member(node, "axis");
  const bool has_axis = !axis.json.is_string() || !axis.json.get_ref<const std::string&>().empty();
  result.axis = has_axis ? tree::name(axis) : "";
  result.nominal = number(member(node, "nominal"));
  result.value = number(member(node, "value"));
  result.error = number(member(node, "error"));
  result.std = number_or_infinity(member(node, "std"));
  result.degrees_of_freedom = number_or_infinity(member(node, "degrees_of_freedom"));
  result.identifiable = tree::truth(member(node, "identifiable"));
  result.gauge = tree::truth(member(node, "gauge"));
  return result;
}

// The lines of the result, effects from their terms; none in a truth file.
void read_estimates(const Node& top, const std::vector<double>& degrees_of_freedom, CalibrationParts& saved) {
  for (const Node& node : optional_elements(top, "parameters")) {
    if (has(node, "degrees_of_freedom")) {
      saved.parameters.push_back(estimate_of(node));
    }
  }
  for (std::size_t e = 0; e < saved.model.effects.size() && !saved.parameters.empty(); ++e) {
    const EffectTerm& term = saved.model.effects[e];
    const double value = saved.estimate.effects[static_cast<Eigen::Index>(e)];
    const std::optional<Eigen::Index> column = saved.free.column(term.name);
    const bool known = column && *column < saved.covariance.rows();
    saved.parameters.push_back({.name = term.name,
                                .joint = term.joint,
                                .kind = ParameterKind::effect,
                                .axis = {},
                                .value = value,
                                .error = value,
                                .std = known ? std::sqrt(saved.covariance(*column, *column)) : 0.0,
                                .degrees_of_freedom = degrees_of_freedom[e],
                                .identifiable = known});
  }
  saved.urdf_errors = saved.estimate.errors;  // truth files and version 0.1 state no others
  if (has(top, "exported_urdf")) {
    saved.urdf_errors.setZero();
    for (const Node& node : optional_elements(member(top, "exported_urdf"), "parameters")) {
      const std::size_t place = parameter_index(saved.model, tree::name(member(node, "name")));
      saved.urdf_errors[static_cast<Eigen::Index>(place)] = number(member(node, "error"));
    }
  }
}

// What the radius of a new point needs. Files before version 0.2 lack a part of it, large results the covariance.
void read_prediction(const Node& top, CalibrationParts& saved) {
  if (saved.covariance.size() == 0 || !has(top, "predicted_accuracy") ||
      !has(member(top, "predicted_accuracy"), "region")) {
    return;
  }
  const Node predicted = member(top, "predicted_accuracy");
  const Node region = member(predicted, "region");
  saved.region.radius_factor = not_negative(member(predicted, "radius_factor"));
  saved.region.largest_variance = not_negative(member(region, "largest_variance"));
  saved.region.unproved = has(region, "unproved") ? not_negative(member(region, "unproved")) : 0.0;
  for (const Node& node : elements(member(region, "joints"))) {
    const Eigen::Vector2d range = tree::numbers<2>(node);
    if (!(range.x() <= range.y())) {
      fail(node, "the lower end first");
    }
    saved.region.joints.emplace_back(range.x(), range.y());
  }
  if (saved.region.joints.size() != saved.model.joints.size()) {
    fail(member(region, "joints"), "a range for each moving joint");
  }
  const Node noise = member(top, "noise");
  NoiseModel& model = saved.noise.model;
  model.independent = tree::numbers<3>(member(noise, "independent"));
  model.common = tree::numbers<3>(member(noise, "common"));
  model.misfit = number(member(noise, "misfit"));
  model.target_misfit = number(member(noise, "target_misfit"));
  if (has(noise, "tracker")) {
    const Eigen::Vector4d tracker = tree::numbers<4>(member(noise, "tracker"));
    model.tracker = TrackerNoise{tracker[0], tracker[1], tracker[2], tracker[3]};
  }
  check(model);
  for (const Node& station : optional_elements(noise, "stations")) {
    const auto factor = [&](const char* name) {
      const double value = not_negative(member(station, name));
      if (!(value >= 1e-6)) {
        fail(member(station, name), "a factor above 0");
      }
      return static_cast<float>(value);
    };
    saved.noise.stations.push_back({.length = factor("factor"), .orientation = factor("orientation_factor")});
  }
  if (!saved.noise.stations.empty() && saved.noise.stations.size() != saved.model.stations.size()) {
    fail(member(noise, "stations"), "one entry for each station");
  }
  saved.noise.degrees_of_freedom = not_negative(member(noise, "degrees_of_freedom_of_point"));
  const bool by_parts = tree::name(member(noise, "model")) == to_string(NoiseSource::parts);
  saved.noise.variance_factor = by_parts ? 1.0 : not_negative(member(noise, "variance_factor"));
  if (has(top, "undetermined")) {
    const Node undetermined = member(top, "undetermined");
    std::vector<std::string> names;
    for (const Node& node : elements(member(undetermined, "names"))) {
      names.push_back(tree::name(node));
    }
    saved.candidates = Unknowns(saved.model, saved.estimate.frames.targets, names);
    const std::vector<Node> directions = elements(member(undetermined, "directions"));
    saved.undetermined.resize(saved.candidates.size(), static_cast<Eigen::Index>(directions.size()));
    for (std::size_t d = 0; d < directions.size(); ++d) {
      saved.undetermined.col(static_cast<Eigen::Index>(d)) = numbers_of(directions[d], names.size());
    }
  }
}

ErrorStatistics statistics_of(const Node& node) {
  if (node.json.is_null()) {
    return {};
  }
  return {.count = static_cast<long>(number(member(node, "count"))),
          .mean = number(member(node, "mean")),
          .rms = number(member(node, "rms")),
          .p95 = number(member(node, "p95")),
          .max = number(member(node, "max")),
          .std = number(member(node, "std"))};
}

std::optional<ErrorStatistics> optional_statistics(const Node& object, const std::string& key) {
  return has(object, key) ? std::optional(statistics_of(member(object, key))) : std::nullopt;
}

std::optional<BeforeAfter> before_after(const Node& object, const std::string& key) {
  if (!has(object, key)) {
    return std::nullopt;
  }
  const Node both = member(object, key);
  return BeforeAfter{.before = statistics_of(member(both, "before")),
                     .after = statistics_of(member(both, "after")),
                     .rigid = optional_statistics(both, "exported_urdf")};
}

std::optional<Iso9283> iso_of(const Node& object, const std::string& key) {
  if (!has(object, key)) {
    return std::nullopt;
  }
  const Node iso = member(object, key);
  return Iso9283{.accuracy = statistics_of(member(iso, "accuracy")),
                 .repeatability = statistics_of(member(iso, "repeatability"))};
}

Accuracy accuracy_of(const Node& top) {
  Accuracy result;
  if (has(top, "position_error")) {
    const Node errors = member(top, "position_error");
    result.train = before_after(errors, "train").value_or(BeforeAfter{});
    result.test = before_after(errors, "test");
    for (const auto& [name, means] : {std::pair{"train", &result.train_means}, std::pair{"test", &result.test_means}}) {
      if (has(errors, name)) {
        *means = before_after(member(errors, name), "means");
      }
    }
    result.test_at_fitted_poses = optional_statistics(errors, "test_at_fitted_poses");
    result.test_at_new_poses = optional_statistics(errors, "test_at_new_poses");
    result.leave_one_out = before_after(errors, "leave_one_out");
    result.nested_leave_one_out = optional_statistics(errors, "nested_leave_one_out");
    result.k_fold = before_after(errors, "k_fold");
    result.folds = result.k_fold ? static_cast<int>(number(member(member(errors, "k_fold"), "folds"))) : 0;
  }
  if (has(top, "iso_9283")) {
    const Node iso = member(top, "iso_9283");
    result.iso_before = iso_of(iso, "before").value_or(Iso9283{});
    result.iso_after = iso_of(iso, "after").value_or(Iso9283{});
    if (has(iso, "test")) {
      result.iso_test_before = iso_of(member(iso, "test"), "before");
      result.iso_test_after = iso_of(member(iso, "test"), "after");
    }
  }
  return result;
}

// Hash of the file of measurements; empty if the result does not state it.
std::string measurements_hash(const Node& top) {
  if (has(top, "provenance")) {
    for (const Node& file : optional_elements(member(top, "provenance"), "files_read")) {
      if (tree::name(member(file, "role")) == "measurements") {
        return tree::name(member(file, "sha256"));
      }
    }
  }
  return {};
}

KeptAxes kept_axes_of(const Node& top) {
  if (!has(top, "kept_axes")) {
    return KeptAxes::none;
  }
  const Node kept = member(member(top, "kept_axes"), "kept");
  for (const KeptAxes known : {KeptAxes::closed_form, KeptAxes::angles}) {
    if (tree::name(kept) == to_string(known)) {
      return known;
    }
  }
  fail(kept, "'closed_form' or 'angles'");
}

// Of named stations; "base" is that of the first.
void read_stations(const Node& top, CalibrationParts& saved) {
  if (!has(top, "stations")) {
    return;
  }
  const Node block = member(top, "stations");
  saved.model.has_undetermined_bases = true;
  saved.model.stations.clear();
  for (const Node& node : elements(block)) {
    saved.model.stations.push_back(tree::name(member(node, "name")));
    if (saved.model.stations.size() > 1) {
      saved.estimate.frames.bases.push_back(tree::pose(node));
    }
  }
  const std::set<std::string> names(saved.model.stations.begin(), saved.model.stations.end());
  if (names.empty() || names.size() != saved.model.stations.size()) {
    fail(block, "stations with names that differ");
  }
}

}  // namespace

std::string hash_of(const Robot& robot) { return sha256(robot.urdf + '\n' + robot.base + '\n' + robot.tip); }

CalibrationParts parse_calibration(std::string_view json, const Robot& robot, const std::string& source,
                                   std::span<const OwnEffect> own) {
  const tree::Json document = tree::parsed(json, source);
  const Node top{.json = document, .where = source};
  require_same_robot(top, robot);
  CalibrationParts saved;
  saved.robot = hash_of(robot);
  saved.model = complete_model(robot, kept_axes_of(top));
  read_stations(top, saved);
  const std::vector<double> effects_freedom = read_parameters(top, own, saved);
  if (has(top, "base")) {
    saved.estimate.frames.base() = tree::pose(member(top, "base"));
  }
  if (has(top, "targets")) {
    saved.estimate.frames.targets = targets_of(top);
  }
  if (has(top, "covariance") && !member(top, "covariance").json.is_null()) {
    read_covariance(member(top, "covariance"), saved);
  }
  read_verdict(top, saved);
  read_estimates(top, effects_freedom, saved);
  read_prediction(top, saved);
  saved.accuracy = accuracy_of(top);
  saved.measurements = measurements_hash(top);
  saved.continues_earlier = has(top, "prior_result") && !member(top, "prior_result").json.is_null();
  return saved;
}

CalibrationParts read_calibration(const std::filesystem::path& result, const Robot& robot,
                                  std::span<const OwnEffect> own) {
  return parse_calibration(read_text_file(result), robot, result.string(), own);
}

TargetFrame target_of(const Node& node) {
  TargetFrame target;
  target.name = tree::name(member(node, "name"));
  target.X_FT.translation() = tree::numbers<3>(member(node, "position"));
  target.with_orientation = has(node, "quaternion_wxyz");
  if (target.with_orientation) {
    target.X_FT.linear() = tree::quaternion(member(node, "quaternion_wxyz")).toRotationMatrix();
  }
  return target;
}

}  // namespace kdl_calibration
