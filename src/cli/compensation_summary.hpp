#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "cli/frames.hpp"
#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/robot.hpp"
#include "measurements/program_file.hpp"

namespace kdl_calibration::cli {

/// What became of the points of a program. Keeps references. Its memory does not grow with their number.
class CompensationSummary {
public:
  CompensationSummary(const Robot& robot, const CalibratedArm& arm, const ProgramFile& program);

  /// The next rows, and how far [m] each commanded flange is from the asked one. Throws InputError for a point whose
  /// pose depends on parameters that were not determined.
  void add(std::span<const ProgramLine> lines, std::span<const CompensatedPoint> points,
           std::span<const double> corrections);
  /// How far [m] the straight line to each of these rows is from the asked one.
  void add_lines(std::span<const ProgramLine> lines, std::span<const double> deviations);

  std::size_t points() const { return points_; }
  bool is_exact() const { return count_[0] == points_; }
  std::vector<std::string> warnings() const;
  Json json() const;
  /// Evenly spaced points for the page, with ordinal, status and correction.
  Json samples() const;
  std::string table() const;

  /// Of the row that is the `ordinal`th.
  std::string label(const ProgramLine& line, std::size_t ordinal) const;

private:
  struct Inexact {
    std::string label;
    CompensationStatus status;
    double position_error;
    double orientation_error;
  };

  struct Sample {
    std::size_t ordinal;
    CompensationStatus status;
    double correction;
  };

  void add_sample(const Sample& sample);

  const Robot& robot_;
  CalibratedArm arm_;
  const ProgramFile& program_;
  std::size_t points_ = 0;
  std::array<std::size_t, 5> count_{};  // of each status
  Eigen::VectorXd changes_;             // largest one of each joint
  double correction_ = 0.0;
  double position_error_ = 0.0;
  double orientation_error_ = 0.0;
  std::vector<Inexact> inexact_;  // the first ones
  std::vector<Sample> samples_;
  std::size_t spacing_ = 1;  // of the samples
  std::size_t outside_ = 0;
  std::string first_outside_;
  bool with_lines_ = false;
  std::size_t bent_lines_ = 0;
  double deviation_ = 0.0;
  std::string most_bent_;  // where the line ends
};

}  // namespace kdl_calibration::cli
