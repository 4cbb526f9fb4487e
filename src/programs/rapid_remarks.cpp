#include "programs/rapid_remarks.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>

#include "programs/add_remark.hpp"

namespace kdl_calibration::rapid {
namespace {

constexpr std::array kLeftBecause = {
    "a robtarget or jointtarget is made of other data or computed: left as it is",
    "9E9 stands in place of a coordinate or joint value, a place that is not taught: left as it is",
    "the quaternion of a robtarget is far from norm 1: left as it is",
    "a robtarget or jointtarget is set at run time: left as it is",
    "a jointtarget moves external axes only: left as it is",
    "no motion uses a robtarget, its tool is not known: left as it is",
    "a robtarget is used with two tools or work objects: left as it is",
    "a robtarget is used with a tool or work object that is known at run time only: left as it is",
    "a robtarget is relative to a tool that stands in the cell, or to an object that the robot holds: left as it is",
    "a robtarget is relative to a work object that a mechanical unit moves (ufprog FALSE): left as it is"};

constexpr std::string_view kUnknownPlace = "holds a place that is known at run time only: not compensated here";
constexpr std::string_view kShift = "moves positions at run time: compensated where they are without that";
constexpr std::string_view kConveyor =
    "lets positions travel with a conveyor: compensated where they are while it stands";
constexpr std::string_view kCorrection = "moves the arm off the programmed path at run time: not compensated there";
constexpr std::string_view kSoft = "makes the arm soft: it yields from where it is commanded";

struct RunTimeWord {
  std::string_view word;  // in lower case
  std::string_view name;
  std::string_view meaning;
};

constexpr std::array kInstructions = std::to_array<RunTimeWord>({
    {"pdispon", "PDispOn", kShift},
    {"pdispset", "PDispSet", kShift},
    {"eoffson", "EOffsOn", kShift},
    {"eoffsset", "EOffsSet", kShift},
    {"waitwobj", "WaitWObj", kConveyor},
    {"dropwobj", "DropWObj", kConveyor},
    {"syncwithsensor", "SyncWithSensor", kConveyor},
    {"synctosensor", "SyncToSensor", kConveyor},
    {"waitsensor", "WaitSensor", kConveyor},
    {"corrcon", "CorrCon", kCorrection},
    {"egmactpose", "EGMActPose", kCorrection},
    {"egmactjoint", "EGMActJoint", kCorrection},
    {"egmactmove", "EGMActMove", kCorrection},
    {"egmrunpose", "EGMRunPose", kCorrection},
    {"egmrunjoint", "EGMRunJoint", kCorrection},
    {"egmmovel", "EGMMoveL", kCorrection},
    {"egmmovec", "EGMMoveC", kCorrection},
    {"fcact", "FCAct", kCorrection},
    {"fcpressl", "FCPressL", kCorrection},
    {"fcpressc", "FCPressC", kCorrection},
    {"fcpress1lstart", "FCPress1LStart", kCorrection},
    {"contactl", "ContactL", kCorrection},
    {"softact", "SoftAct", kSoft},
    {"cssact", "CSSAct", kSoft},
});

// Options of a motion that lead it off its path.
constexpr std::array kOptions = std::to_array<RunTimeWord>({
    {"corr", "\\Corr", kCorrection},
    {"track", "\\Track", kCorrection},
});

// Functions of a place whose result is that place, moved.
constexpr std::array kOffsets = std::to_array<RunTimeWord>({
    {"offs", "Offs", kShift},
    {"reltool", "RelTool", kShift},
});

template <typename Words>
const RunTimeWord* row_of(const Words& words, std::string_view word) {
  const auto row = std::find_if(words.begin(), words.end(), [&](const RunTimeWord& each) { return each.word == word; });
  return row == words.end() ? nullptr : &*row;
}

bool add_row(Remarks& remarks, const RunTimeWord* row, std::size_t file, std::size_t line) {
  if (row != nullptr) {
    remarks.add(fmt::format("{} {}", row->name, row->meaning), file, line);
  }
  return row != nullptr;
}

}  // namespace

void Remarks::add(Left because, std::size_t file, std::size_t line) {
  add(std::string(kLeftBecause[static_cast<std::size_t>(because)]), file, line);
}

bool Remarks::add_instruction(std::string_view name, std::size_t file, std::size_t line) {
  return add_row(*this, row_of(kInstructions, name), file, line);
}

bool Remarks::add_option(std::string_view name, std::size_t file, std::size_t line) {
  return add_row(*this, row_of(kOptions, name), file, line);
}

bool Remarks::add_offset(std::string_view name, std::size_t file, std::size_t line) {
  return add_row(*this, row_of(kOffsets, name), file, line);
}

void Remarks::add_unknown(std::string_view subject, std::size_t file, std::size_t line) {
  add(fmt::format("{} {}", subject, kUnknownPlace), file, line);
}

std::vector<ProgramRemark> Remarks::all() const {
  std::vector<ProgramRemark> remarks;
  for (const auto& [key, found] : lines_) {
    add_remark(remarks, key.second, found, key.first);
  }
  return remarks;
}

std::set<std::string, std::less<>> run_time_instructions() {
  std::set<std::string, std::less<>> names;
  for (const RunTimeWord& each : kInstructions) {
    names.emplace(each.word);
  }
  return names;
}

}  // namespace kdl_calibration::rapid
