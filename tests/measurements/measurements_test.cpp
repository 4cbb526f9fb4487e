#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "measurements/measurements_check.hpp"

#include <gmock/gmock.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <functional>
#include <limits>
#include <map>
#include <numbers>
#include <set>

#include "base/random.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/robot.hpp"
#include "measurements/readings.hpp"
#include "measurements/training_rows.hpp"
#include "refusal.hpp"
#include "same_measurements.hpp"
#include "support.hpp"

namespace kdl_calibration::measurements_test {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using testing::expect_same;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using testing::order_of;
using testing::orientation_of;
using testing::remove_orientation;
using testing::set_orientation;
using testing::set_orientations;
using ::testing::StartsWith;

const std::vector<std::string> kJoints = {"joint_1", "joint_2"};
const std::string kHeader = "configuration,target,joint_1[rad],joint_2[rad],x[m],y[m],z[m]\n";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
  return text;
}

/// The message of the InputError that the call throws; it must be one line.
template <typename Call>
std::string message_of(const Call& call) {
  std::string message = testing::refusal(call);
  EXPECT_EQ(message.find_first_of("\r\n"), std::string::npos) << message;
  return message;
}

std::string csv_message(const std::string& csv, const JointConvention* convention = nullptr) {
  return message_of([&] { parse_measurements(csv, kJoints, convention, "m.csv"); });
}

std::string row_message(const std::string& rows) { return csv_message(kHeader + rows); }

std::string convention_message(const std::string& json) {
  return message_of([&] { parse_joint_convention(json, "c.json"); });
}

Measurements parse(const std::string& csv) { return parse_measurements(csv, kJoints); }

/// Writes a file for one test and removes it.
class TemporaryFile {
public:
  TemporaryFile(const std::string& name, const std::string& content)
      : path_(std::filesystem::path(::testing::TempDir()) / ("measurements_test_" + name)) {
    std::ofstream(path_, std::ios::binary) << content;
  }
  ~TemporaryFile() { std::filesystem::remove(path_); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const std::filesystem::path& path() const { return path_; }

private:
  std::filesystem::path path_;
};

TEST(Measurements, ReadsOneRowPerMeasuredPoint) {
  const Measurements m =
      parse(kHeader + "c1,A,0.5,-1.25,1,2,3\nc1,B,0.5,-1.25,1.5,2.5,3.5\nc2,B,0.75,1e-3,4,5,-6.25\n");
  EXPECT_THAT(m.joints, ElementsAre("joint_1", "joint_2"));
  EXPECT_THAT(m.configurations, ElementsAre("c1", "c2"));
  EXPECT_THAT(m.targets, ElementsAre("A", "B"));
  ASSERT_EQ(m.joint_values.rows(), 2);
  ASSERT_EQ(m.joint_values.cols(), 2);
  EXPECT_EQ(m.joint_values, (Eigen::Matrix2d() << 0.5, 0.75, -1.25, 1e-3).finished());
  ASSERT_EQ(m.observations.size(), 3U);
  EXPECT_EQ(m.observations[2].position(), Eigen::Vector3d(4, 5, -6.25));
  EXPECT_EQ(m.observations[2].configuration, 1);
  EXPECT_EQ(m.observations[2].target, 1);
  EXPECT_EQ(m.observations[2].repeat, 1);
  EXPECT_EQ(m.observations[2].sigma, 0.0);
  EXPECT_EQ(m.observations[2].split, Split::train);
  EXPECT_FALSE(has_orientations(m));
  EXPECT_THAT(m.joint_units, ElementsAre(JointUnit::radian, JointUnit::radian));
}

TEST(Measurements, ReadsColumnsInAnyOrder) {
  const Measurements m = parse("z,joint_2,target,y,split,x,joint_1,configuration\n3,20,A,2,test,1,10,c\n");
  EXPECT_EQ(m.joint_values, Eigen::Vector2d(10, 20));
  EXPECT_EQ(m.observations[0].position(), Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(m.observations[0].split, Split::test);
  EXPECT_THAT(m.joint_units, IsEmpty());
}

TEST(Measurements, ConvertsUnitsToRadiansAndMetres) {
  const Measurements m =
      parse("configuration,target,joint_1 [deg], joint_2[ mm ] ,x[mm],y [m],z,sigma[mm]\nc,A,180,250,1500,2,3,0.03\n");
  EXPECT_NEAR(m.joint_values(0, 0), std::numbers::pi, 1e-15);
  EXPECT_EQ(m.joint_values(1, 0), 0.25);
  EXPECT_EQ(m.observations[0].position(), Eigen::Vector3d(1.5, 2, 3));
  EXPECT_DOUBLE_EQ(m.observations[0].sigma, 0.00003);
  EXPECT_THAT(m.joint_units, ElementsAre(JointUnit::radian, JointUnit::metre));
}

TEST(Measurements, SkipsCommentsAndEmptyLinesEvenBeforeTheHeader) {
  const Measurements m =
      parse("# a note, with commas\n\n" + kHeader + "#c0,A,0,0,0,0,0\n  \t\nc1,A,1,2,3,4,5\n\n;;;\n,,,,,,\n");
  EXPECT_THAT(m.configurations, ElementsAre("c1"));
  EXPECT_EQ(m.observations.size(), 1U);
}

TEST(Measurements, ReadsTheLastLineWithoutALineEnd) {
  EXPECT_EQ(parse(kHeader + "c1,A,1,2,3,4,5.25").observations[0].position().z(), 5.25);
}

TEST(Measurements, TakesDefaultsForEmptyOptionalCells) {
  const Measurements m = parse(
      "configuration,split,repeat,target,joint_1,joint_2,x,y,z,sigma,qw,qx,qy,qz\n"
      "c1,,,A,1,2,3,4,5,,,,,\n"
      "c2,test,7,A,1,2,3,4,5,0.001,0,1,0,0\n"
      "c3,train,0,A,1,2,3,4,5,,,,,\n");
  EXPECT_EQ(m.observations[0].split, Split::train);
  EXPECT_EQ(m.observations[0].repeat, 1);
  EXPECT_EQ(m.observations[0].sigma, 0.0);
  EXPECT_EQ(m.observations[1].split, Split::test);
  EXPECT_EQ(m.observations[1].repeat, 7);
  EXPECT_EQ(m.observations[1].sigma, 0.001);
  EXPECT_EQ(m.observations[2].repeat, 0);
  ASSERT_EQ(m.observations.size(), 3U);
  EXPECT_TRUE(std::holds_alternative<Point>(m.observations[0].reading));
  EXPECT_EQ(orientation_of(m.observations[1]).coeffs(), Eigen::Vector4d(1, 0, 0, 0));  // x, y, z, w
  EXPECT_TRUE(std::holds_alternative<Point>(m.observations[2].reading));
}

TEST(Measurements, NormalisesQuaternionsKeepsTheirSignAndHasNoneWhereTheirColumnsAreEmpty) {
  EXPECT_FALSE(has_orientations(parse(replaced(kHeader, "\n", ",qw,qx,qy,qz\n") + "c1,A,1,2,3,4,5,,,,\n")));
  const Measurements m =
      parse(replaced(kHeader, "\n", ",qw,qx,qy,qz\n") + "c1,A,1,2,3,4,5,-0.5005,0.5005,0.5005,0.5005\n");
  EXPECT_NEAR((orientation_of(m.observations[0]).coeffs() - Eigen::Vector4d(0.5, 0.5, 0.5, -0.5)).norm(), 0.0, 1e-15);
}

TEST(Measurements, ReadsEveryFormOfANumber) {
  const Measurements m = parse(kHeader + "c1,A,+1.5,-.5,1E3,2e-3,7.\n");
  EXPECT_EQ(m.joint_values, Eigen::Vector2d(1.5, -0.5));
  EXPECT_EQ(m.observations[0].position(), Eigen::Vector3d(1000, 0.002, 7));
}

TEST(Measurements, ReadsWhatASpreadsheetSaves) {
  const std::string csv = "\xef\xbb\xbf" + replaced(replaced(kHeader, ",", ";"), "\n", ";\r\n") +
                          "c 1;\"A \"\"left\"\"; top\" ;0.5;-1.25;1;2;3;\r\n;;;;;;;\r\nc 1; B;\"0.5\";-1.25;4;5;6;\r\n";
  const Measurements m = parse(csv);
  EXPECT_THAT(m.configurations, ElementsAre("c 1"));
  EXPECT_THAT(m.targets, ElementsAre("A \"left\"; top", "B"));
  EXPECT_EQ(m.observations[1].position(), Eigen::Vector3d(4, 5, 6));
}

TEST(Measurements, KeepsGroupsTogetherInAnyOrderOfRows) {
  const Measurements m = parse(
      "configuration,repeat,target,joint_1,joint_2,x,y,z\n"
      "b,2,A,1,2,0,0,0\na,1,B,3,4,0,0,1\nb,1,B,1,2,0,0,2\na,1,A,3,4,0,0,3\nb,1,A,1,2,0,0,4\n");
  EXPECT_THAT(m.configurations, ElementsAre("b", "a"));
  EXPECT_THAT(m.targets, ElementsAre("A", "B"));
  std::vector<std::int32_t> configurations;
  for (const Observation& o : m.observations) configurations.push_back(o.configuration);
  EXPECT_THAT(configurations, ElementsAre(0, 1, 0, 1, 0));
  EXPECT_EQ(m.joint_values, (Eigen::Matrix2d() << 1, 3, 2, 4).finished());
}

TEST(Measurements, ReadsALargeFilePieceByPiece) {
  std::string csv = "# " + std::string(1000, '-') + "\n" + kHeader;
  for (int i = 0; csv.size() < (std::size_t{9} << 20U); ++i) {
    const std::string n = std::to_string(i);
    csv += "c" + n + ",A,0." + n + ",1." + n + "," + n + ",2.5,-3." + n + "\r\n";
    if (i % 1000 == 0) csv += "#" + std::string(static_cast<std::size_t>(i % 7919), '#') + "\n";
  }
  const TemporaryFile file("large.csv", csv);
  const Measurements read = read_measurements(file.path(), kJoints);
  EXPECT_GT(read.observations.size(), 100000U);
  expect_same(read, parse(csv));
}

TEST(Measurements, ReadsAFileOfLinesThatAreAsLongAsLinesMayBe) {
  std::string csv = kHeader;
  for (int i = 0; i < 14; ++i) {  // more than the reader holds, with long rests of lines between its pieces
    csv += "#" + std::string(900'000, static_cast<char>('a' + i)) + "\n";
    csv += "c" + std::to_string(i) + ",A,0.5," + std::to_string(i) + ",1,2,3\n";
  }
  const TemporaryFile file("long_lines.csv", csv);
  const Measurements read = read_measurements(file.path(), kJoints);
  ASSERT_EQ(read.joint_values.cols(), 14);
  EXPECT_EQ(read.joint_values.row(1), Eigen::RowVectorXd::LinSpaced(14, 0.0, 13.0));
  EXPECT_EQ(read.configurations.back(), "c13");
}

TEST(Measurements, AJointsOwnNameMayEndInAUnitOrOtherBrackets) {
  const Measurements m = parse_measurements("configuration,target,turn[deg],axis[1],x,y,z\nc,A,1.5,0.25,1,2,3\n",
                                            {"turn[deg]", "axis[1]"});
  EXPECT_EQ(m.joint_values, Eigen::Vector2d(1.5, 0.25));
  EXPECT_THAT(m.joint_units, IsEmpty());
}

TEST(MeasurementsInput, MissingFileIsNamedWithTheReason) {
  EXPECT_REFUSED_WITH(AllOf(StartsWith("/no/such/file.csv: cannot be opened"), HasSubstr("No such file")),
                      read_measurements("/no/such/file.csv", kJoints));
  EXPECT_REFUSED_WITH(AllOf(StartsWith("/: "), HasSubstr("directory")), read_measurements("/", kJoints));
}

TEST(MeasurementsInput, EmptyFileAndHeaderAloneAreRefused) {
  for (const char* text : {"", "\n\n", "# only a comment", "\xef\xbb\xbf", ";;;\n"}) {
    EXPECT_THAT(csv_message(text), AllOf(StartsWith("m.csv: empty"), HasSubstr("joint_1, joint_2"))) << text;
  }
  EXPECT_THAT(csv_message("\n" + kHeader + "# nothing\n"), AllOf(StartsWith("m.csv: no rows"), HasSubstr("line 2")));
}

TEST(MeasurementsInput, UnknownJointListsTheExpectedOnesAndHintsAtAConvention) {
  EXPECT_THAT(csv_message("# note\n" + replaced(kHeader, "joint_1", "J1")),
              AllOf(StartsWith("m.csv:2: unknown column 'J1[rad]'"), HasSubstr("joint_1, joint_2"),
                    HasSubstr("need --joint-convention")));
}

TEST(MeasurementsInput, JointNamedLikeAnotherColumnIsRefused) {
  EXPECT_REFUSED_WITH(AllOf(HasSubstr("joint 'x'"), HasSubstr("joint convention")),
                      parse_measurements("configuration,target,x,y,z\n", {"x"}, nullptr, "m.csv"));
}

TEST(MeasurementsInput, RaggedRowTellsBothCounts) {
  EXPECT_THAT(row_message("c1,A,1,2,3,4,5\nc2,A,1,2,3,4\n"),
              StartsWith("m.csv:3: 6 fields, expected 7 as in the header in line 1"));
  EXPECT_THAT(row_message("c1,A,1,2,3,4,5,\n"), HasSubstr("8 fields, expected 7"));
  EXPECT_THAT(row_message("c1;A;1;2;3;4;5\n"), HasSubstr("1 fields, expected 7"));
}

TEST(MeasurementsInput, ColumnsWithoutANameAreEmptyAndLast) {
  EXPECT_THAT(csv_message(replaced(kHeader, "target", "")), StartsWith("m.csv:1: column 2 has no name"));
  EXPECT_THAT(csv_message(replaced(kHeader, "\n", ",\n") + "c1,A,1,2,3,4,5,6\n"),
              StartsWith("m.csv:2: value '6' in a column without a name"));
}

TEST(MeasurementsInput, NumbersThatAreNoneAreNamedWithColumnAndValue) {
  EXPECT_THAT(row_message("c1,A,1,2,3,abc,5\n"), StartsWith("m.csv:2: y[m] 'abc' is not a number"));
  EXPECT_THAT(row_message("c1,A,1,2x,3,4,5\n"), StartsWith("m.csv:2: joint_2[rad] '2x' is not a number"));
  EXPECT_THAT(row_message("c1,A,,2,3,4,5\n"), StartsWith("m.csv:2: joint_1[rad] '' is empty"));
  for (const char* text : {"1e", "0x10", "1 2", "--1", "+-1", "+", "-", ".", "1.2.3", "1e5.0", "1\xc2\xa0"}) {
    EXPECT_THAT(row_message("c1,A,1,2,3,4," + std::string(text) + "\n"), HasSubstr("is not a number")) << text;
  }
}

TEST(MeasurementsInput, NanAndInfinityAreRefused) {
  for (const char* text : {"nan", "NaN", "-nan", "inf", "-INF", "infinity", "+inf", "nan(1)"}) {
    EXPECT_THAT(row_message("c1,A,1,2," + std::string(text) + ",4,5\n"),
                AllOf(StartsWith("m.csv:2: x[m] '" + std::string(text)), HasSubstr("is not finite")));
  }
  EXPECT_THAT(row_message("c1,A,1,2,1e999,4,5\n"), HasSubstr("x[m] '1e999' is outside the range of a double"));
}

TEST(MeasurementsInput, SplitRepeatAndSigmaKeepTheirRules) {
  const std::string header = replaced(kHeader, "\n", ",split,repeat,sigma[mm]\n");
  const auto message = [&](const std::string& cells) { return csv_message(header + "c,A,1,2,3,4,5," + cells + "\n"); };
  EXPECT_THAT(message("Tests,1,1"), AllOf(StartsWith("m.csv:2: split 'Tests'"), HasSubstr("train or test")));
  EXPECT_EQ(message("TRAIN,1,1"), message("train,1,1"));
  for (const char* repeat : {"-1", "1.5", "one", "4294967297", "1 1"}) {
    EXPECT_THAT(message("test," + std::string(repeat) + ",1"), HasSubstr("repeat '" + std::string(repeat) + "' is no"));
  }
  for (const char* sigma : {"0", "-0.1", "-0", "1e-322"}) {
    EXPECT_THAT(message("test,1," + std::string(sigma)),
                HasSubstr("sigma[mm] '" + std::string(sigma) + "' is not pos"));
  }
  EXPECT_THAT(message("test,1,nan"), HasSubstr("not finite"));
  EXPECT_THAT(message("test,1,1e-13"), HasSubstr("at least 1e-15 m"));
  EXPECT_THAT(message("test,1,1e13"), HasSubstr("at most 1e12"));
}

TEST(MeasurementsInput, BrokenQuaternionsAreRefused) {
  const std::string header = replaced(kHeader, "\n", ",qw,qx,qy,qz\n");
  EXPECT_THAT(csv_message(header + "c,A,1,2,3,4,5,1,0,,0\n"), HasSubstr("m.csv:2: the quaternion has an empty cell"));
  EXPECT_THAT(csv_message(header + "c,A,1,2,3,4,5,1.0011,0,0,0\n"),
              AllOf(StartsWith("m.csv:2: the norm of the quaternion"), HasSubstr("1.0011")));
  EXPECT_THAT(csv_message(header + "c,A,1,2,3,4,5,0,0,0,0\n"), HasSubstr("norm"));
  EXPECT_THAT(csv_message(header + "c,A,1,2,3,4,5,1e12,1e12,0,0\n"), HasSubstr("norm"));
  EXPECT_EQ(csv_message(header + "c,A,1,2,3,4,5,1.0009,0,0,0\n"), "nothing was refused");
}

TEST(MeasurementsInput, DuplicateRowsNameBothLines) {
  EXPECT_THAT(
      row_message("c1,A,1,2,3,4,5\nc1,B,1,2,3,4,5\n\nc1,A,1,2,3,4,5.1\n"),
      AllOf(StartsWith("m.csv:5: "), HasSubstr("configuration 'c1', repeat 1, target 'A'"), HasSubstr("line 2")));
  const std::string header = replaced(kHeader, "\n", ",repeat\n");
  EXPECT_EQ(csv_message(header + "c,A,1,2,3,4,5,2\nc,A,1,2,3,4,5,1\n"), "nothing was refused");
  EXPECT_THAT(csv_message(header + "c,A,1,2,3,4,5,2\nc,B,1,2,3,4,5,1\nc,A,1,2,3,4,5,2\n"), HasSubstr("measured twice"));
}

TEST(MeasurementsInput, MessagesStayOnOneLineWhateverTheHeaderHolds) {
  EXPECT_THAT(csv_message("configuration,target,joint_1[rad\t],joint_2,x,y,z\nc1,A,a,2,3,4,5\n"),
              StartsWith("m.csv:2: joint_1[rad\\x09] 'a' is not a number"));
}

TEST(MeasurementsInput, OneConfigurationHasOneSetOfJointValuesAndIsWhollyTrainOrTest) {
  EXPECT_THAT(row_message("c1,A,1,2,3,4,5\nc2,A,1,2,3,4,5\nc1,B,1,2.001,3,4,5\n"),
              AllOf(StartsWith("m.csv:4: joint_2[rad] '2.001' differs from line 2"), HasSubstr("configuration 'c1'")));
  EXPECT_THAT(row_message("c1,A,1,2,3,4,5\nc1,B,1.5,2,3,4,5\n"), StartsWith("m.csv:3: joint_1[rad] '1.5' differs"));
  const std::string header = replaced(kHeader, "\n", ",split\n");
  EXPECT_THAT(csv_message(header + "c1,A,1,2,3,4,5,train\nc1,B,1,2,3,4,5,test\n"),
              AllOf(StartsWith("m.csv:3: split 'test' differs from line 2"), HasSubstr("configuration 'c1'")));
}

TEST(MeasurementsInput, LabelsArePlainText) {
  EXPECT_THAT(row_message(",A,1,2,3,4,5\n"), StartsWith("m.csv:2: configuration '' is empty"));
  EXPECT_THAT(row_message("c1,,1,2,3,4,5\n"), StartsWith("m.csv:2: target '' is empty"));
  EXPECT_THAT(row_message("c\x1b[2J,A,1,2,3,4,5\n"), HasSubstr("configuration 'c\\x1b[2J' has a control character"));
  EXPECT_THAT(row_message("c1,Spitze \xfc,1,2,3,4,5\n"), HasSubstr("target 'Spitze \\xfc' is not UTF-8"));
  EXPECT_THAT(parse(kHeader + "c1,Spitze \xc3\xbc,1,2,3,4,5\n").targets, ElementsAre("Spitze \xc3\xbc"));
}

TEST(MeasurementsInput, QuotesMustBeWhole) {
  EXPECT_THAT(row_message("\"c1,A,1,2,3,4,5\nc2,A,1,2,3,4,5\n"), StartsWith("m.csv:2: no closing quote"));
  EXPECT_THAT(row_message("\"c1\"x,A,1,2,3,4,5\n"), StartsWith("m.csv:2: text after the closing quote"));
  EXPECT_THAT(row_message("c\"1,A,1,2,3,4,5\n"), StartsWith("m.csv:2: a quote inside the field 'c\"1'"));
}

TEST(MeasurementsInput, OtherEncodingsAreRefused) {
  const std::string utf16(
      "\xff\xfe"
      "c\0o\0",
      6);
  EXPECT_THAT(csv_message(utf16), AllOf(StartsWith("m.csv: "), HasSubstr("UTF-16")));
  EXPECT_THAT(csv_message(std::string("\xfe\xff\0c", 4)), HasSubstr("UTF-16"));
  EXPECT_THAT(csv_message(std::string("c\0o\0n\0", 6)), AllOf(StartsWith("m.csv:1: "), HasSubstr("NUL")));
  EXPECT_THAT(row_message(std::string("c1,A,1,2,3,4,5\0\n", 16)), AllOf(StartsWith("m.csv:2: "), HasSubstr("NUL")));
  EXPECT_THAT(csv_message(replaced(kHeader, "\n", "\r") + "c1,A,1,2,3,4,5\r"), HasSubstr("carriage return"));
}

TEST(MeasurementsInput, LimitsSayTheirSize) {
  const std::string longest((std::size_t{1} << 20U), '#');
  EXPECT_EQ(csv_message(longest + "\n" + kHeader + "c1,A,1,2,3,4,5\n"), "nothing was refused");
  EXPECT_THAT(csv_message(kHeader + longest + "#\nc1,A,1,2,3,4,5\n"),
              AllOf(StartsWith("m.csv:2: "), HasSubstr("1 MiB")));
  const TemporaryFile file("endless.csv", kHeader + std::string(std::size_t{10} << 20U, '1'));
  EXPECT_REFUSED(":2: the line is longer", read_measurements(file.path(), kJoints));
  EXPECT_THAT(csv_message(replaced(kHeader, "\n", std::string(10000, ',') + "\n")),
              HasSubstr("limit of 10000 columns"));
}

TEST(MeasurementsInput, LongValuesAreShortenedAndEscaped) {
  const std::string message = row_message("c1,A,1,2,3,4," + std::string(500, 'x') + "\n");
  EXPECT_THAT(message, HasSubstr("'" + std::string(40, 'x') + "...' is not a number"));
  EXPECT_THAT(row_message("c1,A,1,2,3,4,\x01\x7f\xff\n"), HasSubstr("'\\x01\\x7f\\xff'"));
}

/// The text with up to three changes. Half of the damage falls into its last quarter, since little in a header can
/// change without harm.
std::string damaged(std::string text, const std::string& alphabet, Random& random) {
  const auto below = [&random](std::size_t n) { return static_cast<std::size_t>(random.bits() % n); };
  for (std::size_t change = below(3) + 1; change > 0 && !text.empty(); --change) {
    const std::size_t at = std::max(below(text.size()), below(2) * text.size() * 3 / 4);
    const std::size_t length = std::min(below(8) + 1, text.size() - at);
    switch (below(4)) {
      case 0:
        text[at] = alphabet[below(alphabet.size())];
        break;
      case 1:
        text.erase(at, length);
        break;
      case 2:
        text.insert(at, 1, alphabet[below(alphabet.size())]);
        break;
      default:
        text.insert(below(text.size()), text.substr(at, length));
    }
  }
  return text;
}

TEST(MeasurementsInput, RandomDamageGivesAResultOrAnInputError) {
  const std::string valid =
      "\xef\xbb\xbf# "
      "note\nconfiguration,split,repeat,target,joint_1[deg],joint_2[rad],x[mm],y[m],z[m],qw,qx,qy,qz,sigma[mm]\r\n"
      "1,train,1,A,10,0.5,1.5,2.5,3.5,1,0,0,0,0.1\r\n\"1\",train,2,\"A\",10,0.5,1.5,2.5,3.5,,,,,\r\n"
      "2,test,1,\"B,\"\"x\"\"\",-1e1,+.5,1.5,2.5,3.5,0.5,-0.5,0.5,0.5,0.02\r\n";
  const std::string alphabet = ",;\"\n\r\t #+-.0123456789eE[]nanif\xef\xbb\xbf\xff\xfe\xc3" + std::string(1, '\0');
  Random random(11);
  int results = 0;
  int errors = 0;
  for (int round = 0; round < 5000; ++round) {
    const std::string csv = damaged(valid, alphabet, random);
    try {
      const Measurements m = parse(csv);
      expect_same(parse(measurements_csv(m)), m);
      ++results;
    } catch (const InputError& error) {
      ASSERT_EQ(std::string(error.what()).find_first_of(std::string("\r\n\0", 3)), std::string::npos);
      ++errors;
    }
    ASSERT_FALSE(::testing::Test::HasFailure()) << csv;
  }
  EXPECT_GT(results, 200);
  EXPECT_GT(errors, 200);
}

const std::string kPendant =
    R"({"description": "J2 counts from above", "controller_joints": ["J1", "J2"], "urdf_joints": ["joint_1", "joint_2"],
        "matrix": [[1, 0], [1, -2]], "offset": [0, 0.5]})";

JointConvention pendant() { return parse_joint_convention(kPendant, "c.json"); }

TEST(JointConventions, ConvertControllerValuesToTheUrdf) {
  const JointConvention convention = pendant();
  EXPECT_EQ(convention.name, "c.json");
  EXPECT_THAT(convention.controller_joints, ElementsAre("J1", "J2"));
  const Measurements m = parse_measurements(
      "configuration,target,J2[rad],J1[deg],x,y,z\nc,A,0.25,90,1,2,3\nd,A,1,0,1,2,3\n", kJoints, &convention);
  EXPECT_THAT(m.joints, ElementsAre("joint_1", "joint_2"));
  const double right = std::numbers::pi / 2;
  EXPECT_NEAR(m.joint_values(0, 0), right, 1e-15);
  EXPECT_NEAR(m.joint_values(1, 0), right - 2 * 0.25 + 0.5, 1e-15);
  EXPECT_EQ(m.joint_values(0, 1), 0.0);
  EXPECT_EQ(m.joint_values(1, 1), -1.5);
  EXPECT_THAT(m.joint_units, IsEmpty());
}

TEST(JointConventions, FollowTheOrderOfTheChain) {
  const JointConvention convention = parse_joint_convention(kPendant);
  const JointConvention matched = matched_convention(convention, {"joint_2", "joint_1"});
  EXPECT_THAT(matched.urdf_joints, ElementsAre("joint_2", "joint_1"));
  EXPECT_THAT(matched.controller_joints, ElementsAre("J1", "J2"));
  EXPECT_EQ(matched.matrix, (Eigen::Matrix2d() << 1, -2, 1, 0).finished());
  EXPECT_EQ(matched.offset, Eigen::Vector2d(0.5, 0));
  const Measurements m =
      parse_measurements("configuration,target,J1,J2,x,y,z\nc,A,3,1,1,2,3\n", {"joint_2", "joint_1"}, &convention);
  EXPECT_EQ(m.joint_values, Eigen::Vector2d(1.5, 3));
}

TEST(JointConventions, OffsetIsZeroWhereAbsent) {
  EXPECT_EQ(parse_joint_convention(R"({"controller_joints": ["a"], "urdf_joints": ["b"], "matrix": [[2]]})").offset,
            Eigen::VectorXd::Zero(1));
}

TEST(JointConventions, RefuseOtherJointsThanTheChains) {
  EXPECT_REFUSED_WITH(AllOf(StartsWith("c.json: key 'urdf_joints'"), HasSubstr("joint_1, other")),
                      matched_convention(pendant(), {"joint_1", "other"}));
  EXPECT_REFUSED("expected the moving joints", matched_convention(pendant(), {"joint_1"}));
}

TEST(JointConventions, RefuseColumnsWithTheUrdfsNames) {
  const JointConvention convention = pendant();
  EXPECT_THAT(csv_message(kHeader + "c,A,1,2,3,4,5\n", &convention),
              AllOf(StartsWith("m.csv:1: column 'joint_1[rad]' has the URDF's joint name"), HasSubstr("c.json"),
                    HasSubstr("J1, J2"), Not(HasSubstr("need --joint-convention"))));
  EXPECT_THAT(csv_message(replaced(kHeader, "joint_", "A"), &convention),
              AllOf(HasSubstr("unknown column 'A1[rad]'"), Not(HasSubstr("need --joint-convention"))));
}

TEST(JointConventions, BadFilesAreNamed) {
  EXPECT_REFUSED_WITH(StartsWith("/no/such.json: cannot be opened"), read_joint_convention("/no/such.json"));
  const TemporaryFile file("convention.json", kPendant);
  EXPECT_EQ(read_joint_convention(file.path()).name, file.path().string());
  EXPECT_THAT(convention_message(""), StartsWith("c.json:1: malformed JSON"));
  EXPECT_THAT(convention_message("{\n\"matrix\": [1,}"), StartsWith("c.json:2: malformed JSON"));
  EXPECT_THAT(convention_message("[]"), HasSubstr("no JSON object"));
  EXPECT_THAT(convention_message(replaced(kPendant, "-2", "1e999")), HasSubstr("range of a double"));
  EXPECT_THAT(convention_message(std::string(200000, '[')), HasSubstr("nested deeper"));
}

TEST(JointConventions, BadKeysAndValuesAreNamedWithTheirPlace) {
  const auto with = [](const std::string& from, const std::string& to) {
    return convention_message(replaced(kPendant, from, to));
  };
  EXPECT_THAT(with("\"offset\"", "\"ofset\""), StartsWith("c.json: unknown key 'ofset': expected controller_joints"));
  EXPECT_THAT(with("\"matrix\"", "\"description\""), HasSubstr("key 'description' appears twice"));
  EXPECT_THAT(convention_message(R"({"controller_joints": ["a"], "urdf_joints": ["b"]})"),
              HasSubstr("missing key 'matrix'"));
  EXPECT_THAT(with("\"J2 counts from above\"", "3"), HasSubstr("key 'description': '3'"));
  EXPECT_THAT(with("[\"J1\", \"J2\"]", "\"J1\""), HasSubstr("key 'controller_joints': expected a list"));
  EXPECT_THAT(with("[\"J1\", \"J2\"]", "[]"), HasSubstr("key 'controller_joints': expected a list"));
  EXPECT_THAT(with("\"J2\"", "2"), HasSubstr("key 'controller_joints': '2' is no joint name"));
  EXPECT_THAT(with("\"J2\"", "\"J1\""), HasSubstr("joint 'J1' appears twice"));
  EXPECT_THAT(with("\"joint_1\", ", ""), HasSubstr("key 'urdf_joints' has 1 names: expected 2"));
  EXPECT_THAT(with("[[1, 0], [1, -2]]", "[[1, 0]]"), HasSubstr("key 'matrix' has 1 rows: expected 2"));
  EXPECT_THAT(with("[0, 0.5]", "[0, 0.5, 1]"), HasSubstr("key 'offset' has 3 entries"));
  EXPECT_THAT(with("[1, -2]", "[2, 0]"),
              AllOf(HasSubstr("key 'matrix' is singular"), HasSubstr("rank is 1, expected 2")));
  const std::string numbers = ": expected a list of 2 numbers, one per joint";
  EXPECT_EQ(with("[1, -2]", "{}"), "c.json: key 'matrix', row 2: '{}' is no list" + numbers);
  EXPECT_EQ(with("[1, 0]", "[1]"), "c.json: key 'matrix', row 1 has 1 entries" + numbers);
  EXPECT_EQ(with("[1, -2]", "[true, 2]"), "c.json: key 'matrix', row 2: 'true' is no number" + numbers);
  EXPECT_EQ(with("[0, 0.5]", "[0, 2e12]"),
            "c.json: key 'offset': '2000000000000.0' is out of range: expected at most "
            "1e12");
  EXPECT_THAT(with("[0, 0.5]", "[-2e12, 1]"), HasSubstr("'-2000000000000.0' is out of range"));
  EXPECT_EQ(with("[[1, 0], [1, -2]]", R"({"a": 1, "b": 2})"),
            "c.json: key 'matrix' has no rows: expected 2, one per joint");
  EXPECT_THAT(with("[[1, 0], [1, -2]]", "7"), HasSubstr("key 'matrix' has no rows"));
  EXPECT_THAT(with("\"J2 counts from above\"", R"({"matrix": 1})"), HasSubstr("is no text"));
}

TEST(JointConventions, ThatCameFromNoFileHoldTogether) {
  const JointConvention sound = parse_joint_convention(kPendant);
  const auto refused = [&](const std::function<void(JointConvention&)>& spoil) {
    JointConvention spoilt = sound;
    spoil(spoilt);
    return message_of([&] { matched_convention(spoilt, kJoints); });
  };
  const double infinite = std::numeric_limits<double>::infinity();
  EXPECT_EQ(refused([](auto&) {}), "nothing was refused");
  EXPECT_THAT(refused([](auto& c) { c.controller_joints.emplace_back("J3"); }),
              HasSubstr("3 controller joints of a convention, expected 2"));
  EXPECT_THAT(refused([](auto& c) { c.matrix.resize(3, 2); }),
              HasSubstr("3 rows of a convention's matrix, expected 2"));
  EXPECT_THAT(refused([](auto& c) { c.matrix.resize(2, 1); }),
              HasSubstr("1 columns of a convention's matrix, expected 2"));
  EXPECT_THAT(refused([](auto& c) { c.offset.resize(3); }), HasSubstr("3 offsets of a convention, expected 2"));
  EXPECT_THAT(refused([&](auto& c) { c.matrix(1, 0) = infinite; }), HasSubstr("not finite"));
  EXPECT_THAT(refused([&](auto& c) { c.offset[1] = -infinite; }), HasSubstr("not finite"));
}

TEST(MeasurementsCsv, WritesOnlyTheColumnsInUse) {
  EXPECT_EQ(measurements_csv(parse(kHeader + "c1,A,0.1,-2e-7,1,2,3\n")), kHeader + "c1,A,0.1,-2e-07,1,2,3\n");
  const std::string full =
      "configuration,split,repeat,target,joint_1,joint_2[m],x[m],y[m],z[m],qw,qx,qy,qz,sigma[m]\n"
      "c1,train,1,A,0.1,2,1,2,3,1,0,0,0,\nc2,test,3,A,0.2,2,1,2,3,,,,,0.5\n";
  EXPECT_EQ(measurements_csv(parse(full)), full);
}

// Whichever row is the one that differs.
TEST(MeasurementsCsv, WritesAColumnThatAnyRowNeeds) {
  const std::string header = "configuration,split,repeat,target,joint_1[rad],joint_2[rad],x[m],y[m],z[m],sigma[m]\n";
  const std::vector<std::string> rows = {"c1,train,2,A,0.1,0.2,1,2,3,\n", "c1,train,1,A,0.1,0.2,1,2,3,\n",
                                         "c2,test,1,A,0.3,0.2,1,2,3,\n", "c3,train,1,A,0.4,0.2,1,2,3,0.5\n",
                                         "c4,train,1,A,0.5,0.2,1,2,3,\n"};
  for (std::size_t first = 0; first < rows.size(); ++first) {
    std::string csv = header;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      csv += rows[(first + i) % rows.size()];
    }
    EXPECT_EQ(measurements_csv(parse(csv)), csv) << first;
  }
}

TEST(MeasurementsCsv, ReadsBackToTheSameDoubles) {
  Random random(3);
  Measurements m;
  m.joints = kJoints;
  m.joint_units = {JointUnit::radian, JointUnit::metre};
  m.targets = {"A", "B, \"right\"", "#3"};
  const int configurations = 200;
  m.joint_values.resize(2, configurations);
  for (std::int32_t c = 0; c < configurations; ++c) {
    m.configurations.push_back(c % 2 == 0 ? "# " + std::to_string(c) + "; " : " c" + std::to_string(c));
    for (int j = 0; j < 2; ++j) m.joint_values(j, c) = random.normal() * std::pow(10.0, random.uniform(-300, 11));
    for (std::int32_t t = 0; t < 3; ++t) {
      Observation o{.reading = Point{{random.normal(), random.normal() * 1e-9, random.normal() * 1e6}}};
      o.sigma = random.uniform() < 0.5 ? 0.0 : random.uniform(1e-6, 1e-3);
      o.configuration = c;
      o.target = t;
      o.repeat = 1 + static_cast<std::int32_t>(random.bits() % 5U);
      o.split = c % 3 == 0 ? Split::test : Split::train;
      const Eigen::Vector4d q{random.normal(), random.normal(), random.normal(), random.normal()};
      if (t != 1) set_orientation(o, Orientation(Eigen::Vector4d(q / q.norm())));
      m.observations.push_back(o);
    }
  }
  expect_same(parse(measurements_csv(m)), m);
}

TEST(MeasurementsCsv, KeepsTheExtremesOfTheNumberRange) {
  Measurements m = parse(kHeader + "c1,A,0,0,0,0,0\n");
  m.joint_values << -0.0, std::numeric_limits<double>::denorm_min();
  m.observations[0].position() << -1e12, std::numeric_limits<double>::min(), std::nextafter(1.0, 2.0);
  expect_same(parse(measurements_csv(m)), m);
}

TEST(MeasurementsCsv, RefusesLabelsThatTheFormatCannotHold) {
  Measurements m = parse(kHeader + "c1,A,0,0,0,0,0\n");
  m.source = "m.csv";
  m.configurations[0] = "a\nb";
  EXPECT_REFUSED("configuration 'a\\x0ab' has a control character", measurements_csv(m));
  m.configurations[0] = "c1";
  m.targets[0] = "";
  EXPECT_REFUSED("target '' is empty", measurements_csv(m));
  m.targets[0] = "A";
  m.joints[1] = "x";
  EXPECT_REFUSED("joint 'x' is named like a column", measurements_csv(m));
}

TEST(MeasurementsSubset, KeepsTheChosenRowsAndDropsEmptyConfigurations) {
  const Measurements m = parse(
      "configuration,split,target,joint_1[rad],joint_2[mm],x,y,z,qw,qx,qy,qz\n"
      "a,test,A,1,2000,0,0,1,1,0,0,0\nb,train,B,3,4000,0,0,2,,,,\nb,train,A,3,4000,0,0,3,0,1,0,0\n"
      "c,train,A,5,6000,0,0,4,,,,\n");
  const Measurements train = subset(m, [](const Observation& o) { return o.split == Split::train; });
  EXPECT_THAT(train.configurations, ElementsAre("b", "c"));
  EXPECT_THAT(train.targets, ElementsAre("A", "B"));
  EXPECT_EQ(train.joints, m.joints);
  EXPECT_EQ(train.joint_units, m.joint_units);
  EXPECT_EQ(train.joint_values, (Eigen::Matrix2d() << 3, 5, 4, 6).finished());
  ASSERT_EQ(train.observations.size(), 3U);
  EXPECT_EQ(train.observations[1].position().z(), 3.0);
  EXPECT_EQ(train.observations[1].configuration, 0);
  EXPECT_EQ(train.observations[2].configuration, 1);
  EXPECT_EQ(train.observations[0].target, 1);
  EXPECT_FALSE(has_orientation(train.observations[0]));
  EXPECT_EQ(orientation_of(train.observations[1]).x(), 1.0);
  EXPECT_FALSE(has_orientation(train.observations[2]));

  const Measurements last = subset(m, [](const Observation& o) { return o.configuration == 2; });
  EXPECT_FALSE(has_orientations(last));
  EXPECT_THAT(last.targets, ElementsAre("A", "B"));

  const Measurements none = subset(m, [](const Observation&) { return false; });
  EXPECT_THAT(none.configurations, IsEmpty());
  EXPECT_THAT(none.observations, IsEmpty());
  EXPECT_EQ(none.joint_values.rows(), 2);
  EXPECT_EQ(none.joint_values.cols(), 0);
  expect_same(subset(m, [](const Observation&) { return true; }), m);
}

TEST(MeasurementsAveraged, IsTheMeanOverTheRepeats) {
  const Measurements m = parse(
      "configuration,split,repeat,target,joint_1,joint_2,x,y,z,sigma\n"
      "a,train,1,B,1,2,1,0,5,0.003\na,train,2,B,1,2,3,2,7,0.004\n"
      "b,test,3,B,1,2,9,9,9,0.1\na,train,2,A,1,2,4,4,4,\na,train,3,A,1,2,6,6,6,0.1\n");
  const Measurements means = averaged(m);
  EXPECT_EQ(means.configurations, m.configurations);
  ASSERT_EQ(means.observations.size(), 3U);
  EXPECT_EQ(means.observations[0].position(), Eigen::Vector3d(2, 1, 6));
  EXPECT_EQ(means.observations[0].target, 0);
  EXPECT_NEAR(means.observations[0].sigma, 0.0025, 1e-18);
  EXPECT_EQ(means.observations[1].position(), Eigen::Vector3d(5, 5, 5));
  EXPECT_EQ(means.observations[1].sigma, 0.0);
  EXPECT_EQ(means.observations[2].position(), Eigen::Vector3d(9, 9, 9));
  EXPECT_EQ(means.observations[2].sigma, 0.1);
  EXPECT_EQ(means.observations[2].split, Split::test);
  for (const Observation& o : means.observations) EXPECT_EQ(o.repeat, 1);
}

// Turned by 0.1 and 0.3 about one axis: the mean is turned by 0.2, and its quaternion is on the side of the first.
TEST(MeasurementsAveraged, AveragesOrientationsWhateverTheirSign) {
  const Eigen::Vector3d axis = Eigen::Vector3d(1, -2, 0.5).normalized();
  Measurements m = parse(
      "configuration,repeat,target,joint_1,joint_2,x,y,z\n"
      "a,1,A,1,2,0,0,0\na,2,A,1,2,0,0,0\na,3,A,1,2,0,0,0\nb,1,A,1,3,0,0,0\nc,1,A,1,3,0,0,0\n");
  const Eigen::Quaterniond only(Eigen::AngleAxisd(0.7, axis));
  set_orientation(m.observations[3], only);
  for (const double first : {1.0, -1.0}) {
    for (const double second : {1.0, -1.0}) {
      const auto turned_by = [&](double angle, double sign) -> Eigen::Vector4d {
        return sign * Eigen::Quaterniond(Eigen::AngleAxisd(angle, axis)).coeffs();
      };
      set_orientation(m.observations[0], Orientation(turned_by(0.1, first)));
      set_orientation(m.observations[2], Orientation(turned_by(0.3, second)));
      const std::vector<Observation> means = averaged(m).observations;
      ASSERT_EQ(means.size(), 3U);
      EXPECT_NEAR((orientation_of(means[0]).coeffs() - turned_by(0.2, first)).norm(), 0.0, 1e-14);
      EXPECT_EQ(orientation_of(means[1]).coeffs(), only.coeffs());
      EXPECT_FALSE(has_orientation(means[2]));
    }
  }
}

Measurements fanuc_tracker() {
  const JointConvention serial = read_joint_convention(URDF_DIR "/fanuc_r2000ic_165f_serial.json");
  return read_measurements(SHARED_DATA_DIR "/r2000ic_165f_tracker/measurements.csv", serial.urdf_joints, &serial);
}

TEST(MeasurementsOnRealData, ReadsTheFanucTrackerSeries) {
  const Measurements m = fanuc_tracker();
  EXPECT_EQ(m.configurations.size(), 24U);
  EXPECT_THAT(m.targets, ElementsAre("A", "B", "C"));
  ASSERT_EQ(m.observations.size(), 720U);
  std::map<std::tuple<int, int>, std::set<int>> repeats;
  for (const Observation& o : m.observations) {
    repeats[{o.configuration, o.target}].insert(o.repeat);
    EXPECT_EQ(o.split, Split::train);
  }
  EXPECT_EQ(repeats.size(), 72U);
  for (const auto& [group, values] : repeats) EXPECT_THAT(values, ElementsAre(1, 2, 3, 4, 5, 6, 7, 8, 9, 10));
  EXPECT_FALSE(has_orientations(m));
  // The first row of the file, with q = [J1, -J2, J3, -J4, J5, -J6].
  Eigen::VectorXd q(6);
  q << 0.785398163397, -0.461999124978, 0.116125481781, 2.87422741081, -0.493945631607, -4.91364289643;
  EXPECT_EQ(m.joint_values.col(0), q);
  EXPECT_EQ(m.observations[0].position(), Eigen::Vector3d(1.107234, 1.279674, 1.325723));
  const double degree = std::numbers::pi / 180.0;
  EXPECT_NEAR(m.joint_values.row(0).minCoeff(), 26 * degree, degree);
  EXPECT_NEAR(m.joint_values.row(0).maxCoeff(), 45 * degree, degree);
}

TEST(MeasurementsOnRealData, MeansAndRepeatScatterAreThePublishedOnes) {
  const Measurements m = fanuc_tracker();
  const Measurements means = averaged(m);
  ASSERT_EQ(means.observations.size(), 72U);
  std::map<std::tuple<int, int>, Eigen::Vector3d> mean;
  for (const Observation& o : means.observations) mean[{o.configuration, o.target}] = o.position();
  Eigen::Vector3d squares = Eigen::Vector3d::Zero();
  for (const Observation& o : m.observations) {
    squares += (o.position() - mean.at({o.configuration, o.target})).cwiseAbs2();
  }
  const Eigen::Vector3d scatter = (squares / (720.0 - 72.0)).cwiseSqrt();
  EXPECT_NEAR(scatter.x(), 59e-6, 1e-6);
  EXPECT_NEAR(scatter.y(), 60e-6, 1e-6);
  EXPECT_NEAR(scatter.z(), 33e-6, 1e-6);
}

TEST(MeasurementsOnRealData, ReadsTheUr10Poses) {
  const Measurements m = read_measurements(
      SHARED_DATA_DIR "/ur10_tracker_poses/measurements.csv",
      {"shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint"});
  EXPECT_EQ(m.configurations.size(), 397U);
  EXPECT_EQ(m.observations.size(), 397U);
  EXPECT_THAT(m.targets, ElementsAre("tmac"));
  for (const Observation& o : m.observations) EXPECT_NEAR(orientation_of(o).norm(), 1.0, 1e-15);
  EXPECT_EQ(m.observations[0].split, Split::train);
  EXPECT_EQ(m.observations[1].split, Split::test);
  EXPECT_EQ(m.joint_values(1, 1), -2.73828);
  EXPECT_NEAR(orientation_of(m.observations[0]).w(), -0.578436625, 1e-8);
}

/// Rows "configuration,target,repeat,split,order" of configurations 0, 1, ... that stand at 10 c and -c.
Measurements rows_of(const std::vector<std::array<int, 5>>& rows) {
  Measurements m{.source = "m.csv", .joints = kJoints, .targets = {"A", "B"}};
  int last = 0;
  for (const auto& [configuration, target, repeat, split, order] : rows) {
    m.observations.push_back({.reading = Point{Eigen::Vector3d(order, configuration, target)},
                              .order = order,
                              .configuration = configuration,
                              .target = target,
                              .repeat = repeat,
                              .split = split == 0 ? Split::train : Split::test});
    last = std::max(last, configuration);
  }
  m.joint_values.resize(2, last + 1);
  for (int c = 0; c <= last; ++c) {
    m.configurations.push_back("c" + std::to_string(c));
    m.joint_values.col(c) << 10.0 * c, -c;
  }
  return m;
}

TEST(MeasurementsSubset, KeepsTheSourceAndTheOrderOfTheRowsKept) {
  const Measurements m = rows_of({{0, 0, 1, 0, 5}, {1, 0, 1, 0, 3}, {0, 1, 1, 0, 9}, {2, 0, 1, 0, 1}});
  const Measurements kept = subset(m, [](const Observation& o) { return o.configuration != 1; });
  EXPECT_EQ(kept.source, "m.csv");
  EXPECT_THAT(order_of(kept), ElementsAre(5, 9, 1));
  EXPECT_THAT(kept.configurations, ElementsAre("c0", "c2"));
}

TEST(MeasurementsAveraged, HasTheOrderOfTheFirstRowOfEachMean) {
  const Measurements m = rows_of({{1, 0, 1, 0, 5}, {0, 1, 1, 0, 3}, {1, 0, 2, 0, 9}, {0, 0, 1, 0, 1}, {0, 1, 2, 0, 7}});
  const Measurements means = averaged(m);
  EXPECT_THAT(order_of(means), ElementsAre(1, 3, 5));
  EXPECT_EQ(means.observations[1].position().x(), 5.0);
}

TEST(TrainedConfigurations, AreThoseWithTrainingRows) {
  const Measurements m = rows_of({{0, 0, 1, 1, 1}, {1, 0, 1, 0, 2}, {1, 1, 1, 0, 3}, {2, 0, 1, 1, 4}, {3, 0, 1, 0, 5}});
  EXPECT_THAT(trained_configurations(m), ElementsAre(false, true, false, true));
}

TEST(TrainingSample, IsEvenlySpacedOverTheConfigurationsWithTrainingRows) {
  std::vector<std::array<int, 5>> rows;
  for (int c = 0; c < 12; ++c) {
    rows.push_back({c, 0, 1, c % 4 == 1 ? 1 : 0, c});  // 0 2 3 4 6 7 8 10 11 have some
    rows.push_back({c, 1, 1, c % 4 == 1 ? 1 : 0, c});
  }
  const Measurements m = rows_of(rows);
  const auto sampled = [&](std::size_t most) { return training_sample(m, most).configurations; };
  EXPECT_THAT(sampled(4), ElementsAre("c0", "c3", "c6", "c8"));
  EXPECT_THAT(sampled(3), ElementsAre("c0", "c4", "c8"));
  EXPECT_THAT(sampled(1), ElementsAre("c0"));
  EXPECT_THAT(sampled(0), IsEmpty());
  const std::vector<std::string> all = {"c0", "c2", "c3", "c4", "c6", "c7", "c8", "c10", "c11"};
  EXPECT_EQ(sampled(9), all);
  EXPECT_EQ(sampled(100), all);
  EXPECT_EQ(training_sample(m, 4).observations.size(), 8U);
}

TEST(ApproachDirections, CountEachVisitOnceAndKeepTheOrderOfTheFileAmongEquals) {
  // Driven 2, 0, 2 (both targets), 1: two visits of 2, of which the second came from below.
  const Measurements m =
      rows_of({{2, 0, 1, 0, 1}, {0, 0, 1, 0, 2}, {2, 0, 2, 0, 4}, {2, 1, 2, 0, 4}, {1, 0, 1, 0, 4}, {2, 1, 3, 0, 0}});
  const Eigen::MatrixXd found = approach_directions(m);
  const Eigen::MatrixXd expected = (Eigen::MatrixXd(2, 3) << -1, -1, 1, 1, 1, -1).finished();
  EXPECT_EQ(found, expected) << found;
  // From both sides, once with two rows and once with one.
  const Eigen::MatrixXd both = approach_directions(
      rows_of({{0, 0, 1, 0, 0}, {1, 0, 1, 0, 1}, {1, 1, 1, 0, 2}, {2, 0, 1, 0, 3}, {1, 0, 2, 0, 4}}));
  EXPECT_EQ(both.col(1), Eigen::Vector2d::Zero()) << both;
  // The only row of the start is the first of the file.
  const Eigen::MatrixXd first = approach_directions(rows_of({{1, 0, 1, 0, 0}, {0, 0, 1, 0, 1}}));
  EXPECT_EQ(first(0, 0), -1.0);
  EXPECT_TRUE(std::isnan(first(0, 1)));
  Measurements fewer = m;
  fewer.observations.back().order.reset();
  EXPECT_REFUSED("observation 5: some rows have a place in the order", approach_directions(fewer));
}

TEST(TrainedRanges, AreThoseOfTheTrainingRows) {
  const Measurements m = rows_of({{0, 0, 1, 1, 1}, {1, 0, 1, 0, 2}, {3, 0, 1, 0, 3}, {2, 0, 1, 0, 4}, {4, 0, 1, 1, 5}});
  const JointRanges expected = {{10.0, 30.0}, {-3.0, -1.0}};
  EXPECT_EQ(trained_ranges(m), expected);
  const JointRanges none = trained_ranges(rows_of({{0, 0, 1, 1, 1}}));
  ASSERT_EQ(none.size(), 2U);
  for (const auto& [least, largest] : none) {
    EXPECT_EQ(least, std::numeric_limits<double>::infinity());
    EXPECT_EQ(largest, -std::numeric_limits<double>::infinity());
  }
}

TEST(JoinedMeasurements, StandBehindEachOther) {
  Measurements first = rows_of({{0, 0, 1, 0, 1}, {1, 1, 1, 0, 2}, {1, 0, 1, 0, 3}});
  Measurements second = rows_of({{1, 0, 1, 1, 8}, {0, 1, 4, 1, 9}});
  second.joint_values *= 3.0;
  first.signals.torques = (Eigen::MatrixXd(2, 2) << 1, 2, 3, 4).finished();
  second.signals.torques = (Eigen::MatrixXd(2, 2) << 5, 6, 7, 8).finished();
  const Measurements both = joined(first, second);
  EXPECT_THAT(both.configurations, ElementsAre("c0", "c1", "3", "4"));
  EXPECT_EQ(both.joint_values, (Eigen::MatrixXd(2, 4) << 0, 10, 0, 30, 0, -1, 0, -3).finished());
  ASSERT_EQ(both.observations.size(), 5U);
  EXPECT_EQ(both.observations[2].configuration, 1);
  EXPECT_EQ(both.observations[3].configuration, 3);
  EXPECT_EQ(both.observations[4].configuration, 2);
  EXPECT_EQ(both.observations[4].repeat, 4);
  EXPECT_EQ(both.observations[4].split, Split::test);
  EXPECT_THAT(order_of(both), ElementsAre(1, 2, 3, 8, 9));
  EXPECT_EQ(both.signals.torques, (Eigen::MatrixXd(2, 4) << 1, 2, 5, 6, 3, 4, 7, 8).finished());
  EXPECT_FALSE(has_orientations(both));
}

TEST(JoinedMeasurements, KeepTheOrderIfBothHaveOneAndEachOrientation) {
  const Measurements plain = rows_of({{0, 0, 1, 0, 1}, {1, 1, 1, 0, 2}});
  Measurements poses = without_order(rows_of({{0, 0, 1, 0, 1}}));
  set_orientations(poses, Orientation(0, 1, 0, 0));
  const auto kinds = [](const Measurements& m) {
    std::string text;
    for (const Observation& o : m.observations) text += has_orientation(o) ? 'o' : 'p';
    return text;
  };
  EXPECT_EQ(kinds(joined(plain, poses)), "ppo");
  EXPECT_EQ(kinds(joined(poses, plain)), "opp");
  EXPECT_EQ(kinds(joined(poses, poses)), "oo");
  EXPECT_THAT(order_of(joined(plain, poses)), IsEmpty());
  EXPECT_THAT(order_of(joined(poses, plain)), IsEmpty());
}

TEST(JoinedMeasurements, AreOfTheSameJointsAndTargets) {
  const Measurements m = rows_of({{0, 0, 1, 0, 1}});
  Measurements nameless = m;
  nameless.joints.clear();
  EXPECT_EQ(joined(m, nameless).joints, kJoints);
  EXPECT_THAT(joined(nameless, m).joints, IsEmpty());
  Measurements others = m;
  others.joints[1] = "other";
  EXPECT_REFUSED("the second measurements have other joints or targets", joined(m, others));
  Measurements more = nameless;
  more.joint_values.conservativeResize(3, Eigen::NoChange);
  more.joint_values.row(2).setZero();
  EXPECT_REFUSED("3 joints of the second measurements, expected 2", joined(m, more));
}

TEST(MeasurementsCheck, SaysWhatIsWrongWithWhichRow) {
  const Measurements sound = rows_of({{0, 0, 1, 0, 1}, {1, 1, 1, 0, 2}, {2, 0, 1, 0, 3}});
  const auto refused = [&](const std::function<void(Measurements&)>& spoil) {
    Measurements spoilt = sound;
    spoil(spoilt);
    return message_of([&] { check(spoilt); });
  };
  EXPECT_EQ(refused([](auto&) {}), "nothing was refused");
  const std::string gone = " is not there, expected 0 to ";
  for (const std::size_t row : {std::size_t{0}, std::size_t{2}}) {
    const std::string where = "m.csv: observation " + std::to_string(row) + ": ";
    for (const int number : {-1, 3}) {
      EXPECT_EQ(refused([&](auto& m) { m.observations[row].configuration = number; }),
                where + "configuration " + std::to_string(number) + gone + "2");
    }
    for (const int number : {-1, 2}) {
      EXPECT_EQ(refused([&](auto& m) { m.observations[row].target = number; }),
                where + "target " + std::to_string(number) + gone + "1");
    }
    EXPECT_EQ(refused([&](auto& m) { m.observations[row].sigma = -1e-9; }),
              where + "sigma is negative or not finite, expected 0 where none is stated");
  }
  EXPECT_EQ(refused([](auto& m) { m.joints.pop_back(); }), "m.csv: 1 names of joints, expected 2, one for each");
  EXPECT_EQ(refused([](auto& m) {
              m.source.clear();
              m.joint_units = {JointUnit::metre};
            }),
            "measurements: 1 units of joints, expected 2, one for each");
  for (const double norm : {0.9991, 1.0009, 0.9989, 1.0011}) {
    const std::string found = refused([&](auto& m) {
      set_orientation(m.observations[1], Orientation(norm, 0, 0, 0));
      set_orientation(m.observations[2], Orientation::Identity());
    });
    EXPECT_EQ(found, std::abs(norm - 1.0) < 1e-3 ? "nothing was refused"
                                                 : "m.csv: observation 1: the orientation is no unit quaternion")
        << norm;
  }
}

TEST(TrainingRows, AreTheMeasurementsThemselvesWhereThereIsNothingElse) {
  const Measurements all = rows_of({{0, 0, 1, 0, 1}, {1, 0, 1, 0, 2}});
  const TrainingRows training(all);
  EXPECT_EQ(&*training, &all);
  EXPECT_FALSE(training.has_others());
  EXPECT_THAT(training.values_of({1, 2}), ElementsAre(1, 2));
  EXPECT_THAT(training.values_among_all({1, 2}, 7.0), ElementsAre(1, 2));
}

TEST(TrainingRows, OfWhatDoesNotHoldTogetherAreRefusedBeforeAnyIsTaken) {
  const Measurements sound = rows_of({{0, 0, 1, 0, 1}, {1, 0, 1, 1, 2}, {2, 0, 1, 0, 3}});
  Measurements turned = sound;
  set_orientation(turned.observations[1], Orientation(2, 0, 0, 0));
  EXPECT_REFUSED("observation 1: the orientation is no unit quaternion", TrainingRows(turned));
  Measurements fewer = sound;
  fewer.observations[1].order.reset();
  EXPECT_REFUSED("observation 1: some rows have a place in the order", TrainingRows(fewer));
}

TEST(TrainingRows, KeepTheNumbersOfConfigurationsAndTargets) {
  Measurements all =
      rows_of({{0, 0, 1, 0, 10}, {0, 1, 1, 1, 9}, {1, 0, 1, 1, 8}, {1, 1, 1, 1, 7}, {2, 0, 1, 0, 6}, {2, 1, 1, 0, 5}});
  set_orientations(all, Orientation::Identity());
  remove_orientation(all.observations[2]);
  const TrainingRows training(all);
  ASSERT_TRUE(training.has_others());
  const Measurements& rows = *training;
  EXPECT_EQ(rows.configurations, all.configurations);
  EXPECT_EQ(rows.joint_values, all.joint_values);
  ASSERT_EQ(rows.observations.size(), 3U);
  const std::vector<std::size_t> expected = {0, 4, 5};
  for (std::size_t i = 0; i < 3; ++i) {
    const Observation& observation = all.observations[expected[i]];
    EXPECT_EQ(rows.observations[i].position(), observation.position()) << i;
    EXPECT_EQ(rows.observations[i].configuration, observation.configuration) << i;
    EXPECT_EQ(rows.observations[i].target, observation.target) << i;
  }
  EXPECT_THAT(order_of(rows), ElementsAre(10, 6, 5));
  EXPECT_TRUE(std::all_of(rows.observations.begin(), rows.observations.end(), has_orientation));
  EXPECT_THAT(training.values_of({1, 2, 3, 4, 5, 6}), ElementsAre(1, 5, 6));
  EXPECT_THAT(training.values_among_all({1, 5, 6}, 0.0), ElementsAre(1, 0, 0, 0, 5, 6));
  EXPECT_TRUE(training.values_of({}).empty());
  EXPECT_TRUE(training.values_among_all({}, 0.0).empty());
  EXPECT_REFUSED("1 values of rows", training.values_of({1.0}));
  EXPECT_REFUSED("2 values of training rows, expected 3", training.values_among_all({1.0, 2.0}, 0.0));
}

TEST(JointConventions, RandomDamageGivesAResultOrAnInputError) {
  const std::string alphabet = "{}[]\",:0123456789.eE-+ \n\\ntrue\xff" + std::string(1, '\0');
  Random random(12);
  int errors = 0;
  for (int round = 0; round < 5000; ++round) {
    try {
      ASSERT_TRUE(parse_joint_convention(damaged(kPendant, alphabet, random)).matrix.allFinite());
    } catch (const InputError& error) {
      ASSERT_EQ(std::string(error.what()).find('\n'), std::string::npos);
      ++errors;
    }
  }
  EXPECT_GT(errors, 1000);
}

}  // namespace
}  // namespace kdl_calibration::measurements_test
