// Standard error and exit status of each subcommand that can doubt: all lines of each case are expected, so that each
// warning appears in its own case and in no other.

#include <functional>
#include <numbers>

#include "base/json_tree.hpp"
#include "cli_options_support.hpp"
#include "kdl_calibration/measurements.hpp"
#include "planning/simulation.hpp"
#include "printed_text.hpp"
#include "validation/validation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::kdlcal_warnings_test {
namespace {

using ::testing::ElementsAreArray;
using ::testing::MatchesRegex;
using Arguments = std::vector<std::string>;

const std::string kWarning = "kdlcal: warning: ";
const std::string kSerial = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_serial.json";
const std::string kPendant = std::string(URDF_DIR) + "/fanuc_r2000ic_165f_pendant.json";

class CommandLineWarnings : public CommandLine {
protected:
  Measurements at(const Eigen::MatrixXd& q, const MeasuringNoise& noise = {.sigma = 3e-5}) {
    return without_sigmas(experiment.measure(q, noise));
  }

  /// Extended regular expressions of what follows "kdlcal: not to be trusted: ", then of what follows
  /// "kdlcal: warning: " on each line.
  Outcome expect(const Arguments& arguments, int status, const std::vector<std::string>& warnings,
                 const std::vector<std::string>& doubts = {}) {
    Outcome outcome = run(arguments);
    const std::string command = ::testing::PrintToString(arguments);
    EXPECT_EQ(outcome.status, status) << command << outcome.err;
    std::vector<::testing::Matcher<std::string>> lines;
    for (const std::string& doubt : doubts) {
      lines.push_back(MatchesRegex("kdlcal: not to be trusted: " + doubt));
    }
    for (const std::string& warning : warnings) {
      lines.push_back(MatchesRegex(kWarning + warning));
    }
    EXPECT_THAT(lines_of(outcome.err), ElementsAreArray(lines)) << command;
    EXPECT_NE(outcome.out, "") << command;
    return outcome;
  }

  VirtualExperiment experiment;
  Measurements measured = at(experiment.configurations(20));
};

const std::string kFileDoesNotSaySo =
    R"(c\.urdf comes from an answer that is not to be trusted; the file itself does not say so)";
const std::string kHint =
    R"(as they were read the measurements leave a misfit of [0-9.]+ mm(| with its geometry fitted); with the convention )"
    R"(fanuc_r2000ic_165f_serial\.json it is [0-9.]+ mm; the input was used as read)";

TEST_F(CommandLineWarnings, CalibrateIsSilentAboutCleanData) {
  write("m.csv", measurements_csv(measured));
  expect({"calibrate", "--measurements", "m.csv", "--output", "c.urdf", "--leave-one-out"}, 0, {});
  write("serial.csv", in_controller_joints(measured, content(kSerial)));
  const Outcome outcome = expect({"calibrate", "--measurements", "serial.csv", "--joint-convention", kSerial}, 0, {});
  EXPECT_THAT(outcome.out, ::testing::HasSubstr("joint zero offsets, for mastering: add to the displayed values"));
}

// By hand: q2 = -J2, q3 = J3 + J2, q4 = -J4, q5 = J5.
TEST_F(CommandLineWarnings, OffsetsForMasteringAreThoseOfTheControllersJoints) {
  const auto calibrated = [&](const Eigen::MatrixXd& q, const Arguments& more) {
    write("pendant.csv", in_controller_joints(at(q), content(kPendant)));
    const Words command = words_of("calibrate --measurements pendant.csv --json --effects none --prior none");
    return nlohmann::json::parse(run(command + Words{"--joint-convention", kPendant} + more).out);
  };
  Eigen::VectorXd& errors = experiment.robot.truth.errors;
  errors.setZero();
  errors.segment(1, 4) << 1e-3, -2e-3, 3e-3, -4e-3;  // dq2 to dq5
  const nlohmann::json alone = calibrated(measured.joint_values, {});
  const nlohmann::json& joints = alone["joint_offsets"]["joints"];
  const std::vector<double> expected = {-1e-3, -2e-3 + 1e-3, -3e-3, -4e-3};
  for (std::size_t j = 0; j < 6; ++j) {
    EXPECT_EQ(joints[j]["joint"], "J" + std::to_string(j + 1));
    EXPECT_EQ(joints[j]["unit"], "rad");
    EXPECT_EQ(joints[j]["measurable"], j > 0 && j < 5);
    if (j > 0 && j < 5) {
      EXPECT_NEAR(joints[j]["add"], expected[j - 1], 5.0 * joints[j]["std"].get<double>()) << j;
      EXPECT_LT(joints[j]["std"].get<double>(), 2e-4);
      EXPECT_GT(joints[j]["std"].get<double>(), 1e-6);
      EXPECT_LT(joints[j]["interval_95"][0], joints[j]["add"]);
      EXPECT_NEAR(joints[j]["add_if_only_these"], expected[j - 1], 3e-4) << j;
    }
  }
  const auto left = [](const nlohmann::json& result) {
    return result["joint_offsets"]["if_only_these"]["rms"].get<double>() /
           result["position_error"]["train"]["after"]["rms"].get<double>();
  };
  EXPECT_LT(left(alone), 1.5);  // noise
  errors[12] = 2e-3;            // Tx1
  EXPECT_GT(left(calibrated(measured.joint_values, {})), 10.0);
  EXPECT_FALSE(calibrated(measured.joint_values, {"--fix", "dq*"})["joint_offsets"].contains("if_only_these"));
  Eigen::MatrixXd still = measured.joint_values;
  still.row(3).setConstant(0.6);
  const nlohmann::json at_rest = calibrated(still, {})["joint_offsets"];
  EXPECT_EQ(at_rest["joints"].size(), 6U);
  EXPECT_TRUE(at_rest["if_only_these"]["rms"].is_number());
}

TEST_F(CommandLineWarnings, CalibrateTrustsWhereItWasMeasuredAndNamesWhatIsNotDetermined) {
  Eigen::MatrixXd q = measured.joint_values;
  q.row(3).setConstant(0.6);
  write("m.csv", measurements_csv(at(q)));
  const Outcome outcome = expect(
      {"calibrate", "--measurements", "m.csv", "--json"}, 0,
      {"trusted where it was measured: the measurements do not determine [0-9]+ parameters \\(.*\\): joint_4 never "
       R"(moves; .* \(kdlcal plan --measured FILE --add N chooses them\))",
       "the measurements cannot tell apart: .*", "fixed by gauge: .* \\(errors at zero, .*"});
  EXPECT_EQ(nlohmann::json::parse(outcome.out)["termination"], "rank_deficient");
}

TEST_F(CommandLineWarnings, CalibrateNamesTheConventionThatFits) {
  write("serial.csv", in_controller_joints(measured, content(kSerial)));
  const Outcome outcome = run({"calibrate", "--measurements", "serial.csv", "--joint-convention", kPendant, "--output",
                               "c.urdf", "--result", "r.json"});
  EXPECT_EQ(outcome.status, 1) << outcome.err;
  const std::vector<std::string> lines = lines_of(outcome.err);
  EXPECT_THAT(lines, ::testing::Contains(MatchesRegex("kdlcal: not to be trusted: " + kHint + ".*")));
  EXPECT_THAT(lines.back(), MatchesRegex(kWarning + kFileDoesNotSaySo));
  // All but what concerns the other file stands in the result.
  const nlohmann::json result = json_of("r.json");
  EXPECT_EQ(result["doubts"].front()["cause"], "joint_convention");
  std::vector<std::string> expected;
  for (const nlohmann::json& doubt : result["doubts"]) {
    expected.push_back("kdlcal: not to be trusted: " + doubt["message"].get<std::string>());
  }
  for (const nlohmann::json& warning : result["warnings"]) {
    expected.push_back(kWarning + warning.get<std::string>());
  }
  // The command line adds the options that help.
  ASSERT_EQ(lines.size(), expected.size() + 1);
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_THAT(lines[i], ::testing::StartsWith(expected[i]));
  }
  EXPECT_THAT(outcome.err, ::testing::HasSubstr("(--joint-convention says how to read the joint values)\n"));
}

TEST_F(CommandLineWarnings, CalibrateNamesTheOptionThatReadsJointValuesInAnotherWay) {
  const auto doubt = [&](const std::string& cause, const std::function<void(Measurements&)>& spoil) {
    Measurements spoilt = measured;
    spoil(spoilt);
    write("m.csv", measurements_csv(spoilt));
    const Outcome outcome =
        run(words_of("calibrate --measurements m.csv --effects none --prior none --result r.json --force"));
    EXPECT_EQ(outcome.status, 1) << cause;
    std::vector<std::string> causes;
    const nlohmann::json result = json_of("r.json");
    for (const nlohmann::json& found : result["doubts"]) {
      causes.push_back(found["cause"]);
    }
    EXPECT_THAT(causes, ::testing::Contains(cause));
    EXPECT_THAT(outcome.err, ::testing::HasSubstr(" (--joint-convention says how to read the joint values)\n"))
        << cause;
  };
  doubt("joint_sign", [](Measurements& m) { m.joint_values.row(1) *= -1.0; });
  doubt("joint_unit", [](Measurements& m) { m.joint_values *= 180.0 / std::numbers::pi; });
  doubt("joint_columns", [](Measurements& m) { m.joint_values.row(1).swap(m.joint_values.row(2)); });
}

TEST_F(CommandLineWarnings, CalibrateNamesNoConventionWhereTheMeasurementsAreToBlame) {
  Eigen::MatrixXd q = measured.joint_values;
  q.row(3).setConstant(0.6);
  write("serial.csv", in_controller_joints(at(q), content(kSerial)));
  const Outcome outcome = run({"calibrate", "--measurements", "serial.csv", "--joint-convention", kSerial});
  EXPECT_EQ(outcome.status, 0);
  EXPECT_THAT(outcome.err, ::testing::Not(::testing::HasSubstr("the input was used as read")));
}

TEST_F(CommandLineWarnings, CalibrateDoubtsARowThatSpoilsTheFitAndTellsHowToLeaveItOut) {
  Measurements mistyped = measured;
  mistyped.observations[40].position().y() += 0.01;
  write("m.csv", measurements_csv(mistyped));
  expect({"calibrate", "--measurements", "m.csv", "--effects", "none"}, 1,
         {"measurements: target B in configuration 14, repeat 1: y is off by about 10.0 mm"},
         {"not where all others put it: configuration 14, target B by (9|10)[0-9.]* mm; without that the misfit is "
          "0.04[0-9]* mm, .* leave it out with --exclude '14:B'"});
  const Outcome without = run({"calibrate", "--measurements", "m.csv", "--effects", "none", "--exclude", "14:B"});
  EXPECT_EQ(without.status, 0);
  EXPECT_EQ(without.err, "kdlcal: note: measurements: left out as asked: 14:B\n");
  const Outcome unknown = run({"calibrate", "--measurements", "m.csv", "--exclude", "14:Z"});
  EXPECT_EQ(unknown.status, 2);
  EXPECT_THAT(unknown.err, ::testing::HasSubstr("m.csv: '14:Z' cannot be left out"));
}

TEST_F(CommandLineWarnings, ValidateIsSilentAboutTheNominalRobot) {
  write("m.csv", measurements_csv(measured));
  expect({"validate", "--measurements", "m.csv"}, 0, {});
  write("serial.csv", in_controller_joints(measured, content(kSerial)));
  expect({"validate", "--measurements", "serial.csv", "--joint-convention", kSerial, "--json"}, 0, {});
}

TEST_F(CommandLineWarnings, ValidateSaysThatItRegistersToTestRows) {
  Measurements tests = measured;
  for (Observation& observation : tests.observations) {
    observation.split = Split::test;
  }
  write("m.csv", measurements_csv(tests));
  expect({"validate", "--measurements", "m.csv"}, 0, {"m\\.csv: no train rows, the test rows place base and targets"});
  for (Observation& observation : tests.observations) {
    observation.split = observation.configuration < 2 ? Split::train : Split::test;
  }
  write("m.csv", measurements_csv(tests));
  EXPECT_THAT(run({"validate", "--measurements", "m.csv"}).err, ::testing::Not(::testing::HasSubstr("no train rows")));
}

TEST_F(CommandLineWarnings, ValidateSaysWhereTheBaseIsLeftOpen) {
  Eigen::MatrixXd q = measured.joint_values.col(0).replicate(1, 12);
  q.row(0).setLinSpaced(-1.0, 1.0);
  const Measurements circle = subset(at(q, {.sigma = 0.0}), [](const Observation& o) { return o.target == 0; });
  write("m.csv", measurements_csv(circle));
  expect({"validate", "--measurements", "m.csv"}, 0,
         {"registration: the configurations leave a rotation of the base undetermined"});
}

TEST_F(CommandLineWarnings, ValidateDoubtsAnotherJointConvention) {
  write("serial.csv", in_controller_joints(measured, content(kSerial)));
  expect({"validate", "--measurements", "serial.csv", "--joint-convention", kPendant}, 1, {kHint});
  Measurements flipped = measured;
  flipped.joint_values.row(1) *= -1.0;
  write("flipped.csv", measurements_csv(flipped));
  expect({"validate", "--measurements", "flipped.csv"}, 1,
         {"as they were read the measurements leave a misfit of [0-9.]+ mm with its geometry fitted; with joint_2 with "
          "the opposite "
          "sign it is [0-9.]+ mm; the input was used as read"});
  for (Observation& observation : flipped.observations) {
    observation.split = Split::test;
  }
  write("flipped.csv", measurements_csv(flipped));
  expect({"validate", "--measurements", "flipped.csv", "--json"}, 1,
         {"flipped\\.csv: no train rows, .*", "as they were read .* with joint_2 with the opposite sign it is .*"});
}

TEST_F(CommandLineWarnings, ValidateSaysWhereBaseAndTargetsTookAQuarterOfTheCoordinates) {
  // Two targets and the base are 12 unknowns, six coordinates come with each configuration.
  std::string heading;  // of the table
  const auto warned = [&](int configurations, const Arguments& more = {}) {
    write("m.csv", measurements_csv(subset(measured, [=](const Observation& o) {
            return o.configuration < configurations && o.target < 2;
          })));
    const Outcome outcome = run(Words{"validate", "--measurements", "m.csv"} + more);
    heading = lines_of(outcome.out).at(0);
    heading.erase(0, heading.rfind(", ") + 2);
    return outcome.err.substr(0, outcome.err.find(" coordinates"));
  };
  EXPECT_EQ(warned(7), kWarning + "base and targets took 12 of 42");
  EXPECT_EQ(warned(8), "");
  write("known.json", R"({"base": {"position": [0, 0, 0], "quaternion_wxyz": [1, 0, 0, 0]},
    "targets": [{"name": "A", "position": [0.1, 0, 0]}, {"name": "B", "position": [0, 0, 0.1]}]})");
  EXPECT_EQ(warned(3, {"--known-base", "known.json"}), kWarning + "targets took 6 of 18");
  EXPECT_EQ(heading, "targets registered to the train rows");
  EXPECT_EQ(warned(3, {"--known-targets", "known.json"}), kWarning + "base took 6 of 18");
  EXPECT_EQ(heading, "base registered to the train rows");
  EXPECT_EQ(warned(3, {"--known-base", "known.json", "--known-targets", "known.json"}), "");
  EXPECT_EQ(heading, "base and targets as given");
}

TEST_F(CommandLineWarnings, ValidateDoubtsAMisfitOfATenthOfTheArm) {
  double reach = experiment.model.tip_origin.p.Norm();
  for (const MovingJoint& joint : experiment.model.joints) {
    reach += joint.origin.p.Norm();
  }
  Random random(8);
  const Measurements exact = at(measured.joint_values, {});
  for (const double share : {0.08, 0.14}) {
    Measurements scattered = exact;
    for (Observation& observation : scattered.observations) {
      observation.position() +=
          share * reach / std::sqrt(3.0) * Eigen::Vector3d{random.normal(), random.normal(), random.normal()};
    }
    write("m.csv", measurements_csv(scattered));
    const Outcome outcome = run({"validate", "--measurements", "m.csv", "--json"});
    const double rms = nlohmann::json::parse(outcome.out)["position_error"]["all"]["rms"];
    const bool absurd = share > 0.1;
    ASSERT_EQ(rms > 0.1 * reach, absurd);
    EXPECT_EQ(outcome.status, absurd ? 1 : 0) << share << outcome.err;
    EXPECT_EQ(outcome.err.find("is more than geometric errors explain; are units, signs and order of the joints "
                               "right?") != std::string::npos,
              absurd)
        << outcome.err;
  }
}

TEST_F(CommandLineWarnings, AResultThatIsNotToBeTrustedIsDoubtedWhereItIsUsed) {
  for (const Arguments& command :
       {Arguments{"fk", "--joints", "0,0,0,0,0,0", "--result", "r.json"},
        Arguments{"jacobian", "--joints", "0,0,0,0,0,0", "--result", "r.json"},
        words_of("plan --result r.json --configurations 15 --workspace 20 --starts 1 --candidates 60")}) {
    const auto result = [&](const std::string& judgement) {
      nlohmann::ordered_json json =
          nlohmann::ordered_json::parse(R"({"parameters": [{"name": "dq2", "error": 0.002}])" + judgement + "}");
      json["hashes"] = tree::hashes(json);
      write("r.json", json.dump());
      return run(command).err;
    };
    const std::string doubts =
        R"(, "doubts": [{"cause": "drift", "message": "first"}, {"cause": "scale", "message": "second"}])";
    const std::string without = result("");
    EXPECT_EQ(result(R"(, "trusted": false)" + doubts), kWarning + "r.json is not to be trusted: first\n" + without);
    EXPECT_EQ(result(R"(, "trusted": true, "doubts": [])"), without);
    EXPECT_THAT(without, ::testing::Not(::testing::HasSubstr("trusted")));
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::kdlcal_warnings_test
