#include "effects/effect_functions.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <string>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/kinematics.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Ref;
using Eigen::Vector3d;
using Eigen::VectorXd;

namespace {

// Torque (force for a prismatic joint) of a unit mass about the joint's axis, with g = 1.
double unit_torque(const ErrorModel& model, std::size_t joint, const Vector3d& centre, const JointFrames& frames) {
  const Vector3d gravity = to_eigen(model.gravity);
  const Vector3d lever = centre - frames.moved[joint].translation();
  const Vector3d effect = model.joints[joint].type == JointType::prismatic ? gravity : Vector3d(lever.cross(gravity));
  return frames.axis(joint).dot(effect);
}

// Beyond its ends a table keeps the state of its end.
bool is_withheld(const JointTable& table, double q) {
  const double held = std::clamp(q, table.lower, table.upper);
  return std::any_of(table.withheld.begin(), table.withheld.end(),
                     [&](const auto& range) { return range.first <= held && held <= range.second; });
}

}  // namespace

bool is_withheld(const EffectTerm& term, double q) {
  const auto* const table = std::get_if<JointTable>(&term.function);
  return table != nullptr && is_withheld(*table, q);
}

bool withholds_tables(const ErrorModel& model, const VectorXd& q) {
  return std::any_of(model.effects.begin(), model.effects.end(),
                     [&](const EffectTerm& term) { return is_withheld(term, q[term.index]); });
}

Vector3d JointFrames::axis(std::size_t joint, EffectAxis axis) const {
  return axes[joint].col(axis == EffectAxis::own ? 2 : axis == EffectAxis::across_x ? 0 : 1);
}

JointFrames joint_frames(const ErrorModel& model, const Ref<const VectorXd>& q, std::pmr::memory_resource* memory) {
  JointFrames frames{.axes = std::pmr::vector<Matrix3d>(memory), .moved = std::pmr::vector<Eigen::Isometry3d>(memory)};
  frames.axes.reserve(model.joints.size());
  frames.moved.reserve(model.joints.size() + 1);
  KDL::Frame pose = KDL::Frame::Identity();
  for (std::size_t i = 0; i < model.joints.size(); ++i) {
    const MovingJoint& joint = model.joints[i];
    pose = pose * joint.origin;
    frames.axes.emplace_back(to_eigen(pose).linear() * z_onto(to_eigen(joint.axis)));
    const double value = q[static_cast<Index>(i)];
    pose = pose * (joint.type == JointType::prismatic ? KDL::Frame(joint.axis * value)
                                                      : KDL::Frame(KDL::Rotation::Rot2(joint.axis, value)));
    frames.moved.push_back(to_eigen(pose));
  }
  frames.moved.push_back(to_eigen(pose * model.tip_origin));
  return frames;
}

std::vector<JointFrames> joint_frames_of_all(const ErrorModel& model, const MatrixXd& joint_values) {
  std::vector<JointFrames> result;
  result.reserve(static_cast<std::size_t>(joint_values.cols()));
  for (Index c = 0; c < joint_values.cols(); ++c) {
    result.push_back(joint_frames(model, joint_values.col(c)));
  }
  return result;
}

// sqrt of the spectral density of the Matérn-3/2 covariance of unit variance at the function's frequency, times the
// function, orthonormal on [-L, L].
double table_value(const JointTable& table, double q) {
  const double half = 0.5 * (table.upper - table.lower);
  const double middle = 0.5 * (table.upper + table.lower);
  const double L = half + kTableBeyond * table.length;
  const double frequency = table.number * std::numbers::pi / (2.0 * L);
  const double x = std::clamp(q, table.lower, table.upper) - middle;
  const double width = frequency * table.length;
  return std::sqrt(4.0 * table.length / (std::sqrt(3.0) * L)) * std::sin(frequency * (x + L)) /
         (1.0 + width * width / 3.0);
}

double load_torque(const ErrorModel& model, std::size_t joint, double mass, const JointFrames& frames) {
  double sum = 0.0;
  for (std::size_t frame = joint + 1; frame < frames.moved.size(); ++frame) {
    sum += mass * unit_torque(model, joint, frames.moved[frame].translation(), frames);
  }
  return sum;
}

namespace {

Vector3d centre_of(const PayloadTorque& payload, double mass) {
  if (payload.centres.empty()) {
    return to_eigen(payload.centre);
  }
  const PayloadCentre* below = nullptr;
  for (const PayloadCentre& one : payload.centres) {
    if (mass <= one.mass) {
      if (below == nullptr) {
        return to_eigen(one.centre);
      }
      const double share = (mass - below->mass) / (one.mass - below->mass);
      return ((1.0 - share) * below->mass * to_eigen(below->centre) + share * one.mass * to_eigen(one.centre)) / mass;
    }
    below = &one;
  }
  return to_eigen(below->centre);
}

// Evaluates each kind of function for one term at one configuration.
struct RawValue {
  const ErrorModel& model;
  const EffectTerm& term;
  const Stop& stop;
  std::size_t joint = static_cast<std::size_t>(term.index);
  double own = stop.q[term.index];

  double operator()(const GravityMoment& moment) const {
    const Vector3d gravity = to_eigen(model.gravity);
    const Vector3d axis = stop.frames.axis(joint, term.axis);
    const auto link = static_cast<std::size_t>(moment.link);
    switch (moment.axis) {
      case GravityMoment::kOwn:
        return axis.dot(gravity);
      case GravityMoment::kSlide:
        return stop.q[static_cast<Index>(link)] * axis.dot(stop.frames.axis(link).cross(gravity));
      default:
        return axis.dot(Vector3d(stop.frames.moved[link].linear().col(moment.axis)).cross(gravity));
    }
  }

  double operator()(const LoadTorque& load) const {
    double sum = 0.0;
    for (const PointMass& mass : load.masses) {
      const Vector3d centre = stop.frames.moved[static_cast<std::size_t>(mass.frame)] * to_eigen(mass.centre);
      sum += mass.mass * unit_torque(model, joint, centre, stop.frames);
    }
    return sum;
  }
  double operator()(const JointGain& /*gain*/) const { return own; }
  double operator()(const LoadSide& side) const { return std::tanh(load_torque(model, joint, side.mass, stop.frames)); }
  double operator()(const ApproachSide& /*side*/) const { return signal(stop.signals.approach); }
  double operator()(const Sinusoid& swing) const {
    return swing.is_cosine ? std::cos(swing.times * own) : std::sin(swing.times * own);
  }
  double operator()(const JointTable& table) const { return is_withheld(table, own) ? 0.0 : table_value(table, own); }

  double operator()(const MeasuredTorque& measured) const {
    const double torque = signal(stop.signals.torques);
    if (std::isnan(torque)) {
      throw InputError(
          "no measured torque of " + model.joints[joint].name +
          (stop.signals.torques.size() > 0 ? " at configuration number " + std::to_string(stop.column + 1) : "") +
          ", expected one for the effect " + term.name);
    }
    return measured.play > 0.0 ? std::tanh(torque / measured.play) : torque;
  }

  double operator()(const JointCoupling& coupling) const {
    const double other = stop.q[coupling.joint];
    return coupling.times == 0.0 ? other
           : coupling.is_cosine  ? std::cos(coupling.times * other)
                                 : std::sin(coupling.times * other);
  }
  double operator()(const Temperature& temperature) const {
    const double degrees = temperature_before_joint();
    return temperature.of_link ? degrees * link_before(model, joint).norm() : degrees;
  }
  double operator()(const PayloadTorque& payload) const {
    const double mass = around(Circumstance::payload, model.circumstances.payload);
    return mass * unit_torque(model, joint, stop.frames.moved.back() * centre_of(payload, mass), stop.frames);
  }
  double operator()(const OwnFunction& of_caller) const {
    return own_values(of_caller, own_columns(of_caller.effect, of_caller.columns, stop.q))[0];
  }

  // The model's where the configuration states none.
  double around(Circumstance circumstance, double otherwise) const {
    const MatrixXd& stated = stop.signals.circumstances;
    const double value =
        stated.size() > 0 ? stated(static_cast<Index>(circumstance), stop.column) : Circumstances::kUnknown;
    return std::isnan(value) ? otherwise : value;
  }

  // That of the link before the joint: its own, else the arm's; the model's where the configuration states none.
  double temperature_before_joint() const {
    const std::vector<std::string>& links = model.joints[joint].links;
    const DriveSignals& stated = stop.signals;
    for (std::size_t row = 0; row < stated.links.size(); ++row) {
      const double value = stated.link_temperatures(static_cast<Index>(row), stop.column);
      if (!std::isnan(value) && std::find(links.begin(), links.end(), stated.links[row]) != links.end()) {
        return value;
      }
    }
    return around(Circumstance::temperature, temperature_before(model.joints[joint], model.circumstances));
  }

  // NaN if no such signals were measured.
  double signal(const MatrixXd& values) const {
    return values.size() > 0 ? values(term.index, stop.column) : std::numeric_limits<double>::quiet_NaN();
  }
};

}  // namespace

double raw_value(const ErrorModel& model, const EffectTerm& term, const Stop& stop) {
  return std::visit(RawValue{.model = model, .term = term, .stop = stop}, term.function);
}

namespace {

std::string in_words(const Ref<const VectorXd>& q) {
  std::string text;
  for (const double value : q) {
    text += (text.empty() ? "" : ", ") + shortest(value);
  }
  return text;
}

}  // namespace

MatrixXd own_columns(const std::string& effect, const OwnColumns& columns, const MatrixXd& joint_values) {
  return checked_columns("effects.own: " + effect, columns, joint_values);
}

MatrixXd checked_columns(const std::string& what, const OwnColumns& columns, const MatrixXd& joint_values) {
  MatrixXd values = columns(joint_values);
  const auto fail = [&](const std::string& given, const std::string& expected) {
    throw InputError(what + " gives " + given + ", expected " + expected);
  };
  const Index count = joint_values.cols();
  if (values.rows() != count || values.cols() == 0) {
    fail(std::to_string(values.rows()) + " rows of " + std::to_string(values.cols()) + " columns",
         "a row for each of the " + std::to_string(count) + " configurations and at least one column");
  }
  for (Index c = 0; c < count; ++c) {
    if (!values.row(c).allFinite()) {
      fail("a value that is not finite at joint values " + in_words(joint_values.col(c)), "finite numbers");
    }
  }
  return values;
}

std::size_t joint_moved_by(const std::string& what, const std::string& joint, const ErrorModel& model) {
  const auto found = std::find_if(model.joints.begin(), model.joints.end(),
                                  [&](const MovingJoint& moving) { return moving.name == joint; });
  if (found == model.joints.end()) {
    throw InputError(what + " moves " + joint + ", expected a moving joint of the robot");
  }
  return static_cast<std::size_t>(found - model.joints.begin());
}

void require_named(const char* option, const std::string& name, const OwnColumns& function,
                   std::set<std::string>& others) {
  const bool is_word = !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_' || c == '-';
  });
  if (!is_word) {
    throw OptionError(option, shown(name) + " is not accepted as a name, expected letters, digits, _ and -");
  }
  if (!others.insert(name).second) {
    throw OptionError(option, name + " is given twice, expected each name once");
  }
  if (!function) {
    throw OptionError(option, name + " has no function, expected one of the joint values");
  }
}

MatrixXd columns_by_row(const std::string& what, const OwnColumns& function, const MatrixXd& joint_values) {
  constexpr double kSame = 1e-9;
  MatrixXd columns = checked_columns(what, function, joint_values);
  if (joint_values.cols() == 0) {
    return columns;
  }
  for (const Index c : {Index{0}, joint_values.cols() - 1}) {
    const MatrixXd alone = checked_columns(what, function, joint_values.col(c));
    if (alone.cols() != columns.cols() || !((alone.row(0) - columns.row(c)).norm() <= kSame * columns.norm())) {
      throw InputError(what +
                       " gives other values at one configuration than among all, expected a function of the joint "
                       "values of each alone");
    }
  }
  return columns;
}

VectorXd own_values(const OwnFunction& own, const MatrixXd& columns) {
  if (own.column >= columns.cols()) {
    throw InputError("effects.own: " + own.effect + " gives " + std::to_string(columns.cols()) +
                     " columns, expected as many as when it was fitted");
  }
  return columns.col(own.column);
}

VectorXd raw_values(const ErrorModel& model, const EffectTerm& term, const Stops& stops) {
  if (const auto* const own = std::get_if<OwnFunction>(&term.function)) {
    return own_values(*own, own_columns(own->effect, own->columns, stops.q));
  }
  VectorXd result(stops.q.cols());
  for (Index c = 0; c < result.size(); ++c) {
    result[c] = raw_value(model, term, {stops.q.col(c), stops.frames[static_cast<std::size_t>(c)], stops.signals, c});
  }
  return result;
}

}  // namespace kdl_calibration
