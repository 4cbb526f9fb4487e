#include "results/mastering.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/degree.hpp"
#include "base/json_tree.hpp"
#include "base/random.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "effects/arm_kinematics.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/result_blocks.hpp"
#include "results/saved_calibration.hpp"
#include "robot/joint_ranges.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::VectorXd;

// Lengths for joints that slide, angles for the others: a controller's joint moves URDF joints of its own kind.
void require_unit(const std::vector<MovingJoint>& joints, const JointConvention& convention, Index place,
                  const EnteredOffset& offset) {
  const std::vector<std::size_t> independent = independent_joints(joints);
  for (Index k = 0; k < convention.matrix.rows(); ++k) {
    const bool slides = joints[independent[static_cast<std::size_t>(k)]].type == JointType::prismatic;
    if (convention.matrix(k, place) != 0.0 && slides != offset.is_length) {
      throw InputError("what was entered for " + shown(offset.joint) + " is " +
                       (offset.is_length ? "a length, expected deg or rad" : "an angle, expected mm or m"));
    }
  }
}

// By which the values of all joints grow.
VectorXd shifts_of(const std::vector<MovingJoint>& joints, const JointConvention& convention,
                   const std::vector<EnteredOffset>& entered) {
  VectorXd added = VectorXd::Zero(convention.matrix.cols());
  for (const EnteredOffset& offset : entered) {
    const auto& names = convention.controller_joints;
    const Index place = std::find(names.begin(), names.end(), offset.joint) - names.begin();
    require_unit(joints, convention, place, offset);
    added[place] = offset.added;
  }
  const VectorXd independent = convention.matrix * added;
  return all_joint_values(joints, independent) - all_joint_values(joints, VectorXd::Zero(independent.size()));
}

// Adds to a number of an entry, if it is there.
void add_to(Json& entry, const char* key, double shift) {
  if (entry.contains(key) && entry[key].is_number()) {
    entry[key] = entry[key].get<double>() + shift;
  }
}

void move_range(Json& range, double shift) {
  if (range.is_array()) {
    for (Json& end : range) {
      end = end.get<double>() + shift;
    }
  }
}

// The offsets in a list of parameters become smaller by what was entered. A list holds those that are not zero.
void move_offsets(Json& parameters, const ErrorModel& model, const VectorXd& shifts, bool with_uncertainty) {
  for (const ErrorParameter& parameter : model.parameters) {
    const double shift = parameter.kind == ParameterKind::joint_offset ? -shifts[parameter.frame] : 0.0;
    if (shift == 0.0) {
      continue;
    }
    const auto listed = std::find_if(parameters.begin(), parameters.end(),
                                     [&](const Json& entry) { return entry["name"] == parameter.name; });
    if (listed != parameters.end()) {
      add_to(*listed, "value", shift);
      add_to(*listed, "error", shift);
      if (listed->contains("interval_95")) {
        move_range((*listed)["interval_95"], shift);
      }
      continue;
    }
    Json entry = {{"name", parameter.name}, {"nominal", parameter.nominal}, {"value", shift}, {"error", shift}};
    if (with_uncertainty) {
      entry.update({{"joint", parameter.joint},
                    {"kind", to_string(parameter.kind)},
                    {"axis", ""},
                    {"std", 0.0},
                    {"degrees_of_freedom", nullptr},
                    {"interval_95", nullptr},
                    {"identifiable", false},
                    {"gauge", false}});
    }
    parameters.push_back(entry);
  }
}

// A linear change of two coefficients, by the terms' names: [first, second] -> turn * [first, second].
struct Turn {
  std::string first;
  std::string second;
  Eigen::Matrix2d matrix;
};

// Sine or cosine of the value of joint `of`.
struct Swing {
  int of = 0;
  double times = 0.0;
  bool is_cosine = false;
};
std::optional<Swing> swing_of(const EffectTerm& term) {
  if (const auto* const own = std::get_if<Sinusoid>(&term.function)) {
    return Swing{.of = term.index, .times = own->times, .is_cosine = own->is_cosine};
  }
  const auto* const coupling = std::get_if<JointCoupling>(&term.function);
  if (coupling == nullptr || coupling->times == 0.0) {
    return std::nullopt;
  }
  return Swing{.of = coupling->joint, .times = coupling->times, .is_cosine = coupling->is_cosine};
}

// The cosine that belongs to a sine.
std::optional<std::size_t> partner_of(const std::vector<EffectTerm>& terms, const EffectTerm& sine) {
  const Swing of_sine = *swing_of(sine);
  for (std::size_t i = 0; i < terms.size(); ++i) {
    const std::optional<Swing> other = swing_of(terms[i]);
    if (other && other->is_cosine && other->of == of_sine.of && other->times == of_sine.times &&
        terms[i].index == sine.index && terms[i].axis == sine.axis && terms[i].group() == sine.group()) {
      return i;
    }
  }
  return std::nullopt;
}

// a sin(n (q - E)) + b cos(n (q - E)) = (a c + b s) sin(n q) + (b c - a s) cos(n q), with c = cos(n E), s = sin(n E).
std::vector<Turn> move_sinusoids(Json& terms, const std::vector<EffectTerm>& effects, const VectorXd& shifts) {
  std::vector<Turn> turns;
  for (std::size_t i = 0; i < effects.size(); ++i) {
    const std::optional<Swing> swing = swing_of(effects[i]);
    if (!swing || swing->is_cosine) {
      continue;
    }
    const std::optional<std::size_t> k = partner_of(effects, effects[i]);
    if (!k) {
      continue;
    }
    Json& sine = terms[i];
    Json& cosine = terms[*k];
    const double angle = swing->times * shifts[swing->of];
    const Eigen::Matrix2d turn = Eigen::Rotation2Dd(-angle).toRotationMatrix();  // of (a, b), also of their means
    const Eigen::Vector2d scales(effects[i].scale, effects[*k].scale);
    const Eigen::Vector2d means = turn * Eigen::Vector2d(effects[i].mean, effects[*k].mean);
    const Eigen::Matrix2d scaled = scales.asDiagonal() * turn * scales.cwiseInverse().asDiagonal();
    const Eigen::Vector2d values =
        scaled * Eigen::Vector2d(sine["coefficient"].get<double>(), cosine["coefficient"].get<double>());
    sine["coefficient"] = values[0];
    cosine["coefficient"] = values[1];
    sine["mean"] = means[0];
    cosine["mean"] = means[1];
    turns.push_back({.first = effects[i].name, .second = effects[*k].name, .matrix = scaled});
  }
  return turns;
}

std::vector<Turn> move_effects(Json& result, const std::vector<EffectTerm>& effects, const VectorXd& shifts) {
  if (effects.empty()) {
    return {};
  }
  Json& terms = result["effects"]["terms"];
  for (std::size_t i = 0; i < effects.size(); ++i) {
    const double shift = shifts[effects[i].index];
    if (std::holds_alternative<JointGain>(effects[i].function)) {
      add_to(terms[i], "mean", shift);
    } else if (const auto* const coupling = std::get_if<JointCoupling>(&effects[i].function);
               coupling != nullptr && coupling->times == 0.0) {
      add_to(terms[i], "mean", shifts[coupling->joint]);
    } else if (std::holds_alternative<JointTable>(effects[i].function)) {
      Json& table = terms[i]["function"];
      add_to(table, "lower", shift);
      add_to(table, "upper", shift);
      if (table.contains("withheld")) {
        for (Json& range : table["withheld"]) {
          move_range(range, shift);
        }
      }
    }
    if (terms[i].contains("valid_range")) {
      move_range(terms[i]["valid_range"], shift);
    }
  }
  return move_sinusoids(terms, effects, shifts);
}

// Rows of `names` that a turn mixes; none if they are not estimated.
std::optional<std::pair<Index, Index>> rows_of(const Json& names, const Turn& turn) {
  const auto first = std::find(names.begin(), names.end(), turn.first);
  const auto second = std::find(names.begin(), names.end(), turn.second);
  return first == names.end() || second == names.end()
             ? std::nullopt
             : std::optional(std::pair<Index, Index>(first - names.begin(), second - names.begin()));
}

// Vectors over `names`, such as the shifts of a covariance.
void turn_vectors(Json& vectors, const Json& names, const std::vector<Turn>& turns) {
  for (Json& vector : vectors) {
    for (const Turn& turn : turns) {
      if (const auto rows = rows_of(names, turn)) {
        Json& first = vector[static_cast<std::size_t>(rows->first)];
        Json& second = vector[static_cast<std::size_t>(rows->second)];
        const Eigen::Vector2d turned = turn.matrix * Eigen::Vector2d(first.get<double>(), second.get<double>());
        first = turned[0];
        second = turned[1];
      }
    }
  }
}

// Sigma -> L Sigma L', by saved.covariance. Null, an infinite variance, is left as it is.
void turn_covariance(Json& result, const Eigen::MatrixXd& covariance, const std::vector<Turn>& turns) {
  if (turns.empty() || covariance.size() == 0) {
    return;
  }
  Json& block = result["covariance"];
  Eigen::MatrixXd L = Eigen::MatrixXd::Identity(covariance.rows(), covariance.cols());
  for (const Turn& turn : turns) {
    if (const auto rows = rows_of(block["names"], turn)) {
      const std::vector<Index> places = {rows->first, rows->second};
      L(places, places) = turn.matrix;
    }
  }
  Eigen::MatrixXd turned = L * covariance * L.transpose();
  turned = (0.5 * (turned + turned.transpose())).eval();
  Json lower = Json::array();
  Json full = Json::array();
  for (Index r = 0; r < turned.rows(); ++r) {
    Json row = Json::array();
    for (Index c = 0; c < turned.cols(); ++c) {
      row.push_back(finite_or_null(turned(r, c)));
    }
    full.push_back(row);
    lower.push_back(std::vector<Json>(row.begin(), row.begin() + r + 1));
  }
  block["lower_triangle"] = lower;
  block["matrix"] = full;
  if (block.contains("shifts")) {
    turn_vectors(block["shifts"], block["names"], turns);
  }
  for (Json& term : result["effects"]["terms"]) {
    const auto place = std::find(block["names"].begin(), block["names"].end(), term["name"]);
    if (place != block["names"].end()) {
      const Index row = place - block["names"].begin();
      term["std"] = finite_or_null(std::sqrt(turned(row, row)));
    }
  }
  if (result.contains("undetermined")) {
    turn_vectors(result["undetermined"]["directions"], result["undetermined"]["names"], turns);
  }
}

// Entries that neither what was found of all joints nor of these alone asks for, by the sign or the size.
std::vector<std::string> doubtful_entries(const Json& result, const std::vector<EnteredOffset>& entered) {
  std::vector<std::string> warnings;
  if (!result.contains("joint_offsets")) {
    return warnings;
  }
  for (const Json& joint : result["joint_offsets"]["joints"]) {
    for (const EnteredOffset& offset : entered) {
      const auto moves_away = [&](const char* key) {
        const double asked = joint.contains(key) && joint[key].is_number() ? joint[key].get<double>() : 0.0;
        return std::abs(asked - offset.added) > std::abs(asked);
      };
      if (joint["joint"] != offset.joint || !joint.contains("add") || !joint["add"].is_number() ||
          joint["add"].get<double>() == 0.0 || !moves_away("add") || !moves_away("add_if_only_these")) {
        continue;
      }
      const double unit = offset.is_length ? 1e-3 : kDegree;
      const char* name = offset.is_length ? "mm" : "deg";
      warnings.push_back(
          fmt::format("{}: {:.4g} {} were entered where the result says to add {:.4g} {}: its zero is "
                      "further off than before; is the sign or the unit another one?",
                      offset.joint, offset.added / unit, name, joint["add"].get<double>() / unit, name));
    }
  }
  return warnings;
}

void move_joint_offsets(Json& result, const std::vector<EnteredOffset>& entered) {
  if (!result.contains("joint_offsets")) {
    return;
  }
  for (Json& joint : result["joint_offsets"]["joints"]) {
    for (const EnteredOffset& offset : entered) {
      if (joint["joint"] == offset.joint) {
        add_to(joint, "add", -offset.added);
        add_to(joint, "add_if_only_these", -offset.added);
        if (joint.contains("interval_95")) {
          move_range(joint["interval_95"], -offset.added);
        }
      }
    }
  }
}

void move_region(Json& result, const VectorXd& shifts) {
  if (!result.contains("predicted_accuracy")) {
    return;
  }
  Json& predicted = result["predicted_accuracy"];
  predicted.erase("asked");
  if (predicted.contains("region")) {
    Json& joints = predicted["region"]["joints"];
    for (std::size_t i = 0; i < joints.size(); ++i) {
      move_range(joints[i], shifts[static_cast<Index>(i)]);
    }
  }
}

void update_exported_urdf(Json& result, const Robot& robot, const CalibrationParts& before, const VectorXd& shifts) {
  if (!result.contains("exported_urdf")) {
    return;
  }
  Json& exported = result["exported_urdf"];
  move_offsets(exported["parameters"], before.model, shifts, false);
  VectorXd errors = before.urdf_errors;
  for (std::size_t p = 0; p < before.model.parameters.size(); ++p) {
    const ErrorParameter& parameter = before.model.parameters[p];
    errors[static_cast<Index>(p)] -= parameter.kind == ParameterKind::joint_offset ? shifts[parameter.frame] : 0.0;
  }
  exported["nominal_kept"] = false;
  if (exported["sha256"].is_string()) {
    exported["sha256"] = sha256(calibrated_urdf(robot, before.model, errors));
  }
}

Json entry_json(std::string_view earlier, const Json& result, const JointConvention& convention,
                const std::vector<EnteredOffset>& entered) {
  Json joints = Json::array();
  for (const EnteredOffset& offset : entered) {
    joints.push_back({{"joint", offset.joint}, {"added", offset.added}});
  }
  return {{"sha256_of_earlier_result", sha256(std::string(earlier))},
          {"convention", convention.name},
          {"joints", joints},
          {"earlier", result.contains("mastering_entered") ? result["mastering_entered"] : Json(nullptr)}};
}

// RMS distance of the flange of both arms at the same places of the motors, over the measured region.
double moved_by_entry(const CalibrationParts& before, const CalibrationParts& after, const VectorXd& shifts) {
  constexpr int kCount = 200;
  if (std::any_of(before.model.effects.begin(), before.model.effects.end(),
                  [](const EffectTerm& term) { return term.group() == EffectGroup::torque; })) {
    return 0.0;  // a function of measured torques alone; the other effects are as in a model without it
  }
  const ArmKinematics earlier(before.model, before.estimate.errors, before.estimate.effects);
  const ArmKinematics later(after.model, after.estimate.errors, after.estimate.effects);
  Random random(1);
  const JointRanges ranges = before.region.joints.empty() ? limits_of(before.model.joints) : before.region.joints;
  const Eigen::MatrixXd q = random_configurations(before.model.joints, ranges, kCount, random);
  double squares = 0.0;
  for (const auto& column : q.colwise()) {
    const VectorXd shifted = column + shifts;
    squares += (earlier.flange_pose(column).translation() - later.flange_pose(shifted).translation()).squaredNorm();
  }
  return std::sqrt(squares / kCount);
}

}  // namespace

MasteredResult mastered_result(std::string_view result, const std::string& source, const Robot& robot,
                               const JointConvention& convention, const std::vector<EnteredOffset>& entered) {
  const CalibrationParts before = parse_calibration(result, robot, source);
  if (before.verdict == Verdict::not_trusted) {
    throw InputError(source + ": is not to be trusted, expected a result whose offsets may be entered");
  }
  const JointConvention matched = matched_convention(convention, independent_joint_names(before.model.joints));
  const VectorXd shifts = shifts_of(before.model.joints, matched, entered);
  Json json = tree::parsed(result, source);
  move_offsets(json["parameters"], before.model, shifts, true);
  const std::vector<Turn> turns = move_effects(json, before.model.effects, shifts);
  turn_covariance(json, before.covariance, turns);
  std::vector<std::string> warnings = doubtful_entries(json, entered);
  move_joint_offsets(json, entered);
  move_region(json, shifts);
  update_exported_urdf(json, robot, before, shifts);
  json["mastering_entered"] = entry_json(result, json, convention, entered);
  json["hashes"] = tree::hashes(json);
  MasteredResult mastered{.json = json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n",
                          .warnings = std::move(warnings)};
  mastered.moved = moved_by_entry(before, parse_calibration(mastered.json, robot, source), shifts);
  return mastered;
}

}  // namespace kdl_calibration
