#pragma once

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <string>
#include <vector>

namespace kdl_calibration::cli {

/// Help within 80 columns.
class HelpFormatter : public CLI::Formatter {
public:
  std::string make_option(const CLI::Option* option, bool is_positional) const override;
  std::string make_description(const CLI::App* app) const override;
};

/// Puts options of the app, named with their dashes, under a heading of the help.
void add_group(CLI::App& app, const std::string& heading, const std::vector<std::string>& options);

/// The word that a mistyped one was most likely meant to be: the fewest letters added, left out, changed or exchanged
/// with their neighbour, at most a third of them; empty where there is none.
std::string nearest(const std::string& mistyped, const std::vector<std::string>& words);

}  // namespace kdl_calibration::cli
