#pragma once

// Files that are written as a whole or not at all.

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace kdl_calibration {

using TextSink = std::function<void(std::string_view piece)>;

/// A file to write.
struct OutputFile {
  std::string option;  ///< the option that named it, for messages; may be empty
  std::string path;
  std::string text;
  std::function<void(const TextSink& write)> pieces = {};  ///< writes a text that is too large for memory; else empty
};
/// A file to read.
struct NamedFile {
  std::string option;
  std::string path;
  std::string reason = option + " reads";  ///< why it is an input, for messages
  std::string sha256 = {};                 ///< a file with this hash is it as well, wherever it is; empty: none
};

/// Makes signals that end the process (Ctrl-C) first remove the temporary files of write_whole.
void remove_temporaries_on_signals();

/// Throws InputError if a file exists and `force` is false, is not a regular file, has no name or cannot be created.
/// Also refused: one of the inputs under any name (links, spellings, hard links), and the same file twice. `inputs` may
/// name the outputs, by the same options.
void require_writable(const std::vector<OutputFile>& files, const std::vector<NamedFile>& inputs, bool force);

/// Writes all files or none: first to temporary files beside their targets, which are then renamed. `after_renaming`
/// may throw. On failure throws InputError as above, or what was thrown, and restores all files. Some file systems
/// cannot restore a replaced file; the error then names those that were written.
void write_whole(const std::vector<OutputFile>& files, const std::vector<NamedFile>& inputs, bool force,
                 const std::function<void()>& after_renaming = {});

}  // namespace kdl_calibration
