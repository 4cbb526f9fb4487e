#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <utility>

#include "base/text.hpp"
#include "programs/rapid_module_reader.hpp"
#include "programs/rapid_values.hpp"

namespace kdl_calibration::rapid {
namespace {

constexpr std::array kTypes = std::to_array<std::pair<std::string_view, Type>>({{"robtarget", Type::robtarget},
                                                                                {"jointtarget", Type::jointtarget},
                                                                                {"tooldata", Type::tooldata},
                                                                                {"wobjdata", Type::wobjdata},
                                                                                {"confdata", Type::confdata},
                                                                                {"extjoint", Type::extjoint}});

std::optional<Type> type_of(std::string_view word) {
  const auto found = std::find_if(kTypes.begin(), kTypes.end(), [&](const auto& each) { return each.first == word; });
  return found == kTypes.end() ? std::nullopt : std::optional(found->second);
}

}  // namespace

// LOCAL PERS tooldata tool1:=[...]; or a routine behind LOCAL.
void ModuleReader::declaration() {
  bool is_local = scope_ != module_;
  while (words_.is_word("local") || words_.is_word("task")) {
    is_local = words_.is_word("local") || is_local;
    words_.take();
  }
  if (words_.is_word("proc") || words_.is_word("func") || words_.is_word("trap") || words_.is_word("record")) {
    statement();
    return;
  }
  if (words_.is_word("alias")) {
    words_.skip_statement();
    return;
  }
  if (!words_.is_word("const") && !words_.is_word("pers") && !words_.is_word("var")) {
    words_.fail(words_.found() + ", expected CONST, PERS, VAR or a routine");
  }
  const bool is_constant = words_.is_word("const");
  words_.take();
  const std::optional<Type> type = type_of(lower_case(words_.expect_word("a type").text));
  if (!type) {
    words_.skip_statement();
    return;
  }
  const Token name = words_.expect_word("the name of the data");
  Datum datum{.type = *type, .name = std::string(name.text), .file = file_, .line = name.line};
  datum.is_constant = is_constant;
  std::size_t dimensions = 0;
  if (words_.is("{")) {
    words_.take();
    for (dimensions = 1; !words_.is("}"); words_.take()) {
      if (words_.is_end() || words_.is(";")) {
        words_.fail(name.line, escaped(datum.name) + ": the number of elements does not end, expected '}'");
      }
      dimensions += words_.is(",") ? 1 : 0;
    }
    words_.take();
    datum.is_array = true;
  }
  if (words_.take_if(":=")) {
    declare_value(datum, dimensions);
  }
  words_.expect(";");
  add(std::move(datum), is_local);
}

void ModuleReader::declare_value(Datum& datum, std::size_t dimensions) {
  if (dimensions > 0 && words_.is("[")) {
    elements(datum, dimensions, "");
  } else if (dimensions > 0) {
    words_.value();
  } else {
    item(datum, "");
  }
}

void ModuleReader::elements(Datum& datum, std::size_t dimensions, const std::string& index) {
  constexpr std::size_t kMostDimensions = 3;
  if (dimensions > kMostDimensions) {
    words_.fail(
        fmt::format("{} has {} dimensions, expected at most {}", escaped(datum.name), dimensions, kMostDimensions));
  }
  words_.expect("[");
  std::size_t number = 0;
  do {
    const std::string label = index + (index.empty() ? "" : ",") + std::to_string(++number);
    if (dimensions == 1) {
      item(datum, label);
    } else {
      elements(datum, dimensions - 1, label);
    }
  } while (words_.take_if(","));
  words_.expect("]");
}

// The value of the datum, or of its element.
void ModuleReader::item(Datum& datum, const std::string& index) {
  const Value value = words_.value();
  const std::string name = escaped(datum.name) + (index.empty() ? "" : "{" + index + "}");
  if (datum.is_array) {
    datum.elements[index] = datum.items.size();
  }
  switch (datum.type) {
    case Type::robtarget:
    case Type::jointtarget: {
      Place place = place_of(value, datum.type, name, words_);
      place.point.line = index.empty() ? datum.line : value.line;
      datum.items.push_back(add_place(std::move(place)));
      break;
    }
    case Type::tooldata:
    case Type::wobjdata: {
      Frame frame = frame_of(value, datum.type, name, words_);
      frame.key = lower_case(name);
      datum.items.push_back(modules_.frames.size());
      modules_.frames.push_back(std::move(frame));
      break;
    }
    case Type::confdata:
      datum.configuration = index.empty() ? configuration_of(value, name, words_) : std::nullopt;
      break;
    case Type::extjoint:
      datum.external = index.empty() ? external_of(value, name, words_) : std::nullopt;
      break;
  }
}

std::size_t ModuleReader::add_place(Place place) {
  place.point.file = file_;
  place.scope = scope_;
  modules_.places.push_back(std::move(place));
  return modules_.places.size() - 1;
}

// Data of a module are known in all modules, but for LOCAL ones.
void ModuleReader::add(Datum datum, bool is_local) {
  const std::string name = lower_case(datum.name);
  const bool is_zero_frame = name == "tool0" || name == "wobj0";
  auto& own = modules_.scopes_[scope_].data;
  if (own.contains(name) && !is_zero_frame) {
    words_.fail(datum.line, escaped(datum.name) + " is there twice, expected each name once");
  }
  for (const std::size_t frame : datum.items) {
    const bool is_frame = datum.type == Type::tooldata || datum.type == Type::wobjdata;
    if (is_frame && !is_zero_frame && !modules_.keys_.insert(modules_.frames[frame].key).second) {
      modules_.frames[frame].key += fmt::format(" (line {})", datum.line);  // LOCAL data of the same name
    }
  }
  own[name] = modules_.data_.size();
  if (!is_local && !is_zero_frame) {
    modules_.scopes_[0].data.try_emplace(name, modules_.data_.size());
  }
  modules_.data_.push_back(std::move(datum));
}

void ModuleReader::record() {
  const std::size_t line = words_.peek().line;
  while (!words_.is_word("endrecord")) {
    if (words_.is_end()) {
      words_.fail(line, "RECORD does not end, expected ENDRECORD");
    }
    words_.take();
  }
  words_.take();
}

// PROC name(parameters), FUNC type name(parameters), TRAP name
void ModuleReader::routine() {
  if (scope_ != module_) {
    words_.fail(words_.found() + " within a routine, expected its end (ENDPROC, ENDFUNC or ENDTRAP)");
  }
  const bool is_function = lower_case(words_.take().text) == "func";
  if (is_function) {
    words_.expect_word("the type of the function");
  }
  const std::string name = lower_case(words_.expect_word("the name of the routine").text);
  Routine routine{.scope = add_scope(module_), .parameters = {}};
  begin_scope(routine.scope);
  if (words_.is("(")) {
    routine.parameters = parameters();
  }
  modules_.routines_.emplace(name, std::move(routine));
}

// (robtarget place, \switch on | \num distance, PERS tooldata tool, VAR robtarget path{*})
std::vector<Parameter> ModuleReader::parameters() {
  constexpr std::array kReferences = std::to_array<std::string_view>({"inout", "var", "pers", "ref"});
  const std::size_t line = words_.peek().line;
  words_.expect("(");
  std::vector<Parameter> result;
  Parameter next;
  std::string type;
  Token name;
  const auto keep = [&] {
    if (const std::optional<Type> known = type_of(type)) {
      modules_.scopes_[scope_].data[lower_case(name.text)] = modules_.data_.size();
      modules_.data_.push_back(
          {.type = *known, .name = std::string(name.text), .file = file_, .line = name.line, .is_parameter = true});
    }
    if (!type.empty()) {
      next.name = lower_case(name.text);
      result.push_back(next);
    }
    next = {};
    type.clear();
    name = {};
  };
  while (!words_.is(")")) {
    if (words_.is_end() || words_.is(";")) {
      words_.fail(line, "the parameters of a routine do not end, expected ')'");
    }
    if (words_.is(",") || words_.is("|") || words_.is("\\")) {
      keep();
      next.is_optional = words_.is("\\");
    } else if (words_.is("{")) {
      words_.skip_brackets();
      continue;
    } else if (words_.peek().kind == TokenKind::word) {
      type = lower_case(name.text);
      name = words_.peek();
      next.is_reference = next.is_reference || contains(kReferences, lower_case(name.text));
    }
    words_.take();
  }
  keep();
  words_.expect(")");
  return result;
}

}  // namespace kdl_calibration::rapid
