#pragma once

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <istream>
#include <vector>

namespace kdl_calibration::cli {

/// Options from a TOML or INI file: the keys of the section that is named after the subcommand in use, and those in
/// front of all sections as far as the subcommand has such an option. What the command line gives wins.
class ConfigFile : public CLI::ConfigBase {
public:
  explicit ConfigFile(const CLI::App& app) : app_(app) {}

  /// Throws InputError for a section that is no subcommand and a key that is no option.
  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

private:
  const CLI::App& app_;
};

}  // namespace kdl_calibration::cli
