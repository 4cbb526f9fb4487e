#include "measurements/measurement_row.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <numbers>
#include <system_error>

#include "base/number_range.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "base/units.hpp"

namespace kdl_calibration {
namespace {

constexpr double kQuaternionTolerance = 1e-3;

bool has_commas_of_numbers(std::string_view text) {
  return text.find(',') != std::string_view::npos &&
         text.find_first_not_of("0123456789+-.,eE") == std::string_view::npos;
}

// Error message for a cell that is not a valid number.
std::string number_fault(std::string_view text, std::errc error, double value, char separator) {
  if (text.empty()) return "is empty: expected a number";
  if (error == std::errc::result_out_of_range) return "is outside the range of a double";
  if (error == std::errc() && !std::isfinite(value)) return "is not finite: expected a finite number";
  if (error == std::errc()) return "is out of range: expected at most 1e12";
  if (separator == ',' && has_commas_of_numbers(text)) {
    return "has a decimal comma: expected a number with a decimal point, or semicolons between the columns";
  }
  return "is not a number";
}

// Parses the whole text as a number.
std::errc parse_number(std::string_view text, double& value) {
  const char* first = text.data();
  const char* last = first + text.size();
  if (text.size() > 1 && text[0] == '+' && text[1] != '-') ++first;  // from_chars accepts no plus sign
  const auto [end, error] = std::from_chars(first, last, value);
  return end == last ? error : std::errc::invalid_argument;
}

// Roll, pitch and yaw of R = Rz(yaw) Ry(pitch) Rx(roll), of several solutions the nearest to `own`.
Eigen::Vector3d roll_pitch_yaw(const Eigen::Quaterniond& R, const Eigen::Vector3d& own) {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  // There only yaw - roll or their sum is defined to the last digit of pendants (0.0001 degrees): roll stays.
  constexpr double kGimbalLock = 5e-7;
  const Eigen::Matrix3d M = R.toRotationMatrix();
  const double side = std::cos(own[1]) < 0.0 ? -1.0 : 1.0;  // of the two solutions, that on the row's side
  const bool is_locked = std::hypot(M(2, 1), M(2, 2)) < kGimbalLock;
  const double roll = is_locked ? own[0] : std::atan2(side * M(2, 1), side * M(2, 2));
  const Eigen::Matrix3d rest = M * Eigen::AngleAxisd(-roll, Eigen::Vector3d::UnitX());  // Rz(yaw) Ry(pitch)
  Eigen::Vector3d result(roll, std::atan2(-rest(2, 0), rest(2, 2)), std::atan2(-rest(0, 1), rest(1, 1)));
  for (int i = 0; i < 3; ++i) {
    result[i] = own[i] + std::remainder(result[i] - own[i], kTurn);
  }
  return result;
}

}  // namespace

Row::Row(const Header& header, const Fields& fields, const Place& place, DecimalMark& decimals)
    : header_(header), fields_(fields), place_(place), decimals_(decimals) {
  if (fields.size() != header.fields) fail_ragged();
  for (std::size_t i = header.names.size(); i < fields.size(); ++i) {
    if (!trimmed(fields[i]).empty()) fail(place, "value " + shown(fields[i]) + " in a column without a name");
  }
}

bool Row::has(const Column& column) const { return present(column) && !trimmed(fields_[column.index]).empty(); }

double Row::number(const Column& column) const {
  const std::string_view text = trimmed(fields_[column.index]);
  double value = 0.0;
  std::errc error = parse_number(text, value);
  if (error != std::errc() && header_.separator != ',' && has_commas_of_numbers(text)) {
    error = parse_number(with_point(column, text), value);
    if (error == std::errc()) note_decimals(column, ',');
  } else if (decimals_.mark != '.' && error == std::errc() && text.find('.') != std::string_view::npos) {
    note_decimals(column, '.');
  }
  if (error != std::errc() || !(std::abs(value) <= kLargestNumber)) {
    fail_cell(column, number_fault(text, error, value, header_.separator));
  }
  return to_si(value, column.unit);
}

std::string Row::with_point(const Column& column, std::string_view text) const {
  const std::size_t comma = text.find(',');
  if (text.find('.') != std::string_view::npos || text.rfind(',') != comma) {
    fail_cell(column, "has more than a decimal comma: expected a number without separators of thousands");
  }
  std::string result(text);
  result[comma] = '.';
  return result;
}

void Row::note_decimals(const Column& column, char mark) const {
  if (decimals_.mark == '\0') decimals_ = {.mark = mark, .line = place_.line};
  if (decimals_.mark == mark) return;
  const auto name = [](char of) { return std::string(of == ',' ? "comma" : "point"); };
  fail_cell(column, fmt::format("has a decimal {}, but numbers have decimal {}s since line {}: expected one of them in "
                                "all numbers",
                                name(mark), name(decimals_.mark), decimals_.line));
}

Split Row::split() const {
  if (!has(header_.split)) return Split::train;
  const std::string text = lower_case(trimmed(fields_[header_.split.index]));
  if (text == "train") return Split::train;
  if (text == "test") return Split::test;
  fail_cell(header_.split, "is not a valid split: expected train or test");
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

Reading Row::reading() const {
  const bool with_points = present(header_.position[0]);
  const auto is_given = [&](const Column& column) { return has(column); };
  if (has(header_.distance)) return distance_from_anchor();
  if (has(header_.along) || std::any_of(header_.normal.begin(), header_.normal.end(), is_given) ||
      (present(header_.along) && !with_points)) {
    return coordinate_along();
  }
  if (!with_points) fail_cell(header_.distance, "is empty: expected a number");
  return coordinates_by_axis();
}

Reading Row::coordinates_by_axis() const {
  Eigen::Vector3d z = Eigen::Vector3d::Zero();
  Eigen::Vector3d is_measured = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < 3; ++i) {
    if (!has(header_.position[i])) continue;
    z[static_cast<Eigen::Index>(i)] = number(header_.position[i]);
    is_measured[static_cast<Eigen::Index>(i)] = 1.0;
  }
  switch (static_cast<int>(is_measured.sum())) {
    case 0:
      fail_cell(header_.position[0], "is empty: expected a number, or no row for what was not measured");
    case 1:
      return Coordinates{.position = z, .normal = is_measured, .count = 1};
    case 2:
      return Coordinates{.position = z, .normal = Eigen::Vector3d::Ones() - is_measured, .count = 2};
    default:
      return Point{z};
  }
}

Reading Row::coordinate_along() const {
  constexpr double kUnit = 1e-3;  // largest difference of the norm from 1
  for (const Column& column : header_.position) {
    if (has(column)) fail_cell(column, "stands beside a coordinate along n_x, n_y, n_z: expected one of the two");
  }
  const Eigen::Vector3d n(number(header_.normal[0]), number(header_.normal[1]), number(header_.normal[2]));
  if (!(std::abs(n.norm() - 1.0) <= kUnit)) {
    fail(place_, fmt::format("the norm of n_x, n_y, n_z is {:.4g}: expected a unit vector", n.norm()));
  }
  Eigen::Index largest = 0;
  n.cwiseAbs().maxCoeff(&largest);
  const Eigen::Vector3d unit = n.normalized();
  const Eigen::Vector3d position = number(header_.along) * unit;
  // One of the two opposite normals, so that equal directions are equal vectors.
  return Coordinates{.position = position, .normal = n[largest] < 0.0 ? Eigen::Vector3d(-unit) : unit, .count = 1};
}

Reading Row::distance_from_anchor() const {
  const double distance = number(header_.distance);
  if (!(distance > 0.0)) fail_cell(header_.distance, "is no distance: expected one above 0");
  for (const Column& column : {header_.along, header_.normal[0], header_.normal[1], header_.normal[2]}) {
    if (has(column)) fail_cell(column, "stands beside a distance: expected one of the two");
  }
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();
  const auto is_given = [&](const Column& column) { return has(column); };
  if (std::any_of(header_.position.begin(), header_.position.end(), is_given)) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      anchor[static_cast<Eigen::Index>(axis)] = number(header_.position[axis]);
    }
  }
  return Distance{.length = distance, .anchor = anchor};
}

std::optional<Eigen::Quaterniond> Row::orientation() const {
  const OrientationForm& form = kOrientationForms[header_.orientation];
  const auto& columns = header_.orientations[header_.orientation];
  const auto given = std::count_if(columns.begin(), columns.end(), [&](const Column& c) { return has(c); });
  if (given == 0) return std::nullopt;
  if (static_cast<std::size_t>(given) != form.count()) {
    fail(place_, "the " + std::string(form.what) + " has an empty cell: expected all of " + form.words() + " or none");
  }
  if (header_.orientation == kQuaternion) return quaternion();
  const Eigen::Vector3d v = angles();
  if (header_.reading == OrientationReading::rotation_vector) {
    return Eigen::Quaterniond(Eigen::AngleAxisd(v.norm(), v.stableNormalized())).normalized();
  }
  const Eigen::AngleAxisd about_z(v[z_first() ? 0 : 2], Eigen::Vector3d::UnitZ());
  const Eigen::AngleAxisd about_y(v[1], Eigen::Vector3d::UnitY());
  const Eigen::AngleAxisd about_x(v[z_first() ? 2 : 0], Eigen::Vector3d::UnitX());
  const bool x_moves_z = header_.reading == OrientationReading::moving_xyz;
  return (x_moves_z ? about_x * about_y * about_z : about_z * about_y * about_x).normalized();
}

Eigen::Vector3d Row::angles() const {
  const auto& columns = header_.orientations[header_.orientation];
  return {angle(columns[0]), angle(columns[1]), angle(columns[2])};
}

// A, B, C are about z, y, x as KUKA's. All other columns are about x, y, z.
bool Row::z_first() const { return header_.orientation == kKuka && header_.reading == OrientationReading::moving_zyx; }

Eigen::Vector4d Row::orientation_numbers(const Eigen::Quaterniond& R) const {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  if (header_.orientation == kQuaternion) {
    const double sign = R.dot(quaternion()) < 0.0 ? -1.0 : 1.0;
    return sign * Eigen::Vector4d(R.w(), R.x(), R.y(), R.z());
  }
  constexpr double kSame = 1e-14;
  const Eigen::Vector3d own = angles();
  Eigen::Vector4d result = Eigen::Vector4d::Zero();
  if (orientation()->angularDistance(R) < kSame) {
    result.head<3>() = own;
  } else if (header_.reading == OrientationReading::rotation_vector) {
    const Eigen::AngleAxisd turn(R);
    const double angle = own.dot(turn.axis());
    result.head<3>() = (angle + std::remainder(turn.angle() - angle, kTurn)) * turn.axis();
  } else if (header_.reading == OrientationReading::moving_xyz) {
    // The inverse of Rx(a) Ry(b) Rz(c) is Rz(-c) Ry(-b) Rx(-a).
    result.head<3>() = -roll_pitch_yaw(R.conjugate(), -own);
  } else {
    const Eigen::Vector3d angles = roll_pitch_yaw(R, z_first() ? Eigen::Vector3d(own.reverse()) : own);
    result.head<3>() = z_first() ? Eigen::Vector3d(angles.reverse()) : angles;
  }
  return result;
}

double Row::angle(const Column& column) const {
  constexpr double kTurn = 2.0 * std::numbers::pi + 1e-3;  // with tolerance for few digits
  const double value = number(column);
  if (column.unit == Unit::none && std::abs(value) > kTurn) {
    const std::string& name = header_.names[column.index];
    fail_cell(column, "without a unit is no angle in radians: degrees? write " + name + "[deg] (or [rad])");
  }
  return value;
}

Eigen::Quaterniond Row::quaternion() const {
  const auto& columns = header_.orientations[kQuaternion];
  const Eigen::Quaterniond q(number(columns[0]), number(columns[1]), number(columns[2]), number(columns[3]));
  const double norm = q.norm();
  if (!(std::abs(norm - 1.0) <= kQuaternionTolerance)) {
    fail(place_, "the norm of the quaternion (qw " + shown(text(columns[0])) + ", ...) is " + shortest(norm) +
                     ": expected 1 within 0.001");
  }
  // Quaternions normalised to rounding are not changed, so that a written file reads back to the same bits.
  constexpr double kRounding = 8 * std::numeric_limits<double>::epsilon();
  return std::abs(norm - 1.0) <= kRounding ? q : Eigen::Quaterniond(q.coeffs() / norm);
}

void Row::fail_cell(const Column& column, const std::string& what) const {
  fail(place_, header_.names[column.index] + " " + shown(fields_[column.index]) + " " + what);
}
void Row::fail_row(const std::string& what) const { fail(place_, what); }

void Row::fail_ragged() const {
  const bool more_commas = header_.separator == ',' && fields_.size() > header_.fields;
  fail(place_,
       fmt::format(
           "{} fields, expected {} as in the header in line {}{}", fields_.size(), header_.fields, header_.line,
           more_commas ? " (decimal commas are not read between commas: separate the columns by semicolons)" : ""));
}

}  // namespace kdl_calibration
