#include "kdl_calibration/calibration.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/preconditions.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/new_point.hpp"
#include "diagnosis/own_alternatives.hpp"
#include "effects/joint_effects.hpp"
#include "interface/calibration_parts.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/version.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/readings.hpp"
#include "measurements/training_rows.hpp"
#include "model/error_chains.hpp"
#include "results/calibrated_urdf.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

KDL::Vector unit_vector(const Eigen::Vector3d& direction) {
  if (!direction.allFinite() || direction.isZero(0.0)) {
    throw OptionError("effects.gravity_direction", "expected three numbers x,y,z that are not all 0");
  }
  const Eigen::Vector3d unit = direction.stableNormalized();
  return {unit.x(), unit.y(), unit.z()};
}

void require_urdf(const Robot& robot) {
  if (robot.urdf.empty()) {
    refuse_input("the robot is empty", "a URDF, as load_robot or parse_robot reads it");
  }
}

EarlierResult earlier_result(const Calibration& earlier, const Robot& robot) {
  require_same_robot(robot, earlier);
  if (earlier.verdict() != Verdict::trusted) {
    throw OptionError("priors.earlier",
                      "is not trusted everywhere, expected a result whose parameters are all determined");
  }
  const CalibrationParts& parts = earlier.parts();
  if (parts.covariance.size() == 0) {
    throw OptionError("priors.earlier", "has no covariance, expected a result of at most 300 parameters");
  }
  const Unknowns own = parts.free.without(UnknownGroup::base).without(UnknownGroup::targets);
  const Eigen::Index first = parts.free.range(UnknownGroup::geometric).first;
  return {.terms = parts.model.effects,
          .prior = {.names = own.names(),
                    .mean = own.values(parts.estimate),
                    .covariance = parts.covariance.block(first, first, own.size(), own.size())},
          .rigid = own.without(UnknownGroup::effects).values({.errors = parts.urdf_errors}),
          .targets = parts.estimate.frames.targets,
          .noise = parts.noise.model};
}

CalibrationParts summary_of(const CalibrationResult& result) {
  const Diagnosis& diagnosis = result.diagnosis;
  CalibrationParts summary{{.model = result.model,
                            .estimate = result.fit.identification.estimate,
                            .free = result.fit.free,
                            .covariance = result.uncertainty.covariance,
                            .candidates = result.fit.candidates,
                            .undetermined = result.uncertainty.predicted.undetermined,
                            .noise = new_point_noise(result.noise),
                            .region = result.uncertainty.predicted.region}};
  summary.verdict = result.verdict();
  summary.doubts = diagnosis.reservation ? std::vector<Doubt>{*diagnosis.reservation} : diagnosis.doubts;
  summary.warnings = messages_of(diagnosis.remarks);
  summary.remarks = diagnosis.remarks;
  summary.accuracy = result.accuracy;
  summary.parameters = result.uncertainty.parameters;
  summary.shifts = result.uncertainty.shifts;
  summary.continues_earlier = result.selection.continued.has_value();
  summary.urdf_errors = result.exported.estimate.errors;
  if (result.exported.nominal_kept) {
    summary.urdf_errors.setZero();
  }
  return summary;
}

}  // namespace

const char* version() { return KDL_CALIBRATION_VERSION; }

std::string hash_of(const Measurements& measurements) {
  Sha256 hash;
  const auto add = [&](const auto& value) {
    hash.add({reinterpret_cast<const char*>(&value), sizeof value});  // NOLINT(*-reinterpret-cast): of any number
  };
  const auto add_each = [&](const auto& values) {
    add(values.size());
    for (const double value : values.reshaped()) {
      add(value);
    }
  };
  const auto add_names = [&](const std::vector<std::string>& names) {
    add(names.size());
    for (const std::string& name : names) {
      add(name.size());
      hash.add(name);
    }
  };
  const auto add_kind = ByKind{[](const Point&) {}, [&](const Pose& pose) { add_each(pose.orientation.coeffs()); },
                               [&](const Coordinates& some) {
                                 add_each(some.normal);
                                 add(some.count);
                               },
                               [&](const Distance& distance) { add(distance.length); }};
  // The bindings name every member: a new one does not compile before somebody decides whether it belongs to the hash.
  const auto& [source, joints, joint_values, configurations, targets, stations, observations, joint_units, remark,
               signals] = measurements;
  const auto& [approach, torques, circumstances, links, link_temperatures] = signals;
  add_each(joint_values);
  add_each(approach);
  add_each(torques);
  if (circumstances.size() > 0) {
    add_each(circumstances);
  }
  if (!links.empty()) {
    add_names(links);
    add_each(link_temperatures);
  }
  add(observations.size());
  for (const Observation& row : observations) {
    // `noise` is left out: a fit estimates it anew.
    const auto& [reading, sigma, order, configuration, target, repeat, split, station, noise] = row;
    add(reading.index());
    add_each(row.position());
    std::visit(add_kind, reading);
    add(sigma);
    add(order.has_value());
    add(order.value_or(0));
    add(configuration);
    add(target);
    add(repeat);
    add(split);
    add(station);
  }
  for (const std::vector<std::string>* names : {&joints, &configurations, &targets, &stations}) {
    add_names(*names);
  }
  return hash.hexadecimal();
}

void require_as_parsed(const Robot& robot) {
  require_urdf(robot);
  const Robot parsed = parse_robot(robot.urdf, {.base = robot.base, .tip = robot.tip}, robot.source);
  const auto same_frame = [](const KDL::Frame& a, const KDL::Frame& b) {  // KDL's comparison has a tolerance
    return to_eigen(a).matrix() == to_eigen(b).matrix();
  };
  const auto same = [&](const MovingJoint& a, const MovingJoint& b) {
    return a.name == b.name && a.type == b.type && same_frame(a.origin, b.origin) &&
           to_eigen(a.axis) == to_eigen(b.axis) && a.links == b.links;
  };
  if (!std::equal(robot.joints.begin(), robot.joints.end(), parsed.joints.begin(), parsed.joints.end(), same) ||
      !same_frame(robot.tip_origin, parsed.tip_origin) || robot.tip_joint != parsed.tip_joint) {
    refuse_input("the joints of " + robot.source + " are not those of its URDF text",
                 "a robot as load_robot or parse_robot gives it");
  }
}

void require_one_split(const Measurements& measurements) {
  std::vector<const Observation*> first(measurements.configurations.size(), nullptr);
  for (std::size_t row = 0; row < measurements.observations.size(); ++row) {
    const Observation& observation = measurements.observations[row];
    const auto configuration = static_cast<std::size_t>(observation.configuration);
    if (configuration >= first.size()) {
      return;  // which check() refuses
    }
    if (first[configuration] == nullptr) {
      first[configuration] = &observation;
    } else if (first[configuration]->split != observation.split) {
      refuse_input(fmt::format("{}: configuration {} has train and test rows (observation {})", measurements.source,
                               shown(measurements.configurations[configuration]), row),
                   "one of both in all of its rows");
    }
  }
}

void require_same_robot(const Robot& robot, const Calibration& calibration) {
  require_urdf(robot);
  if (hash_of(robot) != calibration.parts().robot) {
    refuse_input("the calibration was not made with " + robot.source, "the URDF, base and tip that were calibrated");
  }
}

void require_conventions(const DiagnosisOptions& options, const std::vector<MovingJoint>& joints) {
  if (options.convention) {
    matched_convention(*options.convention, independent_joint_names(joints));
  }
  for (const JointConvention& other : options.other_conventions) {
    matched_convention(other, other.urdf_joints);
  }
}

PredictionBasis nominal_basis(const Robot& robot) {
  PredictionBasis basis{.model = complete_model(robot)};
  basis.estimate.errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(basis.model.parameters.size()));
  return basis;
}

const CalibrationResult& fit_of(const Robot& robot, const Measurements& measurements, const Calibration& calibration) {
  require_same_robot(robot, calibration);
  const CalibrationParts& parts = calibration.parts();
  if (!parts.fitted) {
    refuse_input("the calibration was read from a file", "one that calibrate has just made");
  }
  if (hash_of(measurements) != parts.measurements) {
    refuse_input("these are other measurements than those of the calibration", "the same");
  }
  return *parts.fitted;
}

namespace {

// What the calibration without kept axes leaves. It serves for comparison only, so that nothing else is found out.
FreeAxes fit_with_free_axes(const ErrorModel& model, const Measurements& measurements, CalibrationSettings settings) {
  if (settings.selection.earlier) {
    return {.not_computed = "an earlier result with kept axes is continued", .train = {}, .held_out = {}};
  }
  settings.diagnosis.try_readings = false;
  settings.validation.nested = false;
  settings.predict_at = {};
  try {
    const CalibrationResult found = calibrate(model, measurements, settings);
    if (!has_converged(found.fit.identification)) {
      return {.not_computed = found.fit.identification.message, .train = {}, .held_out = {}};
    }
    const BeforeAfter* held_out = found.accuracy.held_out();
    return {.not_computed = {},
            .train = found.accuracy.train,
            .held_out = held_out != nullptr ? std::optional(*held_out) : std::nullopt};
  } catch (const InputError& error) {  // such as fewer equations than unknowns
    return {.not_computed = error.what(), .train = {}, .held_out = {}};
  }
}

// An earlier result is continued with the axes that it kept.
KeptAxes kept_axes(const CalibrationOptions& options) {
  const KeptAxes asked = options.parameters.keep_axes;
  const Calibration* earlier = options.priors.earlier;
  const KeptAxes kept = earlier != nullptr ? earlier->parts().model.kept_axes : asked;
  if (asked != KeptAxes::none && asked != kept) {
    throw OptionError("keep_axes", "the earlier result keeps other axes or none, expected one with the same option",
                      {"priors.earlier"});
  }
  return kept;
}

}  // namespace

void require_circumstances(const Measurements& measurements, const ErrorModel& model) {
  const DriveSignals& signals = measurements.signals;
  const auto require_all = [&](const std::string& what, const auto& row) {
    for (std::size_t c = 0; c < measurements.configurations.size(); ++c) {
      if (std::isnan(row[static_cast<Eigen::Index>(c)])) {
        throw InputError(measurements.source + ": configuration " + shown(measurements.configurations[c]) + " has no " +
                         what + ", expected one in each configuration or in none");
      }
    }
  };
  for (const Circumstance circumstance : {Circumstance::temperature, Circumstance::payload}) {
    if (!is_stated_of_any_link(signals, circumstance) && depend_on(model.effects, circumstance)) {
      throw InputError(measurements.source + ": no " + to_string(circumstance) +
                       ", expected the column that the effects of the result depend on");
    }
    if (is_stated(signals, circumstance)) {
      require_all(to_string(circumstance), signals.circumstances.row(static_cast<Eigen::Index>(circumstance)));
    }
  }
  for (Eigen::Index link = 0; link < signals.link_temperatures.rows(); ++link) {
    if (!signals.link_temperatures.row(link).array().isNaN().all()) {
      require_all("temperature_" + signals.links[static_cast<std::size_t>(link)], signals.link_temperatures.row(link));
    }
  }
  for (const EffectTerm& term : model.effects) {
    const std::vector<std::string>& links = model.joints[static_cast<std::size_t>(term.index)].links;
    if (depends_on_temperature(term) && !has_temperature(signals, links)) {
      throw InputError(measurements.source + ": no temperature_" + links.back() +
                       " and no temperature, expected one of the two: the effect " + term.name + " depends on it");
    }
  }
}

void require_links(const Measurements& measurements, const Robot& robot) {
  const std::string fault = fault_of_links(measurements.signals.links, link_names(robot), robot.joints);
  if (!fault.empty()) {
    throw InputError(measurements.source + ": " + fault);
  }
}

namespace {

// The means over the training configurations.
Circumstances mean_circumstances(const Measurements& measurements) {
  const DriveSignals& signals = measurements.signals;
  const std::vector<bool> trained = trained_configurations(measurements);
  Circumstances means = {.temperature = range_of(signals, Circumstance::temperature, trained).mean,
                         .payload = range_of(signals, Circumstance::payload, trained).mean};
  for (std::size_t link = 0; link < signals.links.size(); ++link) {
    const double mean = range_of_link(signals, static_cast<Eigen::Index>(link), trained).mean;
    if (!std::isnan(mean)) {
      means.link_temperatures[signals.links[link]] = mean;
    }
  }
  return means;
}

void require_centres_of_all(const std::vector<PayloadCentre>& centres, const DriveSignals& signals) {
  constexpr double kSame = 0.01;  // [kg]
  if (centres.empty() || !is_stated(signals, Circumstance::payload)) {
    return;
  }
  for (const double mass : signals.circumstances.row(static_cast<Eigen::Index>(Circumstance::payload))) {
    const bool is_known = std::isnan(mass) || mass == 0.0 ||
                          std::any_of(centres.begin(), centres.end(),
                                      [&](const PayloadCentre& one) { return std::abs(one.mass - mass) <= kSame; });
    if (!is_known) {
      throw OptionError("effects.payload_centres",
                        fmt::format("has no centre for the measured payload of {:g} kg, expected one for each", mass));
    }
  }
}

void take_payload_centres(const EffectOptions& options, const DriveSignals& signals, ErrorModel& model) {
  const Eigen::Vector3d& centre = options.payload_centre;
  require_finite("effects.payload_centre", centre.allFinite());
  model.payload_centre = {centre.x(), centre.y(), centre.z()};
  if (!options.payload_centres.empty() && !centre.isZero(0.0)) {
    throw OptionError("effects.payload_centres",
                      "states centres beside that of payload_centre, expected one of the two");
  }
  for (const auto& [mass, of_mass] : options.payload_centres) {
    if (!(mass > 0.0) || !(mass <= possible_range(Circumstance::payload).second)) {
      throw OptionError("effects.payload_centres", fmt::format("has a mass of {:g} kg, expected one above 0", mass));
    }
    require_finite("effects.payload_centres", of_mass.allFinite());
    model.payload_centres.push_back({.mass = mass, .centre = {of_mass.x(), of_mass.y(), of_mass.z()}});
  }
  require_centres_of_all(model.payload_centres, signals);
}

}  // namespace

CalibrationResult fit(const Robot& robot, const Measurements& measurements, const CalibrationOptions& options) {
  require_as_parsed(robot);
  require_one_split(measurements);
  require_links(measurements, robot);
  require_circumstances(measurements,
                        options.priors.earlier != nullptr ? options.priors.earlier->parts().model : ErrorModel());
  const KeptAxes kept = kept_axes(options);
  ErrorModel model = complete_model(robot, kept);
  model.gravity = unit_vector(options.effects.gravity_direction);
  require_conventions(options.diagnosis, model.joints);
  require_alternatives(options.diagnosis, model, measurements);
  take_payload_centres(options.effects, measurements.signals, model);
  model.circumstances = mean_circumstances(measurements);
  CalibrationSettings settings = settings_of(options);
  if (const Calibration* earlier = options.priors.earlier) {
    settings.selection.earlier = std::make_shared<EarlierResult>(earlier_result(*earlier, robot));
    model.gravity = earlier->parts().model.gravity;
    model.payload_centre = earlier->parts().model.payload_centre;
    model.payload_centres = earlier->parts().model.payload_centres;
  }
  CalibrationResult result = calibrate(model, measurements, settings);
  if (kept != KeptAxes::none) {
    ErrorModel free = complete_model(robot);
    free.gravity = model.gravity;
    free.payload_centre = model.payload_centre;
    free.payload_centres = model.payload_centres;
    free.circumstances = model.circumstances;
    result.free_axes = fit_with_free_axes(free, measurements, settings);
  }
  return result;
}

Calibration calibrate(const Robot& robot, const Measurements& measurements, const CalibrationOptions& options) {
  const auto fitted = std::make_shared<const CalibrationResult>(fit(robot, measurements, options));
  CalibrationParts parts = summary_of(*fitted);
  parts.robot = hash_of(robot);
  parts.measurements = hash_of(measurements);
  parts.fitted = fitted;
  return Calibration(std::make_shared<CalibrationParts>(std::move(parts)));
}

Calibration::Calibration(std::shared_ptr<const CalibrationParts> parts) : parts_(std::move(parts)) {
  if (!parts_) {
    refuse_input("a calibration of nothing", "one of calibrate or load_calibration");
  }
}

Verdict Calibration::verdict() const { return parts_->verdict; }
const std::vector<Doubt>& Calibration::doubts() const { return parts_->doubts; }
const std::vector<std::string>& Calibration::warnings() const { return parts_->warnings; }
const std::vector<Remark>& Calibration::remarks() const { return parts_->remarks; }
const Accuracy& Calibration::accuracy() const { return parts_->accuracy; }
const std::vector<ParameterEstimate>& Calibration::parameters() const { return parts_->parameters; }
std::vector<std::string> Calibration::estimated() const { return parts_->free.names(); }
const Eigen::MatrixXd& Calibration::covariance() const { return parts_->covariance; }

const ParameterEstimate& Calibration::parameter(const std::string& name) const {
  const auto found = std::find_if(parts_->parameters.begin(), parts_->parameters.end(),
                                  [&](const ParameterEstimate& parameter) { return parameter.name == name; });
  if (found == parts_->parameters.end()) {
    refuse_input("parameter " + shown(name) + " is not estimated", "a name among parameters()");
  }
  return *found;
}

namespace {

// Throws InputError where no effect depends on the temperature of this link.
void set_temperature(ErrorModel& model, const std::string& link, double temperature) {
  if (!std::isfinite(temperature)) {
    refuse_input("temperature of " + shown(link) + ": not finite", "a number");
  }
  const auto [least, most] = possible_range(Circumstance::temperature);
  if (!(temperature >= least && temperature <= most)) {
    refuse_input(fmt::format("temperature of {}: {} is impossible", shown(link), temperature),
                 fmt::format("{} to {}", least, most));
  }
  std::vector<std::string> possible;
  for (const EffectTerm& term : model.effects) {
    const std::vector<std::string>& links = model.joints[static_cast<std::size_t>(term.index)].links;
    if (!depends_on_temperature(term)) {
      continue;
    }
    if (std::find(links.begin(), links.end(), link) != links.end()) {
      for (const std::string& fixed : links) {
        model.circumstances.link_temperatures.erase(fixed);
      }
      model.circumstances.link_temperatures[link] = temperature;
      return;
    }
    if (std::find(possible.begin(), possible.end(), links.back()) == possible.end()) {
      possible.push_back(links.back());
    }
  }
  refuse_input("temperature of " + shown(link) + ": no effect of this calibration depends on it",
               possible.empty() ? "none" : "that of " + comma_separated(possible));
}

}  // namespace

Calibration Calibration::at(const Circumstances& circumstances) const {
  if (!states_any(circumstances)) {
    return *this;
  }
  CalibrationParts parts = *parts_;
  parts.fitted = nullptr;  // which is of the measured ones
  const auto take = [&](double value, Circumstance which, double& taken) {
    if (std::isnan(value)) {
      return;
    }
    if (!std::isfinite(value)) {
      refuse_input(std::string(to_string(which)) + ": not finite", "a number");
    }
    const auto [least, most] = possible_range(which);
    if (!(value >= least && value <= most)) {
      refuse_input(fmt::format("{}: {} is impossible", to_string(which), value), fmt::format("{} to {}", least, most));
    }
    if (!depend_on(parts.model.effects, which)) {
      refuse_input(std::string(to_string(which)) + ": no effect of this calibration depends on it", "none");
    }
    taken = value;
  };
  take(circumstances.temperature, Circumstance::temperature, parts.model.circumstances.temperature);
  take(circumstances.payload, Circumstance::payload, parts.model.circumstances.payload);
  if (!std::isnan(circumstances.temperature)) {
    parts.model.circumstances.link_temperatures.clear();
  }
  for (const auto& [link, temperature] : circumstances.link_temperatures) {
    set_temperature(parts.model, link, temperature);
  }
  return Calibration(std::make_shared<CalibrationParts>(std::move(parts)));
}

CalibratedArm Calibration::arm() const { return CalibratedArm(parts_); }

KDL::Chain Calibration::urdf_chain() const {
  origin_corrections(parts_->model, parts_->urdf_errors);  // throws where no URDF can have these errors
  return folded_chain(parts_->model, parts_->urdf_errors);
}

}  // namespace kdl_calibration
