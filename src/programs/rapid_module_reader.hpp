#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "programs/rapid_modules.hpp"
#include "programs/rapid_text.hpp"

namespace kdl_calibration::rapid {

// Reads one file.
class ModuleReader {
public:
  ModuleReader(Modules& modules, const ProgramText& text, std::size_t file)
      : modules_(modules), words_(text.text, text.source), file_(file) {}

  void read();
  void read_declarations();

private:
  void module();
  std::size_t add_scope(std::size_t parent);
  void begin_scope(std::size_t scope);

  void statement();
  void declaration();
  void declare_value(Datum& datum, std::size_t dimensions);
  void elements(Datum& datum, std::size_t dimensions, const std::string& index);
  void item(Datum& datum, const std::string& index);
  void add(Datum datum, bool is_local);
  void routine();
  std::vector<Parameter> parameters();
  void record();
  void assignment_or_instruction(const Token& name);
  void instruction(const Token& name);
  void argument(Instruction& instruction, const std::optional<MotionKind>& kind);
  std::size_t add_place(Place place);
  void skip_to_word(std::string_view word);
  void skip_case();
  void placeholder();

  Modules& modules_;
  Words words_;
  std::size_t file_;
  std::size_t module_ = 0;
  std::size_t scope_ = 0;
};

}  // namespace kdl_calibration::rapid
