// Every number that validate, model, fk and jacobian print, as a table and as JSON, against the library, KDL or the
// formula written out.

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <kdl/chainjnttojacsolver.hpp>
#include <sstream>

#include "cli_support.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/result_table.hpp"
#include "kdl_calibration/simulation.hpp"
#include "kdl_calibration/validation.hpp"
#include "printed_text.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::testing::cli_tables_test {
namespace {

using Json = nlohmann::json;

/// Both documents hold the same, numbers to within `tolerance`.
void expect_near(const Json& got, const Json& expected, const std::string& where, double tolerance = 1e-12) {
  if (expected.is_number() && got.is_number()) {
    EXPECT_NEAR(got.get<double>(), expected.get<double>(), tolerance) << where;
    return;
  }
  if (!expected.is_structured() || got.type() != expected.type() || got.size() != expected.size()) {
    EXPECT_EQ(got, expected) << where;
    return;
  }
  for (const auto& [key, value] : expected.items()) {
    if (expected.is_object() && !got.contains(key)) {
      ADD_FAILURE() << where << ": expected the key " << key << ", got " << got;
      continue;
    }
    expect_near(expected.is_object() ? got.at(key) : got.at(std::stoul(key)), value, where + "/" + key, tolerance);
  }
}

Json frame_json(const Eigen::Isometry3d& X) {
  const KDL::Frame frame = to_kdl(X);
  double x = 0.0;
  double y = 0.0;
  double z = 0.0;
  double w = 0.0;
  frame.M.GetQuaternion(x, y, z, w);
  const double sign = w < 0.0 ? -1.0 : 1.0;
  return {{"position", {frame.p.x(), frame.p.y(), frame.p.z()}},
          {"quaternion_wxyz", {sign * w, sign * x, sign * y, sign * z}}};
}

/// The last `count` words of each of these lines end below those of the heading.
void expect_columns(const std::vector<std::string>& lines, std::size_t heading, std::size_t end, std::size_t count) {
  ASSERT_LE(end, lines.size());
  for (std::size_t i = heading + 1; i < end; ++i) {
    EXPECT_EQ(word_ends(lines[i], count), word_ends(lines[heading], count)) << lines[heading] << "\n" << lines[i];
  }
}

class Tables : public CommandLine {
protected:
  /// Expects this standard output, word by word, and nothing on standard error.
  std::vector<std::string> expect_table(const std::vector<std::string>& arguments,
                                        const std::vector<std::string>& lines) {
    const Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    EXPECT_EQ(outcome.err, "");
    expect_lines(outcome.out, lines, ::testing::PrintToString(arguments));
    return lines_of(outcome.out);
  }
};

// ---- validate ------------------------------------------------------------------------------------------------------

class ValidateTable : public Tables {
protected:
  ValidateTable() {
    std::vector<TargetFrame> targets = published_targets(2);
    targets[1].with_orientation = true;
    Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
    X_WB.linear() = Eigen::AngleAxisd(3.0, Eigen::Vector3d(0.2, -0.3, 0.9).normalized()).toRotationMatrix();
    X_WB.translation() = Eigen::Vector3d(2.0, -1.5, 0.4);
    VirtualExperiment experiment({.model = model, .targets = targets, .X_WB = X_WB, .random = Random(11)});
    const Measurements held_out = experiment.measure(5, {.sigma = 3e-5}, Split::test);
    measured = without_sigmas(joined(experiment.measure(12, {.sigma = 3e-5}), held_out));
    const Eigen::Quaterniond none = Eigen::Quaterniond(Eigen::Vector4d::Constant(std::nan("")));
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      measured.orientations[row] = measured.observations[row].target == 0 ? none : measured.orientations[row];
    }
  }

  ErrorStatistics errors(const Estimate& estimate, Rows rows) const {
    return error_statistics(position_errors(model, estimate, measured, rows));
  }

  static std::string line(const std::string& label, const ErrorStatistics& s) {
    std::string text = label;
    for (const double value : {s.rms, s.mean, s.p95, s.max}) {
      text += " " + decimals(value * 1e3, 3);
    }
    return text + " " + std::to_string(s.count);
  }

  static std::string place(const std::string& label, const Eigen::Vector3d& p) {
    return label + " " + decimals(p.x() * 1e3, 3) + " " + decimals(p.y() * 1e3, 3) + " " + decimals(p.z() * 1e3, 3);
  }

  ErrorModel model = complete_model(fanuc());
  Measurements measured;
};

TEST_F(ValidateTable, ShowsEachStatisticInMillimetres) {
  write("m.csv", measurements_csv(measured));
  const Estimate found = nominal_start(model, read_measurements(directory / "m.csv", joint_names(fanuc())));
  const std::string urdf = std::string(URDF_DIR) + "/fanuc_r2000ic_165f.urdf";
  const std::vector<std::string> lines = expect_table(
      {"validate", "--urdf", urdf, "--measurements", "m.csv"},
      {"position error of " + urdf + ", base and targets registered", "rows [mm] rms mean p95 max points",
       line("all", errors(found, Rows::all)), line("train", errors(found, Rows::train)),
       line("test", errors(found, Rows::test)), place("base, measured [mm]", found.X_WB.translation()),
       place("target A", found.targets[0].X_FT.translation()), place("target B", found.targets[1].X_FT.translation())});
  expect_columns(lines, 1, 5, 5);
  const Eigen::Vector3d& base = found.X_WB.translation();
  const Eigen::Vector3d& target = found.targets[1].X_FT.translation();
  EXPECT_EQ(lines.at(5),
            printed("%-24s%12.3f%12.3f%12.3f", "base, measured [mm]", base.x() * 1e3, base.y() * 1e3, base.z() * 1e3));
  EXPECT_EQ(lines.at(7),
            printed("%-24s%12.3f%12.3f%12.3f", "target B", target.x() * 1e3, target.y() * 1e3, target.z() * 1e3));
}

TEST_F(ValidateTable, JsonHoldsEachStatisticInMetresAndTheFrames) {
  write("m.csv", measurements_csv(measured));
  const Estimate found = nominal_start(model, read_measurements(directory / "m.csv", joint_names(fanuc())));
  const auto statistics = [&](Rows rows) -> Json {
    const ErrorStatistics s = errors(found, rows);
    return {{"count", s.count}, {"mean", s.mean}, {"rms", s.rms}, {"p95", s.p95}, {"max", s.max}, {"std", s.std}};
  };
  Json a = {{"name", "A"}, {"position", frame_json(found.targets[0].X_FT)["position"]}};
  Json b = frame_json(found.targets[1].X_FT);
  b["name"] = "B";
  Json got = run_json({"validate", "--measurements", "m.csv", "--json"});
  // Of 24 points base and targets took 6 and 2 x 3 coordinates.
  EXPECT_EQ(got["degrees_of_freedom"], 60);
  EXPECT_NEAR(got["rms_corrected"].get<double>(), errors(found, Rows::train).rms * std::sqrt(72.0 / 60.0), 1e-9);
  got.erase("degrees_of_freedom");
  got.erase("rms_corrected");
  expect_near(got,
              {{"position_error",
                {{"all", statistics(Rows::all)}, {"train", statistics(Rows::train)}, {"test", statistics(Rows::test)}}},
               {"base", frame_json(found.X_WB)},
               {"targets", Json::array({a, b})}},
              "validate");
}

TEST_F(ValidateTable, LeavesOutRowsThatTheMeasurementsDoNotHave) {
  const Measurements train = subset(measured, [](const Observation& o) { return o.split == Split::train; });
  write("m.csv", measurements_csv(train));
  const Estimate found = nominal_start(model, train);
  const Outcome outcome = run({"validate", "--measurements", "m.csv"});
  const std::vector<std::string> lines = lines_of(outcome.out);
  ASSERT_EQ(lines.size(), 7U) << outcome.out;
  EXPECT_EQ(squeezed(lines[2]), line("all", errors(found, Rows::train)));
  EXPECT_EQ(squeezed(lines[3]), line("train", errors(found, Rows::train)));
  EXPECT_TRUE(run_json({"validate", "--measurements", "m.csv", "--json"})["position_error"]["test"].is_null());
}

// ---- model ---------------------------------------------------------------------------------------------------------

/// "0.500 dq2 - 1.000 base.Tx" of what replaces a dropped parameter.
std::string sum_of(const std::map<std::string, double>& terms) {
  std::string text;
  for (const auto& [name, coefficient] : terms) {
    text += text.empty() ? "" : " ";
    if (coefficient < 0.0) {
      text += "- ";
    } else if (!text.empty()) {
      text += "+ ";
    }
    text += decimals(std::abs(coefficient), 3) + " " + name;
  }
  return terms.empty() ? "nothing: it has no effect" : text;
}

std::string words(const std::vector<std::string>& names, const std::string& between) {
  std::string text;
  for (const std::string& name : names) {
    text += text.empty() ? name : between + name;
  }
  return text;
}

TEST_F(Tables, ModelListsWhatIsKeptTheGaugeAndWhatReplacesTheRest) {
  write("odd.urdf", kOddArm);
  struct Case {
    std::vector<std::string> options;
    Robot robot;
    int targets;
    bool poses;
  };
  for (const Case& c : {Case{{}, fanuc(), 3, false}, Case{{"--targets", "1"}, fanuc(), 1, false},
                        Case{{"--urdf", "odd.urdf", "--targets", "2", "--poses"}, parse_robot(kOddArm), 2, true}}) {
    const ErrorModel model = complete_model(c.robot);
    std::vector<TargetFrame> targets = generic_targets(c.targets);
    for (TargetFrame& target : targets) {
      target.with_orientation = c.poses;
    }
    const Reduction reduction = reduced_model(model, targets);
    std::vector<std::string> names;
    for (const ErrorParameter& parameter : model.parameters) {
      names.push_back(parameter.name);
    }
    std::vector<std::string> lines = {
        c.robot.name + ": " + c.robot.base + " to " + c.robot.tip + ", " + std::to_string(c.robot.joints.size()) +
            " joints, " + std::to_string(c.targets) + " measured " + (c.poses ? "poses" : "points") + " on the tool",
        "complete model, " + std::to_string(names.size()) + " geometric parameters:",
        "  " + words(names, " "),
        "irreducible model, rank " + std::to_string(reduction.rank) + " of " + std::to_string(reduction.candidates) +
            " candidates:",
        "  " + words(reduction.kept, " "),
        "gauge, held at zero:"};
    for (const GaugeParameter& gauge : reduction.gauge) {
      lines.push_back(printed("  %-8stied to ", gauge.name.c_str()) + words(gauge.tied_to, ", "));
    }
    lines.emplace_back("dropped, replaced to first order by:");
    for (const DroppedParameter& dropped : reduction.dropped) {
      lines.push_back(printed("  %-8s", dropped.name.c_str()) + sum_of(dropped.replaced_by));
    }
    std::vector<std::string> arguments = {"model"};
    arguments.insert(arguments.end(), c.options.begin(), c.options.end());
    EXPECT_EQ(expect_table(arguments, lines), lines);
  }
}

TEST_F(Tables, ModelNamesTheJointsThatFollowOthers) {
  std::string urdf = kOddArm;
  for (const auto& [joint, mimic] :
       {std::pair<std::string, std::string>{"skew", R"(joint="turn")"},
        std::pair<std::string, std::string>{"wrist", R"(joint="elbow" multiplier="-0.5" offset="0.25")"}}) {
    urdf.insert(urdf.find("</joint>", urdf.find("<joint name=\"" + joint)), "<mimic " + mimic + "/>");
  }
  write("odd.urdf", urdf);
  EXPECT_EQ(lines_of(run({"model", "--urdf", "odd.urdf"}).out).at(0),
            "odd: world to tool, 5 joints (skew = 1.0 turn + 0.0, wrist = -0.5 elbow + 0.25), 3 measured points on the "
            "tool");
}

// ---- fk and jacobian -----------------------------------------------------------------------------------------------

const std::vector<double> kOddJoints = {0.7, 0.25, -1.1, 0.9, -0.4};
const std::string kOddJointsText = "0.7,0.25,-1.1,0.9,-0.4";

KDL::JntArray odd_joints() {
  KDL::JntArray q(5);
  for (unsigned i = 0; i < 5; ++i) {
    q(i) = kOddJoints[i];
  }
  return q;
}

/// Position in millimetres, then roll, pitch and yaw in degrees: R = Rz(yaw) Ry(pitch) Rx(roll).
std::string pose_line(const std::string& name, const KDL::Frame& X) {
  const KDL::Rotation& R = X.M;
  std::string text = name;
  for (int i = 0; i < 3; ++i) {
    text += " " + decimals(X.p[i] * 1e3, 4);
  }
  for (const double angle : {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(0, 0), R(1, 0))),
                             std::atan2(R(1, 0), R(0, 0))}) {
    text += " " + decimals(angle / kDegree, 5);
  }
  return text;
}

TEST_F(Tables, FkShowsMillimetresAndDegreesOfEveryFrame) {
  write("odd.urdf", kOddArm);
  const Robot robot = parse_robot(kOddArm);
  KDL::ChainFkSolverPos_recursive solver(robot.chain);
  const std::string heading = "in world x[mm] y[mm] z[mm] roll[deg] pitch[deg] yaw[deg]";
  std::vector<std::string> lines = {heading};
  for (unsigned s = 0; s < robot.chain.getNrOfSegments(); ++s) {
    KDL::Frame frame;
    solver.JntToCart(odd_joints(), frame, static_cast<int>(s) + 1);
    lines.push_back(pose_line(robot.chain.getSegment(s).getName(), frame));
  }
  const std::vector<std::string> arguments = {"fk", "--urdf", "odd.urdf", "--joints", kOddJointsText};
  expect_table(arguments, {heading, lines.back()});
  std::vector<std::string> every = arguments;
  every.emplace_back("--frames");
  expect_table(every, lines);
}

/// A line of fk in columns, or one of its heading.
std::string in_columns(const std::string& name, int width, const std::vector<std::string>& words) {
  std::string line = printed("%-*s", width, name.c_str());
  for (const std::string& word : words) {
    line += printed("%12s", word.c_str());
  }
  return line;
}

TEST_F(Tables, ColumnsAreAsWideAsTheNamesAndNumbersOrTwelve) {
  write("odd.urdf", kOddArm);
  std::string long_names = kOddArm;
  for (const auto& [from, to] : {std::pair<std::string, std::string>{"\"skew\"", "\"a_joint_with_a_long_name\""},
                                 std::pair<std::string, std::string>{"\"bracket\"", "\"a_bracket_of_length\""}}) {
    for (std::size_t at = long_names.find(from); at != std::string::npos; at = long_names.find(from, at + to.size())) {
      long_names.replace(at, from.size(), to);
    }
  }
  write("long.urdf", long_names);
  for (const bool is_long : {false, true}) {
    const Robot robot = parse_robot(is_long ? long_names : kOddArm);
    const std::vector<std::string> at_joints = {"--urdf", is_long ? "long.urdf" : "odd.urdf", "--joints",
                                                kOddJointsText};
    const int width = is_long ? 21 : 10;  // "a_bracket_of_length" and two blanks; "in world" and two
    std::string fk = in_columns("in world", width, {"x[mm]", "y[mm]", "z[mm]", "roll[deg]", "pitch[deg]", "yaw[deg]"});
    KDL::ChainFkSolverPos_recursive solver(robot.chain);
    for (unsigned s = 0; s < robot.chain.getNrOfSegments(); ++s) {
      KDL::Frame frame;
      solver.JntToCart(odd_joints(), frame, static_cast<int>(s) + 1);
      std::istringstream fields(pose_line("", frame));
      const std::vector<std::string> numbers(std::istream_iterator<std::string>(fields), {});
      fk += "\n" + in_columns(robot.chain.getSegment(s).getName(), width, numbers);
    }
    std::vector<std::string> arguments = {"fk", "--frames"};
    arguments.insert(arguments.end(), at_joints.begin(), at_joints.end());
    EXPECT_EQ(run(arguments).out, fk + "\n");

    KDL::Jacobian J(5);
    KDL::ChainJntToJacSolver(robot.chain).JntToJac(odd_joints(), J);
    std::vector<int> widths(5, 12);
    widths[2] = is_long ? 26 : 12;
    std::vector<std::string> expected = {std::string(10, ' '), "v_x       ", "v_y       ", "v_z       ",
                                         "omega_x   ",         "omega_y   ", "omega_z   "};
    for (unsigned c = 0; c < 5; ++c) {
      expected[0] += printed("%*s", widths[c], robot.joints[c].name.c_str());
      for (unsigned r = 0; r < 6; ++r) {
        expected[r + 1] += printed("%*s", widths[c], decimals(J(r, c), 7).c_str());
      }
    }
    arguments.front() = "jacobian";
    arguments.erase(arguments.begin() + 1);
    const std::vector<std::string> lines = lines_of(run(arguments).out);
    EXPECT_EQ(std::vector<std::string>(lines.begin() + 1, lines.begin() + 8), expected);
  }
}

TEST_F(Tables, NothingIsPrintedAsMinusZero) {
  run({"simulate", "--configurations", "12", "--output", "m.csv"});
  const std::string calibrated = run({"calibrate", "--measurements", "m.csv", "--effects", "none"}).out;
  const std::string out = run({"fk", "--joints", "0,0,0,0,0,0", "--frames"}).out +
                          run({"fk", "--joints=-1e-12,-1e-12,-1e-12,-1e-12,-1e-12,-1e-12", "--frames"}).out +
                          run({"jacobian", "--joints", "0,0,0,0,0,0"}).out + calibrated;
  EXPECT_NE(out.find(" 0.0000 "), std::string::npos) << out;
  EXPECT_NE(out.find(" 0.0000000"), std::string::npos) << out;
  for (const char* zero : {"-0.0000 ", "-0.00000 ", "-0.00000\n", "-0.0000000"}) {
    EXPECT_EQ(out.find(zero), std::string::npos) << out;
  }
}

TEST_F(Tables, FkOfAResultIsTheCalibratedRobot) {
  write("odd.urdf", kOddArm);
  write("r.json", R"({"parameters": [{"name": "dq2", "error": 0.002}, {"name": "dq3", "error": -0.01},
                                     {"name": "Tx1", "error": 0.003}, {"name": "base.Tx", "error": 7.0}]})");
  const ErrorModel model = complete_model(parse_robot(kOddArm));
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.parameters.size()));
  errors[static_cast<Eigen::Index>(parameter_index(model, "dq2"))] = 0.002;
  errors[static_cast<Eigen::Index>(parameter_index(model, "dq3"))] = -0.01;
  errors[static_cast<Eigen::Index>(parameter_index(model, "Tx1"))] = 0.003;
  const KDL::Frame tip = kdl_pose(error_chain(model, errors), odd_joints().data);
  const std::vector<std::string> rest = {"--urdf", "odd.urdf", "--joints", kOddJointsText, "--result", "r.json"};
  std::vector<std::string> fk = {"fk"};
  fk.insert(fk.end(), rest.begin(), rest.end());
  expect_table(fk, {"in world x[mm] y[mm] z[mm] roll[deg] pitch[deg] yaw[deg]", pose_line("tool", tip)});

  std::vector<std::string> jacobian = {"jacobian", "--json"};
  jacobian.insert(jacobian.end(), rest.begin(), rest.end());
  const Json got = run_json(jacobian);
  KDL::Jacobian expected(5);
  KDL::ChainJntToJacSolver(folded_chain(model, errors)).JntToJac(odd_joints(), expected);
  for (unsigned r = 0; r < 6; ++r) {
    for (unsigned c = 0; c < 5; ++c) {
      EXPECT_NEAR(got["kdl"][r][c].get<double>(), expected(r, c), 1e-9) << r << ", " << c;
    }
  }
}

TEST_F(Tables, JacobianShowsARowForEachVelocityAndAColumnForEachJoint) {
  write("odd.urdf", kOddArm);
  const Robot robot = parse_robot(kOddArm);
  KDL::Jacobian J(5);
  KDL::ChainJntToJacSolver(robot.chain).JntToJac(odd_joints(), J);
  std::vector<std::string> lines = {"tool in world, per rad (or m) of each joint; m/rad above, rad/rad below",
                                    "turn slide skew elbow wrist"};
  const std::vector<std::string> labels = {"v_x", "v_y", "v_z", "omega_x", "omega_y", "omega_z"};
  for (unsigned r = 0; r < 6; ++r) {
    std::string line = labels[r];
    for (unsigned c = 0; c < 5; ++c) {
      const std::string number = decimals(J(r, c), 7);
      line += " " + (number == "-0.0000000" ? "0.0000000" : number);
    }
    lines.push_back(line);
  }
  const std::vector<std::string> arguments = {"jacobian", "--urdf", "odd.urdf", "--joints", kOddJointsText};
  std::vector<std::string> as_json = arguments;
  as_json.emplace_back("--json");
  lines.push_back("largest difference between KDL's solver, matrix derivatives and cross products: " +
                  run_json(as_json)["largest_difference"].dump());
  expect_table(arguments, lines);
}

// ---- simulate and plan ---------------------------------------------------------------------------------------------

TEST_F(Tables, SimulateSaysWhatItDrew) {
  expect_table({"simulate", "--configurations", "40",    "--test-configurations",
                "7",        "--targets",        "2",     "--noise",
                "4e-5",     "--length-sigma",   "0.002", "--angle-sigma",
                "0.003",    "--effects",        "gain",  "--effect-sigma",
                "0.0005",   "--seed",           "5",     "--output",
                "m.csv",    "--truth",          "t.json"},
               {"40 configurations to fit and 7 to test, 2 targets, 94 rows",
                "noise 0.0400 mm; 20 true errors, lengths 2.000 mm, angles 0.1719 deg (1 sigma); 6 effects, 0.500 "
                "mrad; seed 5"});
  const Json truth = json_of("t.json");
  EXPECT_EQ(truth["parameters"].size(), 20U);
  EXPECT_EQ(truth["effects"]["terms"].size(), 6U);
  expect_table({"simulate", "--configurations", "5", "--poses", "--output", "p.csv"},
               {"5 configurations to fit, 3 poses, 15 rows",
                "noise 0.0000 mm; 20 true errors, lengths 2.500 mm, angles 3.0000 deg (1 sigma); seed 1"});
}

/// What plan prints, by the answer that it gives in JSON to the same words.
std::vector<std::string> plan_lines(const Json& plan, const std::string& noise, const std::string& removed) {
  const auto text = [](const Json& number) { return std::to_string(number.get<long>()); };
  const auto of_sigma = [&](const std::string& label, const Json& sigma) {
    std::string line = printed("  %-22s", label.c_str());
    for (const char* figure : {"mean", "p95", "max", "worst_configuration_rms"}) {
      line += printed("%10s", sigma[figure].is_null() ? "-" : decimals(sigma[figure].get<double>() * 1e3, 4).c_str());
    }
    return line;
  };
  const Json& sigma = plan["sigma"];
  const Json& O = plan["observability"];
  const std::string effects =
      plan["effects"].empty() ? "" : ", " + std::to_string(plan["effects"].size()) + " of effects";
  std::vector<std::string> lines = {
      std::to_string(plan["configurations"].size()) + " configurations of 60 candidates, " +
          plan["criterion"].get<std::string>() + "-optimal; " + text(plan["targets"]) + " targets, " +
          text(plan["parameters"]) + " parameters" + effects + ", noise " + noise,
      "search                  3 starts, " + text(plan["exchanges"]) + " exchanges; seed 4",
      "samples                 " + text(plan["candidates"]["samples"]) + " drawn" + removed,
      std::string("predicted 1 sigma [mm]        mean       p95       max  worst RMS of a ") + "configuration",
      of_sigma("this plan", sigma["plan"]),
      of_sigma("random choice", sigma["random"])};
  if (!sigma["floor"].is_null()) {
    lines.push_back(
        printed("%-54s%10.4f", "  the least that any plan could promise", sigma["floor"].get<double>() * 1e3));
  }
  lines.push_back("observability           O1 " + decimals(O["O1"], 4) + ", O2 " + decimals(O["O2"], 5) + ", O3 " +
                  decimals(O["O3"], 4) + ", O4 " + decimals(O["O4"], 5) + ", O5 " + decimals(O["O5"], 5) + " (m, rad)");
  lines.push_back("D-efficiency            at least " + decimals(plan["d_efficiency"], 3));
  lines.push_back("travel                  " + decimals(plan["travel_seconds"], 0) +
                  " s at full speed, without the stops");
  if (plan.contains("monte_carlo")) {
    const Json& runs = plan["monte_carlo"];
    const auto mm = [](const Json& metres) { return decimals(metres.get<double>() * 1e3, 4); };
    lines.push_back("Monte Carlo             " + text(runs["runs"]) + " runs, " + text(runs["not_trusted"]) +
                    " not to be trusted; held-out error [mm] mean " + mm(runs["held_out_error"]["mean"]) + ", p95 " +
                    mm(runs["held_out_error"]["p95"]) + ", max " + mm(runs["held_out_error"]["max"]) +
                    "; RMS of a point, mean " + mm(runs["rms_of_point_mean"]));
  }
  return lines;
}

TEST_F(Tables, PlanShowsWhatItsJsonHolds) {
  const std::vector<std::string> plan = {"plan", "--candidates", "60", "--workspace", "30",  "--starts",
                                         "3",    "--seed",       "4",  "--noise",     "5e-5"};
  const auto both = [&](std::vector<std::string> words, const std::string& noise, bool refuses) {
    words.insert(words.begin(), plan.begin(), plan.end());
    std::vector<std::string> as_json = words;
    as_json.emplace_back("--json");
    Json answer = run_json(as_json);
    std::string removed;
    for (const Json& refused : answer["candidates"]["refused"]) {
      removed += "; " + refused["constraint"].get<std::string>() + " removes " + refused["samples"].dump();
    }
    EXPECT_EQ(removed.empty(), !refuses);
    const std::vector<std::string> expected = plan_lines(answer, noise, removed);
    EXPECT_EQ(expect_table(words, expected), expected);
    return answer;
  };
  both({"--configurations", "20", "--monte-carlo", "5"}, "0.0500 mm", false);
  both({"--configurations", "14", "--targets", "2", "--criterion", "I", "--least-height", "0.3", "--noise-tracker",
        "1e-5,0,3e-5,8e-6", "--tracker", "4,1,0.5"},
       "of the tracker", true);
  both({"--configurations", "12", "--effects", "gain"}, "0.0500 mm", false);
  // Joint 4 has but two values: random choices of one of them determine nothing.
  const Json poor = both({"--configurations", "6", "--joint-range", "joint_4=0:0.001"}, "0.0500 mm", false);
  EXPECT_THAT(poor["sigma"]["random"], ::testing::Each(Json(nullptr)));
}

TEST_F(Tables, ManyRunsOfASimulationAreCountedAndTheirErrorsShown) {
  const std::vector<std::string> simulate = {"simulate", "--monte-carlo", "2", "--noise", "1e-5", "--threads", "1"};
  std::vector<std::string> as_json = simulate;
  as_json.emplace_back("--json");
  const Json runs = run_json(as_json);
  const auto statistics = [&](const char* key) {
    const Json& s = runs["held_out_error"][key];
    return ErrorStatistics{
        .count = s["count"], .mean = s["mean"], .rms = s["rms"], .p95 = s["p95"], .max = s["max"], .std = s["std"]};
  };
  EXPECT_EQ(statistics("all").count, 2 * 100 * 3);
  EXPECT_EQ(statistics("mean_of_run").count, 2);
  EXPECT_EQ(statistics("max_of_run").max, statistics("all").max);
  EXPECT_EQ(run(simulate).out, "2 runs, 0 of them not to be trusted\n" + statistics_heading("held-out error [mm]") +
                                   statistics_row("all points", statistics("all")) +
                                   statistics_row("mean of a run", statistics("mean_of_run")) +
                                   statistics_row("largest of a run", statistics("max_of_run")));
}

// ---- text ----------------------------------------------------------------------------------------------------------

TEST_F(Tables, WarningsStayOnOneLineWhateverNamesHold) {
  const std::string name = "test\nrows\t.csv";
  write(name,
        "configuration,target,split,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n"
        "1,A,test,0,0,0,0,0,0,1,2,3\n2,A,test,0.1,0.2,0.3,0.4,0.5,0.6,1,2,4\n"
        "3,A,test,0.5,0,0,0,0,0,1,3,3\n4,A,test,0,0.4,0.3,0.4,0,0.6,2,2,4\n5,A,test,0,0,0.3,0,0.5,0.6,1,2.5,4\n");
  const Outcome outcome = run({"validate", "--measurements", name});
  EXPECT_EQ(outcome.err.rfind("kdlcal: warning: test rows .csv: no train rows, ", 0), 0U) << outcome.err;
  for (const std::string& line : lines_of(outcome.err)) {
    EXPECT_EQ(line.rfind("kdlcal: warning: ", 0), 0U) << outcome.err;
  }
}

TEST_F(Tables, NumbersOnTheCommandLineMayHaveAPlusSign) {
  const auto tip = [&](const std::string& joints) { return run({"fk", "--joints", joints}).out; };
  EXPECT_EQ(tip("+0.1,+0.2,+3e-1,0,0,0"), tip("0.1,0.2,0.3,0,0,0"));
  for (const char* wrong : {"+-0.1", "++0.1", "+", "0.1x", "nan", "inf", "1e999", "0,1"}) {
    EXPECT_EQ(run({"fk", "--joints", std::string(wrong) + ",0,0,0,0,0"}).status, 2) << wrong;
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::cli_tables_test
