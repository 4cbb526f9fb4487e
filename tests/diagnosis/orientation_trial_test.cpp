// Poses written by independent formulas, and read in another way.

#include "diagnosis/orientation_trial.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <functional>
#include <string>
#include <vector>

#include "diagnosis/trial_fit.hpp"
#include "kdl_calibration/orientation_reading.hpp"
#include "support.hpp"

namespace kdl_calibration::orientation_trial_test {
namespace {

using ::testing::HasSubstr;

using Numbers = std::function<Eigen::Vector3d(const KDL::Rotation&)>;

Eigen::Vector3d fixed_xyz(const KDL::Rotation& R) {
  Eigen::Vector3d v;
  R.GetRPY(v[0], v[1], v[2]);
  return v;
}

Eigen::Vector3d moving_xyz(const KDL::Rotation& R) { return to_eigen(KDL::Frame(R)).linear().eulerAngles(0, 1, 2); }

Eigen::Vector3d rotation_vector(const KDL::Rotation& R) {
  const KDL::Vector v = R.GetRot();
  return {v.x(), v.y(), v.z()};
}

// 24 poses of a target at random joint values of the nominal robot.
std::string poses(const std::string& columns, const Numbers& numbers) {
  const Robot robot = testing::fanuc();
  const KDL::Frame target(KDL::Rotation::RPY(0.2, -0.1, 0.3), KDL::Vector(0.1, 0.05, 0.2));
  std::string csv = "configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z," + columns + "\n";
  Random random(5);
  for (int i = 0; i < 24; ++i) {
    const Eigen::VectorXd q = testing::random_joints(complete_model(robot), random);
    const KDL::Frame pose = testing::kdl_pose(robot.chain, q) * target;
    csv += fmt::format("{},A,{}", i + 1, fmt::join(q.begin(), q.end(), ","));
    const Eigen::Vector3d degrees = numbers(pose.M) / testing::kDegree;
    csv += fmt::format(",{},{},{},{},{},{}\n", pose.p.x(), pose.p.y(), pose.p.z(), degrees[0], degrees[1], degrees[2]);
  }
  return csv;
}

std::string found(const std::string& csv, const std::string& word) {
  const Robot robot = testing::fanuc();
  const ErrorModel model = complete_model(robot);
  const Measurements measured = parse_measurements(robot, csv, nullptr, "m.csv", orientation_reading(word));
  const auto trial = try_orientations(model, measured, nominal_start(model, measured));
  if (!trial) {
    return "as read";
  }
  EXPECT_EQ(trial->said.cause, Cause::orientations);
  return trial->said.message;
}

TEST(OrientationTrial, NamesWhatThreeNumbersAre) {
  struct Case {
    std::string columns;
    Numbers numbers;
    std::string right;  // --orientation
    std::string wrong;
    std::string words;
  };
  const std::string r = "rx[deg],ry[deg],rz[deg]";
  const std::string rpy = "roll[deg],pitch[deg],yaw[deg]";
  const std::string kuka = "A[deg],B[deg],C[deg]";
  const std::vector<Case> cases = {
      {r, fixed_xyz, "fixed-xyz", "", "24 of 24 do if they are read as angles about fixed axes instead of a rotation"},
      {r, moving_xyz, "moving-xyz", "", "24 of 24 do if they are read as angles about moving axes instead of a rota"},
      {r, rotation_vector, "", "fixed-xyz", "as a rotation vector instead of angles (--orientation rotation-vector)"},
      {r, rotation_vector, "", "moving-xyz", "as a rotation vector instead of angles (--orientation rotation-vector)"},
      {r, fixed_xyz, "fixed-xyz", "moving-xyz", "24 of 24 do if they are read as angles about fixed instead of moving"},
      {rpy, moving_xyz, "moving-xyz", "", "24 of 24 do if they are read as angles about moving instead of fixed"},
      {kuka, fixed_xyz, "fixed-xyz", "", "24 of 24 do if they are read as angles about x, y and z instead of z, y"}};
  for (const Case& each : cases) {
    const std::string csv = poses(each.columns, each.numbers);
    EXPECT_EQ(found(csv, each.right), "as read") << each.columns << each.right;
    EXPECT_THAT(found(csv, each.wrong), HasSubstr(each.words)) << each.columns << each.wrong;
  }
}

// Points that are 5 % too far apart are another doubt. The one that all rows agree on is said in its place.
TEST(OrientationTrial, IsSaidBeforeAnyOtherDoubt) {
  const Robot robot = testing::fanuc();
  const ErrorModel model = complete_model(robot);
  const auto causes = [&](OrientationReading reading) {
    Measurements measured =
        parse_measurements(robot, poses("rx[deg],ry[deg],rz[deg]", fixed_xyz), nullptr, "m.csv", reading);
    for (Observation& row : measured.observations) {
      row.position() *= 1.05;
    }
    std::vector<Cause> found;
    for (const AlternativeReading& each :
         alternative_readings_of_nominal(model, measured, nominal_start(model, measured))) {
      found.push_back(each.cause);
    }
    return found;
  };
  EXPECT_THAT(causes(OrientationReading::fixed_xyz), ::testing::ElementsAre(Cause::scale));
  EXPECT_THAT(causes(OrientationReading::usual), ::testing::ElementsAre(Cause::orientations));
}

}  // namespace
}  // namespace kdl_calibration::orientation_trial_test
