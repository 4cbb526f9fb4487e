#include "robot/urdf_correction.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "base/number_text.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "robot/urdf_reading.hpp"

namespace kdl_calibration {
namespace {

constexpr std::string_view kBlanks = " \t\r\n";
const std::string kSource = "URDF";

using Triple = std::array<double, 3>;

/// Position of an attribute's value in the text, without quotes.
struct AttributePlace {
  std::string_view name;
  std::size_t begin = 0;
  std::size_t end = 0;
};

/// Position of an element's start tag in the text.
struct StartTag {
  std::string_view name;
  std::size_t name_end = 0;
  std::size_t end = 0;  ///< one past '>'
  bool self_closing = false;
  std::vector<AttributePlace> attributes;
};

/// Replacement of `length` bytes at `begin`.
struct Edit {
  std::size_t begin = 0;
  std::size_t length = 0;
  std::string text;
};

/// Finds the start tags of XML accepted by tinyxml2, in the order of the text.
class TagScanner {
public:
  explicit TagScanner(std::string_view text) : text_(text) {}

  std::vector<StartTag> scan() {
    std::vector<StartTag> tags;
    for (at_ = text_.find('<'); at_ != std::string_view::npos; at_ = text_.find('<', at_)) {
      if (skipped("<!--", "-->") || skipped("<![CDATA[", "]]>") || skipped("<?", "?>") || skipped("<!", ">")) {
        continue;
      }
      ++at_;
      skip_blanks();
      if (!skipped("/", ">")) {
        tags.push_back(start_tag());
      }
    }
    return tags;
  }

private:
  [[noreturn]] void fail() const {
    const auto line = 1 + std::count(text_.begin(), text_.begin() + static_cast<std::ptrdiff_t>(at_), '\n');
    throw InputError(fmt::format("{}:{}: malformed XML, expected an element", kSource, line));
  }

  char peek() const {
    if (at_ >= text_.size()) {
      fail();
    }
    return text_[at_];
  }

  void skip_blanks() { at_ = std::min(text_.find_first_not_of(kBlanks, at_), text_.size()); }

  bool skipped(std::string_view opening, std::string_view closing) {
    if (!text_.substr(at_).starts_with(opening)) {
      return false;
    }
    const std::size_t close = text_.find(closing, at_ + opening.size());
    if (close == std::string_view::npos) {
      fail();
    }
    at_ = close + closing.size();
    return true;
  }

  std::string_view name_until(std::string_view stops) {
    const std::size_t begin = at_;
    at_ = std::min(text_.find_first_of(stops, begin), text_.size());
    return text_.substr(begin, at_ - begin);
  }

  AttributePlace attribute() {
    AttributePlace place;
    place.name = name_until(" \t\r\n=/>");
    skip_blanks();
    if (peek() != '=') {
      fail();
    }
    ++at_;
    skip_blanks();
    const char quote = peek();
    place.begin = at_ + 1;
    place.end = text_.find(quote, place.begin);
    if ((quote != '"' && quote != '\'') || place.end == std::string_view::npos) {
      fail();
    }
    at_ = place.end + 1;
    return place;
  }

  StartTag start_tag() {
    StartTag tag;
    tag.name = name_until(" \t\r\n/>");
    tag.name_end = at_;
    for (skip_blanks(); peek() != '>' && peek() != '/'; skip_blanks()) {
      tag.attributes.push_back(attribute());
    }
    tag.self_closing = peek() == '/';
    at_ += tag.self_closing ? 1 : 0;
    if (peek() != '>') {
      fail();
    }
    tag.end = ++at_;
    return tag;
  }

  std::string_view text_;
  std::size_t at_ = 0;
};

/// Pairs each element that tinyxml2 found with its start tag in the text: both come in document order.
class TagPairing : public tinyxml2::XMLVisitor {
public:
  explicit TagPairing(const std::vector<StartTag>& tags) : tags_(tags) {}
  using tinyxml2::XMLVisitor::VisitEnter;
  bool VisitEnter(const tinyxml2::XMLElement& element, const tinyxml2::XMLAttribute* /*first*/) override {
    if (tag_of_.size() == tags_.size() || tags_[tag_of_.size()].name != element.Name()) {
      throw InputError(fmt::format("{}:{}: element {} has no start tag of its own, expected plain XML", kSource,
                                   element.GetLineNum(), in_quotes(element.Name())));
    }
    tag_of_.emplace(&element, &tags_[tag_of_.size()]);
    return true;
  }
  const StartTag& tag(const tinyxml2::XMLElement& element) const { return *tag_of_.at(&element); }

private:
  const std::vector<StartTag>& tags_;
  std::map<const tinyxml2::XMLElement*, const StartTag*> tag_of_;
};

/// The attribute's three numbers as urdfdom reads them; zeros if it is missing.
Triple read_triple(const tinyxml2::XMLElement* origin, const char* attribute, const std::string& joint) {
  const char* value = origin == nullptr ? nullptr : origin->Attribute(attribute);
  urdf::Vector3 triple;
  if (value != nullptr) {
    try {
      triple.init(value);
    } catch (const std::exception&) {
      throw InputError(fmt::format("{}:{}: joint {}: origin has {} {}, expected three numbers", kSource,
                                   origin->GetLineNum(), in_quotes(joint), attribute, in_quotes(value)));
    }
  }
  return {triple.x, triple.y, triple.z};
}

std::string written(const Triple& numbers) {
  return shortest(numbers[0]) + " " + shortest(numbers[1]) + " " + shortest(numbers[2]);
}

/// Replaces the changed numbers in an attribute's value.
void edit_value(std::string_view text, const AttributePlace& place, const Triple& old, const Triple& now,
                std::vector<Edit>& edits) {
  const std::string_view value = text.substr(place.begin, place.end - place.begin);
  std::vector<Edit> numbers;
  for (std::size_t at = value.find_first_not_of(kBlanks); at != std::string_view::npos;) {
    const std::size_t end = std::min(value.find_first_of(kBlanks, at), value.size());
    numbers.push_back({place.begin + at, end - at, ""});
    at = value.find_first_not_of(kBlanks, end);
  }
  if (old == now) {
    return;
  }
  // The position of a number is unknown if blanks or digits are written as entities.
  if (numbers.size() != 3 || value.find('&') != std::string_view::npos) {
    edits.push_back({place.begin, value.size(), written(now)});
    return;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    if (now[i] != old[i]) {
      numbers[i].text = shortest(now[i]);
      edits.push_back(numbers[i]);
    }
  }
}

/// ` name="1 2 3"`, or an empty text if all three are zero.
std::string new_attribute(const char* name, const Triple& numbers, char quote) {
  return numbers == Triple{} ? std::string() : std::string(" ") + name + "=" + quote + written(numbers) + quote;
}

const AttributePlace* find_attribute(const StartTag& tag, std::string_view name) {
  const auto place =
      std::find_if(tag.attributes.begin(), tag.attributes.end(), [&](const auto& a) { return a.name == name; });
  return place == tag.attributes.end() ? nullptr : &*place;
}

char quote_of(std::string_view text, const StartTag& tag) {
  return tag.attributes.empty() ? '"' : text[tag.attributes.front().end];
}

struct Origin {
  Triple xyz{};
  Triple rpy{};
};

void edit_origin(std::string_view text, const StartTag& tag, const Origin& old, const Origin& now,
                 std::vector<Edit>& edits) {
  const char quote = quote_of(text, tag);
  const AttributePlace* xyz = find_attribute(tag, "xyz");
  const AttributePlace* rpy = find_attribute(tag, "rpy");
  std::string added;
  if (xyz != nullptr) {
    edit_value(text, *xyz, old.xyz, now.xyz, edits);
  } else {
    added += new_attribute("xyz", now.xyz, quote);
  }
  if (rpy != nullptr) {
    edit_value(text, *rpy, old.rpy, now.rpy, edits);
  } else {
    added += new_attribute("rpy", now.rpy, quote);
  }
  edits.push_back({xyz != nullptr ? xyz->end + 1 : tag.name_end, 0, added});
}

/// Adds an <origin> as the joint's first child, on its own line if the present first child has one.
void add_origin(std::string_view text, const StartTag& joint, const Origin& now, std::vector<Edit>& edits) {
  const char quote = quote_of(text, joint);
  const std::string attributes = new_attribute("xyz", now.xyz, quote) + new_attribute("rpy", now.rpy, quote);
  if (attributes.empty()) {
    return;
  }
  const std::size_t child = std::min(text.find_first_not_of(kBlanks, joint.end), text.size());
  const std::string_view blanks = text.substr(joint.end, child - joint.end);
  std::size_t line_end = blanks.find_last_of("\r\n");
  if (line_end != std::string_view::npos && line_end > 0 && blanks.substr(line_end - 1, 2) == "\r\n") {
    --line_end;
  }
  const std::string indent(line_end == std::string_view::npos ? std::string_view() : blanks.substr(line_end));
  edits.push_back({joint.end, 0, indent + "<origin" + attributes + "/>"});
}

Origin corrected(const Origin& old, const OriginCorrection& correction) {
  Origin now = old;
  urdf::Rotation rotation;
  rotation.setFromRPY(old.rpy[0], old.rpy[1], old.rpy[2]);
  const KDL::Rotation old_rotation = to_kdl(rotation);
  const KDL::Vector shift = old_rotation * correction.correction.p;
  for (std::size_t i = 0; i < 3; ++i) {
    now.xyz[i] += shift(static_cast<int>(i));
  }
  const KDL::Rotation identity = KDL::Rotation::Identity();
  if (!std::equal(std::begin(identity.data), std::end(identity.data), std::begin(correction.correction.M.data))) {
    now.rpy = rpy_of(old_rotation * correction.correction.M, old.rpy);
  }
  return now;
}

void require_finite(const Origin& pose, const std::string& joint) {
  for (const Triple& triple : {pose.xyz, pose.rpy}) {
    if (!std::all_of(triple.begin(), triple.end(), [](double x) { return std::isfinite(x); })) {
      throw InputError(kSource + ": joint " + in_quotes(joint) +
                       ": corrected origin is not finite, expected finite numbers");
    }
  }
}

const tinyxml2::XMLElement& find_joint(const tinyxml2::XMLElement& robot, const std::string& name) {
  const tinyxml2::XMLElement* found = nullptr;
  const char* tag = "joint";
  for (auto* joint = robot.FirstChildElement(tag); joint != nullptr; joint = joint->NextSiblingElement(tag)) {
    if (!joint->Attribute("name", name.c_str())) {
      continue;
    }
    if (found != nullptr) {
      throw InputError(fmt::format("{}:{}: joint {} exists twice, expected one joint of each name", kSource,
                                   joint->GetLineNum(), in_quotes(name)));
    }
    found = joint;
  }
  if (found == nullptr) {
    throw InputError(kSource + ": no joint " + in_quotes(name) + " to correct, expected a joint of the robot");
  }
  return *found;
}

Origin corrected(const Origin& /*old*/, const NewOrigin& origin) { return {origin.xyz, origin.rpy}; }

template <class Correction>
void edit_joint(std::string_view text, const tinyxml2::XMLElement& joint, const TagPairing& pairing,
                const Correction& correction, std::vector<Edit>& edits) {
  const tinyxml2::XMLElement* origin = joint.FirstChildElement("origin");
  const Origin old{read_triple(origin, "xyz", correction.joint), read_triple(origin, "rpy", correction.joint)};
  const Origin now = corrected(old, correction);
  require_finite(now, correction.joint);
  if (origin != nullptr) {
    edit_origin(text, pairing.tag(*origin), old, now, edits);
  } else if (!pairing.tag(joint).self_closing) {
    add_origin(text, pairing.tag(joint), now, edits);
  } else {
    throw InputError(fmt::format("{}:{}: joint {} is empty, expected a parent and a child", kSource, joint.GetLineNum(),
                                 in_quotes(correction.joint)));
  }
}

std::string applied(std::string_view text, std::vector<Edit> edits) {
  std::stable_sort(edits.begin(), edits.end(), [](const Edit& a, const Edit& b) { return a.begin < b.begin; });
  std::string result;
  std::size_t at = 0;
  for (const Edit& edit : edits) {
    result.append(text.substr(at, edit.begin - at)).append(edit.text);
    at = edit.begin + edit.length;
  }
  return result.append(text.substr(at));
}

template <class Correction>
std::string with_edited_origins(std::string_view urdf, const std::vector<Correction>& corrections) {
  tinyxml2::XMLDocument document;
  parse_xml(document, urdf, kSource);
  const tinyxml2::XMLElement* robot = document.FirstChildElement("robot");
  if (robot == nullptr) {
    throw InputError(kSource + ": no <robot> element, expected a URDF");
  }
  const std::vector<StartTag> tags = TagScanner(urdf).scan();
  TagPairing pairing(tags);
  document.Accept(&pairing);

  std::vector<Edit> edits;
  std::set<std::string> done;
  for (const Correction& correction : corrections) {
    if (!done.insert(correction.joint).second) {
      throw InputError(kSource + ": joint " + in_quotes(correction.joint) +
                       " has two corrections, expected one per joint");
    }
    edit_joint(urdf, find_joint(*robot, correction.joint), pairing, correction, edits);
  }
  return applied(urdf, std::move(edits));
}

}  // namespace

std::array<double, 3> rpy_of(const KDL::Rotation& r, const std::array<double, 3>& old, double locked) {
  constexpr double kManyTurns = 100.0;
  Triple nearest{};
  double smallest = std::numeric_limits<double>::infinity();
  const bool is_locked = std::hypot(r(0, 0), r(1, 0)) < locked;
  for (const double sign : {1.0, -1.0}) {
    const double yaw = is_locked ? old[2] : std::atan2(sign * r(1, 0), sign * r(0, 0));
    const double c = std::cos(yaw);
    const double s = std::sin(yaw);
    const double pitch = std::atan2(-r(2, 0), c * r(0, 0) + s * r(1, 0));
    const double roll = std::atan2(s * r(0, 2) - c * r(1, 2), c * r(1, 1) - s * r(0, 1));
    Triple rpy{roll, pitch, yaw};
    double distance = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
      const bool near = std::abs(old[i]) < kManyTurns;
      const double turns = near ? std::round((old[i] - rpy[i]) / (2.0 * std::numbers::pi)) : 0.0;
      rpy[i] += turns * 2.0 * std::numbers::pi;
      distance += std::abs(rpy[i] - old[i]);
    }
    if (distance < smallest) {
      smallest = distance;
      nearest = rpy;
    }
  }
  return nearest;
}

std::string corrected_urdf(std::string_view urdf, const std::vector<OriginCorrection>& corrections) {
  return with_edited_origins(urdf, corrections);
}

std::string urdf_with_origins(std::string_view urdf, const std::vector<NewOrigin>& origins) {
  return with_edited_origins(urdf, origins);
}

}  // namespace kdl_calibration
