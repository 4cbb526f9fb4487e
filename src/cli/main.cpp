#include <malloc.h>
#include <sys/resource.h>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>
#include <algorithm>
#include <csignal>
#include <cstdio>
#include <exception>
#include <map>
#include <memory>
#include <new>
#include <string>
#include <utility>
#include <vector>

#include "base/text.hpp"
#include "calibration/calibration_settings.hpp"
#include "cli/config_file.hpp"
#include "cli/help.hpp"
#include "cli/options.hpp"
#include "cli/output_files.hpp"
#include "cli/subcommands.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

std::string chosen_name(const CLI::App& parser) {
  const auto chosen = parser.get_subcommands();
  return "kdlcal" + (chosen.empty() ? "" : " " + chosen.front()->get_name());
}

std::string subcommand_names(const CLI::App& parser) {
  std::vector<std::string> names;
  for (const CLI::App* subcommand : parser.get_subcommands([](const CLI::App*) { return true; })) {
    names.push_back(subcommand->get_name());
  }
  return comma_separated(names);
}

std::vector<std::string> option_names(const CLI::App& subcommand) {
  std::vector<std::string> names;
  for (const CLI::Option* option : subcommand.get_options()) {
    names.push_back(option->get_name());
  }
  return names;
}

// Prints the error on one line.
int refuse(const std::string& message) {
  constexpr std::size_t kLongestMessage = 400;
  const std::string line = shortened(one_line(message), kLongestMessage) + "\n";
  std::fwrite(line.data(), 1, line.size(), stderr);
  return bad_input;
}

// The parser's message, rewritten where it uses internal terms.
std::string in_plain_words(const CLI::App& parser, const CLI::ParseError& error) {
  std::string message = error.what();
  const std::string option = message.substr(0, message.find(':'));
  const auto says = [&](const char* words) { return message.find(words) != std::string::npos; };
  if (dynamic_cast<const CLI::FileError*>(&error) != nullptr) {
    return "--config: '" + parser.get_config_ptr()->as<std::string>() + "' cannot be read, expected a TOML or INI file";
  }
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr && says("missing")) {
    return option + ": has no value, expected one";
  }
  if (dynamic_cast<const CLI::ArgumentMismatch*>(&error) != nullptr && says("At Most")) {
    return option + ": is given more than once, expected once";
  }
  const std::string excludes = " excludes ";
  if (const std::size_t at = message.find(excludes);
      at != std::string::npos && dynamic_cast<const CLI::ExcludesError*>(&error) != nullptr) {
    return message.replace(at, excludes.size(), ": is given beside ") + ", expected one of the two";
  }
  return message;
}

// The parser's error in one sentence. An unknown argument is named first, because it is often why a required one is
// missing.
std::string usage_fault(const CLI::App& parser, const CLI::ParseError& error) {
  const std::vector<std::string> unknown = parser.remaining(true);
  if (parser.get_subcommands().empty()) {
    const std::string first = unknown.empty() ? "no subcommand" : "'" + unknown.front() + "' is no subcommand";
    return "kdlcal: " + first + ", expected one of " + subcommand_names(parser);
  }
  const std::string command = chosen_name(parser);
  if (!unknown.empty()) {
    const std::string meant =
        nearest(unknown.front().substr(0, unknown.front().find('=')), option_names(*parser.get_subcommands().front()));
    return command + ": '" + unknown.front() + "' is not expected here, " +
           (meant.empty() ? "" : "did you mean " + meant + "? See ") + (meant.empty() ? "see " : "") + command +
           " --help";
  }
  return command + ": " + in_plain_words(parser, error) + ", see " + command + " --help";
}

// Protects the files that options name, even those that the run does not read.
void protect_named_files(const CLI::App& parser, const CLI::App& subcommand) {
  std::vector<NamedFile> named;
  for (const CLI::App* app : {&parser, &subcommand}) {
    for (const CLI::Option* option : app->get_options()) {
      const std::string type = option->get_type_name();
      for (const std::string& text : type.ends_with("FILE") ? option->results() : std::vector<std::string>()) {
        named.push_back({.option = option->get_name(), .path = text});
        if (type == "[STATION=]FILE") {
          named.push_back({.option = option->get_name(), .path = text.substr(text.find('=') + 1)});
        }
      }
    }
  }
  protect_inputs(std::move(named));
}

int run(int argc, const char* const* argv) {
  CLI::App parser(
      "Kinematic calibration of robot arms: finds the geometric errors that explain what a tracker measured", "kdlcal");
  parser.formatter(std::make_shared<HelpFormatter>());
  parser.set_version_flag("--version", "kdlcal " KDL_CALIBRATION_VERSION);
  parser.set_config("--config", "", "Options from a TOML or INI file, in a section named after the subcommand")
      ->type_name("FILE")
      ->check(not_empty("a file name"));
  parser.config_formatter(std::make_shared<ConfigFile>(parser));
  parser.allow_config_extras(CLI::config_extras_mode::error);
  parser.require_subcommand(1);
  parser.fallthrough();
  const std::vector<Subcommand> subcommands = {
      add_model(parser),    add_fk(parser),     add_jacobian(parser),   add_simulate(parser), add_calibrate(parser),
      add_validate(parser), add_plan(parser),   add_compensate(parser), add_frames(parser),   add_report(parser),
      add_export(parser),   add_import(parser), add_compare(parser),    add_apply(parser)};
  try {
    parser.parse(argc, argv);
  } catch (const CLI::CallForHelp&) {
    print(parser.help());
    return done;
  } catch (const CLI::CallForVersion& version) {
    print(std::string(version.what()) + "\n");
    return done;
  } catch (const CLI::ParseError& error) {
    return refuse(usage_fault(parser, error));
  }
  const auto chosen = std::find_if(subcommands.begin(), subcommands.end(),
                                   [](const Subcommand& subcommand) { return subcommand.app->parsed(); });
  protect_named_files(parser, *chosen->app);
  return chosen->run();
}

// The option of kdlcal for a member of CalibrationOptions.
std::string option_of(const std::string& member) {
  static const std::map<std::string, std::string> others = {{"weights", "--noise"},
                                                            {"effects.gravity_direction", "--gravity-direction"},
                                                            {"effects.payload_centre", "--payload-centre"},
                                                            {"effects.payload_centres", "--payload-centre"},
                                                            {"noise.orientation", "--orientation-sigma"},
                                                            {"noise.independent", "--noise-independent"},
                                                            {"noise.tracker", "--noise-tracker"},
                                                            {"known.bases", "--known-base"},
                                                            {"known.targets", "--known-targets"},
                                                            {"keep_axes", "--keep-axes"},
                                                            {"priors.earlier", "--prior-result"}};
  const auto found = others.find(member);
  return found == others.end() ? "--" + member : found->second;
}

std::string in_options(const OptionError& error) {
  std::vector<std::string> remedies;
  for (const std::string& member : error.remedies()) {
    remedies.push_back(option_of(member));
  }
  return option_of(error.option()) + ": " + error.fault() +
         (remedies.empty() ? "" : "; see " + comma_separated(remedies));
}

// Input is bounded, by 100 levels of JSON and XML and 2,000 joints: all of it takes less than half of this stack.
void require_stack() {
  constexpr rlim_t kLeast = rlim_t{1} << 20U;
  struct rlimit limit = {};
  if (::getrlimit(RLIMIT_STACK, &limit) == 0 && limit.rlim_cur < kLeast) {
    throw InputError("the stack is limited to " + std::to_string(limit.rlim_cur >> 10U) +
                     " KiB, expected at least 1024 KiB: ulimit -s 1024");
  }
}

// Keeps freed memory: new pages for large matrices cost more time than the arithmetic on them.
void keep_freed_memory() {
#ifdef __GLIBC__
  constexpr int kMost = 1 << 25;  // bytes
  ::mallopt(M_MMAP_THRESHOLD, kMost);
  ::mallopt(M_TRIM_THRESHOLD, 8 * kMost);
#endif
}

int run_or_refuse(int argc, const char* const* argv) {
  try {
    require_stack();
    return run(argc, argv);
  } catch (const std::bad_alloc&) {
    return refuse("kdlcal: out of memory, expected less data");
  } catch (const OptionError& error) {
    return refuse("kdlcal: " + in_options(error));
  } catch (const std::exception& error) {
    return refuse(std::string("kdlcal: ") + error.what());
  } catch (...) {
    return refuse("kdlcal: failed for an unknown reason");
  }
}

}  // namespace
}  // namespace kdl_calibration::cli

int main(int argc, char** argv) {
  // Exceeding the file size limit must be a failed write, not end the process.
  std::signal(SIGXFSZ, SIG_IGN);
  kdl_calibration::cli::keep_freed_memory();
  kdl_calibration::cli::remove_temporaries_on_signals();
  return kdl_calibration::cli::run_or_refuse(argc, argv);
}
