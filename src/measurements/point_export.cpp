#include "measurements/point_export.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cstddef>

#include "base/text.hpp"
#include "base/units.hpp"
#include "measurements/measurement_columns.hpp"

namespace kdl_calibration {
namespace {

constexpr std::string_view kSlashes = "//";
constexpr std::array<std::string_view, 3> kPointAxes = {"x", "y", "z"};
constexpr std::array kMetricWords = {Word{"millimeters", "mm"}, Word{"millimetres", "mm"}, Word{"mm", "mm"},
                                     Word{"meters", "m"},       Word{"metres", "m"},       Word{"m", "m"}};

std::string_view content_of(const Comment& comment) {
  return trimmed(std::string_view(comment.text).substr(kSlashes.size()));
}

/// "mm" or "m" of the comment "Units: Millimeters"; empty if it states no unit.
std::string_view unit_stated(const Comment& comment, const std::string& source) {
  const std::string_view content = content_of(comment);
  const std::size_t colon = content.find(':');
  const std::string name = lower_case(trimmed(content.substr(0, colon)));
  if (colon == std::string_view::npos || (name != "units" && name != "unit" && name != "length units")) {
    return {};
  }
  const std::string_view stated = trimmed(content.substr(colon + 1));
  const std::string_view unit = translated(trimmed(stated.substr(0, stated.find_first_of(",; "))), kMetricWords);
  if (unit != "mm" && unit != "m") {
    fail(Place{source, comment.line}, "unit " + shown(stated) + " is not read: expected Millimeters or Meters");
  }
  return unit;
}

/// The cells in lower case, without units, as far as they name a column.
std::vector<std::string> meanings_in(const Fields& cells) {
  std::vector<std::string> meanings;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    meanings.push_back(lower_case(column_meaning(trimmed(name_and_unit(cells[i]).first))));
  }
  return meanings;
}

bool names_points(const std::vector<std::string>& meanings) {
  return std::all_of(kPointAxes.begin(), kPointAxes.end(), [&](std::string_view axis) {
    return std::find(meanings.begin(), meanings.end(), axis) != meanings.end();
  });
}

bool reads_as_number(std::string_view text) {
  double value = 0.0;
  return std::from_chars(text.data(), text.data() + text.size(), value).ptr == text.data() + text.size() &&
         !text.empty();
}

/// Collection, group, point, x, y, z.
bool is_usual_row(const Fields& cells) {
  return cells.size() == 6 && reads_as_number(cells[3]) && reads_as_number(cells[4]) && reads_as_number(cells[5]);
}

/// The header, in which x, y and z have the unit unless they state one.
std::string with_unit(const Fields& cells, char separator, std::string_view unit) {
  const std::vector<std::string> meanings = meanings_in(cells);
  std::string text;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const bool is_axis = std::find(kPointAxes.begin(), kPointAxes.end(), meanings[i]) != kPointAxes.end();
    const bool is_bare = is_axis && !unit.empty() && !name_and_unit(cells[i]).second;
    text +=
        (i == 0 ? "" : std::string(1, separator)) + csv_cell(cells[i]) + (is_bare ? "[" + std::string(unit) + "]" : "");
  }
  return text;
}

}  // namespace

std::optional<ExportHeader> export_header(const std::vector<Comment>& comments, std::string_view first,
                                          const std::string& source) {
  const char separator = separator_of(first);
  std::string_view unit;
  Fields cells;
  std::string named;
  bool any = false;
  for (const Comment& comment : comments) {
    if (!comment.text.starts_with(kSlashes)) {
      continue;
    }
    any = true;
    if (const std::string_view own = unit_stated(comment, source); !own.empty()) {
      unit = own;
    }
    if (comment.text.find('"') == std::string::npos) {  // quotes may be odd in prose
      cells.split(content_of(comment), separator, {source, comment.line});
      named = names_points(meanings_in(cells)) ? std::string(content_of(comment)) : named;
    }
  }
  const Place place{source, comments.empty() ? 0 : comments.back().line + 1};
  cells.split(first, separator, place);
  if (!any || cells.size() < kPointAxes.size()) {
    return std::nullopt;
  }
  if (names_points(meanings_in(cells))) {
    return ExportHeader{.text = with_unit(cells, separator, unit)};
  }
  if (named.empty() && !is_usual_row(cells)) {
    return std::nullopt;
  }
  if (named.empty()) {
    named = "collection,group,target,x,y,z";
    std::replace(named.begin(), named.end(), ',', separator);
  }
  cells.split(named, separator, place);
  return ExportHeader{.text = with_unit(cells, separator, unit), .before_first = true};
}

}  // namespace kdl_calibration
