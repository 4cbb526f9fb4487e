#include "cli/data_dir.hpp"

#include <system_error>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

/// Empty if the system does not provide it.
std::filesystem::path executable_dir() {
  std::error_code error;
  const std::filesystem::path executable = std::filesystem::read_symlink("/proc/self/exe", error);
  return error ? std::filesystem::path() : executable.parent_path();
}

}  // namespace

std::filesystem::path urdf_dir() {
  const std::filesystem::path bin = executable_dir();
  std::filesystem::path installed = (bin / KDL_CALIBRATION_URDF_FROM_BIN).lexically_normal();
  std::filesystem::path source = KDL_CALIBRATION_SOURCE_URDF_DIR;
  std::error_code error;
  if (!bin.empty() && std::filesystem::is_directory(installed, error)) {
    return installed;
  }
  if (std::filesystem::is_directory(source, error)) {
    return source;
  }
  throw InputError(installed.string() + ": no such folder, expected the robots that come with kdlcal; use --urdf");
}

std::filesystem::path default_urdf_path() { return urdf_dir() / "fanuc_r2000ic_165f.urdf"; }

}  // namespace kdl_calibration::cli
