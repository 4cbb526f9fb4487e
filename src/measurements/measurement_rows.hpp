#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/csv.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"
#include "measurements/measurement_columns.hpp"
#include "measurements/measurement_row.hpp"

namespace kdl_calibration {

/// Expected kind of the file.
struct FileKind {
  bool kinds_known = true;  ///< whether the joint types are known
  FileContent content = FileContent::measurements;
  OrientationReading orientation = OrientationReading::usual;
  std::vector<std::string> links = {};  ///< of the chain, base to tip, that may have a temperature; empty: any names
};

/// The header of a measurements file, then its rows one after the other. Keeps references.
class MeasurementRows {
public:
  MeasurementRows(LineReader& lines, const std::vector<MovingJoint>& chain, const JointConvention* convention,
                  const FileKind& kind);
  MeasurementRows(const MeasurementRows&) = delete;
  MeasurementRows& operator=(const MeasurementRows&) = delete;

  /// Moves to the next row; false at the end.
  bool next();
  /// The same without splitting it into fields.
  bool next_line();
  Row row() { return {header_, fields_, lines_.place(), decimals_}; }
  const Fields& fields() const { return fields_; }
  std::string_view line() const { return line_; }

  const ExpectedJoints& joints() const { return joints_; }
  const Header& header() const { return header_; }
  /// The header's line, and that of the units if there is one.
  const std::vector<std::string>& head() const { return head_; }
  const DecimalMark& decimals() const { return decimals_; }

private:
  LineReader& lines_;
  std::vector<std::string> urdf_joints_;
  std::optional<JointConvention> matched_;
  ExpectedJoints joints_;
  std::vector<std::string> head_;
  Header header_;
  DecimalMark decimals_;
  std::string_view line_;
  Fields fields_;
  bool has_first_ = false;  // the first row is read but was not asked for
};

}  // namespace kdl_calibration
