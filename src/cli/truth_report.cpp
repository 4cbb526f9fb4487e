#include "cli/truth_report.hpp"

#include <fmt/core.h>
#include <algorithm>

#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "model/parameters.hpp"
#include "results/result_blocks.hpp"
#include "results/result_json.hpp"

namespace kdl_calibration::cli {
namespace {

Json vector_json(const Eigen::Ref<const Eigen::VectorXd>& vector) {
  return Json(std::vector<double>(vector.begin(), vector.end()));
}

Json parameter_json(const ErrorParameter& parameter, const Json& values) {
  Json json = {{"name", parameter.name},
               {"joint", parameter.joint.empty() ? Json(nullptr) : Json(parameter.joint)},
               {"kind", to_string(parameter.kind)},
               {"axis", parameter.axis == 'q' ? "" : std::string(1, parameter.axis)},
               {"nominal", parameter.nominal}};
  json.update(values);
  return json;
}

Json compared_json(const ErrorModel& model, const ComparedParameter& compared) {
  return parameter_json(
      model.parameters[compared.index],
      {{"estimated", compared.estimated},
       {"true", compared.truth},
       {"true_in_gauge", compared.truth_in_gauge},
       {"difference", compared.gauge ? Json(nullptr) : Json(compared.estimated - compared.truth_in_gauge)},
       {"gauge", compared.gauge}});
}

Json targets_json(const Estimate& estimate, const Estimate& truth, const Estimate& truth_in_gauge) {
  Json list = Json::array();
  for (std::size_t t = 0; t < estimate.frames.targets.size(); ++t) {
    const Eigen::Vector3d estimated = estimate.frames.targets[t].X_FT.translation();
    const Eigen::Vector3d in_gauge = truth_in_gauge.frames.targets[t].X_FT.translation();
    const TargetFrame* const drawn = find_target(truth.frames.targets, estimate.frames.targets[t].name);
    list.push_back({{"name", estimate.frames.targets[t].name},
                    {"estimated", position_json(estimated)},
                    {"true", position_json(drawn->X_FT.translation())},
                    {"true_in_gauge", position_json(in_gauge)},
                    {"difference", position_json(estimated - in_gauge)}});
  }
  return list;
}

// The value in mm or degrees, never -0.
double shown(double value, bool length) { return (length ? value * 1e3 : value / kDegree) + 0.0; }

std::string parameter_line(const ErrorModel& model, const ComparedParameter& compared, std::size_t joint_width) {
  const ErrorParameter& parameter = model.parameters[compared.index];
  const bool length = is_length(model, parameter);
  std::string text =
      fmt::format("  {:<6}{}{}", parameter.name, padded(parameter.joint, joint_width), length ? "mm " : "deg");
  for (const double value : {compared.estimated, compared.truth, compared.truth_in_gauge}) {
    text += fmt::format("{:>15}", fixed(shown(value, length), 6));
  }
  const double difference = shown(compared.estimated - compared.truth_in_gauge, length);
  return text + (compared.gauge ? "        gauge\n" : fmt::format("{:>13.2e}\n", difference));
}

std::string differences_line(const std::string& label, const Eigen::Ref<const Eigen::VectorXd>& differences,
                             bool length) {
  std::string text = "  " + padded(label, 28) + (length ? "mm " : "deg");
  for (const double value : differences) {
    text += fmt::format("{:>13.2e}", shown(value, length));
  }
  return text + "\n";
}

}  // namespace

Json drawn_json(const VirtualRobot& robot, const std::vector<std::size_t>& with_errors, const Reduction& reduction) {
  Json parameters = Json::array();
  for (const std::size_t p : with_errors) {
    const ErrorParameter& parameter = robot.model.parameters[p];
    const double error = robot.truth.errors[static_cast<Eigen::Index>(p)];
    const bool gauge = std::any_of(reduction.gauge.begin(), reduction.gauge.end(),
                                   [&](const GaugeParameter& candidate) { return candidate.name == parameter.name; });
    parameters.push_back(
        parameter_json(parameter, {{"value", parameter.nominal + error}, {"error", error}, {"gauge", gauge}}));
  }
  Json targets = Json::array();
  for (const TargetFrame& target : robot.truth.frames.targets) {
    targets.push_back(target_json(target));
  }
  Json drawn = {{"parameters", parameters}, {"base", frame_json(robot.truth.frames.base())}, {"targets", targets}};
  for (std::size_t station = 0; robot.model.has_undetermined_bases && station < robot.model.stations.size();
       ++station) {
    drawn["stations"].push_back({{"name", robot.model.stations[station]}});
    drawn["stations"].back().update(frame_json(robot.truth.frames.base(station)));
  }
  if (!robot.model.effects.empty()) {
    drawn["effects"] = json_of(effects_json(robot.model, robot.truth.effects), "effects");
  }
  return drawn;
}

Json truth_json(const ErrorModel& model, const Estimate& estimate, const Estimate& truth,
                const TruthComparison& comparison) {
  Json parameters = Json::array();
  for (const ComparedParameter& parameter : comparison.parameters) {
    parameters.push_back(compared_json(model, parameter));
  }
  return {{"parameters", parameters},
          {"base",
           {{"estimated", frame_json(estimate.frames.base())},
            {"true", frame_json(truth.frames.base())},
            {"true_in_gauge", frame_json(comparison.truth_in_gauge.frames.base())},
            {"difference", vector_json(comparison.base_difference)}}},
          {"targets", targets_json(estimate, truth, comparison.truth_in_gauge)},
          {"largest_difference", {{"length", comparison.largest_length}, {"angle", comparison.largest_angle}}},
          {"gauge_misfit", comparison.gauge_misfit},
          {"comparable", comparison.comparable()}};
}

std::string truth_table(const ErrorModel& model, const Estimate& estimate, const TruthComparison& comparison) {
  std::size_t joint_width = 7;
  for (const ComparedParameter& parameter : comparison.parameters) {
    joint_width = std::max(joint_width, model.parameters[parameter.index].joint.size() + 2);
  }
  std::string text = fmt::format("{:{}}{:>15}{:>15}{:>15}{:>13}\n", "", joint_width + 11, "estimated", "true",
                                 "true in gauge", "difference");
  for (const ComparedParameter& parameter : comparison.parameters) {
    text += parameter_line(model, parameter, joint_width);
  }
  text += "differences along x, y and z\n";
  text += differences_line("base, position", comparison.base_difference.head<3>(), true);
  text += differences_line("base, orientation", comparison.base_difference.tail<3>(), false);
  for (std::size_t t = 0; t < estimate.frames.targets.size(); ++t) {
    const Eigen::Vector3d difference =
        estimate.frames.targets[t].X_FT.translation() - comparison.truth_in_gauge.frames.targets[t].X_FT.translation();
    text += differences_line("target " + estimate.frames.targets[t].name, difference, true);
  }
  return fmt::format("{}largest difference up to the gauge: {:.2e} mm and {:.2e} deg\n", text,
                     comparison.largest_length * 1e3, comparison.largest_angle / kDegree);
}

Json rounds_json(const TwoStepTrialResult& result) {
  Json rounds = Json::array();
  for (const TwoStepTrialRound& entry : result.rounds) {
    rounds.push_back({{"round", entry.round.number},
                      {"change", entry.round.change},
                      {"misfit", entry.round.misfit},
                      {"held_out", statistics_json(entry.held_out)}});
  }
  return {{"termination", to_string(result.identification.termination)},
          {"message", result.identification.message},
          {"settled", result.settled},
          {"convergence_factor", result.factor > 0.0 ? Json(result.factor) : Json(nullptr)},
          {"rounds", rounds}};
}

std::string rounds_table(const TwoStepTrialResult& result) {
  std::string text = "round      change [mm]    misfit [mm]  held out, rms       max [mm]\n";
  for (const TwoStepTrialRound& entry : result.rounds) {
    text += fmt::format("{:5}  ", entry.round.number);
    for (const double metres : {entry.round.change, entry.round.misfit, entry.held_out.rms, entry.held_out.max}) {
      text += fmt::format("{:>15.4e}", metres * 1e3);
    }
    text += "\n";
  }
  text += to_string(result.identification.termination) + ": " + result.identification.message + "\n";
  if (result.settled && result.identification.termination != Termination::converged) {
    text += fmt::format("the last change is what noise alone causes, {:.2e} mm a round\n", result.floor * 1e3);
  }
  if (result.factor > 0.0) {
    text += fmt::format("each round left {:.3f} of the change of the round before\n", result.factor);
  }
  return text;
}

}  // namespace kdl_calibration::cli
