#pragma once

#include <filesystem>

namespace kdl_calibration::cli {

/// The folder with the robots that come with the executable: `share/kdl_calibration/urdf` of the tree it is installed
/// in, wherever that was moved to; else the source tree's `urdf`. Throws InputError where neither exists.
std::filesystem::path urdf_dir();

/// The R-2000iC/165F in that folder.
std::filesystem::path default_urdf_path();

}  // namespace kdl_calibration::cli
