#include "effects/joint_effects.hpp"
#include "effects/effect_terms.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <kdl/chaindynparam.hpp>
#include <kdl/chainfksolverpos_recursive.hpp>
#include <map>
#include <numeric>
#include <set>

#include "effects/arm_kinematics.hpp"
#include "estimation/identification.hpp"
#include "measurements/drive_signals.hpp"
#include "model/error_chains.hpp"
#include "model/kinematics.hpp"
#include "planning/simulation.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::joint_effects_test {
namespace {

using testing::fanuc;
using testing::names_of;

/// The function itself, before it is centred and scaled.
double value_of(const EffectTerm& term, double in_basis) { return in_basis * term.scale + term.mean; }

/// The torques that gravity exerts on the joints, by the KDL solver, which gives those that hold the arm against it.
Eigen::VectorXd kdl_torques(const Robot& robot, const KDL::Vector& gravity, const Eigen::VectorXd& q) {
  KDL::ChainDynParam solver(robot.chain, gravity);
  KDL::JntArray joints(static_cast<unsigned>(q.size()));
  KDL::JntArray torques(joints.rows());
  joints.data = q;
  EXPECT_EQ(solver.JntToGravity(joints, torques), 0);
  return -torques.data;
}

TEST(JointEffects, GravityBendsTheSecondAndThirdJointOfTheR2000iC) {
  // The first axis is vertical; the wrist's levers are small beside the arm's.
  EXPECT_THAT(names_of(load_terms(complete_model(fanuc()))),
              ::testing::ElementsAre("gravity2_3", "gravity2_4", "gravity3_4"));
}

TEST(JointEffects, NoBacklashWhereNothingLoadsTheJoint) {
  // The flange stands on the sixth axis: what torque there is comes from rounding.
  const ErrorModel model = complete_model(fanuc());
  Random random(1);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 50, random);
  std::vector<int> joints;
  for (const EffectTerm& term : effect_terms(model, EffectGroup::backlash, q)) {
    joints.push_back(term.index);
    EXPECT_LT(std::get<LoadSide>(term.function).mass, 1e4);
  }
  EXPECT_THAT(joints, ::testing::ElementsAre(1, 2, 3, 4)) << "the first axis is vertical";
}

TEST(JointEffects, BasisIsTheHorizontalLeverOverItsLargest) {
  ErrorModel model = complete_model(fanuc());
  model.effects = load_terms(model);
  Random random(1);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 50, random);
  const Eigen::MatrixXd basis = effect_basis(model, q);
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    // Upper arm of 1.075 m along z, turned by q2 about x: horizontal lever 1.075 sin q2.
    EXPECT_NEAR(std::abs(basis(0, c)) * model.effects[0].scale, 1.075 * std::abs(std::sin(q(1, c))), 1e-12);
  }
  EXPECT_LE(basis.cwiseAbs().maxCoeff(), 1.05);
}

// The R-2000iC with masses on links 2 and 3.
Robot loaded_fanuc(double upper_arm, double forearm) {
  std::string urdf = fanuc().urdf;
  const auto add_mass = [&](const std::string& link, const std::string& centre, double mass) {
    const std::string tag = "<link name=\"" + link + "\">";
    const auto at = urdf.find(tag);
    ASSERT_NE(at, std::string::npos) << link;
    urdf.insert(at + tag.size(), "<inertial><origin xyz='" + centre + "'/><mass value='" + std::to_string(mass) +
                                     "'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>");
  };
  add_mass("link_2", "0 0.1 0.5", upper_arm);
  add_mass("link_3", "0.05 0.6 0.1", forearm);
  return parse_robot(urdf);
}

TEST(JointEffects, LightLinksLoadNoJointBehindThem) {
  EXPECT_THAT(names_of(load_terms(complete_model(loaded_fanuc(0.02, 0.015)))),
              ::testing::ElementsAre("gravity2", "gravity3"));
}

// The odd arm with masses on every link, on those behind fixed joints as well.
Robot heavy_odd_arm() {
  std::string urdf = testing::kOddArm;
  urdf.insert(urdf.find("<joint"),  // and on one behind two of them
              "<link name=\"gripper\"/>"
              "<joint name=\"adapter\" type=\"fixed\"><parent link=\"tool\"/><child link=\"gripper\"/>"
              "<origin xyz=\"0.1 0.2 -0.3\" rpy=\"0.4 -0.5 0.6\"/></joint>");
  double mass = 3.0;
  for (const std::string link : {"world", "a", "b", "bracket", "c", "d", "e", "tool", "gripper"}) {
    const std::string tag = "<link name=\"" + link + "\"/>";
    const auto at = urdf.find(tag);
    const std::string inertial = "<inertial><origin xyz='0.1 " + std::to_string(0.02 * mass) + " -0.05' rpy='0 0 0'/>" +
                                 "<mass value='" + std::to_string(mass) +
                                 "'/><inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial>";
    urdf.replace(at, tag.size(), "<link name=\"" + link + "\">" + inertial + "</link>");
    mass += 2.0;
  }
  return parse_robot(urdf);
}

TEST(JointEffects, MassesBehindFixedJointsPullAsTheKdlSolverSays) {
  const Robot robot = heavy_odd_arm();
  ErrorModel model = complete_model(robot);
  ASSERT_EQ(model.link_masses.size(), 8U);  // all but the base link's
  for (const Eigen::Vector3d& down : {Eigen::Vector3d(0.0, 0.0, -1.0), Eigen::Vector3d(0.48, -0.6, -0.64)}) {
    model.gravity = KDL::Vector(down.x(), down.y(), down.z());
    model.effects = load_terms(model);
    std::vector<int> joints;
    for (const EffectTerm& effect : model.effects) {
      joints.push_back(effect.index);
    }
    EXPECT_THAT(joints, ::testing::IsSupersetOf({0, 2, 3}));
    Random random(4);
    for (int i = 0; i < 50; ++i) {
      const Eigen::VectorXd q = testing::random_joints(model, random);
      const Eigen::VectorXd torques = kdl_torques(robot, model.gravity, q);
      const Eigen::MatrixXd basis = effect_basis(model, q);
      for (std::size_t d = 0; d < model.effects.size(); ++d) {
        EXPECT_NEAR(basis(static_cast<Eigen::Index>(d), 0) * model.effects[d].scale, torques[joints[d]], 1e-9)
            << model.effects[d].name;
      }
      // What bends the joints: each by its value times its basis, and only its own.
      Eigen::VectorXd values_of = Eigen::VectorXd::LinSpaced(static_cast<Eigen::Index>(joints.size()), 0.001, 0.004);
      Eigen::VectorXd expected = q;
      for (std::size_t d = 0; d < joints.size(); ++d) {
        expected[joints[d]] += values_of[static_cast<Eigen::Index>(d)] * basis(static_cast<Eigen::Index>(d), 0);
      }
      EXPECT_LT((effective_joint_values(model, values_of, q) - expected).norm(), 1e-15);
    }
  }
}

// Every linear function of gravity in a link that a joint feels, as it is.
std::vector<EffectTerm> whole_gravity_basis(const ErrorModel& model) {
  std::vector<EffectTerm> terms;
  for (int joint = 0; joint < static_cast<int>(model.joints.size()); ++joint) {
    for (int link = joint; link < static_cast<int>(model.joints.size()); ++link) {
      for (int axis = 0; axis <= GravityMoment::kOwn; ++axis) {
        const auto type = model.joints[static_cast<std::size_t>(axis == GravityMoment::kSlide ? link : joint)].type;
        const bool fits = axis < GravityMoment::kSlide || type == JointType::prismatic;
        if (fits) {
          terms.push_back({.name = std::to_string(terms.size()),
                           .index = joint,
                           .function = GravityMoment{.link = link, .axis = axis}});
        }
      }
    }
  }
  return terms;
}

TEST(JointEffects, TheTorqueOfAnyMassesIsALinearFunctionOfTheGravityTerms) {
  const Robot robot = heavy_odd_arm();
  ErrorModel model = complete_model(robot);
  model.gravity = KDL::Vector(0.48, -0.6, -0.64);
  model.effects = whole_gravity_basis(model);
  Random random(6);
  constexpr Eigen::Index kCount = 200;
  Eigen::MatrixXd q(5, kCount);
  Eigen::MatrixXd torques(5, kCount);
  for (Eigen::Index c = 0; c < kCount; ++c) {
    q.col(c) = testing::random_joints(model, random);
    torques.col(c) = kdl_torques(robot, model.gravity, q.col(c));
  }
  const Eigen::MatrixXd basis = effect_basis(model, q);
  for (int joint = 0; joint < 5; ++joint) {
    const std::vector<Eigen::Index> own = terms_by_motion(model).at({EffectGroup::gravity, joint});
    const Eigen::MatrixXd columns = basis(own, Eigen::all).transpose();
    const Eigen::VectorXd torque = torques.row(joint).transpose();
    const Eigen::VectorXd rest = torque - columns * columns.completeOrthogonalDecomposition().solve(torque);
    EXPECT_LT(rest.norm(), 1e-10 * torques.norm()) << "joint " << joint + 1;
    EXPECT_GT(torque.norm(), 0.01 * torques.norm()) << "nothing to explain";
  }
}

/// The share of the torques' variance (joints x N) that these terms do not explain, each joint's by its own.
double unexplained(ErrorModel model, std::vector<EffectTerm> terms, const Eigen::MatrixXd& q,
                   const Eigen::MatrixXd& torques) {
  model.effects = std::move(terms);
  const Eigen::MatrixXd basis = effect_basis(model, q);
  const auto motions = terms_by_motion(model);
  double left = 0.0;
  double all = 0.0;
  for (int joint = 0; joint < static_cast<int>(q.rows()); ++joint) {
    const auto own = motions.find({EffectGroup::gravity, joint});
    const Eigen::Index count = own == motions.end() ? 0 : std::ssize(own->second);
    Eigen::MatrixXd columns = Eigen::MatrixXd::Ones(q.cols(), count + 1);  // the joint's zero takes up the mean
    if (count > 0) {
      columns.leftCols(count) = basis(own->second, Eigen::all).transpose();
    }
    const Eigen::VectorXd torque = torques.row(joint).transpose();
    left += (torque - columns * columns.completeOrthogonalDecomposition().solve(torque)).squaredNorm();
    all += (torque.array() - torque.mean()).matrix().squaredNorm();
  }
  return left / all;
}

// Of an arm with a sliding joint and stated masses, and of one of which no mass is known: there less than a third of
// the terms carries what equal masses at its joints weigh. A term below 15 % of the largest carries 2 % of its
// variance.
TEST(JointEffects, MainGravityTermsCarryNearlyAllOfTheTorque) {
  Random random(7);
  constexpr Eigen::Index kCount = 200;
  const Robot heavy = heavy_odd_arm();
  for (const Robot& robot : {heavy, fanuc()}) {
    const ErrorModel model = complete_model(robot);
    const bool is_heavy = !model.link_masses.empty();
    Eigen::MatrixXd q(std::ssize(model.joints), kCount);
    Eigen::MatrixXd torques = q;
    for (Eigen::Index c = 0; c < kCount; ++c) {
      q.col(c) = testing::random_joints(model, random);
      torques.col(c) =
          is_heavy ? kdl_torques(robot, model.gravity, q.col(c)) : Eigen::VectorXd(gravity_torques(model, q.col(c)));
    }
    const std::vector<EffectTerm> all = effect_terms(model, EffectGroup::gravity, q);
    const std::vector<EffectTerm> main = main_gravity_terms(model, all);
    EXPECT_LE(main.size(), (is_heavy ? 0.8 : 0.3) * static_cast<double>(all.size()));
    EXPECT_LT(unexplained(model, all, q, torques), 1e-9);
    EXPECT_LT(unexplained(model, main, q, torques), is_heavy ? 0.1 : 0.03);
  }
}

TEST(JointEffects, TermsHaveZeroMeanAndUnitScaleOverTheJointValuesTheyAreMadeFor) {
  ErrorModel model = complete_model(fanuc());
  Random random(7);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  for (const EffectGroup group : {EffectGroup::gravity, EffectGroup::transverse, EffectGroup::gain,
                                  EffectGroup::backlash, EffectGroup::harmonics}) {
    model.effects = effect_terms(model, group, q);
    ASSERT_FALSE(model.effects.empty()) << to_string(group);
    const Eigen::MatrixXd basis = effect_basis(model, q);
    for (std::size_t e = 0; e < model.effects.size(); ++e) {
      const auto row = basis.row(static_cast<Eigen::Index>(e)).array();
      EXPECT_EQ(model.effects[e].group(), group);
      EXPECT_NEAR(row.mean(), 0.0, 1e-12) << model.effects[e].name;
      EXPECT_NEAR(std::sqrt(row.square().mean()), 1.0, 1e-12) << model.effects[e].name;
    }
  }
}

// Of the odd arm, whose second joint slides.
TEST(JointEffects, FunctionsOfTheJointsValueAreAsTheyAreNamed) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  Random random(7);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  for (const EffectGroup group : {EffectGroup::gain, EffectGroup::harmonics, EffectGroup::ripple}) {
    for (const EffectTerm& term : effect_terms(model, group, q)) {
      model.effects.push_back(term);
    }
  }
  for (const EffectTerm& term : ripple_terms(model, q, 2, 7.5)) {
    model.effects.push_back(term);
  }
  const Eigen::MatrixXd basis = effect_basis(model, q);
  const std::map<std::string, std::function<double(double)>> functions = {
      {"gain.2", [](double slide) { return slide; }},
      {"gain.3", [](double angle) { return angle; }},
      {"harmonics.3.sin1", [](double angle) { return std::sin(angle); }},
      {"harmonics.3.cos2",
       [](double angle) { return std::cos(angle) * std::cos(angle) - std::pow(std::sin(angle), 2); }},
      {"ripple.3.sin7.5", [](double angle) { return std::imag(std::polar(1.0, 7.5 * angle)); }},
      {"ripple.3.cos7.5", [](double angle) { return std::real(std::polar(1.0, 7.5 * angle)); }},
      {"ripple.4.cos100", [](double angle) { return std::real(std::polar(1.0, 100.0 * angle)); }}};
  for (const auto& [name, function] : functions) {
    const auto term = std::find_if(model.effects.begin(), model.effects.end(),
                                   [&, of = name](const EffectTerm& other) { return other.name == of; });
    ASSERT_NE(term, model.effects.end()) << name;
    for (Eigen::Index c = 0; c < q.cols(); ++c) {
      EXPECT_NEAR(value_of(*term, basis(term - model.effects.begin(), c)), function(q(term->index, c)), 1e-12) << name;
    }
  }
}

// Of the odd arm, whose second joint slides: its value couples, and no sine of it.
TEST(JointEffects, CouplingIsAFunctionOfTheJointsBefore) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  Random random(7);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  model.effects = effect_terms(model, EffectGroup::coupling, q);
  const Eigen::MatrixXd basis = effect_basis(model, q);
  const std::map<std::string, std::function<double(const Eigen::VectorXd&)>> functions = {
      {"coupling.2.1", [](const Eigen::VectorXd& at) { return at[0]; }},
      {"coupling.2.1.sin1", [](const Eigen::VectorXd& at) { return std::imag(std::polar(1.0, at[0])); }},
      {"coupling.2.1.cos1", [](const Eigen::VectorXd& at) { return std::real(std::polar(1.0, at[0])); }},
      {"coupling.3.2", [](const Eigen::VectorXd& at) { return at[1]; }},
      {"coupling.3.1", [](const Eigen::VectorXd& at) { return at[0]; }},
      {"coupling.4.3", [](const Eigen::VectorXd& at) { return at[2]; }},
      {"coupling.4.2", [](const Eigen::VectorXd& at) { return at[1]; }}};
  const std::vector<std::string> names = names_of(model.effects);
  for (const auto& [name, function] : functions) {
    const auto place = std::find(names.begin(), names.end(), name) - names.begin();
    ASSERT_LT(place, std::ssize(names)) << name;
    const EffectTerm& term = model.effects[static_cast<std::size_t>(place)];
    EXPECT_EQ(term.index, name[9] - '1') << name;
    for (Eigen::Index c = 0; c < q.cols(); ++c) {
      EXPECT_NEAR(value_of(term, basis(place, c)), function(q.col(c)), 1e-12) << name;
    }
  }
  EXPECT_THAT(names, ::testing::Not(::testing::Contains("coupling.3.2.sin1")));
  for (const std::string& name : names) {
    EXPECT_NE(name[9], '1') << name << ": nothing stands before the first joint";
  }
}

OwnEffect own_effect(const std::string& name, const OwnColumns& columns, EffectAxis axis = EffectAxis::own) {
  return {.name = name, .joint = "joint_3", .axis = axis, .columns = columns};
}

// A constant and a repeated column are left out; the others keep their number.
TEST(JointEffects, ColumnsOfACallersFunctionAreTerms) {
  ErrorModel model = complete_model(fanuc());
  Random random(7);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  const OwnColumns columns = [](const Eigen::MatrixXd& at) {
    Eigen::MatrixXd values(at.cols(), 4);
    values.col(0) = 1e-6 * at.row(1).transpose();
    values.col(1).setConstant(2.0);
    values.col(2) = 3.0 * values.col(0);
    values.col(3) = (at.row(1).array() * at.row(4).array()).transpose();
    return values;
  };
  model.effects = own_terms(model, own_effect("bend", columns, EffectAxis::across_y), q);
  ASSERT_THAT(names_of(model.effects), ::testing::ElementsAre("own.bend.3", "own.bend.3.3"));
  for (const EffectTerm& term : model.effects) {
    EXPECT_EQ(term.group(), EffectGroup::own);
    EXPECT_EQ(size_name(term), "own.bend");
    EXPECT_EQ(term.axis, EffectAxis::across_y);
  }
  const Eigen::MatrixXd basis = effect_basis(model, q);
  const Eigen::VectorXd values{{0.5, -2.0}};
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    EXPECT_NEAR(value_of(model.effects[0], basis(0, c)), 1e-6 * q(1, c), 1e-18);
    EXPECT_NEAR(value_of(model.effects[1], basis(1, c)), q(1, c) * q(4, c), 1e-12);
    Eigen::VectorXd motion(motion_size(model));  // of one configuration alone
    effect_motion(model, values, q.col(c), motion);
    motion += own_motions(model, values, q.col(c));
    EXPECT_NEAR(motion[motion_entry(model, model.effects[0])], 0.5 * basis(0, c) - 2.0 * basis(1, c), 1e-12);
  }
}

TEST(JointEffects, WrongValuesOfACallersFunctionAreRefused) {
  const ErrorModel model = complete_model(fanuc());
  const Eigen::MatrixXd q = Eigen::MatrixXd::Constant(6, 5, 0.25);
  const auto refused = [&](const OwnColumns& columns) {
    return testing::refusal([&] { own_terms(model, own_effect("bend", columns), q); });
  };
  EXPECT_THAT(refused([](const Eigen::MatrixXd&) { return Eigen::MatrixXd::Ones(4, 1); }),
              ::testing::HasSubstr("bend gives 4 rows of 1 columns, expected a row for each of the 5 configurations"));
  EXPECT_THAT(refused([](const Eigen::MatrixXd& at) { return Eigen::MatrixXd(at.cols(), 0); }),
              ::testing::HasSubstr("at least one column"));
  EXPECT_THAT(refused([](const Eigen::MatrixXd& at) {
                return Eigen::MatrixXd((at.row(0).transpose().array() / 0.0).matrix());
              }),
              ::testing::HasSubstr("not finite at joint values 0.25, 0.25"));
  const Eigen::MatrixXd several = Eigen::MatrixXd::Random(6, 5);
  EXPECT_THAT(testing::refusal([&] {
                const OwnColumns centred = [](const Eigen::MatrixXd& at) {
                  return Eigen::MatrixXd((at.row(1).array() - at.row(1).mean()).matrix().transpose());
                };
                own_terms(model, own_effect("bend", centred), several);
              }),
              ::testing::HasSubstr("bend gives other values at one configuration than among all"));
  OwnEffect elsewhere = own_effect("bend", [](const Eigen::MatrixXd& at) { return Eigen::MatrixXd(at.transpose()); });
  elsewhere.joint = "joint_9";
  EXPECT_THAT(testing::refusal([&] { own_terms(model, elsewhere, q); }),
              ::testing::HasSubstr("bend moves joint_9, expected a moving joint"));
}

TEST(JointEffects, GravityTermsThatRepeatEachOtherOrHardlyChangeAreLeftOut) {
  ErrorModel model = complete_model(fanuc());
  Random random(8);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 200, random);
  model.effects = effect_terms(model, EffectGroup::gravity, q);
  const Eigen::MatrixXd basis = effect_basis(model, q);
  // The first axis is vertical: nothing turns it. Joint 2 sees its own link, the next and those of the wrist.
  for (const EffectTerm& term : model.effects) {
    EXPECT_GT(term.index, 0) << term.name;
  }
  EXPECT_EQ(model.effects.size(), 30U);
  for (int joint = 1; joint < 6; ++joint) {
    const std::vector<Eigen::Index> own = terms_by_motion(model).at({EffectGroup::gravity, joint});
    const Eigen::MatrixXd columns = basis(own, Eigen::all).transpose();
    EXPECT_EQ(Eigen::ColPivHouseholderQR<Eigen::MatrixXd>(columns).rank(), columns.cols()) << joint + 1;
  }
  EXPECT_TRUE(effect_terms(model, EffectGroup::gravity, q.leftCols(1)).empty()) << "of one configuration";
}

// By products of KDL frames: about the joint's own axis or one across it, seen in the frame of the joint's origin.
double moment_by_hand(const ErrorModel& model, const EffectTerm& term, const Eigen::VectorXd& q) {
  const auto& [link, axis_of_link] = std::get<GravityMoment>(term.function);
  const Eigen::Vector3d own = to_eigen(model.joints[static_cast<std::size_t>(term.index)].axis);
  const bool is_own = term.axis == EffectAxis::own;
  const Eigen::Vector3d axis = is_own ? own : z_onto(own).col(term.axis == EffectAxis::across_x ? 0 : 1);
  EXPECT_NEAR(axis.dot(own), is_own ? 1.0 : 0.0, 1e-15);
  EXPECT_NEAR(axis.norm(), 1.0, 1e-15);
  KDL::Frame pose = KDL::Frame::Identity();
  KDL::Vector about;
  KDL::Vector along;  // the way of the link's joint
  for (int i = 0; i <= link; ++i) {
    const MovingJoint& joint = model.joints[static_cast<std::size_t>(i)];
    pose = pose * joint.origin;
    if (i == term.index) {
      about = pose.M * KDL::Vector(axis.x(), axis.y(), axis.z());
    }
    along = pose.M * joint.axis * q[i];
    pose = pose * (joint.type == JointType::prismatic ? KDL::Frame(joint.axis * q[i])
                                                      : KDL::Frame(KDL::Rotation::Rot2(joint.axis, q[i])));
  }
  if (axis_of_link == GravityMoment::kOwn) {
    return KDL::dot(about, model.gravity);
  }
  const KDL::Vector levers[] = {pose.M.UnitX(), pose.M.UnitY(), pose.M.UnitZ(), along};
  return KDL::dot(about, levers[axis_of_link] * model.gravity);
}

// Of a robot with its joints' axes across each other.
TEST(JointEffects, JointsAndBearingsFeelTheMomentsOfGravity) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  model.gravity = KDL::Vector(0.48, -0.6, -0.64);
  Random random(12);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  std::set<std::pair<EffectGroup, int>> seen;  // with the axes of the links
  for (const EffectGroup group : {EffectGroup::gravity, EffectGroup::transverse}) {
    for (const EffectTerm& term : effect_terms(model, group, q)) {
      const auto& [link, axis] = std::get<GravityMoment>(term.function);
      EXPECT_EQ(term.axis == EffectAxis::own, group == EffectGroup::gravity) << term.name;
      EXPECT_GE(link, term.index) << term.name;
      EXPECT_LE(link, group == EffectGroup::gravity ? 4 : term.index + 2) << term.name;
      seen.emplace(term.group(), axis);
      model.effects.push_back(term);
    }
  }
  EXPECT_EQ(seen.size(), 8U) << "those of a slide are not across";
  const Eigen::MatrixXd basis = effect_basis(model, q);
  for (std::size_t e = 0; e < model.effects.size(); ++e) {
    const EffectTerm& term = model.effects[e];
    for (Eigen::Index c = 0; c < q.cols(); ++c) {
      EXPECT_NEAR(value_of(term, basis(static_cast<Eigen::Index>(e), c)), moment_by_hand(model, term, q.col(c)), 1e-12)
          << term.name;
    }
  }
}

TEST(JointEffects, TiltsTurnTheChainInFrontOfItsJoints) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  Random random(13);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  model.effects = effect_terms(model, EffectGroup::transverse, q);
  const Eigen::VectorXd errors = testing::random_errors(model, random, 0.001, 0.001);
  const Eigen::VectorXd values = Eigen::VectorXd::NullaryExpr(static_cast<Eigen::Index>(model.effects.size()),
                                                              [&](Eigen::Index) { return 1e-3 * random.normal(); });
  const Eigen::MatrixXd moved = effective_joint_values(model, values, q);
  const Eigen::MatrixXd basis = effect_basis(model, q);
  ASSERT_EQ(moved.rows(), 15);
  EXPECT_TRUE(moved.topRows(5) == q);
  const FoldedChain chain = folded(model, errors);
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    KDL::Frame expected = KDL::Frame::Identity();
    for (int i = 0; i < 5; ++i) {
      const MovingJoint& joint = model.joints[static_cast<std::size_t>(i)];
      double tilts[2] = {0.0, 0.0};
      for (std::size_t e = 0; e < model.effects.size(); ++e) {
        if (model.effects[e].index == i) {
          const auto term = static_cast<Eigen::Index>(e);
          tilts[model.effects[e].axis == EffectAxis::across_x ? 0 : 1] += values[term] * basis(term, c);
        }
      }
      const Eigen::Matrix3d across = z_onto(to_eigen(joint.axis));
      const auto turn = [&](int k) {
        return KDL::Frame(KDL::Rotation::Rot2(KDL::Vector(across(0, k), across(1, k), across(2, k)),
                                              tilts[static_cast<std::size_t>(k)]));
      };
      expected = expected * joint.origin * frame_correction(model, errors, i) * turn(0) * turn(1) *
                 (joint.type == JointType::prismatic ? KDL::Frame(joint.axis * q(i, c))
                                                     : KDL::Frame(KDL::Rotation::Rot2(joint.axis, q(i, c))));
    }
    expected = expected * model.tip_origin * frame_correction(model, errors, 5);
    EXPECT_LT(testing::difference(to_kdl(flange_pose(chain, moved.col(c))), expected), 1e-12);
    // The same by the KDL solver on the robot's chain.
    const KDL::Chain tilted = tilted_chain(folded_chain(model, errors), moved.col(c).tail(10));
    EXPECT_LT(testing::difference(testing::kdl_pose(tilted, q.col(c)), expected), 1e-12);
  }
}

// The joint frame at the link's far end moves along the link: by hand, and on the KDL solver's chain.
TEST(JointEffects, LinksGrowAlongThemselvesWithTheTemperature) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  Random random(13);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  DriveSignals signals;
  signals.circumstances = Eigen::MatrixXd::Constant(2, 60, 10.0);
  for (double& temperature : signals.circumstances.row(0)) {
    temperature = random.uniform(15.0, 35.0);
  }
  model.effects = effect_terms(model, EffectGroup::expansion, q, signals);
  const auto count = static_cast<Eigen::Index>(model.effects.size());
  ASSERT_EQ(count, 5);
  const Eigen::VectorXd errors = testing::random_errors(model, random, 0.001, 0.001);
  const double spread = model.effects[0].scale;                        // [degC], the same for links of any length
  const Eigen::VectorXd growth{{11.5e-6, 24e-6, 12e-6, -5e-6, 1e-3}};  // [1/K] of each link
  const Eigen::MatrixXd moved = effective_joint_values(model, growth * spread, q, signals);
  ASSERT_EQ(moved.rows(), 20);
  const double mean = signals.circumstances.row(0).mean();
  const FoldedChain chain = folded(model, errors);
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    KDL::Frame expected = KDL::Frame::Identity();
    for (int i = 0; i < 5; ++i) {
      const MovingJoint& joint = model.joints[static_cast<std::size_t>(i)];
      const KDL::Frame motion = joint.type == JointType::prismatic
                                    ? KDL::Frame(joint.axis * q(i, c))
                                    : KDL::Frame(KDL::Rotation::Rot2(joint.axis, q(i, c)));
      const KDL::Frame grown(joint.origin.p * growth[i] * (signals.circumstances(0, c) - mean));
      expected = expected * grown * joint.origin * frame_correction(model, errors, i) * motion;
    }
    expected = expected * model.tip_origin * frame_correction(model, errors, 5);
    EXPECT_LT(testing::difference(to_kdl(flange_pose(chain, moved.col(c))), expected), 1e-12);
    const KDL::Chain stretched = stretched_chain(model, folded_chain(model, errors), moved.col(c).tail(5));
    EXPECT_LT(testing::difference(testing::kdl_pose(stretched, q.col(c)), expected), 1e-12);
  }
  // Of an arm at a stated temperature, without signals.
  model.circumstances.temperature = mean + 8.0;
  Eigen::VectorXd motion(20);
  effect_motion(model, growth * spread, q.col(0), motion);
  EXPECT_NEAR(motion[16], growth[1] * 8.0 * model.joints[1].origin.p.Norm(), 1e-15);
  model.circumstances.temperature = Circumstances::kUnknown;
  effect_motion(model, growth * spread, q.col(0), motion);
  EXPECT_TRUE(motion.isZero(0.0)) << "unknown is as the mean";
}

// By hand: the link before each joint has its own temperature or that of the arm, and so has the zero of the joint.
TEST(JointEffects, LinksGrowAndJointsDriftWithTheirOwnTemperatures) {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  Random random(15);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  Eigen::MatrixXd warmth(5, 60);  // of the link before each joint
  for (double& temperature : warmth.reshaped()) {
    temperature = random.uniform(15.0, 35.0);
  }
  warmth.row(3) = warmth.row(1);  // without an own column
  DriveSignals signals;
  signals.circumstances = Eigen::MatrixXd::Constant(2, 60, Circumstances::kUnknown);
  signals.circumstances.row(0) = warmth.row(1);
  signals.links = {"e", "b", "d", "world"};  // `b` and the joint's parent are fixed to each other
  signals.link_temperatures = Eigen::MatrixXd::Constant(4, 60, 100.0);
  signals.link_temperatures.row(1) = warmth.row(2);
  signals.link_temperatures.row(2) = warmth.row(4);
  signals.link_temperatures.row(3) = warmth.row(0);
  const Eigen::VectorXd means = warmth.rowwise().mean();
  const Eigen::VectorXd growth{{11.5e-6, 24e-6, 12e-6, -5e-6, 1e-3}};  // [1/K] of each link, or [rad/K] and [m/K]
  for (const EffectGroup group : {EffectGroup::expansion, EffectGroup::drift}) {
    model.effects = effect_terms(model, group, q, signals);
    ASSERT_EQ(model.effects.size(), 5U);
    Eigen::VectorXd values(5);
    for (Eigen::Index i = 0; i < 5; ++i) {
      values[i] = growth[i] * model.effects[static_cast<std::size_t>(i)].scale;
    }
    const auto size_of = [&](Eigen::Index i) {  // of what grows
      return group == EffectGroup::drift ? 1.0 : model.joints[static_cast<std::size_t>(i)].origin.p.Norm();
    };
    const Eigen::MatrixXd moved = effective_joint_values(model, values, q, signals);
    for (Eigen::Index c = 0; c < 60; ++c) {
      for (Eigen::Index i = 0; i < 5; ++i) {
        const double expected = growth[i] * size_of(i) * (warmth(i, c) - means[i]);
        const double found = group == EffectGroup::drift ? moved(i, c) - q(i, c) : moved(15 + i, c);
        EXPECT_NEAR(found, expected, 1e-14) << to_string(group) << " " << i;
      }
    }
    // Of an arm at stated temperatures, without signals.
    const Eigen::Index offset = group == EffectGroup::drift ? 0 : 15;
    model.circumstances = {.temperature = means[1] + 8.0, .link_temperatures = {{"bracket", means[2] - 3.0}}};
    Eigen::VectorXd motion(offset + 5);
    effect_motion(model, values, q.col(0), motion);
    EXPECT_NEAR(motion[offset + 1], growth[1] * size_of(1) * 8.0, 1e-14);
    EXPECT_NEAR(motion[offset + 2], growth[2] * size_of(2) * -3.0, 1e-14);
    model.circumstances = {};
  }
  signals.circumstances.resize(0, 0);
  model.effects = effect_terms(model, EffectGroup::expansion, q, signals);
  ASSERT_EQ(model.effects.size(), 3U) << "two links have no temperature";
  EXPECT_EQ(model.effects[1].name, "expansion.3");
}

// By KDL's solver, which gives the torques that hold a mass on the flange.
TEST(JointEffects, PayloadsTurnTheJointsByTheirTorque) {
  const Robot robot = fanuc();
  ErrorModel model = complete_model(robot);
  model.payload_centre = KDL::Vector(0.1, -0.05, 0.2);
  Random random(14);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  DriveSignals signals;
  signals.circumstances = Eigen::MatrixXd::Constant(2, 60, Circumstances::kUnknown);
  for (Eigen::Index c = 0; c < 60; ++c) {
    signals.circumstances(1, c) = 50.0 * static_cast<double>(c % 3);
  }
  EXPECT_TRUE(effect_terms(model, EffectGroup::drift, q, signals).empty()) << "no temperature is stated";
  model.effects = effect_terms(model, EffectGroup::payload, q, signals);
  ASSERT_GE(model.effects.size(), 4U);
  KDL::Chain loaded;
  for (const KDL::Segment& segment : robot.chain.segments) {
    loaded.addSegment(KDL::Segment(segment.getName(), segment.getJoint(), segment.getFrameToTip()));
  }
  Robot carrier = robot;
  const Eigen::MatrixXd basis = effect_basis(model, q, signals);
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    carrier.chain = loaded;
    carrier.chain.addSegment(KDL::Segment("payload", KDL::Joint(KDL::Joint::Fixed), KDL::Frame::Identity(),
                                          KDL::RigidBodyInertia(signals.circumstances(1, c), model.payload_centre)));
    const Eigen::VectorXd torques = kdl_torques(carrier, model.gravity, q.col(c));
    for (std::size_t e = 0; e < model.effects.size(); ++e) {
      const EffectTerm& term = model.effects[e];
      EXPECT_NEAR(value_of(term, basis(static_cast<Eigen::Index>(e), c)), torques[term.index], 1e-9) << term.name;
    }
  }
}

// By KDL's solver: a mass between those of two payloads is a part of each, a lighter or heavier one stands where the
// nearest of them does.
TEST(JointEffects, SeveralPayloadsHaveCentresOfTheirOwn) {
  const Robot robot = fanuc();
  ErrorModel model = complete_model(robot);
  const KDL::Vector light(0.1, -0.05, 0.2);
  const KDL::Vector heavy(-0.2, 0.3, 0.05);
  model.payload_centre = KDL::Vector(9.0, 9.0, 9.0);  // not used
  model.payload_centres = {{.mass = 40.0, .centre = light}, {.mass = 100.0, .centre = heavy}};
  const std::vector<std::vector<std::pair<double, KDL::Vector>>> carried = {
      {}, {{20.0, light}}, {{40.0, light}}, {{30.0, light}, {25.0, heavy}}, {{100.0, heavy}}, {{130.0, heavy}}};
  Random random(14);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  DriveSignals signals;
  signals.circumstances = Eigen::MatrixXd::Constant(2, 60, Circumstances::kUnknown);
  for (Eigen::Index c = 0; c < 60; ++c) {
    double mass = 0.0;
    for (const auto& [part, centre] : carried[static_cast<std::size_t>(c) % carried.size()]) {
      mass += part;
    }
    signals.circumstances(1, c) = mass;
  }
  model.effects = effect_terms(model, EffectGroup::payload, q, signals);
  ASSERT_GE(model.effects.size(), 5U);
  const Eigen::MatrixXd basis = effect_basis(model, q, signals);
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    Eigen::VectorXd torques = Eigen::VectorXd::Zero(6);
    for (const auto& [part, centre] : carried[static_cast<std::size_t>(c) % carried.size()]) {
      Robot carrier = robot;
      carrier.chain = KDL::Chain();
      for (const KDL::Segment& segment : robot.chain.segments) {
        carrier.chain.addSegment(KDL::Segment(segment.getName(), segment.getJoint(), segment.getFrameToTip()));
      }
      carrier.chain.addSegment(KDL::Segment("payload", KDL::Joint(KDL::Joint::Fixed), KDL::Frame::Identity(),
                                            KDL::RigidBodyInertia(part, centre)));
      torques += kdl_torques(carrier, model.gravity, q.col(c));
    }
    for (std::size_t e = 0; e < model.effects.size(); ++e) {
      const EffectTerm& term = model.effects[e];
      EXPECT_NEAR(value_of(term, basis(static_cast<Eigen::Index>(e), c)), torques[term.index], 1e-9) << term.name;
    }
  }
}

// Its torque about the axis that it lies on is rounding.
TEST(JointEffects, APayloadOnAnAxisDoesNotTurnThatJoint) {
  ErrorModel model = complete_model(fanuc());
  Random random(14);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  DriveSignals signals;
  signals.circumstances = Eigen::MatrixXd::Constant(2, 60, Circumstances::kUnknown);
  signals.circumstances.row(1) = 100.0 * Eigen::RowVectorXd::LinSpaced(60, 0.0, 1.0);
  const auto names = [&] { return names_of(effect_terms(model, EffectGroup::payload, q, signals)); };
  EXPECT_THAT(names(), ::testing::Not(::testing::Contains("payload.6")));
  EXPECT_THAT(names(), ::testing::IsSupersetOf({"payload.2", "payload.3", "payload.5"}));
  model.payload_centre = KDL::Vector(1e-3, 0.0, 0.0);
  EXPECT_THAT(names(), ::testing::Contains("payload.6"));
}

TEST(JointEffects, AColumnThatChangesByRoundingAloneIsNoTerm) {
  const ErrorModel model = complete_model(fanuc());
  Random random(15);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  const OwnColumns one = [](const Eigen::MatrixXd& at) {
    const Eigen::ArrayXd x = at.row(1).transpose();
    return Eigen::MatrixXd((x.sin().square() + x.cos().square()).matrix());
  };
  EXPECT_TRUE(own_terms(model, own_effect("one", one), q).empty());
  const OwnColumns small = [](const Eigen::MatrixXd& at) { return Eigen::MatrixXd(1e-12 * at.row(1).transpose()); };
  EXPECT_EQ(own_terms(model, own_effect("small", small), q).size(), 1U);
}

// Joint values with what the drives told there; some directions are not known.
DrivenConfigurations driven_stops(const ErrorModel& model, Random& random) {
  DrivenConfigurations driven;
  driven.joint_values = random_configurations(limits_of(model.joints), 60, random);
  driven.signals.approach = directions_of_motion(driven.joint_values);
  driven.signals.torques.resizeLike(driven.joint_values);
  for (double& torque : driven.signals.torques.reshaped()) {
    torque = 200.0 + 500.0 * random.normal();
  }
  return driven;
}

TEST(JointEffects, OfTheDirectionOfApproachIsItsSignWhereItIsKnown) {
  ErrorModel model = complete_model(fanuc());
  Random random(11);
  const auto [q, signals, from] = driven_stops(model, random);
  model.effects = effect_terms(model, EffectGroup::backlash, q, signals);
  std::erase_if(model.effects,
                [](const EffectTerm& term) { return !std::holds_alternative<ApproachSide>(term.function); });
  ASSERT_EQ(model.effects.size(), 6U) << "also of the first and last joint, which no weight loads";
  EXPECT_EQ(model.effects[0].name, "backlash.1.approach");
  const Eigen::MatrixXd basis = effect_basis(model, q, signals);
  for (Eigen::Index j = 0; j < 6; ++j) {
    double sum = 0.0;
    for (Eigen::Index c = 1; c < q.cols(); ++c) {
      sum += q(j, c) > q(j, c - 1) ? 1.0 : -1.0;
    }
    const double mean = sum / 59.0;
    for (Eigen::Index c = 1; c < q.cols(); ++c) {
      const double sign = q(j, c) > q(j, c - 1) ? 1.0 : -1.0;
      EXPECT_NEAR(basis(j, c), (sign - mean) / std::sqrt(1.0 - mean * mean), 1e-12);
    }
    EXPECT_EQ(basis(j, 0), 0.0) << "nobody knows how it came to the first";
  }
  EXPECT_TRUE(effect_basis(model, q).isZero(0.0)) << "without an order";
  EXPECT_EQ(effective_joint_values(model, Eigen::VectorXd::Ones(6), q), q);
  EXPECT_TRUE(misses_approach(model.effects[0], signals, 0));
  EXPECT_FALSE(misses_approach(model.effects[0], signals, 1));
}

TEST(JointEffects, OfMeasuredTorquesAreTheTorqueAndItsSide) {
  ErrorModel model = complete_model(fanuc());
  Random random(12);
  const auto [q, signals, from] = driven_stops(model, random);
  model.effects = effect_terms(model, EffectGroup::torque, q, signals);
  ASSERT_EQ(model.effects.size(), 12U);
  EXPECT_EQ(model.effects[2].name, "torque.2");
  EXPECT_EQ(model.effects[3].name, "torque.2.tanh");
  const Eigen::MatrixXd basis = effect_basis(model, q, signals);
  const Eigen::ArrayXd torque = signals.torques.row(1).transpose();
  const Eigen::ArrayXd side = (torque / (0.15 * torque.abs().mean())).tanh();
  for (const auto& [row, raw] : {std::pair{2, torque}, std::pair{3, side}}) {
    const Eigen::ArrayXd centred = raw - raw.mean();
    EXPECT_LT((basis.row(row).transpose().array() - centred / std::sqrt(centred.square().mean())).abs().maxCoeff(),
              1e-12);
  }
  EXPECT_TRUE(needs_torques(model));
}

TEST(JointEffects, OfTorquesThatWereNotMeasuredAreRefused) {
  ErrorModel model = complete_model(fanuc());
  Random random(13);
  DrivenConfigurations driven = driven_stops(model, random);
  const Eigen::MatrixXd& q = driven.joint_values;
  DriveSignals& signals = driven.signals;
  EXPECT_TRUE(effect_terms(model, EffectGroup::torque, q).empty());
  model.effects = effect_terms(model, EffectGroup::torque, q, signals);
  EXPECT_REFUSED_WITH(::testing::HasSubstr("no measured torque of joint_1"), effect_basis(model, q));
  EXPECT_REFUSED_WITH(::testing::HasSubstr("measured torques"),
                      ArmKinematics(model, Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size())),
                                    Eigen::VectorXd::Ones(12)));
  signals.torques(2, 7) = std::nan("");
  EXPECT_REFUSED_WITH(::testing::HasSubstr("joint_3 at configuration number 8"), effect_basis(model, q, signals));
  EXPECT_REFUSED_WITH(::testing::HasSubstr("joint_3"), effect_terms(model, EffectGroup::torque, q, signals));
  signals.torques.row(2).setConstant(std::nan(""));
  EXPECT_EQ(effect_terms(model, EffectGroup::torque, q, signals).size(), 10U) << "one joint has no sensor";
}

// The torque is the slope of the potential energy of unit masses at the frames, which KDL places.
TEST(JointEffects, BacklashLiesWhereGravityPulls) {
  const Robot robot = fanuc();
  ErrorModel model = complete_model(robot);
  Random random(9);
  const Eigen::MatrixXd q = random_configurations(limits_of(model.joints), 60, random);
  model.effects = effect_terms(model, EffectGroup::backlash, q);
  const auto second = std::find_if(model.effects.begin(), model.effects.end(),
                                   [](const EffectTerm& term) { return term.name == "backlash.2"; });
  ASSERT_NE(second, model.effects.end());
  const Eigen::VectorXd basis = effect_basis(model, q).row(second - model.effects.begin());
  KDL::ChainFkSolverPos_recursive solver(robot.chain);
  std::vector<std::pair<double, double>> sides;  // torque, and where the joint lies in its play
  for (Eigen::Index c = 0; c < q.cols(); ++c) {
    const Eigen::MatrixXd slopes = testing::central_differences(6, 1e-6, [&](const Eigen::VectorXd& step) {
      KDL::JntArray joints(6);
      joints.data = q.col(c) + step;
      double energy = 0.0;
      for (unsigned segment = 1; segment <= robot.chain.getNrOfSegments(); ++segment) {
        KDL::Frame pose;
        solver.JntToCart(joints, pose, static_cast<int>(segment));
        energy += pose.p.z();
      }
      return Eigen::VectorXd::Constant(1, energy);
    });
    sides.emplace_back(-slopes(0, 1), value_of(*second, basis[c]));
    EXPECT_GE(sides.back().first * sides.back().second, 0.0) << c;
  }
  double mean = 0.0;
  for (const auto& [torque, side] : sides) {
    mean += std::abs(torque) / static_cast<double>(sides.size());
  }
  for (const auto& [torque, side] : sides) {
    EXPECT_NEAR(side, std::tanh(torque / (0.15 * mean)), 1e-6) << torque;
  }
  std::sort(sides.begin(), sides.end());
  EXPECT_TRUE(std::is_sorted(sides.begin(), sides.end(),
                             [](const auto& a, const auto& b) { return a.second < b.second - 1e-6; }));
  EXPECT_LT(sides.front().second, -0.9);
  EXPECT_GT(sides.back().second, 0.9);
  EXPECT_LE(sides.back().second, 1.0);
}

// The sum of the squared functions is the covariance of the process (Rasmussen and Williams 2006, 4.17), with this
// length on the scale of these values of the third joint.
void expect_matern(const ErrorModel& model, const Eigen::MatrixXd& q, const Eigen::VectorXd& values, double length) {
  const Eigen::MatrixXd basis = effect_basis(model, q);
  const Eigen::MatrixXd covariance = basis.transpose() * basis;
  for (Eigen::Index a = 0; a < q.cols(); ++a) {
    for (Eigen::Index b = 0; b < q.cols(); ++b) {
      const double r = std::sqrt(3.0) * std::abs(values[a] - values[b]) / length;
      EXPECT_NEAR(covariance(a, b), (1.0 + r) * std::exp(-r), 0.03) << length << ": " << a << ", " << b;
    }
  }
}

TEST(JointEffects, TablesHaveTheCovarianceOfMaternThreeHalves) {
  ErrorModel model = complete_model(fanuc());
  Eigen::MatrixXd q = Eigen::MatrixXd::Zero(6, 41);
  q.row(2) = Eigen::RowVectorXd::LinSpaced(41, -1.0, 1.4);
  for (const double length : {0.5, 0.2, 0.1}) {
    model.effects = table_terms(model, q, length);
    for (const EffectTerm& term : model.effects) {
      ASSERT_EQ(term.index, 2) << "the others do not move";
      ASSERT_EQ(size_name(term), "tables.3");
    }
    expect_matern(model, q, q.row(2), length);
    // What is withheld at an end is withheld beyond it.
    ErrorModel withholding = model;
    for (EffectTerm& term : withholding.effects) {
      auto& table = std::get<JointTable>(term.function);
      table.withheld = {{1.2, table.upper}};
    }
    for (const double there : {1.1, 1.3, 1.5}) {
      Eigen::MatrixXd at = q.leftCols(1);
      at(2, 0) = there;
      EXPECT_EQ(effect_basis(withholding, at).isZero(0.0), there > 1.2) << there;
      EXPECT_EQ(withholds_tables(withholding, at.col(0)), there > 1.2) << there;
    }
    // Beyond the measured range the value is held.
    Eigen::MatrixXd beyond = q.rightCols(1);
    beyond(2, 0) += 0.7;
    EXPECT_EQ(effect_basis(model, beyond), effect_basis(model, q.rightCols(1)));
  }
}

// A length of more than half the measured range is half of it: the table is that of a joint that moves ten times as far
// with ten times the length.
TEST(JointEffects, TablesOfAShortRangeAreThoseOfALongOneMadeSmaller) {
  ErrorModel model = complete_model(fanuc());
  Eigen::MatrixXd q = Eigen::MatrixXd::Zero(6, 21);
  q.row(2) = Eigen::RowVectorXd::LinSpaced(21, -1.0, 1.0);
  const Eigen::MatrixXd narrow = 0.1 * q;
  const std::vector<EffectTerm> of_long = table_terms(model, q, 1.0);
  for (const double length : {0.1, 0.5, 30.0}) {
    model.effects = table_terms(model, narrow, length);
    EXPECT_EQ(model.effects.size(), of_long.size()) << length;
    expect_matern(model, narrow, q.row(2), 1.0);
  }
  EXPECT_TRUE(table_terms(model, 0.01 * q, 0.5).empty()) << "a joint that hardly moves";
}

TEST(JointEffects, IsIdentifiedFromMeasurements) {
  ErrorModel model = complete_model(fanuc());
  model.effects = load_terms(model);
  for (const EffectTerm& gain : gain_terms(model)) {
    model.effects.push_back(gain);
  }
  testing::VirtualExperiment experiment({.model = model, .random = Random(3)});
  VirtualRobot& robot = experiment.robot;
  robot.truth.effects = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.effects.size()));
  robot.truth.effects.head<4>() << 0.001, -0.0005, 0.0008, 0.0002;
  const Measurements measured = experiment.measure(60);
  std::vector<std::size_t> effects(model.effects.size());
  std::iota(effects.begin(), effects.end(), 0U);
  const Unknowns free = experiment.free.with(model, UnknownGroup::effects, effects);
  const Identification found = identify_jointly(model, measured, nominal_start(model, measured), free);
  ASSERT_EQ(found.termination, Termination::converged) << found.message;
  EXPECT_LT((found.estimate.effects - robot.truth.effects).cwiseAbs().maxCoeff(), 1e-9);
  EXPECT_LT(found.rms, 1e-11);
}

}  // namespace
}  // namespace kdl_calibration::joint_effects_test
