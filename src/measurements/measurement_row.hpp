#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/csv.hpp"
#include "kdl_calibration/measurements.hpp"
#include "measurements/measurement_columns.hpp"

namespace kdl_calibration {

/// Decimal mark of a file, point or comma, taken from the first cell with one of them.
struct DecimalMark {
  char mark = '\0';      ///< '\0' until known
  std::size_t line = 0;  ///< line of that cell
};

/// One row of a measurements file, read cell by cell. Keeps references. Invalid cells throw InputError with their
/// place.
class Row {
public:
  Row(const Header& header, const Fields& fields, const Place& place, DecimalMark& decimals);

  bool has(const Column& column) const;
  std::string_view text(const Column& column) const { return fields_[column.index]; }
  /// In SI units.
  double number(const Column& column) const;
  Split split() const;
  std::int32_t repeat() const;
  std::int64_t order() const;
  double sigma() const;  ///< [m]; 0 if none is stated
  /// The row's reading.
  Reading reading() const;
  std::optional<Eigen::Quaterniond> orientation() const;
  /// The numbers [SI] that state the orientation `R` in the file's form, of several ways those nearest to the row's.
  Eigen::Vector4d orientation_numbers(const Eigen::Quaterniond& R) const;

  [[noreturn]] void fail_cell(const Column& column, const std::string& what) const;
  [[noreturn]] void fail_row(const std::string& what) const;

private:
  [[noreturn]] void fail_ragged() const;
  std::string with_point(const Column& column, std::string_view text) const;
  void note_decimals(const Column& column, char mark) const;
  Reading coordinates_by_axis() const;
  Reading coordinate_along() const;
  Reading distance_from_anchor() const;
  Eigen::Quaterniond quaternion() const;
  double angle(const Column& column) const;
  Eigen::Vector3d angles() const;
  bool z_first() const;

  const Header& header_;
  const Fields& fields_;
  Place place_;
  DecimalMark& decimals_;
};

}  // namespace kdl_calibration
