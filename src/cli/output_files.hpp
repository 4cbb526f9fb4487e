#pragma once

#include <string>
#include <vector>

namespace kdl_calibration::cli {

/// A file that a subcommand was asked to write.
struct OutputFile {
  std::string option;  ///< that named it, for messages
  std::string path;
  std::string text;
};

/// A file that an option named.
struct NamedFile {
  std::string option;
  std::string path;
};

/// Those to write: the files whose option is given.
std::vector<OutputFile> given_outputs(const std::vector<NamedFile>& files);

/// All files that the command line names. From now on none of them but the one of the same option is written to, under
/// whatever name: through links, other spellings or hard links. Nor is the robot that comes with kdlcal.
void protect_inputs(std::vector<NamedFile> inputs);

/// From now on a signal that ends the process (Ctrl-C) first removes the temporary files of write_whole.
void remove_temporaries_on_signals();

/// To be called before the work: throws InputError where a file exists and `force` does not say to overwrite it, is no
/// regular file or no name at all, or cannot be created in its directory, and where two of them are the same file or
/// one is an input.
void require_writable(const std::vector<OutputFile>& files, bool force);

/// Writes each file whole or not at all: all of them into temporary files beside their targets first, which are
/// renamed only when every byte is on the disk and `printed` is on standard output. Throws InputError and leaves
/// everything as it was where that fails.
void write_whole(const std::vector<OutputFile>& files, bool force, const std::string& printed = {});

}  // namespace kdl_calibration::cli
