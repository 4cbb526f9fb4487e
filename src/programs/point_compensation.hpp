#pragma once

#include <Eigen/Geometry>
#include <functional>
#include <optional>
#include <string>

#include "interface/compensated_line.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/carrier.hpp"
#include "programs/controller.hpp"
#include "programs/controller_joints.hpp"
#include "programs/nearby_ways.hpp"
#include "programs/pose_numbers.hpp"
#include "programs/program.hpp"
#include "programs/wrist_arm.hpp"

namespace kdl_calibration {

/// Values of the six joints of an arm and of up to six external axes.
using ProgramJoints = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 12, 1>;

/// CompensatedPoint in little memory, as programs have many.
struct CommandedPoint {
  CompensationStatus status = CompensationStatus::unreachable;
  ProgramJoints joint_values;
  ProgramJoints change;
  double position_error = 0.0;
  double orientation_error = 0.0;

  operator CompensatedPoint() const {  // NOLINT(google-explicit-constructor): it is one
    return {.status = status,
            .joint_values = joint_values,
            .change = change,
            .position_error = position_error,
            .orientation_error = orientation_error};
  }
};

/// What became of a point of a program.
struct CompensatedPosition {
  std::string name;
  std::size_t line = 0;
  CommandedPoint point;       ///< joint values of the URDF that are commanded
  SixJoints change;           ///< of the controller's joints [rad]
  double displacement = 0.0;  ///< [m] of the commanded flange against the program's
  double rounding = 0.0;      ///< [m] displacement of the flange by rounding to the digits of the text
  double other_way = 0.0;     ///< [m] of another command that the controller may need: NearbyWays
  bool written = false;       ///< else the point is as it was, because it cannot be reached as it should

  /// Nominal joint values of the URDF for the program's point.
  CompensatedJoints asked() const { return point.joint_values - point.change; }
};

/// A robot, its calibration, its controller and the language of the program. Keeps references.
struct ProgramSetup {
  const Robot& robot;
  const Compensator& compensator;
  const Controller& controller;
  const ProgramLanguage& language;
  std::function<void()> check = {};  ///< called before each point, from any thread: throws to stop; may be empty
};

/// From where the arm comes to a point that does not state its joint values.
struct Approach {
  CompensatedJoints previous = {};  ///< nominal joint values of the point before
  bool is_straight = false;         ///< along a path: the arm keeps its configuration
};

/// Compensates single points of one program for one robot.
class PointCompensation {
public:
  /// Throws InputError for a chain whose joints before the six of the arm are not all external axes, and for another
  /// arm than those with a closed form of inverse kinematics if a point needs it (ProgramPoint::branch).
  PointCompensation(const ProgramSetup& setup, const Program& program, const std::vector<ProgramText>& texts);

  /// Whether the point is a pose whose joint values depend on where the arm comes from.
  static bool follows_previous(const ProgramPoint& point);

  /// Sets the numbers of the point. `approach`: for those that follow the point before.
  CompensatedPosition compensate(ProgramPoint& point, const Approach& approach = {}) const;

  /// Whether the ways in which the arm reaches a pose are known.
  bool knows_ways() const { return ways_.are_known(); }

  /// Whether shoulder, elbow and wrist stand on the same sides at both points; true for arms without a closed form.
  bool share_branch(const CompensatedPosition& a, const CompensatedPosition& b) const {
    return !arm_ || stays_in_branch(a.asked(), b.asked());
  }

  /// Of the tool from the asked straight line between two points.
  LineDeviation deviation(const CompensatedPosition& from, const CompensatedPosition& to,
                          const ProgramPoint& end) const;

private:
  [[noreturn]] void fail(const ProgramPoint& point, const std::string& what) const;
  std::string where(const ProgramPoint& point) const;
  std::optional<Eigen::Isometry3d> tool_frame(const ProgramPoint& point) const;
  Eigen::Isometry3d required_frame(const ProgramPoint& point, bool is_tool) const;
  CompensatedJoints all_joints(const ProgramPoint& point, const SixJoints& arm) const;
  Eigen::Isometry3d flange(const ProgramPoint& point, const PointNumbers& numbers) const;
  PointNumbers commanded_numbers(const ProgramPoint& point, const PointNumbers& old, const CompensatedJoints& q) const;
  PointNumbers numbers_in(const ProgramPoint& point) const;
  double unit(const ProgramPoint& point, std::size_t field) const;
  void set_numbers(ProgramPoint& point, const PointNumbers& numbers) const;

  CompensatedPoint solve(const ProgramPoint& point, const PointNumbers& numbers, const Approach& approach,
                         double& other_way) const;
  CompensatedPoint solve_near(const ProgramPoint& point, const Eigen::Isometry3d& X_BF, const Approach& approach,
                              double& other_way) const;
  bool is_reached(const Eigen::Isometry3d& X_BF, const CompensatedJoints& nominal) const;
  CompensatedPoint followed(const ProgramPoint& point, const Eigen::Isometry3d& X_BF,
                            const CompensatedJoints& near) const;
  SixJoints solution(const ProgramPoint& point, const Eigen::Isometry3d& X_CF) const;
  std::optional<SixJoints> turned(const ArmBranch& branch, const SixJoints& q) const;
  bool stays_in_branch(const CompensatedJoints& asked, const CompensatedJoints& commanded) const;
  bool states_turns(ProgramPoint& point, const SixJoints& commanded) const;

  const Compensator& compensator_;
  const Controller& controller_;
  const ProgramLanguage& language_;
  const ProgramFrames& frames_;
  const std::vector<ProgramText>& texts_;
  std::function<void()> check_;
  Carrier carrier_;
  Robot robot_;  // the arm alone
  ControllerJoints joints_;
  NearbyWays ways_;
  std::optional<WristArm> arm_;  // where points state a branch
};

}  // namespace kdl_calibration
