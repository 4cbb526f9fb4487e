#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cli/frames.hpp"
#include "interface/compensated_line.hpp"
#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/robot.hpp"

namespace kdl_calibration::cli {

/// The name of a point for people, by its place among those that are added.
using PointLabel = std::function<std::string(std::size_t)>;

/// Rows of --predict: how well points are known.
inline constexpr std::string_view kPredictionHeader =
    "configuration,status,position_error[m],orientation_error[rad],sigma[m],radius_95[m],outside\n";

/// The row of a point, for its least certain target.
std::string prediction_row(const CalibratedArm& arm, const std::string& label, const CompensatedPoint& point);

/// What became of the points of a program. Keeps references. Its memory does not grow with their number.
class CompensationSummary {
public:
  /// `convention`: of the joints whose largest changes are listed; none, or one of other joints: those of the URDF.
  CompensationSummary(const Robot& robot, const CalibratedArm& arm, const std::optional<JointConvention>& convention);

  /// The next points, and how far [m] each commanded flange is from the asked one. Throws InputError for a point whose
  /// pose depends on parameters that were not determined.
  void add(std::span<const CompensatedPoint> points, std::span<const double> corrections, const PointLabel& label);
  /// How far the tool leaves the straight line to each of these points; `tolerance` [m] for warnings.
  void add_lines(std::span<const LineDeviation> deviations, double tolerance, const PointLabel& label);

  std::size_t points() const { return points_; }
  bool is_exact() const { return count_[0] == points_; }
  std::vector<std::string> warnings() const;
  Json json() const;
  std::string table() const;
  /// The page of `json` with the files of the run.
  std::string page(const Json& json, const std::vector<std::string>& warnings) const;

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
  // Evenly spaced points for the page, with ordinal, status and correction.
  Json samples() const;

  // A joint as it is listed: its changes are `weights` of those of the URDF's joints.
  struct Listed {
    std::string name;
    bool slides = false;
    Eigen::RowVectorXd weights;
    double change = 0.0;  // largest one
  };

  CalibratedArm arm_;
  std::vector<Listed> joints_;
  std::size_t points_ = 0;
  std::array<std::size_t, 5> count_{};  // of each status
  double correction_ = 0.0;
  double position_error_ = 0.0;
  double orientation_error_ = 0.0;
  std::vector<Inexact> inexact_;  // the first ones
  std::vector<Sample> samples_;
  std::size_t spacing_ = 1;  // of the samples
  std::size_t outside_ = 0;
  std::string first_outside_;
  std::optional<double> tolerance_;  // of lines
  std::size_t bent_lines_ = 0;
  LineDeviation deviation_;
  std::string most_bent_;  // where the line ends
};

}  // namespace kdl_calibration::cli
