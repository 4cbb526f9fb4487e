#pragma once

#include <string>

namespace kdl_calibration::cli {

/// The page as PDF, printed by a browser of this machine: chromium, chromium-browser, google-chrome or
/// google-chrome-stable of the PATH, without a window and without network. Throws InputError if there is none, or if it
/// fails or takes more than two minutes.
std::string printed_page(const std::string& html);

}  // namespace kdl_calibration::cli
