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
    count_visits();
    for (const ProgramMotion& motion : program_.motions) {
      approach_.is_straight = motion.is_straight && is_known_;
      if (motion.point && !visit(*motion.point)) {
        other_ways_.push_back(motion.line);
      }
      is_known_ = motion.point.has_value();
    }
    approach_.is_straight = false;
    for (std::size_t i = 0; i < positions_.size(); ++i) {
      if (PointCompensation::follows_previous(program_.points[i]) && !is_visited_[i]) {
        visit(i);
      }
    }
    add_remark(program_.remarks,
               "reaches a pose with other joint values than a motion before: its command is right for the first ones, "
               "expected a pose of its own",
               std::move(other_ways_));
  }

private:
  void count_visits() {
    is_visited_.resize(positions_.size());
    for (const ProgramMotion& motion : program_.motions) {
      if (motion.point && PointCompensation::follows_previous(program_.points[*motion.point])) {
        if (is_visited_[*motion.point]) {
          originals_.try_emplace(*motion.point, program_.points[*motion.point]);
        }
        is_visited_[*motion.point] = true;
      }
    }
    is_visited_.assign(positions_.size(), false);
  }

  // False for a point that was visited before with other joint values.
  bool visit(std::size_t i) {
    constexpr double kSame = 1e-3;  // [rad]
    ProgramPoint& point = program_.points[i];
    if (!PointCompensation::follows_previous(point)) {
      approach_.previous = positions_[i].asked();
      return true;
    }
    if (!is_visited_[i]) {
      is_visited_[i] = true;
      positions_[i] = compensation_.compensate(point, approach_);
      approach_.previous = positions_[i].asked();
      return true;
    }
    ProgramPoint again = originals_.at(i);
    approach_.previous = compensation_.compensate(again, approach_).asked();
    return (approach_.previous - positions_[i].asked()).norm() < kSame;
  }

  const PointCompensation& compensation_;
  Program& program_;
  std::vector<CompensatedPosition>& positions_;
  Approach approach_;
  bool is_known_ = false;  // where the motion begins
  std::vector<bool> is_visited_;
  std::map<std::size_t, ProgramPoint> originals_;  // of those that are visited again
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

void check_lines(const PointCompensation& compensation, const Program& program, const std::vector<ProgramText>& texts,
                 double tolerance, CompensatedProgram& result) {
  std::vector<Segment> segments = segments_of(program);
  std::erase_if(segments, [](const Segment& segment) { return segment.motion->is_curved; });
  std::vector<LineDeviation> found(segments.size());
  parallel_for(segments.size(), 0, [&](std::size_t i) {
    found[i] = compensation.deviation(result.positions[segments[i].from], result.positions[segments[i].to],
                                      program.points[segments[i].to]);
  });
  result.lines = segments.size();
  for (std::size_t i = 0; i < segments.size(); ++i) {
    result.largest_deviation.include(found[i]);
    if (found[i].position > tolerance) {
      result.paths.push_back({.source = texts[segments[i].motion->file].source,
                              .line = segments[i].motion->line,
                              .from = program.points[segments[i].from].name,
                              .to = program.points[segments[i].to].name,
                              .deviation = found[i]});
    }
  }
  std::stable_sort(result.paths.begin(), result.paths.end(), [](const PathDeviation& a, const PathDeviation& b) {
    return a.deviation.position > b.deviation.position;
  });
}

// A text does not say how the tool turns along a circle: makers do it in several ways.
void remark_curves(Program& program) {
  std::map<std::size_t, std::vector<std::size_t>> lines;  // of each file
  for (const ProgramMotion& motion : program.motions) {
    if (motion.is_curved && motion.is_known) {
      lines[motion.file].push_back(motion.line);
    }
  }
  for (auto& [file, of_file] : lines) {
    add_remark(program.remarks,
               "moves along a circle or spline: its points are compensated, how far the tool leaves it between them is "
               "not computed",
               std::move(of_file), file);
  }
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

// A text of the program with the new numbers.
std::string rewritten(const ProgramText& text, std::size_t file, const Program& program,
                      const std::vector<CompensatedPosition>& positions, const ProgramLanguage& language) {
  std::vector<const ProgramPoint*> points;
  points.reserve(positions.size());
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (positions[i].written && program.points[i].file == file) {
      points.push_back(&program.points[i]);
    }
  }
  // The numbers of a point stand together, with none of another one between them.
  const auto first_stands_before = [](const ProgramPoint* a, const ProgramPoint* b) {
    return a->fields.front().begin < b->fields.front().begin;
  };
  if (!std::is_sorted(points.begin(), points.end(), first_stands_before)) {
    std::sort(points.begin(), points.end(), first_stands_before);
  }
  return with_numbers(
      text.text, points.size(),
      [&](std::size_t i, std::vector<NumberField>& fields) {
        const auto old = static_cast<std::ptrdiff_t>(fields.size());
        fields.insert(fields.end(), points[i]->fields.begin(), points[i]->fields.end());
        fields.insert(fields.end(), points[i]->turn_fields.begin(), points[i]->turn_fields.end());
        std::sort(fields.begin() + old, fields.end(),
                  [](const NumberField& a, const NumberField& b) { return a.begin < b.begin; });
      },
      language);
}

}  // namespace

CompensatedProgram compensated_program(const ProgramSetup& setup, const std::vector<ProgramText>& texts,
                                       const CompensatedJoints& near, double line_tolerance) {
  Program program = setup.language.parse(texts);
  leave_out_resting_axes(program, setup.controller);
  leave_out_moving_frames(program, setup.controller.frames);
  const PointCompensation compensation(setup, program, texts);
  std::vector<CompensatedPosition> positions(program.points.size());
  compensate_alone(compensation, program, positions);
  InOrder(compensation, program, positions, near).compensate();
  remark_other_branches(compensation, positions, program);
  remark_close_choices(compensation, positions, program);
  remark_curves(program);
  CompensatedProgram result;
  for (std::size_t file = 0; file < texts.size(); ++file) {
    result.texts.push_back(rewritten(texts[file], file, program, positions, setup.language));
  }
  for (const CompensatedPosition& position : positions) {
    result.rounding = std::max(result.rounding, position.rounding);
  }
  result.positions = std::move(positions);
  check_lines(compensation, program, texts, line_tolerance, result);
  std::stable_sort(program.remarks.begin(), program.remarks.end(), [](const ProgramRemark& a, const ProgramRemark& b) {
    return std::pair(a.file, a.lines.front()) < std::pair(b.file, b.lines.front());
  });
  for (const ProgramRemark& remark : program.remarks) {
    result.warnings.push_back(warning_of(remark, texts[remark.file].source));
  }
  return result;
}

}  // namespace kdl_calibration
