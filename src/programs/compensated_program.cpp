#include "programs/compensated_program.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <map>
#include <set>
#include <utility>

#include "base/parallel.hpp"
#include "programs/add_remark.hpp"
#include "programs/left_points.hpp"
#include "programs/number_fields.hpp"

namespace kdl_calibration {
namespace {

// Texts of ABB and KUKA state zeros for axes that there are not.
void leave_out_resting_axes(Program& program, const Controller& controller) {
  std::set<int> moving;
  for (const ProgramPoint& point : program.points) {
    for (const ExternalValue& external : point.external) {
      if (external.value != 0.0 || controller.external_axes.contains(external.axis)) {
        moving.insert(external.axis);
      }
    }
  }
  for (ProgramPoint& point : program.points) {
    std::erase_if(point.external, [&](const ExternalValue& external) { return !moving.contains(external.axis); });
  }
}

// Frames of --frames that do not stand still.
void leave_out_moving_frames(Program& program, const ProgramFrames& frames) {
  const auto is_moving = [](const auto& name, const auto& own, const std::set<std::string>& moving) {
    return name && !own.contains(*name) && moving.contains(*name);
  };
  leave_out_points(
      program,
      "a point is relative to a tool that stands in the cell, or to a frame that the robot or another unit "
      "moves (--frames): left as it is",
      [&](const ProgramPoint& point) {
        return point.notation != PointNotation::joints &&
               (is_moving(point.user_frame, program.frames.user, frames.moving_user) ||
                is_moving(point.tool_frame, program.frames.tool, frames.standing_tools));
      });
}

// The points whose joint values do not depend on other points.
void compensate_alone(const PointCompensation& compensation, Program& program,
                      std::vector<CompensatedPosition>& positions) {
  constexpr std::size_t kBlock = 64;
  parallel_blocks(positions.size(), kBlock, 0, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (!PointCompensation::follows_previous(program.points[i])) {
        positions[i] = compensation.compensate(program.points[i]);
      }
    }
  });
}

// Those that depend on where the arm comes from, in the order of the motions.
class InOrder {
public:
  InOrder(const PointCompensation& compensation, Program& program, std::vector<CompensatedPosition>& positions,
          const CompensatedJoints& near)
      : compensation_(compensation), program_(program), positions_(positions), approach_{.previous = near} {}

  void compensate() {
    for (const ProgramMotion& motion : program_.motions) {
      approach_.is_straight = motion.is_straight && is_known_;
      if (motion.point && !visit(*motion.point)) {
        other_ways_.push_back(motion.line);
      }
      is_known_ = motion.point.has_value();
    }
    approach_.is_straight = false;
    for (std::size_t i = 0; i < positions_.size(); ++i) {
      if (PointCompensation::follows_previous(program_.points[i]) && !originals_.contains(i)) {
        visit(i);
      }
    }
    add_remark(program_.remarks,
               "reaches a pose with other joint values than a motion before: its command is right for the first ones, "
               "expected a pose of its own",
               std::move(other_ways_));
  }

private:
  // False for a point that was visited before with other joint values.
  bool visit(std::size_t i) {
    constexpr double kSame = 1e-3;  // [rad]
    ProgramPoint& point = program_.points[i];
    if (!PointCompensation::follows_previous(point)) {
      approach_.previous = positions_[i].asked();
      return true;
    }
    const auto [original, is_new] = originals_.try_emplace(i, point);
    if (is_new) {
      positions_[i] = compensation_.compensate(point, approach_);
      approach_.previous = positions_[i].asked();
      return true;
    }
    ProgramPoint again = original->second;
    approach_.previous = compensation_.compensate(again, approach_).asked();
    return (approach_.previous - positions_[i].asked()).norm() < kSame;
  }

  const PointCompensation& compensation_;
  Program& program_;
  std::vector<CompensatedPosition>& positions_;
  Approach approach_;
  bool is_known_ = false;                          // where the motion begins
  std::map<std::size_t, ProgramPoint> originals_;  // of those that were visited
  std::vector<std::size_t> other_ways_;            // lines
};

// A motion along a path, from point to point.
struct Segment {
  const ProgramMotion* motion;
  std::size_t from;
  std::size_t to;
};

std::vector<Segment> segments_of(const Program& program) {
  std::vector<Segment> segments;
  std::optional<std::size_t> last;
  for (const ProgramMotion& motion : program.motions) {
    const std::optional<std::size_t> next = motion.is_known ? motion.point : std::nullopt;
    if (motion.is_straight && last && next) {
      segments.push_back({.motion = &motion, .from = *last, .to = *next});
    }
    last = next;
  }
  return segments;
}

// On a straight line no controller changes the branch: some then ignore what a point states.
void remark_other_branches(const PointCompensation& compensation, const std::vector<CompensatedPosition>& positions,
                           Program& program) {
  std::map<std::size_t, std::vector<std::size_t>> lines;  // of each file
  for (const Segment& segment : segments_of(program)) {
    if (!compensation.share_branch(positions[segment.from], positions[segment.to])) {
      lines[segment.motion->file].push_back(segment.motion->line);
    }
  }
  for (auto& [file, of_file] : lines) {
    add_remark(program.remarks,
               "a motion along a path ends in another configuration (shoulder, elbow, wrist) than that of the point "
               "above: its command is right for the one that is stated",
               std::move(of_file), file);
  }
}

// Where the controller may choose another way to a pose than the one that is compensated.
void remark_close_choices(const PointCompensation& compensation, const std::vector<CompensatedPosition>& positions,
                          Program& program) {
  constexpr double kTold = 1e-4;  // [m]
  struct Choices {
    double most = 0.0;
    std::vector<std::size_t> close;  // lines
    std::vector<std::size_t> unknown;
  };
  std::map<std::size_t, Choices> of_file;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const ProgramPoint& point = program.points[i];
    Choices& choices = of_file[point.file];
    if (const double other = positions[i].other_way; other > kTold) {
      choices.most = std::max(choices.most, other);
      choices.close.push_back(point.line);
    } else if (!compensation.knows_ways() && (point.near || PointCompensation::follows_previous(point))) {
      choices.unknown.push_back(point.line);
    }
  }
  for (auto& [file, choices] : of_file) {
    add_remark(program.remarks,
               fmt::format("another way to a pose (shoulder, elbow, wrist, turns) is about as near as the one that is "
                           "compensated, and its command is up to {:.2f} mm away, expected joint values",
                           choices.most * 1e3),
               std::move(choices.close), file);
    add_remark(program.remarks,
               "poses without a configuration are followed from the point before: whether another way to them is about "
               "as near is not known for an arm of this build",
               std::move(choices.unknown), file);
  }
}

std::vector<PathDeviation> path_deviations(const PointCompensation& compensation, const Program& program,
                                           const std::vector<CompensatedPosition>& positions,
                                           const std::vector<ProgramText>& texts) {
  constexpr double kNoticeable = 1e-4;  // [m]
  const std::vector<Segment> segments = segments_of(program);
  std::vector<PathDeviation> deviations(segments.size());
  parallel_for(segments.size(), 0, [&](std::size_t i) {
    const Segment& segment = segments[i];
    deviations[i] = {.source = texts[segment.motion->file].source,
                     .line = segment.motion->line,
                     .from = program.points[segment.from].name,
                     .to = program.points[segment.to].name,
                     .deviation = compensation.deviation(positions[segment.from], positions[segment.to],
                                                         program.points[segment.to])};
  });
  std::erase_if(deviations, [](const PathDeviation& path) { return !(path.deviation > kNoticeable); });
  std::stable_sort(deviations.begin(), deviations.end(),
                   [](const PathDeviation& a, const PathDeviation& b) { return a.deviation > b.deviation; });
  return deviations;
}

// "IN.LS:3: Offset moves ... (also in lines 5, 8 and 12 more)"
std::string warning_of(const ProgramRemark& remark, const std::string& source) {
  constexpr std::size_t kMostLines = 10;
  std::string others;
  for (std::size_t i = 1; i < std::min(kMostLines, remark.lines.size()); ++i) {
    others += (i == 1 ? "" : ", ") + std::to_string(remark.lines[i]);
  }
  if (remark.lines.size() > kMostLines) {
    others += fmt::format(" and {} more", remark.lines.size() - kMostLines);
  }
  return fmt::format(
      "{}:{}: {}{}", source, remark.lines.front(), remark.what,
      others.empty() ? "" : (remark.lines.size() == 2 ? " (also in line " : " (also in lines ") + others + ")");
}

// The numbers to write into a text, in its order.
std::vector<NumberField> fields_of(const Program& program, const std::vector<CompensatedPosition>& positions,
                                   std::size_t file) {
  std::vector<NumberField> fields;
  fields.reserve(6 * positions.size());
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const ProgramPoint& point = program.points[i];
    if (positions[i].written && point.file == file) {
      fields.insert(fields.end(), point.fields.begin(), point.fields.end());
      fields.insert(fields.end(), point.turn_fields.begin(), point.turn_fields.end());
    }
  }
  const auto before = [](const NumberField& a, const NumberField& b) { return a.begin < b.begin; };
  if (!std::is_sorted(fields.begin(), fields.end(), before)) {
    std::sort(fields.begin(), fields.end(), before);
  }
  return fields;
}

}  // namespace

CompensatedProgram compensated_program(const ProgramSetup& setup, const std::vector<ProgramText>& texts,
                                       const CompensatedJoints& near) {
  Program program = setup.language.parse(texts);
  leave_out_resting_axes(program, setup.controller);
  leave_out_moving_frames(program, setup.controller.frames);
  const PointCompensation compensation(setup, program, texts);
  std::vector<CompensatedPosition> positions(program.points.size());
  compensate_alone(compensation, program, positions);
  InOrder(compensation, program, positions, near).compensate();
  remark_other_branches(compensation, positions, program);
  remark_close_choices(compensation, positions, program);
  CompensatedProgram result;
  for (std::size_t file = 0; file < texts.size(); ++file) {
    result.texts.push_back(with_numbers(texts[file].text, fields_of(program, positions, file), setup.language));
  }
  result.paths = path_deviations(compensation, program, positions, texts);
  for (const CompensatedPosition& position : positions) {
    result.rounding = std::max(result.rounding, position.rounding);
  }
  result.positions = std::move(positions);
  std::stable_sort(program.remarks.begin(), program.remarks.end(), [](const ProgramRemark& a, const ProgramRemark& b) {
    return std::pair(a.file, a.lines.front()) < std::pair(b.file, b.lines.front());
  });
  for (const ProgramRemark& remark : program.remarks) {
    result.warnings.push_back(warning_of(remark, texts[remark.file].source));
  }
  return result;
}

}  // namespace kdl_calibration
