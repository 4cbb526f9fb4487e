#include "results/result_table.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "base/wrapped_text.hpp"
#include "calibration/new_point.hpp"
#include "calibration/parameter_estimates.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/input_check.hpp"
#include "measurements/training_rows.hpp"
#include "model/kept_axes.hpp"
#include "model/parameters.hpp"
#include "results/effect_findings.hpp"
#include "results/joint_offsets.hpp"
#include "results/result_blocks.hpp"

namespace kdl_calibration {
namespace {

std::string cell(double value, int width, int decimals = 3) {
  return fmt::format("{:>{}}", fixed(value, decimals), width);
}

std::string priors_in_words(const Priors& priors) {
  if (!(priors.length > 0.0) && !(priors.angle > 0.0)) {
    return "no priors";
  }
  return fmt::format("priors of {:.3g} mm and {:.3g} mrad", priors.length * 1e3, priors.angle * 1e3);
}

void add_errors(const CalibrationResult& calibration, std::string& text) {
  text += "\n" + statistics_heading("position error [mm]");
  const auto add = [&](const std::string& what, const ErrorStatistics& before, const ErrorStatistics& after) {
    text += statistics_row(what + ", nominal", before) + statistics_row(what + ", calibrated", after);
  };
  const auto add_pair = [&](const std::string& what, const std::optional<BeforeAfter>& pair) {
    if (pair) {
      add(what, pair->before, pair->after);
      text += pair->rigid ? statistics_row(what + ", URDF alone", *pair->rigid) : "";
    }
  };
  add_pair("fitted", calibration.accuracy.train);
  add_pair("means", calibration.accuracy.train_means);
  add_pair("test", calibration.accuracy.test);
  add_pair("test means", calibration.accuracy.test_means);
  if (calibration.accuracy.test_at_fitted_poses) {
    text += statistics_row("  at fitted poses", *calibration.accuracy.test_at_fitted_poses);
  }
  if (calibration.accuracy.test_at_new_poses) {
    text += statistics_row("  at new poses", *calibration.accuracy.test_at_new_poses);
  }
  add_pair("left out", calibration.accuracy.leave_one_out);
  if (calibration.accuracy.nested_leave_one_out) {
    text += statistics_row("left out, choice anew", *calibration.accuracy.nested_leave_one_out);
  }
  if (calibration.accuracy.k_fold) {
    add_pair(fmt::format("{}-fold", calibration.accuracy.folds), calibration.accuracy.k_fold);
  }
  const ErrorStatistics& repeatability = calibration.accuracy.iso_after.repeatability;
  if (repeatability.count > 0) {
    text += fmt::format(
        "AP and RP by the formulas of ISO 9283 (not its test cycle), largest:\n  AP nominal {:.3f} mm, calibrated "
        "{:.3f} mm; RP {:.3f} mm\n",
        calibration.accuracy.iso_before.accuracy.max * 1e3, calibration.accuracy.iso_after.accuracy.max * 1e3,
        repeatability.max * 1e3);
  }
}

// "0.030 mm", or one value per axis of W if they differ.
std::string per_axis(const Eigen::Vector3d& sigma) {
  if ((sigma.array() == sigma.x()).all()) {
    return fixed(sigma.x() * 1e3, 3) + " mm";
  }
  return fmt::format("{}, {}, {} mm", fixed(sigma.x() * 1e3, 3), fixed(sigma.y() * 1e3, 3), fixed(sigma.z() * 1e3, 3));
}

std::string noise_of_stations(const CalibrationResult& calibration) {
  std::vector<std::string> each;
  for (std::size_t station = 0; station < calibration.noise.stations.size(); ++station) {
    each.push_back(fmt::format("{} {} mm", calibration.model.stations[station],
                               fixed(calibration.noise.sigma_at(station) * 1e3, 3)));
  }
  return each.empty() ? "" : wrapped("noise per coordinate by station: " + comma_separated(each), 0, 2);
}

std::string noise_line(const NoiseReport& noise) {
  std::string line = "noise per coordinate: ";
  if (noise.independent.isZero(0.0)) {
    line += per_axis(Eigen::Vector3d::Constant(noise.sigma)) + " in all";
  } else {
    line += per_axis(noise.independent) + " per point";
    if (!noise.common.isZero(0.0)) {
      line += ", " + per_axis(noise.common) + " common to a repeat";
    }
    if (noise.misfit > 0.0) {
      line += ", " + per_axis(Eigen::Vector3d::Constant(noise.misfit)) + " common to a configuration";
    }
    if (noise.target_misfit > 0.0) {
      line += ", " + per_axis(Eigen::Vector3d::Constant(noise.target_misfit)) + " of a target in a configuration";
    }
  }
  if (noise.source == NoiseSource::stated || (noise.parts && !noise.parts->estimated[NoiseParts::kIndependent])) {
    if (noise.parts && noise.parts->estimated[NoiseParts::kCommon] && !noise.common.isZero(0.0)) {
      return line + " (the first as stated, the rest from the residuals)";
    }
    const bool more = noise.misfit > 0.0 || noise.target_misfit > 0.0;
    return line + (more ? " (as stated, the misfits from the residuals)" : " (as stated)");
  }
  return line + (noise.repeats ? " (from residuals and repeats)" : " (from the residuals)");
}

// "joint_2, joint_3 parallel; joint_4, joint_5, joint_6 through one point"
std::string kept_axes_line(const ErrorModel& model) {
  const AxisRelations relations = axis_relations(model.joints, model.kept_axes);
  std::string line = model.kept_axes == KeptAxes::angles ? "kept: the angles between neighbouring axes" : "kept:";
  for (const auto& [runs, how] :
       {std::pair{&relations.parallel, " parallel"}, std::pair{&relations.meeting, " through one point"}}) {
    for (const std::vector<std::string>& names : joint_names(*runs, model.joints)) {
      line += (line.back() == ':' ? " " : "; ") + comma_separated(names) + how;
    }
  }
  return line;
}

void add_kept_axes(const CalibrationResult& calibration, std::string& text) {
  if (calibration.model.kept_axes == KeptAxes::none) {
    return;
  }
  text += wrapped(kept_axes_line(calibration.model), 0, 2);
  if (calibration.free_axes && !calibration.free_axes->not_computed.empty()) {
    text += wrapped("what that costs is not computed: " + calibration.free_axes->not_computed, 0, 2);
  }
}

void add_figures(const CalibrationResult& calibration, bool details, std::string& text) {
  const Identification& found = calibration.fit.identification;
  text += "\n";
  add_kept_axes(calibration, text);
  text += wrapped(noise_line(calibration.noise), 0, 2);
  text += noise_of_stations(calibration);
  text += fmt::format("rank {} of {} parameters, condition number {:.0f}, {} iterations\n",
                      calibration.uncertainty.identifiability.rank, calibration.uncertainty.identifiability.columns,
                      calibration.uncertainty.identifiability.condition, found.iterations);
  if (found.convergence_factor > 0.0) {
    text += fmt::format("each round left {:.3f} of the error of the round before\n", found.convergence_factor);
  }
  if (details && calibration.uncertainty.predicted.workspace.count > 0) {
    text += fmt::format(
        "1 sigma of a predicted point, from the uncertainty of the parameters alone:\n  {:.3f} mm at the measured "
        "configurations, {:.3f} mm over the whole workspace\n",
        calibration.uncertainty.predicted.measured.rms * 1e3, calibration.uncertainty.predicted.workspace.rms * 1e3);
  }
  if (!calibration.selection.tried.empty()) {
    const ModelOption& chosen = calibration.selection.tried.front();
    text += wrapped("chosen by cross-validation: " + priors_in_words(chosen.priors) + ", beyond geometry " +
                        (chosen.effects.empty() ? "nothing" : comma_separated(chosen.effects)),
                    0, 2);
  }
  if (!calibration.selection.not_tried.empty()) {
    text += wrapped("not tried: " + in_words(calibration.selection.not_tried), 0, 2);
  }
}

std::string cook_number(double cook) { return std::isfinite(cook) ? cell(cook, 10) : "  not without"; }

void add_most_influential(const Measurements& measurements, const Influence& influence, std::string& text) {
  constexpr std::size_t kShown = 5;
  std::vector<ConfigurationInfluence> order = influence.configurations;
  if (order.empty()) {
    return;
  }
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.cook > b.cook; });
  const auto count = [&](auto member) {
    return std::count_if(order.begin(), order.end(), [&](const auto& entry) { return entry.*member; });
  };
  text += fmt::format(
      "\nmost influential: {} of {} configurations have a Cook's distance above {:.3f},\n{} a high leverage (*)\n",
      count(&ConfigurationInfluence::influential), order.size(), influence.cook_limit,
      count(&ConfigurationInfluence::high_leverage));
  text += "  configuration               Cook's  leverage\n";
  for (std::size_t i = 0; i < std::min(kShown, order.size()); ++i) {
    text += padded("  " + measurements.configurations[static_cast<std::size_t>(order[i].configuration)], 26) +
            cook_number(order[i].cook) + cell(order[i].leverage, 10) + (order[i].high_leverage ? " *" : "") + "\n";
  }
}

// Of each kind the mistake that would harm most.
void add_detectable(const std::vector<DetectableMistake>& mistakes, std::string& text) {
  std::vector<const DetectableMistake*> worst;
  for (const DetectableMistake& mistake : mistakes) {
    const auto same =
        std::find_if(worst.begin(), worst.end(), [&](const auto* other) { return other->cause == mistake.cause; });
    if (same == worst.end()) {
      worst.push_back(&mistake);
    } else if ((*same)->moves < mistake.moves) {
      *same = &mistake;
    }
  }
  if (worst.empty()) {
    return;
  }
  text += "\nthe smallest mistake that would show (80 %), and what it does if it is hidden [mm]\n";
  text += fmt::format("{:>70}\n", "points  predictions");
  for (const DetectableMistake* mistake : worst) {
    const double shown = mistake->estimate * (std::string_view(mistake->unit) == "%" ? 1e2 : 1e3);
    const std::string size = *mistake->unit != 0 ? fmt::format("{:.2g} {}", shown, mistake->unit) : "";
    text += padded("  " + mistake->subject, 40) + fmt::format("{:>10}", size) + cell(mistake->size * 1e3, 8) +
            cell(mistake->moves * 1e3, 12) + "\n";
  }
}

void add_predictions(const std::vector<AskedPoint>& points, std::string& text) {
  if (points.empty()) {
    return;
  }
  constexpr std::size_t kMostPoints = 20;
  text += "\npredicted, in the base [mm]           x          y          z  sigma   95 %\n";
  for (std::size_t i = 0; i < std::min(points.size(), kMostPoints); ++i) {
    const AskedPoint& point = points[i];
    const Eigen::Vector3d p = point.position * 1e3;
    text += padded("  " + point.configuration + " " + point.target, 28) + cell(p.x(), 11) + cell(p.y(), 11) +
            cell(p.z(), 11);
    text += std::isfinite(point.sigma) ? fmt::format("{:>7.3f}{:>7.3f}", point.sigma * 1e3, point.radius_95 * 1e3)
                                       : "  not determined";
    const Eigen::Vector3d moved = p - point.nominal * 1e3;
    text +=
        "\n" + padded("    minus nominal", 28) + cell(moved.x(), 11) + cell(moved.y(), 11) + cell(moved.z(), 11) + "\n";
  }
  if (points.size() > kMostPoints) {
    text += fmt::format("further ones: --result lists all {}\n", points.size());
  }
}

// Display unit of a parameter.
struct DisplayUnit {
  double per_si;  // display units per metre or radian
  int decimals;   // resolution of some tenths of a micrometre or microradian
  const char* name;

  std::string of(double value) const { return cell(value * per_si, 10, decimals) + name; }
};
constexpr DisplayUnit kMillimetres{.per_si = 1e3, .decimals = 4, .name = " mm "};
constexpr DisplayUnit kDegrees{.per_si = 180.0 / std::numbers::pi, .decimals = 5, .name = " deg"};

// A prismatic joint's offset is a length.
const DisplayUnit& unit_of(const ErrorModel& model, const std::string& name) {
  return is_length(model, model.parameters[parameter_index(model, name)]) ? kMillimetres : kDegrees;
}

// "x shift of link 1 (origin of joint_2)"
std::string in_words(const ErrorModel& model, const ParameterEstimate& parameter) {
  if (parameter.kind == ParameterKind::joint_offset) {
    return "zero offset of " + parameter.joint;
  }
  const ErrorParameter& error = model.parameters[parameter_index(model, parameter.name)];
  return fmt::format("{}{} of link {}{}", parameter.axis,
                     parameter.kind == ParameterKind::translation ? " shift" : " turn", error.frame,
                     parameter.joint.empty() ? "" : " (origin of " + parameter.joint + ")");
}

// The parameter with the largest coefficient in the replacement of a dropped one.
std::string replacement_of(const DroppedParameter& dropped) {
  const auto largest =
      std::max_element(dropped.replaced_by.begin(), dropped.replaced_by.end(),
                       [](const auto& a, const auto& b) { return std::abs(a.second) < std::abs(b.second); });
  return largest == dropped.replaced_by.end() ? std::string() : largest->first;
}

// Reason why a parameter was not estimated; `fixed`: text if the user fixed it.
std::string why_held(const Reduction& reduction, const ParameterEstimate& parameter, const std::string& fixed) {
  if (parameter.gauge) {
    return parameter.error == 0.0 ? "held, gauge" : "by gauge";
  }
  if (parameter.std > 0.0) {
    return "not determined";
  }
  const auto dropped = std::find_if(reduction.dropped.begin(), reduction.dropped.end(),
                                    [&](const DroppedParameter& other) { return other.name == parameter.name; });
  if (dropped == reduction.dropped.end()) {
    return fixed;
  }
  const std::string replacement = replacement_of(*dropped);
  return replacement.empty() ? "held, no effect" : "held, in " + replacement;
}

std::string parameter_line(const ErrorModel& model, const Reduction& reduction, const ParameterEstimate& parameter,
                           const std::string& fixed_by_user) {
  const std::size_t width = std::max<std::size_t>(6, parameter.name.size() + 1);
  const DisplayUnit& unit = unit_of(model, parameter.name);
  const std::string line =
      "  " + padded(parameter.name, width) + padded(in_words(model, parameter), 40) + unit.of(parameter.error);
  if (parameter.identifiable) {
    return fmt::format("{}  +- {}\n", line,
                       fixed(unit.per_si * half_width_95(parameter.std, parameter.degrees_of_freedom), unit.decimals));
  }
  return line + "  " + why_held(reduction, parameter, fixed_by_user) + "\n";
}

void add_parameters(const CalibrationResult& calibration, const std::string& held, std::string& text) {
  text += "\ngeometric errors, +- half of the 95 % interval\n";
  for (const ParameterEstimate& parameter : calibration.uncertainty.parameters) {
    if (parameter.name.find('.') == std::string::npos) {  // neither of a frame nor of an effect
      text += parameter_line(calibration.model, calibration.fit.reduction, parameter, held);
    }
  }
}

// The largest motion of each joint by each group of effects at the measured configurations.
void add_effects(const CalibrationResult& calibration, const Measurements& measurements, std::string& text) {
  if (calibration.model.effects.empty()) {
    return;
  }
  text += "\neffects beyond geometry, largest motion at the measured configurations\n";
  const std::vector<EffectMotion> motions = effect_motions(calibration, measurements);
  for (const EffectMotion& motion : motions) {
    const MovingJoint& joint = calibration.model.joints[static_cast<std::size_t>(motion.by.joint)];
    const DisplayUnit& unit = motion.is_length(calibration.model) ? kMillimetres : kDegrees;
    const EffectAxis axis = motion.by.axis;
    const std::string about = axis == EffectAxis::own || axis == EffectAxis::along
                                  ? ""
                                  : std::string(", ") + to_string(axis) + " across its axis";
    text += "  " + padded(to_string(motion.by.group), 12) + padded(joint.name + about, 34) + unit.of(motion.largest()) +
            "\n";
  }
  for (const std::string& finding : effect_findings(calibration, motions)) {
    text += wrapped(finding, 2, 4);
  }
}

// For mastering: corrections to add to the controller's joint values.
void add_joint_offsets(const CalibrationResult& calibration, const JointConvention& convention, std::string& text) {
  text += "\njoint zero offsets, for mastering: add to the displayed values\n" +
          wrapped(
              "enter nothing if you use the calibrated URDF or compensate, which correct them, or enter the first "
              "column and go on with kdlcal apply",
              2, 2) +
          fmt::format("{:>52}{}\n", "+- 95 %", calibration.offsets_alone ? "   if only these" : "");
  for (const JointOffset& offset : joint_offsets(calibration, convention)) {
    const DisplayUnit& unit = offset.slides ? kMillimetres : kDegrees;
    text += "  " + padded(offset.joint, 24);
    if (!offset.measurable) {
      text += "  not measurable: base or targets take it up\n";
      continue;
    }
    text += unit.of(offset.add);
    text += offset.std == 0.0
                ? "        held"
                : cell(unit.per_si * half_width_95(offset.std, offset.degrees_of_freedom), 12, unit.decimals);
    if (calibration.offsets_alone) {
      text += cell(unit.per_si * offset.add_alone, 12, unit.decimals) + " " + std::string(trimmed(unit.name));
    }
    text += "\n";
  }
  if (!calibration.model.effects.empty()) {
    text += "  the first column includes the mean of the effects of each joint\n";
  }
  if (calibration.offsets_alone) {
    text += wrapped(fmt::format("enter the last column only if you use neither the calibrated URDF nor compensate: "
                                "{:.3f} mm would be left (fitted)",
                                calibration.offsets_alone->accuracy.rms * 1e3),
                    2, 2);
  }
}

std::string row_of(const std::string& label, const Eigen::Vector3d& position) {
  const Eigen::Vector3d p = position * 1e3;
  return padded("  " + label, 26) + cell(p.x(), 12) + cell(p.y(), 12) + cell(p.z(), 12) + "\n";
}

void add_base(const std::string& name, const Eigen::Isometry3d& X_WB, std::string& text) {
  text += row_of(name, X_WB.translation());
  double roll = 0.0;
  double pitch = 0.0;
  double yaw = 0.0;
  to_kdl(X_WB).M.GetRPY(roll, pitch, yaw);
  text += "  roll, pitch, yaw [deg]  ";
  for (const double angle : {roll, pitch, yaw}) {
    text += cell(angle * kDegrees.per_si, 12, kDegrees.decimals);
  }
  text += "\n";
}

void add_frames(const ErrorModel& model, const Estimate& estimate, std::string& text) {
  const std::string axes = "           x           y           z\n";
  text += "\nbase, as measured [mm]    " + axes;
  for (std::size_t station = 0; station < estimate.frames.bases.size(); ++station) {
    add_base(model.has_undetermined_bases ? "from " + model.stations[station] : "origin", estimate.frames.base(station),
             text);
  }
  text += "\ntargets on the flange [mm]" + axes;
  for (const TargetFrame& target : estimate.frames.targets) {
    text += row_of(target.name, target.X_FT.translation());
  }
}

long fitted_configurations(const Measurements& measurements) {
  const std::vector<bool> trained = trained_configurations(measurements);
  return std::count(trained.begin(), trained.end(), true);
}

std::string sizes(const Measurements& measurements, const CalibrationResult& calibration) {
  const Eigen::Index effects = calibration.fit.free.range(UnknownGroup::effects).count;
  return fmt::format("{} configurations, {} points, {} parameters{}", fitted_configurations(measurements),
                     calibration.accuracy.train.after.count, calibration.fit.free.size() - effects,
                     effects > 0 ? fmt::format(" and {} of effects", effects) : "");
}

// Whether the robot has changed since the earlier result, if there is one.
std::string since_earlier(const CalibrationResult& calibration) {
  if (!calibration.selection.continued) {
    return {};
  }
  const EarlierComparison& found = calibration.selection.continued->comparison;
  const std::vector<std::string> changes = in_words(calibration.model, found);
  const std::string unseen = found.unseen_zeros.empty()
                                 ? ""
                                 : " A changed zero does not show in " + comma_separated(found.unseen_zeros) +
                                       ": a moved base or tool would look the same.";
  return wrapped(fmt::format("{} since the earlier result (p = {:.2g}){}{}.{}",
                             found.has_changed() ? "Changed" : "No change found", found.p_value,
                             changes.empty() ? "" : ": ", comma_separated(changes), unseen),
                 0, 4);
}

// The verdict, shown before any figure.
std::string verdict(const Measurements& measurements, const CalibrationResult& calibration) {
  const std::string since = since_earlier(calibration);
  const std::string of_what = wrapped("Calibration of " + sizes(measurements, calibration) + ".", 0, 4) + since;
  if (calibration.trusted()) {
    const auto& reservation = calibration.diagnosis.reservation;
    return reservation ? wrapped("Trusted where it was measured: " + reservation->message + ".", 0, 4) + of_what
                       : wrapped("Trusted. Calibration of " + sizes(measurements, calibration) + ".", 0, 4) + since;
  }
  std::string text;
  for (const Doubt& doubt : calibration.diagnosis.doubts) {
    text += wrapped((text.empty() ? "NOT TO BE TRUSTED: " : "Also: ") + doubt.message + ".", 0, 4);
  }
  for (const QualityFinding& finding : calibration.diagnosis.findings) {
    text += wrapped("Measurements: " + finding.message + ".", 0, 4);
  }
  return text + "\n" + of_what;
}

// The accuracy that users ask for, in one sentence.
std::string new_point_line(const CalibrationResult& calibration, const Measurements& measurements) {
  const NewPointErrors errors = new_point_errors(calibration, measurements);
  const auto mm = [](double value) { return fmt::format("{:.{}f} mm", value * 1e3, value < 1e-4 ? 3 : 2); };
  const std::string rigid = errors.urdf_alone == errors.compensated
                                ? " in compensated programs or with the URDF"
                                : " in compensated programs, " + mm(errors.urdf_alone) + " with the URDF alone";
  const std::string nominal = ", " + mm(errors.nominal) + " as the robot is";
  const char* rows = errors.rows == NewPointErrors::Rows::left_out ? ""
                     : errors.rows == NewPointErrors::Rows::test
                         ? " (by the test rows)"
                         : " (by the fitted rows, which is too good: nothing was left out)";
  return wrapped(fmt::format("A new {} lies within {} (k = {:.2g}){}{}{}.",
                             errors.of_coordinates ? "coordinate or distance" : "point", mm(errors.compensated),
                             errors.coverage_factor, rigid, nominal, rows),
                 0, 4);
}

std::string main_row(const std::string& label, const BeforeAfter& errors, double ErrorStatistics::*figure) {
  const auto cell_of = [&](const std::optional<ErrorStatistics>& statistics) {
    return statistics && statistics->count > 0 ? cell(*statistics.*figure * 1e3, 12) : std::string(12, ' ');
  };
  return padded(label, 26) + cell_of(errors.before) + cell_of(errors.after) + cell_of(errors.rigid) +
         fmt::format("{:>10}\n", errors.after.count);
}

// The error that the exported URDF leaves alone stands beside that of the full model.
void add_main_figures(const CalibrationResult& calibration, std::string& text) {
  const Accuracy& accuracy = calibration.accuracy;
  text += fmt::format("\nposition error, rms [mm]       nominal  calibrated{}    points\n",
                      accuracy.train.rigid ? "  URDF alone" : "            ");
  const auto add = [&](const std::string& label, const std::optional<BeforeAfter>& errors) {
    text += errors ? main_row(label, *errors, &ErrorStatistics::rms) : "";
  };
  add("fitted", accuracy.train);
  add("fitted, means of repeats", accuracy.train_means);
  add("test", accuracy.test);
  add("test, means of repeats", accuracy.test_means);
  add(accuracy.train_means ? "left out, means of repeats" : "left out", accuracy.leave_one_out);
  if (accuracy.k_fold) {
    add(fmt::format("{}-fold", accuracy.folds), accuracy.k_fold);
  }
  if (const std::optional<FreeAxes>& free = calibration.free_axes) {
    add("fitted, axes free", free->not_computed.empty() ? std::optional(free->train) : std::nullopt);
    add("left out, axes free", free->held_out);
  }
  const BeforeAfter* held_out = accuracy.held_out();
  text += held_out != nullptr ? main_row("largest, left out", *held_out, &ErrorStatistics::max)
                              : "left out                  not known\n";
}

}  // namespace

std::string statistics_heading(const std::string& label, const std::string& counted) {
  return fmt::format("{}         rms        mean         p95         max{:>8}\n", padded(label, 24), counted);
}

std::string statistics_row(const std::string& label, const ErrorStatistics& statistics) {
  std::string text = padded(label, 24);
  for (const double value : {statistics.rms, statistics.mean, statistics.p95, statistics.max}) {
    text += statistics.count > 0 ? fmt::format("{:>12.3f}", value * 1e3) : "           -";
  }
  return text + fmt::format("{:8}\n", statistics.count);
}

std::string result_table(const Measurements& measurements, const CalibrationResult& calibration,
                         const TableOptions& options) {
  check(calibration.fit.identification.estimate, calibration.model, measurements);
  std::string text = verdict(measurements, calibration);
  text += calibration.trusted() ? new_point_line(calibration, measurements) : "";
  add_main_figures(calibration, text);
  add_figures(calibration, options.details, text);
  if (calibration.trusted()) {
    if (options.convention != nullptr) {
      add_joint_offsets(calibration, *options.convention, text);
    }
    add_predictions(calibration.uncertainty.predicted.asked, text);
  }
  if (options.details) {
    add_errors(calibration, text);
  }
  if (options.details && calibration.trusted()) {
    add_parameters(calibration, options.fixed, text);
    add_effects(calibration, measurements, text);
    add_most_influential(measurements, calibration.uncertainty.influence, text);
    add_detectable(calibration.diagnosis.detectable, text);
    add_frames(calibration.model, calibration.fit.identification.estimate, text);
  }
  if (!options.written.empty()) {
    text += "\n" + wrapped("Written: " + comma_separated(options.written), 0, 9);
  }
  return text;
}

}  // namespace kdl_calibration
