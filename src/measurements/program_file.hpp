#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "base/csv.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"
#include "measurements/measurement_rows.hpp"
#include "measurements/stated_joints.hpp"

namespace kdl_calibration {

/// A row of a program.
struct ProgramLine {
  std::string text;
  std::size_t number = 0;  ///< in the file
};

/// What rows of a program state.
struct ProgramPoints {
  Eigen::MatrixXd joint_values;          ///< all joints x N, in the URDF's convention; empty if not stated
  std::vector<Eigen::Isometry3d> poses;  ///< empty for a program of joint values
};

/// The points of a program (CSV), read in pieces, and written again with other values. Each row is a point. The const
/// functions may be called from several threads. All throw InputError as read_measurements does.
class ProgramFile {
public:
  /// `content`: configurations or poses. Keeps references to robot and convention.
  ProgramFile(const std::filesystem::path& file, const Robot& robot, const JointConvention* convention,
              FileContent content, OrientationReading orientation = OrientationReading::usual);

  bool states_joints() const { return !joints_.empty(); }
  /// See orientation_note.
  std::string orientations() const { return orientation_note(rows_.header()); }
  /// The next rows, at most so many; none at the end.
  std::vector<ProgramLine> next(std::size_t most);
  /// The share of the file that was read, roughly.
  double share() const;

  ProgramPoints points(std::span<const ProgramLine> lines) const;
  /// The row's label; empty without a column `configuration`.
  std::string label(const ProgramLine& line) const;

  /// The header, with the row of units if there is one.
  std::string head() const;
  /// The rows with these values at full precision. Columns, units, separator, decimal mark and all other cells stay.
  std::string text(std::span<const ProgramLine> lines, const ProgramPoints& commanded) const;

private:
  void for_each_row(std::span<const ProgramLine> lines,
                    const std::function<void(const Row&, const Fields&, Eigen::Index)>& work) const;
  StatedJoints stated(std::span<const ProgramLine> lines) const;

  LineReader lines_;
  MeasurementRows rows_;
  std::vector<Column> joints_;          // empty if the file states none
  std::vector<Column> columns_;         // those; then, of poses, coordinates and orientation
  std::vector<std::size_t> column_at_;  // of each field, index into columns_ or their number
  DecimalMark decimals_;
  std::size_t read_ = 0;  // [bytes]
};

}  // namespace kdl_calibration
