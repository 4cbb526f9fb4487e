#include "cli/help.hpp"

#include <algorithm>
#include <cstddef>
#include <sstream>

#include "base/wrapped_text.hpp"

namespace kdl_calibration::cli {
namespace {

// Restricted edit distance (Damerau 1964).
std::size_t letters_apart(const std::string& a, const std::string& b) {
  std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1, 0));
  for (std::size_t i = 0; i <= a.size(); ++i) {
    for (std::size_t j = 0; j <= b.size(); ++j) {
      if (i == 0 || j == 0) {
        d[i][j] = i + j;
        continue;
      }
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, d[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0U : 1U)});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
      }
    }
  }
  return d[a.size()][b.size()];
}

}  // namespace

std::string HelpFormatter::make_option(const CLI::Option* option, bool is_positional) const {
  const std::string name = "  " + make_option_name(option, is_positional) + make_option_opts(option);
  const std::size_t column = get_column_width();
  const std::string text = wrapped(make_option_desc(option), column, column);
  return name.size() + 1 < column ? name + text.substr(name.size()) : name + "\n" + text;
}

std::string HelpFormatter::make_description(const CLI::App* app) const {
  std::istringstream paragraphs(app->get_description());
  std::string text;
  for (std::string paragraph; std::getline(paragraphs, paragraph);) {
    text += wrapped(paragraph, 0, 0);
  }
  return text;
}

std::string HelpFormatter::make_subcommand(const CLI::App* subcommand) const {
  const std::string description = subcommand->get_description();
  std::ostringstream text;
  CLI::detail::format_help(text, subcommand->get_name(), description.substr(0, description.find('\n')),
                           get_column_width());
  return text.str();
}

void add_group(CLI::App& app, const std::string& heading, const std::vector<std::string>& options) {
  for (const std::string& option : options) {
    app.get_option(option)->group(heading);
  }
}

std::string nearest(const std::string& mistyped, const std::vector<std::string>& words) {
  std::string best;
  std::size_t least = std::max<std::size_t>(mistyped.size() / 3, 1) + 1;
  for (const std::string& word : words) {
    const std::size_t apart = letters_apart(mistyped, word);
    if (apart < least) {
      least = apart;
      best = word;
    }
  }
  return best;
}

}  // namespace kdl_calibration::cli
