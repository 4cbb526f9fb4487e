#include "cli/planned_cell.hpp"

#include <filesystem>
#include <optional>
#include <sstream>
#include <string_view>
#include <vector>

#include "base/csv.hpp"
#include "base/number_text.hpp"
#include "cli/plan_command.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr std::string_view kCell = "Cell: ";
constexpr std::string_view kPlaces = "Measured: ";

// The text behind `name` in the comments before the header.
std::string text_of_note(const std::string& file, std::string_view name) {
  LineReader lines{std::filesystem::path(file)};
  for (std::string_view line; lines.next(line) && is_comment(line);) {
    if (const std::size_t start = line.find(name); start != std::string_view::npos) {
      // A spreadsheet fills the line up with separators.
      const std::string_view text = line.substr(start + name.size());
      return std::string(text.substr(0, text.find_last_not_of(" \t,;\"") + 1));
    }
  }
  return {};
}

}  // namespace

std::string cell_note(const CellArguments& arguments) {
  std::string words;
  const auto add = [&](std::string_view option, const std::string& value) {
    words += (words.empty() ? "" : " ") + std::string(option) + " " + value;
  };
  const auto add_text = [&](std::string_view option, const std::string& value) {
    if (!value.empty()) {
      add(option, value);
    }
  };
  const auto add_number = [&](std::string_view option, const std::optional<double>& value) {
    if (value) {
      add(option, shortest(*value));
    }
  };
  const auto add_all = [&](std::string_view option, const std::vector<std::string>& values) {
    for (const std::string& value : values) {
      add(option, value);
    }
  };
  add_text("--frame", arguments.frame);
  add_all("--joint-range", arguments.joint_ranges);
  add_text("--box", arguments.box);
  add_number("--least-height", arguments.least_height);
  add_number("--least-radius", arguments.least_radius);
  add_all("--keep-out-sphere", arguments.out_spheres);
  add_all("--keep-out-box", arguments.out_boxes);
  add_number("--clearance", arguments.clearance);
  add_number("--arm-radius", arguments.arm_radius);
  add_number("--tool-radius",
             arguments.tool_radius > 0.0 ? std::optional<double>(arguments.tool_radius) : std::nullopt);
  add_text("--tracker", arguments.tracker);
  add_text("--distance-range", arguments.distance_range);
  add_number("--acceptance-angle", arguments.acceptance_deg);
  return cell_in(words).empty() ? std::string() : std::string(kCell) + words;
}

std::string cell_in(const std::string& text) {
  CLI::App cell;
  cell.set_help_flag();
  CellArguments unused;
  add_cell_options(cell, unused);
  std::istringstream words{text};
  for (std::string option, value; words >> option;) {
    if (cell.get_option_no_throw(option) == nullptr || !(words >> value) || shell_word(value) != value) {
      return {};
    }
  }
  return text;
}

std::string planned_cell(const std::string& file) { return cell_in(text_of_note(file, kCell)); }

std::string planned_cell_of(const MeasurementArguments& arguments) {
  const std::string own = planned_cell(arguments.measurements);
  return own.empty() && !arguments.joints_file.empty() ? planned_cell(arguments.joints_file) : own;
}

std::string planned_cell_of(const Json& result) {
  return result.is_object() && result.contains("provenance") ? cell_in(text_at(result["provenance"], "planned_cell"))
                                                             : std::string();
}

std::string places_note(const PlaceArguments& arguments) {
  return std::string(kPlaces) + (arguments.sockets.empty() ? arguments.directions : kTouches);
}

std::string planned_places(const std::string& file) {
  const std::string text = text_of_note(file, kPlaces);
  const bool directions = text == "r" || text.find_first_not_of("xyz") == std::string::npos;
  return directions || text == kTouches ? text : std::string();
}

}  // namespace kdl_calibration::cli
