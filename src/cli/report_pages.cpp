#include "cli/report_pages.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>

#include "cli/truth_report.hpp"
#include "model/kinematics.hpp"
#include "results/result_blocks.hpp"

namespace kdl_calibration::cli {
namespace {

Json page_data(const char* kind, const Json& result) {
  return {{"kind", kind},
          {"software", {{"name", "kdl_calibration"}, {"version", KDL_CALIBRATION_VERSION}}},
          {"result", result}};
}

Json setup_json(const PageFacts& setup) {
  Json list = Json::array();
  for (const auto& [key, value] : setup) {
    list.push_back({key, value});
  }
  return list;
}

Json block(const std::string& text) { return json_of(text, "the page"); }

std::string page_of(const Json& data) { return report_page(data.dump(-1, ' ', false, Json::error_handler_t::replace)); }

Json sample_json(const ErrorStatistics& statistics, const std::vector<double>& values) {
  return {{"count", statistics.count}, {"values", values}};
}

Json places_json(const std::vector<Eigen::Isometry3d>& poses) {
  Json list = Json::array();
  for (const Eigen::Isometry3d& pose : poses) {
    list.push_back(position_json(pose.translation()));
  }
  return list;
}

// The boxes and spheres of a cell in the base frame. Sides that are open are drawn far away.
Json zones_json(const Cell& cell) {
  constexpr double kFar = 20.0;  // [m]
  Json zones = Json::array();
  const auto add = [&](const std::string& name, const char* kind, const Box& box) {
    zones.push_back({{"name", name},
                     {"kind", kind},
                     {"lower", position_json(box.lower.cwiseMax(-kFar))},
                     {"upper", position_json(box.upper.cwiseMin(kFar))}});
  };
  if (cell.box.lower.array().isFinite().any() || cell.box.upper.array().isFinite().any()) {
    add("targets stay in", "after", cell.box);
  }
  for (std::size_t i = 0; i < cell.out_boxes.size(); ++i) {
    add("keep-out box " + std::to_string(i + 1), "mark", cell.out_boxes[i]);
  }
  for (std::size_t i = 0; i < cell.out_spheres.size(); ++i) {
    zones.push_back({{"name", "keep-out sphere " + std::to_string(i + 1)},
                     {"kind", "mark"},
                     {"centre", position_json(cell.out_spheres[i].center)},
                     {"radius", cell.out_spheres[i].radius}});
  }
  return zones;
}

// The targets in each configuration, in the base frame.
Json beams_json(const std::vector<Eigen::Isometry3d>& flanges, const std::vector<TargetFrame>& targets) {
  Json list = Json::array();
  for (const Eigen::Isometry3d& X_BF : flanges) {
    Json ends = Json::array();
    for (const TargetFrame& target : targets) {
      ends.push_back(position_json(X_BF * target.X_FT.translation()));
    }
    list.push_back(ends);
  }
  return list;
}

// Evenly spaced candidates that were not chosen.
std::vector<Eigen::Index> rejected(const PlanRequest& request, const Plan& plan) {
  constexpr Eigen::Index kMost = 1500;
  const std::set<Eigen::Index> chosen(plan.selection.chosen.begin(), plan.selection.chosen.end());
  const Eigen::Index count = request.candidates;
  std::vector<Eigen::Index> result;
  for (Eigen::Index i = 0; i < std::min(kMost, count); ++i) {
    const Eigen::Index candidate = i * count / std::min(kMost, count);
    if (chosen.count(candidate) == 0) {
      result.push_back(candidate);
    }
  }
  return result;
}

}  // namespace

Json with_files(Json result, const RobotArguments& arguments, const Robot& robot, const FileRoles& files) {
  result["input"].update({{"urdf", robot.source}, {"base", robot.base}, {"tip", robot.tip}});
  result["provenance"] = {{"files_read", files_json(hashed_files(arguments, robot, files))}};
  return result;
}

std::string monte_carlo_page(const Json& result, const MonteCarlo& experiment, const MonteCarloResult& runs,
                             const PageFacts& setup) {
  Json data = page_data("monte_carlo", result);
  data["setup"] = setup_json(setup);
  data["distributions"] = {{"all", sample_json(runs.all, runs.all_errors)},
                           {"means", sample_json(runs.means, runs.mean_errors)},
                           {"maxima", sample_json(runs.maxima, runs.largest_errors)}};
  const std::vector<double> predicted = predicted_errors(experiment);
  data["predicted"] = {{"count", predicted.size()}, {"values", predicted}};
  return page_of(data);
}

std::string two_step_page(const Json& result, const Json& other, const PageFacts& setup) {
  Json data = page_data("two_step", result);
  data["setup"] = setup_json(setup);
  data["other"] = other;
  return page_of(data);
}

std::string plan_page(const Json& result, const PlanPage& page) {
  const auto& [request, plan, setup, convention, frame, X_BW] = page;
  Json data = page_data("plan", result);
  data["setup"] = setup_json(setup);
  const ErrorModel& model = plan.experiment.model;
  const Estimate nominal{.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size())),
                         .frames = {.targets = plan.experiment.targets},
                         .effects = {}};
  data["robot"] = block(reported_robot(request.robot, model, nominal));
  const FoldedChain chain = folded(model, nominal.errors);
  Json configurations = Json::array();
  for (std::size_t c = 0; c < plan.sheet.configurations.size(); ++c) {
    const Eigen::VectorXd q = plan.sheet.joint_values.col(static_cast<Eigen::Index>(c));
    configurations.push_back(
        {{"name", plan.sheet.configurations[c]}, {"joint_values", std::vector<double>(q.begin(), q.end())}});
  }
  if (convention != nullptr) {
    const Json shown = block(reported_joints(model, plan.sheet.joint_values, *convention));
    data["joints"] = shown["joints"];
    for (std::size_t c = 0; c < configurations.size(); ++c) {
      configurations[c]["controller"] = shown["values"][c];
    }
  }
  data["configurations"] = configurations;
  data["chosen"] = places_json(flange_poses(chain, plan.sheet.joint_values));
  data["rejected"] =
      places_json(flange_poses(chain, plan.drawn.joint_values(Eigen::all, rejected(request, plan)).eval()));
  data["axes"] = {{"name", frame}, {"pose", frame12(X_BW)}};
  data["zones"] = zones_json(request.cell);
  data["beams"] = beams_json(flange_poses(chain, plan.sheet.joint_values), plan.experiment.targets);
  if (request.cell.tracker) {
    data["tracker"] = position_json(request.cell.tracker->position);
  }
  Json counted = Json::array();
  for (const CountedAccuracy& entry : accuracy_by_count(request, plan)) {
    const auto finite = [](double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); };
    counted.push_back({{"count", entry.count}, {"plan", finite(entry.plan)}, {"random", finite(entry.random)}});
  }
  data["by_count"] = counted;
  return page_of(data);
}

std::string page_of_result(const char* kind, const Json& result, const Json& more) {
  Json data = page_data(kind, result);
  data.update(more);
  return page_of(data);
}

std::string validation_page(const ValidationPage& page) {
  return page_of_result("validation", page.result,
                        {{"requirements", page.requirements},
                         {"doubts", page.doubts},
                         {"warnings", page.warnings},
                         {"robot", block(reported_robot(page.robot, page.reported.model, page.reported.estimate))},
                         {"measured", block(reported_measurements(page.reported))}});
}

}  // namespace kdl_calibration::cli
