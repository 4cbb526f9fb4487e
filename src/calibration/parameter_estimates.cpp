#include "calibration/parameter_estimates.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <set>
#include <utility>

#include "base/distributions.hpp"
#include "calibration/noise_stage.hpp"

#include "model/kinematics.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

// Position and rotation vector of a frame as six parameters.
void add_frame_parameters(const std::vector<std::string>& names, const Eigen::Isometry3d& nominal,
                          const Eigen::Isometry3d& frame, std::vector<ParameterEstimate>& parameters) {
  const Eigen::Vector3d turn = rotation_log(frame.linear());
  const Eigen::Vector3d nominal_turn = rotation_log(nominal.linear());
  for (std::size_t i = 0; i < names.size(); ++i) {
    const auto axis = static_cast<Eigen::Index>(i % 3);
    const double value = i < 3 ? frame.translation()[axis] : turn[axis];
    const double before = i < 3 ? nominal.translation()[axis] : nominal_turn[axis];
    parameters.push_back({.name = names[i],
                          .joint = {},
                          .kind = i < 3 ? ParameterKind::translation : ParameterKind::rotation,
                          .axis = std::string(1, static_cast<char>('x' + axis)),
                          .nominal = before,
                          .value = value,
                          .error = value - before});
  }
}

// Length [m] of the parameter's link; that of a mean link if its frames coincide.
double link_length(const ErrorModel& model, const ErrorParameter& parameter) {
  const auto length = [&](std::size_t frame) {
    return (frame < model.joints.size() ? model.joints[frame].origin.p : model.tip_origin.p).Norm();
  };
  double reach = 0.0;
  for (std::size_t frame = 0; frame <= model.joints.size(); ++frame) {
    reach += length(frame);
  }
  constexpr double kNoLink = 0.1;     // of a mean link
  constexpr double kShortest = 0.01;  // [m] of a mean link, where joints that slide meet in one point
  const double mean = std::max(reach / static_cast<double>(model.joints.size() + 1), kShortest);
  const double own = length(static_cast<std::size_t>(parameter.frame));
  return own > kNoLink * mean ? own : mean;
}

// All parameters of base, targets, geometry and effects.
std::vector<ParameterEstimate> all_parameters(const ErrorModel& model, const Estimate& nominal,
                                              const Estimate& estimate) {
  std::vector<ParameterEstimate> all;
  const std::vector<std::string> bases = base_parameter_names(model);
  for (std::size_t station = 0; station < estimate.frames.bases.size(); ++station) {
    const auto first = bases.begin() + static_cast<std::ptrdiff_t>(6 * station);
    add_frame_parameters({first, first + 6}, nominal.frames.base(station), estimate.frames.base(station), all);
  }
  for (std::size_t k = 0; k < estimate.frames.targets.size(); ++k) {
    const TargetFrame& target = estimate.frames.targets[k];
    add_frame_parameters(target_parameter_names(target), nominal.frames.targets[k].X_FT, target.X_FT, all);
  }
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const ErrorParameter& parameter = model.parameters[p];
    const double error = estimate.errors[static_cast<Eigen::Index>(p)];
    all.push_back({.name = parameter.name,
                   .joint = parameter.joint,
                   .kind = parameter.kind,
                   .axis = parameter.axis == 'q' ? "" : std::string(1, parameter.axis),
                   .nominal = parameter.nominal,
                   .value = parameter.nominal + error,
                   .error = error});
  }
  for (std::size_t d = 0; d < model.effects.size() && estimate.effects.size() > 0; ++d) {
    const double value = estimate.effects[static_cast<Eigen::Index>(d)];
    all.push_back({.name = model.effects[d].name,
                   .joint = model.effects[d].joint,
                   .kind = ParameterKind::effect,
                   .axis = {},
                   .value = value,
                   .error = value});
  }
  return all;
}

}  // namespace

bool is_unknown(const ErrorModel& model, const ParameterEstimate& estimate) {
  constexpr double kAngle = 0.5;
  const auto found = std::find_if(model.parameters.begin(), model.parameters.end(),
                                  [&](const ErrorParameter& parameter) { return parameter.name == estimate.name; });
  return found != model.parameters.end() &&
         estimate.std > (is_length(model, *found) ? link_length(model, *found) : kAngle);
}

std::vector<ParameterEstimate> parameter_estimates(const ErrorModel& model, const Estimate& nominal,
                                                   const DeterminedFit& fit, const KnownOfParameters& known) {
  const Estimate& estimate = fit.identification.estimate;
  const std::vector<ValueUncertainty> uncertain = uncertainties(estimate, fit.free, known.covariance, known.noise);
  std::set<std::string> biased;  // parameters biased by fixed gauge parameters
  for (const std::vector<std::string>& group : known.tied) {
    biased.insert(group.begin(), group.end());
  }
  std::set<std::string> gauge;
  for (const GaugeParameter& parameter : fit.reduction.gauge) {
    gauge.insert(parameter.name);
  }
  const std::set<std::string> held(known.fixed_by_gauge.begin(), known.fixed_by_gauge.end());
  const std::set<std::string> kept(fit.reduction.kept.begin(), fit.reduction.kept.end());
  std::vector<ParameterEstimate> parameters;
  for (ParameterEstimate& parameter : all_parameters(model, nominal, estimate)) {
    const std::optional<Eigen::Index> column = fit.free.column(parameter.name);
    const bool estimated = column.has_value();
    parameter.gauge = gauge.count(parameter.name) > 0 || held.count(parameter.name) > 0;
    if (estimated) {
      const ValueUncertainty& value = uncertain[static_cast<std::size_t>(*column)];
      parameter.std = value.std;
      parameter.degrees_of_freedom = value.degrees_of_freedom;
      parameter.identifiable =
          std::isfinite(parameter.std) && !is_unknown(model, parameter) && biased.count(parameter.name) == 0;
    } else if (parameter.gauge) {
      parameter.std = std::numeric_limits<double>::infinity();
    }
    const bool known_frame = parameter.joint.empty() && parameter.name.find('.') != std::string::npos;
    if (estimated || parameter.gauge || known_frame || parameter.error != 0.0 || kept.count(parameter.name) > 0) {
      parameters.push_back(std::move(parameter));
    }
  }
  return parameters;
}

double half_width_95(double std, double degrees_of_freedom) {
  return std > 0.0 ? t_critical_95(degrees_of_freedom) * std : std;
}

}  // namespace kdl_calibration
