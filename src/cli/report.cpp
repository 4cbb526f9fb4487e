#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "base/sha256.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "cli/cures.hpp"
#include "cli/frames.hpp"
#include "cli/measurement_options.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/plan_command.hpp"
#include "cli/printed_page.hpp"
#include "cli/robot_controller.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "results/report_page.hpp"

namespace kdl_calibration::cli {
namespace {

struct ReportArguments {
  std::string result;
  std::string urdf;
  std::string dh;
  MeasurementArguments measurements;
  std::string output;
  std::string pdf;
  std::string paper = "a4";
  bool force = false;
};

// The files given, and empty paths for the other bases that the result was made with.
FileRoles files_and_bases(const ReportArguments& arguments, const Json& result) {
  FileRoles files = files_of(arguments.measurements);
  if (hash_of_input(result, "measurements")) {
    for (const Json& file : result["provenance"]["files_read"]) {
      const std::string role = text_at(file, "role");
      const auto is_same = [&](const auto& other) { return other.first == role; };
      if (role.rfind("known-base", 0) == 0 && std::none_of(files.begin(), files.end(), is_same)) {
        files.emplace_back(role, "");
      }
    }
  }
  return files;
}

// Requires the files of the result: with others the page would show residuals that the result never had.
void require_same_files(const ReportArguments& arguments, const Json& result) {
  for (const auto& [role, path] : files_and_bases(arguments, result)) {
    require_same_input(result, arguments.result, role, path);
  }
}

// Another robot may lack the links that the result names, so its text is compared before it is read.
void require_same_urdf(const ReportArguments& arguments, const Json& input) {
  const std::string hash = text_at(input, "sha256");
  if (!arguments.urdf.empty() && !hash.empty() && sha256_of_file(arguments.urdf) != hash) {
    throw InputError("--urdf: '" + arguments.urdf + "' is not the robot that " + arguments.result +
                     " was made with, its hash is another one; expected the URDF that was calibrated");
  }
}

ExitStatus run(const ReportArguments& arguments) {
  const std::string& measurements_file = arguments.measurements.measurements;
  const bool with_robot = !arguments.urdf.empty() || !arguments.dh.empty() || !measurements_file.empty();
  std::vector<OutputFile> files = given_outputs({{"--output", arguments.output}, {"--pdf", arguments.pdf}});
  if (files.empty()) {
    throw InputError("no file to write, expected --output or --pdf");
  }
  require_writable(files, arguments.force);
  const std::string text = read_text_file(arguments.result);
  const Json result = json_of(text, arguments.result);
  CalibrationPage page{.result = text,
                       .source = arguments.result,
                       .plan_command = plan_command(result),
                       .apply_command = apply_command(result, arguments.result),
                       .cures = cures(result.is_object() && result.contains("stations"))};
  std::optional<Robot> robot;
  std::optional<Measurements> measurements;
  if (with_robot) {
    const Json input = result.is_object() && result.contains("input") ? result["input"] : Json::object();
    require_same_urdf(arguments, input);
    robot = load(
        {.urdf = arguments.urdf, .dh = arguments.dh, .base = text_at(input, "base"), .tip = text_at(input, "tip")});
    page.robot = &*robot;
  }
  if (!measurements_file.empty()) {
    require_same_files(arguments, result);
    if (result.contains("mastering_entered")) {
      throw InputError(
          "--measurements: were taken before the mastering was entered, expected none, or the result "
          "before the entry");
    }
    measurements = read(arguments.measurements, *robot);
    page.measurements = &*measurements;
    page.known = known_frames(arguments.measurements, *measurements);
    page.convention = convention_of(arguments.measurements.joint_convention, *robot);
    page.X_BK = world_of(*robot, page.convention);
  }
  std::vector<std::string> written;
  for (OutputFile& file : files) {
    page.paper = file.option == "--pdf" ? arguments.paper : "";
    file.text = calibration_page(page);
    file.text = file.option == "--pdf" ? printed_page(file.text) : file.text;
    written.push_back(file.path);
  }
  write_whole(files, arguments.force, "Written: " + comma_separated(written) + "\n");
  return done;
}

}  // namespace

Subcommand add_report(CLI::App& parser) {
  CLI::App* app = parser.add_subcommand("report", "The page for people from a result, without a fit");
  const auto arguments = std::make_shared<ReportArguments>();
  add_file(*app, "--result", arguments->result, "The result that calibrate wrote (JSON)")->required();
  CLI::Option* urdf =
      add_file(*app, "--urdf", arguments->urdf, "The robot that was calibrated, for its picture; checked by its hash");
  add_file(*app, "--dh", arguments->dh, "The same as a DH table")->excludes(urdf);
  add_measurement_options(*app, arguments->measurements);
  app->get_option("--measurements")->required(false);
  add_file(*app, "--output", arguments->output, "Write the page (HTML)");
  add_file(*app, "--pdf", arguments->pdf, "Write the page as PDF, printed by chromium or google-chrome");
  add_word(*app, "--paper", arguments->paper, {"a4", "letter"}, "Paper of the PDF: a4 or letter");
  app->add_flag("--force", arguments->force, "Overwrite files that exist");
  add_example(*app,
              "kdlcal report --result result.json --urdf robot.urdf --measurements measurements.csv"
              " --output report.html");
  return {.app = app, .run = [arguments] { return run(*arguments); }};
}

}  // namespace kdl_calibration::cli
