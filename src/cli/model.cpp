#include <fmt/core.h>
#include <memory>
#include <optional>
#include <utility>

#include "base/text.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/simulated_places.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/reduction.hpp"
#include "planning/places.hpp"
#include "results/result_json.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration::cli {
namespace {

struct ModelArguments {
  RobotArguments robot;
  int targets = 3;
  bool poses = false;
  PlaceArguments places;
  bool json = false;
};

std::string combination(const DroppedParameter& dropped) {
  std::string text;
  for (const auto& [name, coefficient] : dropped.replaced_by) {
    const std::string sign = coefficient < 0.0 ? "- " : text.empty() ? "" : "+ ";
    text += fmt::format("{}{}{:.3f} {}", text.empty() ? "" : " ", sign, std::abs(coefficient), name);
  }
  return text.empty() ? "nothing: it has no effect" : text;
}

// " (joint_3 = -1.0 joint_2 + 0.1)"
std::string followers(const Robot& robot) {
  std::string text;
  for (const MovingJoint& joint : robot.joints) {
    if (joint.mimic) {
      text += (text.empty() ? "" : ", ") + joint.name + " = " + Json(joint.mimic->multiplier).dump() + " " +
              robot.joints[joint.mimic->leader].name + " + " + Json(joint.mimic->offset).dump();
    }
    if (joint.drive) {
      text += (text.empty() ? "" : ", ") + joint.name + " = " + Json(joint.drive->multiplier).dump() + " " +
              joint.drive->name + " + " + Json(joint.drive->offset).dump();
    }
  }
  return text.empty() ? "" : " (" + text + ")";
}

std::string table(const Robot& robot, const ErrorModel& model, const ModelArguments& arguments,
                  const Reduction& reduction) {
  std::string complete;
  for (const ErrorParameter& parameter : model.parameters) {
    complete += (complete.empty() ? "" : " ") + parameter.name;
  }
  std::string kept;
  for (const std::string& name : reduction.kept) {
    kept += (kept.empty() ? "" : " ") + name;
  }
  std::string text =
      fmt::format("{}: {} to {}, {} joints{}, {} measured {} on the tool\n", robot.name, robot.base, robot.tip,
                  robot.joints.size(), followers(robot), arguments.targets, arguments.poses ? "poses" : "points");
  text += fmt::format("complete model, {} geometric parameters:\n  {}\n", model.parameters.size(), complete);
  text +=
      fmt::format("irreducible model, rank {} of {} candidates:\n  {}\n", reduction.rank, reduction.candidates, kept);
  text += "gauge, held at zero:\n";
  for (const GaugeParameter& gauge : reduction.gauge) {
    text += fmt::format("  {:<8}tied to {}\n", gauge.name, comma_separated(gauge.tied_to));
  }
  text += "dropped, replaced to first order by:\n";
  for (const DroppedParameter& dropped : reduction.dropped) {
    text += fmt::format("  {:<8}{}\n", dropped.name, combination(dropped));
  }
  return text;
}

// What measurements from such places determine, with many random configurations.
DeterminedByRows determined(const ErrorModel& model, const std::vector<TargetFrame>& targets, const Places& places) {
  constexpr int kConfigurations = 60;  // of a station: ten for each of its unknowns, several for those of the arm
  constexpr int kDraws = 5;            // the best counts: an arm with few joints may miss a way to reach a socket
  DeterminedByRows best;
  Random random(1);
  const Reach reach{.ranges = limits_of(model.joints)};
  for (int draw = 0; draw < kDraws; ++draw) {
    const Eigen::MatrixXd q =
        random_configurations(model.joints, reach.ranges, kConfigurations * places.stations, random);
    DeterminedByRows found = determined_by(rows_at(places, nominal_robot(model, targets), reach, q, random));
    if (draw == 0 || found.arm.rank > best.arm.rank) {
      best = std::move(found);
    }
    if (best.arm.rank == best.arm.columns) {
      break;
    }
  }
  return best;
}

std::string table(const DeterminedByRows& determined, const PlaceArguments& places) {
  std::string text = fmt::format("measured like this ({} from {} {}):\n  arm: {} of {} parameters determined\n",
                                 !places.sockets.empty()    ? "touches of sockets"
                                 : places.directions == "r" ? "distances"
                                                            : places.directions,
                                 places.stations, places.stations > 1 ? "stations" : "station", determined.arm.rank,
                                 determined.arm.columns);
  for (const std::vector<std::string>& tied : determined.arm.tied) {
    text += fmt::format("  not told apart: {}\n", comma_separated(tied));
  }
  text += "  each base, directions of 6:";
  for (const int directions : determined.bases) {
    text += fmt::format(" {}", directions);
  }
  return text + "\n";
}

Json json(const DeterminedByRows& determined) {
  return {{"arm_parameters", determined.arm_names},
          {"arm_rank", determined.arm.rank},
          {"tied", determined.arm.tied},
          {"base_ranks", determined.bases}};
}

ExitStatus run(const ModelArguments& arguments) {
  require_directions(arguments.places);
  const Places places = places_of(arguments.places);
  if (are_special(places) && arguments.poses) {
    throw InputError("--poses: are measured by one station, expected none with --stations, --sockets, --directions");
  }
  require_one_ball(arguments.places, static_cast<std::size_t>(arguments.targets));
  const Robot robot = load(arguments.robot);
  const ErrorModel model = complete_model(robot);
  std::vector<TargetFrame> targets = generic_targets(arguments.targets);
  for (TargetFrame& target : targets) {
    target.with_orientation = arguments.poses;
  }
  const Reduction reduction = reduced_model(model, targets);
  std::optional<DeterminedByRows> by_places;
  if (are_special(places)) {
    by_places = determined(model, targets, places);
  }
  if (arguments.json) {
    Json result = json_of(model_json(model, targets, reduction), "the model");
    if (by_places) {
      result["measured"] = json(*by_places);
    }
    print(json_text(result));
  } else {
    print(table(robot, model, arguments, reduction) + (by_places ? table(*by_places, arguments.places) : ""));
  }
  return done;
}

}  // namespace

Subcommand add_model(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("model", "What of the robot's geometry can be calibrated");
  const auto arguments = std::make_shared<ModelArguments>();
  add_robot_options(*app, arguments->robot);
  app->add_option("--targets", arguments->targets, "Number of measured targets on the tool")
      ->type_name("N")
      ->check(whole_number_between(1, 100, "a whole number from 1 to 100"))
      ->capture_default_str();
  app->add_flag("--poses", arguments->poses, "The targets' orientation is measured as well");
  add_place_options(*app, arguments->places);
  add_json_flag(*app, arguments->json);
  add_example(*app, "kdlcal model --targets 3");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
