#include "results/result_blocks.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "base/csv.hpp"
#include "base/number_text.hpp"
#include "base/sha256.hpp"
#include "estimation/input_check.hpp"
#include "estimation/prediction.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "model/kept_axes.hpp"
#include "results/calibrated_urdf.hpp"

namespace kdl_calibration {
namespace {

const char* split_name(const Observation& observation) { return observation.split == Split::train ? "train" : "test"; }

// Empty cell if not finite.
std::string csv_number(double value) { return std::isfinite(value) ? shortest(value) : std::string(); }

Json frame_block(const Eigen::Isometry3d& frame, bool with_orientation) {
  Json result = {{"position", array(frame.translation())}};
  if (with_orientation) {
    result["quaternion_wxyz"] = quaternion(frame.linear());
  }
  return result;
}

std::vector<Eigen::Vector3d> residuals_of_fit(const Measurements& measurements, const CalibrationResult& calibration) {
  const FromZero fitted(measurements, calibration.distance_zero ? calibration.distance_zero->length : 0.0);
  return residuals_of(calibration.model, calibration.fit.identification.estimate, *fitted);
}

// Null if not finite.
Json array_or_null(const Eigen::Vector3d& v) { return v.allFinite() ? array(v) : Json(nullptr); }

}  // namespace

std::string in_words(const std::vector<NotTried>& choices) {
  std::string text;
  for (const NotTried& choice : choices) {
    text += (text.empty() ? "" : "; ") + choice.what + " (" + choice.why + ")";
  }
  return text;
}

Json files_json(const std::vector<HashedFile>& files) {
  Json result = Json::array();
  for (const HashedFile& file : files) {
    result.push_back({{"role", file.role}, {"path", file.path}, {"sha256", file.sha256}});
  }
  return result;
}

Json array(const Eigen::Vector3d& v) { return Json::array({v.x(), v.y(), v.z()}); }

Json frame12(const Eigen::Isometry3d& frame) {
  Json result = Json::array();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 4; ++column) {
      result.push_back(frame.matrix()(row, column));
    }
  }
  return result;
}

Json quaternion(const Eigen::Matrix3d& R) {
  const Eigen::Quaterniond q(R);
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  return Json::array({sign * q.w(), sign * q.x(), sign * q.y(), sign * q.z()});
}

Json finite_or_null(double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); }

Json statistics_json(const ErrorStatistics& statistics) {
  if (statistics.count == 0) {
    return nullptr;
  }
  return {{"count", statistics.count}, {"mean", statistics.mean}, {"rms", statistics.rms},
          {"p95", statistics.p95},     {"max", statistics.max},   {"std", statistics.std}};
}

Json covariance_json(const CalibrationResult& calibration) {
  const std::vector<std::string> names = calibration.fit.free.names();
  if (names.size() > kMostColumns ||
      static_cast<std::size_t>(calibration.uncertainty.covariance.rows()) != names.size()) {
    return nullptr;
  }
  Json rows = Json::array();
  Json lower = Json::array();
  const Eigen::MatrixXd symmetric = calibration.uncertainty.covariance.selfadjointView<Eigen::Lower>();
  for (const auto& covariances : symmetric.rowwise()) {
    Json row = Json::array();
    for (const double value : covariances) {
      row.push_back(finite_or_null(value));
    }
    rows.push_back(row);
    row.erase(row.begin() + static_cast<std::ptrdiff_t>(rows.size()), row.end());
    lower.push_back(row);
  }
  Json shifts = Json::array();
  for (const auto& shift : calibration.uncertainty.shifts.colwise()) {
    shifts.push_back(std::vector<double>(shift.begin(), shift.end()));
  }
  return {{"names", names}, {"lower_triangle", lower}, {"matrix", rows}, {"shifts", shifts}};
}

Json residuals_json(const Measurements& measurements, const CalibrationResult& calibration) {
  const std::vector<Eigen::Vector3d> all = residuals_of_fit(measurements, calibration);
  std::vector<double> distances(all.size());
  std::transform(all.begin(), all.end(), distances.begin(), [](const Eigen::Vector3d& e) { return e.norm(); });
  std::vector<std::size_t> shown(all.size());
  std::iota(shown.begin(), shown.end(), std::size_t{0});
  if (all.size() > kMostRows) {
    const auto end = shown.begin() + kLargestRows;
    std::partial_sort(shown.begin(), end, shown.end(), [&](std::size_t a, std::size_t b) {
      return distances[a] != distances[b] ? distances[a] > distances[b] : a < b;
    });
    shown.erase(end, shown.end());
  }
  Json rows = Json::array();
  for (const std::size_t i : shown) {
    const Observation& observation = measurements.observations[i];
    rows.push_back({{"configuration", measurements.configurations[static_cast<std::size_t>(observation.configuration)]},
                    {"repeat", observation.repeat},
                    {"target", measurements.targets[static_cast<std::size_t>(observation.target)]},
                    {"split", split_name(observation)},
                    {"residual", array(all[i])},
                    {"distance", distances[i]}});
  }
  return {{"statistics", statistics_json(error_statistics(distances))},
          {all.size() > kMostRows ? "largest" : "rows", rows}};
}

Json held_out_points_json(const Measurements& measurements, const CalibrationResult& calibration) {
  const std::vector<HeldOutPoint>& points = calibration.held_out_points;
  if (points.empty() || points.size() > kMostRows) {
    return nullptr;
  }
  Json result = Json::array();
  for (const HeldOutPoint& point : points) {
    result.push_back({{"configuration", measurements.configurations[static_cast<std::size_t>(point.configuration)]},
                      {"target", measurements.targets[static_cast<std::size_t>(point.target)]},
                      {"residual", array_or_null(point.residual)},
                      {"distance", finite_or_null(point.residual.norm())}});
  }
  return result;
}

std::string residuals_csv(const Measurements& measurements, const CalibrationResult& calibration) {
  check(calibration.fit.identification.estimate, calibration.model, measurements);
  const std::vector<Eigen::Vector3d> all = residuals_of_fit(measurements, calibration);
  const bool several = measurements.stations.size() > 1;
  std::string csv = "configuration,repeat,target,split,";
  csv += several ? "station,dx[m],dy[m],dz[m],distance[m]\n" : "dx[m],dy[m],dz[m],distance[m]\n";
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Observation& observation = measurements.observations[i];
    csv += csv_field(measurements.configurations[static_cast<std::size_t>(observation.configuration)]) + "," +
           std::to_string(observation.repeat) + "," +
           csv_field(measurements.targets[static_cast<std::size_t>(observation.target)]) + "," +
           split_name(observation) + (several ? "," + csv_field(measurements.stations[station_of(observation)]) : "");
    for (const double value : {all[i].x(), all[i].y(), all[i].z(), all[i].norm()}) {
      csv += "," + csv_number(value);
    }
    csv += "\n";
  }
  return csv;
}

std::string covariance_csv(const CalibrationResult& calibration) {
  const std::vector<std::string> names = calibration.fit.free.names();
  std::string csv = "parameter";
  for (const std::string& name : names) {
    csv += "," + csv_field(name);
  }
  csv += "\n";
  for (std::size_t r = 0; r < names.size(); ++r) {
    csv += csv_field(names[r]);
    for (Eigen::Index c = 0; c < calibration.uncertainty.covariance.cols(); ++c) {
      csv += "," + csv_number(calibration.uncertainty.covariance(static_cast<Eigen::Index>(r), c));
    }
    csv += "\n";
  }
  return csv;
}

Json exported_urdf_json(const Robot& robot, const CalibrationResult& calibration) {
  const ExportedUrdf& exported = calibration.exported;
  Json parameters = Json::array();
  for (std::size_t p = 0; p < calibration.model.parameters.size(); ++p) {
    const ErrorParameter& parameter = calibration.model.parameters[p];
    const double error = exported.estimate.errors[static_cast<Eigen::Index>(p)];
    if (error != 0.0) {
      parameters.push_back({{"name", parameter.name},
                            {"nominal", parameter.nominal},
                            {"value", parameter.nominal + error},
                            {"error", error}});
    }
  }
  Json targets = Json::array();
  for (const TargetFrame& target : exported.estimate.frames.targets) {
    Json entry = {{"name", target.name}};
    entry.update(frame_block(target.X_FT, target.with_orientation));
    targets.push_back(entry);
  }
  Json hash = nullptr;
  try {
    hash = sha256(calibrated_urdf(robot, calibration));
  } catch (const InputError&) {  // no URDF can represent the errors of the last link
  }
  return {{"parameters", parameters},
          {"base", frame_block(exported.estimate.frames.base(), true)},
          {"targets", targets},
          {"position_error",
           {{"train", statistics_json(exported.train)},
            {"test", exported.test ? statistics_json(*exported.test) : Json(nullptr)},
            {"held_out", exported.held_out ? statistics_json(*exported.held_out) : Json(nullptr)}}},
          {"nominal_kept", exported.nominal_kept},
          {"sha256", hash}};
}

namespace {

Json after_json(const BeforeAfter& errors) {
  return {{"after", statistics_json(errors.after)},
          {"exported_urdf", statistics_json(errors.rigid.value_or(errors.after))}};
}

}  // namespace

Json kept_axes_json(const CalibrationResult& calibration) {
  const ErrorModel& model = calibration.model;
  const AxisRelations relations = axis_relations(model.joints, model.kept_axes);
  Json result = {{"kept", to_string(model.kept_axes)},
                 {"parallel", joint_names(relations.parallel, model.joints)},
                 {"meeting", joint_names(relations.meeting, model.joints)}};
  if (const std::optional<FreeAxes>& free = calibration.free_axes) {
    const bool known = free->not_computed.empty();
    result["without"] = {{"not_computed", known ? Json(nullptr) : Json(free->not_computed)},
                         {"train", known ? after_json(free->train) : Json(nullptr)},
                         {"held_out", free->held_out ? after_json(*free->held_out) : Json(nullptr)}};
  }
  return result;
}

bool is_information(Cause cause) {
  switch (cause) {
    case Cause::file_interpreted:
    case Cause::single_coordinates:
    case Cause::points_not_compared:
    case Cause::neighbours_left_out:
    case Cause::held_as_registered:
    case Cause::smallest_errors:
    case Cause::distances_corrected:
      return true;
    default:
      return false;
  }
}

Json provenance_json(const Provenance& provenance) {
  Json notes = Json::object();
  for (const auto& [key, value] : provenance.notes) {
    notes[key] = value;
  }
  Json options = Json::object();
  for (const auto& [key, value] : provenance.options) {
    options[key] = value;
  }
  return {{"notes", notes},
          {"options", options},
          {"planned_cell", provenance.planned_cell},
          {"files_read", files_json(provenance.files_read)},
          {"files_written", files_json(provenance.files_written)}};
}

}  // namespace kdl_calibration
