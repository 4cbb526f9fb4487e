#pragma once

// Which tool and base are in force at each statement of a program in the KUKA Robot Language, along the branches,
// loops, jumps and calls of its text.

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "programs/krl_symbols.hpp"

namespace kdl_calibration::krl {

/// $TOOL or $BASE.
struct FrameInForce {
  enum class Kind : std::uint8_t {
    unset,     ///< the text sets none before
    known,     ///< the frame with the key
    computed,  ///< set to a value that is known at run time only
    moving     ///< a base that an external kinematic system or a conveyor moves
  };
  Kind kind = Kind::unset;
  std::size_t key = 0;
  bool is_certain = true;  ///< false where another branch or a routine may have set another one

  bool operator==(const FrameInForce&) const = default;
};

struct FramesInForce {
  FrameInForce tool;
  FrameInForce base;
  ToolPlace place = ToolPlace::unstated;
  FrameData next;  ///< FDAT_ACT, which BAS(#FRAMES) puts in force
  bool is_reached = true;

  bool operator==(const FramesInForce&) const = default;
};

/// What holds where two ways join: where they differ, the second, but not for certain.
FramesInForce joined(const FramesInForce& a, const FramesInForce& b);

/// What a walk through the text finds for the next walk: jumps and calls go backwards as well.
struct FlowSummary {
  struct Sets {
    bool tool = false;
    bool base = false;
    bool place = false;
    bool next = false;
    bool operator==(const Sets&) const = default;
  };
  std::vector<FramesInForce> loop_ends;
  std::map<std::pair<Routine, std::string>, FramesInForce> labels;  ///< at the jumps to them
  std::map<Routine, FramesInForce> entries;
  std::map<Routine, FramesInForce> exits;
  std::map<Routine, Sets> sets;

  bool operator==(const FlowSummary&) const = default;
};

/// Follows the control flow of one walk.
class Flow {
public:
  explicit Flow(const FlowSummary& previous) : previous_(previous) {}

  const FramesInForce& now() const { return now_; }
  const FlowSummary& summary() const { return summary_; }
  Routine routine() const { return routine_; }

  void set_tool(const FrameInForce& tool);
  void set_base(const FrameInForce& base);
  void set_place(ToolPlace place);
  void set_next(const FrameData& next);

  /// In a spline block other frames hold for the block alone.
  void begin_spline() { before_spline_ = now_; }
  void replace(const FramesInForce& frames) { now_ = frames; }
  void end_spline();

  void begin_routine(Routine routine);
  void end_routine();
  /// Whether the line is a statement of control flow.
  bool statement(std::string_view word, std::string_view line);
  void label(const std::string& name);
  /// A call of a routine of these texts, or of another.
  void call(std::optional<Routine> routine);
  /// A routine that an interrupt calls.
  void interrupted_by(Routine routine);

private:
  enum class BlockKind : std::uint8_t { branch, choice, loop };
  struct Block {
    BlockKind kind;
    FramesInForce entry;
    std::optional<FramesInForce> ends;  // joined
    bool has_case = false;
    bool covers_all = false;  // ELSE or DEFAULT
    bool may_be_skipped = false;
    std::size_t loop = 0;
  };

  void begin(BlockKind kind, bool may_be_skipped = false);
  Block* open(BlockKind kind) { return !blocks_.empty() && blocks_.back().kind == kind ? &blocks_.back() : nullptr; }
  void next_case(bool covers_all);
  void end_choice();
  void end_branch();
  void end_loop(bool is_endless);
  void exit_loop();

  const FlowSummary& previous_;
  FlowSummary summary_;
  FramesInForce now_;
  Routine routine_ = 0;
  std::vector<Block> blocks_;
  std::vector<std::size_t> loops_;  // indices of blocks
  std::optional<FramesInForce> before_spline_;
};

}  // namespace kdl_calibration::krl
