#pragma once

// The files of src/results/report, which the build embeds.

#include <string_view>

namespace kdl_calibration {

std::string_view report_html();    ///< with the placeholders {{style}}, {{script}} and {{data}}
std::string_view report_style();   ///< CSS
std::string_view report_script();  ///< JavaScript

}  // namespace kdl_calibration
