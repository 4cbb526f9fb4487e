#include <fmt/core.h>
#include <algorithm>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "base/csv.hpp"
#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "base/units.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_command.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/mastering.hpp"
#include "results/result_blocks.hpp"
#include "results/saved_calibration.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

struct ApplyArguments {
  RobotArguments robot;
  std::string result;
  std::string entered;
  std::string joint_convention;
  std::string output;
  std::string urdf;
  bool force = false;
};

// The entered offsets: a table (CSV) with the columns joint, added and unit (deg, rad, mm or m).
std::vector<EnteredOffset> parse_entered_offsets(std::string_view csv, const std::string& source,
                                                 const JointConvention& convention) {
  LineReader lines(csv, source);
  std::string_view line;
  Fields fields;
  std::vector<EnteredOffset> entered;
  bool has_header = false;
  char separator = ',';
  while (next_record(lines, line)) {
    if (!has_header) {
      separator = separator_of(line);
      fields.split(line, separator, lines.place());
      has_header = fields.size() == 3 && fields[0] == "joint" && fields[1] == "added" && fields[2] == "unit";
      if (!has_header) {
        fail(lines.place(), "the header is another one, expected joint,added,unit");
      }
      continue;
    }
    fields.split(line, separator, lines.place());
    if (fields.size() != 3) {
      fail(lines.place(), "has " + std::to_string(fields.size()) + " fields, expected joint, added and unit");
    }
    const std::string joint(name_in(fields[0]));
    const auto& names = convention.controller_joints;
    if (std::find(names.begin(), names.end(), joint) == names.end()) {
      fail(lines.place(), shown(joint) + " is no joint of the controller, expected one of " + comma_separated(names));
    }
    if (std::any_of(entered.begin(), entered.end(), [&](const EnteredOffset& other) { return other.joint == joint; })) {
      fail(lines.place(), shown(joint) + " is there twice, expected each joint once");
    }
    std::string text(fields[1]);
    if (separator == ';') {
      std::replace(text.begin(), text.end(), ',', '.');
    }
    const std::optional<double> number = parsed_number(text);
    const Unit unit = unit_named(lower_case(fields[2]));
    if (!number || unit == Unit::none) {
      fail(lines.place(), "'" + std::string(fields[1]) + " " + std::string(fields[2]) +
                              "' is not accepted, expected a number and deg, rad, mm or m");
    }
    entered.push_back(
        {.joint = joint, .added = to_si(*number, unit), .is_length = unit == Unit::m || unit == Unit::mm});
  }
  if (entered.empty()) {
    fail(source, "has no joint, expected the header joint,added,unit and a line for each joint that was entered");
  }
  return entered;
}

// The joints of the URDF, where no convention is given.
JointConvention urdf_convention(const Robot& robot) {
  const std::vector<std::string> names = independent_joint_names(robot.joints);
  const auto count = static_cast<Eigen::Index>(names.size());
  return {.name = "the URDF's joints",
          .controller_joints = names,
          .urdf_joints = names,
          .matrix = Eigen::MatrixXd::Identity(count, count),
          .offset = Eigen::VectorXd::Zero(count)};
}

// The result with the files that it comes from, which no hash protects.
std::string with_provenance(const MasteredResult& mastered, const ApplyArguments& arguments, const OutputFile* urdf) {
  Json json = json_of(mastered.json, "the result");
  Json& provenance = json["provenance"];
  for (const auto& [role, path] :
       {std::pair{"earlier-result", arguments.result}, std::pair{"mastering-entered", arguments.entered}}) {
    provenance["files_read"].push_back({{"role", role}, {"path", path}, {"sha256", sha256_of_file(path)}});
  }
  provenance["files_written"] = Json::array();
  if (urdf != nullptr) {
    provenance["files_written"].push_back({{"role", "output"}, {"path", urdf->path}, {"sha256", sha256(urdf->text)}});
  }
  return json_text(json);
}

// The same entry again would count it twice.
void require_new_entry(const Json& result, const ApplyArguments& arguments) {
  if (result.is_object() && result.contains("mastering_entered") &&
      hash_of_input(result, "mastering-entered") == sha256_of_file(arguments.entered)) {
    throw InputError("--mastering-entered: " + arguments.result + " is the result after " + arguments.entered +
                     " already, expected the result before it, or what was entered since");
  }
}

std::string summary(const std::vector<EnteredOffset>& entered, const std::vector<OutputFile>& files) {
  std::vector<std::string> names;
  std::vector<std::string> paths;
  for (const EnteredOffset& offset : entered) {
    names.push_back(offset.joint);
  }
  for (const OutputFile& file : files) {
    paths.push_back(file.path);
  }
  return "The result and URDF of the robot whose controller adds what was entered for " + comma_separated(names) +
         ".\nUse them with programs and joint values from after the entry; measure a few points and run kdlcal validate"
         ".\nWritten: " +
         comma_separated(paths) + "\n";
}

ExitStatus run(const ApplyArguments& arguments) {
  // Beyond this, effects at the new joint values are another function than before.
  constexpr double kMostMoved = 5e-5;
  std::vector<OutputFile> files = given_outputs({{"--output", arguments.output}, {"--output-urdf", arguments.urdf}});
  require_writable(files, arguments.force);
  const Robot robot = load(arguments.robot);
  const std::string text = read_text_file(arguments.result);
  // With another one the offsets would be of other joints.
  require_same_input(json_of(text, arguments.result), arguments.result, "joint-convention", arguments.joint_convention);
  require_new_entry(json_of(text, arguments.result), arguments);
  const std::optional<JointConvention> given = convention_of(arguments.joint_convention, robot);
  const JointConvention convention = given ? *given : urdf_convention(robot);
  const std::vector<EnteredOffset> entered =
      parse_entered_offsets(read_text_file(arguments.entered), arguments.entered, convention);
  const MasteredResult mastered = mastered_result(text, arguments.result, robot, convention, entered);
  if (!(mastered.moved <= kMostMoved)) {
    throw InputError(
        fmt::format("{}: what was entered is so large that effects under load change by {:.3f} mm, expected "
                    "at most {:.3f} mm; calibrate anew after the entry",
                    arguments.entered, mastered.moved * 1e3, kMostMoved * 1e3));
  }
  const OutputFile* urdf = nullptr;
  for (OutputFile& file : files) {
    if (file.option == "--output-urdf") {
      const CalibrationParts parts = parse_calibration(mastered.json, robot, arguments.result);
      file.text = calibrated_urdf(robot, parts.model, parts.urdf_errors);
      urdf = &file;
    }
  }
  files.front().text = with_provenance(mastered, arguments, urdf);
  write_whole(files, arguments.force, summary(entered, files));
  std::for_each(mastered.warnings.begin(), mastered.warnings.end(), warn);
  return done;
}

}  // namespace

Subcommand add_apply(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand(
      "apply",
      "The result after its joint zero offsets were entered\n"
      "Turns a result and its URDF into those of the robot whose mastering was corrected, so that both do not correct "
      "the same offsets.");
  const auto arguments = std::make_shared<ApplyArguments>();
  add_file(*app, "--result", arguments->result, "The result that calibrate wrote (JSON)")->required();
  add_file(*app, "--mastering-entered", arguments->entered,
           "What was entered, as displayed: joint,added,unit, one line for each joint (CSV; deg, rad, mm or m)")
      ->required();
  add_robot_options(*app, arguments->robot);
  add_file(*app, "--joint-convention", arguments->joint_convention, "The convention that the result was made with");
  add_file(*app, "--output", arguments->output, "Write the result after the entry (JSON)")->required();
  add_file(*app, "--output-urdf", arguments->urdf, "Write its calibrated URDF");
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_example(*app,
              "kdlcal apply --result result.json --mastering-entered entered.csv --output entered.json"
              " --output-urdf entered.urdf");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
