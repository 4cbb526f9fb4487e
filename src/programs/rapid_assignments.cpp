#include "programs/rapid_assignments.hpp"

#include <iterator>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "programs/rapid_calls.hpp"

namespace kdl_calibration::rapid {
namespace {

class Assignments {
public:
  Assignments(const std::vector<ProgramText>& texts, Modules& modules, Remarks& remarks)
      : texts_(texts), modules_(modules), remarks_(remarks), is_assigned_(modules.places.size()) {}

  std::vector<bool> read();

private:
  void read_calls();
  bool change_arguments(const std::vector<Call>& calls);
  void remark_calls_elsewhere(const std::vector<Call>& calls);
  void assign(const Instruction& at, const std::string& name);

  const std::vector<ProgramText>& texts_;
  Modules& modules_;
  Remarks& remarks_;
  std::vector<bool> is_assigned_;                      // each place
  std::set<std::pair<std::size_t, std::string>> set_;  // scopes and names that are assigned
};

std::vector<bool> Assignments::read() {
  for (const Instruction& each : modules_.assignments) {
    assign(each, each.name);
  }
  for (const Instruction& each : modules_.instructions) {  // SearchL writes where the signal came
    const std::optional<MotionKind> kind = motion_kind(each.name);
    std::size_t position = 0;
    for (const Argument& argument : each.arguments) {
      const bool is_found_point = kind && kind->stops_on_signal && argument.option.empty() && position++ == 1;
      if (is_found_point) {
        assign(each, argument.value.name);
      }
    }
  }
  read_calls();
  return std::move(is_assigned_);
}

// What routines of the program change of their arguments, and other routines may change.
void Assignments::read_calls() {
  std::vector<Call> calls;
  for (std::size_t file = 0; file < texts_.size(); ++file) {
    std::vector<Call> found = calls_in(texts_[file], file, modules_);
    std::move(found.begin(), found.end(), std::back_inserter(calls));
  }
  while (change_arguments(calls)) {  // a routine may hand its parameter on
  }
  remark_calls_elsewhere(calls);
}

bool Assignments::change_arguments(const std::vector<Call>& calls) {
  bool is_new = false;
  for (const Call& call : calls) {
    for (const std::string& name :
         changed_arguments(call, modules_, [&](std::size_t scope, const std::string&parameter) {
           return set_.contains({scope, parameter});
         })) {
      if (!set_.contains({call.at.scope, name})) {
        assign(call.at, name);
        is_new = true;
      }
    }
  }
  return is_new;
}

void Assignments::remark_calls_elsewhere(const std::vector<Call>& calls) {
  for (const Call& call : calls) {
    if (!call.is_statement || modules_.has_routine(call.routine)) {
      continue;
    }
    for (const CallArgument& argument : call.arguments) {
      const Datum* datum = argument.is_whole ? modules_.find(call.at.scope, argument.name) : nullptr;
      const bool is_place = datum != nullptr && (datum->type == Type::robtarget || datum->type == Type::jointtarget);
      if (is_place && !datum->is_constant && !datum->is_parameter && !datum->is_assigned && !datum->items.empty()) {
        remarks_.add(
            "a robtarget or jointtarget that is no CONST is handed to a routine that is not here: if that changes it, "
            "motions to it are not compensated",
            call.at.file, call.at.line);
      }
    }
  }
}

void Assignments::assign(const Instruction& at, const std::string& name) {
  set_.insert({at.scope, name});
  Datum* datum = modules_.find(at.scope, name);
  if (datum == nullptr) {
    return;
  }
  datum->is_assigned = true;
  if (datum->type == Type::tooldata || datum->type == Type::wobjdata) {
    remarks_.add(
        "a tool or work object is set at run time: poses are compensated with its value in the program or in "
        "--frames",
        at.file, at.line);
    for (const std::size_t frame : datum->items) {
      modules_.frames[frame].is_assigned = true;
    }
  } else if (datum->type == Type::robtarget || datum->type == Type::jointtarget) {
    for (const std::size_t place : datum->items) {
      is_assigned_[place] = true;
    }
  }
}

}  // namespace

std::vector<bool> mark_assigned(const std::vector<ProgramText>& texts, Modules& modules, Remarks& remarks) {
  return Assignments(texts, modules, remarks).read();
}

}  // namespace kdl_calibration::rapid
