#include "base/csv.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <cstring>
#include <system_error>
#include <utility>

#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"

namespace kdl_calibration {
namespace {

constexpr std::uintmax_t kLargestCsvFile = std::uintmax_t{16} << 30U;
constexpr std::size_t kLongestLine = std::size_t{1} << 20U;
constexpr std::size_t kFileBuffer = 4 * kLongestLine;
constexpr std::size_t kMostColumns = 10'000;

bool is_number(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  double value = 0.0;
  const char* end = text.data() + text.size();
  return std::from_chars(text.data(), end, value).ptr == end && std::isfinite(value);
}

// Leading apostrophes are skipped, so that every name reads back.
bool begins_a_formula(std::string_view name) {
  const std::size_t first = name.find_first_not_of('\'');
  return first != std::string_view::npos && std::string_view("=+-@").find(name[first]) != std::string_view::npos &&
         !is_number(name);
}

}  // namespace

void fail(const Place& place, const std::string& what) {
  throw InputError(fmt::format("{}:{}: {}", place.source, place.line, what));
}

void fail(const std::string& source, const std::string& what) { throw InputError(source + ": " + what); }

LineReader::LineReader(std::string_view text, std::string source)
    : source_(std::move(source)), rest_(text), size_hint_(text.size()) {}

LineReader::LineReader(const std::filesystem::path& path)
    : source_(path.string()), file_(open_file(path)), buffer_(new char[kFileBuffer]), rest_(buffer_.get(), 0) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (!error) size_hint_ = static_cast<std::size_t>(size);
  if (!error && size > kLargestCsvFile) fail(source_, "larger than the limit of 16 GiB");
}

bool LineReader::next(std::string_view& line) {
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

// Called if the rest has no line end. A rest longer than the longest line is refused without reading on.
void LineReader::refill() {
  if (rest_.size() > kLongestLine) return;
  if (!rest_.empty()) {  // memmove must not get a null pointer, even for zero bytes
    std::memmove(buffer_.get(), rest_.data(), rest_.size());
  }
  const std::size_t free = kFileBuffer - rest_.size();
  const std::size_t read = read_bytes(file_.get(), buffer_.get() + rest_.size(), free, source_);
  rest_ = {buffer_.get(), rest_.size() + read};
  read_ += read;
  if (read_ > kLargestCsvFile) fail(source_, "larger than the limit of 16 GiB");  // size unknown for pipes
  if (read < free) file_.reset();
}

void LineReader::check_encoding() {
  if (rest_.starts_with("\xff\xfe") || rest_.starts_with("\xfe\xff")) {
    fail(source_, "the text is UTF-16: save it as UTF-8");
  }
  if (rest_.starts_with("\xef\xbb\xbf")) rest_.remove_prefix(3);
}

void LineReader::check_characters(std::string_view line) const {
  if (line.find('\0') != std::string_view::npos) {
    fail(place(), "the line has a NUL byte: expected text in UTF-8 (UTF-16 is not read)");
  }
  if (line.find('\r') != std::string_view::npos) {
    fail(place(), "the line has a carriage return inside: expected lines that end with LF or CRLF");
  }
}

bool is_comment(std::string_view line) { return line.starts_with('#') || line.starts_with("//"); }

bool next_record(LineReader& lines, std::string_view& line, std::vector<Comment>* comments) {
  while (lines.next(line)) {
    const bool comment = is_comment(line);
    if (!comment && line.find_first_not_of(" \t,;") != std::string_view::npos) return true;
    if (comment && comments != nullptr) comments->push_back({std::string(line), lines.place().line});
  }
  return false;
}

char separator_of(std::string_view header) {
  constexpr std::string_view kSeparators = ",;\t";
  std::array<int, kSeparators.size()> count{};
  bool quoted = false;
  for (const char c : header) {
    if (c == '"') quoted = !quoted;
    const std::size_t which = kSeparators.find(c);
    if (!quoted && which != std::string_view::npos) ++count[which];
  }
  return kSeparators[static_cast<std::size_t>(std::max_element(count.begin(), count.end()) - count.begin())];
}

void Fields::split(std::string_view line, char separator, const Place& place) {
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

void Fields::add(std::string_view field, const Place& place) {
  if (fields_.size() == kMostColumns) fail(place, "more fields than the limit of 10000 columns");
  fields_.push_back(field);
}

void Fields::skip_blanks(std::string_view& line, char separator) {
  line.remove_prefix(std::min(line.find_first_not_of(separator == '\t' ? " " : " \t"), line.size()));
}

void Fields::split_quoted(std::string_view line, char separator, const Place& place) {
  unescaped_.clear();
  unescaped_.reserve(line.size());  // the views into it must stay valid
  while (true) {
    skip_blanks(line, separator);
    add(line.starts_with('"') ? take_quoted(line, separator, place) : take_plain(line, separator, place), place);
    if (line.empty()) return;
    line.remove_prefix(1);
  }
}

std::string_view Fields::take_plain(std::string_view& line, char separator, const Place& place) {
  const std::string_view field = trimmed(line.substr(0, line.find(separator)));
  if (field.find('"') != std::string_view::npos) {
    fail(place, "a quote inside the field " + shown(field) + ": expected the whole field in quotes, its own doubled");
  }
  line.remove_prefix(std::min(line.find(separator), line.size()));
  return field;
}

std::string_view Fields::take_quoted(std::string_view& line, char separator, const Place& place) {
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
  skip_blanks(line, separator);
  if (!line.empty() && line.front() != separator) fail(place, "text after the closing quote of " + shown(whole));
  return std::string_view(unescaped_).substr(begin);
}

std::string label_fault(std::string_view label) {
  if (label.empty()) return "is empty: expected a name";
  if (std::any_of(label.begin(), label.end(), is_control)) return "has a control character: expected plain text";
  if (!is_utf8(label)) return "is not UTF-8: save the file as UTF-8";
  return {};
}

std::string csv_cell(std::string_view text) {
  if (text.find_first_of(",;\"#") == std::string_view::npos && !is_comment(text) &&
      trimmed(text).size() == text.size()) {
    return std::string(text);
  }
  std::string cell = "\"";
  for (const char c : text) cell += c == '"' ? "\"\"" : std::string(1, c);
  return cell + '"';
}

std::string csv_field(const std::string& name) { return csv_cell(begins_a_formula(name) ? "'" + name : name); }

std::string_view name_in(std::string_view field) {
  return field.starts_with('\'') && begins_a_formula(field) ? field.substr(1) : field;
}

}  // namespace kdl_calibration
