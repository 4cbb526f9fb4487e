#include "programs/controller.hpp"
#include "programs/ls_program.hpp"
#include "promise.hpp"
#include "targets.hpp"

namespace kdl_calibration::fuzzing {

void fanuc_program(std::string_view bytes) {
  let_input_errors_pass([&] {
    const LsProgram program = parse_ls_program(bytes, "IN.LS");
    const auto last_line = 1 + static_cast<std::size_t>(std::count(bytes.begin(), bytes.end(), '\n'));
    for (const ProgramRemark& remark : program.remarks) {
      promise(!remark.lines.empty() && std::is_sorted(remark.lines.begin(), remark.lines.end()) &&
                  remark.lines.front() > 0 && remark.lines.back() <= last_line,
              "lines of the text, in order");
    }
    std::vector<NumberField> fields;
    for (const ProgramPosition& position : program.positions) {
      fields.insert(fields.end(), position.fields.begin(), position.fields.end());
    }
    for (const NumberField& field : fields) {
      promise(field.begin < field.end && field.end <= bytes.size() && std::isfinite(field.value),
              "a number of the text");
    }
    std::sort(fields.begin(), fields.end(),
              [](const NumberField& a, const NumberField& b) { return a.begin < b.begin; });
    promise(with_numbers(bytes, fields) == bytes, "no change, no other byte");
  });
}

void fanuc_frames(std::string_view bytes) {
  let_input_errors_pass([&] {
    const NumberedFrames frames = parse_system_frames(bytes, "SYSFRAME.VA");
    for (const auto* kind : {&frames.user, &frames.tool}) {
      for (const auto& [number, frame] : *kind) {
        promise(number > 0 && frame.matrix().allFinite(), "finite frames, by number from 1");
      }
    }
  });
}

}  // namespace kdl_calibration::fuzzing
