#include "programs/krl_calls.hpp"

#include <algorithm>
#include <optional>

#include "programs/krl_text.hpp"

namespace kdl_calibration::krl {

std::vector<Parameter> parameters_of(std::string_view head) {
  std::vector<Parameter> parameters;
  const std::size_t open = std::min(head.find('('), head.size());
  const std::optional<std::size_t> end = open < head.size() ? closing_bracket(head, open) : std::nullopt;
  for (const std::string_view part :
       end ? list_parts(head.substr(open + 1, *end - open - 1)) : std::vector<std::string_view>()) {
    const std::string_view name = word_at(part);
    const std::size_t colon = std::min(part.find(':'), part.size());
    if (!name.empty()) {
      parameters.push_back(
          {.name = in_upper_case(name),
           .is_reference = colon == part.size() || !is_word(word_at(rest_after(part, colon + 1)), "IN")});
    }
  }
  return parameters;
}

std::vector<Call> calls_in(std::string_view line, std::size_t routine) {
  std::vector<Call> calls;
  for (std::size_t at = 0; at < line.size();) {
    const std::string_view word = word_at(line.substr(at));
    const std::string_view rest = rest_after(line, at + word.size());
    const std::optional<std::size_t> end =
        !word.empty() && rest.starts_with('(') ? closing_bracket(rest) : std::nullopt;
    if (end) {
      calls.push_back(
          {.name = in_upper_case(word), .arguments = list_parts(rest.substr(1, *end - 1)), .routine = routine});
    }
    at += std::max<std::size_t>(word.size(), 1);
  }
  return calls;
}

}  // namespace kdl_calibration::krl
