#pragma once

// The variables of a program in the KUKA Robot Language: what its data lists (.dat) and its declarations state.

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "programs/krl_calls.hpp"
#include "programs/krl_position.hpp"
#include "programs/krl_text.hpp"

namespace kdl_calibration::krl {

/// $IPO_MODE: where the tool is.
enum class ToolPlace : std::uint8_t { unstated, on_arm, in_cell, computed };

/// Tool, base and interpolation of a motion: {TOOL_NO 1,BASE_NO 2,IPO_FRAME #BASE}. Numbers below zero are not taught.
struct FrameData {
  std::optional<int> tool;
  std::optional<int> base;
  ToolPlace place = ToolPlace::unstated;

  bool operator==(const FrameData&) const = default;
};
FrameData frame_data_of(const Aggregate& aggregate);
/// #BASE or #TCP
ToolPlace tool_place_of(std::string_view value);

/// A variable, or an element of an array, that texts assign an aggregate to.
struct Symbol {
  std::string name;  ///< as its first text writes it
  Place place;
  bool is_frame = false;    ///< of the type FRAME, which states frames and offsets as well
  bool is_changed = false;  ///< assigned other values, or several
  std::optional<Position> position;
  std::optional<FrameData> frame_data;
};

/// A routine is counted in the order of the texts from 1; 0: outside of routines.
using Routine = std::size_t;

/// A line that begins or ends a routine or a data list.
struct RoutineLine {
  enum class Kind : std::uint8_t { none, routine, data, end_of_routine, end_of_data } kind = Kind::none;
  std::string name;  ///< of a routine, in upper case
};
RoutineLine routine_line(std::string_view line);

class Symbols {
public:
  /// Reads declarations and assignments. Throws InputError with file and line.
  explicit Symbols(const std::vector<ProgramText>& texts);

  const std::vector<Symbol>& all() const { return symbols_; }

  /// Index of the variable that a routine means; none where no aggregate is assigned to it.
  std::optional<std::size_t> find(const Reference& reference, Routine routine) const;
  /// All elements of an array.
  std::vector<std::size_t> elements(const Reference& reference, Routine routine) const;
  /// Whether a text here declares the variable.
  bool is_declared(const Reference& reference, Routine routine) const;
  /// A whole number, a constant, or a member of frame data.
  std::optional<int> whole(std::string_view expression, Routine routine) const;
  /// The routine with this name in upper case.
  std::optional<Routine> routine(const std::string& name) const;

private:
  struct Declaration {
    std::string type;
    bool is_constant = false;
  };

  void read(const ProgramText& text, std::size_t file);
  RoutineLine::Kind next_part(const RoutineLine& bound, RoutineLine::Kind open, std::string_view line,
                              const Place& place);
  bool declares(std::string_view line, const Place& place);
  void declare(std::string_view part, const Declaration& declaration, const Place& place);
  void assign(std::string_view line, const Place& place);
  void define(const Reference& left, std::string_view line, std::string_view value, const Place& place);
  void change(const Reference& left, Routine routine);
  void change_arguments();
  void mark_changed();
  std::string key(const std::string& name, Routine routine) const;
  std::optional<std::string> element_key(const Reference& reference, Routine routine) const;

  std::vector<Symbol> symbols_;
  std::unordered_map<std::string, std::size_t> index_;  // by key
  std::unordered_map<std::string, std::vector<std::size_t>> elements_;
  std::unordered_map<std::string, std::string> types_;
  std::unordered_set<Routine> have_own_;  // variables
  std::unordered_map<std::string, int> constants_;
  std::unordered_set<std::string> initial_;  // keys with a value in their declaration
  std::unordered_set<std::string> changed_;
  std::unordered_set<std::string> assigned_;  // keys of variables, without index
  std::unordered_map<Routine, std::vector<Parameter>> parameters_;
  std::vector<Call> calls_;
  std::unordered_map<std::string, Routine> routines_;
  Routine now_ = 0;
  Routine count_ = 0;
};

}  // namespace kdl_calibration::krl
