#include "measurements/directions.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "measurements/measurements_check.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "refusal.hpp"

namespace kdl_calibration::directions_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using testing::refusal;

const std::string kHeader = "configuration,split,target,q1[rad],x[m],y[m],z[m],n_x,n_y,n_z,along[mm]\n";
const std::string kFile = kHeader +
                          "1,train,A,0.1,1,2,3,,,,\n"
                          "1,train,B,0.1,,5,6,,,,\n"
                          "2,test,A,0.2,,,9,,,,\n"
                          "3,train,A,0.5,,,,0.6,0,0.8,-500\n";

Measurements parsed(const std::string& csv) { return parse_measurements(csv, std::vector<std::string>{"q1"}); }
std::string refusal_of(const std::string& row) {
  return refusal([&] { return parsed(kHeader + row + "\n"); });
}

TEST(Directions, BlankCoordinatesAndLinesAreReadAndWrittenBack) {
  const Measurements read = parsed(kFile);
  EXPECT_THAT(read.stations, ElementsAre("W"));
  const Vector3d n(0.6, 0.0, 0.8);
  ASSERT_EQ(read.coordinates.size(), 4U);
  EXPECT_EQ(read.coordinates[0].directions, Matrix3d::Identity());
  EXPECT_EQ(read.coordinates[1].directions, Matrix3d(Vector3d(0, 1, 1).asDiagonal()));
  EXPECT_EQ(read.observations[1].position, Vector3d(0, 5, 6));
  EXPECT_EQ(read.coordinates[2].directions, Matrix3d(Vector3d::UnitZ().asDiagonal()));
  EXPECT_TRUE(read.coordinates[3].directions.isApprox(n * n.transpose(), 1e-15));
  EXPECT_TRUE(read.observations[3].position.isApprox(-0.5 * n, 1e-15));
  const Measurements again = parsed(measurements_csv(read));
  for (std::size_t row = 0; row < 4; ++row) {
    EXPECT_TRUE(again.coordinates[row].directions.isApprox(read.coordinates[row].directions, 1e-15));
    EXPECT_TRUE(again.observations[row].position.isApprox(read.observations[row].position, 1e-15));
  }
  EXPECT_EQ(coordinates_of(read), 3 + 2 + 1 + 1);
}

TEST(Directions, FilesOfWholePointsHaveNone) {
  const Measurements read = parsed(kHeader + "1,train,A,0.1,1,2,3,,,,\n");
  EXPECT_FALSE(has_single_coordinates(read));
  EXPECT_TRUE(read.stations.empty());
}

TEST(Directions, LinesAloneNeedNoPoints) {
  const Measurements read = parsed("configuration,target,q1,n_x,n_y,n_z,along\n1,A,0.1,0,0,-1,2\n");
  EXPECT_EQ(read.observations.front().position, Vector3d(0, 0, -2));
  EXPECT_REFUSED("missing column n_z", parsed("configuration,target,q1,n_x,n_y,along\n1,A,0.1,0,0,2\n"));
  EXPECT_REFUSED("missing columns x, y, z, along", parsed("configuration,target,q1,n_x,n_y,n_z\n1,A,0.1,0,0,1\n"));
}

TEST(Directions, WrongRowsAreRefused) {
  EXPECT_THAT(refusal_of("1,train,A,0.1,,,,,,,"), HasSubstr(":2: x[m] '' is empty: expected a number"));
  EXPECT_THAT(refusal_of("1,train,A,0.1,1,,,1,0,0,5"), HasSubstr("expected one of the two"));
  EXPECT_THAT(refusal_of("1,train,A,0.1,,,,1,,0,5"), HasSubstr("n_y '' is empty"));
  EXPECT_THAT(refusal_of("1,train,A,0.1,,,,1,0,0,"), HasSubstr("along[mm] '' is empty"));
  EXPECT_THAT(refusal_of("1,train,A,0.1,,,,1,0,0.1,5"),
              HasSubstr("the norm of n_x, n_y, n_z is 1.005: expected a unit vector"));
  Measurements wrong = parsed(kFile);
  wrong.coordinates[1].directions *= 2.0;
  EXPECT_REFUSED("observation 1: its directions are no projector", check(wrong));
}

TEST(Directions, OnePointMayHaveSeveralButEachOnce) {
  const std::string rows = "1,train,A,0.1,1,,,,,,\n1,train,A,0.1,,2,,,,,\n1,train,A,0.1,,,3,,,,\n";
  const Measurements point = averaged(parsed(kHeader + rows));
  ASSERT_EQ(point.observations.size(), 1U);
  EXPECT_TRUE(point.observations.front().position.isApprox(Vector3d(1, 2, 3), 1e-15));
  EXPECT_TRUE(point.coordinates.front().directions.isIdentity(1e-15));
  EXPECT_REFUSED(":5: configuration '1', repeat 1, target 'A' is measured twice, before in line 3",
                 parsed(kHeader + rows + "1,train,A,0.1,,7,,,,,\n"));
}

// Twice x = 1 and 3, once 0.6 x + 0.8 y = 2: x by least squares is 2, and the line gives y = 1.
TEST(Directions, MeansAreThoseOfLeastSquares) {
  Measurements rows = parsed(kHeader + "1,train,A,0.1,1,,,,,,\n1,train,A,0.1,,,,0.6,0.8,0,2000\n");
  rows.observations.push_back(rows.observations.front());
  rows.observations.back().position.x() = 3.0;
  rows.coordinates.push_back(rows.coordinates.front());
  const Measurements mean = averaged(rows);
  EXPECT_TRUE(mean.observations.front().position.isApprox(Vector3d(2, 1, 0), 1e-12));
  EXPECT_TRUE(mean.coordinates.front().directions.isApprox(Matrix3d(Vector3d(1, 1, 0).asDiagonal()), 1e-12));
}

// Weights of 1/9 and 1/16 make 25/144.
TEST(Directions, MeansOfStatedSigmasStateTheirOwn) {
  Measurements rows = parsed(kHeader + "1,train,A,0.1,1,,,,,,\n");
  rows.observations.push_back(rows.observations.front());
  rows.coordinates.push_back(rows.coordinates.front());
  EXPECT_EQ(averaged(rows).observations.front().sigma, 0.0);
  rows.observations[0].sigma = 3e-5;
  rows.observations[1].sigma = 4e-5;
  EXPECT_NEAR(averaged(rows).observations.front().sigma, 2.4e-5, 1e-18);
}

TEST(Directions, StayWithTheirRows) {
  const Measurements all = parsed(kFile);
  const Measurements last = subset(all, [](const Observation& o) { return o.configuration > 0; });
  ASSERT_EQ(last.coordinates.size(), 2U);
  EXPECT_EQ(last.coordinates[1].directions, all.coordinates[3].directions);
  EXPECT_EQ((*TrainingRows(all)).coordinates.size(), 3U);
  EXPECT_EQ(rows_of_station(all, 0).measurements.coordinates, all.coordinates);
  Measurements whole = subset(all, [](const Observation& o) { return o.configuration == 0 && o.target == 0; });
  whole.coordinates.clear();
  const Measurements both = joined(whole, all);
  ASSERT_EQ(both.coordinates.size(), 5U);
  EXPECT_EQ(both.coordinates[0].directions, Matrix3d::Identity());
  EXPECT_EQ(both.coordinates[4].directions, all.coordinates[3].directions);
}

const std::string kDistances = "configuration,target,q1,anchor,distance[mm],x,y,z\n";

TEST(RowsOfDistances, AreReadAndWrittenBack) {
  const Measurements read = parsed(kDistances + "1,A,0.1,left,1500,,,\n1,B,0.1,left,1600,,,\n2,A,0.2,right,10,1,2,3\n");
  EXPECT_THAT(read.stations, ElementsAre("left", "right"));
  EXPECT_THAT(read.configurations, ElementsAre("1", "2"));
  EXPECT_EQ(read.coordinates[1].distance, 1.6);
  EXPECT_EQ(read.observations[1].position, Vector3d::Zero());
  EXPECT_EQ(read.observations[2].position, Vector3d(1, 2, 3));
  EXPECT_EQ(coordinates_of(read), 3);
  const Measurements again = parsed(measurements_csv(read));
  EXPECT_EQ(again.coordinates, read.coordinates);
  EXPECT_EQ(again.stations, read.stations);
  const Measurements alone = parsed("configuration,target,q1,distance\n1,A,0.1,1.5\n");
  EXPECT_THAT(alone.stations, ElementsAre("W"));
  EXPECT_EQ(alone.coordinates.front().distance, 1.5);
}

TEST(RowsOfDistances, AnAnchorWithoutADistanceIsNoPoint) {
  EXPECT_REFUSED(":3: the distance is empty and x, y, z are those of an anchor",
                 parsed(kDistances + "1,A,0.1,left,10,1,2,3\n2,A,0.2,left,,1,2,3\n"));
  for (const char* other : {"2,A,0.2,left,,1,2,3.5\n", "2,A,0.2,right,,1,2,3\n"}) {
    EXPECT_EQ(parsed(kDistances + "1,A,0.1,left,10,1,2,3\n" + other).observations.size(), 2U);
  }
}

TEST(RowsOfDistances, AnAnchorIsGivenInAllRowsOfItsStationOrInNone) {
  const char* const fault = ":3: x, y, z of the anchor are given in some rows of the station and empty in others";
  EXPECT_REFUSED(fault, parsed(kDistances + "1,A,0.1,left,10,1,2,3\n2,A,0.2,left,10,,,\n"));
  EXPECT_REFUSED(fault, parsed(kDistances + "1,A,0.1,left,10,,,\n2,A,0.2,left,10,0,0,0\n"));
  EXPECT_EQ(parsed(kDistances + "1,A,0.1,left,10,1,2,3\n2,A,0.2,right,10,,,\n").observations.size(), 2U);
}

// Several anchors see a configuration at once: each is a configuration at the same joint values.
TEST(RowsOfDistances, FromOtherAnchorsAreOtherConfigurations) {
  const std::string file =
      kDistances + "1,A,0.1,left,1,0,0,0\n1,A,0.1,right,2,,,\n1,B,0.1,right,3,,,\n1,A,0.1,left,4,1,0,0.5\n";
  const Measurements read = parsed(file);
  EXPECT_THAT(read.configurations, ElementsAre("1", "1 from right", "1 from left 1 0 0.5"));
  EXPECT_EQ(read.joint_values, Eigen::RowVector3d(0.1, 0.1, 0.1));
  EXPECT_EQ(read.observations[2].configuration, 1);
  check(read);
  const Measurements again = parsed(measurements_csv(read));
  EXPECT_EQ(again.configurations, read.configurations);
  EXPECT_EQ(without_rows(read, {"1:A"}).observations.size(), 1U);
  EXPECT_THAT(without_rows(read, {"1 from right"}).configurations, ElementsAre("1", "1 from left 1 0 0.5"));
}

TEST(RowsOfDistances, MeansAreThoseOfTheirWeights) {
  Measurements rows = parsed(kDistances + "1,A,0.1,left,1000,,,\n");
  rows.observations.push_back(rows.observations.front());
  rows.coordinates.push_back({.distance = 4.0});
  rows.observations[0].sigma = 1.0;
  rows.observations[1].sigma = 0.5;
  const Measurements mean = averaged(rows);
  EXPECT_DOUBLE_EQ(mean.coordinates.front().distance, (1.0 + 4.0 * 4.0) / 5.0);
  EXPECT_DOUBLE_EQ(mean.observations.front().sigma, 1.0 / std::sqrt(5.0));
}

TEST(Directions, WholePointsAloneAreWholePoints) {
  EXPECT_FALSE(has_single_coordinates(without_rows(parsed(kFile), {"1:B", "2", "3"})));
}

TEST(RowsOfDistances, WrongRowsAreRefused) {
  const auto refused = [](const std::string& row) { return refusal([&] { return parsed(kDistances + row + "\n"); }); };
  EXPECT_THAT(refused("1,A,0.1,left,0,,,"), HasSubstr("is no distance: expected one above 0"));
  EXPECT_THAT(refused("1,A,0.1,left,-5,,,"), HasSubstr("is no distance: expected one above 0"));
  EXPECT_THAT(refused("1,A,0.1,left,7,1,,3"), HasSubstr("y '' is empty"));
  EXPECT_REFUSED("missing columns y, z", parsed("configuration,target,q1,x,distance\n1,A,0.1,2,7\n"));
  EXPECT_REFUSED("distance '' is empty", parsed("configuration,target,q1,distance\n1,A,0.1,\n"));
  Measurements mixed = parsed(kDistances + "1,A,0.1,left,7,,,\n1,B,0.1,left,8,,,\n");
  mixed.observations[1].position.x() = 0.5;
  EXPECT_REFUSED("rows of several anchors", check(mixed));
  mixed.coordinates[1].distance = -1.0;
  EXPECT_REFUSED("a distance of -1, expected one above 0", check(mixed));
}

}  // namespace
}  // namespace kdl_calibration::directions_test
