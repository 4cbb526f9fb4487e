#include "kdl_calibration/orientation_reading.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::orientation_reading_test {
namespace {

using Eigen::Quaterniond;
using ::testing::HasSubstr;

const std::string kHead = "configuration,target,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z,";

Quaterniond read(const std::string& columns, const std::string& angles, const std::string& word) {
  const Measurements found =
      parse_measurements(testing::fanuc(), kHead + columns + "\n1,A,0,0,0,0,0,0,1,2,3," + angles + "\n", nullptr,
                         "m.csv", orientation_reading(word));
  return *found.observations[0].orientation();
}

// Products of quarter turns, multiplied by hand: i j = k, j k = i, k i = j.
TEST(OrientationReading, IsTheProductThatItsNameSays) {
  const double half = std::numbers::pi / 2.0 / std::numbers::sqrt2;  // of a turn by a quarter of (1, 0, 1)
  const double s = std::sin(half) / std::numbers::sqrt2;
  struct Case {
    std::string columns;
    std::string angles;
    std::string word;
    Quaterniond expected;
  };
  const std::string r = "rx[deg],ry[deg],rz[deg]";
  const std::string kuka = "A[deg],B[deg],C[deg]";
  const std::vector<Case> cases = {{r, "90,0,90", "fixed-xyz", {0.5, 0.5, 0.5, 0.5}},
                                   {r, "90,0,90", "moving-xyz", {0.5, 0.5, -0.5, 0.5}},
                                   {r, "90,0,90", "moving-zyx", {0.5, 0.5, 0.5, 0.5}},
                                   {r, "90,0,90", "rotation-vector", {std::cos(half), s, 0.0, s}},
                                   {r, "90,0,90", "", {std::cos(half), s, 0.0, s}},
                                   {kuka, "90,90,0", "", {0.5, -0.5, 0.5, 0.5}},
                                   {kuka, "90,90,0", "moving-zyx", {0.5, -0.5, 0.5, 0.5}},
                                   {kuka, "90,90,0", "fixed-xyz", {0.5, 0.5, 0.5, -0.5}},
                                   {kuka, "90,90,0", "moving-xyz", {0.5, 0.5, 0.5, 0.5}},
                                   {"roll[deg],pitch[deg],yaw[deg]", "90,90,0", "moving-xyz", {0.5, 0.5, 0.5, 0.5}},
                                   {"W[deg],P[deg],R[deg]", "90,90,0", "", {0.5, 0.5, 0.5, -0.5}}};
  for (const Case& each : cases) {
    const Quaterniond found = read(each.columns, each.angles, each.word);
    EXPECT_NEAR(std::abs(found.dot(each.expected)), 1.0, 1e-15) << each.columns << each.word;
  }
}

TEST(OrientationReading, HasAWord) {
  for (const std::string& word : orientation_words()) {
    EXPECT_EQ(to_string(orientation_reading(word)), word);
  }
  EXPECT_EQ(orientation_words().size(), 4U);
  EXPECT_EQ(orientation_reading(""), OrientationReading::usual);
  EXPECT_EQ(to_string(OrientationReading::usual), "");
  EXPECT_REFUSED("orientation: 'zyz' is unknown, expected one of rotation-vector, fixed-xyz",
                 orientation_reading("zyz"));
}

TEST(OrientationReading, NeedsThreeNumbers) {
  EXPECT_REFUSED("m.csv:1: no three numbers of an orientation are there to be read as fixed-xyz",
                 read("qw,qx,qy,qz", "1,0,0,0", "fixed-xyz"));
  EXPECT_REFUSED("m.csv:1: no three numbers", read("sigma", "0.1", "moving-zyx"));
}

}  // namespace
}  // namespace kdl_calibration::orientation_reading_test
