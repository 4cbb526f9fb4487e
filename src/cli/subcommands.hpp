#pragma once

#include <CLI/App.hpp>
#include <functional>
#include <string>

namespace kdl_calibration::cli {

/// Exit status of kdlcal.
enum ExitStatus { done = 0, not_to_be_trusted = 1, bad_input = 2 };

/// A subcommand of the parser, and the function that runs it after parsing. Running throws InputError for bad input.
struct Subcommand {
  CLI::App* app = nullptr;
  std::function<ExitStatus()> run;
};

Subcommand add_model(CLI::App& parser);
Subcommand add_fk(CLI::App& parser);
Subcommand add_jacobian(CLI::App& parser);
Subcommand add_simulate(CLI::App& parser);
Subcommand add_calibrate(CLI::App& parser);
Subcommand add_validate(CLI::App& parser);
Subcommand add_plan(CLI::App& parser);
Subcommand add_compensate(CLI::App& parser);
Subcommand add_frames(CLI::App& parser);
Subcommand add_compare(CLI::App& parser);
Subcommand add_apply(CLI::App& parser);
Subcommand add_report(CLI::App& parser);
Subcommand add_export(CLI::App& parser);
Subcommand add_import(CLI::App& parser);

}  // namespace kdl_calibration::cli
