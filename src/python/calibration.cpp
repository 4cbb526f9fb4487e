// The calibration and its result.

#include "kdl_calibration/calibration.hpp"

#include <pybind11/stl.h>

#include <fmt/core.h>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <utility>

#include "base/whole_files.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/kinematic_export.hpp"
#include "kdl_calibration/report_page.hpp"
#include "kdl_calibration/result_file.hpp"
#include "kdl_calibration/validation.hpp"
#include "measurements/training_rows.hpp"
#include "python/arm.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/file_names.hpp"
#include "python/interruptible.hpp"
#include "python/keywords.hpp"
#include "python/options.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

const Measurements& Found::fitted() const {
  if (!measurements) {
    throw InputError(origin ? "a calibration at a stated temperature or payload has no measurements, expected the one "
                              "that it was made from"
                            : "the calibration was read from a file, expected one that calibrate has just made");
  }
  return *measurements;
}

std::vector<NamedFile> files_of(const Found& found) {
  if (found.origin) {
    return files_of(*found.origin);
  }
  std::vector<NamedFile> files = {{.option = "the robot", .path = found.robot->source}};
  if (found.measurements && !found.measurements->source.empty()) {
    files.push_back({.option = "the calibration", .path = found.measurements->source});
  }
  if (!found.file.empty()) {
    files.push_back({.option = "load", .path = found.file});
  }
  return files;
}

namespace {

using FoundPointer = std::shared_ptr<Found>;

FoundPointer calibrated(const std::shared_ptr<Robot>& robot, const std::shared_ptr<Measurements>& given,
                        const py::kwargs& keywords) {
  const GivenCalibrationOptions stated = calibration_options(keywords);
  const std::shared_ptr<const Measurements> measurements = named(given, *robot);
  const std::vector<bool> fitted = configurations_with(Split::train, *measurements);
  const auto count = std::count(fitted.begin(), fitted.end(), true);
  if (const int folds = stated.options.validation.k_fold; std::cmp_greater(folds, count)) {
    throw InputError(
        fmt::format("validation.k_fold: {} folds of {} fitted configurations, expected at most as many", folds, count));
  }
  Calibration calibration = interruptible([&](Interruption& interruption) {
    CalibrationOptions options = stated.options;
    options.progress = progress_hook<const std::string&, std::size_t, std::size_t>(stated.progress, interruption);
    return calibrate(*robot, *measurements, options);
  });
  return std::make_shared<Found>(Found{.calibration = std::move(calibration),
                                       .robot = robot,
                                       .measurements = measurements,
                                       .own = stated.earlier ? stated.earlier->own : stated.own});
}

std::string file_text(const std::filesystem::path& file) {
  std::ostringstream text;
  text << std::ifstream(file, std::ios::binary).rdbuf();
  return text.str();
}

FoundPointer loaded(const std::filesystem::path& file, const std::shared_ptr<Robot>& robot, const py::dict& own) {
  Calibration calibration = load_calibration(file, *robot, own_effects(own, "own"));
  return std::make_shared<Found>(Found{.calibration = std::move(calibration),
                                       .robot = robot,
                                       .measurements = nullptr,
                                       .text = file_text(file),
                                       .file = std::filesystem::absolute(file).string(),
                                       .own = copy_of_effects(own)});
}

void save(const Found& found, const std::filesystem::path& file) {
  if (found.measurements) {
    write_result(file, *found.robot, *found.measurements, found.calibration);
    return;
  }
  if (found.text.empty()) {
    throw InputError("a calibration at a stated temperature or payload has no file, expected the one it was made from");
  }
  write_whole({{.option = {}, .path = file.string(), .text = found.text}},
              {{.option = "the robot", .path = found.robot->source}}, true);
}

const char* word_of(Verdict verdict) {
  return verdict == Verdict::trusted                  ? "trusted"
         : verdict == Verdict::trusted_where_measured ? "trusted_where_measured"
                                                      : "not_trusted";
}

// A column of the parameters.
template <class T, class Member>
py::array_t<T> numbers(const std::vector<ParameterEstimate>& parameters, const Member& member) {
  py::array_t<T> result(static_cast<py::ssize_t>(parameters.size()));
  T* to = result.mutable_data();
  for (const ParameterEstimate& parameter : parameters) {
    *to++ = parameter.*member;
  }
  return result;
}

template <class Member>
py::array texts(const std::vector<ParameterEstimate>& parameters, const Member& member) {
  std::vector<std::string> result;
  for (const ParameterEstimate& parameter : parameters) {
    result.emplace_back(member(parameter));
  }
  return text_array(result);
}

py::array parameters_of(const Found& found) {
  using P = ParameterEstimate;
  const std::vector<P>& all = found.calibration.parameters();
  return structured({{"name", texts(all, [](const P& p) { return p.name; })},
                     {"joint", texts(all, [](const P& p) { return p.joint; })},
                     {"kind", texts(all, [](const P& p) { return to_string(p.kind); })},
                     {"axis", texts(all, [](const P& p) { return p.axis; })},
                     {"nominal", numbers<double>(all, &P::nominal)},
                     {"value", numbers<double>(all, &P::value)},
                     {"error", numbers<double>(all, &P::error)},
                     {"std", numbers<double>(all, &P::std)},
                     {"degrees_of_freedom", numbers<double>(all, &P::degrees_of_freedom)},
                     {"identifiable", numbers<bool>(all, &P::identifiable)},
                     {"gauge", numbers<bool>(all, &P::gauge)}},
                    static_cast<py::ssize_t>(all.size()));
}

py::array residuals_of(const Found& found) {
  const Measurements& measurements = found.fitted();
  const std::vector<RowResidual> rows = residuals(*found.robot, measurements, found.calibration);
  const auto column = [&](const auto& member) {
    Doubles result({static_cast<py::ssize_t>(rows.size()), py::ssize_t{3}});
    double* to = result.mutable_data();
    for (const RowResidual& row : rows) {
      to = std::copy((row.*member).begin(), (row.*member).end(), to);
    }
    return result;
  };
  return observation_table(measurements, {{"position", column(&RowResidual::position)},
                                          {"whitened", column(&RowResidual::whitened)},
                                          {"rotation", column(&RowResidual::rotation)}});
}

py::array jacobian_of(const Found& found) {
  const Eigen::MatrixXd jacobian = position_jacobian(*found.robot, found.fitted(), found.calibration);
  Doubles result({jacobian.rows() / 3, Eigen::Index{3}, jacobian.cols()});
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
      result.mutable_data(), jacobian.rows(), jacobian.cols()) = jacobian;
  return result;
}

KinematicFormat format_named(const std::string& name) {
  constexpr std::pair<const char*, KinematicFormat> kFormats[] = {{"urdf", KinematicFormat::urdf},
                                                                  {"dh", KinematicFormat::dh},
                                                                  {"mdh", KinematicFormat::mdh},
                                                                  {"opw", KinematicFormat::opw},
                                                                  {"ur_yaml", KinematicFormat::ur_yaml},
                                                                  {"xacro_yaml", KinematicFormat::xacro_yaml},
                                                                  {"parameters_csv", KinematicFormat::parameters_csv}};
  for (const auto& [word, format] : kFormats) {
    if (name == word) {
      return format;
    }
  }
  throw InputError("format: '" + name + "', expected urdf, dh, mdh, opw, ur_yaml, xacro_yaml or parameters_csv");
}

/// What holds where `stated` is asked for after `before`: a temperature of the arm is that of all links.
Circumstances after(const Circumstances& before, const Circumstances& stated) {
  Circumstances result = stated;
  result.temperature = std::isnan(stated.temperature) ? before.temperature : stated.temperature;
  result.payload = std::isnan(stated.payload) ? before.payload : stated.payload;
  if (std::isnan(stated.temperature)) {
    result.link_temperatures.insert(before.link_temperatures.begin(), before.link_temperatures.end());
  }
  return result;
}

FoundPointer taken_at(const FoundPointer& found, const Circumstances& stated) {
  return std::make_shared<Found>(Found{.calibration = found->calibration.at(stated),
                                       .robot = found->robot,
                                       .measurements = nullptr,
                                       .own = found->own,
                                       .circumstances = after(found->circumstances, stated),
                                       .origin = found->origin ? found->origin : found});
}

std::string words_of(const Circumstances& at) {
  std::string text = std::isnan(at.temperature) ? "" : fmt::format(" at {:g} degC", at.temperature);
  for (const auto& [link, temperature] : at.link_temperatures) {
    text += fmt::format(" with {} at {:g} degC", link, temperature);
  }
  return text + (std::isnan(at.payload) ? "" : fmt::format(" with {:g} kg", at.payload));
}

std::string calibration_text(const Found& found) {
  const BeforeAfter& train = found.calibration.accuracy().train;
  std::ostringstream text;
  text.precision(3);
  text << "<Calibration of " << found.robot->name << words_of(found.circumstances) << ": "
       << word_of(found.calibration.verdict()) << ", rms " << train.before.rms * 1e3 << " mm -> "
       << train.after.rms * 1e3 << " mm>";
  return text.str();
}

using FoundClass = py::class_<Found, FoundPointer>;

void bind_verdict(FoundClass& type) {
  type.def_property_readonly(
          "verdict", [](const Found& f) { return word_of(f.calibration.verdict()); },
          "'trusted', 'trusted_where_measured' or 'not_trusted'.")
      .def_property_readonly(
          "trusted", [](const Found& f) { return f.calibration.trusted(); },
          "Whether the result may be used, at least where it was measured.")
      .def_property_readonly(
          "doubts", [](const Found& f) { return f.calibration.doubts(); },
          "Why it is not to be trusted, or what is not known elsewhere: a list of Doubt.")
      .def_property_readonly(
          "remarks", [](const Found& f) { return f.calibration.remarks(); },
          "Worth knowing, but no reason to distrust it: a list of Doubt.")
      .def_property_readonly(
          "warnings", [](const Found& f) { return message_texts(f.calibration.warnings()); },
          "The messages of the remarks.")
      .def_property_readonly("accuracy", [](const Found& f) { return f.calibration.accuracy(); })
      .def_property_readonly("robot", [](const Found& f) { return std::const_pointer_cast<Robot>(f.robot); })
      .def_property_readonly(
          "measurements", [](const Found& f) { return std::const_pointer_cast<Measurements>(f.measurements); },
          "Those that were fitted; None if the result was loaded.");
}

void bind_parameters(FoundClass& type) {
  type.def_property_readonly("parameters", &parameters_of,
                             "Structured array: name, joint, kind, axis, nominal, value, error, std (1 sigma),\n"
                             "degrees_of_freedom, identifiable, gauge. SI units.")
      .def(
          "error", [](const Found& f, const std::string& name) { return f.calibration.error(name); }, "name"_a,
          "The error of 'Tx1', 'base.Rz', 'A.x' [m or rad].")
      .def(
          "std", [](const Found& f, const std::string& name) { return f.calibration.std(name); }, "name"_a,
          "Its 1 sigma.")
      .def_property_readonly(
          "estimated", [](const Found& f) { return f.calibration.estimated(); }, "Names of the k estimated parameters.")
      .def_property_readonly(
          "covariance",
          [](const py::object& self) {
            return transposed_view(self.cast<const Found&>().calibration.covariance(), self);
          },
          "(k, k) covariance of the `estimated` parameters, SI units, a view; infinite where not determined.")
      .def_property_readonly("jacobian", &jacobian_of,
                             "(M, 3, k) derivatives of the predicted positions of the M rows, in the measuring frame\n"
                             "and along the measured directions, by the `estimated` parameters.")
      .def_property_readonly("residuals", &residuals_of,
                             "Structured array of the M rows: configuration, target, station, repeat, test, position\n"
                             "(3,) [m] measured minus predicted in the measuring frame, whitened (3,): the same over\n"
                             "the root of the covariance of one row (noise and misfit), rotation (3,) [rad].");
}

}  // namespace

void bind_calibration(py::module_& module) {
  FoundClass type(module, "Calibration", "What was found, how far to trust it, and the arm that results.");
  bind_verdict(type);
  bind_parameters(type);
  type.def_property_readonly("arm", &Found::arm, py::return_value_policy::copy, "The arm with all effects.")
      .def(
          "predict",
          [prediction = module.attr("Prediction")](const Found& found, const py::object& q, std::string target,
                                                   std::string frame, std::string station, int threads) {
            return prediction(
                *predictions(found.arm(), {q, std::move(target), std::move(frame), std::move(station), threads}));
          },
          "q"_a, "target"_a, "frame"_a = "base", "station"_a = "", "threads"_a = 0, kPredictDocumentation)
      .def(
          "flange_poses",
          [](const Found& found, const py::object& q, int threads) { return flange_poses(found.arm(), q, threads); },
          "q"_a, "threads"_a = 0,
          "q: (N, n) or (n,) [rad or m]. Returns (N, 4, 4) or (4, 4): the flange in the base frame [m].")
      .def(
          "at",
          [](const FoundPointer& found, double temperature, double payload,
             std::map<std::string, double> link_temperatures) {
            return taken_at(
                found,
                {.temperature = temperature, .payload = payload, .link_temperatures = std::move(link_temperatures)});
          },
          "temperature"_a = Circumstances::kUnknown, "payload"_a = Circumstances::kUnknown,
          "link_temperatures"_a = std::map<std::string, double>(),
          "The same arm at this temperature [degC] and payload [kg] instead of the means of the measurements, for "
          "predictions and Compensator. link_temperatures: by the URDF link, of those that are at another temperature. "
          "Raises InputError where no effect depends on them.")
      .def_property_readonly("_origin",
                             [](const FoundPointer& found) {
                               return found->origin ? std::const_pointer_cast<Found>(found->origin) : found;
                             })
      .def_property_readonly("_circumstances",
                             [](const Found& found) {
                               return py::make_tuple(found.circumstances.temperature, found.circumstances.payload,
                                                     found.circumstances.link_temperatures);
                             })
      .def_property_readonly(
          "own", [](const Found& found) { return copy_of_effects(found.own); },
          "The effects that are functions of the caller's own.")
      .def("save", &save, "file"_a, "Writes the result that `kdlcal calibrate --result` writes, and `load` reads.")
      .def(
          "report",
          [](const Found& found, const std::filesystem::path& file) {
            write_report(file, *found.robot, found.fitted(), found.calibration);
          },
          "file"_a, "Writes the page for people, one HTML file.")
      .def(
          "write_urdf",
          [](const Found& found, const std::filesystem::path& file) {
            require_writable({{.option = {}, .path = file.string(), .text = {}}}, files_of(found), true);
            write_urdf(file, *found.robot, found.calibration);
          },
          "file"_a, "Writes the URDF with corrected joint origins.")
      .def(
          "export",
          [](const Found& found, const std::string& format) {
            return kinematic_export(*found.robot, found.calibration, format_named(format));
          },
          "format"_a, "The calibrated geometry as text: urdf, dh, mdh, opw, ur_yaml, xacro_yaml or parameters_csv.")
      .def("__repr__", &calibration_text);
  module.def("calibrate", &calibrated, "robot"_a.none(false), "measurements"_a.none(false),
             "Registration, choice of parameters, priors and effects, fit, uncertainty, validation and diagnosis.\n\n"
             "Keywords are the members of the C++ CalibrationOptions, structures as dicts:\n"
             "    calibrate(robot, m, parameters={'fix': ['Tx*']}, noise={'stated': {'independent': 3e-5}})\n"
             "progress: called with a stage, how many of its fits are done, and their number.\n\n"
             "Raises InputError for bad input, TypeError for an unknown keyword. Ctrl-C stops it.");
  module.def("load", &loaded, "file"_a, "robot"_a.none(false), "own"_a = py::dict(),
             "Reads a result. robot: the one that was calibrated. own: its effects that are functions of your own, as "
             "in the keyword effects of calibrate.\n\n"
             "Raises InputError for another robot, a bad file and an effect of your own that is not given.");
}

}  // namespace kdl_calibration::python
