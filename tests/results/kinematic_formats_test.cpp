#include "results/kinematic_formats.hpp"

#include <gmock/gmock.h>

#include <map>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>

#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "robot/chain_to_dh.hpp"
#include "robot/ur_calibration.hpp"
#include "support.hpp"
#include "ur10.hpp"

namespace kdl_calibration::kinematic_formats_test {
namespace {

using ::testing::HasSubstr;

/// The robot with errors of 2 mm and 20 mrad; of the last link as well, if a fixed joint carries them.
Robot with_errors(const Robot& robot, bool of_last_link = true) {
  const ErrorModel model = complete_model(robot);
  Random random(8);
  Eigen::VectorXd errors = testing::random_errors(model, random, 0.002, 0.02);
  for (std::size_t p = 0; p < model.parameters.size(); ++p) {
    const bool last = model.parameters[p].frame == static_cast<int>(model.joints.size());
    errors[static_cast<Eigen::Index>(p)] *= last && !of_last_link ? 0.0 : 1.0;
  }
  return parse_robot(calibrated_urdf(robot, model, errors), {.base = robot.base, .tip = robot.tip});
}

/// Seven joints, all skew.
Robot skew_arm() {
  std::string urdf = "<robot name=\"skew\"><link name=\"l0\"/>";
  Random random(2);
  for (int i = 1; i <= 8; ++i) {
    std::ostringstream joint;
    joint << "<link name=\"l" << i << "\"/><joint name=\"j " << i << "\" type=\"" << (i < 8 ? "continuous" : "fixed")
          << "\"><parent link=\"l" << i - 1 << "\"/><child link=\"l" << i << "\"/><origin xyz=\"" << random.uniform()
          << " " << random.uniform() << " " << random.uniform() << "\" rpy=\"" << 3 * random.uniform() << " "
          << random.uniform() << " " << 3 * random.uniform() << "\"/><axis xyz=\"1 " << random.uniform()
          << " 0\"/></joint>";
    urdf += joint.str();
  }
  return parse_robot(urdf + "</robot>");
}

std::vector<Robot> arms() { return {testing::fanuc(), skew_arm(), parse_robot(testing::kOddArm)}; }

using Origins = std::map<std::string, KDL::Frame>;

/// x, y, z, roll, pitch and yaw from the second group of a match on.
KDL::Frame origin_in(const std::smatch& match) {
  const auto number = [&](std::size_t i) { return std::stod(match[i]); };
  return {KDL::Rotation::RPY(number(5), number(6), number(7)), KDL::Vector(number(2), number(3), number(4))};
}

KDL::Chain chain_with(const Robot& robot, const Origins& origins) {
  return testing::chain_with(robot, [&](const KDL::Segment& segment) {
    const std::string& name = segment.getJoint().getName();
    return origins.contains(name) ? origins.at(name) : segment.pose(0.0);
  });
}

void expect_same(const KDL::Chain& a, const Robot& b) {
  Random random(9);
  for (int i = 0; i < 30; ++i) {
    const Eigen::VectorXd q = testing::random_joints(complete_model(b), random);
    EXPECT_LT(testing::difference(testing::kdl_pose(a, q), testing::kdl_pose(b.chain, q)), 1e-12);
  }
}

TEST(KinematicFormats, DhTablesAreTheCalibratedArm) {
  for (const Robot& robot : arms()) {
    const Robot calibrated = with_errors(robot);
    for (const DhConvention convention : {DhConvention::standard, DhConvention::modified}) {
      const std::string text = dh_export(calibrated, convention, "a note");
      const nlohmann::json json = nlohmann::json::parse(text);
      EXPECT_EQ(json["note"], "a note");
      EXPECT_LT(json["largest_difference"]["position[m]"], 1e-12) << text;
      EXPECT_LT(json["largest_difference"]["rotation[rad]"], 1e-12) << text;
      expect_same(parse_robot(dh_urdf(parse_dh_table(text))).chain, calibrated);
    }
  }
}

TEST(KinematicFormats, XacroYamlHasTheOriginOfEveryJoint) {
  for (const Robot& robot : arms()) {
    const Robot calibrated = with_errors(robot);
    const std::string yaml = xacro_yaml(calibrated, "a note");
    EXPECT_TRUE(yaml.starts_with("# a note\n"));
    const std::regex line(R"re(^"([^"]+)": \{xyz: "(\S+) (\S+) (\S+)", rpy: "(\S+) (\S+) (\S+)"\}$)re");
    Origins origins;
    std::istringstream lines(yaml.substr(yaml.find('\n') + 1));
    for (std::string text; std::getline(lines, text);) {
      std::smatch m;
      ASSERT_TRUE(std::regex_match(text, m, line)) << text;
      origins[m[1]] = origin_in(m);
    }
    EXPECT_EQ(origins.size(), robot.chain.getNrOfSegments());
    expect_same(chain_with(robot, origins), calibrated);
  }
}

TEST(KinematicFormats, UrYamlHasTheOriginsByTheirNames) {
  const Robot robot = parse_robot(testing::kUr10);
  const Robot calibrated = with_errors(robot, false);
  const std::string yaml = ur_yaml(robot, calibrated, "");
  const std::map<std::string, std::string> joints = {
      {"shoulder", "shoulder_pan_joint"}, {"forearm", "elbow_joint"},   {"upper_arm", "shoulder_lift_joint"},
      {"wrist_1", "wrist_1_joint"},       {"wrist_2", "wrist_2_joint"}, {"wrist_3", "wrist_3_joint"}};
  const std::regex block(R"(\n  (\w+):\n    x: (\S+)\n    y: (\S+)\n    z: (\S+)\n    roll: (\S+)\n    pitch: (\S+)\n)"
                         R"(    yaw: (\S+)(?=\n))");
  Origins origins;
  for (std::sregex_iterator it(yaml.begin(), yaml.end(), block), end; it != end; ++it) {
    origins[joints.at((*it)[1])] = origin_in(*it);
  }
  EXPECT_EQ(origins.size(), 6U) << yaml;
  EXPECT_TRUE(yaml.starts_with("kinematics:\n  shoulder:\n")) << yaml;
  EXPECT_THAT(yaml, HasSubstr("\n  hash: kdl_calibration_"));
  expect_same(chain_with(robot, origins), calibrated);
  expect_same(parse_robot(urdf_with_origins(robot.urdf, ur_origins(robot, yaml, "u.yaml"))).chain, calibrated);
  // YAML 1.1 reads 1e-05 as text.
  EXPECT_FALSE(std::regex_search(ur_yaml(robot, robot, ""), std::regex(R"(: -?\de)")));
  EXPECT_THAT(ur_yaml(robot, robot, "a note"), HasSubstr("# a note\nkinematics:\n"));

  const auto refused = [](const Robot& nominal, const Robot& other) {
    return testing::refusal([&] { ur_yaml(nominal, other, ""); });
  };
  EXPECT_THAT(refused(testing::fanuc(), testing::fanuc()), HasSubstr("is no Universal Robot: expected the joints"));
  EXPECT_THAT(refused(robot, with_errors(robot)), HasSubstr("errors stand behind the last joint"));
  std::string turned = testing::kUr10;
  turned.replace(turned.find("0 0 1\""), 5, "0 1 0");
  EXPECT_THAT(refused(parse_robot(turned), parse_robot(turned)),
              HasSubstr("'shoulder_pan_joint' does not turn about z"));
}

TEST(KinematicFormats, ParametersHaveUnitsAndDeviationsWhereTheyAreKnown) {
  const ErrorModel model = complete_model(testing::fanuc());
  const Eigen::VectorXd errors = testing::errors_of(model, {{"dq2", 0.01}, {"Tz2", 0.002}});
  const std::vector<ParameterEstimate> estimates = {
      {.name = "Tz2", .joint = {}, .axis = {}, .error = 0.002, .std = 1e-5},
      {.name = "Ty1", .joint = {}, .axis = {}, .error = 0.5, .std = 1e-5},
      {.name = "A.x", .joint = {}, .axis = {}, .error = 1.0, .std = 1e-5}};
  EXPECT_EQ(parameters_csv(model, errors, estimates, "a note"),
            "# a note\nparameter,joint,kind,axis,unit,nominal,value,error,std\n"
            "dq2,joint_2,joint_offset,x,rad,0,0.01,0.01,\n"
            "Ty1,joint_2,translation,y,m,0.312,0.312,0,\n"
            "Tz2,joint_3,translation,z,m,1.075,1.077,0.002,1e-05\n");
}

}  // namespace
}  // namespace kdl_calibration::kinematic_formats_test
