#include "robot/urdf_model.hpp"

#include <console_bridge/console.h>
#include <urdf_parser/urdf_parser.h>

#include <map>
#include <mutex>
#include <set>
#include <utility>

#include "base/text.hpp"
#include "robot/urdf_reading.hpp"

namespace kdl_calibration {
namespace {

constexpr std::size_t kLargestText = std::size_t{64} << 20U;
constexpr std::size_t kMostJoints = 2'000;

/// Keeps urdfdom's messages from the console while it lives, and remembers its errors from listen() on.
class UrdfdomErrors : public console_bridge::OutputHandler {
public:
  UrdfdomErrors()
      : lock_(mutex()), previous_(console_bridge::getOutputHandler()), level_(console_bridge::getLogLevel()) {
    console_bridge::useOutputHandler(this);
    console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_NONE);  // no message is formatted
  }
  ~UrdfdomErrors() override {
    console_bridge::useOutputHandler(previous_);
    console_bridge::setLogLevel(level_);
  }
  UrdfdomErrors(const UrdfdomErrors&) = delete;
  UrdfdomErrors& operator=(const UrdfdomErrors&) = delete;
  UrdfdomErrors(UrdfdomErrors&&) = delete;
  UrdfdomErrors& operator=(UrdfdomErrors&&) = delete;

  void log(const std::string& text, console_bridge::LogLevel level, const char* /*file*/, int /*line*/) override {
    if (level >= console_bridge::CONSOLE_BRIDGE_LOG_ERROR) {
      text_ += (text_.empty() ? "" : "; ") + one_line(text);
    }
  }
  static void listen() { console_bridge::setLogLevel(console_bridge::CONSOLE_BRIDGE_LOG_ERROR); }
  const std::string& text() const { return text_; }

private:
  static std::mutex& mutex() {
    static std::mutex instance;
    return instance;
  }

  std::lock_guard<std::mutex> lock_;
  console_bridge::OutputHandler* previous_;
  console_bridge::LogLevel level_;
  std::string text_;
};

/// Prints elements and attributes only, in a form that urdfdom's own XML parser cannot read differently.
class ElementPrinter : public tinyxml2::XMLPrinter {
public:
  ElementPrinter() : tinyxml2::XMLPrinter(nullptr, true) { PushHeader(false, true); }
  using tinyxml2::XMLPrinter::Visit;
  bool Visit(const tinyxml2::XMLText& /*text*/) override { return true; }
  bool Visit(const tinyxml2::XMLComment& /*comment*/) override { return true; }
  bool Visit(const tinyxml2::XMLDeclaration& /*declaration*/) override { return true; }
  bool Visit(const tinyxml2::XMLUnknown& /*unknown*/) override { return true; }
};

std::string link_of(const tinyxml2::XMLElement& joint, const char* end) {
  const tinyxml2::XMLElement* element = joint.FirstChildElement(end);
  const char* link = element == nullptr ? nullptr : element->Attribute("link");
  return link == nullptr ? std::string() : std::string(link);
}

/// Throws InputError for an attribute that changes the kinematics and that urdfdom ignores, such as quat_xyzw.
void refuse_other_rotations(const tinyxml2::XMLElement& joint, const std::string& name, const std::string& source) {
  for (const char* tag : {"origin", "axis"}) {
    const tinyxml2::XMLElement* element = joint.FirstChildElement(tag);
    for (auto* a = element == nullptr ? nullptr : element->FirstAttribute(); a != nullptr; a = a->Next()) {
      const std::string attribute = a->Name();
      if (attribute.starts_with("quat") || attribute == "expressed_in" || attribute == "relative_to" ||
          attribute == "degrees" || attribute == "rotation_format") {
        throw InputError(source + ": joint " + in_quotes(name) + ": attribute " + in_quotes(attribute) + " of <" + tag +
                         ">, expected xyz and rpy alone");
      }
    }
  }
}

/// Throws InputError if a link has two parents or is its own ancestor. urdfdom accepts both in some cases.
void check_tree(const tinyxml2::XMLElement& robot, const std::string& source) {
  std::map<std::string, std::pair<std::string, std::string>> parents;  // child link -> parent link, joint
  const char* tag = "joint";
  std::size_t count = 0;
  for (auto* joint = robot.FirstChildElement(tag); joint != nullptr; joint = joint->NextSiblingElement(tag)) {
    const char* attribute = joint->Attribute("name");
    const std::string name = attribute == nullptr ? "" : attribute;
    const std::string child = link_of(*joint, "child");
    refuse_other_rotations(*joint, name, source);
    if (++count > kMostJoints) {
      throw InputError(source + ": more joints than the limit of " + std::to_string(kMostJoints));
    }
    if (child.empty()) {  // urdfdom refuses it later, naming the joint
      continue;
    }
    const auto [other, fresh] = parents.try_emplace(child, link_of(*joint, "parent"), name);
    if (!fresh && other->second.second != name) {
      throw InputError(source + ": link " + in_quotes(child) + " is the child of joints " +
                       in_quotes(other->second.second) + " and " + in_quotes(name) +
                       ", expected one joint per child link");
    }
  }
  std::set<std::string> sound;
  for (const auto& entry : parents) {
    std::set<std::string> path;
    std::string link = entry.first;
    while (!sound.contains(link) && parents.contains(link)) {
      if (!path.insert(link).second) {
        throw InputError(source + ": the joints above link " + in_quotes(link) + " form a loop, expected a tree");
      }
      link = parents.at(link).first;
    }
    sound.merge(path);
  }
}

std::string replaced(std::string text, std::string_view from, std::string_view to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size())) {
    text.replace(at, from.size(), to);
  }
  return text;
}

/// urdfdom's errors for `elements`. It uses texts of the file as printf formats, in which `%n` would write to memory,
/// so each % is doubled before.
std::string urdfdom_errors_in(const std::string& elements, UrdfdomErrors& errors) {
  UrdfdomErrors::listen();
  urdf::parseURDF(replaced(elements, "%", "%%"));
  return replaced(errors.text(), "%%", "%");  // texts that were not used as a format
}

}  // namespace

urdf::ModelInterfaceSharedPtr parse_model(std::string_view text, const std::string& source) {
  if (text.size() > kLargestText) {
    throw InputError(source + ": larger than the limit of 64 MiB");
  }
  tinyxml2::XMLDocument document;
  parse_xml(document, text, source);
  tinyxml2::XMLElement* robot = document.FirstChildElement("robot");
  if (robot == nullptr) {
    throw InputError(source + ": no <robot> element, expected a URDF");
  }
  refuse_xacro(*robot, source);
  ElementPrinter printer;
  robot->Accept(&printer);
  check_tree(*robot, source);

  UrdfdomErrors errors;
  std::string reason;
  try {
    if (urdf::ModelInterfaceSharedPtr model = urdf::parseURDF(printer.CStr())) {
      return model;
    }
    reason = urdfdom_errors_in(printer.CStr(), errors);
  } catch (const std::exception& error) {
    reason = one_line(error.what());
  }
  throw InputError(source + ": not a valid URDF: " + reason);
}

}  // namespace kdl_calibration
