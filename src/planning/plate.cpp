#include "planning/plate.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include "base/decompositions.hpp"
#include "base/preconditions.hpp"
#include "effects/arm_kinematics.hpp"
#include "kdl_calibration/input_error.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "planning/places.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::Isometry3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

class Ball {
public:
  Ball(const VirtualRobot& robot, const Plate& plate, const JointRanges& ranges)
      : arm_(robot.model, robot.truth.errors, robot.truth.effects),
        joints_(robot.model.joints),
        ranges_(ranges),
        allowed_(plate.allowed),
        ball_(robot.truth.frames.targets.front().X_FT.translation()) {}

  Vector3d position(const VectorXd& q) const { return arm_.flange_pose(q) * ball_; }

  VectorXd any(Random& random) const { return random_configurations(joints_, ranges_, 1, random).col(0); }
  // The first of many that is allowed and has the ball at an allowed height [m].
  std::optional<VectorXd> any_allowed(double lowest, double highest, Random& random) const {
    constexpr int kTrials = 1000;
    for (int trial = 0; trial < kTrials; ++trial) {
      const VectorXd q = any(random);
      if (const double height = position(q).z(); height >= lowest && height <= highest && is_allowed(q)) {
        return q;
      }
    }
    return std::nullopt;
  }

  // Joint values that bring the ball to `goal` [m] in the base frame, by steps from random ones.
  std::optional<VectorXd> at(const Vector3d& goal, Random& random) const {
    constexpr int kStarts = 100;
    for (int start = 0; start < kStarts; ++start) {
      if (std::optional<VectorXd> q = near(any(random), goal); q && is_allowed(*q)) {
        return q;
      }
    }
    return std::nullopt;
  }

  // The same by Gauss-Newton steps from `q`, whatever is allowed.
  std::optional<VectorXd> near(VectorXd q, const Vector3d& goal) const {
    constexpr int kSteps = 60;
    constexpr double kReached = 1e-12;  // [m]
    constexpr double kLongest = 0.5;    // [rad] or [m] of a step
    for (int step = 0; step < kSteps; ++step) {
      Matrix6Xd jacobian;
      const Isometry3d X_BF = arm_.flange_pose(q, jacobian);
      const Vector3d error = goal - X_BF * ball_;
      if (error.norm() < kReached) {
        return q;
      }
      const MatrixXd J = jacobian.topRows<3>() - skew(X_BF.linear() * ball_) * jacobian.bottomRows<3>();
      const VectorXd move = shortest_solution(J, VectorXd(error));
      q += move * std::min(1.0, kLongest / move.norm());
    }
    return std::nullopt;
  }

private:
  bool is_allowed(const VectorXd& q) const {
    for (std::size_t i = 0; i < ranges_.size(); ++i) {
      const double value = q[static_cast<Index>(i)];
      if (!(value >= ranges_[i].first && value <= ranges_[i].second)) {
        return false;
      }
    }
    return !allowed_ || allowed_(q);
  }

  ArmKinematics arm_;
  const std::vector<MovingJoint>& joints_;
  const JointRanges& ranges_;
  const std::function<bool(const VectorXd&)>& allowed_;
  Vector3d ball_;
};

// A place of the plate with joint values (joints x configurations) for its sockets in turn.
struct PlacedPlate {
  Isometry3d X_BW = Isometry3d::Identity();
  MatrixXd joint_values;
};

std::optional<PlacedPlate> placed_plate(const Plate& plate, const Ball& ball, Index configurations, Random& random) {
  PlacedPlate result;
  const double first = plate.sockets.front().z();  // above the plate's origin, where it is horizontal
  const double above = plate.horizontal ? first : 0.0;
  const std::optional<VectorXd> q = ball.any_allowed(plate.lowest + above, plate.highest + above, random);
  if (!q) {
    return std::nullopt;
  }
  const Vector3d turn = normal_vector(random);
  result.X_BW.linear() = plate.horizontal
                             ? Eigen::AngleAxisd(std::numbers::pi * turn.z(), Vector3d::UnitZ()).toRotationMatrix()
                             : rotation_exp(turn);
  result.X_BW.translation() = ball.position(*q) - result.X_BW.linear() * plate.sockets.front();
  if (const double z = result.X_BW.translation().z(); z < plate.lowest || z > plate.highest) {
    return std::nullopt;
  }
  result.joint_values.resize(q->size(), configurations);
  for (Index c = 0; c < configurations; ++c) {
    const Vector3d& socket = plate.sockets[static_cast<std::size_t>(c) % plate.sockets.size()];
    const std::optional<VectorXd> there = ball.at(result.X_BW * (socket + plate.sigma * normal_vector(random)), random);
    if (!there) {
      return std::nullopt;
    }
    result.joint_values.col(c) = *there;
  }
  return result;
}

Measurements before_touches(const VirtualRobot& robot, Index configurations) {
  Measurements result;
  result.source = "simulation";
  for (const MovingJoint& joint : robot.model.joints) {
    result.joints.push_back(joint.name);
    result.joint_units.push_back(joint.type == JointType::prismatic ? JointUnit::metre : JointUnit::radian);
  }
  result.targets = {robot.truth.frames.targets.front().name};
  result.stations.clear();
  result.joint_values.resize(static_cast<Index>(robot.model.joints.size()), configurations);
  return result;
}

PlacedPlate found_place(const Plate& plate, const Ball& ball, Index configurations, Random& random) {
  constexpr int kTrials = 50;
  for (int trial = 0; trial < kTrials; ++trial) {
    if (std::optional<PlacedPlate> found = placed_plate(plate, ball, configurations, random)) {
      return std::move(*found);
    }
  }
  refuse_input("no place of the plate was found where the arm reaches every socket as it may",
               "sockets closer together, wider joint ranges or heights, fewer limits");
}

void require_touchable(double sigma, const VirtualRobot& robot) {
  require_sigma("the noise of a touch", sigma);
  require_count("targets of a robot that touches a plate", robot.truth.frames.targets.size(), 1);
  if (std::any_of(robot.model.joints.begin(), robot.model.joints.end(),
                  [](const MovingJoint& joint) { return joint.mimic.has_value(); })) {
    refuse_input("a robot with mimic joints and a plate", "independent joints");
  }
}

}  // namespace

Measurements touch(const Plate& plate, const JointRanges& ranges, Index configurations, Random& random,
                   VirtualRobot& robot) {
  require_touchable(plate.sigma, robot);
  require_at_least("sockets of a plate", plate.sockets.size(), 1);
  require_count("ranges of joints", ranges.size(), robot.model.joints.size());
  const Ball ball(robot, plate, ranges);
  Measurements result = before_touches(robot, configurations);
  std::vector<Isometry3d> bases;
  for (int station = 0; station < plate.places; ++station) {
    const Index first = configurations * station / plate.places;
    const Index count = configurations * (station + 1) / plate.places - first;
    const PlacedPlate found = found_place(plate, ball, count, random);
    bases.push_back(found.X_BW.inverse());
    result.stations.push_back("P" + std::to_string(station + 1));
    result.joint_values.middleCols(first, count) = found.joint_values;
    for (Index c = first; c < first + count; ++c) {
      result.configurations.push_back(std::to_string(c + 1));
      result.observations.push_back(
          {.reading = Point{plate.sockets[static_cast<std::size_t>(c - first) % plate.sockets.size()]},
           .sigma = plate.sigma,
           .configuration = static_cast<std::int32_t>(c),
           .station = static_cast<std::int16_t>(station)});
    }
  }
  robot.truth.frames.bases = std::move(bases);
  robot.model = model_at_stations(result, std::move(robot.model));
  return result;
}

Measurements touch_as_planned(const Measurements& plan, const TargetFrame& ball, double sigma, Random& random,
                              VirtualRobot& robot) {
  require_touchable(sigma, robot);
  const Plate plate{.sigma = sigma};
  const JointRanges anywhere(robot.model.joints.size());
  const VirtualRobot nominal = nominal_robot(robot.model, {ball});
  const Ball planned(nominal, plate, anywhere);
  const Ball own(robot, plate, anywhere);
  Measurements result = plan;
  result.targets = {ball.name};
  robot.truth.frames.bases.clear();
  for (std::size_t station = 0; station < plan.stations.size(); ++station) {
    std::vector<Observation*> rows;
    for (Observation& o : result.observations) {
      if (static_cast<std::size_t>(o.station) == station) {
        rows.push_back(&o);
      }
    }
    Eigen::Matrix3Xd sockets(3, std::ssize(rows));
    Eigen::Matrix3Xd balls(3, std::ssize(rows));
    for (std::size_t i = 0; i < rows.size(); ++i) {
      sockets.col(static_cast<Index>(i)) = rows[i]->position();
      balls.col(static_cast<Index>(i)) = planned.position(plan.joint_values.col(rows[i]->configuration));
    }
    const Isometry3d X_BW(Eigen::umeyama(sockets, balls, false));
    for (Observation* row : rows) {
      const Index c = row->configuration;
      const Vector3d goal = X_BW * (row->position() + sigma * normal_vector(random));
      const std::optional<VectorXd> q = own.near(plan.joint_values.col(c), goal);
      if (!q) {
        refuse_input("configuration " + plan.configurations[static_cast<std::size_t>(c)] + " of the plan",
                     "one that a robot with these errors reaches");
      }
      result.joint_values.col(c) = *q;
      row->reading = Point{row->position()};
      row->sigma = sigma;
    }
    robot.truth.frames.bases.push_back(X_BW.inverse());
  }
  robot.model = model_at_stations(result, std::move(robot.model));
  return result;
}

}  // namespace kdl_calibration
