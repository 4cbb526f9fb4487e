#include "python/keywords.hpp"

#include <array>
#include <cctype>
#include <string_view>
#include <utility>

#include "python/file_names.hpp"

namespace kdl_calibration::python {
namespace {

using Renaming = std::pair<std::string_view, std::string_view>;

constexpr std::array kKeywords = {Renaming{"--external-axis", "external_axes"},
                                  Renaming{"--frames", "frames"},
                                  Renaming{"--near", "near"},
                                  Renaming{"--force", "overwrite=True"},
                                  Renaming{"--joint-convention", "convention"},
                                  Renaming{"--orientation", "orientation"},
                                  Renaming{"--prior-result", "priors.earlier"}};

constexpr std::array kMembers = {Renaming{"method", "estimator.method"},
                                 Renaming{"iterations", "estimator.iterations"},
                                 Renaming{"loss", "estimator.loss"},
                                 Renaming{"model", "parameters.model"},
                                 Renaming{"fix", "parameters.fix"},
                                 Renaming{"free", "parameters.free"},
                                 Renaming{"keep_axes", "parameters.keep_axes"},
                                 Renaming{"prior_result", "priors.earlier"},
                                 Renaming{"weights", "noise.weights"},
                                 Renaming{"nested", "validation.nested"}};

bool is_of_name(const std::string& message, std::size_t at) {  // of a file
  return at < message.size() && (std::isalnum(static_cast<unsigned char>(message[at])) != 0 ||
                                 std::string_view("-_./\\").find(message[at]) != std::string_view::npos);
}

}  // namespace

std::string in_keywords(std::string message) {
  for (const auto& [option, keyword] : kKeywords) {
    for (std::size_t at = message.find(option); at != std::string::npos; at = message.find(option, at + 1)) {
      const std::size_t end = at + option.size();
      if ((at == 0 || !is_of_name(message, at - 1)) && !is_of_name(message, end)) {
        message.replace(at, option.size(), keyword);
      }
    }
  }
  return message;
}

std::string in_keywords(const InputError& error) {
  if (const auto* const of_option = dynamic_cast<const OptionError*>(&error)) {
    for (const auto& [member, keyword] : kMembers) {
      if (of_option->option() == member) {
        return std::string(keyword) + ": " + in_keywords(of_option->fault());
      }
    }
  }
  return in_keywords(std::string(error.what()));
}

pybind11::list message_texts(const std::vector<std::string>& messages) {
  pybind11::list texts;
  for (const std::string& message : messages) {
    texts.append(message_text(in_keywords(message)));
  }
  return texts;
}

}  // namespace kdl_calibration::python
