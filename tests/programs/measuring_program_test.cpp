#include "programs/measuring_program.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <string>

#include "programs/program_language.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::measuring_program_test {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kDegree;
using ::testing::SizeIs;

MeasuringPlan two_configurations() {
  MeasuringPlan plan;
  plan.configurations = {"1", "odd;\"name\n"};
  plan.joint_values.resize(6, 2);
  plan.joint_values.col(0) << 10.0, -20.0, 30.0, -40.0, 50.0, -60.0;
  plan.joint_values.col(1) << 1.0, 2.5, -3.25, 0.0, -0.125, 179.5;
  plan.joint_values *= kDegree;
  return plan;
}

// Joints of the R-2000iC with the names of each language, and its pendant's way to count them.
JointConvention pendant_of(const ProgramLanguage& language) {
  JointConvention convention = read_joint_convention(URDF_DIR "/fanuc_r2000ic_165f_pendant.json");
  convention.controller_joints.assign(language.joint_names.begin(), language.joint_names.end());
  return convention;
}

// J = [q1, -q2, q3 + q2, -q4, q5, -q6]: q3 = J3 + J2 and q2 = -J2.
TEST(MeasuringProgram, IsReadAsTheConfigurationsOfThePlanInEveryLanguage) {
  const MeasuringPlan plan = two_configurations();
  for (const ProgramLanguage* language : program_languages()) {
    const JointConvention convention = pendant_of(*language);
    const std::string text = measuring_program(testing::fanuc(), plan, &convention, *language, "plan 1/a");
    EXPECT_THAT(text, HasSubstr("configuration 1")) << language->name;
    EXPECT_EQ(&language_of({.source = "OUT", .text = text}), language) << text;
    const Program program = language->parse({{.source = "OUT", .text = text}});
    EXPECT_THAT(program.remarks, IsEmpty()) << language->name;
    ASSERT_THAT(program.points, SizeIs(2)) << text;
    ASSERT_THAT(program.motions, SizeIs(2)) << text;
    const double degree = kDegree / language->angle_unit;
    for (std::size_t i = 0; i < 2; ++i) {
      EXPECT_EQ(program.motions[i].point, i);
      EXPECT_FALSE(program.motions[i].is_straight);
      const auto q = plan.joint_values.col(static_cast<Eigen::Index>(i)) / kDegree;
      const std::array<double, 6> expected = {q[0], -q[1], q[2] + q[1], -q[3], q[4], -q[5]};
      for (std::size_t k = 0; k < 6; ++k) {
        EXPECT_EQ(program.points[i].notation, PointNotation::joints);
        EXPECT_NEAR(program.points[i].fields[k].value, expected[k] * degree, 5e-4 * degree) << language->name << k;
      }
    }
  }
}

TEST(MeasuringProgram, CountsJointsAsTheUrdfWithoutAConvention) {
  const ProgramLanguage& language = language_of_file("A.Script");
  const std::string text = measuring_program(testing::fanuc(), two_configurations(), nullptr, language, "9");
  EXPECT_THAT(text, HasSubstr("def P9():\n"));
  EXPECT_THAT(text, HasSubstr("movej([0.174533, -0.349066, 0.523599, -0.698132, 0.872665, -1.047198], "));
  EXPECT_THAT(text, HasSubstr("\"configuration odd__name_\""));
}

TEST(MeasuringProgram, RefusesOtherEndingsAndOtherJoints) {
  EXPECT_REFUSED("poses.txt: expected the ending of one of these languages: FANUC LS (.LS), ",
                 language_of_file("poses.txt"));
  const JointConvention of_others = read_joint_convention(URDF_DIR "/fanuc_r2000ic_165f_pendant.json");
  EXPECT_REFUSED(
      "names other joints, expected Base to Wrist 3 of the controller",
      measuring_program(testing::fanuc(), two_configurations(), &of_others, language_of_file("a.script"), "a"));
}

}  // namespace
}  // namespace kdl_calibration::measuring_program_test
