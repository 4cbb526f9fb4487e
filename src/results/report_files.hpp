#pragma once

// The files of src/results/report, which the build embeds.

#include <string_view>

namespace kdl_calibration {

std::string_view report_html();    ///< with {{style}}, {{script}} and {{data}} where these belong
std::string_view report_style();   ///< CSS
std::string_view report_script();  ///< JavaScript

}  // namespace kdl_calibration
