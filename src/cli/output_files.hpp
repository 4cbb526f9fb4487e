#pragma once

#include <functional>
#include <string>
#include <vector>

#include "base/whole_files.hpp"

namespace kdl_calibration::cli {

using kdl_calibration::NamedFile;
using kdl_calibration::OutputFile;
using kdl_calibration::remove_temporaries_on_signals;

/// The output files whose option was given.
std::vector<OutputFile> given_outputs(const std::vector<NamedFile>& files);

/// Begins the list of the run's inputs with the files that the command line names and the bundled robot. Each file that
/// is opened from now on is added, and each that a result was made from. No output replaces a file of this list.
void protect_inputs(std::vector<NamedFile> named);

/// Reads files that nobody named, such as the neighbours of one. What it opens is no input if it throws InputError,
/// which ends here.
void read_on_trial(const std::function<void()>& read);

/// The same with the list of inputs. Call it before the work, behind the reading.
void require_writable(const std::vector<OutputFile>& files, bool force);

/// The same; `printed` then goes to standard output. The files are restored if it cannot be printed.
void write_whole(const std::vector<OutputFile>& files, bool force, const std::string& printed = {});
/// The same with a text that is known once the files are written.
void write_whole(const std::vector<OutputFile>& files, bool force, const std::function<std::string()>& printed);

}  // namespace kdl_calibration::cli
