#pragma once

// Lines and fields of a CSV file, and names written as fields.

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/text_file.hpp"

namespace kdl_calibration {

/// The place named in a message.
struct Place {
  const std::string& source;
  std::size_t line;
};

/// Throw InputError: "source:line: what", "source: what".
[[noreturn]] void fail(const Place& place, const std::string& what);
[[noreturn]] void fail(const std::string& source, const std::string& what);

/// Splits text in memory, or a file that is read in pieces, into lines. Throws InputError for a file above 16 GiB, a
/// line above 1 MiB, a zero byte, a carriage return inside a line, UTF-16.
class LineReader {
public:
  LineReader(std::string_view text, std::string source);
  explicit LineReader(const std::filesystem::path& path);

  /// The next line without its line end; false at the end of the text.
  bool next(std::string_view& line);

  Place place() const { return {source_, line_}; }
  const std::string& source() const { return source_; }
  /// Bytes of the whole text; 0 if not known before the end.
  std::size_t size_hint() const { return size_hint_; }

private:
  void refill();
  void check_encoding();
  void check_characters(std::string_view line) const;

  std::string source_;
  File file_;
  std::unique_ptr<char[]> buffer_;
  std::string_view rest_;
  std::size_t size_hint_ = 0;
  std::uintmax_t read_ = 0;
  std::size_t line_ = 0;
};

/// Whether the line begins with # or, as in exports of SpatialAnalyzer, with //.
bool is_comment(std::string_view line);

struct Comment {
  std::string text;
  std::size_t line = 0;
};

/// The next line that is neither a comment nor empty. Spreadsheets write an empty row as separators alone. Adds the
/// comments before it to `comments`, if there is such a list.
bool next_record(LineReader& lines, std::string_view& line, std::vector<Comment>* comments = nullptr);

/// The separator of a header: comma, semicolon or tab, whichever is most frequent outside quotes.
char separator_of(std::string_view header);

/// The fields of one line; views into the line or, for quoted fields, into an internal buffer. Throws InputError for
/// more than 10,000 of them and for quotes that do not match.
class Fields {
public:
  void split(std::string_view line, char separator, const Place& place);

  std::size_t size() const { return fields_.size(); }
  std::string_view operator[](std::size_t i) const { return fields_[i]; }

private:
  void add(std::string_view field, const Place& place);
  void split_quoted(std::string_view line, char separator, const Place& place);
  static void skip_blanks(std::string_view& line, char separator);
  static std::string_view take_plain(std::string_view& line, char separator, const Place& place);
  std::string_view take_quoted(std::string_view& line, char separator, const Place& place);

  std::vector<std::string_view> fields_;
  std::string unescaped_;
};

/// The rule that the label breaks; empty if it can be written and read back.
std::string label_fault(std::string_view label);

/// The text as a CSV field, in quotes where it needs them.
std::string csv_cell(std::string_view text);

/// The name as a CSV field. A # is quoted as well: at the start of a line it would begin a comment.
/// A name that a spreadsheet would evaluate as a formula (starting with =, +, - or @ after any apostrophes, and not a
/// number) gets an additional leading apostrophe.
std::string csv_field(const std::string& name);
/// The name written by csv_field, without that apostrophe.
std::string_view name_in(std::string_view field);

}  // namespace kdl_calibration
