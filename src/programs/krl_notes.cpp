#include "programs/krl_notes.hpp"

#include <string_view>

#include "programs/add_remark.hpp"

namespace kdl_calibration::krl {
namespace {

constexpr std::array<std::string_view, static_cast<std::size_t>(Note::count)> kTexts = {
    "moves to a place that is known at run time only: not compensated here",
    "moves to a point that another file declares: not compensated here",
    "PTP_REL, LIN_REL and CIRC_REL move by an increment: left as it is",
    "CA ends a circle before or behind its end point: points are compensated, the path is not checked",
    "$TOOL or $BASE is set at run time: poses that are moved to with it are left as they are",
    "TOOL_DATA or BASE_DATA is set at run time: poses are compensated with the frame of --frames",
    "EK, EB or LK couples the base to what moves it: poses that are moved to with it are left as they are",
    "tool or base depend on a branch, a loop or another routine: poses are compensated with those that stand last "
    "above",
    "tool or base are not known here: poses are compensated with those of their FDAT",
    "copies a compensated point or computes with it: motions to the copy, and what is computed from it, use that",
    "hands a point to a routine that is not here: if that changes it (OUT), motions to it are not compensated",
    "TOOL_CORR_ON, BASE_CORR_ON or M_BAS_COR_ON moves poses at run time: compensated where they are without that",
    "a sensor corrects motions at run time: points are compensated where they are without that",
    "$ROBROOT is set by the program: poses are compensated as if it was not",
    "points that the program changes at run time, or uses as a frame: left as they are",
    "points with some of six components, whose others keep their values: left as they are",
    "points with a component that is computed: left as they are",
    "#TCP states points relative to a tool that stands in the cell: left as they are",
    "points that are used with two tools or bases: left as they are",
    "points whose tool or base is known at run time only: left as they are",
    "points that nothing here moves to and that have no FDAT: left as they are",
    "bit 4 of S (16) states that an absolutely accurate robot taught the point. If this robot is one, its controller "
    "compensates already: do not compensate its programs"};

}  // namespace

std::vector<ProgramRemark> Notes::remarks() const {
  std::vector<ProgramRemark> remarks;
  for (std::size_t note = 0; note < kTexts.size(); ++note) {
    for (const auto& [file, lines] : lines_[note]) {
      add_remark(remarks, std::string(kTexts[note]), lines, file);
    }
  }
  return remarks;
}

}  // namespace kdl_calibration::krl
