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
#include "calibration/parameter_estimates.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/input_check.hpp"
#include "measurements/training_rows.hpp"
#include "results/effect_findings.hpp"

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

// Position errors of the means of the repeats, as in all tables.
void add_errors(const CalibrationResult& calibration, std::string& text) {
  text += "\n" + statistics_heading("position error [mm]");
  const auto add = [&](const std::string& what, const ErrorStatistics& before, const ErrorStatistics& after) {
    text += statistics_row(what + ", nominal", before) + statistics_row(what + ", calibrated", after);
  };
  const bool has_effects = calibration.accuracy.train.rigid.has_value();
  add("fitted", calibration.accuracy.iso_before.accuracy, calibration.accuracy.iso_after.accuracy);
  if (has_effects) {
    text += statistics_row("fitted, URDF alone", calibration.exported.iso.accuracy);
  }
  if (calibration.accuracy.iso_test_before && calibration.accuracy.iso_test_after) {
    add("test", calibration.accuracy.iso_test_before->accuracy, calibration.accuracy.iso_test_after->accuracy);
  }
  if (calibration.accuracy.test_at_fitted_poses) {
    text += statistics_row("  at fitted poses", *calibration.accuracy.test_at_fitted_poses);
  }
  if (calibration.accuracy.test_at_new_poses) {
    text += statistics_row("  at new poses", *calibration.accuracy.test_at_new_poses);
  }
  const auto add_held_out = [&](const std::string& what, const BeforeAfter& pair) {
    add(what, pair.before, pair.after);
    if (pair.rigid) {
      text += statistics_row(what + ", URDF alone", *pair.rigid);
    }
  };
  if (calibration.accuracy.leave_one_out) {
    add_held_out("left out", *calibration.accuracy.leave_one_out);
  }
  if (calibration.accuracy.nested_leave_one_out) {
    text += statistics_row("left out, choice anew", *calibration.accuracy.nested_leave_one_out);
  }
  if (calibration.accuracy.k_fold) {
    add_held_out(fmt::format("{}-fold", calibration.accuracy.folds), *calibration.accuracy.k_fold);
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
    const bool more = noise.misfit > 0.0 || noise.target_misfit > 0.0;
    return line + (more ? " (as stated, the misfits from the residuals)" : " (as stated)");
  }
  return line + (noise.repeats ? " (from residuals and repeats)" : " (from the residuals)");
}

void add_figures(const CalibrationResult& calibration, std::string& text) {
  const Identification& found = calibration.fit.identification;
  text += "\n" + wrapped(noise_line(calibration.noise), 0, 2);
  text += fmt::format("rank {} of {} parameters, condition number {:.0f}, {} iterations\n",
                      calibration.uncertainty.identifiability.rank, calibration.uncertainty.identifiability.columns,
                      calibration.uncertainty.identifiability.condition, found.iterations);
  if (found.convergence_factor > 0.0) {
    text += fmt::format("each round left {:.3f} of the error of the round before\n", found.convergence_factor);
  }
  if (calibration.uncertainty.predicted.workspace.count > 0) {
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
    text += wrapped("not tried: " + calibration.selection.not_tried, 0, 2);
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

void add_predictions(const std::vector<AskedPoint>& points, std::string& text) {
  if (points.empty()) {
    return;
  }
  text += "\npredicted, in the base [mm]           x          y          z  sigma   95 %\n";
  for (const AskedPoint& point : points) {
    const Eigen::Vector3d p = point.position * 1e3;
    text += padded("  " + point.configuration + " " + point.target, 28) + cell(p.x(), 11) + cell(p.y(), 11) +
            cell(p.z(), 11);
    text += std::isfinite(point.sigma) ? fmt::format("{:>7.3f}{:>7.3f}", point.sigma * 1e3, point.radius_95 * 1e3)
                                       : "  not determined";
    text += "\n";
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
    const std::string about = axis == EffectAxis::own ? "" : std::string(", ") + to_string(axis) + " across its axis";
    text += "  " + padded(to_string(motion.by.group), 12) + padded(joint.name + about, 34) + unit.of(motion.largest()) +
            "\n";
  }
  for (const std::string& finding : effect_findings(calibration, motions)) {
    text += wrapped(finding, 2, 4);
  }
}

// For mastering: corrections to add to the controller's joint values.
void add_controller_offsets(const CalibrationResult& calibration, const JointConvention& convention,
                            std::string& text) {
  const ErrorModel& model = calibration.model;
  Eigen::VectorXd offsets = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(convention.urdf_joints.size()));
  Eigen::VectorXd unknown = offsets;  // 1 where a gauge holds the offset
  for (const ParameterEstimate& parameter : calibration.uncertainty.parameters) {
    const auto joint = std::find(convention.urdf_joints.begin(), convention.urdf_joints.end(), parameter.joint);
    if (parameter.kind == ParameterKind::joint_offset && joint != convention.urdf_joints.end()) {
      offsets[joint - convention.urdf_joints.begin()] = parameter.error;
      unknown[joint - convention.urdf_joints.begin()] = parameter.gauge ? 1.0 : 0.0;
    }
  }
  const Eigen::MatrixXd to_controller = convention.matrix.inverse();
  const Eigen::VectorXd controller = to_controller * offsets;
  const Eigen::VectorXd held = to_controller.cwiseAbs() * unknown;
  text +=
      "\njoint offsets as the controller counts, for mastering\n"
      "(to add to the displayed values; the calibrated URDF contains them already)\n";
  for (std::size_t i = 0; i < convention.controller_joints.size(); ++i) {
    const auto index = static_cast<Eigen::Index>(i);
    bool slides = false;
    for (const MovingJoint& joint : model.joints) {
      const auto row = std::find(convention.urdf_joints.begin(), convention.urdf_joints.end(), joint.name);
      slides = slides || (joint.type == JointType::prismatic && row != convention.urdf_joints.end() &&
                          convention.matrix(row - convention.urdf_joints.begin(), index) != 0.0);
    }
    const DisplayUnit& unit = slides ? kMillimetres : kDegrees;
    text += "  " + padded(convention.controller_joints[i], 46) +
            (held[index] > 1e-9 ? "      not measurable: base or targets take it up" : unit.of(controller[index])) +
            "\n";
  }
}

std::string row_of(const std::string& label, const Eigen::Vector3d& position) {
  const Eigen::Vector3d p = position * 1e3;
  return padded("  " + label, 26) + cell(p.x(), 12) + cell(p.y(), 12) + cell(p.z(), 12) + "\n";
}

void add_frames(const Estimate& estimate, std::string& text) {
  const std::string axes = "           x           y           z\n";
  text += "\nbase, as measured [mm]    " + axes + row_of("origin", estimate.X_WB.translation());
  double roll = 0.0;
  double pitch = 0.0;
  double yaw = 0.0;
  to_kdl(estimate.X_WB).M.GetRPY(roll, pitch, yaw);
  text += "  roll, pitch, yaw [deg]  ";
  for (const double angle : {roll, pitch, yaw}) {
    text += cell(angle * kDegrees.per_si, 12, kDegrees.decimals);
  }
  text += "\n\ntargets on the flange [mm]" + axes;
  for (const TargetFrame& target : estimate.targets) {
    text += row_of(target.name, target.X_FT.translation());
  }
}

long fitted_configurations(const Measurements& measurements) {
  const std::vector<bool> trained = trained_configurations(measurements);
  return std::count(trained.begin(), trained.end(), true);
}

std::string sizes(const Measurements& measurements, const CalibrationResult& calibration) {
  return fmt::format("{} configurations, {} points, {} parameters", fitted_configurations(measurements),
                     calibration.accuracy.train.after.count, calibration.fit.free.size());
}

// The verdict, shown before any figure.
std::string verdict(const Measurements& measurements, const CalibrationResult& calibration) {
  if (calibration.trusted()) {
    const std::string converged = "Calibration converged: " + sizes(measurements, calibration) + ".\n";
    return calibration.diagnosis.reservation
               ? wrapped("Trusted where it was measured: " + calibration.diagnosis.reservation->message + ".", 0, 4) +
                     converged
               : converged;
  }
  std::string text;
  for (const Doubt& doubt : calibration.diagnosis.doubts) {
    text += wrapped((text.empty() ? "NOT TO BE TRUSTED: " : "Also: ") + doubt.message + ".", 0, 4);
  }
  for (const QualityFinding& finding : calibration.diagnosis.findings) {
    text += wrapped("Measurements: " + finding.message + ".", 0, 4);
  }
  return text + "\nCalibration of " + sizes(measurements, calibration) + ".\n";
}

void add_main_figures(const CalibrationResult& calibration, std::string& text) {
  const Accuracy& accuracy = calibration.accuracy;
  text += fmt::format("Position error, rms:  nominal {:.3f} mm -> calibrated {:.3f} mm  (fitted)\n",
                      accuracy.iso_before.accuracy.rms * 1e3, accuracy.iso_after.accuracy.rms * 1e3);
  if (accuracy.test && accuracy.iso_test_after) {
    text +=
        fmt::format("                      at the test rows {:.3f} mm\n", accuracy.iso_test_after->accuracy.rms * 1e3);
  }
  // The figures above are of the means of repeats; `position_error` of the result has those of single repeats.
  if (accuracy.iso_after.repeatability.count > 0) {
    text += fmt::format("                      single repeats: fitted {:.3f} mm{}\n", accuracy.train.after.rms * 1e3,
                        accuracy.test ? fmt::format(", test rows {:.3f} mm", accuracy.test->after.rms * 1e3) : "");
  }
  const BeforeAfter* held_out = calibration.accuracy.held_out();
  if (held_out == nullptr) {
    text += "                      at unseen configurations: not known\n";
  } else {
    text += fmt::format(
        "                      at unseen configurations {:.3f} mm  ({})\n", held_out->after.rms * 1e3,
        calibration.accuracy.leave_one_out ? "leave-one-out" : fmt::format("{}-fold", calibration.accuracy.folds));
    if (held_out->rigid) {
      text +=
          fmt::format("                      there by the exported URDF alone {:.3f} mm\n", held_out->rigid->rms * 1e3);
    }
  }
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
  check(measurements, calibration.model);
  check(calibration.fit.identification.estimate, calibration.model, measurements);
  std::string text = verdict(measurements, calibration);
  add_main_figures(calibration, text);
  if (!options.written.empty()) {
    text += wrapped("Written: " + comma_separated(options.written), 0, 9);
  }
  add_errors(calibration, text);
  add_figures(calibration, text);
  if (calibration.trusted()) {
    add_parameters(calibration, options.fixed, text);
    add_effects(calibration, measurements, text);
    if (options.convention != nullptr) {
      add_controller_offsets(calibration, *options.convention, text);
    }
    add_most_influential(measurements, calibration.uncertainty.influence, text);
    add_predictions(calibration.uncertainty.predicted.asked, text);
    add_frames(calibration.fit.identification.estimate, text);
  }
  return text;
}

}  // namespace kdl_calibration
