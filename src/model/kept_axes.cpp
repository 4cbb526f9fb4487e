#include "model/kept_axes.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

// Numbers of URDFs are rounded: 3.1416 for pi. Beyond these limits axes are no longer what the closed forms take them
// for, and up to the wider ones somebody may have meant that they are.
constexpr double kExactAngle = 1e-5;   // [rad]
constexpr double kExactLength = 1e-5;  // [m]
constexpr double kNearAngle = 0.02;
constexpr double kNearLength = 1e-3;

constexpr double kLeastSine = 0.1;  // of axes that meet in one point

// Two neighbouring axes: how they stand to each other, and their points next to each other, from the origin of each
// joint along its axis.
struct Neighbours {
  double sine = 0.0;
  double distance = 0.0;
  double on_first = 0.0;
  double on_second = 0.0;
};

// In the frame of the second joint.
Neighbours neighbours(const std::vector<MovingJoint>& joints, std::size_t first) {
  const KDL::Frame& origin = joints[first + 1].origin;
  const KDL::Vector& a = joints[first + 1].axis;
  const KDL::Vector d = origin.M.Inverse(joints[first].axis);
  const KDL::Vector p = -origin.M.Inverse(origin.p);
  const KDL::Vector normal = d * a;
  Neighbours pair{.sine = normal.Norm()};
  if (pair.sine > kLeastSine) {
    const double cosine = KDL::dot(d, a);
    const double squared = pair.sine * pair.sine;
    pair.distance = std::abs(KDL::dot(p, normal)) / pair.sine;
    pair.on_first = (cosine * KDL::dot(p, a) - KDL::dot(p, d)) / squared;
    pair.on_second = (KDL::dot(p, a) - cosine * KDL::dot(p, d)) / squared;
  }
  return pair;
}

std::vector<Neighbours> all_neighbours(const std::vector<MovingJoint>& joints) {
  std::vector<Neighbours> pairs;
  for (std::size_t i = 0; i + 1 < joints.size(); ++i) {
    pairs.push_back(neighbours(joints, i));
  }
  return pairs;
}

// Runs of axes: pairs that belong together, extended while the next pair continues the run.
template <class Pair, class Continues>
std::vector<AxisRun> runs_of(std::size_t pairs, const Pair& pair, const Continues& continues) {
  std::vector<AxisRun> runs;
  for (std::size_t i = 0; i < pairs; ++i) {
    if (!pair(i)) {
      continue;
    }
    if (!runs.empty() && runs.back().last() == i && continues(i)) {
      ++runs.back().count;
    } else {
      runs.push_back({.first = i, .count = 2});
    }
  }
  return runs;
}

// Whether the closed forms need the run: a wrist, or the last two axes of an arm of Universal Robots.
bool is_needed(const AxisRun& meeting, const std::vector<AxisRun>& parallel) {
  return meeting.count > 2 || std::any_of(parallel.begin(), parallel.end(), [&](const AxisRun& run) {
           return run.count > 2 && run.last() + 1 == meeting.first;
         });
}

[[noreturn]] void refuse_nearly(const AxisRun& run, const std::vector<MovingJoint>& joints, const std::string& what,
                                const std::string& expected) {
  throw OptionError("keep_axes", fmt::format("the axes of {} {}, expected {}, as in the nominal robot",
                                             comma_separated(joint_names({run}, joints).front()), what, expected));
}

void require_parallel(const AxisRun& run, const std::vector<MovingJoint>& joints,
                      const std::vector<Neighbours>& pairs) {
  for (std::size_t i = run.first; i < run.last(); ++i) {
    if (pairs[i].sine > kExactAngle) {
      refuse_nearly(run, joints, fmt::format("are {:.2g} rad from parallel", pairs[i].sine), "exactly parallel ones");
    }
  }
}

void require_meeting(const AxisRun& run, const std::vector<MovingJoint>& joints, const std::vector<Neighbours>& pairs) {
  for (std::size_t i = run.first; i < run.last(); ++i) {
    const double beside =
        i == run.first ? 0.0 : std::abs(pairs[i].on_first - pairs[i - 1].on_second);  // along the axis that both share
    const double off = std::max(pairs[i].distance, beside);
    if (off > kExactLength) {
      refuse_nearly(run, joints, fmt::format("miss a common point by {:.2g} mm", off * 1e3), "a common point");
    }
  }
}

AxisRelations relations(const std::vector<MovingJoint>& joints, const std::vector<Neighbours>& pairs, KeptAxes kept) {
  const auto revolute = [&](std::size_t i) { return joints[i].type != JointType::prismatic; };
  AxisRelations found;
  found.parallel = runs_of(
      pairs.size(), [&](std::size_t i) { return pairs[i].sine < kNearAngle; }, [](std::size_t) { return true; });
  found.meeting = runs_of(
      pairs.size(),
      [&](std::size_t i) {
        return revolute(i) && revolute(i + 1) && pairs[i].sine > kLeastSine && pairs[i].distance < kNearLength;
      },
      [&](std::size_t i) { return std::abs(pairs[i].on_first - pairs[i - 1].on_second) < kNearLength; });
  if (kept == KeptAxes::closed_form) {
    std::erase_if(found.meeting, [&](const AxisRun& run) { return !is_needed(run, found.parallel); });
  }
  return found;
}

}  // namespace

const char* to_string(KeptAxes kept) {
  switch (kept) {
    case KeptAxes::none:
      return "none";
    case KeptAxes::closed_form:
      return "closed_form";
    case KeptAxes::angles:
      return "angles";
  }
  return "unknown";
}

AxisRelations axis_relations(const std::vector<MovingJoint>& joints, KeptAxes kept) {
  const std::vector<Neighbours> pairs = all_neighbours(joints);
  AxisRelations found = relations(joints, pairs, kept);
  for (const AxisRun& run : found.parallel) {
    require_parallel(run, joints, pairs);
  }
  for (const AxisRun& run : found.meeting) {
    require_meeting(run, joints, pairs);
  }
  if (found.parallel.empty() && found.meeting.empty()) {
    throw OptionError("keep_axes",
                      "no neighbouring axes of the robot are parallel, and no three meet in a point: none to keep");
  }
  return found;
}

std::vector<std::vector<std::string>> joint_names(const std::vector<AxisRun>& runs,
                                                  const std::vector<MovingJoint>& joints) {
  std::vector<std::vector<std::string>> names;
  for (const AxisRun& run : runs) {
    std::vector<std::string>& of_run = names.emplace_back();
    for (std::size_t i = run.first; i <= run.last(); ++i) {
      of_run.push_back(joints[i].name);
    }
  }
  return names;
}

std::vector<LinkErrors> link_errors(const std::vector<MovingJoint>& joints, KeptAxes kept) {
  std::vector<LinkErrors> links(joints.size() + 1);
  if (kept == KeptAxes::none) {
    return links;
  }
  const AxisRelations found = axis_relations(joints, kept);
  const std::vector<Neighbours> pairs = all_neighbours(joints);
  for (const AxisRun& run : found.parallel) {
    for (std::size_t i = run.first; i < run.last(); ++i) {
      links[i + 1].rotations = false;
    }
  }
  for (const AxisRun& run : found.meeting) {
    for (std::size_t i = run.first; i < run.last(); ++i) {
      links[i + 1].translations = false;
      links[i + 1].pivot = joints[i + 1].axis * pairs[i].on_second;
    }
    links[run.last() + 1].own_translation = true;
  }
  for (std::size_t i = 1; kept == KeptAxes::angles && i < joints.size(); ++i) {
    links[i].rotations = false;
  }
  return links;
}

FreeAxesModel with_free_axes(const ErrorModel& model, const Eigen::VectorXd& errors) {
  FreeAxesModel result{.model = model, .errors = errors};
  if (model.kept_axes == KeptAxes::none) {
    return result;
  }
  Robot robot;
  robot.joints = model.joints;
  robot.tip_origin = model.tip_origin;
  robot.tip_joint = model.tip_joint;
  std::vector<ErrorParameter>& all = result.model.parameters;
  all = complete_model(robot).parameters;
  const auto named = [&](const std::string& name) {
    return std::find_if(all.begin(), all.end(), [&](const ErrorParameter& p) { return p.name == name; });
  };
  for (const ErrorParameter& parameter : model.parameters) {
    if (named(parameter.name) == all.end()) {  // a translation along the link's own axis, before its rotations
      all.insert(std::find_if(all.begin(), all.end(),
                              [&](const ErrorParameter& p) {
                                return p.frame == parameter.frame && p.kind != ParameterKind::joint_offset;
                              }),
                 parameter);
    }
  }
  result.errors = Eigen::VectorXd::Zero(std::ssize(all));
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    result.errors[named(model.parameters[p].name) - all.begin()] = errors[static_cast<Eigen::Index>(p)];
  }
  return result;
}

}  // namespace kdl_calibration
