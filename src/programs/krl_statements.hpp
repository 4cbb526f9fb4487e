#pragma once

// The statements of a program in the KUKA Robot Language but motions: what they put in force.

#include <optional>
#include <string>
#include <string_view>

#include "programs/krl_flow.hpp"
#include "programs/krl_frames.hpp"
#include "programs/krl_notes.hpp"
#include "programs/krl_symbols.hpp"

namespace kdl_calibration::krl {

/// Where a word in upper case stands outside of brackets; none if it does not.
std::optional<std::size_t> find_word(std::string_view text, std::string_view word);

class StatementReader {
public:
  /// Without notes nothing is recorded.
  StatementReader(const Symbols& symbols, FrameValues& frames, const FlowSummary& previous, Notes* notes)
      : symbols_(symbols), frames_(frames), flow_(previous), notes_(notes) {}

  const FramesInForce& now() const { return flow_.now(); }
  Routine routine() const { return flow_.routine(); }
  const FlowSummary& summary() const { return flow_.summary(); }

  void begin_routine(Routine routine) { flow_.begin_routine(routine); }
  void end_routine() { flow_.end_routine(); }

  /// Reads a statement that is no motion. `word`: its first, in upper case.
  void read(const std::string& word, std::string_view line, const Place& place);
  /// These frames with $TOOL, $BASE and $IPO_MODE of the assignments behind WITH.
  FramesInForce with(FramesInForce frames, std::string_view assignments, const Place& place);

private:
  void note(Note note) {
    if (notes_ != nullptr) {
      notes_->add(note, place_.file, place_.line);
    }
  }

  void call(const std::string& name, std::string_view rest);
  void bas(std::string_view arguments);
  void assignment(const Reference& left, std::string_view value);
  void next_frames(const Reference& left, std::string_view value);
  void copies(std::string_view value);
  void interrupt(std::string_view line);
  void put_next_in_force();
  void set_frame(const FrameInForce& value, bool is_tool);

  const Symbols& symbols_;
  FrameValues& frames_;
  Flow flow_;
  Notes* notes_;
  Place place_;
};

}  // namespace kdl_calibration::krl
