#include "results/result_json.hpp"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "base/distributions.hpp"
#include "base/json_tree.hpp"
#include "base/number_range.hpp"
#include "base/sha256.hpp"
#include "calibration/calibration_settings.hpp"
#include "calibration/new_point.hpp"
#include "calibration/parameter_estimates.hpp"
#include "estimation/input_check.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "results/effects_json.hpp"
#include "results/joint_offsets.hpp"
#include "results/result_blocks.hpp"

namespace kdl_calibration {
namespace {

Json before_after_json(const BeforeAfter& pair) {
  Json result = {{"before", statistics_json(pair.before)}, {"after", statistics_json(pair.after)}};
  if (pair.rigid) {
    result["exported_urdf"] = statistics_json(*pair.rigid);
  }
  return result;
}

Json noise_json(const NoiseReport& noise, const std::vector<std::string>& stations) {
  Json result = {{"model", to_string(noise.source)},
                 {"sigma", noise.sigma},
                 {"independent", array(noise.independent)},
                 {"common", array(noise.common)},
                 {"misfit", noise.misfit},
                 {"target_misfit", noise.target_misfit},
                 {"degrees_of_freedom", noise.degrees_of_freedom},
                 {"degrees_of_freedom_of_point", finite_or_null(new_point_noise(noise).degrees_of_freedom)},
                 {"variance_factor", noise.variance_factor}};
  if (const auto& tracker = noise.tracker) {
    result["tracker"] = {tracker->range, tracker->range_per_metre, tracker->transverse, tracker->transverse_per_metre};
  }
  if (noise.orientation_length) {
    result["orientation_length"] = *noise.orientation_length;
  }
  for (std::size_t station = 0; station < noise.stations.size(); ++station) {
    const NoiseFactors& factors = noise.stations[station];
    result["stations"].push_back({{"name", stations[station]},
                                  {"sigma", noise.sigma_at(station)},
                                  {"factor", factors.length},
                                  {"orientation_factor", factors.orientation}});
  }
  if (noise.repeats) {
    result["repeats"] = {{"independent", array(noise.repeats->independent)},
                         {"common", array(noise.repeats->common)},
                         {"total", array(noise.repeats->total)},
                         {"degrees_of_freedom", noise.repeats->degrees_of_freedom}};
    if (noise.repeats->orientation_degrees_of_freedom > 0.0) {
      result["repeats"]["orientation"] = noise.repeats->orientation;
    }
  }
  return result;
}

Json priors_json(const Priors& priors) { return {{"length", priors.length}, {"angle", priors.angle}}; }

Json iso_json(const Iso9283& iso) {
  return {{"accuracy", statistics_json(iso.accuracy)}, {"repeatability", statistics_json(iso.repeatability)}};
}

Json interval_json(double value, double std, double degrees_of_freedom) {
  const double half = half_width_95(std, degrees_of_freedom);
  return std::isfinite(half) ? Json::array({value - half, value + half}) : Json(nullptr);
}

Json joint_offsets_json(const CalibrationResult& calibration, const JointConvention& convention) {
  Json joints = Json::array();
  for (const JointOffset& offset : joint_offsets(calibration, convention)) {
    joints.push_back(
        {{"joint", offset.joint}, {"unit", offset.slides ? "m" : "rad"}, {"measurable", offset.measurable}});
    if (offset.measurable) {
      joints.back().update({{"add", offset.add},
                            {"std", finite_or_null(offset.std)},
                            {"interval_95", interval_json(offset.add, offset.std, offset.degrees_of_freedom)}});
      if (calibration.offsets_alone) {
        joints.back()["add_if_only_these"] = offset.add_alone;
      }
    }
  }
  Json result = {{"joints", joints}};
  if (calibration.offsets_alone) {
    result["if_only_these"] = statistics_json(calibration.offsets_alone->accuracy);
  }
  return result;
}

Json cells_json(const std::vector<WorkspaceCell>& cells) {
  Json result = Json::array();
  for (const WorkspaceCell& cell : cells) {
    result.push_back({{"centre", array(cell.centre)}, {"count", cell.count}, {"mean", cell.mean}, {"max", cell.max}});
  }
  return result;
}

Json region_json(const MeasuredRegion& region) {
  Json joints = Json::array();
  for (const auto& [lower, upper] : region.joints) {
    joints.push_back({lower, upper});
  }
  return {
      {"joints", joints}, {"largest_variance", finite_or_null(region.largest_variance)}, {"unproved", region.unproved}};
}

// Directions of the parameters that the measurements do not determine.
Json undetermined_json(const Unknowns& candidates, const Eigen::MatrixXd& directions) {
  Json columns = Json::array();
  for (const auto& direction : directions.colwise()) {
    columns.push_back(std::vector<double>(direction.begin(), direction.end()));
  }
  return {{"names", candidates.names()}, {"directions", columns}};
}

Json finite_array(const Eigen::Vector3d& v) {
  return Json::array({finite_or_null(v.x()), finite_or_null(v.y()), finite_or_null(v.z())});
}

// `in_base`: whether W is the base frame, as the measurements have several frames.
Json asked_json(const std::vector<AskedPoint>& points, bool in_base) {
  Json result = Json::array();
  for (const AskedPoint& point : points) {
    Json intervals = Json::array();
    for (int axis = 0; axis < 3; ++axis) {
      intervals.push_back(interval_json(point.position_W[axis], point.std[axis], point.degrees_of_freedom));
    }
    result.push_back({{"configuration", point.configuration},
                      {"target", point.target},
                      {"position", array(point.position)},
                      {"position_nominal", array(point.nominal)},
                      {"position_measured_frame", in_base ? Json(nullptr) : array(point.position_W)},
                      {"std", finite_array(point.std)},
                      {"interval_95", intervals},
                      {"sigma", finite_or_null(point.sigma)},
                      {"outside", point.outside},
                      {"radius_95", finite_or_null(point.radius_95)}});
  }
  return result;
}

template <class Entry>
void add_influence(const Entry& entry, Json& result) {
  result["leverage"] = entry.leverage;
  result["high_leverage"] = entry.high_leverage;
  result["cook"] = finite_or_null(entry.cook);
  result["influential"] = entry.influential;
}

Json influence_json(const Influence& influence, const Measurements& measurements) {
  Json configurations = Json::array();
  for (const ConfigurationInfluence& entry : influence.configurations) {
    Json each = {{"configuration", measurements.configurations[static_cast<std::size_t>(entry.configuration)]}};
    add_influence(entry, each);
    Json points = Json::array();
    for (const PointInfluence& point : entry.points) {
      Json own = {{"target", measurements.targets[static_cast<std::size_t>(point.target)]}};
      add_influence(point, own);
      points.push_back(own);
    }
    each["points"] = points;
    configurations.push_back(each);
  }
  return {{"leverage_limit", influence.leverage_limit},
          {"cook_limit", influence.cook_limit},
          {"point_cook_limit", influence.point_cook_limit},
          {"configurations", configurations}};
}

Json subjects_json(const std::vector<Subject>& subjects) {
  Json result = Json::array();
  for (const Subject& subject : subjects) {
    result.push_back({{"kind", to_string(subject.kind)}, {"name", subject.name}});
  }
  return result;
}

Json figures_json(const std::vector<NamedFigure>& figures) {
  Json result = Json::object();
  for (const NamedFigure& figure : figures) {
    result[figure.name] = finite_or_null(figure.value);
  }
  return result;
}

Json doubts_json(const std::vector<Doubt>& doubts) {
  Json result = Json::array();
  for (const Doubt& doubt : doubts) {
    result.push_back({{"cause", to_string(doubt.cause)},
                      {"message", doubt.message},
                      {"subjects", subjects_json(doubt.subjects)},
                      {"figures", figures_json(doubt.figures)}});
  }
  return result;
}

// Without the messages, which are the warnings.
Json remarks_json(const std::vector<Remark>& remarks) {
  Json result = doubts_json(remarks);
  for (std::size_t i = 0; i < remarks.size(); ++i) {
    result[i].erase("message");
    result[i]["information"] = is_information(remarks[i].cause);
  }
  return result;
}

Json tried_json(const std::vector<ModelOption>& options) {
  Json tried = Json::array();
  for (const ModelOption& option : options) {
    tried.push_back({{"priors", priors_json(option.priors)},
                     {"effects", option.effects},
                     {"sized", option.sized},
                     {"held_out_rms", finite_or_null(option.held_out_rms)},
                     {"evidence", finite_or_null(option.evidence)}});
  }
  return tried;
}

// 3D 1 sigma of a new measured point about its prediction, by source.
Json budget_json(const NoiseReport& noise, const PredictedAccuracy& predicted) {
  const NewPointNoise of_point = new_point_noise(noise);
  const double factor = of_point.variance_factor;
  const double k = coverage_factor(std::max(1.0, of_point.degrees_of_freedom));
  const double point = factor * noise.independent.squaredNorm();
  const double repeat = factor * noise.common.squaredNorm();
  const double misfit = 3.0 * (noise.misfit * noise.misfit + noise.target_misfit * noise.target_misfit);
  const double parameters = predicted.unseen.count > 0 ? predicted.unseen.rms : kInfinity;
  const double assumptions = predicted.of_assumptions;
  const double total = std::sqrt(point + repeat + misfit + parameters * parameters + assumptions * assumptions);
  return {{"of_point", std::sqrt(point)},
          {"of_repeat", std::sqrt(repeat)},
          {"of_misfit", std::sqrt(misfit)},
          {"of_parameters", finite_or_null(parameters)},
          {"of_assumptions", assumptions},
          {"total", finite_or_null(total)},
          {"degrees_of_freedom", finite_or_null(of_point.degrees_of_freedom)},
          {"coverage_factor", k},
          {"expanded", finite_or_null(k * total)}};
}

Json new_point_json(const NewPointErrors& errors) {
  return {{"rows", errors.rows == NewPointErrors::Rows::left_out ? "left_out"
                   : errors.rows == NewPointErrors::Rows::test   ? "test"
                                                                 : "fitted"},
          {"of_coordinates", errors.of_coordinates},
          {"configurations", errors.configurations},
          {"coverage_factor", errors.coverage_factor},
          {"of_one", errors.of_one},
          {"compensated", errors.compensated},
          {"urdf_alone", errors.urdf_alone},
          {"nominal", errors.nominal}};
}

Json earlier_json(const EarlierComparison& comparison) {
  Json changes = Json::array();
  for (const auto& [name, change] : comparison.changes) {
    changes.push_back({{"name", name}, {"change", change}});
  }
  return {{"p_value", comparison.p_value},
          {"chi_square", comparison.chi_square},
          {"degrees_of_freedom", comparison.degrees_of_freedom},
          {"changes", changes},
          {"unseen_zeros", comparison.unseen_zeros}};
}

Json predicted_json(const PredictedAccuracy& predicted, const NoiseReport& noise, bool in_base) {
  Json result = {{"budget", budget_json(noise, predicted)},
                 {"measured", statistics_json(predicted.measured)},
                 {"unseen", statistics_json(predicted.unseen)},
                 {"workspace", statistics_json(predicted.workspace)},
                 {"cell", predicted.cell},
                 {"radius_factor", predicted.region.radius_factor},
                 {"region", region_json(predicted.region)},
                 {"cells", cells_json(predicted.cells)}};
  if (const TestedRadius& tested = predicted.tested; tested.configurations > 0) {
    result["tested"] = {
        {"configurations", tested.configurations}, {"outside", tested.outside}, {"p_value", tested.p_value}};
  }
  if (!predicted.asked.empty()) {
    result["asked"] = asked_json(predicted.asked, in_base);
  }
  return result;
}

// Adds what the measurements take as true, and the mistakes that they would have shown.
void add_assumptions(const CalibrationResult& calibration, Json& result) {
  if (calibration.distance_zero) {
    result["distance_zero"] = {{"length", calibration.distance_zero->length},
                               {"sigma", calibration.distance_zero->sigma}};
  }
  Json detectable = Json::array();
  for (const DetectableMistake& mistake : calibration.diagnosis.detectable) {
    detectable.push_back({{"cause", to_string(mistake.cause)},
                          {"subject", mistake.subject},
                          {"estimate", *mistake.unit != 0 ? Json(mistake.estimate) : Json(nullptr)},
                          {"unit", mistake.unit},
                          {"size", mistake.size},
                          {"moves", mistake.moves}});
  }
  result["detectable"] = detectable;
  result["assumed"] = {{"scale_sigma", calibration.settings.noise.scale_sigma},
                       {"length_sigma", calibration.settings.noise.length_sigma}};
}

// Adds model selection, lack of fit, predicted accuracy and down-weighted rows.
void add_details(const CalibrationResult& calibration, const Measurements& measurements, Json& result) {
  result["priors"] = priors_json(calibration.selection.priors);
  result["tried"] = tried_json(calibration.selection.tried);
  if (!calibration.selection.not_tried.empty()) {
    result["not_tried"] = in_words(calibration.selection.not_tried);
  }
  if (const auto& continued = calibration.selection.continued) {
    result["prior_result"] = earlier_json(continued->comparison);
  }
  const ObservabilityIndices& o = calibration.uncertainty.observability;
  result["observability"] = {{"O1", o.O1}, {"O2", o.O2}, {"O3", o.O3}, {"O4", o.O4}, {"O5", o.O5}};
  Json singular_values = Json::array();
  for (const double value : calibration.uncertainty.identifiability.singular_values) {
    singular_values.push_back(value);
  }
  result["singular_values"] = singular_values;
  result["tied"] = calibration.uncertainty.identifiability.tied;
  result["fixed_by_gauge"] = calibration.uncertainty.fixed_by_gauge;
  result["minimum_norm"] = calibration.fit.minimum_norm;
  result["weak"] = calibration.uncertainty.identifiability.weak;
  Json findings = Json::array();
  for (const QualityFinding& finding : calibration.diagnosis.findings) {
    findings.push_back({{"kind", to_string(finding.kind)},
                        {"configuration", finding.configuration},
                        {"repeat", finding.repeat},
                        {"targets", finding.targets},
                        {"axis", finding.axis == ' ' ? Json(nullptr) : Json(std::string(1, finding.axis))},
                        {"amount", finding.amount},
                        {"message", finding.message}});
  }
  result["findings"] = findings;
  add_assumptions(calibration, result);
  result["iso_9283"] = {{"before", iso_json(calibration.accuracy.iso_before)},
                        {"after", iso_json(calibration.accuracy.iso_after)}};
  if (calibration.accuracy.iso_test_before && calibration.accuracy.iso_test_after) {
    result["iso_9283"]["test"] = {{"before", iso_json(*calibration.accuracy.iso_test_before)},
                                  {"after", iso_json(*calibration.accuracy.iso_test_after)}};
  }
  if (calibration.noise.lack_of_fit) {
    const LackOfFit& lack = *calibration.noise.lack_of_fit;
    result["lack_of_fit"] = {{"F", lack.f},
                             {"degrees_of_freedom", lack.degrees_of_freedom},
                             {"repeat_degrees_of_freedom", lack.repeat_degrees_of_freedom},
                             {"p_value", lack.p_value},
                             {"explained_by_joint", lack.explained_by_joint}};
  }
  result["predicted_accuracy"] =
      predicted_json(calibration.uncertainty.predicted, calibration.noise, calibration.model.has_undetermined_bases);
  if (calibration.uncertainty.predicted.undetermined.cols() > 0) {
    result["undetermined"] =
        undetermined_json(calibration.fit.candidates, calibration.uncertainty.predicted.undetermined);
  }
  if (!calibration.uncertainty.influence.configurations.empty()) {
    result["influence"] = influence_json(calibration.uncertainty.influence, measurements);
  }
  if (!calibration.fit.robust.weights.empty()) {
    result["weights"] = calibration.fit.robust.weights;
  }
}

Json input_json(const Robot& robot, const Measurements& measurements, const CalibrationSettings& options) {
  return {{"urdf", robot.source},
          {"sha256", sha256(robot.urdf)},
          {"base", robot.base},
          {"tip", robot.tip},
          {"measurements", measurements.source},
          {"configurations", measurements.joint_values.cols()},
          {"observations", measurements.observations.size()},
          {"method", options.estimator.method == Method::joint ? "joint" : "two-step"},
          {"model", options.parameters.model == ModelChoice::irreducible ? "irreducible" : "complete"}};
}

Json parameters_json(const std::vector<ParameterEstimate>& parameters) {
  Json result = Json::array();
  for (const ParameterEstimate& parameter : parameters) {
    if (parameter.kind == ParameterKind::effect) {  // in a separate block
      continue;
    }
    result.push_back({{"name", parameter.name},
                      {"joint", parameter.joint.empty() ? Json(nullptr) : Json(parameter.joint)},
                      {"kind", to_string(parameter.kind)},
                      {"axis", parameter.axis},
                      {"nominal", parameter.nominal},
                      {"value", parameter.value},
                      {"error", parameter.error},
                      {"std", finite_or_null(parameter.std)},
                      {"degrees_of_freedom", finite_or_null(parameter.degrees_of_freedom)},
                      {"interval_95", parameter.identifiable
                                          ? interval_json(parameter.value, parameter.std, parameter.degrees_of_freedom)
                                          : Json(nullptr)},
                      {"identifiable", parameter.identifiable},
                      {"gauge", parameter.gauge}});
  }
  return result;
}

Json reduction_json(const Reduction& reduction) {
  Json dropped = Json::array();
  for (const DroppedParameter& parameter : reduction.dropped) {
    dropped.push_back({{"name", parameter.name}, {"replaced_by", parameter.replaced_by}});
  }
  Json gauge = Json::array();
  for (const GaugeParameter& parameter : reduction.gauge) {
    gauge.push_back({{"name", parameter.name}, {"tied_to", parameter.tied_to}});
  }
  return {{"dropped", dropped}, {"gauge", gauge}, {"candidates", reduction.candidates}, {"rank", reduction.rank}};
}

double std_of(const std::vector<ParameterEstimate>& parameters, const std::string& name) {
  for (const ParameterEstimate& parameter : parameters) {
    if (parameter.name == name) {
      return parameter.std;
    }
  }
  return 0.0;
}

Json targets_json(const CalibrationResult& calibration) {
  Json targets = Json::array();
  for (const TargetFrame& target : calibration.fit.identification.estimate.frames.targets) {
    Json entry = {{"name", target.name}, {"position", array(target.X_FT.translation())}};
    if (target.with_orientation) {
      entry["quaternion_wxyz"] = quaternion(target.X_FT.linear());
    }
    Json std = Json::array();
    for (const std::string& name : target_parameter_names(target)) {
      std.push_back(finite_or_null(std_of(calibration.uncertainty.parameters, name)));
    }
    entry["std"] = std;
    targets.push_back(entry);
  }
  return targets;
}

Json base_json(const CalibrationResult& calibration, std::size_t station) {
  const Eigen::Isometry3d& X_WB = calibration.fit.identification.estimate.frames.base(station);
  const std::vector<std::string> names = base_parameter_names(calibration.model);
  Json std = Json::array();
  for (std::size_t i = 6 * station; i < 6 * station + 6; ++i) {
    std.push_back(finite_or_null(std_of(calibration.uncertainty.parameters, names[i])));
  }
  return {{"position", array(X_WB.translation())}, {"quaternion_wxyz", quaternion(X_WB.linear())}, {"std", std}};
}

Json stations_json(const CalibrationResult& calibration) {
  Json stations = Json::array();
  for (std::size_t station = 0; station < calibration.model.stations.size(); ++station) {
    Json entry = {{"name", calibration.model.stations[station]}};
    entry.update(base_json(calibration, station));
    const Eigen::Vector3d origin =
        calibration.fit.identification.estimate.frames.base(station).inverse(Eigen::Isometry).translation();
    entry["origin_in_base"] = std::vector<double>(origin.begin(), origin.end());
    stations.push_back(entry);
  }
  return stations;
}

Json position_error_json(const Accuracy& accuracy) {
  Json position_error = {{"train", before_after_json(accuracy.train)}};
  if (accuracy.test) {
    position_error["test"] = before_after_json(*accuracy.test);
  }
  for (const auto& [name, means] :
       {std::pair{"train", &accuracy.train_means}, std::pair{"test", &accuracy.test_means}}) {
    if (*means) {
      position_error[name]["means"] = before_after_json(**means);
    }
  }
  for (const auto& [name, part] : {std::pair{"test_at_fitted_poses", &accuracy.test_at_fitted_poses},
                                   std::pair{"test_at_new_poses", &accuracy.test_at_new_poses}}) {
    if (*part) {
      position_error[name] = statistics_json(**part);
    }
  }
  if (accuracy.leave_one_out) {
    position_error["leave_one_out"] = before_after_json(*accuracy.leave_one_out);
  }
  if (accuracy.nested_leave_one_out) {
    position_error["nested_leave_one_out"] = statistics_json(*accuracy.nested_leave_one_out);
  }
  if (accuracy.k_fold) {
    position_error["k_fold"] = before_after_json(*accuracy.k_fold);
    position_error["k_fold"]["folds"] = accuracy.folds;
  }
  return position_error;
}

}  // namespace

std::string result_json(const Robot& robot, const Measurements& measurements, const CalibrationResult& calibration,
                        const Provenance& provenance) {
  check(calibration.fit.identification.estimate, calibration.model, measurements);
  const CalibrationSettings& options = calibration.settings;
  const Identification& found = calibration.fit.identification;
  Json result = {{"software", {{"name", "kdl_calibration"}, {"version", KDL_CALIBRATION_VERSION}}},
                 {"input", input_json(robot, measurements, options)},
                 {"termination", to_string(found.termination)},
                 {"message", found.message},
                 {"trusted", calibration.trusted()},
                 {"doubts", doubts_json(calibration.diagnosis.doubts)},
                 {"iterations", found.iterations},
                 {"history", found.rms_history},
                 {"rank", calibration.uncertainty.identifiability.rank},
                 {"condition", finite_or_null(calibration.uncertainty.identifiability.condition)}};
  if (calibration.diagnosis.reservation) {
    result["reservation"] = doubts_json({*calibration.diagnosis.reservation}).front();
  }
  if (options.estimator.method == Method::two_step) {
    result["convergence_factor"] = found.convergence_factor;
  }
  result["parameters"] = parameters_json(calibration.uncertainty.parameters);
  result["effects"] = effects_json(calibration, measurements);
  result["model"] = reduction_json(calibration.fit.reduction);
  if (calibration.model.kept_axes != KeptAxes::none) {
    result["kept_axes"] = kept_axes_json(calibration);
  }
  result["base"] = base_json(calibration, 0);
  if (calibration.model.has_undetermined_bases) {
    result["stations"] = stations_json(calibration);
  }
  result["targets"] = targets_json(calibration);
  result["position_error"] = position_error_json(calibration.accuracy);
  result["new_point"] = new_point_json(new_point_errors(calibration, measurements));
  if (const auto& convention = options.diagnosis.convention) {
    result["joint_offsets"] = joint_offsets_json(calibration, *convention);
  }
  result["exported_urdf"] = exported_urdf_json(robot, calibration);
  result["noise"] = noise_json(calibration.noise, calibration.model.stations);
  add_details(calibration, measurements, result);
  result["covariance"] = covariance_json(calibration);
  result["residuals"] = residuals_json(measurements, calibration);
  result["held_out_points"] = held_out_points_json(measurements, calibration);
  result["difference_to_kdl"] = calibration.difference_to_kdl;
  result["warnings"] = messages_of(calibration.diagnosis.remarks);
  result["remarks"] = remarks_json(calibration.diagnosis.remarks);
  result["provenance"] = provenance_json(provenance);
  result["hashes"] = tree::hashes(result);
  return result.dump(2, ' ', false, Json::error_handler_t::replace) + "\n";  // file names may not be UTF-8
}

std::string model_json(const ErrorModel& model, const std::vector<TargetFrame>& targets, const Reduction& reduction) {
  const std::set<std::string> kept(reduction.kept.begin(), reduction.kept.end());
  std::set<std::string> gauge;
  for (const GaugeParameter& parameter : reduction.gauge) {
    gauge.insert(parameter.name);
  }
  Json parameters = Json::array();
  const auto add = [&](const std::string& name, const std::string& joint, const char* kind, char axis, double nominal) {
    if (kept.count(name) > 0 || gauge.count(name) > 0) {
      parameters.push_back({{"name", name},
                            {"joint", joint.empty() ? Json(nullptr) : Json(joint)},
                            {"kind", kind},
                            {"axis", axis == 'q' ? "" : std::string(1, axis)},
                            {"nominal", nominal},
                            {"identifiable", kept.count(name) > 0},
                            {"gauge", gauge.count(name) > 0}});
    }
  };
  const auto add_frame = [&](const std::vector<std::string>& names) {
    for (std::size_t i = 0; i < names.size(); ++i) {
      add(names[i], "", i < 3 ? "translation" : "rotation", static_cast<char>('x' + i % 3), 0.0);
    }
  };
  add_frame(base_parameter_names());
  for (const TargetFrame& target : targets) {
    add_frame(target_parameter_names(target));
  }
  for (const ErrorParameter& parameter : model.parameters) {
    add(parameter.name, parameter.joint, to_string(parameter.kind), parameter.axis, parameter.nominal);
  }
  Json result = {{"parameters", parameters}};
  result.update(reduction_json(reduction));
  return result.dump(2) + "\n";
}

}  // namespace kdl_calibration
