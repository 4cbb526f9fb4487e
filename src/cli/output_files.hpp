#pragma once

#include <string>
#include <vector>

namespace kdl_calibration::cli {

/// A file to write.
struct OutputFile {
  std::string option;  ///< the option that named it, for messages
  std::string path;
  std::string text;
};

/// A file to read.
struct NamedFile {
  std::string option;
  std::string path;
};

/// The output files whose option was given.
std::vector<OutputFile> given_outputs(const std::vector<NamedFile>& files);

/// Registers the input files of the command line. They and the bundled robot are never written to under any name
/// (links, spellings, hard links), except by the same option.
void protect_inputs(std::vector<NamedFile> inputs);

/// Makes signals that end the process (Ctrl-C) first remove the temporary files of write_whole.
void remove_temporaries_on_signals();

/// Call it before the work. Throws InputError if a file exists and `force` is false, is not a regular file, has no name
/// or cannot be created. Also refused: an input file, and the same file twice.
void require_writable(const std::vector<OutputFile>& files, bool force);

/// Writes all files or none: first to temporary files beside their targets, which are renamed when all bytes are on
/// disk and `printed` is on standard output. On failure throws InputError and leaves all files unchanged.
void write_whole(const std::vector<OutputFile>& files, bool force, const std::string& printed = {});

}  // namespace kdl_calibration::cli
