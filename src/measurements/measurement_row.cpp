#include "measurements/measurement_row.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <system_error>

#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"

namespace kdl_calibration {
namespace {

constexpr double kQuaternionTolerance = 1e-3;

// Why a cell that should hold a number does not.
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

}  // namespace

Row::Row(const Header& header, const Fields& fields, const Place& place)
    : header_(header), fields_(fields), place_(place) {
  if (fields.size() != header.fields) fail_ragged();
  for (std::size_t i = header.names.size(); i < fields.size(); ++i) {
    if (!trimmed(fields[i]).empty()) fail(place, "value " + shown(fields[i]) + " in a column without a name");
  }
}

bool Row::has(const Column& column) const { return present(column) && !trimmed(fields_[column.index]).empty(); }
double Row::number(const Column& column) const {
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

Split Row::split() const {
  if (!has(header_.split)) return Split::train;
  const std::string_view text = trimmed(fields_[header_.split.index]);
  if (text == "train") return Split::train;
  if (text == "test") return Split::test;
  fail_cell(header_.split, "is no split: expected train or test");
}

std::int32_t Row::repeat() const {
  if (!has(header_.repeat)) return 1;
  const std::string_view text = trimmed(fields_[header_.repeat.index]);
  std::int32_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < 0) {
    fail_cell(header_.repeat, "is no repeat: expected an integer from 0 to 2147483647");
  }
  return value;
}

std::int64_t Row::order() const {
  const std::string_view text = trimmed(fields_[header_.order.index]);
  std::int64_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size()) {
    fail_cell(header_.order, "is no place in an order: expected an integer");
  }
  return value;
}

double Row::sigma() const {
  if (!has(header_.sigma)) return 0.0;
  const double value = number(header_.sigma);
  if (!(value > 0.0)) fail_cell(header_.sigma, "is not positive: expected a standard deviation above 0");
  if (value < kSmallestSigma) fail_cell(header_.sigma, "is out of range: expected at least 1e-15 m");
  return value;
}

Eigen::Quaterniond Row::quaternion() const {
  const auto& columns = header_.quaternion;
  const auto given = std::count_if(columns.begin(), columns.end(), [&](const Column& c) { return has(c); });
  if (given == 0) return point_alone();
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

void Row::fail_cell(const Column& column, const std::string& what) const {
  fail(place_, header_.names[column.index] + " " + shown(fields_[column.index]) + " " + what);
}
void Row::fail_row(const std::string& what) const { fail(place_, what); }

void Row::fail_ragged() const {
  const bool more_commas = header_.separator == ',' && fields_.size() > header_.fields;
  fail(place_, std::to_string(fields_.size()) + " fields, expected " + std::to_string(header_.fields) +
                   " as in the header in line " + std::to_string(header_.line) +
                   (more_commas ? " (decimal commas are not read)" : ""));
}

}  // namespace kdl_calibration
