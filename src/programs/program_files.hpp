#pragma once

// The files of a program, before and after its compensation.

#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "base/parallel.hpp"
#include "base/whole_files.hpp"
#include "programs/compensated_program.hpp"
#include "programs/program.hpp"

namespace kdl_calibration {

/// A program: its file, and the one that belongs to it in its language, motions before points.
struct ProgramFiles {
  std::string named;  ///< file that was given: one of the texts
  const ProgramLanguage* language = nullptr;
  std::vector<ProgramText> texts;
};

/// Reads a program in the language of its text. Throws InputError for files that are unreadable, larger than 512 MiB or
/// in no known language.
ProgramFiles read_program(const std::string& file);

/// Throws InputError if the record beside one of the files says that the program is compensated already.
void require_original(const ProgramFiles& program);

/// Where the texts and the record go, without texts: the given file to `output`, the one beside it to the same stem
/// with its own extension, the record behind them.
std::vector<OutputFile> program_outputs(const ProgramFiles& program, const std::string& output);

/// The record without its positions: hashes of the result and of the texts, straight lines, warnings. `line_tolerance`
/// [m] is that of the compensation.
std::string record_head(const CompensatedProgram& program, const std::string& result_sha256, double line_tolerance);
/// The record (JSON), piece by piece. `head`: of record_head.
void write_record(const std::string& head, const CompensatedProgram& program, const TextSink& sink);

/// A text of many positions, piece by piece: add(i, text) appends that of a position.
template <class Add>
void write_positions(std::size_t count, const TextSink& sink, const Add& add) {
  constexpr std::size_t kBlock = 512;
  constexpr std::size_t kAtOnce = 64 * kBlock;
  for (std::size_t first = 0; first < count; first += kAtOnce) {
    const std::size_t size = std::min(kAtOnce, count - first);
    std::vector<std::string> blocks((size + kBlock - 1) / kBlock);
    parallel_blocks(size, kBlock, 0, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) {
        add(first + i, blocks[begin / kBlock]);
      }
    });
    for (const std::string& block : blocks) {
      sink(block);
    }
  }
}

}  // namespace kdl_calibration
