#include "results/report_page.hpp"

#include <array>
#include <utility>
#include <vector>

#include "base/json_reading.hpp"
#include "base/json_tree.hpp"
#include "base/sha256.hpp"
#include "estimation/identification.hpp"
#include "estimation/input_check.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/readings.hpp"
#include "results/report_blocks.hpp"
#include "results/report_files.hpp"

namespace kdl_calibration {
namespace {

// Escapes `<` in JSON, so that no name can end the page's data element.
std::string escaped(const std::string& json) {
  std::string result;
  result.reserve(json.size());
  for (const char c : json) {
    if (c == '<') {
      result += "\\u003c";
    } else {
      result += c;
    }
  }
  return result;
}

// Replaces each placeholder once, without searching inserted text.
std::string filled_in(std::string_view html,
                      const std::array<std::pair<std::string_view, std::string_view>, 3>& parts) {
  std::string page;
  std::size_t at = 0;
  while (at < html.size()) {
    std::size_t next = html.size();
    const std::pair<std::string_view, std::string_view>* found = nullptr;
    for (const auto& part : parts) {
      const std::size_t place = html.find(part.first, at);
      if (place < next) {
        next = place;
        found = &part;
      }
    }
    page += html.substr(at, next - at);
    at = next;
    if (found != nullptr) {
      page += found->second;
      at += found->first.size();
    }
  }
  return page;
}

std::string page_of(const Json& data) {
  const std::string json = escaped(data.dump(-1, ' ', false, Json::error_handler_t::replace));
  return filled_in(report_html(),
                   {{{"{{style}}", report_style()}, {"{{script}}", report_script()}, {"{{data}}", json}}});
}

// Keeps the shown rows of a result and notes whether these are all.
void shorten_residuals(const std::vector<std::size_t>& shown, Json& residuals) {
  if (!residuals.contains("rows") || !residuals["rows"].is_array()) {
    residuals["complete"] = false;
    return;
  }
  Json rows = Json::array();
  for (const std::size_t row : shown) {
    rows.push_back(residuals["rows"][row]);
  }
  residuals["complete"] = rows.size() == residuals["rows"].size();
  residuals["rows"] = std::move(rows);
}

// Drops the influence of single points if there are many configurations, to limit the page's size.
void shorten_influence(Json& influence) {
  constexpr std::size_t kMostWithPoints = 1000;
  const bool complete = influence.at("configurations").size() <= kMostWithPoints;
  if (!complete) {
    for (Json& configuration : influence.at("configurations")) {
      configuration.erase("points");
    }
  }
  influence["complete"] = complete;
}

std::vector<double> distances_of_rows(const Json& residuals) {
  std::vector<double> distances;
  if (residuals.contains("rows")) {
    for (const Json& row : residuals["rows"]) {
      distances.push_back(row.is_object() && row.contains("distance") && row["distance"].is_number()
                              ? row["distance"].get<double>()
                              : 0.0);
    }
  }
  return distances;
}

// Texts for sections without data, by the missing input.
Json missing_json(const CalibrationPage& page) {
  Json missing = Json::object();
  if (page.robot == nullptr) {
    missing["robot"] = "The picture needs the URDF, which was not given when this page was made.";
  }
  if (page.measurements == nullptr) {
    missing["measurements"] = "This needs the measurements, which were not given when this page was made.";
  }
  return missing;
}

void require_result(const Json& result, const std::string& source) {
  for (const char* key : {"trusted", "parameters", "position_error"}) {
    if (!result.is_object() || !result.contains(key)) {
      throw InputError(source + ": has no '" + key + "', expected a result that calibrate wrote");
    }
  }
}

}  // namespace

std::string report_page(std::string_view data) { return page_of(tree::parsed(data, "page")); }

std::string reported_robot(const Robot& robot, const ErrorModel& model, const Estimate& estimate) {
  return robot_block(robot, model, estimate).dump();
}

std::string reported_joints(const ErrorModel& model, const Eigen::MatrixXd& q, const JointConvention& convention) {
  const ShownJoints shown = shown_joints(model, q, convention);
  Json values = Json::array();
  for (const auto& column : shown.values.colwise()) {
    values.push_back(std::vector<double>(column.begin(), column.end()));
  }
  return Json{{"joints", shown.joints}, {"values", values}}.dump();
}

std::string reported_measurements(const ReportedMeasurements& reported) {
  check(reported.estimate, reported.model, reported.measurements);
  if (reported.before != nullptr) {
    check(*reported.before, reported.model, reported.measurements);
  }
  return measurements_block(reported).dump();
}

namespace {

Json calibration_data(const CalibrationPage& page, Json result) {
  Json data = {{"kind", "calibration"}};
  if (result.contains("covariance") && result["covariance"].is_object()) {
    data["correlations"] = correlations_block(result["covariance"]);
  }
  if (page.robot != nullptr) {
    const CalibrationParts saved = parse_calibration(page.result, *page.robot, page.source, page.own);
    data["robot"] = robot_block(*page.robot, saved.model, saved.estimate);
    if (page.measurements != nullptr) {
      const double zero = result.contains("distance_zero") ? result["distance_zero"]["length"].get<double>() : 0.0;
      const FromZero measured(*page.measurements, zero);
      const Estimate before = nominal_start(saved.model, *measured, {.known = page.known});
      data["measured"] = measurements_block({.model = saved.model,
                                             .estimate = saved.estimate,
                                             .measurements = *measured,
                                             .before = &before,
                                             .convention = page.convention,
                                             .X_BK = page.X_BK});
      data["effects"] = effects_block(saved, *page.measurements);
    }
  }
  result.erase("covariance");
  result.erase("hashes");  // no longer valid for shortened blocks
  if (result.contains("residuals") && result["residuals"].is_object()) {
    shorten_residuals(shown_rows(distances_of_rows(result["residuals"])), result["residuals"]);
  }
  if (result.contains("influence") && result["influence"].is_object()) {
    shorten_influence(result["influence"]);
  }
  data["missing"] = missing_json(page);
  data["plan_command"] = page.plan_command;
  data["apply_command"] = page.apply_command;
  data["cures"] = Json::object();
  for (const auto& [cause, cure] : page.cures) {
    data["cures"][to_string(cause)] = cure;
  }
  if (!page.paper.empty()) {
    data["paper"] = page.paper;
  }
  data["sha256"] = sha256(page.result);
  data["result"] = std::move(result);
  return data;
}

}  // namespace

std::string calibration_page(const CalibrationPage& page) {
  Json result = tree::parsed(page.result, page.source);
  require_result(result, page.source);
  try {
    return page_of(calibration_data(page, std::move(result)));
  } catch (const Json::exception&) {
    throw InputError(page.source + ": is not as calibrate writes it, expected a result that nobody changed");
  }
}

}  // namespace kdl_calibration
