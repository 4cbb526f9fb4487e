#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>

#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"
#include "programs/carrier.hpp"
#include "programs/controller.hpp"
#include "programs/controller_joints.hpp"
#include "programs/pose_numbers.hpp"
#include "programs/program.hpp"
#include "programs/wrist_arm.hpp"

namespace kdl_calibration {

/// What became of a point of a program.
struct CompensatedPosition {
  std::string name;
  std::string source;
  std::size_t line = 0;
  CompensatedPoint point;     ///< joint values of the URDF that are commanded
  SixJoints change;           ///< of the controller's joints [rad]
  double displacement = 0.0;  ///< [m] of the commanded flange against the program's
  double rounding = 0.0;      ///< [m] displacement of the flange by rounding to the digits of the text
  bool written = false;       ///< else the point is as it was, because it cannot be reached as it should
};

/// A robot, its calibration, its controller and the language of the program. Keeps references.
struct ProgramSetup {
  const Robot& robot;
  const Compensator& compensator;
  const Controller& controller;
  const ProgramLanguage& language;
};

/// Compensates single points of one program for one robot.
class PointCompensation {
public:
  /// Throws InputError for a chain whose joints before the six of the arm are not all external axes, and for another
  /// arm than those with a closed form of inverse kinematics if a point needs it (ProgramPoint::branch).
  PointCompensation(const ProgramSetup& setup, const Program& program, const std::vector<ProgramText>& texts);

  struct Outcome {
    CompensatedPosition position;
    CompensatedJoints asked;  ///< nominal joint values of the URDF
  };

  /// Whether the point is a pose whose joint values depend on where the arm comes from.
  static bool follows_previous(const ProgramPoint& point);

  /// Sets the numbers of the point. `previous`: nominal joint values of the point before, for those that follow it.
  Outcome compensate(ProgramPoint& point, const CompensatedJoints& previous = {}) const;

  /// Whether shoulder, elbow and wrist stand on the same sides at both points; true for arms without a closed form.
  bool share_branch(const Outcome& a, const Outcome& b) const { return !arm_ || stays_in_branch(a.asked, b.asked); }

  /// [m] of the tool from the asked straight line between two points.
  double deviation(const Outcome& from, const Outcome& to, const ProgramPoint& end) const;

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

  CompensatedPoint solve(const ProgramPoint& point, const PointNumbers& numbers, const CompensatedJoints& previous,
                         CompensatedJoints& asked) const;
  CompensatedPoint solve_near(const ProgramPoint& point, const Eigen::Isometry3d& X_BF, const CompensatedJoints& near,
                              CompensatedJoints& asked) const;
  SixJoints solution(const ProgramPoint& point, const Eigen::Isometry3d& X_CF) const;
  std::optional<SixJoints> turned(const ArmBranch& branch, const SixJoints& q) const;
  bool stays_in_branch(const CompensatedJoints& asked, const CompensatedJoints& commanded) const;
  bool states_turns(ProgramPoint& point, const SixJoints& commanded) const;

  const Compensator& compensator_;
  const Controller& controller_;
  const ProgramLanguage& language_;
  const ProgramFrames& frames_;
  const std::vector<ProgramText>& texts_;
  Carrier carrier_;
  Robot robot_;  // the arm alone
  ControllerJoints joints_;
  std::optional<WristArm> arm_;  // where points state a branch
};

}  // namespace kdl_calibration
