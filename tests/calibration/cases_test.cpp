// Files that once gave a wrong number without a word. The truth is in their test rows, or in how they were made.

#include <gmock/gmock.h>

#include <cmath>
#include <string>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "kdl_calibration/measurements.hpp"
#include "measurements/same_poses.hpp"
#include "support.hpp"

namespace kdl_calibration::cases_test {
namespace {

using ::testing::HasSubstr;

const std::string kCases = std::string(SHARED_DATA_DIR) + "/cases/";

// As kdlcal does without an option.
CalibrationResult calibrated(const Measurements& measured, CalibrationSettings options = {}) {
  options.selection.automatic_priors = true;
  options.selection.effects.automatic = true;
  return calibrate(complete_model(testing::fanuc()), measured, options);
}

CalibrationResult calibrated(const std::string& name, const CalibrationSettings& options = {}) {
  return calibrated(with_poses_joined(read_measurements(testing::fanuc(), kCases + name)), options);
}

TEST(CasesOnRealData, ABlunderIsNamedAndWhatTheRestGivesWithoutIt) {
  const CalibrationResult found = calibrated("blunder_pose_12.csv");
  ASSERT_FALSE(found.trusted());
  EXPECT_EQ(found.diagnosis.doubts.front().cause, Cause::gross_rows);
  EXPECT_THAT(found.diagnosis.gross_rows.rows,
              ::testing::ElementsAre(::testing::Field(&GrossRow::configuration, "12")));
  EXPECT_NEAR(found.diagnosis.gross_rows.rows.front().distance, 0.062, 0.003);
  EXPECT_LT(found.diagnosis.gross_rows.rms_without, 5e-5);
  const Measurements measured = read_measurements(testing::fanuc(), kCases + "blunder_pose_12.csv");
  const CalibrationResult without = calibrated(without_rows(measured, {"12"}));
  EXPECT_TRUE(without.trusted());
  EXPECT_LT(without.accuracy.train.after.rms, 5e-5);
}

TEST(CasesOnRealData, ReadBacksOfOnePoseAreRepeats) {
  const CalibrationResult found = calibrated("jittered_repeats.csv");
  ASSERT_TRUE(found.accuracy.test.has_value());
  ASSERT_NE(found.accuracy.held_out(), nullptr);
  EXPECT_EQ(found.uncertainty.influence.configurations.size(), 16U);
  // Sixteen poses tell of new ones what they tell: within a factor of two of the test rows, not a hundredth.
  EXPECT_GT(found.accuracy.held_out()->after.rms, 0.5 * found.accuracy.test->after.rms);
}

TEST(CasesOnRealData, NoiseAgreesWithTheResiduals) {
  const CalibrationResult found = calibrated("offsets_only.csv", {.parameters = {.fix = {"T*", "R*"}}});
  const double of_coordinates = found.accuracy.train.after.rms / std::sqrt(3.0);
  EXPECT_GT(found.noise.sigma, of_coordinates / 1.5);
  EXPECT_LT(found.noise.sigma, of_coordinates * 1.5);
  EXPECT_LE(found.noise.degrees_of_freedom, 270.0);
}

TEST(CasesOnRealData, ALonelyRowHidesNoEffect) {
  const CalibrationResult found = calibrated("lone_target.csv");
  ASSERT_TRUE(found.accuracy.test.has_value());
  EXPECT_LT(found.accuracy.test->after.rms, 8e-5);
  EXPECT_TRUE(found.trusted());
  EXPECT_THAT(messages_of(found.diagnosis.remarks),
              ::testing::Contains(HasSubstr("models were compared without 1 point")));
  EXPECT_THAT(messages_of(found.diagnosis.remarks),
              ::testing::Contains(HasSubstr("alone, which says hardly anything of the arm")));
}

TEST(CasesOnRealData, ADriveBesideTheChainIsAJointOfTheFile) {
  const Robot lift = load_robot(kCases + "leader_elsewhere.urdf", {.base = "", .tip = "tool0"});
  const CalibrationResult found =
      calibrate(complete_model(lift), read_measurements(lift, kCases + "leader_elsewhere.csv"));
  EXPECT_TRUE(found.trusted());
  EXPECT_LT(found.accuracy.train.after.rms, 1e-9);
}

TEST(CasesOnRealData, SocketsOneAfterTheOtherAreRight) {
  const CalibrationResult found = calibrated("three_sockets.csv");
  EXPECT_TRUE(found.trusted());
  EXPECT_THAT(found.diagnosis.gross_rows.rows, ::testing::IsEmpty());
}

}  // namespace
}  // namespace kdl_calibration::cases_test
