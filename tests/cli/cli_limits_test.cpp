// Limits at their exact value, on both sides: what is just allowed is read, what is just beyond is refused by its name.
// What the readers' own tests cover is not repeated: the length of a line (measurements_test.cpp), the number of
// joints in a URDF and the size of measurements (cli_robust_test.cpp).

#include <limits>

#include "cli_support.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "kdl_calibration/measuring_plan.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::testing::cli_limits_test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using Words = std::vector<std::string>;

// ---- Options -------------------------------------------------------------------------------------------------------

class ExactLimits : public CommandLine {
protected:
  /// The command takes all these options, "--name=value": what fails is the robot, which is read later.
  void accepts(const Words& command, const Words& options) {
    Words words = command;
    words.insert(words.end(), options.begin(), options.end());
    words.insert(words.end(), {"--urdf", "none.urdf"});
    const Outcome outcome = run(words);
    EXPECT_EQ(outcome.status, 2);
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("none.urdf"), Not(HasSubstr("--")))) << ::testing::PrintToString(options);
  }

  void refuses(const Words& command, const std::string& option, const Words& values) {
    for (const std::string& value : values) {
      Words words = command;
      words.insert(words.end(), {option + "=" + value, "--urdf", "none.urdf"});
      expect_refused(words, {option, "'" + value + "'", "expected"});
    }
  }

  void refuses_beyond(const Words& command, const std::string& option, long least, long most) {
    refuses(command, option, {std::to_string(least - 1), std::to_string(most + 1)});
  }

  /// Sigmas or lengths: 0, or from 1e-15 to 1e12.
  void sigmas(const Words& command, const Words& options) {
    for (const std::string value : {"0", "1e-15", "1e12"}) {
      Words given = options;
      for (std::string& option : given) {
        option += "=" + value;
      }
      accepts(command, given);
    }
    for (const std::string& option : options) {
      refuses(command, option, {"0.99e-15", "-1e-15", "1.000000000001e12"});
    }
  }
};

TEST_F(ExactLimits, OfCountsInSimulations) {
  accepts({"model"}, {"--targets=1"});
  accepts({"model"}, {"--targets=100"});
  refuses_beyond({"model"}, "--targets", 1, 100);
  const Words simulate = {"simulate"};
  accepts(simulate, {"--configurations=1", "--test-configurations=0", "--targets=1", "--repeats=1", "--monte-carlo=0",
                     "--threads=0", "--seed=0"});
  accepts(simulate, {"--configurations=100000", "--test-configurations=100000", "--monte-carlo=1000000",
                     "--threads=1024", "--seed=9223372036854775807"});
  accepts(simulate, {"--targets=100", "--repeats=1000"});
  refuses_beyond(simulate, "--configurations", 1, 100'000);
  refuses_beyond(simulate, "--test-configurations", 0, 100'000);
  refuses_beyond(simulate, "--targets", 1, 100);
  refuses_beyond(simulate, "--repeats", 1, 1'000);
  refuses_beyond(simulate, "--monte-carlo", 0, 1'000'000);
  refuses_beyond(simulate, "--threads", 0, 1'024);
  refuses(simulate, "--seed", {"-1", "9223372036854775808"});
}

TEST_F(ExactLimits, OfCountsInCalibrations) {
  const Words calibrate = {"calibrate", "--measurements", "m.csv"};
  accepts(calibrate, {"--iterations=1", "--k-fold=2", "--threads=0"});
  accepts(calibrate, {"--iterations=1000000", "--k-fold=1000", "--threads=1024"});
  refuses_beyond(calibrate, "--iterations", 1, 1'000'000);
  refuses_beyond(calibrate, "--k-fold", 2, 1'000);
  refuses_beyond(calibrate, "--threads", 0, 1'024);
}

TEST_F(ExactLimits, OfTheDirectionOfGravity) {
  const Words calibrate = {"calibrate", "--measurements", "m.csv"};
  accepts(calibrate, {"--gravity-direction=-1000000,0,1000000"});
  for (const std::string value : {"-1000001", "1000001"}) {
    expect_refused(
        {"calibrate", "--measurements", "m.csv", "--urdf", "none.urdf", "--gravity-direction", "0,0," + value},
        {"--gravity-direction", "'" + value + "'", "expected a number"});
  }
}

TEST_F(ExactLimits, OfCountsInPlans) {
  const Words plan = {"plan"};
  const Words more = {"plan", "--measured", "m.csv"};
  accepts(plan, {"--configurations=1", "--candidates=1", "--workspace=1", "--starts=1", "--targets=1",
                 "--monte-carlo=0", "--threads=0", "--seed=0"});
  accepts(plan, {"--configurations=2000", "--candidates=1000000", "--workspace=100000", "--starts=1000",
                 "--targets=100", "--monte-carlo=100000", "--threads=1024", "--seed=9223372036854775807"});
  accepts(more, {"--add=1"});
  accepts(more, {"--add=2000"});
  refuses_beyond(plan, "--configurations", 1, 2'000);
  refuses_beyond(more, "--add", 1, 2'000);
  refuses_beyond(plan, "--candidates", 1, 1'000'000);
  refuses_beyond(plan, "--workspace", 1, 100'000);
  refuses_beyond(plan, "--starts", 1, 1'000);
  refuses_beyond(plan, "--targets", 1, 100);
  refuses_beyond(plan, "--monte-carlo", 0, 100'000);
  refuses_beyond(plan, "--threads", 0, 1'024);
  refuses(plan, "--seed", {"-1", "9223372036854775808"});
}

TEST_F(ExactLimits, OfSigmas) {
  sigmas({"simulate"},
         {"--noise", "--orientation-noise", "--length-sigma", "--angle-sigma", "--base-sigma", "--target-sigma"});
  sigmas({"simulate"}, {"--angle-sigma-deg"});  // instead of another
  sigmas({"calibrate", "--measurements", "m.csv"}, {"--prior-length", "--prior-angle", "--noise-independent",
                                                    "--noise-common", "--noise-tracker", "--orientation-sigma"});
  sigmas({"plan"}, {"--configuration-noise", "--prior-length", "--prior-angle", "--noise-tracker"});
}

TEST_F(ExactLimits, OfLengthsAndAnglesInPlans) {
  const Words plan = {"plan"};
  accepts(plan, {"--noise=1e-12", "--accuracy=1e-6", "--acceptance-angle=0", "--least-height=-1e6"});
  accepts(plan, {"--noise=1", "--accuracy=1e6", "--acceptance-angle=180", "--least-height=1e12"});
  refuses(plan, "--noise", {"0.99e-12", "1.001"});
  refuses(plan, "--accuracy", {"0.99e-6", "1000001"});
  refuses(plan, "--acceptance-angle", {"-0.001", "180.001"});
  refuses(plan, "--least-height", {"-1000001", "1.000000000001e12"});
  sigmas(plan, {"--least-radius", "--clearance", "--arm-radius", "--tool-radius"});
}

TEST_F(ExactLimits, OfSimulatedRows) {
  const Words simulate = {"simulate", "--configurations",     "99999", "--repeats", "100", "--targets", "1", "--plan",
                          "none.csv", "--test-configurations"};
  const auto with = [&](const std::string& test) {
    Words words = simulate;
    words.push_back(test);
    return words;
  };
  expect_refused(with("1"), {"none.csv", "No such file"});  // 10,000,000
  expect_refused(with("2"), {"10000100 rows, expected at most 10000000"});
}

// ---- Files ---------------------------------------------------------------------------------------------------------

TEST_F(ExactLimits, OfTextFilesAre64MiB) {
  constexpr std::uintmax_t kLimit = std::uintmax_t{64} << 20U;
  const std::string fact = "larger than the limit of 64 MiB";
  const Words fk = {"fk", "--joints", "0,0,0,0,0,0", "--joint-convention", "huge"};
  // A file of so many bytes that takes no room on the disk.
  const auto resize = [&](std::uintmax_t size) {
    write("huge", "");
    std::error_code error;
    std::filesystem::resize_file(directory / "huge", size, error);
    return !error;
  };
  const auto said = [&](const Words& command) {
    const Outcome outcome = run(command);
    EXPECT_EQ(outcome.status, 2);
    return outcome.err;
  };
  if (!resize(kLimit + 1)) {
    GTEST_SKIP() << "no room for a sparse file";
  }
  for (const Words& command : {Words{"model", "--urdf", "huge"}, Words{"simulate", "--target-file", "huge"}, fk}) {
    EXPECT_THAT(said(command), HasSubstr(fact));
  }
  // What has no size, like a pipe, is read so far.
  EXPECT_THAT(said({"fk", "--joints", "0,0,0,0,0,0", "--joint-convention", "/dev/zero"}), HasSubstr(fact));
  ASSERT_TRUE(resize(kLimit));
  EXPECT_THAT(said(fk), Not(HasSubstr(fact)));  // the same reader for all of them
}

TEST_F(ExactLimits, OfOptionFilesAre1MiB) {
  constexpr std::size_t kLimit = std::size_t{1} << 20U;
  const std::string option = "json = true\n";
  write("options.toml", option + std::string(kLimit - option.size(), '#'));
  const Words fk = {"fk", "--joints", "0,0,0,0,0,0", "--config", "options.toml"};
  EXPECT_EQ(run_json(fk)["frames"].size(), 7U);
  write("options.toml", option + std::string(kLimit - option.size() + 1, '#'));
  expect_refused(fk, {"options.toml", "larger than the limit of 1 MiB"});
}

std::string targets_json(int count) {
  std::string list;
  for (int i = 1; i <= count; ++i) {
    list += (i == 1 ? "" : ",") + (R"({"name": "T)" + std::to_string(i)) + R"(", "position": [0, 0, 0.)" +
            std::to_string(i) + "]}";
  }
  return "{\"targets\": [" + list + "]}";
}

TEST_F(ExactLimits, OfKnownTargetsAre100) {
  ASSERT_EQ(run({"simulate", "--configurations", "4", "--output", "m.csv"}).status, 0);
  const Words validate = {"validate", "--measurements", "m.csv", "--known-targets", "t.json"};
  write("t.json", targets_json(100));
  expect_refused(validate, {"t.json: targets: none was measured", "A, B, C"});
  write("t.json", targets_json(101));
  expect_refused(validate, {"t.json: targets: 101, expected at most 100"});
}

// ---- Readers -------------------------------------------------------------------------------------------------------

const Words kTwo = {"a", "b"};
const std::string kTaken = "nothing was refused";

std::string measured(const std::string& header, const std::string& row) {
  return refusal([&] { parse_measurements("configuration,target,a,b,x,y,z" + header + "\n" + row + "\n", kTwo); });
}

TEST(ExactLimitsOfReaders, ColumnsAre10000) {
  const auto with = [](std::size_t columns) {
    const std::string empty(columns - 7, ',');
    return measured(empty, "1,A,0,0,1,2,3" + empty);
  };
  EXPECT_EQ(with(10'000), kTaken);
  EXPECT_THAT(with(10'001), HasSubstr("limit of 10000 columns"));
}

TEST(ExactLimitsOfReaders, TargetsAre100) {
  std::string rows;
  for (int i = 1; i <= 100; ++i) {
    rows += "1,T" + std::to_string(i) + ",0,0,1,2,3\n";
  }
  EXPECT_EQ(measured("", rows), kTaken);
  EXPECT_THAT(measured("", rows + "1,T100a,0,0,1,2,3"), AllOf(HasSubstr(":102"), HasSubstr("limit of 100")));
}

TEST(ExactLimitsOfReaders, NumbersReach1e12) {
  for (const std::string sign : {"", "-"}) {
    EXPECT_EQ(measured("", "1,A,0,0,1," + sign + "1e12,3"), kTaken);
    EXPECT_THAT(measured("", "1,A,0,0,1," + sign + "1000000000000.001,3"), HasSubstr("at most 1e12"));
    EXPECT_EQ(measured("", "1,A,0," + sign + "1e12,1,2,3"), kTaken);
    EXPECT_THAT(measured("", "1,A,0," + sign + "1000000000000.001,1,2,3"), HasSubstr("at most 1e12"));
  }
}

TEST(ExactLimitsOfReaders, SigmasReachFrom1e_15To1e12) {
  for (const std::string value : {"1e-15", "1e12"}) {
    EXPECT_EQ(measured(",sigma", "1,A,0,0,1,2,3," + value), kTaken);
  }
  EXPECT_THAT(measured(",sigma", "1,A,0,0,1,2,3,0.99e-15"), HasSubstr("at least 1e-15"));
  EXPECT_THAT(measured(",sigma", "1,A,0,0,1,2,3,1000000000000.001"), HasSubstr("at most 1e12"));
}

TEST(ExactLimitsOfReaders, QuaternionsHaveNormOneToAThousandth) {
  for (const std::string norm : {"0.9991", "1.0009"}) {
    EXPECT_EQ(measured(",qw,qx,qy,qz", "1,A,0,0,1,2,3," + norm + ",0,0,0"), kTaken);
  }
  for (const std::string norm : {"0.9989", "1.0011"}) {
    EXPECT_THAT(measured(",qw,qx,qy,qz", "1,A,0,0,1,2,3," + norm + ",0,0,0"), HasSubstr("norm of the quaternion"));
  }
}

std::string diagonal_convention(int joints, const std::string& element, const std::string& offset) {
  std::string names;
  std::string rows;
  std::string offsets;
  for (int i = 0; i < joints; ++i) {
    const std::string comma = i == 0 ? "" : ",";
    names += comma + "\"" + std::to_string(i) + "\"";
    std::string row;
    for (int j = 0; j < joints; ++j) {
      row += (j == 0 ? "" : ",") + (i == j ? element : std::string("0"));
    }
    rows += comma + "[" + row + "]";
    offsets += comma + offset;
  }
  return R"({"controller_joints": [)" + names + R"(], "urdf_joints": [)" + names + R"(], "matrix": [)" + rows +
         R"(], "offset": [)" + offsets + "]}";
}

TEST(ExactLimitsOfReaders, ConventionsHave1000JointsAndNumbersUpTo1e12) {
  const auto refused = [](int joints, const std::string& element, const std::string& offset) {
    return refusal([&] { parse_joint_convention(diagonal_convention(joints, element, offset)); });
  };
  EXPECT_EQ(refused(2, "1e12", "-1e12"), kTaken);
  EXPECT_NE(refused(2, "1000000000000.001", "0"), kTaken);
  EXPECT_NE(refused(2, "1", "1000000000000.001"), kTaken);
  // The rows are counted after the names: that many are not needed for this.
  const auto names = [](int joints) {
    const std::string text = diagonal_convention(joints, "1", "0");
    return refusal(
        [&] { parse_joint_convention(text.substr(0, text.find("\"matrix\"")) + R"("matrix": [], "offset": []})"); });
  };
  EXPECT_THAT(names(1'000), AllOf(Not(HasSubstr("limit of 1000")), HasSubstr("matrix")));
  EXPECT_THAT(names(1'001), HasSubstr("limit of 1000 joints"));
}

TEST(ExactLimitsOfReaders, ValuesInJsonStandInside100Others) {
  const auto nested = [](std::size_t depth) {  // inside arrays and the object
    const std::string inside = std::string(depth - 1, '[') + "0" + std::string(depth - 1, ']');
    return refusal([&] { parse_joint_convention("{\"controller_joints\": " + inside + "}"); });
  };
  EXPECT_THAT(nested(100), Not(HasSubstr("deeper")));
  EXPECT_THAT(nested(101), HasSubstr("nested deeper than the limit of 100"));
}

TEST(ExactLimitsOfReaders, ElementsInXmlAreNestedLessThan100Deep) {
  const auto nested = [](int depth) {
    std::string inside;
    for (int i = 1; i < depth; ++i) {
      inside = "<a>" + inside + "</a>";
    }
    return refusal([&] { parse_robot("<robot name='r'>" + inside + "</robot>"); });
  };
  EXPECT_THAT(nested(98), Not(HasSubstr("deeply")));  // tinyxml2 counts the document and the end of the innermost too
  EXPECT_THAT(nested(101), HasSubstr("nested too deeply"));
}

TEST(ExactLimitsOfReaders, ChainsHave100MovingJoints) {
  const auto chain = [](int joints) {
    std::string text = "<robot name='r'><link name='l0'/>";
    for (int i = 1; i <= joints; ++i) {
      const std::string n = std::to_string(i);
      text += "<link name='l" + n + "'/><joint name='j" + n + "' type='continuous'><parent link='l" +
              std::to_string(i - 1) + "'/><child link='l" + n + "'/></joint>";
    }
    return text + "</robot>";
  };
  EXPECT_EQ(parse_robot(chain(100)).joints.size(), 100U);
  EXPECT_THAT(refusal([&] { parse_robot(chain(101)); }),
              AllOf(HasSubstr("101 moving joints"), HasSubstr("at most 100")));
}

TEST(ExactLimitsOfReaders, OriginsReach1e12) {
  const auto at = [](const std::string& x) {
    return refusal([&] {
      parse_robot(
          "<robot name='r'><link name='a'/><link name='b'/><joint name='j' type='continuous'><parent link='a'/>"
          "<child link='b'/><origin xyz='" +
          x + " 0 0'/></joint></robot>");
    });
  };
  EXPECT_EQ(at("1e12"), kTaken);
  EXPECT_EQ(at("-1e12"), kTaken);
  EXPECT_THAT(at("1000000000000.001"), HasSubstr("1e12"));
}

}  // namespace
}  // namespace kdl_calibration::testing::cli_limits_test
