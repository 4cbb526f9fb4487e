#include "kdl_calibration/measurements.hpp"

#include <gmock/gmock.h>

#include <cmath>
#include <fstream>
#include <limits>
#include <map>

#include "base/random.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "measurements/label_table.hpp"
#include "measurements/readings.hpp"
#include "refusal.hpp"
#include "support.hpp"
#include "urdf_text.hpp"

namespace kdl_calibration::measurements_file_test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::StartsWith;

const std::string kTaken = "nothing was refused";
const std::vector<std::string> kTwo = {"a", "b"};

std::string fault(const std::string& csv, const std::vector<std::string>& joints = kTwo) {
  return testing::refusal([&] { parse_measurements(csv, joints, nullptr, "m.csv"); });
}

/// A turn and a slide, each with one joint that follows it.
Robot coupled_robot(const std::string& turn_limit = "-3:3", const std::string& slide_limit = "-2:3") {
  using testing::urdf::joint;
  using testing::urdf::limit;
  const std::string origin = "<origin xyz='0.6 0.8 0'/>";
  return parse_robot(testing::urdf::robot_of(
      testing::urdf::links({"l0", "l1", "l2", "l3", "l4"}) +
      joint("turn", "revolute", "l0", "l1", origin + limit(turn_limit)) +
      joint("slide", "prismatic", "l1", "l2", origin + limit(slide_limit)) +
      joint("turning", "revolute", "l2", "l3",
            origin + limit("-6:6") + "<mimic joint='turn' multiplier='-0.5' offset='0.25'/>") +
      joint("sliding", "prismatic", "l3", "l4", origin + limit("-1000:1000") + "<mimic joint='slide'/>")));
}

std::string robot_fault(const std::string& columns, const std::string& values, const Robot& robot = coupled_robot()) {
  return testing::refusal([&] {
    parse_measurements(robot, "configuration,target,x,y,z," + columns + "\nc,A,0,0,0," + values + "\n", nullptr,
                       "m.csv");
  });
}

TEST(MeasurementsHeader, ColumnsThatAreNoLengthHaveNoUnit) {
  for (const std::string name : {"configuration", "target", "split", "repeat", "order", "qw", "qx", "qy", "qz"}) {
    EXPECT_EQ(fault(name + "[m],a,b\n"), "m.csv:1: unknown unit 'm' in column '" + name + "[m]': expected none");
  }
  for (const std::string name : {"x", "y", "z", "sigma"}) {
    for (const std::string unit : {"s", "deg", ""}) {
      EXPECT_EQ(fault(name + "[" + unit + "],a,b\n"),
                "m.csv:1: unknown unit '" + unit + "' in column '" + name + "[" + unit + "]': expected [m], [mm]");
    }
  }
}

TEST(MeasurementsHeader, EveryMissingColumnIsNamedWithAllThatAreExpected) {
  const std::string rest =
      ": expected configuration, target, x, y, z (or n_x, n_y, n_z, along; or distance) and the joints a, b, "
      "optionally split, repeat, order, sigma, station, temperature, temperature_<link>, payload, "
      "tau_<joint>, an orientation (qw, qx, qy, qz; rx, ry, rz; roll, pitch, yaw; A, B, C; W, P, R) (an orientation's "
      "columns together)";
  EXPECT_EQ(fault("repeat\n"), "m.csv:1: missing columns configuration, target, x, y, z, a, b" + rest);
  EXPECT_EQ(fault("configuration,target,a,b,x,y,z,qy\n"), "m.csv:1: missing columns qw, qx, qz" + rest);
  EXPECT_EQ(testing::refusal([] { parse_configurations("x\n", kTwo, nullptr, "c.csv"); }),
            "c.csv:1: missing columns a, b: expected the joints a, b, optionally configuration, target, x, y, z, "
            "split, repeat, order, sigma, station, temperature, temperature_<link>, payload, tau_<joint>, an "
            "orientation (qw, "
            "qx, qy, qz; "
            "rx, ry, rz; roll, "
            "pitch, yaw; A, "
            "B, C; W, P, R) (an orientation's columns together)");
}

TEST(MeasurementsHeader, HalfAPairOfBracketsIsPartOfTheName) {
  EXPECT_THAT(fault("x[m,a,b\n"), StartsWith("m.csv:1: unknown column 'x[m'"));
  EXPECT_THAT(fault("x],a,b\n"), StartsWith("m.csv:1: unknown column 'x]'"));
}

TEST(MeasurementsHeader, UnitsFollowTheKindOfTheJoint) {
  const std::string angles = "expected [rad], [deg]";
  const std::string lengths = "expected [m], [mm]";
  for (const std::string joint : {"turn", "turning"}) {
    EXPECT_EQ(robot_fault(joint + "[mm]", "0"), "m.csv:1: unknown unit 'mm' in column '" + joint + "[mm]': " + angles);
  }
  for (const std::string joint : {"slide", "sliding"}) {
    EXPECT_EQ(robot_fault(joint + "[deg]", "0"),
              "m.csv:1: unknown unit 'deg' in column '" + joint + "[deg]': " + lengths);
  }
  EXPECT_EQ(fault("a[x],b\n"), "m.csv:1: unknown unit 'x' in column 'a[x]': expected [rad], [deg], [m], [mm]");
  EXPECT_EQ(robot_fault("tau_turn[N]", "0"), "m.csv:1: unknown unit 'N' in column 'tau_turn[N]': expected [Nm]");
  EXPECT_EQ(robot_fault("tau_slide[Nm]", "0"), "m.csv:1: unknown unit 'Nm' in column 'tau_slide[Nm]': expected [N]");
  EXPECT_EQ(fault("tau_a[kg],b\n"), "m.csv:1: unknown unit 'kg' in column 'tau_a[kg]': expected [Nm], [N]");
}

TEST(MeasurementsHeader, UnitsBehindAConventionAreThoseOfAllJointsThatFollow) {
  // turn = P + M, slide = S + M: P turns, S slides, of M nothing is known.
  JointConvention convention{.name = "c.json", .controller_joints = {"P", "S"}, .urdf_joints = {"turn", "slide"}};
  convention.offset = Eigen::Vector2d::Zero();
  const auto refused = [&](const Eigen::Matrix2d& matrix, const std::string& column) {
    convention.matrix = matrix;
    return testing::refusal([&] { parse_measurements(coupled_robot(), column + ",x,y,z\n", &convention, "m.csv"); });
  };
  const Eigen::Matrix2d apart = Eigen::Matrix2d::Identity();
  EXPECT_THAT(refused(apart, "P[s]"), HasSubstr("'P[s]': expected [rad], [deg]"));
  EXPECT_THAT(refused(apart, "S[s]"), HasSubstr("'S[s]': expected [m], [mm]"));
  const Eigen::Matrix2d crossed = (Eigen::Matrix2d() << 0, 2, -1, 0).finished();
  EXPECT_THAT(refused(crossed, "P[s]"), HasSubstr("'P[s]': expected [m], [mm]"));
  EXPECT_THAT(refused(crossed, "S[s]"), HasSubstr("'S[s]': expected [rad], [deg]"));
  const Eigen::Matrix2d mixed = (Eigen::Matrix2d() << 1, 1, 0, 1).finished();
  EXPECT_THAT(refused(mixed, "P[s]"), HasSubstr("'P[s]': expected [rad], [deg]"));
  EXPECT_THAT(refused(mixed, "S[s]"), HasSubstr("'S[s]': expected [rad], [deg], [m], [mm]"));
  const Eigen::Matrix2d lower = (Eigen::Matrix2d() << 1, 0, 1, 1).finished();
  EXPECT_THAT(refused(lower, "P[s]"), HasSubstr("'P[s]': expected [rad], [deg], [m], [mm]"));
  EXPECT_THAT(refused(lower, "S[s]"), HasSubstr("'S[s]': expected [m], [mm]"));
}

TEST(MeasurementsHeader, AJointMayBeNamedLikeTheTorqueOfAnother) {
  const Measurements m = parse_measurements("configuration,target,a,tau_a,x,y,z\nc,A,1,2,0,0,0\n", {"a", "tau_a"});
  EXPECT_EQ(m.joint_values, Eigen::Vector2d(1, 2));
  EXPECT_EQ(m.signals.torques.size(), 0);
}

TEST(MeasurementsHeader, TorquesKeepTheirValueInBothUnits) {
  const Measurements m =
      parse_measurements("configuration,target,a,b,x,y,z,tau_a[N],tau_b[Nm]\nc,A,1,2,0,0,0,7,-9\n", kTwo);
  EXPECT_EQ(m.signals.torques, Eigen::Vector2d(7, -9));
}

TEST(MissingUnits, AnglesAreDoubtedBeyondTwoTurnsOrTwiceTheWidestLimit) {
  const std::string columns = "turn,slide";
  const Robot far = coupled_robot("-3:3", "-40:40");
  EXPECT_EQ(robot_fault(columns, "12.56,0", far), kTaken);
  EXPECT_THAT(robot_fault(columns, "12.57,0", far), HasSubstr("'turn' up to 12.57 without a unit are no radians"));
  for (const std::string limit : {"-9:4", "-4:9"}) {
    const Robot wide = coupled_robot(limit);
    EXPECT_EQ(robot_fault(columns, "-18,0", wide), kTaken) << limit;
    EXPECT_THAT(robot_fault(columns, "-18.01,0", wide), HasSubstr("degrees? write turn[deg] (or [rad])")) << limit;
  }
}

TEST(MissingUnits, LengthsAreDoubtedBeyondTwentyTimesTheReach) {
  // Four origins of a metre, a tool of a metre, the slides.
  const auto refused = [](const std::string& slide_limit, const std::string& value) {
    return robot_fault("turn,slide", "0," + value, coupled_robot("-3:3", slide_limit));
  };
  const double wide = 20.0 * (1.0 + 4.0 + 3.0 + 1000.0);  // the follower's own limits are a kilometre
  for (const std::string limit : {"-2:3", "-3:2"}) {
    EXPECT_EQ(refused(limit, std::to_string(wide)), kTaken) << limit;
    EXPECT_THAT(refused(limit, std::to_string(wide + 0.01)), HasSubstr("are no metres: millimetres? write slide[mm]"))
        << limit;
  }
  const double narrow = wide - 20.0 * 2.0;  // a slide counts a metre at least
  EXPECT_EQ(refused("-0.2:0.3", std::to_string(narrow)), kTaken);
  EXPECT_THAT(refused("-0.2:0.3", std::to_string(narrow + 0.01)), HasSubstr("are no metres"));
}

TEST(MissingUnits, PointsAreDoubtedAlongEachAxisByItself) {
  // One joint that turns, on an arm of a metre: lengths up to 40 m.
  const Robot arm = parse_robot(testing::urdf::serial({{"continuous", "<origin xyz='0 0 1'/>"}}));
  const auto refused = [&](const std::string& header, const Eigen::Vector3d& first, const Eigen::Vector3d& second) {
    const auto row = [](const Eigen::Vector3d& p) {
      return std::to_string(p.x()) + "," + std::to_string(p.y()) + "," + std::to_string(p.z()) + "\n";
    };
    return testing::refusal([&] {
      parse_measurements(arm, "configuration,target,j1," + header + "\nc,A,0," + row(first) + "c,B,0," + row(second) +
                                  "d,B,1,0,0,0\n");
    });
  };
  for (int axis = 0; axis < 3; ++axis) {
    const std::string name(1, "xyz"[axis]);
    const Eigen::Vector3d unit = Eigen::Vector3d::Unit(axis);
    EXPECT_EQ(refused("x,y,z", 15.0 * unit, -25.0 * unit), kTaken) << name;
    EXPECT_THAT(refused("x,y,z", 15.6 * unit, -25.0 * unit),
                HasSubstr("points 41 m apart along " + name +
                          " without a unit are beyond this robot: millimetres? "
                          "write " +
                          name + "[mm] (or [m])"))
        << name;
    std::string stated = "x,y,z";
    stated.insert(stated.find(name) + 1, "[m]");
    EXPECT_EQ(refused(stated, 1000.0 * unit, -1000.0 * unit), kTaken) << stated;
    EXPECT_THAT(refused(stated, Eigen::Vector3d::Constant(100.0), Eigen::Vector3d::Zero()),
                HasSubstr(axis == 0 ? "along y" : "along x"))
        << stated;
  }
}

TEST(MissingUnits, AreLookedForInEveryConfigurationAndEveryJoint) {
  const std::string header = "configuration,target,x,y,z,turn,slide\n";
  const auto refused = [&](const std::string& second) {
    return testing::refusal(
        [&] { parse_measurements(coupled_robot(), header + "c,A,0,0,0,0,0\nd,A,0,0,0," + second + "\n"); });
  };
  EXPECT_THAT(refused("13,0"), HasSubstr("'turn' up to 13"));
  EXPECT_THAT(refused("0,30000"), HasSubstr("'slide' up to 30000"));
}

TEST(MissingUnits, AreNoneWhereTheyAreStatedOrTheKindIsNotKnown) {
  EXPECT_EQ(robot_fault("turn[rad],slide[m]", "100,30000"), kTaken);
  EXPECT_EQ(fault("configuration,target,a,b,x,y,z\nc,A,1000,2000,1,2,3\nd,A,1,2,5000,-5000,7000\n"), kTaken);
  JointConvention convention{.name = "c", .controller_joints = {"P", "S"}, .urdf_joints = {"turn", "slide"}};
  convention.matrix = (Eigen::Matrix2d() << 1, 1, 0, 1).finished();
  convention.offset = Eigen::Vector2d::Zero();
  EXPECT_EQ(parse_measurements(coupled_robot(), "configuration,target,x,y,z,P,S\nc,A,0,0,0,1,50000\n", &convention)
                .joint_values(1, 0),
            50000.0);
}

TEST(Configurations, AreNumberedWhereTheyAreNotNamed) {
  const Measurements m = parse_configurations("b[mm],a\n20,1000\n40,3\n40,3\n", kTwo, nullptr, "c.csv");
  EXPECT_EQ(m.source, "c.csv");
  EXPECT_THAT(m.configurations, ElementsAre("1", "2", "3"));
  EXPECT_THAT(m.targets, ElementsAre("1"));
  EXPECT_EQ(m.joint_values, (Eigen::MatrixXd(2, 3) << 1000, 3, 3, 0.02, 0.04, 0.04).finished());
  ASSERT_EQ(m.observations.size(), 3U);
  for (std::size_t row = 0; row < 3; ++row) {
    EXPECT_EQ(m.observations[row].configuration, static_cast<std::int32_t>(row));
    EXPECT_EQ(m.observations[row].target, 0);
    EXPECT_EQ(m.observations[row].position(), Eigen::Vector3d::Zero());
  }
}

TEST(Configurations, MayNameTheirTargetsAndLeaveTheirPointsOpen) {
  const Measurements m =
      parse_configurations("configuration,target,a,b,x[mm],y,z\nc,A,1,2,5,,7\nc,B,1,2,,,\nd,B,3,4,,,\n", kTwo);
  EXPECT_THAT(m.configurations, ElementsAre("c", "d"));
  EXPECT_THAT(m.targets, ElementsAre("A", "B"));
  EXPECT_EQ(m.observations[0].position(), Eigen::Vector3d(0.005, 0.0, 7.0));
  EXPECT_EQ(m.observations[2].position(), Eigen::Vector3d::Zero());
  EXPECT_EQ(m.observations[2].target, 1);
  EXPECT_THAT(fault("configuration,target,a,b,x,y,z\nc,A,1,2,,,\n"), StartsWith("m.csv:2: x '' is empty"));
}

TEST(Configurations, OfAFileAreThoseOfItsText) {
  const std::string file = ::testing::TempDir() + "measurements_file_test_configurations.csv";
  std::ofstream(file) << "a,b[m]\n1000,2000\n";
  EXPECT_EQ(read_configurations(file, kTwo).joint_values, Eigen::Vector2d(1000, 2000));
  std::ofstream(file) << "slide[mm],turn\n500,0.5\n";
  EXPECT_EQ(read_configurations(coupled_robot(), file).joint_values, Eigen::Vector4d(0.5, 0.5, 0.0, 0.5));
}

TEST(MeasurementsRows, NumbersAreJudgedWhole) {
  const auto cell = [](const std::string& text) {
    return fault("configuration;target;a;b;x;y;z\nc;A;1;2;" + text + ";4;5\n");
  };
  EXPECT_EQ(cell("+5"), kTaken);
  for (const std::string text : {"inf5", "nan_", "abc,5", "+"}) {
    EXPECT_THAT(cell(text), HasSubstr("x '" + text + "' is not a number")) << text;
  }
}

TEST(MeasurementsRows, DecimalCommasAreSuspectedWhereCommasSeparateAndFieldsAreTooMany) {
  const auto ragged = [](const std::string& header, const std::string& row) {
    return fault(header + "\n" + row + "\n");
  };
  const std::string hint = "(decimal commas are not read between commas: separate the columns by semicolons)";
  EXPECT_THAT(ragged("configuration,target,a,b,x,y,z", "c,A,1,2,3,4,5,6"), HasSubstr(hint));
  EXPECT_THAT(ragged("configuration,target,a,b,x,y,z", "c,A,1,2,3,4"), Not(HasSubstr(hint)));
  EXPECT_THAT(ragged("configuration;target;a;b;x;y;z", "c;A;1;2;3;4;5;6"), Not(HasSubstr(hint)));
}

TEST(MeasurementsRows, OrdersAreIntegers) {
  const std::string header = "configuration,target,a,b,x,y,z,order\nc,A,1,2,0,0,0,";
  const Measurements m = parse_measurements(header + "9223372036854775807\nd,A,1,2,0,0,0,-3\n", kTwo);
  EXPECT_THAT(testing::order_of(m), ElementsAre(std::numeric_limits<std::int64_t>::max(), -3));
  for (const std::string text : {"1.5", "one", "", "9223372036854775808", "1 1"}) {
    EXPECT_THAT(fault(header + text + "\n"), HasSubstr("order '" + text + "' is no place in an order: expected an int"))
        << text;
  }
}

TEST(MeasurementsRows, QuaternionsStayToTheLastBitWhereTheirNormIsOneToRounding) {
  const double epsilon = std::numeric_limits<double>::epsilon();
  const auto read = [](double w) {
    Measurements m{.joints = kTwo, .joint_values = Eigen::Vector2d::Zero(), .configurations = {"c"}, .targets = {"A"}};
    m.observations = {{.reading = Pose{Eigen::Vector3d::Zero(), Orientation(w, 0, 0, 0)}}};
    return testing::orientation_of(parse_measurements(measurements_csv(m), kTwo).observations[0]).w();
  };
  EXPECT_EQ(read(1.0 + 5.0 * epsilon), 1.0 + 5.0 * epsilon);
  EXPECT_EQ(read(1.0 + 30.0 * epsilon), 1.0);
  EXPECT_THAT(fault("configuration,target,a,b,x,y,z,qw,qx,qy,qz\nc,A,1,2,0,0,0,0.25,-0.5,0.75,1\n"),
              HasSubstr("the norm of the quaternion (qw '0.25', ...) is 1.3693"));
}

TEST(MeasurementsRows, TwinsAreFoundWhereverTheyStandAmongRowsInOrder) {
  for (int twin = 0; twin <= 12; ++twin) {  // 12: none
    std::string csv = "configuration,target,a,b,x,y,z\n";
    for (int c = 0; c < 12; ++c) {
      const std::string row = "c" + std::to_string(c) + ",A,1,2,0,0,0\n";
      csv += c == twin ? row + row : row;
    }
    EXPECT_EQ(fault(csv), twin == 12
                              ? kTaken
                              : "m.csv:" + std::to_string(twin + 3) + ": configuration 'c" + std::to_string(twin) +
                                    "', repeat 1, target 'A' is measured twice, before in line " +
                                    std::to_string(twin + 2) + ": expected one row for each");
  }
}

TEST(MeasurementsRows, ConvertedValuesReach1e12) {
  JointConvention convention{.name = "c.json", .controller_joints = {"P", "S"}, .urdf_joints = kTwo};
  convention.matrix = Eigen::Vector2d(1.0, 2.0).asDiagonal();
  convention.offset = Eigen::Vector2d::Zero();
  const auto refused = [&](const std::string& p, const std::string& s) {
    const std::string row = "configuration,target,P,S,x,y,z\nc,A,0,0,0,0,0\nd,A," + p + "," + s + ",0,0,0\n";
    return testing::refusal([&] { parse_measurements(row, kTwo, &convention, "m.csv"); });
  };
  EXPECT_EQ(refused("1e12", "5e11"), kTaken);
  EXPECT_THAT(refused("0", "5.00000001e11"),
              AllOf(StartsWith("m.csv:3: joint values out of range"), HasSubstr("c.json")));
}

TEST(MeasurementsRows, FollowersMayBeRoundedByWhatBothColumnsLose) {
  // turning = -0.5 turn + 0.25: half of a thousandth of a degree in its column, half of that through its leader's.
  const auto refused = [](double rounding) {
    const std::string rows = "c,A,0,0,0,0.5,1,0,1\nd,A,0,0,0,0.5,1," + std::to_string(rounding) + ",1\n";
    return testing::refusal([&] {
      parse_measurements(coupled_robot(), "configuration,target,x,y,z,turn,slide,turning,sliding\n" + rows, nullptr,
                         "m.csv");
    });
  };
  for (const double sign : {1.0, -1.0}) {
    EXPECT_EQ(refused(sign * 1.4e-5), kTaken);
    EXPECT_THAT(refused(sign * 1.6e-5), StartsWith("m.csv:3: turning '"));
  }
  EXPECT_EQ(refused(0.125),
            "m.csv:3: turning '0.125' contradicts the URDF, where the joint mimics 'turn': expected 0 "
            "(-0.5 times that of 'turn' plus 0.25)");
}

TEST(MeasurementsRows, UnitsOfFollowersAreThoseOfTheirColumns) {
  const auto units = [](const std::string& columns, const std::string& values) {
    return parse_measurements(coupled_robot(), "configuration,target,x,y,z," + columns + "\nc,A,0,0,0," + values + "\n")
        .joint_units;
  };
  using enum JointUnit;
  EXPECT_THAT(units("turn,slide[m],turning[rad],sliding[mm]", "0.5,1,0,1000"),
              ElementsAre(unstated, metre, radian, metre));
  EXPECT_THAT(units("turn[deg],slide,turning,sliding", "0,1,0.25,1"),
              ElementsAre(radian, unstated, unstated, unstated));
  EXPECT_THAT(units("turn,slide", "0,1"), IsEmpty());
}

TEST(MeasurementsCsv, WritesOrderAndTorquesInTheUnitsOfTheirJoints) {
  const std::string csv =
      "configuration,target,turn[rad],\"b,c[m]\",plain,x[m],y[m],z[m],order,tau_turn[Nm],\"tau_b,c[N]\",tau_plain\n"
      "c1,A,0.1,2,5,1,2,3,7,0.5,-3,1e-05\n"
      "c2,A,0.2,2,6,1,2,3,-4,,4,\n";
  const std::vector<std::string> joints = {"turn", "b,c", "plain"};
  const Measurements read = parse_measurements(csv, joints);
  EXPECT_EQ(measurements_csv(read), csv);
  Measurements without = read;
  without.joint_units.clear();
  without.signals.torques.row(1).setConstant(std::nan(""));
  without = without_order(std::move(without));
  EXPECT_EQ(measurements_csv(without),
            "configuration,target,turn,\"b,c\",plain,x[m],y[m],z[m],tau_turn,tau_plain\n"
            "c1,A,0.1,2,5,1,2,3,0.5,1e-05\nc2,A,0.2,2,6,1,2,3,,\n");
}

TEST(LabelTables, NumberLabelsByTheirFirstAppearanceAndBeginAnew) {
  Random random(7);
  LabelTable table;
  for (int round = 0; round < 3; ++round) {
    std::map<std::string, std::int32_t> plain;
    for (int i = 0; i < 9000; ++i) {
      const std::string label = std::to_string(random.bits() % 3000U);
      const auto size = static_cast<std::int32_t>(plain.size());
      const auto [place, fresh] = plain.emplace(label, size);
      ASSERT_EQ(table.find(label), place->second) << label;
      if (fresh) table.add(label);
      ASSERT_EQ(table.size(), static_cast<std::int32_t>(plain.size()));
      ASSERT_EQ(table.find("none"), table.size());
    }
    const std::vector<std::string> labels = table.take_labels();
    ASSERT_EQ(labels.size(), plain.size());
    for (const auto& [label, number] : plain) EXPECT_EQ(labels[static_cast<std::size_t>(number)], label);
    EXPECT_EQ(table.size(), 0);
    EXPECT_EQ(table.find(labels.front()), 0);
  }
}

}  // namespace
}  // namespace kdl_calibration::measurements_file_test
