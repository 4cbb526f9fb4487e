#pragma once

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

namespace kdl_calibration::testing {

/// The JSON that a page holds.
inline nlohmann::json data_of_page(const std::string& page) {
  const std::string opening = R"(<script type="application/json" id="data">)";
  const std::size_t start = page.find(opening);
  const std::size_t end = page.find("</script>", start);
  if (start == std::string::npos || end == std::string::npos) {
    ADD_FAILURE() << "the page has no block of data";
    return {};
  }
  return nlohmann::json::parse(page.substr(start + opening.size(), end - start - opening.size()));
}

/// How often `part` occurs in `text`.
inline int occurrences(const std::string& text, const std::string& part) {
  int count = 0;
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + part.size())) {
    ++count;
  }
  return count;
}

}  // namespace kdl_calibration::testing
