#include "programs/number_fields.hpp"
#include "programs/program_language.hpp"
#include "promise.hpp"
#include "targets.hpp"

namespace kdl_calibration::fuzzing {
namespace {

void read_program(const ProgramLanguage& language, std::string_view bytes) {
  const Program program = language.parse({{.source = "program", .text = std::string(bytes)}});
  const auto last_line = 1 + static_cast<std::size_t>(std::count(bytes.begin(), bytes.end(), '\n'));
  for (const ProgramRemark& remark : program.remarks) {
    promise(!remark.lines.empty() && std::is_sorted(remark.lines.begin(), remark.lines.end()) &&
                remark.lines.front() > 0 && remark.lines.back() <= last_line,
            "lines of the text, in order");
  }
  for (const ProgramMotion& motion : program.motions) {
    promise(motion.line > 0 && motion.line <= last_line && (!motion.point || *motion.point < program.points.size()),
            "motions of the text, to its points");
  }
  std::vector<NumberField> fields;
  for (const ProgramPoint& point : program.points) {
    promise(point.fields.size() == (point.notation == PointNotation::quaternion ? 7U : 6U), "all numbers of a point");
    fields.insert(fields.end(), point.fields.begin(), point.fields.end());
    fields.insert(fields.end(), point.turn_fields.begin(), point.turn_fields.end());
  }
  std::sort(fields.begin(), fields.end(), [](const NumberField& a, const NumberField& b) { return a.begin < b.begin; });
  std::size_t end = 0;
  for (const NumberField& field : fields) {
    promise(field.begin >= end && field.begin < field.end && field.end <= bytes.size() && std::isfinite(field.value),
            "numbers of the text, none of them twice");
    end = field.end;
  }
  promise(with_numbers(bytes, fields, language) == bytes, "no change, no other byte");
}

}  // namespace

void programs(std::string_view bytes) {
  for (const ProgramLanguage* language : program_languages()) {
    if (language->is_written_in(bytes)) {
      let_input_errors_pass([&] { read_program(*language, bytes); });
    }
  }
}

void program_frames(std::string_view bytes) {
  for (const ProgramLanguage* language : program_languages()) {
    let_input_errors_pass([&] {
      const ProgramFrames frames = language->read_frames(bytes, "frames");
      for (const auto* kind : {&frames.user, &frames.tool}) {
        for (const auto& [name, frame] : *kind) {
          promise(!name.empty() && frame.matrix().allFinite(), "finite frames with names");
        }
      }
    });
  }
}

}  // namespace kdl_calibration::fuzzing
