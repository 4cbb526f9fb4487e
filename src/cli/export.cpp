#include <map>
#include <memory>

#include "base/text_file.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/kinematic_export.hpp"
#include "kdl_calibration/result_file.hpp"

namespace kdl_calibration::cli {
namespace {

/// --output and --force of a text that else goes to standard output.
struct TextOutput {
  std::string output;
  bool force = false;
};

void add_text_output(CLI::App& app, TextOutput& arguments) {
  add_file(app, "--output", arguments.output, "Write it to this file [standard output]");
  app.add_flag("--force", arguments.force, "Overwrite a file that exists");
}

// `text` makes the text once the file is known to be writable.
ExitStatus write_text(const TextOutput& arguments, const std::function<std::string()>& text) {
  std::vector<OutputFile> files = given_outputs({{.option = "--output", .path = arguments.output}});
  require_writable(files, arguments.force);
  if (files.empty()) {
    print(text());
    return done;
  }
  files.front().text = text();
  write_whole(files, arguments.force, "Written: " + arguments.output + "\n");
  return done;
}

struct ExportArguments {
  RobotArguments robot;
  std::string result;
  std::string format;
  TextOutput to;
};

const std::map<std::string, KinematicFormat>& formats() {
  static const std::map<std::string, KinematicFormat> known = {{"dh", KinematicFormat::dh},
                                                               {"mdh", KinematicFormat::mdh},
                                                               {"opw", KinematicFormat::opw},
                                                               {"urdf", KinematicFormat::urdf},
                                                               {"xacro-yaml", KinematicFormat::xacro_yaml},
                                                               {"ur-yaml", KinematicFormat::ur_yaml},
                                                               {"csv", KinematicFormat::parameters_csv}};
  return known;
}

std::string exported(const ExportArguments& arguments) {
  const Robot robot = load(arguments.robot);
  if (arguments.result.empty()) {
    if (arguments.format != "urdf") {
      throw InputError("--result: is required; without it, --format urdf gives the nominal robot, such as one of --dh");
    }
    return robot.urdf;
  }
  const Calibration found = load_calibration(arguments.result, robot);
  warn_if_doubted(arguments.result, found.verdict(), found.doubts());
  return kinematic_export(robot, found, formats().at(arguments.format));
}

struct ImportArguments {
  RobotArguments robot;
  std::string calibration;
  TextOutput to;
};

std::string imported(const ImportArguments& arguments) {
  return ur_calibrated_urdf(load(arguments.robot), read_text_file(arguments.calibration), arguments.calibration);
}

}  // namespace

Subcommand add_export(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("export", "The calibrated geometry as DH table, URDF, YAML or CSV");
  const auto arguments = std::make_shared<ExportArguments>();
  add_robot_options(*app, arguments->robot);
  add_file(*app, "--result", arguments->result, "The result that calibrate wrote (JSON) [none: the nominal URDF]");
  add_word(*app, "--format", arguments->format, {"dh", "mdh", "opw", "urdf", "xacro-yaml", "ur-yaml", "csv"},
           "dh or mdh (table, JSON), opw (parameters for MoveIt, YAML), urdf, xacro-yaml (joint origins), ur-yaml "
           "(kinematics of Universal Robots), csv "
           "(parameters)")
      ->required();
  add_text_output(*app, arguments->to);
  add_example(*app, "kdlcal export --result result.json --urdf robot.urdf --format mdh --output table.json");
  return {.app = app, .run = [arguments] { return write_text(arguments->to, [&] { return exported(*arguments); }); }};
}

Subcommand add_import(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("import", "The maker's own calibration as URDF");
  const auto arguments = std::make_shared<ImportArguments>();
  add_robot_options(*app, arguments->robot);
  add_file(*app, "--ur-calibration", arguments->calibration,
           "calibration.conf of a Universal Robot's controller, or the YAML of ur_calibration for ROS")
      ->required();
  add_text_output(*app, arguments->to);
  add_example(*app, "kdlcal import --ur-calibration calibration.conf --urdf ur5.urdf --output calibrated.urdf");
  return {.app = app, .run = [arguments] { return write_text(arguments->to, [&] { return imported(*arguments); }); }};
}

}  // namespace kdl_calibration::cli
