#pragma once

// Points as SpatialAnalyzer writes them (ASCII export): comments (//) state the unit and often the columns.

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/csv.hpp"

namespace kdl_calibration {

/// The header that a file would have as measurements.
struct ExportHeader {
  std::string text;           ///< with the unit that a comment states
  bool before_first = false;  ///< the first line is a row already
};

/// From the comments before the first line that is none. Its columns are those of that line if it names x, y and z,
/// else of a comment that does, else by their order: collection, group, target, x, y, z. Nothing if no comment begins
/// with //, or the line is neither a header nor such a row. Throws InputError for a unit other than millimetres and
/// metres.
std::optional<ExportHeader> export_header(const std::vector<Comment>& comments, std::string_view first,
                                          const std::string& source);

}  // namespace kdl_calibration
