#include "programs/rapid_modules.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <iterator>

#include "base/text.hpp"
#include "programs/rapid_module_reader.hpp"
#include "programs/rapid_values.hpp"

namespace kdl_calibration::rapid {
namespace {

// Words that begin no statement with arguments: the reader goes on behind them.
constexpr std::array kAlone =
    std::to_array<std::string_view>({"else", "endif", "endfor", "endwhile", "endtest", "then", "do", "endrecord"});
constexpr std::array kHandlers = std::to_array<std::string_view>({"error", "undo", "backward"});
constexpr std::array kOthers = std::to_array<std::string_view>({"return", "raise", "goto", "exit", "connect", "alias"});

}  // namespace

Modules::Modules(std::set<std::string, std::less<>> noted) : scopes_(1), noted_(std::move(noted)) {
  for (const auto& [name, type] : {std::pair("tool0", Type::tooldata), std::pair("wobj0", Type::wobjdata)}) {
    scopes_[0].data[name] = data_.size();
    data_.push_back({.type = type, .name = name, .items = {frames.size()}});
    frames.push_back({.key = name, .pose = Eigen::Isometry3d::Identity(), .is_tool = type == Type::tooldata});
    keys_.insert(name);
  }
}

std::optional<std::size_t> Datum::item(const std::string& index) const {
  if (!is_array) {
    return index.empty() && !items.empty() ? std::optional(items.front()) : std::nullopt;
  }
  const auto found = elements.find(index);
  return found == elements.end() ? std::nullopt : std::optional(items[found->second]);
}

Datum* Modules::find(std::size_t scope, const std::string& name) {
  for (;; scope = scopes_[scope].parent) {
    const auto found = scopes_[scope].data.find(name);
    if (found != scopes_[scope].data.end()) {
      return &data_[found->second];
    }
    if (scope == 0) {
      return nullptr;
    }
  }
}

std::vector<const Routine*> Modules::routines_of(const std::string& name) const {
  std::vector<const Routine*> result;
  const auto [begin, end] = routines_.equal_range(name);
  std::for_each(begin, end, [&](const auto& each) { result.push_back(&each.second); });
  return result;
}

std::size_t Modules::scope_at(std::size_t file, std::size_t line) const {
  const auto next = scope_from_.upper_bound({file, line});
  return next == scope_from_.begin() || std::prev(next)->first.first != file ? 0 : std::prev(next)->second;
}

void ModuleReader::read() {
  if (!words_.is_word("module")) {
    words_.fail(words_.found() + ", expected MODULE: a RAPID program");
  }
  while (!words_.is_end()) {
    if (!words_.is_word("module")) {
      words_.fail(words_.found() + " behind ENDMODULE, expected the end or another MODULE");
    }
    module();
  }
}

void ModuleReader::read_declarations() {
  while (!words_.is_end()) {
    if (words_.is_word("module")) {
      module();
    } else {
      statement();
    }
  }
}

void ModuleReader::module() {
  words_.take();
  words_.expect_word("the name of the module");
  if (words_.is("(")) {
    words_.skip_brackets();
  }
  begin_scope(module_ = add_scope(0));
  while (!words_.is_word("endmodule")) {
    if (words_.is_end()) {
      words_.fail("the text ends here without ENDMODULE, expected the whole program");
    }
    if (words_.is_word("module")) {
      words_.fail("MODULE is here before ENDMODULE, expected one module after the other");
    }
    statement();
  }
  words_.take();
  scope_ = module_ = 0;
}

// Until another one begins.
void ModuleReader::begin_scope(std::size_t scope) {
  scope_ = scope;
  modules_.scope_from_[{file_, words_.peek().line}] = scope;
}

std::size_t ModuleReader::add_scope(std::size_t parent) {
  modules_.scopes_.push_back({.parent = parent, .data = {}});
  return modules_.scopes_.size() - 1;
}

void ModuleReader::statement() {
  const std::string word = words_.peek().kind == TokenKind::word ? lower_case(words_.peek().text) : "";
  if (word == "local" || word == "task" || word == "const" || word == "pers" || word == "var") {
    declaration();
  } else if (word == "proc" || word == "func" || word == "trap") {
    routine();
  } else if (word == "endproc" || word == "endfunc" || word == "endtrap") {
    words_.take();
    begin_scope(module_);
  } else if (word == "record") {
    record();
  } else if (word == "if" || word == "elseif" || word == "while") {
    words_.take();
    words_.skip_condition();
  } else if (word == "for") {
    skip_to_word("do");
  } else if (word == "case" || word == "default" || word == "test") {
    skip_case();
  } else if (contains(kOthers, word) || words_.is("%")) {  // %"name"% argument;
    words_.skip_statement();
  } else if (contains(kHandlers, word)) {
    words_.take();
    if (words_.is("(")) {
      words_.skip_brackets();
    }
  } else if (words_.is("<")) {  // <SMT>, a statement that is to be written
    placeholder();
  } else if (word.empty() || contains(kAlone, word)) {
    words_.take();
  } else {
    assignment_or_instruction(words_.take());
  }
}

void ModuleReader::skip_to_word(std::string_view word) {
  const std::size_t line = words_.peek().line;
  while (!words_.is_word(word)) {
    if (words_.is_end() || words_.is(";")) {
      words_.fail(line, "a loop has no " + std::string(word) + ", expected it before the first statement");
    }
    words_.take();
  }
  words_.take();
}

// TEST value, CASE 1, 2: or DEFAULT:
void ModuleReader::skip_case() {
  const Token first = words_.take();
  if (lower_case(first.text) == "test") {
    while (!words_.is_word("case") && !words_.is_word("default") && !words_.is_word("endtest")) {
      if (words_.is_end() || words_.is(";")) {
        words_.fail(first.line, "TEST has no CASE, expected one behind its value");
      }
      words_.take();
    }
    return;
  }
  while (!words_.take_if(":")) {
    if (words_.is_end() || words_.is(";")) {
      words_.fail(first.line, shown(first.text) + " has no colon, expected one behind its values");
    }
    words_.take();
  }
}

void ModuleReader::placeholder() {
  const std::size_t line = words_.peek().line;
  while (!words_.take_if(">")) {
    if (words_.is_end() || words_.is(";")) {
      words_.fail(line, "a placeholder <...> does not end, expected '>'");
    }
    words_.take();
  }
}

// ---- Statements ----------------------------------------------------------------------------------------------------

void ModuleReader::assignment_or_instruction(const Token& name) {
  if (words_.take_if(":")) {
    return;  // a label
  }
  bool has_component = false;
  while (words_.is("{") || words_.is(".")) {
    if (words_.is("{")) {
      words_.skip_brackets();
    } else {
      words_.take();
      words_.expect_word("a component behind '.'");
    }
    has_component = true;
  }
  if (words_.is(":=")) {
    modules_.assignments.push_back({.name = lower_case(name.text),
                                    .spelling = std::string(name.text),
                                    .file = file_,
                                    .line = name.line,
                                    .scope = scope_,
                                    .arguments = {}});
    words_.skip_statement();
  } else if (has_component) {
    words_.fail(words_.found() + ", expected ':='");
  } else {
    instruction(name);
  }
}

void ModuleReader::instruction(const Token& name) {
  Instruction result{.name = lower_case(name.text),
                     .spelling = std::string(name.text),
                     .file = file_,
                     .line = name.line,
                     .scope = scope_,
                     .arguments = {}};
  const std::optional<MotionKind> kind = motion_kind(result.name);
  if (!kind && result.name != "confl" && result.name != "confj") {
    words_.skip_statement();
    if (modules_.noted_.contains(result.name)) {
      modules_.instructions.push_back(std::move(result));
    }
    return;
  }
  while (!words_.take_if(";")) {
    if (!words_.take_if(",")) {
      argument(result, kind);
    }
  }
  modules_.instructions.push_back(std::move(result));
}

// \WObj:=w, \Inpos, \Time?time, or a value
void ModuleReader::argument(Instruction& instruction, const std::optional<MotionKind>& kind) {
  Argument argument;
  if (words_.take_if("\\")) {
    argument.option = lower_case(words_.expect_word("a name behind '\\'").text);
    if (words_.take_if("?")) {
      words_.expect_word("a name behind '?'");
    } else if (words_.take_if(":=")) {
      argument.value = words_.value();
    }
  } else {
    const auto before =
        static_cast<std::size_t>(std::count_if(instruction.arguments.begin(), instruction.arguments.end(),
                                               [](const Argument& each) { return each.option.empty(); }));
    argument.value = words_.value();
    // Speed and zone may be written in the instruction as well.
    const bool is_target = kind && before >= kind->before && before < kind->before + kind->targets;
    if (is_target && argument.value.kind == ValueKind::aggregate) {
      const Type type = kind->has_joints ? Type::jointtarget : Type::robtarget;
      argument.place = add_place(place_of(argument.value, type, "target of " + instruction.spelling, words_));
      argument.value.members.clear();
    }
  }
  instruction.arguments.push_back(std::move(argument));
}

void Modules::read(const ProgramText& text, std::size_t file) { ModuleReader(*this, text, file).read(); }

void Modules::read_declarations(const ProgramText& text) { ModuleReader(*this, text, 0).read_declarations(); }

}  // namespace kdl_calibration::rapid
