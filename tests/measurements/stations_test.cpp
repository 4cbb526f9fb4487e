#include "measurements/stations.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "measurements/measurements_check.hpp"
#include "measurements/same_poses.hpp"
#include "refusal.hpp"

namespace kdl_calibration::stations_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::refusal;

const std::string kFile =
    "configuration,station,target,q1[rad],x[m],y[m],z[m]\n"
    "1,east,A,0.1,1,2,3\n"
    "1,east,B,0.1,4,5,6\n"
    "2,west,A,0.1,7,8,9\n"
    "3,east,A,0.5,1,1,1\n";

Measurements parsed(const std::string& csv) { return parse_measurements(csv, std::vector<std::string>{"q1"}); }

TEST(StationColumn, AreReadAndWrittenBack) {
  const Measurements read = parsed(kFile);
  EXPECT_THAT(read.stations, ElementsAre("east", "west"));
  EXPECT_THAT(stations_of_configurations(read), ElementsAre(0, 1, 0));
  const Measurements again = parsed(measurements_csv(read));
  EXPECT_EQ(again.stations, read.stations);
  EXPECT_EQ(stations_of_configurations(again), stations_of_configurations(read));
}

TEST(StationColumn, OneConfigurationHasOne) {
  const std::string message = refusal([] { return parsed(kFile + "2,east,B,0.1,0,0,0\n"); });
  EXPECT_THAT(message,
              HasSubstr("measurements:6: station 'east' differs from line 4: expected one station in all rows of"));
  Measurements wrong = parsed(kFile);
  wrong.observations.front().station = 1;
  EXPECT_REFUSED("rows of several stations", check(wrong));
  wrong.observations.front().station = 2;
  EXPECT_REFUSED("station 2 is not there, expected 0 to 1", check(wrong));
}

TEST(StationColumn, AreAtMostAHundredWithNames) {
  std::string csv = "configuration,station,target,q1[rad],x[m],y[m],z[m]\n";
  for (int i = 0; i <= 100; ++i) {
    csv += std::to_string(i) + ",s" + std::to_string(i) + ",A,0.1,1,2,3\n";
  }
  EXPECT_REFUSED("measurements:102: one station more than the limit of 100", parsed(csv));
  EXPECT_REFUSED("measurements:6: station ''", parsed(kFile + "4,,A,0.2,0,0,0\n"));
}

TEST(StationColumn, TheSamePoseFromTwoIsNoRepeat) {
  EXPECT_EQ(with_poses_joined(parsed(kFile)).configurations.size(), 3U);
}

TEST(StationColumn, KeepTheirRowsInSubsetsAndUnions) {
  const Measurements all = parsed(kFile);
  const Measurements west = subset(all, [](const Observation& o) { return o.station == 1; });
  EXPECT_EQ(west.stations, all.stations);
  EXPECT_THAT(stations_of_configurations(west), ElementsAre(1));
  EXPECT_THAT(stations_of_configurations(averaged(all)), ElementsAre(0, 1, 0));
  EXPECT_THAT(stations_of_configurations(joined(all, west)), ElementsAre(0, 1, 0, 1));
  Measurements unnamed = west;
  unnamed.stations = {"W"};
  unnamed.observations.front().station = 0;
  EXPECT_REFUSED("other stations", joined(all, unnamed));
  const StationRows rows = rows_of_station(all, 0);
  EXPECT_THAT(rows.rows, ElementsAre(0U, 1U, 3U));
  EXPECT_EQ(rows.measurements.configurations.size(), 3U);
  EXPECT_EQ(rows.measurements.stations, std::vector<std::string>{"W"});
}

}  // namespace
}  // namespace kdl_calibration::stations_test
