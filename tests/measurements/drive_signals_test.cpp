#include "measurements/drive_signals.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "kdl_calibration/measurements.hpp"
#include "measurements/training_rows.hpp"
#include "refusal.hpp"
#include "same_measurements.hpp"
#include "support.hpp"

namespace kdl_calibration::drive_signals_test {
namespace {

using Eigen::MatrixXd;
using ::testing::HasSubstr;
using testing::same_bits;

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

TEST(DriveSignals, DirectionsAreThoseOfTheLastMotion) {
  MatrixXd stops(2, 5);
  stops << 0.0, 0.1, 0.1 + 5e-7, -0.2, -0.2,  //
      1.0, 1.0, 0.5, 0.5, 0.7;
  MatrixXd expected(2, 5);
  expected << kUnknown, 1.0, 1.0, -1.0, -1.0,  //
      kUnknown, kUnknown, -1.0, -1.0, 1.0;
  EXPECT_TRUE(same_bits(directions_of_motion(stops), expected));
  EXPECT_EQ(directions_of_motion(MatrixXd(2, 0)).cols(), 0);
}

const std::vector<std::string> kJoints = {"a", "b"};

TEST(DriveSignals, ApproachIsTheMeanOverTheVisitsInTheOrderOfDriving) {
  // Driven 1 -> 2 -> 1 -> 3 -> 2, in a file of another order; two targets of one visit count once.
  const Measurements read = parse_measurements(
      "configuration,repeat,target,a,b,x,y,z,order\n"
      "1,1,A,0,0,0,0,0,1\n"
      "1,1,B,0,0,0,0,0,2\n"
      "1,2,A,0,0,0,0,0,4\n"
      "2,1,A,1,2,0,0,0,3\n"
      "2,2,A,1,2,0,0,0,9\n"
      "3,1,A,3,-1,0,0,0,5\n",
      kJoints);
  MatrixXd expected(2, 3);
  expected << -1.0, 0.0, 1.0,  // to 1 from 2 (its first visit is not known); to 2 from both sides; to 3 from 1
      -1.0, 1.0, -1.0;
  EXPECT_TRUE(same_bits(read.signals.approach, expected));
  EXPECT_TRUE(same_bits(approach_directions(read), expected));
  const Measurements last = subset(read, [](const Observation& o) { return o.configuration == 2; });
  EXPECT_TRUE(same_bits(last.signals.approach, expected.col(2))) << "where the arm came from stays";
}

TEST(DriveSignals, NothingIsKnownWithoutOrderAndTorques) {
  const Measurements read = parse_measurements("configuration,target,a,b,x,y,z\n1,A,0,0,0,0,0\n", kJoints);
  EXPECT_EQ(read.signals.approach.size(), 0);
  EXPECT_EQ(read.signals.torques.size(), 0);
}

TEST(DriveSignals, TorquesAreMeansOverTheRowsOfAConfigurationWhereverTheyStand) {
  const Measurements read = parse_measurements(
      "configuration,target,a,b,x,y,z,tau_b[Nm]\n"
      "1,A,0,0,0,0,0,10\n"
      "2,A,1,0,0,0,0,\n"
      "1,B,0,0,0,0,0,13\n"
      "3,A,2,0,0,0,0,-4\n",
      kJoints);
  MatrixXd expected(2, 3);
  expected << kUnknown, kUnknown, kUnknown, 11.5, kUnknown, -4.0;
  EXPECT_TRUE(same_bits(read.signals.torques, expected));
  const Measurements again = parse_measurements(measurements_csv(read), kJoints);
  EXPECT_TRUE(same_bits(again.signals.torques, expected)) << measurements_csv(read);
  EXPECT_THAT(measurements_csv(read), ::testing::Not(HasSubstr("tau_a")));
}

TEST(DriveSignals, CircumstancesAreMeansOverTheRowsOfAConfiguration) {
  const Measurements read = parse_measurements(
      "configuration,target,a,b,x,y,z,payload[kg],Temperature (°C)\n"
      "1,A,0,0,1,2,3,80,20\n1,B,0,0,1,2,4,80,21\n2,A,1,0,1,2,3,,24.5\n3,A,1,1,1,2,3,0,\n",
      kJoints);
  MatrixXd expected(2, 3);
  expected << 20.5, 24.5, kUnknown, 80.0, kUnknown, 0.0;
  EXPECT_TRUE(same_bits(read.signals.circumstances, expected));
  EXPECT_TRUE(same_bits(parse_measurements(measurements_csv(read), kJoints).signals.circumstances, expected));
  EXPECT_TRUE(
      same_bits(columns(read.signals, {2, 0}).circumstances, (MatrixXd(2, 2) << kUnknown, 20.5, 0.0, 80.0).finished()));
  EXPECT_TRUE(same_bits(column(read.signals, 1).circumstances, Eigen::Vector2d(24.5, kUnknown)));
  EXPECT_TRUE(same_bits(side_by_side(read.signals, read.signals).circumstances, expected.replicate(1, 2)));
  const CircumstanceRange range = range_of(read.signals, Circumstance::payload, {true, true, true});
  EXPECT_EQ(range.mean, 40.0);
  EXPECT_EQ(range.lower, 0.0);
  EXPECT_EQ(range.upper, 80.0);
  EXPECT_EQ(range_of(read.signals, Circumstance::temperature, {false, true, true}).mean, 24.5);
  EXPECT_TRUE(std::isnan(range_of({}, Circumstance::temperature, {}).mean));
  EXPECT_TRUE(is_stated(read.signals, Circumstance::temperature));
  EXPECT_FALSE(is_stated({}, Circumstance::temperature));
  const Measurements cold =
      parse_measurements("configuration,target,a,b,x,y,z,temperature\n1,A,0,0,1,2,3,-5\n", kJoints);
  EXPECT_FALSE(is_stated(cold.signals, Circumstance::payload));
  EXPECT_THAT(measurements_csv(cold), ::testing::AllOf(HasSubstr(",temperature[degC]\n"), HasSubstr(",-5\n")));
  EXPECT_REFUSED("unit", parse_measurements("configuration,target,a,b,x,y,z,temperature[K]\n", kJoints));
}

TEST(DriveSignals, TemperaturesOfLinksAreMeansOverTheRowsOfAConfiguration) {
  const Measurements read = parse_measurements(
      "configuration;target;a;b;x;y;z;temperature_arm[degC];temperature;Temperature_fore,arm (°C);temperature_none\n"
      "1;A;0;0;1;2;3;30;20;-1;\n1;B;0;0;1;2;4;31;20;-2;\n2;A;1;0;1;2;3;25;21;3;\n3;A;1;1;1;2;3;24;22;5;\n",
      kJoints);
  EXPECT_THAT(read.signals.links, ::testing::ElementsAre("arm", "fore,arm", "none"));
  MatrixXd expected(3, 3);
  expected << 30.5, 25.0, 24.0, -1.5, 3.0, 5.0, kUnknown, kUnknown, kUnknown;
  EXPECT_TRUE(same_bits(read.signals.link_temperatures, expected));
  EXPECT_TRUE(same_bits(read.signals.circumstances.row(0), Eigen::RowVector3d(20.0, 21.0, 22.0)));
  const std::string text = measurements_csv(read);
  EXPECT_THAT(text, HasSubstr(",temperature[degC],temperature_arm[degC],\"temperature_fore,arm[degC]\"\n"));
  const Measurements again = parse_measurements(text, kJoints);
  EXPECT_THAT(again.signals.links, ::testing::ElementsAre("arm", "fore,arm"));
  EXPECT_TRUE(same_bits(again.signals.link_temperatures, expected.topRows(2)));
  EXPECT_TRUE(same_bits(columns(read.signals, {2, 0}).link_temperatures, expected(Eigen::all, {2, 0})));
  EXPECT_TRUE(same_bits(column(read.signals, 1).link_temperatures, expected.col(1)));
  EXPECT_EQ(column(read.signals, 1).links, read.signals.links);
  EXPECT_TRUE(same_bits(side_by_side(read.signals, read.signals).link_temperatures, expected.replicate(1, 2)));
  const Measurements test = subset(read, [](const Observation& o) { return o.configuration == 1; });
  EXPECT_TRUE(same_bits(test.signals.link_temperatures, expected.col(1)));
  EXPECT_TRUE(same_bits(averaged(read).signals.link_temperatures, expected));
  const CircumstanceRange range = range_of_link(read.signals, 1, {true, true, false});
  EXPECT_EQ(range.mean, 0.75);
  EXPECT_EQ(range.lower, -1.5);
  EXPECT_EQ(range.upper, 3.0);
  EXPECT_EQ(row_of_link(read.signals, {"base", "fore,arm"}), 1);
  EXPECT_EQ(row_of_link(read.signals, {"none"}), std::nullopt) << "no row states it";
  EXPECT_TRUE(has_temperature(read.signals, {"none"})) << "that of the arm";
}

TEST(DriveSignals, OfLinksSideBySideThoseThatBothHave) {
  DriveSignals first{.approach = {}, .torques = {}};
  first.links = {"a", "b", "c"};
  first.link_temperatures = (MatrixXd(3, 1) << 1, 2, 3).finished();
  DriveSignals second{.approach = {}, .torques = {}};
  second.links = {"c", "d", "a"};
  second.link_temperatures = (MatrixXd(3, 2) << 4, 5, 6, 7, 8, 9).finished();
  const DriveSignals both = side_by_side(first, second);
  EXPECT_THAT(both.links, ::testing::ElementsAre("a", "c"));
  EXPECT_TRUE(same_bits(both.link_temperatures, (MatrixXd(2, 3) << 1, 8, 9, 3, 4, 5).finished()));
  EXPECT_TRUE(side_by_side(first, {}).links.empty());
  EXPECT_EQ(side_by_side(first, {}).link_temperatures.size(), 0);
}

TEST(DriveSignals, TemperaturesAreThoseOfLinksOfTheChain) {
  const Robot robot = parse_robot(testing::kOddArm);
  EXPECT_THAT(link_names(robot), ::testing::ElementsAre("world", "a", "b", "bracket", "c", "d", "e", "tool"));
  EXPECT_THAT(robot.joints[2].links, ::testing::ElementsAre("b", "bracket")) << "the plate is fixed";
  EXPECT_THAT(robot.joints[0].links, ::testing::ElementsAre("world"));
  const auto with = [&](const std::string& names) {
    const std::string numbers = std::count(names.begin(), names.end(), ',') == 0 ? "20" : "20,21";
    return parse_measurements(robot,
                              "configuration,target,turn,slide,skew,elbow,wrist,x,y,z," + names +
                                  "\n1,A,0.1,0.1,0.1,0.1,0.1,1,2,3," + numbers + "\n",
                              nullptr, "m.csv");
  };
  EXPECT_THAT(with("temperature_bracket,temperature_tool").signals.links, ::testing::ElementsAre("bracket", "tool"));
  EXPECT_THAT(with("TEMPERATURE_Bracket,temperature_D").signals.links, ::testing::ElementsAre("bracket", "d"));
  EXPECT_EQ(
      testing::refusal([&] { with("temperature_f"); }),
      "m.csv:1: temperature of 'f', which is no link of the chain: expected some of world, a, b, bracket, c, d, e, "
      "tool");
  EXPECT_EQ(testing::refusal([&] { with("temperature_bracket,temperature_b"); }),
            "m.csv:1: temperatures of 'bracket' and 'b', which are fixed to each other: expected that of one of them");
  EXPECT_REFUSED("repeats 'temperature_a'", with("temperature_a,temperature_A"));
  EXPECT_REFUSED("unknown unit 'K' in column 'temperature_a[K]': expected [degC]", with("temperature_a[K]"));
  EXPECT_REFUSED("unknown column 'temperature_'", with("temperature_"));
}

TEST(DriveSignals, BehindAConventionTorquesDoTheSameWork) {
  JointConvention convention{.name = "coupled", .controller_joints = {"J1", "J2"}, .urdf_joints = kJoints};
  convention.matrix.resize(2, 2);
  convention.matrix << -2.0, 0.0, 1.0, 1.0;
  convention.offset = Eigen::Vector2d(0.3, -0.1);
  const Measurements read = parse_measurements(
      "configuration,target,J1,J2,x,y,z,tau_J1,tau_J2\n1,A,0.1,0.2,0,0,0,7,-3\n", kJoints, &convention);
  const Eigen::Vector2d stated(7.0, -3.0);
  for (const Eigen::Vector2d& motion : {Eigen::Vector2d(1.0, 0.0), Eigen::Vector2d(0.0, 1.0)}) {
    EXPECT_NEAR(read.signals.torques.col(0).dot(convention.matrix * motion), stated.dot(motion), 1e-12);
  }
  const Measurements one =
      parse_measurements("configuration,target,J1,J2,x,y,z,tau_J2\n1,A,0.1,0.2,0,0,0,-3\n", kJoints, &convention);
  EXPECT_TRUE(std::isnan(one.signals.torques(0, 0))) << "that of a follows from both";
  EXPECT_DOUBLE_EQ(one.signals.torques(1, 0), -3.0);
}

TEST(DriveSignals, JoinedOnesStandSideBySideWhereBothHaveThem) {
  DriveSignals first{.approach = MatrixXd::Constant(2, 3, 1.0), .torques = MatrixXd::Constant(2, 3, 5.0)};
  DriveSignals second{.approach = MatrixXd::Constant(2, 1, -1.0), .torques = {}};
  const DriveSignals both = side_by_side(first, second);
  ASSERT_EQ(both.approach.cols(), 4);
  EXPECT_EQ(both.approach(0, 2), 1.0);
  EXPECT_EQ(both.approach(1, 3), -1.0);
  EXPECT_EQ(both.torques.size(), 0);
}

TEST(DriveSignals, MotionsOfAMicronAndLessAreNone) {
  for (const double sign : {1.0, -1.0}) {
    const Eigen::RowVector4d stops = sign * Eigen::RowVector4d(0.0, 1.0, 1.0 - 0.9e-6, 1.0 - 2.1e-6);
    const MatrixXd expected = sign * Eigen::RowVector4d(kUnknown, 1.0, 1.0, -1.0);
    EXPECT_TRUE(same_bits(directions_of_motion(stops), expected)) << sign;
  }
}

TEST(DriveSignals, AreTakenByConfigurationAndStayEmptyWhereNothingIsKnown) {
  const DriveSignals signals{.approach = (MatrixXd(2, 3) << 1, -1, 1, -1, 0, 1).finished(),
                             .torques = (MatrixXd(2, 3) << 1, 2, 3, 4, 5, kUnknown).finished()};
  const DriveSignals two = columns(signals, {2, 0});
  EXPECT_TRUE(same_bits(two.approach, (MatrixXd(2, 2) << 1, 1, 1, -1).finished()));
  EXPECT_TRUE(same_bits(two.torques, (MatrixXd(2, 2) << 3, 1, kUnknown, 4).finished()));
  EXPECT_TRUE(same_bits(column(signals, 1).approach, Eigen::Vector2d(-1, 0)));
  EXPECT_TRUE(same_bits(column(signals, 1).torques, Eigen::Vector2d(2, 5)));
  const DriveSignals one{.approach = {}, .torques = MatrixXd::Constant(1, 1, 7.0)};
  EXPECT_TRUE(same_bits(columns(one, {0}).torques, one.torques));
  EXPECT_TRUE(same_bits(column(one, 0).torques, one.torques));
  EXPECT_TRUE(same_bits(side_by_side(one, one).torques, MatrixXd::Constant(1, 2, 7.0)));
  EXPECT_TRUE(same_bits(columns(one, {0, 0}).approach, MatrixXd()));
  EXPECT_TRUE(same_bits(column(one, 0).approach, MatrixXd()));
  EXPECT_TRUE(has_torques(one, 0));
  EXPECT_FALSE(has_torques({}, 0));
}

TEST(DriveSignals, OfAnotherSizeAreRefused) {
  Measurements read = parse_measurements("configuration,target,a,b,x,y,z\n1,A,0,0,0,0,0\n", kJoints);
  read.signals.torques = MatrixXd::Zero(2, 2);
  EXPECT_REFUSED("2 x 2 torques, expected 2 x 1", averaged(read));
  read.signals.torques = MatrixXd::Zero(3, 1);
  EXPECT_REFUSED("3 x 1 torques, expected 2 x 1", averaged(read));
  read.signals.torques.resize(0, 0);
  read.signals.approach = MatrixXd::Constant(2, 1, std::numeric_limits<double>::infinity());
  EXPECT_REFUSED("directions of approach that are infinite", averaged(read));
  read.signals.approach.resize(0, 0);
  read.signals.circumstances = MatrixXd::Zero(1, 1);
  EXPECT_REFUSED("1 x 1 circumstances, expected 2 x 1", averaged(read));
  read.signals.circumstances = Eigen::Vector2d(20.0, -1.0);
  EXPECT_REFUSED("an impossible payload, expected 0 to 100000", averaged(read));
  read.signals.circumstances = Eigen::Vector2d(-300.0, 1.0);
  EXPECT_REFUSED("an impossible temperature, expected -273.15 to 1000", averaged(read));
  read.signals.circumstances.resize(0, 0);
  read.signals.links = {"arm"};
  EXPECT_REFUSED("0 x 0 temperatures of links, expected 1 x 1, one of each link for each configuration",
                 averaged(read));
  read.signals.link_temperatures = MatrixXd::Constant(1, 2, 20.0);
  EXPECT_REFUSED("1 x 2 temperatures of links, expected 1 x 1", averaged(read));
  read.signals.link_temperatures = MatrixXd::Constant(1, 1, 2000.0);
  EXPECT_REFUSED("an impossible temperature of 'arm', expected -273.15 to 1000", averaged(read));
  read.signals.links = {"arm", "arm"};
  read.signals.link_temperatures = MatrixXd::Constant(2, 1, 20.0);
  EXPECT_REFUSED("temperatures of 'arm' are there twice", averaged(read));
}

}  // namespace
}  // namespace kdl_calibration::drive_signals_test
