#include "programs/rapid_values.hpp"

#include <fmt/core.h>
#include <array>
#include <cmath>

#include "base/text.hpp"
#include "programs/number_fields.hpp"

namespace kdl_calibration::rapid {
namespace {

using Numbers = std::optional<std::vector<NumberField>>;

constexpr double kNoAxis = 1e9;  // 9E9 says that there is no such axis

// What a message says of a value that is wrong.
struct Expectation {
  const std::string& name;
  const char* form;
  const Words& words;
};

// The members of a value; none where another expression stands for it.
const std::vector<Value>* members(const Value& value, std::size_t count, const Expectation& expected) {
  if (value.kind != ValueKind::aggregate) {
    return nullptr;
  }
  if (value.members.size() != count) {
    expected.words.fail(value.line, fmt::format("{}: {} has {} members, expected {}", expected.name, shown(value.text),
                                                value.members.size(), expected.form));
  }
  return &value.members;
}

Numbers numbers(const Value& value, std::size_t count, int least_decimals, const Expectation& expected) {
  const std::vector<Value>* all = members(value, count, expected);
  if (all == nullptr) {
    return std::nullopt;
  }
  std::vector<NumberField> fields;
  fields.reserve(count);
  for (const Value& each : *all) {
    if (each.kind == ValueKind::aggregate || (!each.text.empty() && each.text.front() == '"')) {
      expected.words.fail(each.line, fmt::format("{}: {} is in {}, expected {}", expected.name, shown(each.text),
                                                 shown(value.text), expected.form));
    }
    if (each.kind != ValueKind::number) {
      return std::nullopt;
    }
    fields.push_back(each.number);
    fields.back().decimals = decimals_of(each.text, least_decimals);
  }
  return fields;
}

double norm_of(const std::vector<NumberField>& quaternion) {
  double squares = 0.0;
  for (const NumberField& each : quaternion) {
    squares += each.value * each.value;
  }
  return std::sqrt(squares);
}

bool is_unit(const std::vector<NumberField>& quaternion) {
  constexpr double kFar = 0.1;
  return std::abs(norm_of(quaternion) - 1.0) < kFar;
}

// [[x,y,z],[q1,q2,q3,q4]]
std::optional<Eigen::Isometry3d> pose(const Value& value, const std::string& name, const Words& words) {
  const Expectation expected{name, "[[x,y,z],[q1,q2,q3,q4]]", words};
  const std::vector<Value>* parts = members(value, 2, expected);
  const Numbers position = parts == nullptr ? std::nullopt : numbers((*parts)[0], 3, 0, expected);
  const Numbers q = parts == nullptr ? std::nullopt : numbers((*parts)[1], 4, 0, expected);
  if (!position || !q || !is_unit(*q)) {
    return std::nullopt;
  }
  constexpr double kMillimetre = 1e-3;
  Eigen::Isometry3d result = Eigen::Isometry3d::Identity();
  result.translation() =
      kMillimetre * Eigen::Vector3d((*position)[0].value, (*position)[1].value, (*position)[2].value);
  result.linear() =
      Eigen::Quaterniond((*q)[0].value, (*q)[1].value, (*q)[2].value, (*q)[3].value).normalized().toRotationMatrix();
  return result;
}

// TRUE or FALSE; none where it is computed.
std::optional<bool> truth(const Value& value) {
  if (value.kind != ValueKind::name || (value.name != "true" && value.name != "false")) {
    return std::nullopt;
  }
  return value.name == "true";
}

constexpr const char* kRobtarget = "[[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax_a,...,eax_f]]";
constexpr const char* kJointtarget = "[[rax_1,...,rax_6],[eax_a,...,eax_f]]";

void read_external(Place& place, const Value& value, const Words& words) {
  if (value.kind == ValueKind::name) {
    place.extjoint = value.name;
    return;
  }
  std::optional<std::vector<ExternalValue>> external = external_of(value, place.point.name, words);
  place.is_computed = place.is_computed || !external;
  place.point.external = std::move(external).value_or(std::vector<ExternalValue>());
}

// Keeps the numbers of the place; false where they are computed.
bool keep(Place& place, const Numbers& fields) {
  if (!fields) {
    place.is_computed = true;
    return false;
  }
  for (const NumberField& each : *fields) {
    place.is_taught = place.is_taught && std::abs(each.value) < kNoAxis;
  }
  place.point.fields.insert(place.point.fields.end(), fields->begin(), fields->end());
  return true;
}

void read_configuration(Place& place, const Value& value, const Words& words) {
  if (value.kind == ValueKind::name) {
    place.confdata = value.name;
    return;
  }
  place.configuration = configuration_of(value, place.point.name, words);
  if (!place.configuration) {
    place.is_computed = true;
    return;
  }
  constexpr std::size_t kTurns = 3;
  for (std::size_t i = 0; i < kTurns; ++i) {
    place.point.turn_fields.push_back(value.members[i].number);
    place.point.turn_fields.back().decimals = 0;
  }
}

void read_robtarget(Place& place, const std::vector<Value>& parts, const Words& words) {
  constexpr int kMillimetreDecimals = 3;
  constexpr int kQuaternionDecimals = 8;
  const Expectation expected{place.point.name, kRobtarget, words};
  place.point.notation = PointNotation::quaternion;
  keep(place, numbers(parts[0], 3, kMillimetreDecimals, expected));
  const Numbers quaternion = numbers(parts[1], 4, kQuaternionDecimals, expected);
  if (keep(place, quaternion)) {
    place.has_orientation = is_unit(*quaternion);
  }
  read_configuration(place, parts[2], words);
  read_external(place, parts[3], words);
}

}  // namespace

Place place_of(const Value& value, Type type, const std::string& name, const Words& words) {
  constexpr int kDegreeDecimals = 4;
  const bool has_joints = type == Type::jointtarget;
  Place place;
  place.point.name = name;
  place.point.line = value.line;
  const std::vector<Value>* parts =
      members(value, has_joints ? 2 : 4, {name, has_joints ? kJointtarget : kRobtarget, words});
  place.is_computed = parts == nullptr;
  if (parts == nullptr) {
    place.point.notation = has_joints ? PointNotation::joints : PointNotation::quaternion;
  } else if (has_joints) {
    keep(place, numbers((*parts)[0], 6, kDegreeDecimals, {name, kJointtarget, words}));
    read_external(place, (*parts)[1], words);
  } else {
    read_robtarget(place, *parts, words);
  }
  return place;
}

Frame frame_of(const Value& value, Type type, const std::string& name, const Words& words) {
  Frame frame{.is_tool = type == Type::tooldata};
  if (type == Type::tooldata) {
    const std::vector<Value>* parts = members(value, 3, {name, "[robhold,tframe,tload]", words});
    if (parts != nullptr) {
      frame.stands_still = truth((*parts)[0]) == false;
      frame.pose = truth((*parts)[0]) ? pose((*parts)[1], name, words) : std::nullopt;
    }
    return frame;
  }
  const std::vector<Value>* parts = members(value, 5, {name, "[robhold,ufprog,ufmec,uframe,oframe]", words});
  if (parts != nullptr) {
    frame.stands_still = truth((*parts)[0]) == true;
    frame.is_moved = truth((*parts)[1]) == false;
    const std::optional<Eigen::Isometry3d> user = pose((*parts)[3], name, words);
    const std::optional<Eigen::Isometry3d> object = pose((*parts)[4], name, words);
    if (truth((*parts)[0]) && truth((*parts)[1]) && user && object) {
      frame.pose = *user * *object;
    }
  }
  return frame;
}

std::optional<Configuration> configuration_of(const Value& value, const std::string& name, const Words& words) {
  constexpr double kMost = 1e4;
  const Numbers fields = numbers(value, 4, 0, {name, "[cf1,cf4,cf6,cfx]", words});
  if (!fields) {
    return std::nullopt;
  }
  Configuration result{};
  for (std::size_t i = 0; i < result.size(); ++i) {
    const double number = (*fields)[i].value;
    if (std::abs(number) > kMost || number != std::floor(number)) {
      words.fail(value.line,
                 fmt::format("{}: the configuration is {}, expected four whole numbers", name, shown(value.text)));
    }
    result[i] = static_cast<int>(number);
  }
  return result;
}

std::optional<std::vector<ExternalValue>> external_of(const Value& value, const std::string& name, const Words& words) {
  const Numbers fields = numbers(value, 6, 0, {name, "[eax_a,eax_b,eax_c,eax_d,eax_e,eax_f]", words});
  if (!fields) {
    return std::nullopt;
  }
  std::vector<ExternalValue> external;
  for (std::size_t i = 0; i < fields->size(); ++i) {
    if (std::abs((*fields)[i].value) < kNoAxis) {
      external.push_back({.axis = static_cast<int>(i) + 1, .value = (*fields)[i].value, .is_length = std::nullopt});
    }
  }
  return external;
}

}  // namespace kdl_calibration::rapid
