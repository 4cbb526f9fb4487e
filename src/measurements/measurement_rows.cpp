#include "measurements/measurement_rows.hpp"

#include <cstddef>

#include "measurements/point_export.hpp"
#include "robot/mimic.hpp"

namespace kdl_calibration {

MeasurementRows::MeasurementRows(LineReader& lines, const std::vector<MovingJoint>& chain,
                                 const JointConvention* convention, const FileKind& kind)
    : lines_(lines),
      urdf_joints_(independent_joint_names(chain)),
      matched_(convention == nullptr ? std::nullopt : std::optional(matched_convention(*convention, urdf_joints_))),
      joints_{matched_ ? matched_->controller_joints : urdf_joints_,
              urdf_joints_,
              matched_ ? &*matched_ : nullptr,
              chain,
              {},
              kind.kinds_known,
              kind.content,
              kind.orientation,
              kind.links} {
  for (std::size_t i = 0; i < chain.size(); ++i) {
    if (chain[i].mimic || chain[i].drive) joints_.followers.push_back(i);
  }
  std::vector<Comment> comments;
  if (!next_record(lines, line_, &comments)) fail(lines.source(), "empty: " + expected_columns(joints_));
  const std::optional<ExportHeader> stated = export_header(comments, line_, lines.source());
  // Copied, because the next line may overwrite the buffer.
  head_.push_back(stated ? stated->text : std::string(line_));
  header_ = parse_header(head_.front(), joints_, lines.place());
  // If commas separate the columns, decimal commas are refused.
  decimals_ = {.mark = header_.separator == ',' ? '.' : '\0', .line = header_.line};
  if (stated && stated->before_first) fields_.split(line_, header_.separator, lines_.place());
  has_first_ = (stated && stated->before_first) || next();
  if (has_first_ && is_unit_row(fields_)) {
    row();  // throws if it is ragged
    head_.emplace_back(line_);
    const UnitRow units{.cells = fields_, .line = lines.place().line};
    header_ = parse_header(head_.front(), joints_, {lines.source(), header_.line}, &units);
    has_first_ = false;
  }
  require_clear_orientations(header_, joints_, lines.source());
}

bool MeasurementRows::next() {
  if (!next_line()) return false;
  fields_.split(line_, header_.separator, lines_.place());
  return true;
}

bool MeasurementRows::next_line() {
  if (!has_first_) return next_record(lines_, line_);
  has_first_ = false;
  return true;
}

}  // namespace kdl_calibration
