// Programs of controllers, compensated.

#include <fmt/core.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <iterator>
#include <limits>
#include <string_view>
#include <utility>

#include "kdl_calibration/compensation.hpp"
#include "kdl_calibration/input_error.hpp"
#include "programs/compensated_program.hpp"
#include "programs/program_files.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/file_names.hpp"
#include "python/interruptible.hpp"
#include "python/keywords.hpp"
#include "python/options.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

namespace {

struct CompensatedFiles {
  ProgramFiles given;
  CompensatedProgram program;
  std::shared_ptr<Found> calibration;
  std::vector<NamedFile> inputs;  ///< that were read
  double line_tolerance = 0.0;
};

std::ptrdiff_t count_left(const CompensatedProgram& program) {
  return std::count_if(program.positions.begin(), program.positions.end(),
                       [](const CompensatedPosition& position) { return !position.written; });
}

// The program may change its working directory before it writes.
std::string absolute_name(const std::filesystem::path& path) { return std::filesystem::absolute(path).string(); }

Controller controller_of(const GivenProgram& given, const Robot& robot, const ProgramFiles& program) {
  const ProgramLanguage& language = *program.language;
  if (!given.controller && language.needs_description) {
    throw InputError(
        fmt::format("{}: controllers of {} count joints in another way than URDFs do, expected controller, "
                    "the file that describes it",
                    program.named, language.name));
  }
  Controller controller = given.controller ? read_controller(*given.controller) : controller_of_links(robot);
  if (given.joint_convention) {
    const auto* const file = std::get_if<std::filesystem::path>(&*given.joint_convention);
    controller.convention =
        file != nullptr ? read_joint_convention(*file) : std::get<JointConvention>(*given.joint_convention);
  }
  std::vector<std::pair<std::string, std::string>> axes;
  for (const auto& [axis, joint] : given.external_axes) {
    axes.emplace_back(py::str(axis), py::str(joint));
  }
  controller.external_axes = external_axes(axes, robot, "external_axes");
  controller.frames = given.frames_file ? read_program_frames(*given.frames_file, language) : given.frames;
  return controller;
}

CompensatedJoints near_of(const py::object& near, std::size_t joints) {
  if (near.is_none()) {
    return {};
  }
  const Doubles values = doubles(near, "near");
  if (values.ndim() != 1 || values.shape(0) != static_cast<py::ssize_t>(joints)) {
    throw InputError(
        fmt::format("near: an array of shape {}, expected ({},)", std::string(py::str(values.attr("shape"))), joints));
  }
  const Rows row(near, joints, "near");
  if (!row.row(0).allFinite()) {
    throw InputError("near: a joint value that is not finite, expected a number for each joint");
  }
  return row.row(0);
}

std::vector<NamedFile> inputs_of(const ProgramFiles& program, const GivenProgram& given, const Found& found) {
  std::vector<NamedFile> inputs = files_of(found);
  const auto add = [&](const char* keyword, const std::filesystem::path& path) {
    inputs.push_back({.option = keyword, .path = absolute_name(path)});
  };
  for (const ProgramText& text : program.texts) {
    add("program", text.source);
  }
  if (given.controller) {
    add("controller", *given.controller);
  }
  if (given.frames_file) {
    add("frames", *given.frames_file);
  }
  if (given.joint_convention && std::holds_alternative<std::filesystem::path>(*given.joint_convention)) {
    add("joint_convention", std::get<std::filesystem::path>(*given.joint_convention));
  }
  return inputs;
}

std::shared_ptr<CompensatedFiles> compensated_files(const std::shared_ptr<Found>& found,
                                                    const std::filesystem::path& file, const py::kwargs& keywords) {
  const Robot& robot = *found->robot;
  GivenProgram stated = program_options(keywords);
  if (!(stated.line_tolerance > 0.0)) {
    throw InputError(fmt::format("line_tolerance: {}, expected a length above 0 [m]", stated.line_tolerance));
  }
  auto result = std::make_shared<CompensatedFiles>(CompensatedFiles{.given = read_program(file.string()),
                                                                    .program = {},
                                                                    .calibration = found,
                                                                    .line_tolerance = stated.line_tolerance});
  require_original(result->given);
  result->inputs = inputs_of(result->given, stated, *found);
  const Controller controller = controller_of(stated, robot, result->given);
  for (std::string& joint : carrying_joints(controller)) {
    stated.options.held.push_back(std::move(joint));
  }
  const CompensatedJoints near = near_of(stated.near, robot.joints.size());
  const Compensator compensator(found->calibration, stated.options);
  result->program = interruptible([&](const Interruption& interruption) {
    const ProgramSetup setup{.robot = robot,
                             .compensator = compensator,
                             .controller = controller,
                             .language = *result->given.language,
                             .check = [&] { interruption.check(); }};
    return compensated_program(setup, result->given.texts, near, stated.line_tolerance);
  });
  return result;
}

// The values of all positions, each with `count` numbers: read(position, to). NaN where there are none.
template <class Read>
Doubles numbers_of(const CompensatedProgram& program, std::vector<py::ssize_t> rest, const Read& read) {
  rest.insert(rest.begin(), static_cast<py::ssize_t>(program.positions.size()));
  Doubles result(std::move(rest));
  double* const begin = result.mutable_data();
  std::fill(begin, begin + result.size(), std::numeric_limits<double>::quiet_NaN());
  const py::ssize_t count = program.positions.empty() ? 0 : result.size() / result.shape(0);
  double* to = begin;
  for (const CompensatedPosition& position : program.positions) {
    read(position, to);
    to += count;
  }
  return result;
}

py::array positions_of(const CompensatedFiles& files) {
  const CompensatedProgram& program = files.program;
  const auto count = static_cast<py::ssize_t>(program.positions.size());
  std::vector<std::string> names;
  std::vector<std::string> status;
  py::array_t<std::int64_t> lines(count);
  py::array_t<bool> written(count);
  for (py::ssize_t i = 0; i < count; ++i) {
    const CompensatedPosition& position = program.positions[static_cast<std::size_t>(i)];
    names.push_back(position.name);
    status.emplace_back(to_string(position.point.status));
    lines.mutable_at(i) = static_cast<std::int64_t>(position.line);
    written.mutable_at(i) = position.written;
  }
  using P = CompensatedPosition;
  const auto joints = static_cast<py::ssize_t>(files.calibration->robot->joints.size());
  return structured(
      {{"name", text_array(names)},
       {"line", lines},
       {"status", text_array(status)},
       {"written", written},
       {"asked", numbers_of(program, {joints},
                            [](const P& p, double* to) {
                              const CompensatedJoints asked = p.asked();
                              std::copy(asked.begin(), asked.end(), to);
                            })},
       {"joint_values", numbers_of(program, {joints},
                                   [](const P& p, double* to) {
                                     std::copy(p.point.joint_values.begin(), p.point.joint_values.end(), to);
                                   })},
       {"displacement", numbers_of(program, {}, [](const P& p, double* to) { *to = p.displacement; })},
       {"position_error", numbers_of(program, {}, [](const P& p, double* to) { *to = p.point.position_error; })},
       {"orientation_error", numbers_of(program, {}, [](const P& p, double* to) { *to = p.point.orientation_error; })}},
      count);
}

// What the record beside a program writes of a line.
py::list paths_of(const CompensatedFiles& files) {
  py::list result;
  for (const PathDeviation& path : files.program.paths) {
    result.append(py::dict("line"_a = path.line, "from"_a = path.from, "to"_a = path.to,
                           "deviation"_a = path.deviation.position,
                           "orientation_deviation"_a = path.deviation.orientation));
  }
  return result;
}

py::dict texts_of(const CompensatedFiles& files) {
  py::dict result;
  for (std::size_t i = 0; i < files.program.texts.size(); ++i) {
    result[py::str(files.given.texts[i].source)] = py::bytes(files.program.texts[i]);
  }
  return result;
}

void save(const CompensatedFiles& files, const std::filesystem::path& output, bool overwrite,
          const std::string& result_sha256) {
  std::vector<OutputFile> outputs = program_outputs(files.given, output.string());
  for (OutputFile& each : outputs) {
    each.option = "output";
  }
  for (std::size_t i = 0; i < files.program.texts.size(); ++i) {
    outputs[i].text = files.program.texts[i];
  }
  const std::string head = record_head(files.program, result_sha256, files.line_tolerance);
  outputs.back().pieces = [&](const TextSink& sink) { write_record(head, files.program, sink); };
  write_whole(outputs, files.inputs, overwrite);
}

}  // namespace

void bind_programs(py::module_& module) {
  py::class_<CompensatedFiles, std::shared_ptr<CompensatedFiles>>(
      module, "CompensatedProgram", "A program at whose points the robot is where the nominal one would be.")
      .def_property_readonly(
          "language", [](const CompensatedFiles& f) { return std::string(f.given.language->name); },
          "'FANUC LS', 'URScript', 'ABB RAPID' or 'KUKA KRL'.")
      .def_readonly("calibration", &CompensatedFiles::calibration)
      .def_property_readonly("texts", &texts_of, "The new bytes of each file of the program, by its name.")
      .def_property_readonly(
          "positions", &positions_of,
          "Structured array of the P points: name, line, status (as Compensator's), written (else the point is as it\n"
          "was), asked (n,) and joint_values (n,) [rad or m], nominal and commanded, displacement [m] of the "
          "commanded\n"
          "flange, position_error [m] and orientation_error [rad] that remain.")
      .def_property_readonly(
          "rounding", [](const CompensatedFiles& f) { return f.program.rounding; },
          "[m] Largest displacement of the flange by rounding to the digits of the program.")
      .def_property_readonly(
          "straight_lines", [](const CompensatedFiles& f) { return f.program.lines; },
          "How many straight lines between points were tried.")
      .def_property_readonly(
          "paths", &paths_of,
          "Those that the tool leaves by more than line_tolerance, worst first: dicts of line, from,\n"
          "to, deviation [m], orientation_deviation [rad]; infinite where it cannot be followed.")
      .def_property_readonly(
          "warnings",
          [](const CompensatedFiles& f) {
            std::vector<std::string> warnings;
            const std::ptrdiff_t left = count_left(f.program);
            if (left > 0) {
              warnings.push_back(fmt::format("{} of {} points are not reached and stay as they were", left,
                                             f.program.positions.size()));
            }
            std::transform(f.program.warnings.begin(), f.program.warnings.end(), std::back_inserter(warnings),
                           [](const std::string& warning) { return in_keywords(warning); });
            return warnings;
          },
          "Points that are not reached, and what the controller decides at run time, with the lines.")
      .def("_save", &save)
      .def("__repr__", [](const CompensatedFiles& f) {
        return fmt::format("<CompensatedProgram in {} with {} points, {} of them left as they were>",
                           f.given.language->name, f.program.positions.size(), count_left(f.program));
      });
  module.def(
      "compensate_program", &compensated_files, "calibration"_a.none(false), "program"_a,
      "A program of a controller (FANUC LS, ABB RAPID, KUKA KRL, URScript) with other numbers, as `kdlcal\n"
      "compensate --program` writes it. program: its file. Keywords: those of Compensator, and\n"
      "controller: the file that describes it. joint_convention: instead of the controller's, or its file.\n"
      "frames: a file, or {'user_frames': {'1': X (4, 4)}, 'tool_frames': ...}. external_axes: joints of the URDF, "
      "{'E1': 'rail', 'E2': '-turntable'}.\n"
      "near: (n,) joint values from which it starts. line_tolerance: [m].\n\n"
      "Raises InputError for a calibration that is not trusted, an unknown language, and a point that cannot be read.");
}

}  // namespace kdl_calibration::python
