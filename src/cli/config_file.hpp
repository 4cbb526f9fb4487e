#pragma once

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <istream>
#include <vector>

namespace kdl_calibration::cli {

/// Options from a TOML or INI file: keys of the section named after the subcommand, and keys before all sections if the
/// subcommand has such an option. The command line takes precedence.
class ConfigFile : public CLI::ConfigBase {
public:
  explicit ConfigFile(const CLI::App& app) : app_(app) {}

  /// Throws InputError for a section that is not a subcommand and a key that is not an option.
  std::vector<CLI::ConfigItem> from_config(std::istream& input) const override;

private:
  const CLI::App& app_;
};

}  // namespace kdl_calibration::cli
