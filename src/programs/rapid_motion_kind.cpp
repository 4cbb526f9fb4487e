#include "programs/rapid_motion_kind.hpp"

#include <algorithm>
#include <array>
#include <utility>

namespace kdl_calibration::rapid {

std::optional<MotionKind> motion_kind(std::string_view name) {
  struct Shape {
    std::string_view letters;
    MotionKind kind;
  };
  constexpr std::array kFamilies =
      std::to_array<std::string_view>({"move", "trigg", "search", "arcmove", "arc", "spotm", "spot", "disp", "paint",
                                       "cap", "nut", "fcpress1", "fcpress", "cssdeactmove"});
  constexpr std::array kShapes = std::to_array<Shape>({{"absj", {.has_joints = true}},
                                                       {"extj", {.has_joints = true, .moves_arm = false}},
                                                       {"l", {.is_straight = true}},
                                                       {"c", {.targets = 2, .is_straight = true}},
                                                       {"j", {}}});
  constexpr std::array kEnds = std::to_array<std::pair<std::string_view, std::size_t>>({{"", 0},
                                                                                        {"do", 2},
                                                                                        {"ao", 2},
                                                                                        {"go", 1},
                                                                                        {"sync", 1},
                                                                                        {"ios", 0},
                                                                                        {"start", 0},
                                                                                        {"end", 0},
                                                                                        {"1", 0},
                                                                                        {"2", 0},
                                                                                        {"1start", 0},
                                                                                        {"1end", 0},
                                                                                        {"2start", 0},
                                                                                        {"2end", 0}});
  if (name == "fcpressend") {
    return MotionKind{.is_straight = true};
  }
  for (const std::string_view family : kFamilies) {
    if (!name.starts_with(family)) {
      continue;
    }
    for (const Shape& shape : kShapes) {
      const std::string_view rest = name.substr(family.size());
      const auto end = std::find_if(kEnds.begin(), kEnds.end(), [&](const auto& each) {
        return rest.starts_with(shape.letters) && rest.substr(shape.letters.size()) == each.first;
      });
      if (end != kEnds.end()) {
        MotionKind kind = shape.kind;
        kind.behind = end->second;
        kind.stops_on_signal = family == "search";
        kind.before = kind.stops_on_signal ? 2 : 0;  // the signal, and where it came
        return kind;
      }
    }
  }
  return std::nullopt;
}

}  // namespace kdl_calibration::rapid
