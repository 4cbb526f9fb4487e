#include "cli/output_files.hpp"

#include <utility>

#include "base/text_file.hpp"
#include "cli/data_dir.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

std::vector<NamedFile> inputs_of_run;

}  // namespace

std::vector<OutputFile> given_outputs(const std::vector<NamedFile>& files) {
  std::vector<OutputFile> given;
  for (const NamedFile& file : files) {
    if (!file.path.empty()) {
      if (file.option == "--report" && lower_ending(file.path) == ".pdf") {
        throw InputError("--report: '" + file.path + "' would hold HTML, expected another name; kdlcal report --pdf " +
                         "prints a result's page");
      }
      given.push_back({.option = file.option, .path = file.path, .text = {}});
    }
  }
  return given;
}

void protect_inputs(std::vector<NamedFile> named) {
  inputs_of_run = std::move(named);
  try {
    inputs_of_run.push_back({.option = "kdlcal itself", .path = default_urdf_path().string()});
  } catch (const InputError&) {  // no bundled robots
  }
  note_inputs([](const std::filesystem::path& path, const std::string& why, const std::string& sha256) {
    inputs_of_run.push_back({.option = {}, .path = path.string(), .reason = why, .sha256 = sha256});
  });
}

void read_on_trial(const std::function<void()>& read) {
  const std::size_t before = inputs_of_run.size();
  try {
    read();
  } catch (const InputError&) {
    inputs_of_run.resize(before);
  }
}

void require_writable(const std::vector<OutputFile>& files, bool force) {
  kdl_calibration::require_writable(files, inputs_of_run, force);
}

void write_whole(const std::vector<OutputFile>& files, bool force, const std::string& printed) {
  write_whole(files, force, [&] { return printed; });
}

void write_whole(const std::vector<OutputFile>& files, bool force, const std::function<std::string()>& printed) {
  // Printing fails where standard output is full or closed.
  kdl_calibration::write_whole(files, inputs_of_run, force, [&] { print(printed()); });
}

}  // namespace kdl_calibration::cli
