#include "cli/config_file.hpp"

#include <algorithm>
#include <sstream>
#include <string>
#include <string_view>

#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration::cli {
namespace {

constexpr std::size_t kLargestFile = std::size_t{1} << 20U;

bool has_option(const CLI::App& subcommand, const std::string& key) {
  return key != "help" && subcommand.get_option_no_throw("--" + key) != nullptr;
}

}  // namespace

std::vector<CLI::ConfigItem> ConfigFile::from_config(std::istream& input) const {
  const auto chosen = app_.get_subcommands();
  const std::string where = app_.get_config_ptr()->as<std::string>();
  std::string text;
  for (char c = 0; text.size() <= kLargestFile && input.get(c);) {
    text += c;
  }
  if (text.size() > kLargestFile) {
    throw InputError(where + ": larger than the limit of 1 MiB");
  }
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  text.erase(0, text.starts_with(kByteOrderMark) ? kByteOrderMark.size() : 0);
  if (text.find_first_not_of(" \t\r\n") == std::string::npos) {
    throw InputError(where + ": is empty, expected options such as seed = 1");
  }
  std::istringstream stream(text);
  const auto all = app_.get_subcommands([](const CLI::App*) { return true; });
  std::vector<CLI::ConfigItem> result;
  for (CLI::ConfigItem& item : ConfigBase::from_config(stream)) {
    const bool section = item.name == "++" || item.name == "--";
    const std::string key = item.name;
    const auto fits = [&](const CLI::App* subcommand) {
      const bool named = item.parents.empty() || item.parents == std::vector<std::string>{subcommand->get_name()};
      return named && (section || has_option(*subcommand, key));
    };
    if (std::none_of(all.begin(), all.end(), fits)) {
      throw InputError(where + ": '" + (section ? "[" + item.parents.front() + "]" : item.fullname()) + "' is no " +
                       (section ? "subcommand" : "option") + ", expected those that --help lists");
    }
    if (!section && !chosen.empty() && fits(chosen.front())) {
      item.parents = {chosen.front()->get_name()};
      result.push_back(item);
    }
  }
  return result;
}

}  // namespace kdl_calibration::cli
