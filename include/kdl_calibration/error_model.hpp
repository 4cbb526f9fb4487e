#pragma once

// What may be wrong with a robot's geometry, and what moves its joints beside it.
//
//     const ErrorModel model = complete_model(robot);
//     const KDL::Chain chain = error_chain(model, errors);  // every error is a fixed segment named after it

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <kdl/chain.hpp>
#include <kdl/frames.hpp>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "kdl_calibration/robot.hpp"
#include "kdl_calibration/version.hpp"

namespace KDL_CALIBRATION_PUBLIC kdl_calibration {

Eigen::Vector3d to_eigen(const KDL::Vector& v);
Eigen::Isometry3d to_eigen(const KDL::Frame& X_AB);
KDL::Frame to_kdl(const Eigen::Isometry3d& X_AB);

/// An `effect` is a coefficient of an EffectTerm, not an error parameter of the geometry.
enum class ParameterKind { joint_offset, translation, rotation, effect };

const char* to_string(ParameterKind kind);

/// One geometric error parameter: an offset dq_i of joint i, or a translation or rotation of link i along an axis of
/// the frame at the link's far end. Its value is zero for the nominal robot [m] or [rad].
struct ErrorParameter {
  std::string name;   ///< "dq2", "Tx1", "Rz4": letter of the axis, number of the link (0 is the base link)
  std::string joint;  ///< the URDF joint whose origin includes it; empty if none does
  ParameterKind kind = ParameterKind::joint_offset;
  char axis = ' ';       ///< 'x', 'y', 'z' in the frame it acts in; for an offset the joint's own axis, 'q' if skew
  int frame = 0;         ///< index of the joint in whose frame it acts; the number of joints means the tip's frame
  double nominal = 0.0;  ///< [m] for translations: the nominal offset along this axis; else 0
};

/// A mass that hangs on the chain.
struct PointMass {
  int frame = 0;  ///< index of the moving joint whose link carries it (number of joints: the tip)
  double mass = 1.0;
  KDL::Vector centre;  ///< in that frame, after the joint's motion [m]
};

/// Kinds of motion of the joints beyond the geometry. `src/README.md` lists the places that a new kind needs.
enum class EffectGroup : std::uint8_t {
  gravity,     ///< joint compliance under the arm's weight
  transverse,  ///< bearing compliance across the axis, under the same weight
  gain,        ///< motion proportional to, but not equal to, the command
  backlash,    ///< play, on the side given by load or direction of approach
  harmonics,   ///< eccentric encoder or gear: once and twice per turn
  ripple,      ///< gear error of many periods per turn
  tables,      ///< any smooth function of the joint value
  torque,      ///< joint compliance under the measured torque
  coupling,    ///< motion with the joints before it, through gears or a linkage
  expansion,   ///< links that grow with temperature
  drift,       ///< zeros of joints that move with temperature
  payload,     ///< joint compliance under a stated payload
  own          ///< a function of the caller's own, see OwnEffect
};
constexpr std::size_t kEffectGroups = 12;  ///< those that can be asked for by name

/// Additional motion of a joint: about (or along) its own axis, about one of the two across it, the images of x and y
/// under z_onto(axis), or along the nominal link before it, which expands.
enum class EffectAxis : std::uint8_t { own, across_x, across_y, along };

/// One component of the gravity direction in a link's frame. The torque about a joint is linear in these components.
struct GravityMoment {
  int link = 0;  ///< index of the joint before the link, from 0
  /// 0 to 2: axis of the link's frame; kSlide: travel of that prismatic joint; kOwn: gravity along the moved prismatic
  /// joint.
  int axis = 0;
  static constexpr int kSlide = 3;
  static constexpr int kOwn = 4;
};

/// The torque of these masses about the joint, with g = 1.
struct LoadTorque {
  std::vector<PointMass> masses;
};

/// The joint's own value.
struct JointGain {};

/// The side of its backlash to which the load pulls the joint: tanh of the torque of equal masses at all later joint
/// frames and the tip.
struct LoadSide {
  double mass = 1.0;
};

/// The sign of the joint's last motion, DriveSignals::approach.
struct ApproachSide {};

/// sin(times · q) or cos(times · q): an encoder off centre (harmonics), or gear ripple.
struct Sinusoid {
  double times = 1.0;  ///< periods per turn
  bool is_cosine = false;
  bool is_ripple = false;
};

/// A smooth function of a joint's value as a sum of sines of growing frequency, see effect_terms.hpp.
struct JointTable {
  int number = 1;       ///< j, from 1
  double length = 0.0;  ///< [rad or m] correlation length
  double lower = 0.0;   ///< [rad or m] measured range; joint values are clamped to it
  double upper = 0.0;
  /// [rad or m] Ranges with too few measurements: the table is zero there.
  std::vector<std::pair<double, double>> withheld;
};

/// The torque that the drive measured, DriveSignals::torques.
struct MeasuredTorque {
  double play = 0.0;  ///< [Nm or N] if above 0 the function is tanh(torque / play)
};

/// The value of another joint, or its sine or cosine.
struct JointCoupling {
  int joint = 0;       ///< index of the other joint
  double times = 0.0;  ///< periods per turn of that joint; 0: its value
  bool is_cosine = false;
};

/// The temperature [degC] of the link before the joint, its own where one is known, else that of the arm; for a link,
/// times its nominal length [degC m].
struct Temperature {
  bool of_link = false;
};

/// One of several payloads.
struct PayloadCentre {
  double mass = 0.0;   ///< [kg]
  KDL::Vector centre;  ///< of mass, in the flange frame [m]
};

/// The torque of the payload about the joint's axis, with g = 1.
struct PayloadTorque {
  KDL::Vector centre;  ///< of every payload, in the flange frame [m]; where no others are stated
  /// Those of several payloads, by ascending mass. Between two of them the product of mass and centre is linear in the
  /// mass; below the lightest and above the heaviest one their centre holds.
  std::vector<PayloadCentre> centres = {};
};

/// Values of functions of the caller's own at N configurations: N x K for joint values joints x N in the URDF's
/// convention [rad or m], each row from its configuration alone. Called from several threads at once.
using OwnColumns = std::function<Eigen::MatrixXd(const Eigen::MatrixXd& joint_values)>;

/// Values of a function of the caller's own where it was fitted: they tell it from another one.
struct OwnValues {
  Eigen::MatrixXd joint_values;  ///< n x m, some of those that were measured
  Eigen::MatrixXd columns;       ///< m x K
};

/// One column of a function of the caller's own.
struct OwnFunction {
  std::string effect;  ///< OwnEffect::name
  OwnColumns columns;
  Eigen::Index column = 0;
  std::shared_ptr<const OwnValues> fitted = {};  ///< null where it was not
};

/// The function of an effect, one struct per kind.
using EffectFunction = std::variant<GravityMoment, LoadTorque, JointGain, LoadSide, ApproachSide, Sinusoid, JointTable,
                                    MeasuredTorque, JointCoupling, Temperature, PayloadTorque, OwnFunction>;

/// An effect of the caller's own: a motion of a joint by an unknown multiple of each of its columns.
struct OwnEffect {
  std::string name;   ///< letters, digits, '_' and '-'
  std::string joint;  ///< URDF joint that moves
  EffectAxis axis = EffectAxis::own;
  OwnColumns columns;
};

/// A motion of a joint that the rigid chain does not have: value · (raw(q) - mean) / scale, added to the joint's value
/// or tilting what it carries. `raw` is evaluated at commanded values and nominal geometry, so that it never depends on
/// the estimate. The motion is zero if its direction of approach is unknown.
struct EffectTerm {
  /// "gravity.2.3x": joint 2, load of link 3; "transverse.2.y.3x": the same about y; "gain.3", "harmonics.3.sin1",
  /// "ripple.3.sin200.5", "tables.3.12"; "backlash.2" from the load, "backlash.2.approach"; "torque.2",
  /// "torque.2.tanh"; "expansion.3": the link before joint 3; "drift.3", "payload.3"; "coupling.6.5",
  /// "coupling.6.5.sin1": joint 6 with joint 5; "own.NAME.2", "own.NAME.2.1" from its second column on.
  std::string name;
  std::string joint;  ///< URDF joint
  int index = 0;      ///< of the joint
  EffectAxis axis = EffectAxis::own;
  EffectFunction function;  ///< gives `raw`
  double mean = 0.0;
  double scale = 1.0;
  double sigma = 0.0;  ///< prior 1 sigma of the value [rad, m or per unit], 0: no prior

  EffectGroup group() const;
};

/// What surrounds an arm; NaN where it is not known.
struct Circumstances {
  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  double temperature = kUnknown;  ///< [degC] of the arm: of all links that `link_temperatures` does not name
  double payload = kUnknown;      ///< [kg] on the flange
  std::map<std::string, double> link_temperatures = {};  ///< [degC] by the URDF link
};

/// What the errors leave exactly as it is in the nominal robot, so that closed forms of the inverse kinematics hold.
enum class KeptAxes : std::uint8_t {
  none,
  /// Neighbouring axes that are parallel stay parallel. Three neighbours that meet in a point keep one, and so do two
  /// that meet behind three parallel ones, as in the arms of Universal Robots.
  closed_form,
  /// The angle between any two neighbours stays, and those that meet keep meeting: the arm keeps the angles and the
  /// zeros of its DH table.
  angles
};

/// The complete model: every joint its offset, every link the translations and rotations along the axes of the next
/// joint's frame, less those along the link's own joint axis where the two are parallel (they equal the joint offset
/// or a parameter of the link before). Order: joint offsets from base to tip, then links from base to tip, within a
/// link Tz Tx Ty Rz Rx Ry, which is also the order in which they act:
///   X_BF = F(1) E(0) Rot(q1) Rot(dq1) · F(2) E(1) Rot(q2) Rot(dq2) · … · F(tip) E(n).
struct ErrorModel {
  std::vector<MovingJoint> joints;
  KDL::Frame tip_origin;
  std::string tip_joint;  ///< the fixed joint that carries the errors of the last link; empty if none
  std::vector<ErrorParameter> parameters;
  std::vector<EffectTerm> effects;                    ///< none by default, see joint_effects.hpp
  std::vector<PointMass> link_masses;                 ///< those stated by the URDF
  KDL::Vector gravity = KDL::Vector(0.0, 0.0, -1.0);  ///< unit vector of its direction in the base frame
  KDL::Vector payload_centre;                         ///< in the flange frame [m]
  std::vector<PayloadCentre> payload_centres;         ///< of several payloads, see PayloadTorque
  /// Taken where signals state none: the means of the measurements, or those of Calibration::at.
  Circumstances circumstances;
  std::vector<std::string> stations = {"W"};  ///< of the measurements, each with its own pose of the base
  /// Whether rows may leave directions of a base undetermined: several stations, single coordinates, or points of one
  /// place that are all on one line. Then the parameters of bases are named base[STATION].Tx, and uncertainties in the
  /// base frame are those of the arm alone.
  bool has_undetermined_bases = false;
  KeptAxes kept_axes = KeptAxes::none;
  /// With kept axes, for each joint frame the point on the joint's axis about which its errors act, and zero for the
  /// tip; else empty: the origins.
  std::vector<KDL::Vector> pivots;
};

/// With kept axes, the model has no parameters that would tilt or part them. Throws InputError where the axes of the
/// robot are only nearly parallel or nearly meet, and where there are none to keep.
ErrorModel complete_model(const Robot& robot, KeptAxes kept = KeptAxes::none);

/// The chain with every error parameter as an extra fixed segment named after it; the joints are the robot's.
/// Throws InputError for another number of errors, and one that is not finite.
KDL::Chain error_chain(const ErrorModel& model, const Eigen::VectorXd& errors);

/// Prior 1 sigma of the geometric errors, each an additional residual; 0: no prior.
struct Priors {
  double length = 0.0;  ///< [m]
  double angle = 0.0;   ///< [rad]
};

/// The base in the frame of the measuring device at one of its places.
struct StationBase {
  std::string station;  ///< its name; may be empty if there is only one
  Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
};

/// A point on the tool, or a full frame where orientation is measured as well; in the flange frame.
struct TargetFrame {
  std::string name;
  Eigen::Isometry3d X_FT = Eigen::Isometry3d::Identity();
  bool with_orientation = false;
};

/// Poses of the base and of the targets.
struct Frames {
  std::vector<Eigen::Isometry3d> bases = {Eigen::Isometry3d::Identity()};  ///< X_WB at each station, at least one
  std::vector<TargetFrame> targets;

  const Eigen::Isometry3d& base(std::size_t station = 0) const { return bases.at(station); }
  Eigen::Isometry3d& base(std::size_t station = 0) { return bases.at(station); }
};

/// Frames that are known and not registered.
struct KnownFrames {
  std::vector<StationBase> bases = {};
  std::vector<TargetFrame> targets = {};
};

}  // namespace kdl_calibration
