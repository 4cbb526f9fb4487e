#pragma once

// Modules of RAPID: what they declare, and the statements that matter to places.

#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "programs/program.hpp"
#include "programs/rapid_motion_kind.hpp"
#include "programs/rapid_text.hpp"

namespace kdl_calibration::rapid {

enum class Type : std::uint8_t { robtarget, jointtarget, tooldata, wobjdata, confdata, extjoint };

/// cf1, cf4, cf6 and cfx.
using Configuration = std::array<int, 4>;

/// A robtarget or jointtarget that the text states with its numbers.
struct Place {
  ProgramPoint point;  ///< without frames and branch
  std::size_t scope = 0;
  std::optional<Configuration> configuration;
  std::string confdata;  ///< the name that stands in place of the four numbers
  std::string extjoint;  ///< or of the external axes
  bool is_computed = false;
  bool is_taught = true;        ///< false: 9E9 in place of a joint value or coordinate
  bool has_orientation = true;  ///< false: the quaternion is far from norm 1
};

/// A tooldata or wobjdata.
struct Frame {
  std::string key;                        ///< in ProgramFrames
  std::optional<Eigen::Isometry3d> pose;  ///< none where the text does not state it
  bool is_tool = false;
  bool is_assigned = false;   ///< at run time
  bool stands_still = false;  ///< a tool that stands in the cell, or an object that the robot holds
  bool is_moved = false;      ///< a mechanical unit moves the user frame
};

struct Datum {
  Type type = Type::robtarget;
  std::string name;  ///< as it is declared
  std::size_t file = 0;
  std::size_t line = 0;
  bool is_parameter = false;
  bool is_constant = false;
  bool is_array = false;
  bool is_assigned = false;                               ///< at run time
  std::vector<std::size_t> items;                         ///< places or frames; empty without a value
  std::unordered_map<std::string, std::size_t> elements;  ///< by index, such as "2,1", the number in `items`
  std::optional<Configuration> configuration;             ///< of confdata
  std::optional<std::vector<ExternalValue>> external;     ///< of extjoint

  /// The place or frame of an element, or of data that are no array (""); none if there is none.
  std::optional<std::size_t> item(const std::string& index) const;
};

struct Argument {
  std::string option;  ///< "wobj" of \WObj:=w; empty for others
  Value value;
  std::optional<std::size_t> place;  ///< of a target that is written in the instruction
};

struct Instruction {
  std::string name;      ///< in lower case
  std::string spelling;  ///< as the text writes it
  std::size_t file = 0;
  std::size_t line = 0;
  std::size_t scope = 0;
  std::vector<Argument> arguments;
};

struct Parameter {
  std::string name;  ///< in lower case
  bool is_optional = false;
  bool is_reference = false;  ///< INOUT, VAR, PERS or REF: the routine may change the argument
};

struct Routine {
  std::size_t scope = 0;
  std::vector<Parameter> parameters;
};

/// What modules declare. A scope is a routine, a module, or the whole program (0).
class Modules {
public:
  /// Keeps motions, ConfL and ConfJ, and without their arguments instructions of these names (in lower case).
  explicit Modules(std::set<std::string, std::less<>> noted = {});

  /// Reads the modules of a file. Throws InputError.
  void read(const ProgramText& text, std::size_t file);
  /// Reads only declarations; the text may have no module.
  void read_declarations(const ProgramText& text);

  /// The datum that a name, in lower case, means in this scope; null if there is none.
  Datum* find(std::size_t scope, const std::string& name);
  bool has_routine(const std::string& name) const { return routines_.contains(name); }
  /// All of a name in lower case; modules may have LOCAL ones of the same name.
  std::vector<const Routine*> routines_of(const std::string& name) const;
  /// The scope of a line of a text.
  std::size_t scope_at(std::size_t file, std::size_t line) const;

  std::vector<Place> places;
  std::vector<Frame> frames;
  std::vector<Instruction> instructions;
  std::vector<Instruction> assignments;  ///< by the name on the left; without arguments

private:
  friend class ModuleReader;
  struct Scope {
    std::size_t parent = 0;
    std::unordered_map<std::string, std::size_t> data;
  };

  std::vector<Scope> scopes_;
  std::vector<Datum> data_;
  std::unordered_multimap<std::string, Routine> routines_;
  std::map<std::pair<std::size_t, std::size_t>, std::size_t> scope_from_;  // scopes by the file and line of their begin
  std::set<std::string> keys_;                                             // of frames
  std::set<std::string, std::less<>> noted_;
};

}  // namespace kdl_calibration::rapid
