#include "effects/effect_terms.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <set>
#include <utility>

#include "base/number_text.hpp"
#include "base/random.hpp"
#include "effects/effect_functions.hpp"
#include "effects/joint_effects.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/drive_signals.hpp"
#include "model/kinematics.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

bool slides(const ErrorModel& model, std::size_t joint) { return model.joints[joint].type == JointType::prismatic; }

constexpr double kLeastLever = 1e-3;  // [m] least mean lever of a load that moves the play
constexpr double kPlay = 0.15;        // share of the mean torque at which the play has mostly changed sides

constexpr double kFunctions = 3.4;  // functions per length: 98.8 % of the variance
constexpr int kMostFunctions = 200;
constexpr double kUsualRipple = 100.0;  // periods per turn

constexpr int kSamples = 200;
constexpr double kDistinct = 0.15;  // least part of a torque not explained by others of its joint

MatrixXd generic_configurations(const ErrorModel& model) {
  Random random(1);
  MatrixXd q(static_cast<Index>(model.joints.size()), kSamples);
  for (Index c = 0; c < q.cols(); ++c) {
    for (Index i = 0; i < q.rows(); ++i) {
      const bool prismatic = model.joints[static_cast<std::size_t>(i)].type == JointType::prismatic;
      const double range = prismatic ? 1.0 : std::numbers::pi;
      q(i, c) = random.uniform(-range, range);
    }
  }
  follow(model.joints, q);
  return q;
}

std::vector<EffectTerm> candidates(const ErrorModel& model, std::size_t joint) {
  const std::string number = std::to_string(joint + 1);
  const auto first = static_cast<int>(joint);
  const auto tip = static_cast<int>(model.joints.size());
  const auto term = [&](const std::string& last, LoadTorque load) {
    return EffectTerm{.name = "gravity" + number + last,
                      .joint = model.joints[joint].name,
                      .index = first,
                      .function = std::move(load)};
  };
  std::vector<EffectTerm> result;
  if (!model.link_masses.empty()) {
    LoadTorque all;
    std::copy_if(model.link_masses.begin(), model.link_masses.end(), std::back_inserter(all.masses),
                 [&](const PointMass& mass) { return mass.frame >= first; });
    return {term("", std::move(all))};
  }
  for (int frame = first + 1; frame <= tip; ++frame) {
    result.push_back(term("_" + std::to_string(frame + 1), {.masses = {{.frame = frame}}}));
  }
  return result;
}

// The name is group, joint and `last`, joined by points.
EffectTerm term_of(const ErrorModel& model, std::size_t joint, EffectFunction function, const std::string& last = {},
                   EffectAxis axis = EffectAxis::own) {
  EffectTerm term{.name = {},
                  .joint = model.joints[joint].name,
                  .index = static_cast<int>(joint),
                  .axis = axis,
                  .function = std::move(function)};
  term.name = std::string(to_string(term.group())) + "." + std::to_string(joint + 1) + (last.empty() ? "" : "." + last);
  return term;
}

void add_gravity(const ErrorModel& model, std::size_t joint, std::vector<EffectTerm>& terms) {
  const auto add = [&](std::size_t link, int axis) {
    const std::string number = std::to_string(link + 1);
    const GravityMoment moment{.link = static_cast<int>(link), .axis = axis};
    terms.push_back(term_of(model, joint, moment, number + "xyzso"[axis]));
  };
  if (slides(model, joint)) {
    add(joint, GravityMoment::kOwn);
    return;
  }
  for (std::size_t link = joint; link < model.joints.size(); ++link) {
    for (int axis = 0; axis < 3; ++axis) {
      add(link, axis);
    }
    if (slides(model, link)) {
      add(link, GravityMoment::kSlide);
    }
  }
}

// Tilting moments from the next links only, because those of further links are similar.
void add_transverse(const ErrorModel& model, std::size_t joint, std::vector<EffectTerm>& terms) {
  constexpr std::size_t kLinks = 3;
  for (const EffectAxis across : {EffectAxis::across_x, EffectAxis::across_y}) {
    const std::string last = across == EffectAxis::across_x ? "x." : "y.";
    for (std::size_t link = joint; link < std::min(joint + kLinks, model.joints.size()); ++link) {
      for (int axis = 0; axis < 3; ++axis) {
        const GravityMoment moment{.link = static_cast<int>(link), .axis = axis};
        terms.push_back(term_of(model, joint, moment, last + std::to_string(link + 1) + "xyz"[axis], across));
      }
    }
  }
}

void add_backlash(const ErrorModel& model, std::size_t joint, const Stops& stops, std::vector<EffectTerm>& terms) {
  if (stops.signals.approach.size() > 0) {
    terms.push_back(term_of(model, joint, ApproachSide{}, "approach"));
  }
  double sum = 0.0;
  for (const JointFrames& at : stops.frames) {
    sum += std::abs(load_torque(model, joint, 1.0, at));
  }
  const double mean = sum / static_cast<double>(stops.q.cols());
  if (mean > kLeastLever) {
    terms.push_back(term_of(model, joint, LoadSide{.mass = 1.0 / (kPlay * mean)}));
  }
}

void add_torque(const ErrorModel& model, std::size_t joint, const Stops& stops, std::vector<EffectTerm>& terms) {
  if (!has_torques(stops.signals, static_cast<Index>(joint))) {
    return;
  }
  terms.push_back(term_of(model, joint, MeasuredTorque{}));
  double sum = 0.0;
  for (const double torque : raw_values(model, terms.back(), stops)) {
    sum += std::abs(torque);
  }
  if (sum > 0.0) {
    const double play = kPlay * sum / static_cast<double>(stops.q.cols());
    terms.push_back(term_of(model, joint, MeasuredTorque{.play = play}, "tanh"));
  }
}

void add_swing(const ErrorModel& model, std::size_t joint, Sinusoid swing, std::vector<EffectTerm>& terms) {
  for (const bool cosine : {false, true}) {
    swing.is_cosine = cosine;
    terms.push_back(term_of(model, joint, swing, (cosine ? "cos" : "sin") + shortest(swing.times)));
  }
}

// None of a joint that slides.
void add_swings(const ErrorModel& model, std::size_t joint, const std::vector<Sinusoid>& swings,
                std::vector<EffectTerm>& terms) {
  for (const Sinusoid& swing : swings) {
    if (!slides(model, joint)) {
      add_swing(model, joint, swing, terms);
    }
  }
}

void add_coupling(const ErrorModel& model, std::size_t joint, std::vector<EffectTerm>& terms) {
  constexpr std::size_t kBefore = 2;  // joints, as of a hollow wrist
  for (std::size_t back = 1; back <= std::min(kBefore, joint); ++back) {
    const std::size_t other = joint - back;
    const std::string number = std::to_string(other + 1);
    JointCoupling coupling{.joint = static_cast<int>(other)};
    terms.push_back(term_of(model, joint, coupling, number));
    coupling.times = 1.0;
    for (const bool cosine : {false, true}) {
      coupling.is_cosine = cosine;
      if (back == 1 && !slides(model, other)) {
        terms.push_back(term_of(model, joint, coupling, number + (cosine ? ".cos1" : ".sin1")));
      }
    }
  }
}

// Every link, every joint, and every joint that the payload turns. None where the circumstance is not stated; a
// temperature may be that of the link.
void add_circumstances(const ErrorModel& model, EffectGroup group, std::size_t joint, const DriveSignals& signals,
                       std::vector<EffectTerm>& terms) {
  const bool is_warm = has_temperature(signals, model.joints[joint].links);
  if (group == EffectGroup::payload && is_stated(signals, Circumstance::payload)) {
    terms.push_back(term_of(model, joint, PayloadTorque{model.payload_centre, model.payload_centres}));
  } else if (group == EffectGroup::drift && is_warm) {
    terms.push_back(term_of(model, joint, Temperature{}));
  } else if (group == EffectGroup::expansion && is_warm) {
    terms.push_back(term_of(model, joint, Temperature{.of_link = true}, {}, EffectAxis::along));
  }
}

constexpr double kLeastScale = 0.05;  // least standard deviation of a function of unit size
constexpr double kNew = 0.05;         // least part of a function not explained by others of its joint

bool has_no_unit_size(const EffectTerm& term) {
  const auto* const torque = std::get_if<MeasuredTorque>(&term.function);
  const auto* const coupling = std::get_if<JointCoupling>(&term.function);
  return std::holds_alternative<JointGain>(term.function) || std::holds_alternative<OwnFunction>(term.function) ||
         std::holds_alternative<Temperature>(term.function) || std::holds_alternative<PayloadTorque>(term.function) ||
         (torque != nullptr && torque->play == 0.0) || (coupling != nullptr && coupling->times == 0.0);
}

double largest_value(const VectorXd& values) {
  return values.array().isNaN().select(0.0, values.array().abs()).maxCoeff();
}

// Of the terms of each group that have no unit size: a payload on the last axis does not turn it but for rounding. The
// units of a caller's own functions are its own.
std::map<EffectGroup, double> largest_values(const ErrorModel& model, const std::vector<EffectTerm>& terms,
                                             const Stops& stops) {
  std::map<EffectGroup, double> largest;
  for (const EffectTerm& term : terms) {
    if (has_no_unit_size(term) && term.group() != EffectGroup::own && stops.q.cols() > 0) {
      double& value = largest[term.group()];
      value = std::max(value, largest_value(raw_values(model, term, stops)));
    }
  }
  return largest;
}

double value_at(const std::map<EffectGroup, double>& values, EffectGroup group) {
  const auto found = values.find(group);
  return found == values.end() ? 0.0 : found->second;
}

// Sets means and scales, and leaves out terms that the N joint values do not tell apart.
std::vector<EffectTerm> distinguishable_terms(const ErrorModel& model, const std::vector<EffectTerm>& terms,
                                              const Stops& stops) {
  constexpr double kRounding = 1e-9;
  const Index stop_count = stops.q.cols();
  const std::map<EffectGroup, double> largest = largest_values(model, terms, stops);
  std::vector<EffectTerm> kept;
  MatrixXd basis(stop_count, 0);
  std::pair<int, EffectAxis> moved = {-1, EffectAxis::own};
  for (EffectTerm term : terms) {
    if (std::pair(term.index, term.axis) != moved) {
      moved = {term.index, term.axis};
      basis.resize(stop_count, 0);
    }
    VectorXd values = raw_values(model, term, stops);
    const double rounding = kRounding * std::max(largest_value(values), value_at(largest, term.group()));
    const auto known = static_cast<double>(stop_count - values.array().isNaN().count());
    term.mean = values.array().isNaN().select(0.0, values).sum() / known;
    values = values.array().isNaN().select(0.0, values.array() - term.mean).matrix();
    term.scale = values.norm() / std::sqrt(known);
    if (!(term.scale > (has_no_unit_size(term) ? rounding : kLeastScale))) {
      continue;
    }
    VectorXd rest = values.normalized();
    for (int pass = 0; pass < 2; ++pass) {  // twice is enough (Kahan, in Parlett 1980)
      rest -= basis * (basis.transpose() * rest);
    }
    if (rest.norm() < kNew) {
      continue;
    }
    if (term.axis == EffectAxis::along && std::holds_alternative<Temperature>(term.function)) {
      term.scale /=
          link_before(model, static_cast<std::size_t>(term.index)).norm();  // one size for links of any length
    }
    basis.conservativeResize(Eigen::NoChange, basis.cols() + 1);
    basis.rightCols<1>() = rest.normalized();
    kept.push_back(std::move(term));
  }
  return kept;
}

// Where a column is lowest and highest, and up to 30 more places that are spread over the others.
OwnValues telling_values(const MatrixXd& joint_values, const MatrixXd& columns) {
  constexpr Index kPlaces = 30;
  std::set<Index> places;
  for (Index column = 0; column < columns.cols(); ++column) {
    Index place = 0;
    columns.col(column).minCoeff(&place);
    places.insert(place);
    columns.col(column).maxCoeff(&place);
    places.insert(place);
  }
  const Index count = std::min(kPlaces, columns.rows());
  for (Index i = 0; i < count; ++i) {
    places.insert(i * columns.rows() / count);
  }
  const std::vector<Index> chosen(places.begin(), places.end());
  return {.joint_values = joint_values(Eigen::all, chosen), .columns = columns(chosen, Eigen::all)};
}

}  // namespace

std::vector<EffectTerm> effect_terms(const ErrorModel& model, EffectGroup group, const MatrixXd& joint_values,
                                     const DriveSignals& signals) {
  if (group == EffectGroup::tables) {
    return table_terms(model, joint_values, std::numbers::pi / 6.0);
  }
  if (joint_values.cols() == 0) {
    return {};
  }
  const Stops stops{.q = joint_values, .signals = signals, .frames = joint_frames_of_all(model, joint_values)};
  std::vector<EffectTerm> all;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    switch (group) {
      case EffectGroup::gravity:
        add_gravity(model, joint, all);
        break;
      case EffectGroup::transverse:
        add_transverse(model, joint, all);
        break;
      case EffectGroup::gain:
        all.push_back(term_of(model, joint, JointGain{}));
        break;
      case EffectGroup::backlash:
        add_backlash(model, joint, stops, all);
        break;
      case EffectGroup::torque:
        add_torque(model, joint, stops, all);
        break;
      case EffectGroup::ripple:
        add_swings(model, joint, {{.times = kUsualRipple, .is_ripple = true}}, all);
        break;
      case EffectGroup::harmonics:
        add_swings(model, joint, {{.times = 1.0}, {.times = 2.0}}, all);
        break;
      case EffectGroup::coupling:
        add_coupling(model, joint, all);
        break;
      case EffectGroup::expansion:
      case EffectGroup::drift:
      case EffectGroup::payload:
        add_circumstances(model, group, joint, signals, all);
        break;
      case EffectGroup::tables:  // of all joints together, above
      case EffectGroup::own:     // own_terms
        break;
    }
  }
  return distinguishable_terms(model, all, stops);
}

std::vector<EffectTerm> main_gravity_terms(const ErrorModel& model, std::vector<EffectTerm> terms) {
  constexpr double kMain = 0.15;  // of the largest
  const VectorXd q = VectorXd::Zero(std::ssize(model.joints));
  const JointFrames at = joint_frames_of_all(model, q).front();
  std::vector<PointMass> masses = model.link_masses;
  for (std::size_t frame = 1; model.link_masses.empty() && frame < at.moved.size(); ++frame) {
    masses.push_back({.frame = static_cast<int>(frame)});
  }
  // Of a joint's torque a_i . sum_l (R_l m_l) x g, the constant m_l in the frame of link l.
  Eigen::Matrix3Xd moments = Eigen::Matrix3Xd::Zero(3, q.size());
  for (Index link = 0; link < q.size(); ++link) {
    const Eigen::Isometry3d& frame = at.moved[static_cast<std::size_t>(link)];
    const Eigen::Vector3d next = frame.inverse() * at.moved[static_cast<std::size_t>(link) + 1].translation();
    for (const PointMass& mass : masses) {
      if (mass.frame >= link) {
        moments.col(link) += mass.mass * (mass.frame == link ? to_eigen(mass.centre) : next);
      }
    }
  }
  const auto size = [&](const EffectTerm& term) {
    const auto& moment = std::get<GravityMoment>(term.function);
    return moment.axis < 3 ? std::abs(moments(moment.axis, moment.link)) : std::numeric_limits<double>::infinity();
  };
  double largest = 0.0;
  for (const EffectTerm& term : terms) {
    largest = std::isfinite(size(term)) ? std::max(largest, size(term)) : largest;
  }
  std::erase_if(terms, [&](const EffectTerm& term) { return size(term) < kMain * largest; });
  return terms;
}

std::vector<EffectTerm> own_terms(const ErrorModel& model, const OwnEffect& own, const MatrixXd& joint_values) {
  const std::string what = "effects.own: " + own.name;
  const std::size_t joint = joint_moved_by(what, own.joint, model);
  const MatrixXd columns = columns_by_row(what, own.columns, joint_values);
  const auto fitted = std::make_shared<const OwnValues>(telling_values(joint_values, columns));
  std::vector<EffectTerm> all;
  for (Index column = 0; column < columns.cols(); ++column) {
    all.push_back(term_of(model, joint,
                          OwnFunction{.effect = own.name, .columns = own.columns, .column = column, .fitted = fitted},
                          {}, own.axis));
    all.back().name =
        size_name(all.back()) + "." + std::to_string(joint + 1) + (column > 0 ? "." + std::to_string(column) : "");
  }
  const DriveSignals none;
  return distinguishable_terms(
      model, all, {.q = joint_values, .signals = none, .frames = joint_frames_of_all(model, joint_values)});
}

std::vector<EffectTerm> ripple_terms(const ErrorModel& model, const MatrixXd& joint_values, std::size_t joint,
                                     double times_a_turn) {
  std::vector<EffectTerm> pair;
  add_swing(model, joint, {.times = times_a_turn, .is_ripple = true}, pair);
  const DriveSignals none;
  return distinguishable_terms(
      model, pair, {.q = joint_values, .signals = none, .frames = joint_frames_of_all(model, joint_values)});
}

std::vector<EffectTerm> table_terms(const ErrorModel& model, const MatrixXd& joint_values, double length) {
  constexpr double kLeastTurn = std::numbers::pi / 18.0;
  constexpr double kLeastSlide = 0.02;
  std::vector<EffectTerm> result;
  for (std::size_t joint = 0; joint < model.joints.size() && joint_values.cols() > 0; ++joint) {
    const auto row = joint_values.row(static_cast<Index>(joint));
    JointTable table{.length = length, .lower = row.minCoeff(), .upper = row.maxCoeff()};
    const double range = table.upper - table.lower;
    if (range < (slides(model, joint) ? kLeastSlide : kLeastTurn)) {
      continue;
    }
    table.length = std::min(length, 0.5 * range);
    const double L = 0.5 * range + kTableBeyond * table.length;
    const int functions = std::min(static_cast<int>(std::ceil(kFunctions * L / table.length)), kMostFunctions);
    for (table.number = 1; table.number <= functions; ++table.number) {
      result.push_back(term_of(model, joint, table, std::to_string(table.number)));
    }
  }
  return result;
}

MatrixXd gravity_torques(const ErrorModel& model, const MatrixXd& joint_values) {
  MatrixXd torques(joint_values.rows(), joint_values.cols());
  const std::vector<JointFrames> frames = joint_frames_of_all(model, joint_values);
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    for (std::size_t c = 0; c < frames.size(); ++c) {
      torques(static_cast<Index>(joint), static_cast<Index>(c)) = load_torque(model, joint, 1.0, frames[c]);
    }
  }
  return torques;
}

std::vector<EffectTerm> load_terms(const ErrorModel& model) {
  const MatrixXd q = generic_configurations(model);
  const DriveSignals none;
  const Stops stops{.q = q, .signals = none, .frames = joint_frames_of_all(model, q)};
  struct Candidate {
    EffectTerm term;
    VectorXd torques;
  };
  std::vector<Candidate> all;
  double largest = 0.0;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    for (EffectTerm& term : candidates(model, joint)) {
      all.push_back({term, raw_values(model, term, stops)});
      largest = std::max(largest, all.back().torques.cwiseAbs().maxCoeff());
    }
  }
  std::vector<EffectTerm> kept;
  MatrixXd basis(kSamples, 0);
  int joint = -1;
  for (Candidate& candidate : all) {
    if (candidate.term.index != joint) {
      joint = candidate.term.index;
      basis = VectorXd::Constant(kSamples, 1.0 / std::sqrt(kSamples));  // a constant is equivalent to the joint offset
    }
    const VectorXd rest = candidate.torques - basis * (basis.transpose() * candidate.torques);
    const double peak = candidate.torques.cwiseAbs().maxCoeff();
    if (!(peak > 0.0) || peak < kDistinct * largest || rest.norm() < kDistinct * candidate.torques.norm()) {
      continue;
    }
    basis.conservativeResize(Eigen::NoChange, basis.cols() + 1);
    basis.rightCols<1>() = rest.normalized();
    candidate.term.scale = peak;
    kept.push_back(std::move(candidate.term));
  }
  return kept;
}

std::vector<EffectTerm> gain_terms(const ErrorModel& model) {
  std::vector<EffectTerm> result;
  for (std::size_t joint = 0; joint < model.joints.size(); ++joint) {
    result.push_back(term_of(model, joint, JointGain{}));
  }
  return result;
}

std::vector<EffectTerm> load_and_gain_terms(const ErrorModel& model) {
  std::vector<EffectTerm> result = load_terms(model);
  const std::vector<EffectTerm> gains = gain_terms(model);
  result.insert(result.end(), gains.begin(), gains.end());
  return result;
}

double ordinary_size(const EffectTerm& term) {
  constexpr double kOrdinaryGain = 1e-3;
  constexpr double kOrdinarySag = 5e-4;     // [rad or m] of a joint under gravity
  constexpr double kOrdinaryEffect = 1e-4;  // [rad or m] of any other effect
  switch (term.group()) {
    case EffectGroup::gain:
      return kOrdinaryGain * term.scale;
    case EffectGroup::gravity:
    case EffectGroup::payload:
      return kOrdinarySag;
    case EffectGroup::coupling: {
      const bool is_ratio = std::get<JointCoupling>(term.function).times == 0.0;
      return is_ratio ? kOrdinaryGain * term.scale : kOrdinaryEffect;
    }
    default:
      return kOrdinaryEffect;
  }
}

}  // namespace kdl_calibration
