#pragma once

// Not installed.

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "base/csv.hpp"
#include "kdl_calibration/measurements.hpp"
#include "measurements/measurement_columns.hpp"

namespace kdl_calibration {

/// Whether the numbers of a file have decimal points or commas. Known from the first cell that has one of them.
struct DecimalMark {
  char mark = '\0';      ///< '\0' until then
  std::size_t line = 0;  ///< of that cell
};

/// One row of a measurements file, read cell by cell. Keeps references. What a cell cannot be throws InputError with
/// its place.
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
  double sigma() const;  ///< [m]; 0 where none is stated
  /// All NaN where the row measures a point alone.
  Eigen::Quaterniond orientation() const;

  [[noreturn]] void fail_cell(const Column& column, const std::string& what) const;
  [[noreturn]] void fail_row(const std::string& what) const;

private:
  [[noreturn]] void fail_ragged() const;
  std::string with_point(const Column& column, std::string_view text) const;
  void note_decimals(const Column& column, char mark) const;
  Eigen::Quaterniond quaternion() const;
  double angle(const Column& column) const;

  const Header& header_;
  const Fields& fields_;
  Place place_;
  DecimalMark& decimals_;
};

}  // namespace kdl_calibration
