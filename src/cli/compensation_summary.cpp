#include "cli/compensation_summary.hpp"

#include <fmt/core.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "base/csv.hpp"
#include "base/degree.hpp"
#include "base/number_text.hpp"
#include "base/text.hpp"
#include "cli/frames.hpp"
#include "cli/options.hpp"
#include "cli/report_pages.hpp"
#include "cli/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "results/report_page.hpp"
#include "results/result_blocks.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration::cli {
namespace {

using Eigen::Index;

constexpr std::array kStatuses = {CompensationStatus::exact, CompensationStatus::position_only,
                                  CompensationStatus::unreachable, CompensationStatus::out_of_limits,
                                  CompensationStatus::branch_changed};
constexpr double kUndetermined = 0.05e-3;  // [m] motion by undetermined parameters, for 1 mm or 1 mrad of each

bool lies_in(const JointRanges& ranges, const CompensatedJoints& q) {
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const double value = q[static_cast<Index>(i)];
    if (value < ranges[i].first || value > ranges[i].second) {
      return false;
    }
  }
  return true;
}

std::string off(double position, double orientation) {
  return fixed(position * 1e3, 4) + " mm and " + fixed(orientation * 1e3, 4) + " mrad";
}

}  // namespace

std::string prediction_row(const CalibratedArm& arm, const std::string& label, const CompensatedPoint& point) {
  double variance = 0.0;
  double radius = 0.0;
  bool outside = false;
  for (const std::string& target : arm.targets()) {
    const PredictedPoint predicted = arm.predict(point.joint_values, target);
    variance = std::max(variance, predicted.covariance.trace());
    radius = std::max(radius, predicted.radius_95);
    outside = outside || predicted.outside;
  }
  std::string row = csv_field(label) + "," + to_string(point.status);
  for (const double value : {point.position_error, point.orientation_error, std::sqrt(variance), radius}) {
    row += "," + shortest(value);
  }
  return row + (outside ? ",true\n" : ",false\n");
}

CompensationSummary::CompensationSummary(const Robot& robot, const CalibratedArm& arm,
                                         const std::optional<JointConvention>& convention)
    : arm_(arm) {
  const std::optional<JointConvention> fitting = fitting_convention(convention, robot);
  const std::vector<std::size_t> independent = independent_joints(robot.joints);
  const auto count = static_cast<Index>(independent.size());
  const Eigen::MatrixXd inverse =
      fitting ? Eigen::MatrixXd(fitting->matrix.inverse()) : Eigen::MatrixXd::Identity(count, count);
  for (std::size_t i = 0; i < independent.size(); ++i) {
    const auto row = static_cast<Index>(i);
    Listed& joint = joints_.emplace_back();
    joint.name = fitting ? fitting->controller_joints[i] : robot.joints[independent[i]].name;
    joint.slides = value_is_length(robot, fitting ? &*fitting : nullptr, row);
    joint.weights = Eigen::RowVectorXd::Zero(static_cast<Index>(robot.joints.size()));
    for (std::size_t j = 0; j < independent.size(); ++j) {
      joint.weights[static_cast<Index>(independent[j])] = inverse(row, static_cast<Index>(j));
    }
  }
}

// Where they become too many, every second one goes.
void CompensationSummary::add_sample(const Sample& sample) {
  if ((sample.ordinal - 1) % spacing_ != 0) {
    return;
  }
  samples_.push_back(sample);
  if (samples_.size() > kMostPointsOfPage) {
    spacing_ *= 2;
    std::erase_if(samples_, [&](const Sample& kept) { return (kept.ordinal - 1) % spacing_ != 0; });
  }
}

void CompensationSummary::add(std::span<const CompensatedPoint> points, std::span<const double> corrections,
                              const PointLabel& label) {
  constexpr std::size_t kMostListed = 1000;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const CompensatedPoint& point = points[i];
    ++points_;
    ++count_[static_cast<std::size_t>(point.status)];
    add_sample({.ordinal = points_, .status = point.status, .correction = corrections[i]});
    for (Listed& joint : joints_) {
      joint.change = std::max(joint.change, std::abs(joint.weights.dot(point.change)));
    }
    correction_ = std::max(correction_, corrections[i]);
    position_error_ = std::max(position_error_, point.position_error);
    orientation_error_ = std::max(orientation_error_, point.orientation_error);
    if (point.status != CompensationStatus::exact && inexact_.size() < kMostListed) {
      inexact_.push_back({.label = label(i),
                          .status = point.status,
                          .position_error = point.position_error,
                          .orientation_error = point.orientation_error});
    }
    if (!lies_in(arm_.measured_ranges(), point.joint_values) && ++outside_ == 1) {
      first_outside_ = label(i);
    }
    if (const double motion = arm_.undetermined_motion(point.joint_values); motion > kUndetermined) {
      throw InputError(
          "configuration " + shown(label(i)) +
          ": the pose is not known, as 1 mm or 1 mrad of parameters that the measurements do not determine "
          "moves it by " +
          fixed(motion * 1e3, 2) +
          " mm, expected points in the measured region, or more measurements (kdlcal plan --measured)");
    }
  }
}

void CompensationSummary::add_lines(std::span<const LineDeviation> deviations, double tolerance,
                                    const PointLabel& label) {
  tolerance_ = tolerance;
  for (std::size_t i = 0; i < deviations.size(); ++i) {
    bent_lines_ += deviations[i].position > tolerance ? 1U : 0U;
    if (deviations[i].position > deviation_.position) {
      most_bent_ = label(i);
    }
    deviation_.include(deviations[i]);
  }
}

std::vector<std::string> CompensationSummary::warnings() const {
  std::vector<std::string> result;
  if (outside_ > 0) {
    result.push_back(
        fmt::format("{} of {} points are outside the joint values that were measured, first configuration {}: the "
                    "calibration may be wrong there",
                    outside_, points_, shown(first_outside_)));
  }
  if (bent_lines_ > 0) {
    result.push_back(fmt::format(
        "{} of {} straight lines are off by more than {} mm, that to configuration {} {}: add points between",
        bent_lines_, points_ - 1, shortest(*tolerance_ * 1e3), shown(most_bent_),
        std::isfinite(deviation_.position) ? "by " + fixed(deviation_.position * 1e3, 3) + " mm"
                                           : "cannot be followed"));
  }
  return result;
}

Json CompensationSummary::json() const {
  Json statuses = Json::object();
  for (const CompensationStatus status : kStatuses) {
    statuses[to_string(status)] = count_[static_cast<std::size_t>(status)];
  }
  Json joints = Json::array();
  for (const Listed& joint : joints_) {
    joints.push_back({{"joint", joint.name}, {"change", joint.change}, {"unit", joint.slides ? "m" : "rad"}});
  }
  Json inexact = Json::array();
  for (const Inexact& point : inexact_) {
    inexact.push_back({{"configuration", point.label},
                       {"status", to_string(point.status)},
                       {"position_error", point.position_error},
                       {"orientation_error", point.orientation_error}});
  }
  Json json = {{"points", points_},
               {"status", statuses},
               {"largest_change", joints},
               {"largest_correction", correction_},
               {"largest_position_error", position_error_},
               {"largest_orientation_error", orientation_error_},
               {"outside", outside_},
               {"not_exact", inexact}};
  if (tolerance_) {
    json["lines"] = {{"largest_deviation", finite_or_null(deviation_.position)},
                     {"largest_orientation_deviation", finite_or_null(deviation_.orientation)},
                     {"to", most_bent_},
                     {"tolerance", *tolerance_},
                     {"above_limit", bent_lines_}};
  }
  return json;
}

Json CompensationSummary::samples() const {
  Json list = Json::array();
  for (const Sample& sample : samples_) {
    list.push_back(
        {{"ordinal", sample.ordinal}, {"status", to_string(sample.status)}, {"correction", sample.correction}});
  }
  return list;
}

std::string CompensationSummary::page(const Json& json, const std::vector<std::string>& warnings) const {
  return page_of_result("compensation", json, {{"points", samples()}, {"warnings", warnings}});
}

std::string CompensationSummary::table() const {
  constexpr std::size_t kWidth = 24;
  constexpr std::size_t kMostLines = 10;
  std::string text = padded("status", kWidth) + "  points\n";
  for (const CompensationStatus status : kStatuses) {
    text += padded(to_string(status), kWidth) + fmt::format("{:>8}\n", count_[static_cast<std::size_t>(status)]);
  }
  text += padded("joint", kWidth) + "  largest change\n";
  for (const Listed& joint : joints_) {
    text += padded(joint.name, kWidth) +
            fmt::format("{:>12} {}\n", fixed(joint.slides ? joint.change * 1e3 : joint.change / kDegree, 4),
                        joint.slides ? "mm" : "deg");
  }
  text += "correction of the flange: at most " + fixed(correction_ * 1e3, 3) + " mm\n";
  text += "remaining error of the flange: at most " + off(position_error_, orientation_error_) + "\n";
  for (std::size_t i = 0; i < std::min(inexact_.size(), kMostLines); ++i) {
    const Inexact& point = inexact_[i];
    text += "configuration " + shown(point.label) + ": " + to_string(point.status) + ", off by " +
            off(point.position_error, point.orientation_error) + "\n";
  }
  if (inexact_.size() > kMostLines) {
    text += "further ones: --json lists the first 1000\n";
  }
  return text;
}

}  // namespace kdl_calibration::cli
