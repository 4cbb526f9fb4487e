#pragma once

#include <filesystem>

namespace kdl_calibration::cli {

/// The folder with the bundled robots: `share/kdl_calibration/urdf` relative to the executable's installation, else the
/// source tree's `urdf`. Throws InputError if neither exists.
std::filesystem::path urdf_dir();

/// Path of the R-2000iC/165F in that folder.
std::filesystem::path default_urdf_path();

}  // namespace kdl_calibration::cli
