#include "programs/number_fields.hpp"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <span>

#include "base/number_text.hpp"
#include "base/parallel.hpp"
#include "base/text.hpp"

namespace kdl_calibration {

namespace {

// The text from the first of these fields to `end`, with their values.
std::string rewritten(std::string_view text, std::span<const NumberField> fields, std::size_t end,
                      const ProgramLanguage& language) {
  std::string result;
  std::size_t copied = fields.front().begin;
  for (const NumberField& field : fields) {
    const std::string_view old = text.substr(field.begin, field.end - field.begin);
    double before = 0.0;
    std::string_view digits = trimmed(old);
    digits.remove_prefix(digits.starts_with('+') ? 1 : 0);
    const bool is_decimal = std::from_chars(digits.data(), digits.data() + digits.size(), before).ec == std::errc();
    if (is_decimal && fixed(field.value, field.decimals) == fixed(before, field.decimals)) {
      continue;
    }
    result += text.substr(copied, field.begin - copied);
    result += language.write(old, field.value, field.decimals);
    copied = field.end;
  }
  result += text.substr(copied, end - copied);
  return result;
}

}  // namespace

std::string with_numbers(std::string_view text, const std::vector<NumberField>& fields,
                         const ProgramLanguage& language) {
  constexpr std::size_t kBlock = 4096;
  std::vector<std::string> parts((fields.size() + kBlock - 1) / kBlock);
  parallel_blocks(fields.size(), kBlock, 0, [&](std::size_t begin, std::size_t end) {
    parts[begin / kBlock] = rewritten(text, std::span(fields).subspan(begin, end - begin),
                                      end < fields.size() ? fields[end].begin : text.size(), language);
  });
  std::string result;
  result.reserve(text.size() + text.size() / 8);
  result += text.substr(0, fields.empty() ? text.size() : fields.front().begin);
  for (const std::string& part : parts) {
    result += part;
  }
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
