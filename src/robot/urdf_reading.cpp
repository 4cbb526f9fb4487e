#include "robot/urdf_reading.hpp"

#include <fmt/core.h>
#include <cctype>
#include <set>
#include <string>

#include "base/text.hpp"

namespace kdl_calibration {
namespace {

[[noreturn]] void refuse(const std::string& source, std::string_view before, const std::string& what) {
  const auto line = 1 + std::count(before.begin(), before.end(), '\n');
  throw InputError(fmt::format("{}:{}: {}, expected XML in UTF-8", source, line, what));
}

bool is_ascii_text(std::string_view text) {
  return std::all_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x80U; });
}

// The encoding stated in <?xml … encoding="…"?>, in capitals; empty if none.
std::string stated_encoding(std::string_view text) {
  const std::size_t start = text.find("<?xml");
  const std::string_view declaration =
      start == std::string_view::npos ? std::string_view() : text.substr(start, text.find("?>", start) - start);
  const std::size_t word = declaration.find("encoding");
  const std::size_t open = word == std::string_view::npos ? word : declaration.find_first_of("\"'", word);
  if (open == std::string_view::npos) {
    return {};
  }
  std::string name(declaration.substr(open + 1, declaration.find(declaration[open], open + 1) - open - 1));
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return name;
}

bool is_macro(const tinyxml2::XMLElement& element) { return std::string_view(element.Name()).starts_with("xacro:"); }

// The first unexpanded macro in an element with its line, "7: <xacro:include>"; empty if there is none.
std::string macro_in(const tinyxml2::XMLElement& element) {
  if (is_macro(element)) {
    return fmt::format("{}: <{}>", element.GetLineNum(), element.Name());
  }
  for (const auto* attribute = element.FirstAttribute(); attribute != nullptr; attribute = attribute->Next()) {
    const std::string_view value = attribute->Value();
    if (value.find("${") != std::string_view::npos || value.find("$(") != std::string_view::npos) {
      return fmt::format("{}: {}", attribute->GetLineNum(), shown(value));
    }
  }
  std::string macro;
  for (auto* child = element.FirstChildElement(); child != nullptr && macro.empty();
       child = child->NextSiblingElement()) {
    macro = macro_in(*child);
  }
  return macro;
}

// Removes children that contain macros, except macros themselves and the elements `kept`.
void remove_with_macros(tinyxml2::XMLElement& parent, const std::set<std::string>& kept) {
  for (auto* child = parent.FirstChildElement(); child != nullptr;) {
    auto* const next = child->NextSiblingElement();
    if (!is_macro(*child) && !kept.contains(child->Name()) && !macro_in(*child).empty()) {
      parent.DeleteChild(child);
    }
    child = next;
  }
}

}  // namespace

void require_utf8(std::string_view text, const std::string& source) {
  if (text.starts_with("\xff\xfe") || text.starts_with("\xfe\xff")) {
    refuse(source, {}, "UTF-16");
  }
  if (const std::size_t zero = text.find('\0'); zero != std::string_view::npos) {
    refuse(source, text.substr(0, zero), "zero byte");
  }
  if (is_ascii_text(text)) {
    return;
  }
  const std::string encoding = stated_encoding(text);
  if (!encoding.empty() && encoding != "UTF-8" && encoding != "UTF8") {
    refuse(source, text.substr(0, text.find("<?xml")), "letters in the encoding " + shown(encoding));
  }
  if (is_utf8(text)) {
    return;
  }
  for (std::size_t start = 0; start < text.size();) {
    const std::size_t end = std::min(text.find('\n', start), text.size());
    if (!is_utf8(text.substr(start, end - start))) {
      refuse(source, text.substr(0, start), "letters in another encoding, such as Latin-1");
    }
    start = end + 1;
  }
}

void refuse_xacro(tinyxml2::XMLElement& robot, const std::string& source) {
  remove_with_macros(robot, {"link", "joint"});
  for (auto* link = robot.FirstChildElement("link"); link != nullptr; link = link->NextSiblingElement("link")) {
    remove_with_macros(*link, {});
  }
  if (const std::string macro = macro_in(robot); !macro.empty()) {
    const std::string file = source.ends_with(".xacro") ? source.substr(0, source.size() - 6) : source;
    throw InputError(source + ":" + macro + " is xacro, expected a URDF; expand it first: xacro " + source + " > " +
                     (file.ends_with(".urdf") && file != source ? file : "robot.urdf"));
  }
}

}  // namespace kdl_calibration
