#include "planning/workspace.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>

#include "base/parallel.hpp"
#include "base/preconditions.hpp"
#include "base/random.hpp"
#include "kdl_calibration/input_error.hpp"
#include "planning/cell_constraints.hpp"
#include "robot/joint_ranges.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Isometry3d;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr std::size_t kSampleBlock = 4096;  // samples per block, after which the passed ones are counted
constexpr long kTracedSamples = 2000;       // from which the causes of refusals are told

VectorXd sample(const Robot& robot, const JointRanges& ranges, const CandidateOptions& options, std::uint64_t stream) {
  Random random(options.seed, stream);
  VectorXd q(static_cast<Eigen::Index>(ranges.size()));
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const auto [lower, upper] = ranges[i];
    double value = random.uniform(lower, upper);
    const double step = robot.joints[i].type == JointType::prismatic ? options.length_step : options.angle_step;
    if (step > 0.0) {
      value = std::clamp(std::round(value / step) * step, lower, upper);
    }
    q[static_cast<Eigen::Index>(i)] = value;
  }
  follow(robot.joints, q);
  return q;
}

void count_refusals(std::uint64_t bits, std::vector<Refusals>& refusals) {
  for (std::size_t k = 0; k < refusals.size(); ++k) {
    if ((bits >> k & 1U) != 0) {
      ++refusals[k].samples;
      refusals[k].alone += bits == std::uint64_t{1} << k ? 1 : 0;
    }
  }
}

// The pair of links that is the closest in most of these samples, which the clearance rejects.
class ClosestLinks {
public:
  void add(const CellConstraints& constraints, std::uint64_t bits, const VectorXd& q) {
    if (constraints.clearance() && (bits >> *constraints.clearance() & 1U) != 0) {
      ++counts_[constraints.closest_links(q)];
    }
  }
  std::string most_frequent() const {
    const auto most = std::max_element(counts_.begin(), counts_.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    return most == counts_.end() ? std::string() : most->first;
  }

private:
  std::map<std::string, long> counts_;
};

// A joint's range in twenty parts of equal length, and which of them candidates use.
class RangeParts {
public:
  RangeParts(const std::pair<double, double>& range, const VectorXd& values)
      : lower_(range.first), width_((range.second - range.first) / kParts) {
    constexpr double kHardlyAny = 0.1;  // of what a part would hold if the candidates were spread evenly
    std::array<double, kParts> counts{};
    for (const double value : values) {
      counts.at(part_of(value)) += 1.0;
    }
    for (std::size_t part = 0; part < kParts; ++part) {
      used_.at(part) = !(width_ > 0.0) || counts.at(part) * kParts >= kHardlyAny * static_cast<double>(values.size());
    }
  }

  double share() const { return static_cast<double>(std::count(used_.begin(), used_.end(), true)) / kParts; }
  bool are_used_at(double value) const { return used_.at(part_of(value)); }

  std::vector<std::pair<double, double>> left_out() const {
    std::vector<std::pair<double, double>> result;
    for (std::size_t part = 0; part < kParts; ++part) {
      const double start = lower_ + width_ * static_cast<double>(part);
      if (used_.at(part)) {
        continue;
      }
      if (part > 0 && !used_.at(part - 1)) {
        result.back().second = start + width_;
      } else {
        result.emplace_back(start, start + width_);
      }
    }
    return result;
  }

private:
  static constexpr std::size_t kParts = 20;

  std::size_t part_of(double value) const {
    const double part = width_ > 0.0 ? (value - lower_) / width_ : 0.0;
    return static_cast<std::size_t>(std::clamp(part, 0.0, static_cast<double>(kParts - 1)));
  }

  double lower_;
  double width_;
  std::array<bool, kParts> used_{};
};

[[noreturn]] void fail_for_too_few(const Candidates& found, std::size_t passed, int wanted) {
  std::string message =
      fmt::format("the constraints leave {} of {} sampled configurations, expected {}", passed, found.samples, wanted);
  for (std::size_t k = 0; k < found.refusals.size(); ++k) {
    const Refusals& refusals = found.refusals[k];
    message += fmt::format("{}{} removes {} ({} alone{})", k == 0 ? "; " : ", ", refusals.constraint, refusals.samples,
                           refusals.alone, refusals.links.empty() ? "" : "; mostly between " + refusals.links);
  }
  throw InputError(message);
}

}  // namespace

Candidates candidates(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell,
                      const CandidateOptions& options) {
  require_at_least("candidates", options.count, 0);
  const CellConstraints constraints(robot, targets, cell);
  Candidates found;
  for (const std::string& name : constraints.names()) {
    found.refusals.push_back({.constraint = name});
  }
  const long most = options.most_samples > 0 ? options.most_samples : 100'000 + 200L * options.count;
  found.joint_values.resize(static_cast<Eigen::Index>(cell.ranges.size()), options.count);
  std::vector<std::uint64_t> bits(kSampleBlock);
  Eigen::Index passed = 0;
  while (passed < options.count && found.samples < most) {
    const auto block = std::min(kSampleBlock, static_cast<std::size_t>(most - found.samples));
    const auto start = static_cast<std::uint64_t>(found.samples);
    parallel_blocks(block, 256, options.threads, [&](std::size_t first, std::size_t end) {
      for (std::size_t k = first; k < end; ++k) {
        bits[k] = constraints.violations(sample(robot, cell.ranges, options, start + k));
      }
    });
    for (std::size_t k = 0; k < block && passed < options.count; ++k) {
      ++found.samples;
      count_refusals(bits[k], found.refusals);
      if (bits[k] == 0) {
        found.joint_values.col(passed++) = sample(robot, cell.ranges, options, start + k);
      }
    }
  }
  if (constraints.clearance()) {
    ClosestLinks links;
    for (long k = 0; k < std::min(found.samples, kTracedSamples); ++k) {
      const VectorXd q = sample(robot, cell.ranges, options, static_cast<std::uint64_t>(k));
      links.add(constraints, constraints.violations(q), q);
    }
    found.refusals[*constraints.clearance()].links = links.most_frequent();
  }
  if (passed < options.count) {
    fail_for_too_few(found, static_cast<std::size_t>(passed), options.count);
  }
  return found;
}

std::vector<NarrowedRange> narrowed_ranges(const Robot& robot, const std::vector<TargetFrame>& targets,
                                           const Cell& cell, const Candidates& drawn, std::uint64_t seed) {
  const CellConstraints constraints(robot, targets, cell);
  std::vector<NarrowedRange> narrowed;
  for (const std::size_t joint : independent_joints(robot.joints)) {
    const RangeParts parts(cell.ranges[joint], drawn.joint_values.row(static_cast<Eigen::Index>(joint)));
    if (parts.share() >= 0.5 || constraints.names().empty()) {
      continue;
    }
    std::vector<Refusals> refusals(constraints.names().size());
    ClosestLinks links;
    for (long k = 0; k < kTracedSamples; ++k) {
      const VectorXd q = sample(robot, cell.ranges, {.seed = seed}, static_cast<std::uint64_t>(k));
      if (!parts.are_used_at(q[static_cast<Eigen::Index>(joint)])) {
        const std::uint64_t bits = constraints.violations(q);
        count_refusals(bits, refusals);
        links.add(constraints, bits, q);
      }
    }
    const auto most = std::max_element(refusals.begin(), refusals.end(),
                                       [](const Refusals& a, const Refusals& b) { return a.samples < b.samples; });
    const auto place = static_cast<std::size_t>(most - refusals.begin());
    most->constraint = constraints.names()[place];
    most->links = place == constraints.clearance() ? links.most_frequent() : "";
    narrowed.push_back({.joint = joint, .share = parts.share(), .left_out = parts.left_out(), .cause = *most});
  }
  return narrowed;
}

std::vector<std::string> violated(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell,
                                  const VectorXd& q) {
  const CellConstraints constraints(robot, targets, cell);
  const std::uint64_t bits = constraints.violations(q);
  std::vector<std::string> names;
  for (std::size_t k = 0; k < constraints.names().size(); ++k) {
    if ((bits >> k & 1U) != 0) {
      names.push_back(constraints.names()[k]);
    }
  }
  return names;
}

}  // namespace kdl_calibration
