#include "cli/plan_summary.hpp"

#include <fmt/core.h>
#include <cmath>
#include <string>
#include <vector>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "cli/frames.hpp"
#include "cli/text.hpp"
#include "planning/places_plan.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

using Eigen::Index;

Json prediction_json(const Prediction& prediction, double worst_configuration) {
  const auto finite = [](double value) { return std::isfinite(value) ? Json(value) : Json(nullptr); };
  return {{"mean", finite(prediction.sigma.mean)},
          {"p95", finite(prediction.sigma.p95)},
          {"max", finite(prediction.sigma.max)},
          {"worst_configuration_rms", finite(worst_configuration)}};
}

Json monte_carlo_summary(const MonteCarloResult& result) {
  return {{"runs", result.runs},
          {"not_trusted", result.not_trusted},
          {"held_out_error",
           {{"mean", result.all.mean}, {"rms", result.all.rms}, {"p95", result.all.p95}, {"max", result.all.max}}},
          {"rms_of_point_mean", result.rms.mean()},
          {"rms_of_point_max", result.rms.maxCoeff()}};
}

std::vector<std::string> effect_names(const Experiment& experiment) {
  std::vector<std::string> names;
  for (const EffectTerm& term : experiment.model.effects) {
    names.push_back(term.name);
  }
  return names;
}

std::string line(const std::string& label, const Prediction& prediction, double worst) {
  std::string text = fmt::format("{:<24}", label);
  for (const double value : {prediction.sigma.mean, prediction.sigma.p95, prediction.sigma.max, worst}) {
    text += std::isfinite(value) ? fmt::format("{:>10.4f}", value * 1e3) : "         -";
  }
  return text + "\n";
}

}  // namespace

std::string json_of_plan(const PlanArguments& arguments, const PlanSetting& setting, const Plan& plan) {
  Json refusals = Json::array();
  for (const Refusals& entry : plan.drawn.refusals) {
    refusals.push_back({{"constraint", entry.constraint}, {"samples", entry.samples}, {"alone", entry.alone}});
    if (!entry.links.empty()) {
      refusals.back()["links"] = entry.links;
    }
  }
  Json configurations = Json::array();
  for (std::size_t c = 0; c < plan.sheet.configurations.size(); ++c) {
    const Eigen::VectorXd q =
        independent_joint_values(setting.request.robot.joints, plan.sheet.joint_values.col(static_cast<Index>(c)));
    configurations.push_back(
        {{"configuration", plan.sheet.configurations[c]}, {"joints", std::vector<double>(q.begin(), q.end())}});
  }
  const ObservabilityIndices& o = plan.observability;
  Json result = {
      {"criterion", arguments.criterion},
      {"parameters", columns(plan.experiment)},
      {"effects", effect_names(plan.experiment)},
      {"targets", plan.sheet.targets.size()},
      {"candidates", {{"count", arguments.candidates}, {"samples", plan.drawn.samples}, {"refused", refusals}}},
      {"exchanges", plan.selection.exchanges},
      {"observability", {{"O1", o.O1}, {"O2", o.O2}, {"O3", o.O3}, {"O4", o.O4}, {"O5", o.O5}}},
      {"d_efficiency", plan.efficiency},
      {"sigma",
       {{"plan", prediction_json(plan.planned, plan.worst_configuration)},
        {"random", prediction_json(plan.random, plan.random.worst_configuration)},
        {"floor", plan.floor ? Json(*plan.floor) : Json(nullptr)}}},
      {"travel_seconds", plan.seconds},
      {"configurations", configurations}};
  if (has_places(arguments.cell)) {
    result["frame"] = frame_json(setting.X_BW);
  }
  if (plan.monte_carlo) {
    result["monte_carlo"] = monte_carlo_summary(*plan.monte_carlo);
  }
  return json_text(result);
}

std::string table_of_plan(const PlanArguments& arguments, const PlanSetting& setting, const Plan& plan) {
  const ObservabilityIndices& o = plan.observability;
  const std::size_t effects = plan.experiment.model.effects.size();
  std::string text = fmt::format(
      "{} configurations of {} candidates, {}-optimal; {} targets, {} parameters{}, noise {}\n"
      "search                  {} starts, {} exchanges; seed {}\n"
      "samples                 {} drawn",
      plan.selection.chosen.size(), arguments.candidates, arguments.criterion, plan.sheet.targets.size(),
      columns(plan.experiment), effects == 0 ? "" : fmt::format(", {} of effects", effects),
      plan.experiment.noise.tracker ? "of the tracker" : fixed(arguments.noise.sigma * 1e3, 4) + " mm",
      arguments.starts, plan.selection.exchanges, arguments.seed, plan.drawn.samples);
  for (const Refusals& entry : plan.drawn.refusals) {
    text += fmt::format("; {} removes {}{}", entry.constraint, entry.samples,
                        entry.links.empty() ? "" : ", mostly between " + entry.links);
  }
  text += "\n" + places_text(arguments.cell, setting.request.cell, setting.request.robot.base, setting.X_BW);
  text += "predicted 1 sigma [mm]        mean       p95       max  worst RMS of a configuration\n";
  text += line("  this plan", plan.planned, plan.worst_configuration);
  text += line("  random choice", plan.random, plan.random.worst_configuration);
  if (plan.floor) {
    text += fmt::format("{:<54}{:>10.4f}\n", "  lower bound for any plan", *plan.floor * 1e3);
  }
  text += fmt::format(
      "observability           O1 {:.4f}, O2 {:.5f}, O3 {:.4f}, O4 {:.5f}, O5 {:.5f} (m, rad)\n"
      "D-efficiency            at least {:.3f}\n"
      "travel                  {:.0f} s at full speed, without the stops\n",
      o.O1, o.O2, o.O3, o.O4, o.O5, plan.efficiency, plan.seconds);
  if (plan.monte_carlo) {
    const MonteCarloResult& runs = *plan.monte_carlo;
    text += fmt::format(
        "Monte Carlo             {} runs, {} not to be trusted; held-out error [mm] mean {:.4f}, p95 {:.4f}, max "
        "{:.4f}; RMS of a point, mean {:.4f}\n",
        runs.runs, runs.not_trusted, runs.all.mean * 1e3, runs.all.p95 * 1e3, runs.all.max * 1e3,
        runs.rms.mean() * 1e3);
  }
  return text;
}

std::string json_of_plan(const PlanArguments& arguments, const PlanSetting& setting, const PlacesPlan& plan) {
  Json stations = Json::array();
  const std::vector<std::string>& names = plan.rows.measurements.stations;
  for (std::size_t s = 0; s < names.size(); ++s) {
    stations.push_back({{"name", names[s]}, {"determined_directions", plan.determined.bases[s]}});
    stations.back().update(frame_json(plan.rows.robot.truth.frames.base(s).inverse()));
  }
  Json configurations = Json::array();
  for (std::size_t c = 0; c < plan.sheet.configurations.size(); ++c) {
    const Eigen::VectorXd q =
        independent_joint_values(setting.request.robot.joints, plan.sheet.joint_values.col(static_cast<Index>(c)));
    configurations.push_back({{"configuration", plan.sheet.configurations[c]},
                              {"station", plan.sheet.stations[c]},
                              {"joints", std::vector<double>(q.begin(), q.end())}});
  }
  Json result = {{"criterion", arguments.criterion},
                 {"parameters", plan.determined.arm.columns},
                 {"targets", plan.sheet.targets.size()},
                 {"stations", stations},
                 {"sigma",
                  {{"plan", prediction_json(plan.planned, plan.planned.worst_configuration)},
                   {"random", prediction_json(plan.random, plan.random.worst_configuration)}}},
                 {"travel_seconds", plan.seconds},
                 {"configurations", configurations}};
  if (has_places(arguments.cell)) {
    result["frame"] = frame_json(setting.X_BW);
  }
  return json_text(result);
}

std::string table_of_plan(const PlanArguments& arguments, const PlanSetting& setting, const PlacesPlan& plan) {
  const std::vector<std::string>& stations = plan.rows.measurements.stations;
  std::string text = fmt::format(
      "{} configurations shared evenly by {} {}, the best of {} draws of stations; {} parameters of the arm, noise {} "
      "mm\n",
      plan.sheet.configurations.size(), stations.size(), stations.size() > 1 ? "stations" : "station", arguments.starts,
      plan.determined.arm.columns, fixed(arguments.noise.sigma * 1e3, 4));
  text += "predicted 1 sigma [mm]        mean       p95       max  worst RMS of a configuration\n";
  text += line("  this plan", plan.planned, plan.planned.worst_configuration);
  text += line("  random choice", plan.random, plan.random.worst_configuration);
  text += places_text(arguments.cell, setting.request.cell, setting.request.robot.base, setting.X_BW);
  if (arguments.places.sockets.empty() && arguments.places.directions == "xyz") {
    text += "a tracker may stand anywhere that sees the targets: these places are examples\n";
  }
  text += "station     in the base frame: x y z [m], angle times axis [deg]\n";
  for (std::size_t s = 0; s < stations.size(); ++s) {
    const Eigen::Isometry3d X_BW = plan.rows.robot.truth.frames.base(s).inverse();
    const Eigen::AngleAxisd turn(X_BW.linear());
    const Eigen::Vector3d r = turn.angle() / kDegree * turn.axis();
    const Eigen::Vector3d p = X_BW.translation();
    text += fmt::format("  {:<8}{:>9.3f}{:>9.3f}{:>9.3f}{:>10.1f}{:>8.1f}{:>8.1f}\n", stations[s], p.x(), p.y(), p.z(),
                        r.x(), r.y(), r.z());
  }
  return text + fmt::format("travel                  {:.0f} s at full speed, without the stops\n", plan.seconds);
}

}  // namespace kdl_calibration::cli
