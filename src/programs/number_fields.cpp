#include "programs/number_fields.hpp"

#include <algorithm>
#include <charconv>
#include <cstdlib>

#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/text.hpp"

namespace kdl_calibration {

namespace {

// The text from the first to the last of some fields, with their values.
struct Part {
  std::size_t begin = 0;
  std::size_t end = 0;
  std::string text;
};

Part rewritten(std::string_view text, const std::vector<NumberField>& fields, const ProgramLanguage& language) {
  if (fields.empty()) {
    return {};
  }
  Part part{.begin = fields.front().begin, .end = fields.back().end, .text = {}};
  std::size_t copied = part.begin;
  for (const NumberField& field : fields) {
    const std::string_view old = text.substr(field.begin, field.end - field.begin);
    double before = 0.0;
    std::string_view digits = trimmed(old);
    digits.remove_prefix(digits.starts_with('+') ? 1 : 0);
    const bool is_decimal = std::from_chars(digits.data(), digits.data() + digits.size(), before).ec == std::errc();
    if (is_decimal && fixed(field.value, field.decimals) == fixed(before, field.decimals)) {
      continue;
    }
    part.text += text.substr(copied, field.begin - copied);
    part.text += language.write(old, field.value, field.decimals);
    copied = field.end;
  }
  part.text += text.substr(copied, part.end - copied);
  return part;
}

}  // namespace

std::string with_numbers(std::string_view text, const std::vector<NumberField>& fields,
                         const ProgramLanguage& language) {
  return with_numbers(
      text, fields.size(), [&](std::size_t i, std::vector<NumberField>& list) { list.push_back(fields[i]); }, language);
}

// Few parts are in memory at a time.
std::string with_numbers(std::string_view text, std::size_t count,
                         const std::function<void(std::size_t i, std::vector<NumberField>& fields)>& add,
                         const ProgramLanguage& language) {
  constexpr std::size_t kBlock = 512;
  constexpr std::size_t kAtOnce = 64 * kBlock;
  std::string result;
  result.reserve(text.size() + text.size() / 8);
  std::size_t copied = 0;
  for (std::size_t first = 0; first < count; first += kAtOnce) {
    const std::size_t size = std::min(kAtOnce, count - first);
    std::vector<Part> parts((size + kBlock - 1) / kBlock);
    parallel_blocks(size, kBlock, 0, [&](std::size_t begin, std::size_t end) {
      std::vector<NumberField> fields;
      for (std::size_t i = begin; i < end; ++i) {
        add(first + i, fields);
      }
      parts[begin / kBlock] = rewritten(text, fields, language);
    });
    for (const Part& part : parts) {
      if (part.end > part.begin) {
        result += text.substr(copied, part.begin - copied);
        result += part.text;
        copied = part.end;
      }
    }
  }
  result += text.substr(copied);
  return result;
}

std::string written_plainly(std::string_view old, double value, int decimals) {
  const std::size_t blanks = std::min(old.find_first_not_of(" \t"), old.size());
  return std::string(old.substr(0, blanks)) + fixed(value, decimals);
}

int decimals_of(std::string_view number, int least) {
  const std::size_t exponent = std::min(number.find_first_of("eE"), number.size());
  const std::size_t point = std::min(number.find('.'), exponent);
  int decimals = static_cast<int>(exponent - std::min(point + 1, exponent));
  if (exponent < number.size()) {
    decimals -= std::atoi(std::string(number.substr(exponent + 1)).c_str());
  }
  constexpr int kMost = 12;
  return std::clamp(decimals, least, std::max(kMost, least));
}

}  // namespace kdl_calibration
