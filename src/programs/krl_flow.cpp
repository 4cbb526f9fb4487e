#include "programs/krl_flow.hpp"

#include <unordered_map>

namespace kdl_calibration::krl {
namespace {

enum class Word : std::uint8_t {
  branch,
  otherwise,
  endif,
  choice,
  one_case,
  other_cases,
  endswitch,
  loop,
  endloop,
  counted,
  endfor,
  conditional,
  endwhile,
  repeat,
  until,
  exit,
  jump,
  leave
};

const std::unordered_map<std::string_view, Word>& words() {
  static const std::unordered_map<std::string_view, Word> all = {
      {"IF", Word::branch},     {"ELSE", Word::otherwise},      {"ENDIF", Word::endif},
      {"SWITCH", Word::choice}, {"CASE", Word::one_case},       {"DEFAULT", Word::other_cases},
      {"LOOP", Word::loop},     {"ENDSWITCH", Word::endswitch}, {"ENDLOOP", Word::endloop},
      {"FOR", Word::counted},   {"ENDFOR", Word::endfor},       {"WHILE", Word::conditional},
      {"REPEAT", Word::repeat}, {"ENDWHILE", Word::endwhile},   {"UNTIL", Word::until},
      {"EXIT", Word::exit},     {"GOTO", Word::jump},           {"RETURN", Word::leave}};
  return all;
}

FrameInForce joined(const FrameInForce& a, const FrameInForce& b) {
  FrameInForce result = b.kind == FrameInForce::Kind::unset ? a : b;
  result.is_certain = a.is_certain && b.is_certain && a.kind == b.kind && a.key == b.key;
  return result;
}

template <class Map, class Key>
void join_into(Map& map, const Key& key, const FramesInForce& frames) {
  const auto [entry, is_new] = map.emplace(key, frames);
  if (!is_new) {
    entry->second = joined(entry->second, frames);
  }
}

}  // namespace

FramesInForce joined(const FramesInForce& a, const FramesInForce& b) {
  if (!a.is_reached || !b.is_reached) {
    return a.is_reached ? a : b;
  }
  return {.tool = joined(a.tool, b.tool),
          .base = joined(a.base, b.base),
          .place = a.place == b.place ? a.place : ToolPlace::computed,
          .next = a.next == b.next ? a.next : FrameData{.tool = {}, .base = {}, .place = ToolPlace::computed}};
}

void Flow::set_tool(const FrameInForce& tool) {
  now_.tool = tool;
  summary_.sets[routine_].tool = true;
}

void Flow::set_base(const FrameInForce& base) {
  now_.base = base;
  summary_.sets[routine_].base = true;
}

void Flow::set_place(ToolPlace place) {
  now_.place = place;
  summary_.sets[routine_].place = true;
}

void Flow::set_next(const FrameData& next) {
  now_.next = next;
  summary_.sets[routine_].next = true;
}

void Flow::end_spline() {
  now_ = before_spline_.value_or(now_);
  before_spline_.reset();
}

void Flow::begin_routine(Routine routine) {
  routine_ = routine;
  const auto entry = previous_.entries.find(routine);
  now_ = entry == previous_.entries.end() ? FramesInForce() : entry->second;
  now_.is_reached = true;
  blocks_.clear();
  loops_.clear();
  before_spline_.reset();
}

void Flow::end_routine() {
  join_into(summary_.exits, routine_, now_);
  routine_ = 0;
}

bool Flow::statement(std::string_view word, std::string_view line) {
  const auto found = words().find(word);
  if (found == words().end()) {
    return false;
  }
  switch (found->second) {
    case Word::branch:
      begin(BlockKind::branch);
      break;
    case Word::otherwise:
      if (Block* block = open(BlockKind::branch)) {
        block->ends = now_;
        block->covers_all = true;
        now_ = block->entry;
      }
      break;
    case Word::endif:
      end_branch();
      break;
    case Word::choice:
      begin(BlockKind::choice);
      break;
    case Word::one_case:
    case Word::other_cases:
      next_case(found->second == Word::other_cases);
      break;
    case Word::endswitch:
      end_choice();
      break;
    case Word::loop:
    case Word::repeat:
      begin(BlockKind::loop);
      break;
    case Word::counted:
    case Word::conditional:
      begin(BlockKind::loop, true);
      break;
    case Word::endloop:
    case Word::endfor:
    case Word::endwhile:
    case Word::until:
      end_loop(found->second == Word::endloop);
      break;
    case Word::exit:
      exit_loop();
      break;
    case Word::jump:
      join_into(summary_.labels, std::pair(routine_, reference_at(rest_after(line, word.size())).name), now_);
      now_.is_reached = false;
      break;
    case Word::leave:
      join_into(summary_.exits, routine_, now_);
      now_.is_reached = false;
      break;
  }
  return true;
}

void Flow::begin(BlockKind kind, bool may_be_skipped) {
  Block block{.kind = kind, .entry = now_, .ends = {}, .may_be_skipped = may_be_skipped};
  if (kind == BlockKind::loop) {
    block.loop = summary_.loop_ends.size();
    summary_.loop_ends.push_back(now_);
    if (block.loop < previous_.loop_ends.size()) {
      now_ = joined(previous_.loop_ends[block.loop], now_);
    }
    loops_.push_back(blocks_.size());
  }
  blocks_.push_back(block);
}

void Flow::end_branch() {
  if (Block* block = open(BlockKind::branch)) {
    now_ = joined(block->covers_all ? *block->ends : block->entry, now_);
    blocks_.pop_back();
  }
}

void Flow::next_case(bool covers_all) {
  Block* block = open(BlockKind::choice);
  if (block == nullptr) {
    return;
  }
  if (block->has_case) {
    block->ends = block->ends ? joined(*block->ends, now_) : now_;
  }
  block->has_case = true;
  block->covers_all = block->covers_all || covers_all;
  now_ = block->entry;
}

void Flow::end_choice() {
  Block* block = open(BlockKind::choice);
  if (block == nullptr) {
    return;
  }
  if (block->ends) {
    now_ = joined(*block->ends, now_);
  }
  if (!block->covers_all) {
    now_ = joined(block->entry, now_);
  }
  blocks_.pop_back();
}

void Flow::end_loop(bool is_endless) {
  Block* block = open(BlockKind::loop);
  if (block == nullptr) {
    return;
  }
  summary_.loop_ends[block->loop] = now_;
  if (block->may_be_skipped) {
    now_ = joined(block->entry, now_);
  }
  if (block->ends) {  // EXIT
    now_ = is_endless ? *block->ends : joined(*block->ends, now_);
  }
  now_.is_reached = true;
  blocks_.pop_back();
  loops_.pop_back();
}

void Flow::exit_loop() {
  if (!loops_.empty()) {
    Block& block = blocks_[loops_.back()];
    block.ends = block.ends ? joined(*block.ends, now_) : now_;
  }
  now_.is_reached = false;
}

void Flow::label(const std::string& name) {
  if (const auto jumps = previous_.labels.find({routine_, name}); jumps != previous_.labels.end()) {
    now_ = joined(jumps->second, now_);
  }
  now_.is_reached = true;
}

void Flow::call(std::optional<Routine> routine) {
  FlowSummary::Sets& sets = summary_.sets[routine_];
  if (!routine) {
    now_.tool.is_certain = now_.base.is_certain = false;
    sets.tool = sets.base = true;
    return;
  }
  join_into(summary_.entries, *routine, now_);
  const auto called = previous_.sets.find(*routine);
  const auto exit = previous_.exits.find(*routine);
  if (called == previous_.sets.end() || exit == previous_.exits.end()) {
    return;
  }
  const FlowSummary::Sets& others = called->second;
  now_.tool = others.tool ? exit->second.tool : now_.tool;
  now_.base = others.base ? exit->second.base : now_.base;
  now_.place = others.place ? exit->second.place : now_.place;
  now_.next = others.next ? exit->second.next : now_.next;
  sets = {.tool = sets.tool || others.tool,
          .base = sets.base || others.base,
          .place = sets.place || others.place,
          .next = sets.next || others.next};
}

void Flow::interrupted_by(Routine routine) {
  FramesInForce frames = now_;
  frames.tool.is_certain = frames.base.is_certain = false;
  join_into(summary_.entries, routine, frames);
}

}  // namespace kdl_calibration::krl
