#include "cli/output_files.hpp"

#include <utility>

#include "cli/data_dir.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

std::vector<NamedFile> inputs_to_protect;

}  // namespace

std::vector<OutputFile> given_outputs(const std::vector<NamedFile>& files) {
  std::vector<OutputFile> given;
  for (const NamedFile& file : files) {
    if (!file.path.empty()) {
      given.push_back({.option = file.option, .path = file.path, .text = {}});
    }
  }
  return given;
}

void protect_inputs(std::vector<NamedFile> inputs) {
  inputs_to_protect = std::move(inputs);
  try {
    inputs_to_protect.push_back({.option = "kdlcal itself", .path = default_urdf_path().string()});
  } catch (const InputError&) {  // no bundled robots
  }
}

void require_writable(const std::vector<OutputFile>& files, bool force) {
  kdl_calibration::require_writable(files, inputs_to_protect, force);
}

void write_whole(const std::vector<OutputFile>& files, bool force, const std::string& printed) {
  write_whole(files, force, [&] { return printed; });
}

void write_whole(const std::vector<OutputFile>& files, bool force, const std::function<std::string()>& printed) {
  // Printing fails where standard output is full or closed.
  kdl_calibration::write_whole(files, inputs_to_protect, force, [&] { print(printed()); });
}

}  // namespace kdl_calibration::cli
