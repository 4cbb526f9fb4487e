#pragma once

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <string>
#include <vector>

namespace kdl_calibration::cli {

/// Formats the help within 80 columns.
class HelpFormatter : public CLI::Formatter {
public:
  std::string make_option(const CLI::Option* option, bool is_positional) const override;
  std::string make_description(const CLI::App* app) const override;
  /// In the list of subcommands, with the first line of its description.
  std::string make_subcommand(const CLI::App* subcommand) const override;
};

/// Groups options, named with their dashes, under a heading of the help.
void add_group(CLI::App& app, const std::string& heading, const std::vector<std::string>& options);

/// The most similar word to a mistyped one: fewest letters added, omitted, changed or transposed, at most a third of
/// them; empty if there is none.
std::string nearest(const std::string& mistyped, const std::vector<std::string>& words);

}  // namespace kdl_calibration::cli
