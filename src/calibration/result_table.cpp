#include "kdl_calibration/result_table.hpp"

#include <locale.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>

namespace kdl_calibration {
namespace {

// printf with the decimal point of the C locale, whatever that of the program.
std::string format(const char* pattern, double value) {
  static const locale_t classic = ::newlocale(LC_ALL_MASK, "C", nullptr);
  const locale_t before = ::uselocale(classic);
  std::string text(static_cast<std::size_t>(std::snprintf(nullptr, 0, pattern, value)), '\0');
  std::snprintf(text.data(), text.size() + 1, pattern, value);
  ::uselocale(before);
  return text;
}

std::string padded(std::string text, std::size_t width) {
  text.resize(std::max(width, text.size()), ' ');
  return text;
}

void add_statistics(const char* label, const ErrorStatistics& statistics, std::string& text) {
  text += padded(label, 26) + format("%8.3f", statistics.rms * 1e3) + format("%8.3f", statistics.mean * 1e3) +
          format("%8.3f", statistics.p95 * 1e3) + format("%8.3f", statistics.max * 1e3) + "   " +
          std::to_string(statistics.count) + "\n";
}

void add_before_after(const char* what, const BeforeAfter& pair, std::string& text) {
  add_statistics((std::string(what) + ", nominal").c_str(), pair.before, text);
  add_statistics((std::string(what) + ", calibrated").c_str(), pair.after, text);
  if (pair.rigid) {
    add_statistics((std::string(what) + ", URDF alone").c_str(), *pair.rigid, text);
  }
}

// Accuracy of the means of the repeats, and repeatability where there are repeats.
void add_iso_line(const std::string& label, const ErrorStatistics& accuracy, const ErrorStatistics* repeatability,
                  std::string& text) {
  text += padded(label, 26) + format("%8.3f", accuracy.mean * 1e3) + format("%8.3f", accuracy.max * 1e3);
  const bool repeats = repeatability != nullptr && repeatability->count > 0;
  text += repeats ? format("%8.3f", repeatability->mean * 1e3) + format("%8.3f", repeatability->max * 1e3)
                  : "       -       -";
  text += "   " + std::to_string(accuracy.count) + "\n";
}

void add_iso_table(const Calibration& calibration, std::string& text) {
  text += "\n" + padded("ISO 9283 [mm]", 26) + " AP mean  AP max RP mean  RP max   points\n";
  const auto add = [&](const std::string& what, const Iso9283& before, const Iso9283& after) {
    add_iso_line(what + ", nominal", before.accuracy, &before.repeatability, text);
    add_iso_line(what + ", calibrated", after.accuracy, &after.repeatability, text);
  };
  add("fitted", calibration.iso_before, calibration.iso_after);
  if (calibration.iso_test_before && calibration.iso_test_after) {
    add("held out", *calibration.iso_test_before, *calibration.iso_test_after);
  }
  if (calibration.leave_one_out) {
    add_iso_line("leave-one-out, nominal", calibration.leave_one_out->before, nullptr, text);
    add_iso_line("leave-one-out, calibrated", calibration.leave_one_out->after, nullptr, text);
  }
}

std::string cook_number(double cook) { return std::isfinite(cook) ? format("%10.3f", cook) : "  not without"; }

void add_most_influential(const Measurements& measurements, const Influence& influence, std::string& text) {
  constexpr std::size_t kShown = 5;
  std::vector<ConfigurationInfluence> order = influence.configurations;
  if (order.empty()) {
    return;
  }
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.cook > b.cook; });
  const auto count = [&](auto member) {
    return std::to_string(std::count_if(order.begin(), order.end(), [&](const auto& entry) { return entry.*member; }));
  };
  text += "\nmost influential: " + count(&ConfigurationInfluence::influential) + " of " + std::to_string(order.size()) +
          format(" configurations have a Cook's distance above %.3f, ", influence.cook_limit) +
          count(&ConfigurationInfluence::high_leverage) + " a high leverage (*)\n";
  text += padded("  configuration", 26) + "    Cook's  leverage\n";
  for (std::size_t i = 0; i < std::min(kShown, order.size()); ++i) {
    text += padded("  " + measurements.configurations[static_cast<std::size_t>(order[i].configuration)], 26) +
            cook_number(order[i].cook) + format("%10.3f", order[i].leverage) + (order[i].high_leverage ? " *" : "") +
            "\n";
  }
}

void add_predictions(const std::vector<PredictedPoint>& points, std::string& text) {
  if (points.empty()) {
    return;
  }
  text += "\n" + padded("predicted, in the base [mm]", 28) + "           x           y           z 3D sigma  95 %\n";
  for (const PredictedPoint& point : points) {
    const Eigen::Vector3d p = point.position * 1e3;
    text += padded("  " + point.configuration + " " + point.target, 28) + format("%12.4f", p.x()) +
            format("%12.4f", p.y()) + format("%12.4f", p.z());
    text += std::isfinite(point.sigma) ? format("%9.4f", point.sigma * 1e3) + format("%9.4f", point.radius_95 * 1e3)
                                       : "   not determined by these measurements";
    text += "\n";
  }
}

// How people read a parameter.
struct DisplayUnit {
  double per_si;      // how many of it are one metre, one radian or 1
  const char* value;  // formats of the value and of its 1 sigma, down to some tenths of a micrometre or microradian
  const char* sigma;
  const char* name;
};
constexpr DisplayUnit kMillimetres{.per_si = 1e3, .value = "%10.4f", .sigma = "  +- %.4f", .name = " mm "};
constexpr DisplayUnit kDegrees{
    .per_si = 180.0 / std::numbers::pi, .value = "%10.5f", .sigma = "  +- %.5f", .name = " deg"};
constexpr DisplayUnit kPercent{.per_si = 100.0, .value = "%10.5f", .sigma = "  +- %.5f", .name = " %  "};

// A prismatic joint's offset and its deflection are lengths, and a gain is neither length nor angle.
const DisplayUnit& unit_of(const ErrorModel& model, const std::string& name) {
  const auto is_it = [&](const auto& entry) { return entry.name == name; };
  const auto deflection = std::find_if(model.deflections.begin(), model.deflections.end(), is_it);
  if (deflection != model.deflections.end()) {
    const bool slides = model.joints[static_cast<std::size_t>(deflection->index)].type == JointType::prismatic;
    return deflection->gain ? kPercent : slides ? kMillimetres : kDegrees;
  }
  return is_length(model, model.parameters[parameter_index(model, name)]) ? kMillimetres : kDegrees;
}

std::string parameter_line(const ErrorModel& model, const ParameterEstimate& parameter) {
  const std::size_t width = std::max<std::size_t>(6, parameter.name.size() + 1);
  const DisplayUnit& unit = unit_of(model, parameter.name);
  const std::string line = "  " + padded(parameter.name, width) + padded(parameter.joint, 22) +
                           format(unit.value, parameter.error * unit.per_si) + unit.name;
  if (parameter.gauge && !parameter.identifiable) {
    return line + "   zero by choice of gauge\n";
  }
  if (!parameter.identifiable) {
    return line + "   not determined\n";
  }
  return line + format(unit.sigma, parameter.std * unit.per_si) + "\n";
}

}  // namespace

std::string result_table(const Measurements& measurements, const Calibration& calibration) {
  const Identification& found = calibration.identification;
  std::string text = to_string(found.termination) + " after " + std::to_string(found.iterations) +
                     " iterations: " + found.message + "\n";
  text += "rank " + std::to_string(calibration.identifiability.rank) + " of " +
          std::to_string(calibration.identifiability.columns) + " parameters" +
          format(", condition number %.0f", calibration.identifiability.condition) +
          format(", noise %.4f mm per coordinate", calibration.noise.sigma * 1e3) +
          (calibration.noise.model == "residuals" ? " (from the residuals)\n" : " (as stated)\n");
  if (found.convergence_factor > 0.0) {
    text += format("each round left %.3f of the error of the round before\n", found.convergence_factor);
  }
  text += format("flange poses agree with the KDL solver to %.1e m\n", calibration.difference_to_kdl);
  text += "\n" + padded("position error [mm]", 26) + "     rms    mean     p95     max   points\n";
  add_before_after("fitted", calibration.train, text);
  if (calibration.test) {
    add_before_after("held out", *calibration.test, text);
  }
  if (calibration.leave_one_out) {
    add_before_after("leave-one-out", *calibration.leave_one_out, text);
  }
  if (calibration.nested_leave_one_out) {
    add_statistics("leave-one-out, nested", *calibration.nested_leave_one_out, text);
  }
  if (calibration.k_fold) {
    add_before_after("k-fold", *calibration.k_fold, text);
  }
  if (calibration.predicted.workspace.count > 0) {
    text += format("predicted 1 sigma of a point: %.3f mm at the measured configurations,",
                   calibration.predicted.measured.rms * 1e3) +
            format(" %.3f mm over the workspace\n", calibration.predicted.workspace.rms * 1e3);
  }
  add_iso_table(calibration, text);
  if (!calibration.tried.empty()) {
    const ModelOption& chosen = calibration.tried.front();
    text += format("chosen by cross-validation: priors %.3g mm", chosen.priors.length * 1e3) +
            format(" and %.3g mrad,", chosen.priors.angle * 1e3) + " gravity " + (chosen.gravity ? "yes" : "no") +
            ", joint gain " + (chosen.gain ? "yes" : "no") + "\n";
  }
  text += "\ngeometric errors (+- 1 sigma)\n";
  for (const ParameterEstimate& parameter : calibration.parameters) {
    if (parameter.name.find('.') == std::string::npos) {
      text += parameter_line(calibration.model, parameter);
    }
  }
  add_most_influential(measurements, calibration.influence, text);
  add_predictions(calibration.predicted.asked, text);
  text += "\ntargets on the flange [mm]\n";
  for (const TargetFrame& target : found.estimate.targets) {
    const Eigen::Vector3d p = target.X_FT.translation() * 1e3;
    text += "  " + padded(target.name, 6) + format("%12.4f", p.x()) + format("%12.4f", p.y()) +
            format("%12.4f", p.z()) + "\n";
  }
  return text;
}

}  // namespace kdl_calibration
