#include "programs/rapid_calls.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "base/units.hpp"

namespace kdl_calibration::rapid {
namespace {

constexpr std::array kBehindWord = std::to_array<std::string_view>(
    {"then", "do", "else", "endif", "endfor", "endwhile", "endtest", "error", "undo", "backward"});

class CallReader {
public:
  CallReader(const ProgramText& text, std::size_t file, const Modules& modules)
      : words_(text.text, text.source), file_(file), modules_(modules) {}

  std::vector<Call> read() {
    bool begins_statement = false;
    bool is_head = false;  // of a routine
    while (!words_.is_end()) {
      const Token token = words_.take();
      const std::string word = token.kind == TokenKind::word ? lower_case(token.text) : "";
      if (!word.empty() && (words_.is("(") || is_procedure(word, begins_statement))) {
        call(token, begins_statement && !words_.is("("));
      }
      begins_statement =
          token.text == ";" || token.text == ":" || contains(kBehindWord, word) || (is_head && token.text == ")");
      is_head = word == "proc" || word == "func" || (is_head && token.text != ")");
    }
    return std::move(calls_);
  }

private:
  // A name whose arguments have no brackets.
  bool is_procedure(const std::string& word, bool begins_statement) const {
    constexpr std::array kNoCall = std::to_array<std::string_view>({":=", ":", "{", "."});
    return begins_statement
               ? std::none_of(kNoCall.begin(), kNoCall.end(), [&](std::string_view sign) { return words_.is(sign); })
               : !modules_.routines_of(word).empty();
  }

  void call(const Token& name, bool is_statement) {
    const std::string routine = lower_case(name.text);
    const std::vector<const Routine*> routines = modules_.routines_of(routine);
    const bool takes_reference = std::any_of(routines.begin(), routines.end(), [](const Routine* each) {
      return std::any_of(each->parameters.begin(), each->parameters.end(),
                         [](const Parameter& parameter) { return parameter.is_reference; });
    });
    // Programs consist of motions, which change no argument.
    const bool is_elsewhere = is_statement && routines.empty() && routine != "return" && !motion_kind(routine);
    if (!takes_reference && !is_elsewhere) {
      return;
    }
    Call call{.routine = routine,
              .at = {.name = {},
                     .spelling = std::string(name.text),
                     .file = file_,
                     .line = name.line,
                     .scope = modules_.scope_at(file_, name.line),
                     .arguments = {}},
              .is_statement = is_statement,
              .arguments = {}};
    // The arguments are read from a copy: they may hold calls themselves.
    Words words = words_;
    read_arguments(words, call);
    calls_.push_back(std::move(call));
  }

  static void read_arguments(Words& words, Call& call) {
    const bool has_brackets = words.take_if("(");
    std::size_t number = 0;
    while (!words.is_end() && !words.is(";") && !words.is(")")) {
      CallArgument argument{.name = {}, .option = {}, .number = number, .is_whole = false};
      if (words.take_if("\\")) {
        argument.option = lower_case(words.take().text);
        words.take_if(":=");
      } else {
        ++number;
      }
      value(words, argument);
      call.arguments.push_back(std::move(argument));
      words.take_if(",");
    }
    if (has_brackets) {
      words.take_if(")");
    }
  }

  // Up to the comma, backslash or bracket behind it. A name, its elements and its components are a place in data.
  static void value(Words& words, CallArgument& argument) {
    const bool is_name = words.peek().kind == TokenKind::word;
    const std::string name = is_name ? lower_case(words.peek().text) : "";
    bool is_place = is_name;
    bool is_whole = is_name;
    for (bool is_first = true; !words.is_end() && !words.is(",") && !words.is("\\") && !words.is(";") && !words.is(")");
         is_first = false) {
      if (words.is("{")) {
        words.skip_brackets();
        continue;
      }
      if (words.is("(") || words.is("[")) {
        is_place = false;
        words.skip_brackets();
        continue;
      }
      const Token token = words.take();
      if (token.text == ".") {
        is_whole = false;
        words.take();
      } else if (!is_first) {
        is_place = false;
      }
    }
    argument.name = is_place ? name : "";
    argument.is_whole = is_place && is_whole;
  }

  Words words_;
  std::size_t file_;
  const Modules& modules_;
  std::vector<Call> calls_;
};

}  // namespace

std::vector<Call> calls_in(const ProgramText& text, std::size_t file, const Modules& modules) {
  return CallReader(text, file, modules).read();
}

}  // namespace kdl_calibration::rapid
