#include "model/parameters.hpp"

#include <algorithm>

#include "kdl_calibration/input_error.hpp"
#include "measurements/stations.hpp"

namespace kdl_calibration {

bool is_length(const ErrorModel& model, const ErrorParameter& parameter) {
  return parameter.kind == ParameterKind::translation ||
         (parameter.kind == ParameterKind::joint_offset &&
          model.joints[static_cast<std::size_t>(parameter.frame)].type == JointType::prismatic);
}

bool is_length(const ErrorModel& model, const EffectTerm& term) {
  return term.axis == EffectAxis::along ||
         (term.axis == EffectAxis::own &&
          model.joints[static_cast<std::size_t>(term.index)].type == JointType::prismatic);
}

double usual_error(const ErrorModel& model, const ErrorParameter& parameter) {
  return is_length(model, parameter) ? 0.003 : 0.005;
}

KDL::Vector parameter_axis(const ErrorModel& model, const ErrorParameter& parameter) {
  return parameter.kind == ParameterKind::joint_offset
             ? model.joints[static_cast<std::size_t>(parameter.frame)].axis
             : KDL::Vector(parameter.axis == 'x', parameter.axis == 'y', parameter.axis == 'z');
}

std::size_t parameter_index(const ErrorModel& model, const std::string& name) {
  const auto found = std::find_if(model.parameters.begin(), model.parameters.end(),
                                  [&](const ErrorParameter& parameter) { return parameter.name == name; });
  if (found == model.parameters.end()) {
    throw InputError("no error parameter is named '" + name + "', expected one of the model's");
  }
  return static_cast<std::size_t>(found - model.parameters.begin());
}

const TargetFrame* find_target(const std::vector<TargetFrame>& targets, const std::string& name) {
  const auto found =
      std::find_if(targets.begin(), targets.end(), [&](const TargetFrame& target) { return target.name == name; });
  return found == targets.end() ? nullptr : &*found;
}

const Eigen::Isometry3d* find_base(const std::vector<StationBase>& bases, const std::string& station) {
  const auto found = std::find_if(bases.begin(), bases.end(), [&](const StationBase& base) {
    return base.station.empty() || base.station == station;
  });
  return found == bases.end() ? nullptr : &found->X_WB;
}

ErrorModel model_at_stations(const Measurements& measurements, ErrorModel model) {
  model.stations = measurements.stations;
  model.has_undetermined_bases = may_leave_bases_undetermined(measurements);
  return model;
}

const std::vector<std::string>& base_parameter_names() {
  static const std::vector<std::string> names = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"};
  return names;
}

std::vector<std::string> base_parameter_names(const ErrorModel& model) {
  if (!model.has_undetermined_bases) {
    return base_parameter_names();
  }
  std::vector<std::string> names;
  for (const std::string& station : model.stations) {
    for (const std::string& name : base_parameter_names()) {
      names.push_back("base[" + station + "]" + name.substr(name.find('.')));
    }
  }
  return names;
}

bool is_of_station(const std::string& name) { return name.rfind("base[", 0) == 0; }

std::vector<std::string> without_stations(std::vector<std::string> names) {
  std::erase_if(names, is_of_station);
  return names;
}

std::vector<std::string> target_parameter_names(const TargetFrame& target) {
  std::vector<std::string> names = {target.name + ".x", target.name + ".y", target.name + ".z"};
  if (target.with_orientation) {
    names.insert(names.end(), {target.name + ".Rx", target.name + ".Ry", target.name + ".Rz"});
  }
  return names;
}

std::vector<std::string> frame_parameter_names(const std::vector<TargetFrame>& targets,
                                               std::vector<std::string> names) {
  for (const TargetFrame& target : targets) {
    const std::vector<std::string> own = target_parameter_names(target);
    names.insert(names.end(), own.begin(), own.end());
  }
  return names;
}

double arm_length(const ErrorModel& model) {
  double length = model.tip_origin.p.Norm();
  for (const MovingJoint& joint : model.joints) {
    length += joint.origin.p.Norm();
  }
  return length;
}

double reach(const ErrorModel& model) {
  double length = model.tip_origin.p.Norm();
  for (std::size_t i = 0; i < model.joints.size(); ++i) {
    const MovingJoint& joint = model.joints[i];
    length += i > 0 ? joint.origin.p.Norm() : 0.0;
    if (joint.type == JointType::prismatic && joint.lower && joint.upper) {
      length += *joint.upper - *joint.lower;
    }
  }
  return length;
}

}  // namespace kdl_calibration
