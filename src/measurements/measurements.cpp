#include "kdl_calibration/measurements.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>
#include <optional>
#include <set>
#include <system_error>
#include <tuple>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "base/json_reading.hpp"
#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "base/text_file.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/mimic.hpp"

namespace kdl_calibration {
namespace {

using Json = nlohmann::json;

constexpr std::uintmax_t kLargestFile = std::uintmax_t{16} << 30U;
constexpr std::size_t kLongestLine = std::size_t{1} << 20U;
constexpr std::size_t kFileBuffer = 4 * kLongestLine;
constexpr std::size_t kMostColumns = 10'000;
constexpr std::int32_t kMostTargets = 100;
constexpr std::size_t kMostConventionJoints = 1'000;
constexpr double kQuaternionTolerance = 1e-3;
constexpr double kRoundedJointValue = 1e-5;  // [rad] or [m] that rounding may cost: half of 0.001 deg, of 0.01 mm
constexpr std::size_t kAbsent = std::numeric_limits<std::size_t>::max();

// ---- Text ----------------------------------------------------------------------------------------------------------

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

bool is_control(char c) { return static_cast<unsigned char>(c) < 0x20U || c == '\x7f'; }

bool is_ascii(char c) { return static_cast<unsigned char>(c) < 0x80U; }

/// Labels end up in JSON results, so what counts is what the JSON writer takes.
bool is_utf8(std::string_view text) {
  if (std::all_of(text.begin(), text.end(), is_ascii)) return true;
  try {
    static_cast<void>(Json(text).dump());
    return true;
  } catch (const Json::type_error&) {
    return false;
  }
}

/// At most some 40 characters of a text for a message, on one line and printable.
std::string printable(std::string_view value) {
  constexpr std::size_t kLongest = 40;
  const bool keep_unicode = is_utf8(value);
  std::size_t length = std::min(value.size(), kLongest);
  if (keep_unicode && length < value.size()) {
    while (length > 0 && (static_cast<unsigned char>(value[length]) & 0xc0U) == 0x80U) --length;
  }
  constexpr std::string_view kHexDigits = "0123456789abcdef";
  std::string text;
  for (const char c : value.substr(0, length)) {
    if (is_control(c) || (!is_ascii(c) && !keep_unicode)) {
      const auto byte = static_cast<unsigned char>(c);
      text += {'\\', 'x', kHexDigits[byte >> 4U], kHexDigits[byte & 0xfU]};
    } else {
      text += c;
    }
  }
  return text + (length < value.size() ? "..." : "");
}

std::string shown(std::string_view value) { return "'" + printable(value) + "'"; }

/// Where a message points to.
struct Place {
  const std::string& source;
  std::size_t line;
};

[[noreturn]] void fail(const Place& place, const std::string& what) {
  throw InputError(place.source + ":" + std::to_string(place.line) + ": " + what);
}

[[noreturn]] void fail(const std::string& source, const std::string& what) { throw InputError(source + ": " + what); }

/// Empty where the label can be written and read back, else the rule that it breaks.
std::string label_fault(std::string_view label) {
  if (label.empty()) return "is empty: expected a name";
  if (std::any_of(label.begin(), label.end(), is_control)) return "has a control character: expected plain text";
  if (!is_utf8(label)) return "is not UTF-8: save the file as UTF-8";
  return {};
}

// ---- Files and lines -----------------------------------------------------------------------------------------------

/// Cuts text in memory, or a file that it reads piece by piece, into lines.
class LineReader {
public:
  LineReader(std::string_view text, std::string source)
      : source_(std::move(source)), rest_(text), size_hint_(text.size()) {}

  explicit LineReader(const std::filesystem::path& path)
      : source_(path.string()), file_(open_file(path)), buffer_(new char[kFileBuffer]), rest_(buffer_.get(), 0) {
    std::error_code error;
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    if (!error) size_hint_ = static_cast<std::size_t>(size);
    if (!error && size > kLargestFile) fail(source_, "larger than the limit of 16 GiB");
  }

  /// The next line without its line end; false at the end of the text.
  bool next(std::string_view& line) {
    if (file_ && rest_.find('\n') == std::string_view::npos) refill();
    if (line_ == 0) check_encoding();
    if (rest_.empty()) return false;
    ++line_;
    const std::size_t end = rest_.find('\n');
    line = rest_.substr(0, end);
    rest_.remove_prefix(end == std::string_view::npos ? rest_.size() : end + 1);
    if (line.size() > kLongestLine) fail(place(), "the line is longer than the limit of 1 MiB");
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    check_characters(line);
    return true;
  }

  Place place() const { return {source_, line_}; }
  const std::string& source() const { return source_; }
  /// Bytes of the whole text; 0 where that is not known before the end.
  std::size_t size_hint() const { return size_hint_; }

private:
  /// Called with no line end in the rest. A rest longer than the longest line needs no more bytes to be refused.
  void refill() {
    if (rest_.size() > kLongestLine) return;
    if (!rest_.empty()) {  // memmove takes no null pointer, not even for nothing
      std::memmove(buffer_.get(), rest_.data(), rest_.size());
    }
    const std::size_t free = kFileBuffer - rest_.size();
    const std::size_t read = read_bytes(file_.get(), buffer_.get() + rest_.size(), free, source_);
    rest_ = {buffer_.get(), rest_.size() + read};
    read_ += read;
    if (read_ > kLargestFile) fail(source_, "larger than the limit of 16 GiB");  // a pipe tells no size
    if (read < free) file_.reset();
  }

  void check_encoding() {
    if (rest_.starts_with("\xff\xfe") || rest_.starts_with("\xfe\xff")) {
      fail(source_, "the text is UTF-16: save it as UTF-8");
    }
    if (rest_.starts_with("\xef\xbb\xbf")) rest_.remove_prefix(3);
  }

  void check_characters(std::string_view line) const {
    if (line.find('\0') != std::string_view::npos) {
      fail(place(), "the line has a NUL byte: expected text in UTF-8 (UTF-16 is not read)");
    }
    if (line.find('\r') != std::string_view::npos) {
      fail(place(), "the line has a carriage return inside: expected lines that end with LF or CRLF");
    }
  }

  std::string source_;
  File file_;
  std::unique_ptr<char[]> buffer_;
  std::string_view rest_;
  std::size_t size_hint_ = 0;
  std::uintmax_t read_ = 0;
  std::size_t line_ = 0;
};

/// The next line that is neither a comment nor empty. Spreadsheets write an empty row as separators alone.
bool next_record(LineReader& lines, std::string_view& line) {
  while (lines.next(line)) {
    const bool comment = line.starts_with('#');
    if (!comment && line.find_first_not_of(" \t,;") != std::string_view::npos) return true;
  }
  return false;
}

/// The fields of one line; views into the line or, for quoted fields, into a text of its own.
class Fields {
public:
  void split(std::string_view line, char separator, const Place& place) {
    fields_.clear();
    if (line.find('"') != std::string_view::npos) {
      split_quoted(line, separator, place);
      return;
    }
    while (true) {
      const std::size_t end = line.find(separator);
      add(trimmed(line.substr(0, end)), place);
      if (end == std::string_view::npos) return;
      line.remove_prefix(end + 1);
    }
  }

  std::size_t size() const { return fields_.size(); }
  std::string_view operator[](std::size_t i) const { return fields_[i]; }

private:
  void add(std::string_view field, const Place& place) {
    if (fields_.size() == kMostColumns) fail(place, "more fields than the limit of 10000 columns");
    fields_.push_back(field);
  }

  void split_quoted(std::string_view line, char separator, const Place& place) {
    unescaped_.clear();
    unescaped_.reserve(line.size());  // the views into it must stay valid
    while (true) {
      line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
      add(line.starts_with('"') ? take_quoted(line, separator, place) : take_plain(line, separator, place), place);
      if (line.empty()) return;
      line.remove_prefix(1);
    }
  }

  static std::string_view take_plain(std::string_view& line, char separator, const Place& place) {
    const std::string_view field = trimmed(line.substr(0, line.find(separator)));
    if (field.find('"') != std::string_view::npos) {
      fail(place, "a quote inside the field " + shown(field) + ": expected the whole field in quotes, its own doubled");
    }
    line.remove_prefix(std::min(line.find(separator), line.size()));
    return field;
  }

  std::string_view take_quoted(std::string_view& line, char separator, const Place& place) {
    const std::string_view whole = line;
    const std::size_t begin = unescaped_.size();
    do {
      line.remove_prefix(1);
      const std::size_t end = line.find('"');
      if (end == std::string_view::npos) fail(place, "no closing quote on the line for the field " + shown(whole));
      unescaped_ += line.substr(0, end);
      line.remove_prefix(end + 1);
      if (line.starts_with('"')) unescaped_ += '"';
    } while (line.starts_with('"'));
    line.remove_prefix(std::min(line.find_first_not_of(" \t"), line.size()));
    if (!line.empty() && line.front() != separator) fail(place, "text behind the closing quote of " + shown(whole));
    return std::string_view(unescaped_).substr(begin);
  }

  std::vector<std::string_view> fields_;
  std::string unescaped_;
};

// ---- Header --------------------------------------------------------------------------------------------------------

enum class Unit : std::uint8_t { none, rad, deg, m, mm };

double to_si(double value, Unit unit) {
  if (unit == Unit::deg) return value * (std::numbers::pi / 180.0);
  if (unit == Unit::mm) return value / 1000.0;
  return value;
}

/// The SI value as a text in the unit, without the last digits that the conversion costs.
std::string in_unit(double value, Unit unit) { return shortest(std::round(value / to_si(1.0, unit) * 1e9) / 1e9); }

/// Where a quantity stands in a row.
struct Column {
  std::size_t index = kAbsent;
  Unit unit = Unit::none;
};

bool present(const Column& column) { return column.index != kAbsent; }

struct Header {
  char separator = ',';
  std::size_t line = 0;
  std::vector<std::string> names;  ///< as the file has them, for messages: units included, no empty ones at the end
  std::size_t fields = 0;          ///< with the empty ones at the end
  Column configuration, split, repeat, target, sigma;
  std::array<Column, 3> position;
  std::array<Column, 4> quaternion;  ///< w, x, y, z
  std::vector<Column> joints;        ///< in the order of the expected names
  std::vector<Column> followers;     ///< in the order of ExpectedJoints::followers; absent ones as well
};

/// The joint names that the header must bear.
struct ExpectedJoints {
  const std::vector<std::string>& names;       ///< the controller's with a convention, else the URDF's
  const std::vector<std::string>& urdf_names;  ///< of the independent joints, base to tip
  const JointConvention* convention;
  const std::vector<MovingJoint>& joints;  ///< of the chain, base to tip
  std::vector<std::size_t> followers;      ///< those of them that mimic another
};

struct FixedColumn {
  std::string_view name;
  Column* column;
  bool is_length;
  bool required;
};

/// Every column that is no joint.
std::array<FixedColumn, 12> fixed_columns(Header& header) {
  auto& [x, y, z] = header.position;
  auto& [qw, qx, qy, qz] = header.quaternion;
  return {{{"configuration", &header.configuration, false, true},
           {"target", &header.target, false, true},
           {"x", &x, true, true},
           {"y", &y, true, true},
           {"z", &z, true, true},
           {"split", &header.split, false, false},
           {"repeat", &header.repeat, false, false},
           {"qw", &qw, false, false},
           {"qx", &qx, false, false},
           {"qy", &qy, false, false},
           {"qz", &qz, false, false},
           {"sigma", &header.sigma, true, false}}};
}

bool is_fixed_column(std::string_view name) {
  Header header;
  const auto fixed = fixed_columns(header);
  return std::any_of(fixed.begin(), fixed.end(), [&](const FixedColumn& column) { return column.name == name; });
}

/// The header cell "name [unit]" cut in two. Without brackets at the end the unit is absent.
std::pair<std::string_view, std::optional<std::string_view>> name_and_unit(std::string_view cell) {
  const std::size_t open = cell.rfind('[');
  if (!cell.ends_with(']') || open == std::string_view::npos) return {cell, std::nullopt};
  return {trimmed(cell.substr(0, open)), trimmed(cell.substr(open + 1, cell.size() - open - 2))};
}

std::string expected_columns(const ExpectedJoints& joints) {
  std::vector<std::string> followers;
  for (const std::size_t i : joints.followers) followers.push_back(joints.joints[i].name);
  return "expected configuration, target, x, y, z and the joints " + comma_separated(joints.names) +
         ", optionally split, repeat, qw, qx, qy, qz, sigma" +
         (followers.empty() ? "" : " and the joints that mimic others: " + comma_separated(followers));
}

[[noreturn]] void fail_unknown_column(const Place& place, std::string_view cell, std::string_view name,
                                      const ExpectedJoints& joints) {
  const auto& urdf = joints.urdf_names;
  if (joints.convention != nullptr && std::find(urdf.begin(), urdf.end(), name) != urdf.end()) {
    fail(place, "column " + shown(cell) + " has the URDF's joint name, but with the joint convention " +
                    joints.convention->name + " the controller's are expected: " + comma_separated(joints.names));
  }
  const std::string hint =
      joints.convention == nullptr ? " (where joints bear the controller's names, give --joint-convention)" : "";
  fail(place, "unknown column " + shown(cell) + ": " + expected_columns(joints) + hint);
}

/// Fills a header from its cells.
class HeaderParser {
public:
  HeaderParser(const ExpectedJoints& joints, const Place& place)
      : joints_(joints), place_(place), fixed_(fixed_columns(header_)) {
    header_.line = place.line;
    header_.joints.resize(joints.names.size());
    header_.followers.resize(joints.followers.size());
    for (std::size_t i = 0; i < joints.names.size(); ++i) joint_columns_.emplace(joints.names[i], &header_.joints[i]);
    for (std::size_t i = 0; i < joints.followers.size(); ++i) {
      joint_columns_.emplace(joints.joints[joints.followers[i]].name, &header_.followers[i]);
    }
    for (const FixedColumn& column : fixed_) {
      if (joint_columns_.contains(column.name)) {
        fail(place.source, "joint " + shown(column.name) +
                               " is named like a column of the measurements: give a joint convention with other names");
      }
    }
  }

  Header parse(std::string_view line) {
    header_.separator = find_separator(line);
    Fields cells;
    cells.split(line, header_.separator, place_);
    header_.fields = cells.size();
    std::size_t named = cells.size();
    while (named > 0 && trimmed(cells[named - 1]).empty()) --named;
    for (std::size_t i = 0; i < named; ++i) add(i, trimmed(cells[i]));
    check_complete();
    return std::move(header_);
  }

private:
  static char find_separator(std::string_view line) {
    std::array<int, 2> count = {0, 0};
    bool quoted = false;
    for (const char c : line) {
      if (c == '"') quoted = !quoted;
      if (!quoted && (c == ',' || c == ';')) ++count[c == ';' ? 1 : 0];
    }
    return count[1] > count[0] ? ';' : ',';
  }

  void add(std::size_t index, std::string_view cell) {
    if (cell.empty()) fail(place_, "column " + std::to_string(index + 1) + " has no name");
    header_.names.emplace_back(printable(cell));
    auto [name, unit] = name_and_unit(cell);
    if (joint_columns_.contains(cell)) {  // a joint's own name may end in brackets
      name = cell;
      unit.reset();
    }
    Column* column = nullptr;
    std::vector<std::string_view> units;
    if (const auto joint = joint_columns_.find(name); joint != joint_columns_.end()) {
      column = joint->second;
      units = {"rad", "deg", "m", "mm"};
    }
    for (const FixedColumn& fixed : fixed_) {
      if (fixed.name != name) continue;
      column = fixed.column;
      if (fixed.is_length) units = {"m", "mm"};
    }
    if (column == nullptr) fail_unknown_column(place_, cell, name, joints_);
    if (present(*column)) {
      fail(place_, "column " + shown(cell) + " repeats '" + header_.names[column->index] + "'");
    }
    *column = {index, unit ? parse_unit(*unit, cell, units) : Unit::none};
  }

  Unit parse_unit(std::string_view unit, std::string_view cell, const std::vector<std::string_view>& allowed) const {
    if (std::find(allowed.begin(), allowed.end(), unit) == allowed.end()) {
      std::string rule = allowed.empty() ? "none" : "";
      for (const std::string_view name : allowed) rule += (rule.empty() ? "[" : ", [") + std::string(name) + "]";
      fail(place_, "unknown unit " + shown(unit) + " in column " + shown(cell) + ": expected " + rule);
    }
    if (unit == "rad") return Unit::rad;
    if (unit == "deg") return Unit::deg;
    return unit == "m" ? Unit::m : Unit::mm;
  }

  void check_complete() const {
    std::vector<std::string> missing;
    for (const FixedColumn& fixed : fixed_) {
      if (fixed.required && !present(*fixed.column)) missing.emplace_back(fixed.name);
    }
    for (std::size_t i = 0; i < header_.joints.size(); ++i) {
      if (!present(header_.joints[i])) missing.push_back(joints_.names[i]);
    }
    const auto& quaternion = header_.quaternion;
    if (std::any_of(quaternion.begin(), quaternion.end(), present)) {
      for (const FixedColumn& fixed : fixed_) {
        if (fixed.name.starts_with('q') && !present(*fixed.column)) missing.emplace_back(fixed.name);
      }
    }
    if (missing.empty()) return;
    fail(place_, (missing.size() == 1 ? "missing column " : "missing columns ") + comma_separated(missing) + ": " +
                     expected_columns(joints_) + " (the quaternion's four together)");
  }

  const ExpectedJoints& joints_;
  Place place_;
  Header header_;
  std::array<FixedColumn, 12> fixed_;
  std::unordered_map<std::string_view, Column*> joint_columns_;
};

// ---- Rows ----------------------------------------------------------------------------------------------------------

/// Why a cell that should hold a number does not.
std::string number_fault(std::string_view text, std::errc error, double value) {
  if (text.empty()) return "is empty: expected a number";
  if (error == std::errc::result_out_of_range) return "is outside the range of a double";
  if (error == std::errc() && !std::isfinite(value)) return "is not finite: expected a finite number";
  if (error == std::errc()) return "is out of range: expected at most 1e12";
  const bool comma = text.find(',') != std::string_view::npos;
  if (comma && text.find_first_not_of("0123456789+-.,eE") == std::string_view::npos) {
    return "has a decimal comma: expected a number with a decimal point";
  }
  return "is not a number";
}

/// One row of the file, read cell by cell.
class Row {
public:
  Row(const Header& header, const Fields& fields, const Place& place)
      : header_(header), fields_(fields), place_(place) {
    if (fields.size() != header.fields) fail_ragged();
    for (std::size_t i = header.names.size(); i < fields.size(); ++i) {
      if (!trimmed(fields[i]).empty()) fail(place, "value " + shown(fields[i]) + " in a column without a name");
    }
  }

  const Header& header() const { return header_; }
  bool has(const Column& column) const { return present(column) && !trimmed(fields_[column.index]).empty(); }
  std::string_view text(const Column& column) const { return fields_[column.index]; }

  double number(const Column& column) const {
    const std::string_view text = trimmed(fields_[column.index]);
    const char* first = text.data();
    const char* last = first + text.size();
    if (text.size() > 1 && text[0] == '+' && text[1] != '-') ++first;  // which from_chars does not take
    double value = 0.0;
    const auto [end, error] = std::from_chars(first, last, value);
    if (error != std::errc() || end != last || !(std::abs(value) <= kLargestNumber)) {
      fail_cell(column, number_fault(text, end == last ? error : std::errc::invalid_argument, value));
    }
    return to_si(value, column.unit);
  }

  Split split() const {
    if (!has(header_.split)) return Split::train;
    const std::string_view text = trimmed(fields_[header_.split.index]);
    if (text == "train") return Split::train;
    if (text == "test") return Split::test;
    fail_cell(header_.split, "is no split: expected train or test");
  }

  std::int32_t repeat() const {
    if (!has(header_.repeat)) return 1;
    const std::string_view text = trimmed(fields_[header_.repeat.index]);
    std::int32_t value = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || end != text.data() + text.size() || value < 0) {
      fail_cell(header_.repeat, "is no repeat: expected an integer from 0 to 2147483647");
    }
    return value;
  }

  double sigma() const {
    if (!has(header_.sigma)) return 0.0;
    const double value = number(header_.sigma);
    if (!(value > 0.0)) fail_cell(header_.sigma, "is not positive: expected a standard deviation above 0");
    if (value < kSmallestSigma) fail_cell(header_.sigma, "is out of range: expected at least 1e-15 m");
    return value;
  }

  /// All NaN where the row measures a point alone.
  Eigen::Quaterniond quaternion() const {
    const auto& columns = header_.quaternion;
    const auto given = std::count_if(columns.begin(), columns.end(), [&](const Column& c) { return has(c); });
    if (given == 0) return Eigen::Quaterniond(Eigen::Vector4d::Constant(std::numeric_limits<double>::quiet_NaN()));
    if (given != 4) fail(place_, "the quaternion has an empty cell: expected all of qw, qx, qy, qz or none");
    const Eigen::Quaterniond q(number(columns[0]), number(columns[1]), number(columns[2]), number(columns[3]));
    const double norm = q.norm();
    if (!(std::abs(norm - 1.0) <= kQuaternionTolerance)) {
      fail(place_, "the norm of the quaternion (qw " + shown(text(columns[0])) + ", ...) is " + shortest(norm) +
                       ": expected 1 within 0.001");
    }
    // What is normalised to rounding stays to the last bit, so that a written file reads back the same.
    constexpr double kRounding = 8 * std::numeric_limits<double>::epsilon();
    return std::abs(norm - 1.0) <= kRounding ? q : Eigen::Quaterniond(q.coeffs() / norm);
  }

  [[noreturn]] void fail_cell(const Column& column, const std::string& what) const {
    fail(place_, header_.names[column.index] + " " + shown(fields_[column.index]) + " " + what);
  }
  [[noreturn]] void fail_row(const std::string& what) const { fail(place_, what); }

private:
  [[noreturn]] void fail_ragged() const {
    const bool more_commas = header_.separator == ',' && fields_.size() > header_.fields;
    fail(place_, std::to_string(fields_.size()) + " fields, expected " + std::to_string(header_.fields) +
                     " as in the header in line " + std::to_string(header_.line) +
                     (more_commas ? " (decimal commas are not read)" : ""));
  }

  const Header& header_;
  const Fields& fields_;
  Place place_;
};

// ---- Measurements --------------------------------------------------------------------------------------------------

/// Numbers labels in the order of their first appearance.
class LabelTable {
public:
  LabelTable() : index_(16, Hash{&labels_}, Equal{&labels_}) {}
  LabelTable(const LabelTable&) = delete;
  LabelTable& operator=(const LabelTable&) = delete;

  /// The number of the label, or the size of the table for a new one.
  /// Files go through their labels in order, so the last one and the one behind it are tried before the hash.
  std::int32_t find(std::string_view label) {
    const std::int32_t next = last_ + 1 < size() ? last_ + 1 : 0;
    for (const std::int32_t guess : {last_, next}) {
      if (guess < size() && labels_[static_cast<std::size_t>(guess)] == label) return last_ = guess;
    }
    const auto found = index_.find(label);
    return found == index_.end() ? size() : last_ = *found;
  }

  void add(std::string_view label) {
    last_ = size();
    labels_.emplace_back(label);
    index_.insert(last_);
  }

  std::int32_t size() const { return static_cast<std::int32_t>(labels_.size()); }
  const std::vector<std::string>& labels() const { return labels_; }

  /// Leaves the table empty.
  std::vector<std::string> take_labels() {
    index_ = Index(0, Hash{&labels_}, Equal{&labels_});
    last_ = 0;
    return std::exchange(labels_, {});
  }

private:
  // The set holds numbers alone; the text of a label is kept once.
  struct Hash {
    using is_transparent = void;
    const std::vector<std::string>* labels;
    std::size_t operator()(std::string_view label) const { return std::hash<std::string_view>()(label); }
    std::size_t operator()(std::int32_t i) const { return (*this)((*labels)[static_cast<std::size_t>(i)]); }
  };
  struct Equal {
    using is_transparent = void;
    const std::vector<std::string>* labels;
    bool operator()(std::int32_t a, std::int32_t b) const { return a == b; }
    bool operator()(std::string_view a, std::int32_t b) const { return a == (*labels)[static_cast<std::size_t>(b)]; }
    bool operator()(std::int32_t a, std::string_view b) const { return (*this)(b, a); }
  };

  using Index = std::unordered_set<std::int32_t, Hash, Equal>;

  std::vector<std::string> labels_;
  Index index_;
  std::int32_t last_ = 0;
};

bool is_point(const Eigen::Quaterniond& q) { return std::isnan(q.w()); }

/// Points alone have no orientations at all.
void drop_unused_orientations(std::vector<Eigen::Quaterniond>& orientations) {
  if (std::all_of(orientations.begin(), orientations.end(), is_point)) orientations.clear();
}

/// Gathers the rows of one file.
class Collector {
public:
  Collector(const Header& header, const std::string& source)
      : header_(header), source_(source), joint_columns_(header.joints) {
    std::copy_if(header.followers.begin(), header.followers.end(), std::back_inserter(joint_columns_), present);
    joint_row_.resize(joint_columns_.size());
  }

  void reserve(std::size_t rows) {
    observations_.reserve(rows);
    lines_.reserve(rows);
  }

  void add(const Row& row, std::size_t line) {
    Observation observation;
    observation.split = row.split();
    observation.configuration = configuration(row, observation.split);
    observation.target = label(targets_, row, header_.target);
    if (targets_.size() > kMostTargets) row.fail_row("one target more than the limit of 100");
    observation.repeat = row.repeat();
    for (std::size_t i = 0; i < 3; ++i) {
      observation.position[static_cast<Eigen::Index>(i)] = row.number(header_.position[i]);
    }
    observation.sigma = row.sigma();
    observations_.push_back(observation);
    lines_.push_back(line);
    if (present(header_.quaternion[0])) orientations_.push_back(row.quaternion());
  }

  Measurements finish(const ExpectedJoints& joints) && {
    if (observations_.empty()) {
      fail(source_, "no measurement behind the header in line " + std::to_string(header_.line));
    }
    check_duplicates();
    Measurements result;
    result.source = source_;
    for (const MovingJoint& joint : joints.joints) result.joints.push_back(joint.name);
    if (joints.convention == nullptr) {
      result.joint_units = joint_units(joints);
    } else {
      convert_joints(*joints.convention);
    }
    result.configurations = configurations_.take_labels();
    result.targets = targets_.take_labels();
    result.observations = std::move(observations_);
    drop_unused_orientations(orientations_);
    result.orientations = std::move(orientations_);
    if (joints.followers.empty()) {
      std::exchange(lines_, {});  // before the joint values are there twice
      std::exchange(first_rows_, {});
    }
    const auto rows = static_cast<Eigen::Index>(joint_columns_.size());
    const auto columns = static_cast<Eigen::Index>(result.configurations.size());
    const Eigen::Map<const Eigen::MatrixXd> read(joint_values_.data(), rows, columns);
    if (joints.followers.empty()) {
      result.joint_values = read;
    } else {
      const auto independent = static_cast<Eigen::Index>(header_.joints.size());
      result.joint_values = all_joint_values(joints.joints, read.topRows(independent));
      check_followers(joints, read.bottomRows(rows - independent), result.joint_values);
    }
    return result;
  }

private:
  static std::int32_t label(LabelTable& table, const Row& row, const Column& column) {
    const std::string_view text = row.text(column);
    const std::int32_t number = table.find(text);
    if (number < table.size()) return number;
    if (const std::string fault = label_fault(text); !fault.empty()) row.fail_cell(column, fault);
    table.add(text);
    return number;
  }

  /// The row's configuration, checked against the rows of the same one before.
  std::int32_t configuration(const Row& row, Split split) {
    const std::int32_t count = configurations_.size();
    const std::int32_t number = label(configurations_, row, header_.configuration);
    const std::size_t joints = joint_row_.size();
    for (std::size_t j = 0; j < joints; ++j) joint_row_[j] = row.number(joint_columns_[j]);
    if (number == count) {
      joint_values_.insert(joint_values_.end(), joint_row_.begin(), joint_row_.end());
      first_rows_.push_back(observations_.size());
      return number;
    }
    const auto index = static_cast<std::size_t>(number);
    const double* first_values = joint_values_.data() + index * joints;
    const std::size_t first_row = first_rows_[index];
    for (std::size_t j = 0; j < joints; ++j) {
      if (joint_row_[j] != first_values[j]) fail_inconsistent(row, joint_columns_[j], "joint values", first_row);
    }
    if (split != observations_[first_row].split) fail_inconsistent(row, header_.split, "split", first_row);
    return number;
  }

  [[noreturn]] void fail_inconsistent(const Row& row, const Column& column, const std::string& rule,
                                      std::size_t first_row) const {
    row.fail_cell(column, "differs from line " + std::to_string(lines_[first_row]) + ": expected one " + rule +
                              " in all rows of configuration " + shown(row.text(header_.configuration)));
  }

  void check_duplicates() const {
    const auto key = [this](std::size_t i) {
      const Observation& o = observations_[i];
      return std::tuple(o.configuration, o.repeat, o.target);
    };
    std::size_t ordered = 1;
    while (ordered < observations_.size() && key(ordered - 1) < key(ordered)) ++ordered;
    if (ordered == observations_.size()) return;
    std::vector<std::size_t> rows(observations_.size());
    std::iota(rows.begin(), rows.end(), std::size_t{0});
    std::sort(rows.begin(), rows.end(),
              [&](std::size_t a, std::size_t b) { return std::tuple(key(a), a) < std::tuple(key(b), b); });
    const auto twin =
        std::adjacent_find(rows.begin(), rows.end(), [&](std::size_t a, std::size_t b) { return key(a) == key(b); });
    if (twin == rows.end()) return;
    const Observation& o = observations_[*twin];
    fail(Place{source_, lines_[*(twin + 1)]},
         "configuration " + shown(configurations_.labels()[static_cast<std::size_t>(o.configuration)]) + ", repeat " +
             std::to_string(o.repeat) + ", target " + shown(targets_.labels()[static_cast<std::size_t>(o.target)]) +
             " is measured twice, before in line " + std::to_string(lines_[*twin]) + ": expected one row for each");
  }

  /// One configuration after the other, so that its values do not depend on where it stands.
  void convert_joints(const JointConvention& convention) {
    const auto size = static_cast<Eigen::Index>(header_.joints.size());
    for (std::size_t c = 0; c < first_rows_.size(); ++c) {
      Eigen::Map<Eigen::VectorXd> values(joint_values_.data() + c * joint_row_.size(), size);
      values = (convention.matrix * values + convention.offset).eval();
      if (!(values.cwiseAbs().maxCoeff() <= kLargestNumber)) {
        fail(Place{source_, lines_[first_rows_[c]]},
             "joint values out of range behind the joint convention " + convention.name + ": expected at most 1e12");
      }
    }
  }

  /// Throws where the column of a follower says otherwise than its leader's: `read` has one row for each column.
  void check_followers(const ExpectedJoints& joints, const Eigen::Ref<const Eigen::MatrixXd>& read,
                       const Eigen::MatrixXd& joint_values) const {
    Eigen::Index row = 0;
    for (std::size_t i = 0; i < joints.followers.size(); ++i) {
      const Column& column = header_.followers[i];
      if (!present(column)) continue;
      const MovingJoint& joint = joints.joints[joints.followers[i]];
      const auto expected = joint_values.row(static_cast<Eigen::Index>(joints.followers[i]));
      const double tolerance = kRoundedJointValue * (1.0 + std::abs(joint.mimic->multiplier));
      for (Eigen::Index c = 0; c < read.cols(); ++c) {
        if (std::abs(read(row, c) - expected[c]) <= tolerance) continue;
        const std::string& leader = joints.joints[joint.mimic->leader].name;
        fail(Place{source_, lines_[first_rows_[static_cast<std::size_t>(c)]]},
             header_.names[column.index] + " " + shown(in_unit(read(row, c), column.unit)) +
                 " contradicts the URDF, where the joint mimics " + shown(leader) + ": expected " +
                 in_unit(expected[c], column.unit) + " (" + shortest(joint.mimic->multiplier) + " times that of " +
                 shown(leader) + " plus " + in_unit(joint.mimic->offset, column.unit) + ")");
      }
      ++row;
    }
  }

  std::vector<JointUnit> joint_units(const ExpectedJoints& joints) const {
    std::vector<Column> columns(joints.joints.size());
    const std::vector<std::size_t> independent = independent_joints(joints.joints);
    for (std::size_t i = 0; i < independent.size(); ++i) columns[independent[i]] = header_.joints[i];
    for (std::size_t i = 0; i < joints.followers.size(); ++i) columns[joints.followers[i]] = header_.followers[i];
    std::vector<JointUnit> units;
    for (const Column& column : columns) {
      const bool angle = column.unit == Unit::rad || column.unit == Unit::deg;
      units.push_back(column.unit == Unit::none ? JointUnit::unstated : angle ? JointUnit::radian : JointUnit::metre);
    }
    const bool any = std::any_of(units.begin(), units.end(), [](JointUnit u) { return u != JointUnit::unstated; });
    return any ? units : std::vector<JointUnit>();
  }

  const Header& header_;
  const std::string& source_;
  std::vector<Column> joint_columns_;  ///< the expected ones, then those of followers that the file has
  LabelTable configurations_;
  LabelTable targets_;
  std::vector<double> joint_values_;     ///< as the file has them but in SI, configuration by configuration
  std::vector<std::size_t> first_rows_;  ///< of each configuration
  std::vector<double> joint_row_;
  std::vector<Observation> observations_;
  std::vector<Eigen::Quaterniond> orientations_;
  std::vector<std::size_t> lines_;  ///< of each observation
};

Measurements collect(LineReader& lines, const std::vector<MovingJoint>& chain, const JointConvention* convention) {
  const std::vector<std::string> urdf_joints = independent_joint_names(chain);
  std::optional<JointConvention> matched;
  if (convention != nullptr) matched = matched_convention(*convention, urdf_joints);
  ExpectedJoints joints{
      matched ? matched->controller_joints : urdf_joints, urdf_joints, matched ? &*matched : nullptr, chain, {}};
  for (std::size_t i = 0; i < chain.size(); ++i) {
    if (chain[i].mimic) joints.followers.push_back(i);
  }
  std::string_view line;
  if (!next_record(lines, line)) fail(lines.source(), "empty: " + expected_columns(joints));
  const Header header = HeaderParser(joints, lines.place()).parse(line);
  Collector collector(header, lines.source());
  Fields fields;
  for (bool first = true; next_record(lines, line); first = false) {
    fields.split(line, header.separator, lines.place());
    collector.add(Row(header, fields, lines.place()), lines.place().line);
    // Rows are about equally long; what is reserved too much is never touched.
    if (first) collector.reserve(lines.size_hint() / line.size() + 1);
  }
  return std::move(collector).finish(joints);
}

/// Joints that follow none, of which only the names are known.
std::vector<MovingJoint> joints_named(const std::vector<std::string>& names) {
  std::vector<MovingJoint> joints(names.size());
  for (std::size_t i = 0; i < names.size(); ++i) joints[i].name = names[i];
  return joints;
}

// ---- Joint convention ----------------------------------------------------------------------------------------------

Json parse_convention(std::string_view text, const std::string& source) {
  std::set<std::string> keys;
  return parse_json<Json>(text, source, [&](int depth, Json::parse_event_t event, const Json& value) {
    if (depth == 1 && event == Json::parse_event_t::key && !keys.insert(value.get<std::string>()).second) {
      fail(source, "key " + shown(value.get<std::string>()) + " appears twice");
    }
  });
}

std::vector<std::string> convention_names(const Json& json, const std::string& key, const std::string& source) {
  const Json& list = json.at(key);
  if (!list.is_array() || list.empty()) fail(source, "key '" + key + "': expected a list of joint names");
  if (list.size() > kMostConventionJoints) fail(source, "key '" + key + "': more than the limit of 1000 joints");
  std::vector<std::string> names;
  for (const Json& item : list) {
    if (!item.is_string() || item.get_ref<const std::string&>().empty()) {
      fail(source, "key '" + key + "': " + shown(item.dump()) + " is no joint name: expected a string");
    }
    const auto& name = item.get_ref<const std::string&>();
    if (std::find(names.begin(), names.end(), name) != names.end()) {
      fail(source, "key '" + key + "': joint " + shown(name) + " appears twice");
    }
    names.push_back(name);
  }
  return names;
}

/// `where` names the list in messages.
Eigen::VectorXd convention_numbers(const Json& list, std::size_t count, const std::string& where,
                                   const std::string& source) {
  const std::string expected = "expected a list of " + std::to_string(count) + " numbers, one per joint";
  if (!list.is_array()) fail(source, where + ": " + shown(list.dump()) + " is no list: " + expected);
  if (list.size() != count) fail(source, where + " has " + std::to_string(list.size()) + " entries: " + expected);
  Eigen::VectorXd values(static_cast<Eigen::Index>(count));
  for (std::size_t i = 0; i < count; ++i) {
    if (!list[i].is_number()) fail(source, where + ": " + shown(list[i].dump()) + " is no number: " + expected);
    values[static_cast<Eigen::Index>(i)] = list[i].get<double>();
    if (std::abs(values[static_cast<Eigen::Index>(i)]) > kLargestNumber) {
      fail(source, where + ": " + shown(list[i].dump()) + " is out of range: expected at most 1e12");
    }
  }
  return values;
}

void check_convention_keys(const Json& json, const std::string& source) {
  const std::string expected = "expected controller_joints, urdf_joints, matrix and optionally offset, description";
  if (!json.is_object()) fail(source, "no JSON object: " + expected);
  for (const auto& [key, value] : json.items()) {
    const bool known = key == "controller_joints" || key == "urdf_joints" || key == "matrix" || key == "offset";
    if (!known && key != "description") fail(source, "unknown key " + shown(key) + ": " + expected);
  }
  for (const char* key : {"controller_joints", "urdf_joints", "matrix"}) {
    if (!json.contains(key)) fail(source, "missing key '" + std::string(key) + "': " + expected);
  }
  if (json.contains("description") && !json["description"].is_string()) {
    fail(source, "key 'description': " + shown(json["description"].dump()) + " is no text: expected a string");
  }
}

// ---- Writing -------------------------------------------------------------------------------------------------------

template <typename Number>
void append_number(std::string& text, Number value) {
  std::array<char, 32> digits{};
  const auto [end, error] = std::to_chars(digits.data(), digits.data() + digits.size(), value);
  text.append(digits.data(), end);
}

/// The name as a CSV field. A # is quoted as well: at the start of a line it would begin a comment.
std::string csv_field(const std::string& name) {
  const bool plain = name.find_first_of(",;\"#") == std::string::npos && trimmed(name).size() == name.size();
  if (plain) return name;
  std::string field = "\"";
  for (const char c : name) field += c == '"' ? "\"\"" : std::string(1, c);
  return field + '"';
}

std::vector<std::string> csv_labels(const std::vector<std::string>& labels, const char* what,
                                    const std::string& source) {
  std::vector<std::string> fields;
  for (const std::string& label : labels) {
    if (const std::string fault = label_fault(label); !fault.empty()) {
      fail(source, std::string(what) + " " + shown(label) + " " + fault);
    }
    fields.push_back(csv_field(label));
  }
  return fields;
}

/// The optional columns that the measurements use.
struct UsedColumns {
  bool split = false;
  bool repeat = false;
  bool sigma = false;
  bool quaternion = false;
};

UsedColumns used_columns(const Measurements& measurements) {
  UsedColumns used;
  used.quaternion = !measurements.orientations.empty();
  for (const Observation& o : measurements.observations) {
    used.split = used.split || o.split == Split::test;
    used.repeat = used.repeat || o.repeat != 1;
    used.sigma = used.sigma || o.sigma > 0.0;
  }
  return used;
}

std::string csv_header(const Measurements& measurements, const UsedColumns& used) {
  std::string text = "configuration";
  if (used.split) text += ",split";
  if (used.repeat) text += ",repeat";
  text += ",target";
  const std::vector<std::string> names = csv_labels(measurements.joints, "joint", measurements.source);
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (is_fixed_column(measurements.joints[i])) {
      fail(measurements.source, "joint " + shown(names[i]) + " is named like a column of the measurements");
    }
    const JointUnit unit = measurements.joint_units.empty() ? JointUnit::unstated : measurements.joint_units[i];
    std::string name = measurements.joints[i];
    if (unit == JointUnit::radian) name += "[rad]";
    if (unit == JointUnit::metre) name += "[m]";
    text += "," + csv_field(name);
  }
  text += ",x[m],y[m],z[m]";
  if (used.quaternion) text += ",qw,qx,qy,qz";
  if (used.sigma) text += ",sigma[m]";
  return text + "\n";
}

// ---- Means ---------------------------------------------------------------------------------------------------------

/// Mean of the orientations of the given rows, see averaged(); NaN where none of them has one.
Eigen::Quaterniond mean_orientation(const std::vector<Eigen::Quaterniond>& orientations,
                                    const std::vector<std::size_t>& rows) {
  std::vector<Eigen::Quaterniond> given;
  for (const std::size_t row : rows) {
    if (!is_point(orientations[row])) given.push_back(orientations[row]);
  }
  if (given.empty()) return orientations[rows.front()];
  if (given.size() == 1) return given.front();
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const Eigen::Quaterniond& q : given) sum += q.coeffs() * q.coeffs().transpose();
  const Eigen::Vector4d mean = Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d>(sum).eigenvectors().col(3).normalized();
  return Eigen::Quaterniond(mean.dot(given.front().coeffs()) < 0.0 ? Eigen::Vector4d(-mean) : mean);
}

/// Mean of the given rows, which share configuration and target.
Observation mean_observation(const std::vector<Observation>& observations, const std::vector<std::size_t>& rows) {
  Observation mean = observations[rows.front()];
  const auto count = static_cast<double>(rows.size());
  Eigen::Vector3d difference = Eigen::Vector3d::Zero();  // from the first, so that equal rows have an exact mean
  double variance = 0.0;
  bool all_stated = true;
  for (const std::size_t row : rows) {
    const Observation& o = observations[row];
    difference += o.position - mean.position;
    variance += o.sigma * o.sigma;
    all_stated = all_stated && o.sigma > 0.0;
  }
  mean.position += difference / count;
  if (rows.size() > 1) mean.sigma = all_stated ? std::sqrt(variance) / count : 0.0;
  mean.repeat = 1;
  return mean;
}

}  // namespace

JointConvention parse_joint_convention(std::string_view json, const std::string& source) {
  const Json document = parse_convention(json, source);
  check_convention_keys(document, source);
  JointConvention convention;
  convention.name = source;
  convention.controller_joints = convention_names(document, "controller_joints", source);
  convention.urdf_joints = convention_names(document, "urdf_joints", source);
  const std::size_t count = convention.controller_joints.size();
  if (convention.urdf_joints.size() != count) {
    fail(source, "key 'urdf_joints' has " + std::to_string(convention.urdf_joints.size()) + " names: expected " +
                     std::to_string(count) + " as in 'controller_joints'");
  }
  const Json& rows = document.at("matrix");
  if (!rows.is_array() || rows.size() != count) {
    fail(source, "key 'matrix' has " + (rows.is_array() ? std::to_string(rows.size()) : "no") + " rows: expected " +
                     std::to_string(count) + ", one per joint");
  }
  const auto size = static_cast<Eigen::Index>(count);
  convention.matrix.resize(size, size);
  for (std::size_t i = 0; i < count; ++i) {
    const std::string where = "key 'matrix', row " + std::to_string(i + 1);
    convention.matrix.row(static_cast<Eigen::Index>(i)) = convention_numbers(rows[i], count, where, source);
  }
  const Eigen::Index rank = convention.matrix.fullPivLu().rank();
  if (rank < size) {
    fail(source,
         "key 'matrix' is singular: its rank is " + std::to_string(rank) + ", expected " + std::to_string(count));
  }
  convention.offset = document.contains("offset")
                          ? convention_numbers(document.at("offset"), count, "key 'offset'", source)
                          : Eigen::VectorXd::Zero(size);
  return convention;
}

JointConvention read_joint_convention(const std::filesystem::path& file) {
  return parse_joint_convention(read_text_file(file), file.string());
}

JointConvention matched_convention(const JointConvention& convention, const std::vector<std::string>& urdf_joints) {
  JointConvention matched = convention;
  matched.urdf_joints = urdf_joints;
  bool match = convention.urdf_joints.size() == urdf_joints.size();
  for (std::size_t i = 0; match && i < urdf_joints.size(); ++i) {
    const auto found = std::find(convention.urdf_joints.begin(), convention.urdf_joints.end(), urdf_joints[i]);
    match = found != convention.urdf_joints.end();
    if (!match) break;
    const Eigen::Index row = found - convention.urdf_joints.begin();
    matched.matrix.row(static_cast<Eigen::Index>(i)) = convention.matrix.row(row);
    matched.offset[static_cast<Eigen::Index>(i)] = convention.offset[row];
  }
  if (!match) {
    fail(convention.name, "key 'urdf_joints' names " + comma_separated(convention.urdf_joints) +
                              ": expected the moving joints of the chain " + comma_separated(urdf_joints));
  }
  return matched;
}

Measurements parse_measurements(std::string_view csv, const std::vector<std::string>& urdf_joints,
                                const JointConvention* convention, const std::string& source) {
  LineReader lines(csv, source);
  return collect(lines, joints_named(urdf_joints), convention);
}

Measurements parse_measurements(const Robot& robot, std::string_view csv, const JointConvention* convention,
                                const std::string& source) {
  LineReader lines(csv, source);
  return collect(lines, robot.joints, convention);
}

Measurements read_measurements(const std::filesystem::path& file, const std::vector<std::string>& urdf_joints,
                               const JointConvention* convention) {
  LineReader lines(file);
  return collect(lines, joints_named(urdf_joints), convention);
}

Measurements read_measurements(const Robot& robot, const std::filesystem::path& file,
                               const JointConvention* convention) {
  LineReader lines(file);
  return collect(lines, robot.joints, convention);
}

std::string measurements_csv(const Measurements& measurements) {
  const UsedColumns used = used_columns(measurements);
  std::string text = csv_header(measurements, used);
  const auto configurations = csv_labels(measurements.configurations, "configuration", measurements.source);
  const auto targets = csv_labels(measurements.targets, "target", measurements.source);
  const auto append_cell = [&text](auto value) {
    text += ',';
    append_number(text, value);
  };
  for (std::size_t i = 0; i < measurements.observations.size(); ++i) {
    const Observation& o = measurements.observations[i];
    text += configurations[static_cast<std::size_t>(o.configuration)];
    if (used.split) text += o.split == Split::test ? ",test" : ",train";
    if (used.repeat) append_cell(o.repeat);
    text += "," + targets[static_cast<std::size_t>(o.target)];
    for (const double value : measurements.joint_values.col(o.configuration)) append_cell(value);
    for (const double value : o.position) append_cell(value);
    if (used.quaternion) {
      const Eigen::Quaterniond& q = measurements.orientations[i];
      if (is_point(q))
        text += ",,,,";
      else
        for (const double value : {q.w(), q.x(), q.y(), q.z()}) append_cell(value);
    }
    if (used.sigma) {
      if (o.sigma > 0.0)
        append_cell(o.sigma);
      else
        text += ',';
    }
    text += '\n';
  }
  return text;
}

Measurements subset(const Measurements& measurements, const std::function<bool(const Observation&)>& keep) {
  Measurements kept;
  kept.source = measurements.source;
  kept.joints = measurements.joints;
  kept.targets = measurements.targets;
  kept.joint_units = measurements.joint_units;
  std::vector<std::int32_t> numbers(measurements.configurations.size(), -1);
  for (std::size_t i = 0; i < measurements.observations.size(); ++i) {
    const Observation& o = measurements.observations[i];
    if (!keep(o)) continue;
    numbers[static_cast<std::size_t>(o.configuration)] = 0;
    kept.observations.push_back(o);
    if (!measurements.orientations.empty()) kept.orientations.push_back(measurements.orientations[i]);
  }
  std::vector<Eigen::Index> columns;
  for (std::size_t c = 0; c < numbers.size(); ++c) {
    if (numbers[c] < 0) continue;
    numbers[c] = static_cast<std::int32_t>(columns.size());
    columns.push_back(static_cast<Eigen::Index>(c));
    kept.configurations.push_back(measurements.configurations[c]);
  }
  kept.joint_values = measurements.joint_values(Eigen::all, columns);
  for (Observation& o : kept.observations) o.configuration = numbers[static_cast<std::size_t>(o.configuration)];
  drop_unused_orientations(kept.orientations);
  return kept;
}

Measurements averaged(const Measurements& measurements) {
  Measurements means = measurements;
  means.observations.clear();
  means.orientations.clear();
  const auto& observations = measurements.observations;
  const auto key = [&](std::size_t i) { return std::pair(observations[i].configuration, observations[i].target); };
  std::vector<std::size_t> order(observations.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto before = [&](std::size_t a, std::size_t b) { return key(a) < key(b); };
  if (!std::is_sorted(order.begin(), order.end(), before)) {
    std::stable_sort(order.begin(), order.end(), before);
  }
  std::vector<std::size_t> rows;
  for (std::size_t k = 0; k < order.size(); ++k) {
    rows.push_back(order[k]);
    if (k + 1 < order.size() && key(order[k]) == key(order[k + 1])) continue;
    means.observations.push_back(mean_observation(observations, rows));
    if (!measurements.orientations.empty()) {
      means.orientations.push_back(mean_orientation(measurements.orientations, rows));
    }
    rows.clear();
  }
  return means;
}

Measurements joined(const Measurements& first, const Measurements& second) {
  Measurements result = first;
  const auto offset = static_cast<std::int32_t>(first.joint_values.cols());
  result.joint_values.resize(first.joint_values.rows(), first.joint_values.cols() + second.joint_values.cols());
  result.joint_values << first.joint_values, second.joint_values;
  for (std::size_t c = 0; c < second.configurations.size(); ++c) {
    result.configurations.push_back(std::to_string(static_cast<std::size_t>(offset) + c + 1));
  }
  for (Observation observation : second.observations) {
    observation.configuration += offset;
    result.observations.push_back(observation);
  }
  result.orientations.insert(result.orientations.end(), second.orientations.begin(), second.orientations.end());
  return result;
}

}  // namespace kdl_calibration
