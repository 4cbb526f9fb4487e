#pragma once

#include <string>
#include <vector>

#include "programs/program.hpp"

namespace kdl_calibration {

/// All languages whose programs are read.
const std::vector<const ProgramLanguage*>& program_languages();

/// The language of a text. Throws InputError, with the languages that there are, if it is in none of them.
const ProgramLanguage& language_of(const ProgramText& text);

/// The language of files with this extension, in small or capital letters. Throws InputError, as language_of.
const ProgramLanguage& language_of_file(const std::string& file);

}  // namespace kdl_calibration
