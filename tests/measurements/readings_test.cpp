#include "measurements/readings.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "measurements/measurements_check.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "refusal.hpp"
#include "same_measurements.hpp"
#include "support.hpp"

namespace kdl_calibration::readings_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ::testing::ElementsAre;
using testing::expect_same;
using ::testing::HasSubstr;
using testing::length_of;
using testing::one_of_each;
using testing::orientation_of;
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

Matrix3d directions_of(const Observation& row) { return directions(row.reading, row.position()); }

TEST(RowsOfCoordinates, BlankCoordinatesAndLinesAreReadAndWrittenBack) {
  const Measurements read = parsed(kFile);
  EXPECT_THAT(read.stations, ElementsAre("W"));
  const Vector3d n(0.6, 0.0, 0.8);
  ASSERT_EQ(read.observations.size(), 4U);
  EXPECT_TRUE(std::holds_alternative<Point>(read.observations[0].reading));
  EXPECT_EQ(directions_of(read.observations[0]), Matrix3d::Identity());
  EXPECT_EQ(directions_of(read.observations[1]), Matrix3d(Vector3d(0, 1, 1).asDiagonal()));
  EXPECT_EQ(read.observations[1].position(), Vector3d(0, 5, 6));
  EXPECT_EQ(directions_of(read.observations[2]), Matrix3d(Vector3d::UnitZ().asDiagonal()));
  EXPECT_TRUE(directions_of(read.observations[3]).isApprox(n * n.transpose(), 1e-15));
  EXPECT_TRUE(read.observations[3].position().isApprox(-0.5 * n, 1e-15));
  const Measurements again = parsed(measurements_csv(read));
  for (std::size_t row = 0; row < 4; ++row) {
    EXPECT_TRUE(directions_of(again.observations[row]).isApprox(directions_of(read.observations[row]), 1e-15));
    EXPECT_TRUE(again.observations[row].position().isApprox(read.observations[row].position(), 1e-15));
  }
  EXPECT_EQ(dimension(read), 3 + 2 + 1 + 1);
}

TEST(RowsOfCoordinates, FilesOfWholePointsHaveNone) {
  const Measurements read = parsed(kHeader + "1,train,A,0.1,1,2,3,,,,\n");
  EXPECT_FALSE(has_single_coordinates(read));
  EXPECT_EQ(read.stations, std::vector<std::string>{"W"});
}

TEST(RowsOfCoordinates, LinesAloneNeedNoPoints) {
  const Measurements read = parsed("configuration,target,q1,n_x,n_y,n_z,along\n1,A,0.1,0,0,-1,2\n");
  EXPECT_EQ(read.observations.front().position(), Vector3d(0, 0, -2));
  EXPECT_REFUSED("missing column n_z", parsed("configuration,target,q1,n_x,n_y,along\n1,A,0.1,0,0,2\n"));
  EXPECT_REFUSED("missing columns x, y, z, along", parsed("configuration,target,q1,n_x,n_y,n_z\n1,A,0.1,0,0,1\n"));
}

TEST(RowsOfCoordinates, WrongRowsAreRefused) {
  EXPECT_THAT(refusal_of("1,train,A,0.1,,,,,,,"), HasSubstr(":2: x[m] '' is empty: expected a number"));
  EXPECT_THAT(refusal_of("1,train,A,0.1,1,,,1,0,0,5"), HasSubstr("expected one of the two"));
  EXPECT_THAT(refusal_of("1,train,A,0.1,,,,1,,0,5"), HasSubstr("n_y '' is empty"));
  EXPECT_THAT(refusal_of("1,train,A,0.1,,,,1,0,0,"), HasSubstr("along[mm] '' is empty"));
  EXPECT_THAT(refusal_of("1,train,A,0.1,,,,1,0,0.1,5"),
              HasSubstr("the norm of n_x, n_y, n_z is 1.005: expected a unit vector"));
  Measurements wrong = parsed(kFile);
  std::get<Coordinates>(wrong.observations[1].reading).normal *= 2.0;
  EXPECT_REFUSED("observation 1: its directions are none, expected 1 or 2 coordinates and a unit vector", check(wrong));
}

TEST(RowsOfCoordinates, OnePointMayHaveSeveralButEachOnce) {
  const std::string rows = "1,train,A,0.1,1,,,,,,\n1,train,A,0.1,,2,,,,,\n1,train,A,0.1,,,3,,,,\n";
  const Measurements point = averaged(parsed(kHeader + rows));
  ASSERT_EQ(point.observations.size(), 1U);
  EXPECT_TRUE(point.observations.front().position().isApprox(Vector3d(1, 2, 3), 1e-15));
  EXPECT_TRUE(std::holds_alternative<Point>(point.observations.front().reading));
  EXPECT_REFUSED(":5: configuration '1', repeat 1, target 'A' is measured twice, before in line 3",
                 parsed(kHeader + rows + "1,train,A,0.1,,7,,,,,\n"));
}

// Twice x = 1 and 3, once 0.6 x + 0.8 y = 2: x by least squares is 2, and the line gives y = 1.
TEST(RowsOfCoordinates, MeansAreThoseOfLeastSquares) {
  Measurements rows = parsed(kHeader + "1,train,A,0.1,1,,,,,,\n1,train,A,0.1,,,,0.6,0.8,0,2000\n");
  rows.observations.push_back(rows.observations.front());
  rows.observations.back().position().x() = 3.0;
  const Measurements mean = averaged(rows);
  EXPECT_TRUE(mean.observations.front().position().isApprox(Vector3d(2, 1, 0), 1e-12));
  EXPECT_TRUE(directions_of(mean.observations.front()).isApprox(Matrix3d(Vector3d(1, 1, 0).asDiagonal()), 1e-12));
}

// Weights of 1/9 and 1/16 make 25/144.
TEST(RowsOfCoordinates, MeansOfStatedSigmasStateTheirOwn) {
  Measurements rows = parsed(kHeader + "1,train,A,0.1,1,,,,,,\n");
  rows.observations.push_back(rows.observations.front());
  EXPECT_EQ(averaged(rows).observations.front().sigma, 0.0);
  rows.observations[0].sigma = 3e-5;
  rows.observations[1].sigma = 4e-5;
  EXPECT_NEAR(averaged(rows).observations.front().sigma, 2.4e-5, 1e-18);
}

// Beside rows of coordinates the mean of whole points is the same as in a file without them.
TEST(RowsOfCoordinates, LeaveTheMeansOfWholePointsAsTheyAre) {
  Measurements rows = parsed(kHeader + "1,train,A,0.1,1,2,3,,,,\n2,train,A,0.1,,5,6,,,,\n");
  rows.observations.push_back(rows.observations.front());
  rows.observations.back().position().x() = 3.0;
  rows.observations.front().sigma = 1e-5;
  rows.observations.back().sigma = 9e-5;
  const Observation mean = averaged(rows).observations.front();
  EXPECT_TRUE(mean.position().isApprox(Vector3d(2, 2, 3), 1e-15));
  EXPECT_NEAR(mean.sigma, std::sqrt(82.0) / 2.0 * 1e-5, 1e-18);
}

TEST(RowsOfCoordinates, TwoThatAreAlongNoAxisCannotBeWritten) {
  Measurements rows = parsed(kFile);
  rows.observations[1].reading =
      Coordinates{.position = Vector3d::Zero(), .normal = Vector3d(0.6, 0.8, 0.0), .count = 2};
  EXPECT_REFUSED("observation 1 has two coordinates that are not along x, y and z", measurements_csv(rows));
}

TEST(RowsOfCoordinates, StayWithTheirRows) {
  const Measurements all = parsed(kFile);
  const Measurements last = subset(all, [](const Observation& o) { return o.configuration > 0; });
  ASSERT_EQ(last.observations.size(), 2U);
  EXPECT_EQ(directions_of(last.observations[1]), directions_of(all.observations[3]));
  const TrainingRows training(all);
  ASSERT_EQ((*training).observations.size(), 3U);
  EXPECT_EQ(directions_of((*training).observations[1]), directions_of(all.observations[1]));
  EXPECT_EQ(directions_of((*training).observations[2]), directions_of(all.observations[3]));
  expect_same(rows_of_station(all, 0).measurements.observations, all.observations);
  const Measurements whole = subset(all, [](const Observation& o) { return o.configuration == 0 && o.target == 0; });
  const Measurements both = joined(whole, all);
  ASSERT_EQ(both.observations.size(), 5U);
  EXPECT_EQ(directions_of(both.observations[0]), Matrix3d::Identity());
  EXPECT_EQ(directions_of(both.observations[4]), directions_of(all.observations[3]));
}

const std::string kDistances = "configuration,target,q1,anchor,distance[mm],x,y,z\n";

TEST(RowsOfDistances, AreReadAndWrittenBack) {
  const Measurements read = parsed(kDistances + "1,A,0.1,left,1500,,,\n1,B,0.1,left,1600,,,\n2,A,0.2,right,10,1,2,3\n");
  EXPECT_THAT(read.stations, ElementsAre("left", "right"));
  EXPECT_THAT(read.configurations, ElementsAre("1", "2"));
  EXPECT_EQ(length_of(read.observations[1]), 1.6);
  EXPECT_EQ(read.observations[1].position(), Vector3d::Zero());
  EXPECT_EQ(read.observations[2].position(), Vector3d(1, 2, 3));
  EXPECT_EQ(dimension(read), 3);
  const Measurements again = parsed(measurements_csv(read));
  expect_same(again.observations, read.observations);
  EXPECT_EQ(again.stations, read.stations);
  const Measurements alone = parsed("configuration,target,q1,distance\n1,A,0.1,1.5\n");
  EXPECT_THAT(alone.stations, ElementsAre("W"));
  EXPECT_EQ(length_of(alone.observations.front()), 1.5);
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
  std::get<Distance>(rows.observations.back().reading).length = 4.0;
  rows.observations[0].sigma = 1.0;
  rows.observations[1].sigma = 0.5;
  const Measurements mean = averaged(rows);
  EXPECT_DOUBLE_EQ(length_of(mean.observations.front()), (1.0 + 4.0 * 4.0) / 5.0);
  EXPECT_DOUBLE_EQ(mean.observations.front().sigma, 1.0 / std::sqrt(5.0));
}

TEST(RowsOfCoordinates, WholePointsAloneAreWholePoints) {
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
  mixed.observations[1].position().x() = 0.5;
  EXPECT_REFUSED("rows of several anchors", check(mixed));
  std::get<Distance>(mixed.observations[1].reading).length = -1.0;
  EXPECT_REFUSED("a distance of -1, expected one above 0", check(mixed));
}

// ---- All kinds -----------------------------------------------------------------------------------------------------

using Rows = std::vector<Observation>;

TEST(Readings, SubsetKeepsAllOfARowButTheNumberOfItsConfiguration) {
  const Measurements all = one_of_each();
  const Measurements kept = subset(all, [](const Observation& o) { return o.configuration != 1; });
  Rows expected = {all.observations[0], all.observations[1], all.observations[4]};
  expected[2].configuration = 1;
  expect_same(kept.observations, expected);
  expect_same(subset(all, [](const Observation&) { return true; }), all);
}

TEST(Readings, JoinedPartsAreTheWhole) {
  const Measurements all = one_of_each();
  const Measurements first = subset(all, [](const Observation& o) { return o.configuration == 0; });
  const Measurements second = subset(all, [](const Observation& o) { return o.configuration > 0; });
  expect_same(joined(first, second).observations, all.observations);
  const Measurements without = joined(first, without_order(second));
  expect_same(without.observations, without_order(all).observations);
}

TEST(Readings, MeansOfSingleRowsAreTheRowsInRepeatOne) {
  const Measurements all = one_of_each();
  Rows expected = all.observations;
  for (Observation& row : expected) {
    row.repeat = 1;
  }
  Measurements shuffled = all;
  std::swap(shuffled.observations[0], shuffled.observations[4]);
  std::swap(shuffled.observations[2], shuffled.observations[3]);
  expect_same(averaged(shuffled).observations, expected);
}

// The mean of two equal rows is that row with its sigma / sqrt(2). The rest is that of the first.
TEST(Readings, MeansOfEqualRowsAreTheRow) {
  const Measurements all = one_of_each();
  Measurements twice = all;
  for (Observation row : all.observations) {
    row.repeat += 20;
    row.order = *row.order + 1000;
    twice.observations.push_back(row);
  }
  Rows means = averaged(twice).observations;
  ASSERT_EQ(means.size(), all.observations.size());
  for (std::size_t i = 0; i < means.size(); ++i) {
    Observation expected = all.observations[i];
    EXPECT_NEAR(means[i].sigma, expected.sigma / std::sqrt(2.0), 1e-18) << i;
    means[i].sigma = expected.sigma;
    expected.repeat = 1;
    ASSERT_EQ(means[i].reading.index(), expected.reading.index()) << i;
    EXPECT_TRUE(directions_of(means[i]).isApprox(directions_of(expected), 1e-14)) << i;
    EXPECT_TRUE(means[i].position().isApprox(expected.position(), 1e-14)) << i;
    if (has_orientation(expected)) {
      EXPECT_TRUE(orientation_of(means[i]).isApprox(orientation_of(expected), 1e-14));
    }
    if (is_distance(expected)) {
      EXPECT_DOUBLE_EQ(length_of(means[i]), length_of(expected));
    }
    means[i].reading = expected.reading;
    expect_same(means[i], expected);
  }
}

TEST(Readings, RowsOfAStationKeepAllButItsNumber) {
  const Measurements all = one_of_each();
  const StationRows right = rows_of_station(all, 1);
  EXPECT_THAT(right.rows, ElementsAre(0, 1));
  Rows expected = {all.observations[0], all.observations[1]};
  expected[0].station = expected[1].station = 0;
  expect_same(right.measurements.observations, expected);
  EXPECT_EQ(right.measurements.joint_values, all.joint_values);
  const StationRows left = rows_of_station(all, 0);
  EXPECT_THAT(left.rows, ElementsAre(2, 3, 4));
  expect_same(left.measurements.observations, Rows(all.observations.begin() + 2, all.observations.end()));
}

TEST(Readings, TrainingRowsAreTheRowsThemselves) {
  const Measurements all = one_of_each();
  const TrainingRows training(all);
  expect_same((*training).observations, Rows(all.observations.begin() + 2, all.observations.end()));
}

TEST(Readings, OtherKindsStayAsTheyAreWithoutOrientationsOrderOrCoordinates) {
  const Measurements all = one_of_each();
  Rows expected = all.observations;
  expected[0].reading = Point{{1, 2, 3}};
  expect_same(without_orientations(all).observations, expected);
  expected = all.observations;
  for (Observation& row : expected) {
    row.order.reset();
  }
  expect_same(without_order(all).observations, expected);
  const Measurements whole = whole_points(all);
  expect_same(whole.observations, {all.observations[0], all.observations[1]});
  EXPECT_THAT(whole.configurations, ElementsAre("p"));
  EXPECT_FALSE(has_single_coordinates(whole));
}

TEST(Readings, AreCounted) {
  const Measurements all = one_of_each();
  EXPECT_EQ(dimension(all), 3 + 3 + 1 + 2 + 1);
  EXPECT_EQ(rows_of_single_coordinates(all), 3U);
  EXPECT_TRUE(has_single_coordinates(all) && has_orientations(all) && has_order(all));
  EXPECT_FALSE(has_orientations(without_orientations(all)));
  EXPECT_FALSE(has_order(without_order(all)));
  Measurements one_without = all;
  one_without.observations[3].order.reset();
  EXPECT_FALSE(has_order(one_without));
  EXPECT_FALSE(has_order(Measurements()));
}

TEST(Readings, OfEachKindAreReadBackFromCsv) {
  const Measurements all = one_of_each();
  Measurements again = parsed(measurements_csv(all));
  ASSERT_EQ(again.observations.size(), 5U);
  // A direction that is not along an axis is normalised once more, and of n and -n one is read.
  Observation& along = again.observations[2];
  EXPECT_TRUE(std::get<Coordinates>(along.reading).normal.isApprox(Vector3d(2, -3, 6) / 7.0, 1e-15));
  EXPECT_TRUE(along.position().isApprox(all.observations[2].position(), 1e-15));
  along.reading = all.observations[2].reading;
  // The labels are numbered by their first appearance.
  EXPECT_THAT(again.targets, ElementsAre("B", "D", "A", "C"));
  EXPECT_THAT(again.stations, ElementsAre("right", "left"));
  for (Observation& row : again.observations) {
    row.target = std::vector<std::int32_t>{1, 3, 0, 2}[static_cast<std::size_t>(row.target)];
    row.station = static_cast<std::int16_t>(1 - row.station);
  }
  EXPECT_EQ(again.configurations, all.configurations);
  EXPECT_EQ(again.joint_values, all.joint_values);
  expect_same(again.observations, all.observations);
}

TEST(Readings, DifferencesAreAlongTheMeasuredDirections) {
  const Measurements all = one_of_each();
  const Vector3d f(0.4, -0.8, 1.3);
  const Vector3d n = Vector3d(2, -3, 6) / 7.0;
  const auto difference = [&](std::size_t row) { return measured_minus_predicted(all.observations[row].reading, f); };
  EXPECT_EQ(difference(0), Vector3d(1, 2, 3) - f);
  EXPECT_EQ(difference(1), Vector3d(4, 5, 6) - f);
  EXPECT_TRUE(difference(2).isApprox(n * (-0.5 - n.dot(f)), 1e-15));
  EXPECT_TRUE(difference(3).isApprox(Vector3d(7.0 - 0.4, 0.0, 9.0 - 1.3), 1e-15));
  const Vector3d arm = f - Vector3d(0.1, 0.2, 0.3);
  EXPECT_TRUE(difference(4).isApprox((1.5 - arm.norm()) * arm.normalized(), 1e-15));
}

// Of a distance this holds where it is the predicted one.
TEST(Readings, DirectionsAreTheDerivativesOfTheDifferences) {
  Measurements all = one_of_each();
  const Vector3d f(0.4, -0.8, 1.3);
  const Vector3d anchor = all.observations[4].position();
  std::get<Distance>(all.observations[4].reading).length = (f - anchor).norm();
  for (const Observation& row : all.observations) {
    const Eigen::MatrixXd J = testing::central_differences(
        3, 1e-5, [&](const Eigen::VectorXd& step) { return measured_minus_predicted(row.reading, f + step); });
    const Matrix3d P = directions(row.reading, f);
    EXPECT_LT((J + P).norm(), 1e-9) << row.reading.index();
    EXPECT_NEAR(P.trace(), dimension(row.reading), 1e-14) << row.reading.index();
  }
}

// ---- Normals -------------------------------------------------------------------------------------------------------

TEST(Normals, OfThreeDigitsAreNormalised) {
  const Vector3d written(0.267, -0.535, 0.802);  // of norm 1.00036
  const Measurements read = parsed(kHeader + "1,train,A,0.1,,,,0.267,-0.535,0.802,250\n");
  const auto& found = std::get<Coordinates>(read.observations.front().reading);
  EXPECT_NEAR(found.normal.norm(), 1.0, 1e-15);
  EXPECT_TRUE(found.normal.isApprox(written.normalized(), 1e-15));
  EXPECT_TRUE(found.position.isApprox(0.25 * written.normalized(), 1e-15));
  EXPECT_EQ(found.count, 1);
  EXPECT_NO_THROW(check(read));
  for (const char* norm : {"0.9991", "1.0009"}) {
    EXPECT_NO_THROW(check(parsed(kHeader + "1,train,A,0.1,,,,0," + norm + ",0,250\n"))) << norm;
  }
  for (const char* norm : {"0.9989", "1.0011"}) {
    EXPECT_THAT(refusal_of(std::string("1,train,A,0.1,,,,0,") + norm + ",0,250"), HasSubstr("expected a unit vector"));
  }
}

TEST(Normals, OfOppositeSignsAreTheSameReading) {
  for (const auto& signs :
       std::vector<std::pair<std::string, std::string>>{{"0.6,0,0.8,-500", "-0.6,0,-0.8,500"},
                                                        {"0.8,-0.6,0,300", "-0.8,0.6,0,-300"},
                                                        {"0.267,0.535,-0.802,7", "-0.267,-0.535,0.802,-7"},
                                                        {"0.577,-0.577,0.577,1", "-0.577,0.577,-0.577,-1"},
                                                        {"0,0,-1,2", "0,0,1,-2"}}) {
    const std::string row = "1,train,A,0.1,,,,";
    const std::string& n = signs.first;
    const std::string& opposite = signs.second;
    const Observation one = parsed(kHeader + row + n + "\n").observations.front();
    const Observation other = parsed(kHeader + row + opposite + "\n").observations.front();
    EXPECT_EQ(std::get<Coordinates>(one.reading).normal, std::get<Coordinates>(other.reading).normal) << n;
    EXPECT_EQ(one.position(), other.position()) << n;
    for (const std::string& again : {n, opposite}) {
      EXPECT_REFUSED(":3: configuration '1', repeat 1, target 'A' is measured twice, before in line 2",
                     parsed(kHeader + row + n + "\n" + row + again + "\n"));
    }
    for (const char* elsewhere : {"1,train,B,0.1,,,,", "2,train,A,0.2,,,,"}) {
      EXPECT_EQ(parsed(kHeader + row + n + "\n" + elsewhere + opposite + "\n").observations.size(), 2U) << n;
    }
  }
}

TEST(Normals, AlongAnAxisAreThatCoordinate) {
  const std::string z = "1,train,A,0.1,,,9,,,,\n";
  EXPECT_REFUSED("is measured twice", parsed(kHeader + z + "1,train,A,0.1,,,,0,0,-1,-9000\n"));
  EXPECT_EQ(parsed(kHeader + z + "1,train,A,0.1,,,,0,1,0,5\n").observations.size(), 2U);
}

TEST(Normals, OfAnotherRepeatAreNoDuplicates) {
  const std::string header = "configuration,repeat,target,q1,n_x,n_y,n_z,along\n";
  const Measurements read = parsed(header + "1,1,A,0.1,0.6,0,0.8,2\n1,2,A,0.1,-0.6,0,-0.8,-3\n");
  const Observation mean = averaged(read).observations.front();
  EXPECT_TRUE(mean.position().isApprox(2.5 * Vector3d(0.6, 0.0, 0.8), 1e-14));
}

TEST(Orientations, StandBesideWholePointsAlone) {
  const std::string header = "configuration,target,q1,x,y,z,distance,qw,qx,qy,qz\n";
  EXPECT_TRUE(has_orientations(parsed(header + "1,A,0.1,1,2,3,,1,0,0,0\n2,A,0.2,1,2,,,,,,\n")));
  for (const char* row : {"1,A,0.1,1,2,,,1,0,0,0\n", "1,A,0.1,,,,1.5,1,0,0,0\n"}) {
    EXPECT_REFUSED(":2: an orientation beside single coordinates or a distance: expected one of the two",
                   parsed(header + row));
  }
}

}  // namespace
}  // namespace kdl_calibration::readings_test
