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

/// Registers the input files of the command line. They and the bundled robot are never written to.
void protect_inputs(std::vector<NamedFile> inputs);

/// The same with the registered inputs. Call it before the work.
void require_writable(const std::vector<OutputFile>& files, bool force);

/// The same; the files are renamed when `printed` is on standard output.
void write_whole(const std::vector<OutputFile>& files, bool force, const std::string& printed = {});
/// The same with a text that is known once the files are written.
void write_whole(const std::vector<OutputFile>& files, bool force, const std::function<std::string()>& printed);

}  // namespace kdl_calibration::cli
