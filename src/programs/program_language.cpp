#include "programs/program_language.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <filesystem>

#include "base/text.hpp"
#include "base/text_file.hpp"
#include "base/units.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/krl_program.hpp"
#include "programs/ls_program.hpp"
#include "programs/rapid_program.hpp"
#include "programs/ur_program.hpp"

namespace kdl_calibration {
namespace {

std::string all_languages() {
  std::vector<std::string> names;
  for (const ProgramLanguage* language : program_languages()) {
    names.push_back(fmt::format("{} ({})", language->name, language->files));
  }
  return comma_separated(names);
}

}  // namespace

const std::vector<const ProgramLanguage*>& program_languages() {
  static const std::vector<const ProgramLanguage*> languages = {&fanuc_ls(), &abb_rapid(), &kuka_krl(), &ur_script()};
  return languages;
}

const ProgramLanguage& language_of(const ProgramText& text) {
  if (text.text.starts_with("\x1f\x8b")) {  // gzip
    throw InputError(text.source +
                     ": is compressed, as a .urp of Universal Robots is, whose format is not documented, expected the "
                     ".script that the controller saves beside it");
  }
  const auto& languages = program_languages();
  const auto found = std::find_if(languages.begin(), languages.end(),
                                  [&](const ProgramLanguage* language) { return language->is_written_in(text.text); });
  if (found == languages.end()) {
    throw InputError(fmt::format("{}:1: begins with {}, expected a program in one of these languages: {}", text.source,
                                 shown(text.text.substr(0, text.text.find('\n'))), all_languages()));
  }
  return **found;
}

const ProgramLanguage& language_of_file(const std::string& file) {
  const std::string extension = lower_ending(file);
  for (const ProgramLanguage* language : program_languages()) {
    const std::string files = lower_case(language->files);
    if (files.substr(0, files.find(',')) == extension) {
      return *language;
    }
  }
  throw InputError(fmt::format("{}: expected the ending of one of these languages: {}", file, all_languages()));
}

}  // namespace kdl_calibration
