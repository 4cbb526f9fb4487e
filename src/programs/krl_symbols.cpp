#include "programs/krl_symbols.hpp"

#include <algorithm>
#include <array>

#include "base/text.hpp"

namespace kdl_calibration::krl {
namespace {

constexpr std::array<std::string_view, 5> kPositionTypes = {"POS", "E6POS", "AXIS", "E6AXIS", "FRAME"};
constexpr std::array<std::string_view, 5> kOtherTypes = {"INT", "REAL", "BOOL", "CHAR", "FDAT"};

bool is_one_of(std::string_view word, const auto& words) {
  return std::any_of(words.begin(), words.end(), [&](std::string_view each) { return is_word(word, each); });
}

// Of "DEFFCT CHAR[128] NAME(A :IN)" behind its first word.
std::string routine_name(std::string_view head) {
  head = stripped(head.substr(0, head.find('(')));
  return in_upper_case(stripped(head.substr(std::min(head.find_last_of(" \t]") + 1, head.size()))));
}

bool has_member(const Aggregate& aggregate, std::string_view name) {
  return std::any_of(aggregate.members.begin(), aggregate.members.end(),
                     [&](const Member& member) { return is_word(member.name, name); });
}

bool is_data_list(const ProgramText& text) {
  Lines lines(text);
  for (std::string_view line; lines.next(line);) {
    if (const RoutineLine::Kind kind = routine_line(line).kind; kind != RoutineLine::Kind::none) {
      return kind == RoutineLine::Kind::data;
    }
  }
  return false;
}

}  // namespace

ToolPlace tool_place_of(std::string_view value) {
  return is_word(value, "#BASE")  ? ToolPlace::on_arm
         : is_word(value, "#TCP") ? ToolPlace::in_cell
                                  : ToolPlace::computed;
}

FrameData frame_data_of(const Aggregate& aggregate) {
  FrameData data;
  for (const Member& member : aggregate.members) {
    if (is_word(member.name, "TOOL_NO")) {
      data.tool = whole_number_in(member.value);
    } else if (is_word(member.name, "BASE_NO")) {
      data.base = whole_number_in(member.value);
    } else if (is_word(member.name, "IPO_FRAME")) {
      data.place = tool_place_of(member.value);
    }
  }
  return data;
}

RoutineLine routine_line(std::string_view line) {
  using LineKind = RoutineLine::Kind;
  std::string_view word = word_at(line);
  if (is_word(word, "GLOBAL")) {
    line = rest_after(line, word.size());
    word = word_at(line);
  }
  if (is_word(word, "DEF") || is_word(word, "DEFFCT")) {
    return {.kind = LineKind::routine, .name = routine_name(rest_after(line, word.size()))};
  }
  if (is_word(word, "DEFDAT")) {
    return {.kind = LineKind::data, .name = {}};
  }
  if (is_word(word, "END") || is_word(word, "ENDFCT")) {
    return {.kind = LineKind::end_of_routine, .name = {}};
  }
  return {.kind = is_word(word, "ENDDAT") ? LineKind::end_of_data : LineKind::none, .name = {}};
}

// Data lists first: their constants and types hold in the routines.
Symbols::Symbols(const std::vector<ProgramText>& texts) {
  for (const bool is_data : {true, false}) {
    for (std::size_t file = 0; file < texts.size(); ++file) {
      if (is_data_list(texts[file]) == is_data) {
        read(texts[file], file);
      }
    }
  }
  change_arguments();
  mark_changed();
}

void Symbols::read(const ProgramText& text, std::size_t file) {
  using LineKind = RoutineLine::Kind;
  Lines lines(text, file);
  LineKind open = LineKind::none;
  bool has_part = false;
  for (std::string_view line; lines.next(line);) {
    const RoutineLine bound = routine_line(line);
    if (bound.kind != LineKind::none) {
      open = next_part(bound, open, line, lines.place());
      has_part = true;
    } else if (!has_part) {
      fail(lines.place(), "has " + shown(line) + " before DEF, DEFFCT or DEFDAT, expected a program in KRL");
    } else if (!declares(line, lines.place())) {
      assign(line, lines.place());
    }
  }
  if (!has_part) {
    fail(lines.place(), "holds no DEF, no DEFFCT and no DEFDAT, expected a program in KRL");
  }
  if (open != LineKind::none) {
    fail(lines.place(), open == LineKind::routine ? "ends without END, expected the whole routine"
                                                  : "ends without ENDDAT, expected the whole data list");
  }
}

// The part that is open behind a line that begins or ends one.
RoutineLine::Kind Symbols::next_part(const RoutineLine& bound, RoutineLine::Kind open, std::string_view line,
                                     const Place& place) {
  using LineKind = RoutineLine::Kind;
  if (bound.kind == LineKind::routine || bound.kind == LineKind::data) {
    if (open != LineKind::none) {
      fail(place, "has " + shown(line) + " inside of another routine or data list, expected its end before");
    }
    if (bound.kind == LineKind::routine) {
      now_ = ++count_;
      routines_.emplace(bound.name, now_);
      for (const Parameter& parameter : parameters_[now_] = parameters_of(line)) {
        types_[std::to_string(now_) + "#" + parameter.name];  // its own, whatever else has this name
        have_own_.insert(now_);
      }
    }
    return bound.kind;
  }
  const LineKind end = open == LineKind::data ? LineKind::end_of_data : LineKind::end_of_routine;
  if (open != LineKind::none && bound.kind != end) {
    fail(place, "has " + shown(line) + ", expected " + (open == LineKind::data ? "ENDDAT" : "END"));
  }
  now_ = 0;
  return LineKind::none;
}

// DECL GLOBAL E6POS XP1={...},XP2
bool Symbols::declares(std::string_view line, const Place& place) {
  Declaration declaration;
  bool is_declaration = false;
  for (std::string_view word = word_at(line); !word.empty(); word = word_at(line)) {
    const bool is_constant = is_word(word, "CONST");
    const bool is_modifier = is_constant || is_word(word, "DECL") || is_word(word, "GLOBAL");
    declaration.is_constant = declaration.is_constant || is_constant;
    if (!is_modifier && !is_declaration && !is_one_of(word, kPositionTypes) && !is_one_of(word, kOtherTypes)) {
      return false;
    }
    line = rest_after(line, word.size());
    is_declaration = true;
    if (!is_modifier) {
      declaration.type = in_upper_case(word);
      break;
    }
  }
  if (!is_declaration || declaration.type == "INTERRUPT") {
    return is_declaration;
  }
  for (const std::string_view part : list_parts(line)) {
    declare(part, declaration, place);
  }
  return true;
}

void Symbols::declare(std::string_view part, const Declaration& declaration, const Place& place) {
  const Reference left = reference_at(part);
  if (left.name.empty()) {
    return;
  }
  // The names of a routine are its own.
  const std::string own = now_ > 0 ? std::to_string(now_) + "#" + left.name : left.name;
  types_[own] = declaration.type;
  if (now_ > 0) {
    have_own_.insert(now_);
  }
  const std::optional<std::string_view> value = assigned_value(part, left);
  if (!value) {
    return;
  }
  if (declaration.is_constant && !left.index) {
    if (const std::optional<int> whole = whole_number_in(*value)) {
      constants_[own] = *whole;
    }
  }
  if (!initial_.insert(element_key(left, now_).value_or(own)).second) {
    fail(place, printable(part.substr(0, left.size)) + " is declared twice, expected each variable once");
  }
  if (value->starts_with('{')) {
    define(left, part, *value, place);
  }
}

void Symbols::assign(std::string_view line, const Place& place) {
  if (line.find('(') != std::string_view::npos) {
    const std::vector<Call> calls = calls_in(line, now_);
    calls_.insert(calls_.end(), calls.begin(), calls.end());
  }
  const std::string_view word = word_at(line);
  if (is_word(word, "FOR")) {
    line = rest_after(line, word.size());
  }
  const Reference left = reference_at(line);
  if (left.name.starts_with('$')) {
    return;
  }
  if (const std::optional<std::string_view> value = assigned_value(line, left)) {
    assigned_.insert(key(left.name, now_));
    if (left.member.empty() && value->starts_with('{')) {
      define(left, line, *value, place);
    } else {
      change(left, now_);
    }
  }
}

void Symbols::define(const Reference& left, std::string_view line, std::string_view value, const Place& place) {
  const std::string array = key(left.name, now_);
  const auto type = types_.find(array);
  const std::string_view type_name = type == types_.end() ? std::string_view() : type->second;
  const bool is_position = is_one_of(type_name, kPositionTypes);
  if (!is_position && !type_name.empty() && type_name != "FDAT") {
    return;
  }
  const std::optional<Aggregate> aggregate = aggregate_at(value, place);
  const std::optional<std::string> element = element_key(left, now_);
  if (!element || !rest_after(value, aggregate->size).empty()) {
    change(left, now_);
    return;
  }
  Symbol symbol{.name = printable(stripped(line.substr(0, left.size))), .place = place};
  if (type_name == "FDAT" || has_member(*aggregate, "TOOL_NO")) {
    symbol.frame_data = frame_data_of(*aggregate);
  } else {
    symbol.position = position_in(*aggregate, place, symbol.name, is_position);
  }
  if (!symbol.frame_data && !symbol.position) {
    return;
  }
  symbol.is_frame = type_name == "FRAME" || left.name == "TOOL_DATA" || left.name == "BASE_DATA";
  const auto [entry, is_new] = index_.emplace(*element, symbols_.size());
  if (is_new) {
    symbols_.push_back(std::move(symbol));
    elements_[array].push_back(entry->second);
  } else {
    symbols_[entry->second].is_changed = true;
  }
}

void Symbols::change(const Reference& left, Routine routine) {
  changed_.insert(element_key(left, routine).value_or(key(left.name, routine)));
}

// A routine that assigns to a parameter changes what it was called with, which may be a parameter too.
void Symbols::change_arguments() {
  for (bool is_new = true; is_new;) {
    is_new = false;
    for (const Call& call : calls_) {
      const std::optional<Routine> called = routine(call.name);
      const auto parameters = called ? parameters_.find(*called) : parameters_.end();
      const std::size_t count =
          parameters == parameters_.end() ? 0 : std::min(parameters->second.size(), call.arguments.size());
      for (std::size_t i = 0; i < count; ++i) {
        const Parameter& parameter = parameters->second[i];
        const Reference argument = reference_at(call.arguments[i]);
        if (parameter.is_reference && assigned_.contains(key(parameter.name, *called)) && !argument.name.empty() &&
            argument.size == call.arguments[i].size()) {
          is_new = assigned_.insert(key(argument.name, call.routine)).second || is_new;
          change(argument, call.routine);
        }
      }
    }
  }
}

void Symbols::mark_changed() {
  for (const std::string& each : changed_) {
    if (const auto symbol = index_.find(each); symbol != index_.end()) {
      symbols_[symbol->second].is_changed = true;
    }
    if (const auto array = elements_.find(each); array != elements_.end()) {
      for (const std::size_t element : array->second) {
        symbols_[element].is_changed = true;
      }
    }
  }
}

std::string Symbols::key(const std::string& name, Routine routine) const {
  if (!have_own_.contains(routine)) {
    return name;
  }
  std::string own = std::to_string(routine) + "#" + name;
  return types_.contains(own) ? own : name;
}

// None where the index is known at run time only.
std::optional<std::string> Symbols::element_key(const Reference& reference, Routine routine) const {
  std::string result = key(reference.name, routine);
  if (!reference.index) {
    return result;
  }
  result += '[';
  for (const std::string_view part : list_parts(*reference.index)) {
    const std::optional<int> number = whole(part, routine);
    if (!number) {
      return std::nullopt;
    }
    result += std::to_string(*number) + ",";
  }
  return result;
}

std::optional<std::size_t> Symbols::find(const Reference& reference, Routine routine) const {
  const std::optional<std::string> element =
      reference.name.empty() || !reference.member.empty() ? std::nullopt : element_key(reference, routine);
  const auto found = element ? index_.find(*element) : index_.end();
  return found == index_.end() ? std::nullopt : std::optional(found->second);
}

std::vector<std::size_t> Symbols::elements(const Reference& reference, Routine routine) const {
  const auto found = elements_.find(key(reference.name, routine));
  return found == elements_.end() ? std::vector<std::size_t>() : found->second;
}

bool Symbols::is_declared(const Reference& reference, Routine routine) const {
  return types_.contains(key(reference.name, routine));
}

std::optional<int> Symbols::whole(std::string_view expression, Routine routine) const {
  if (const std::optional<int> number = whole_number_in(expression)) {
    return number;
  }
  Reference reference = reference_at(expression);
  if (reference.name.empty() || reference.size != expression.size()) {
    return std::nullopt;
  }
  if (const auto constant = constants_.find(key(reference.name, routine));
      constant != constants_.end() && !reference.index && reference.member.empty()) {
    return constant->second;
  }
  const std::string_view member = reference.member;
  reference.member = {};
  const std::optional<std::size_t> found = member.empty() ? std::nullopt : find(reference, routine);
  if (!found || !symbols_[*found].frame_data || symbols_[*found].is_changed) {
    return std::nullopt;
  }
  const FrameData& data = *symbols_[*found].frame_data;
  return is_word(member, "TOOL_NO") ? data.tool : is_word(member, "BASE_NO") ? data.base : std::nullopt;
}

std::optional<Routine> Symbols::routine(const std::string& name) const {
  const auto found = routines_.find(name);
  return found == routines_.end() ? std::nullopt : std::optional(found->second);
}

}  // namespace kdl_calibration::krl
