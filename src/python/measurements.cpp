// Measurements from arrays and files, and as arrays.

#include "kdl_calibration/measurements.hpp"

#include <pybind11/stl.h>

#include <limits>
#include <utility>

#include "interface/calibration_parts.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/orientation_reading.hpp"
#include "measurements/training_rows.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/file_names.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

namespace {

using Integers = py::array_t<std::int64_t, py::array::c_style | py::array::forcecast>;

/// What each row of the package's `from_arrays` holds. Arrays have one element or row for each observation; those that
/// are empty state nothing.
struct GivenRows {
  Doubles points;        ///< (M, 3) [m]
  Doubles orientations;  ///< (M, 4) w, x, y, z
  Doubles sigma;         ///< (M,) [m]
  Integers configuration, target, station, repeat, order, is_test;
};

Observation observation_at(const GivenRows& rows, py::ssize_t i) {
  Observation observation;
  const Eigen::Vector3d position(rows.points.at(i, 0), rows.points.at(i, 1), rows.points.at(i, 2));
  observation.reading = Point{position};
  if (rows.orientations.size() > 0) {
    const Eigen::Quaterniond turn(rows.orientations.at(i, 0), rows.orientations.at(i, 1), rows.orientations.at(i, 2),
                                  rows.orientations.at(i, 3));
    observation.reading = Pose{position, Orientation(turn.normalized())};
  }
  if (rows.sigma.size() > 0) {
    observation.sigma = rows.sigma.at(i);
  }
  if (rows.order.size() > 0) {
    observation.order = rows.order.at(i);
  }
  observation.configuration = static_cast<std::int32_t>(rows.configuration.at(i));
  observation.target = static_cast<std::int32_t>(rows.target.at(i));
  observation.station = static_cast<std::int16_t>(rows.station.at(i));
  observation.repeat = static_cast<std::int32_t>(rows.repeat.at(i));
  observation.split = rows.is_test.at(i) != 0 ? Split::test : Split::train;
  return observation;
}

Integers integers(const py::dict& given, const char* name) { return given[name].cast<Integers>(); }

std::vector<std::string> numbered_joints(Eigen::Index count) {
  std::vector<std::string> names;
  for (Eigen::Index joint = 0; joint < count; ++joint) {
    names.push_back("joint " + std::to_string(joint + 1));
  }
  return names;
}

/// The package checks the arrays, see measurements.py.
std::shared_ptr<Measurements> from_rows(const Rows& joint_values, const py::dict& given, const py::dict& names) {
  const GivenRows rows{.points = doubles(given["points"], "points"),
                       .orientations = doubles(given["orientations"], "orientations"),
                       .sigma = doubles(given["sigma"], "sigma"),
                       .configuration = integers(given, "configuration"),
                       .target = integers(given, "target"),
                       .station = integers(given, "station"),
                       .repeat = integers(given, "repeat"),
                       .order = integers(given, "order"),
                       .is_test = integers(given, "is_test")};
  using Names = std::vector<std::string>;
  auto result = std::make_shared<Measurements>();
  result->source = "the arrays";
  result->joints = names["joints"].cast<Names>();
  result->joint_values = joint_values.transposed();
  result->configurations = names["configurations"].cast<Names>();
  result->targets = names["targets"].cast<Names>();
  result->stations = names["stations"].cast<Names>();
  const Doubles circumstances = doubles(given["circumstances"], "circumstances");  // (N, 2), or nothing
  if (circumstances.size() > 0) {
    result->signals.circumstances = Rows(circumstances, 2, "circumstances").transposed();
  }
  result->signals.links = names["links"].cast<Names>();
  if (!result->signals.links.empty()) {
    const Doubles temperatures = doubles(given["link_temperatures"], "link_temperatures");  // (N, links)
    result->signals.link_temperatures =
        Rows(temperatures, result->signals.links.size(), "link_temperatures").transposed();
  }
  const py::ssize_t count = rows.points.shape(0);
  result->observations.reserve(static_cast<std::size_t>(count));
  for (py::ssize_t i = 0; i < count; ++i) {
    result->observations.push_back(observation_at(rows, i));
  }
  Names stated = std::exchange(result->joints, numbered_joints(result->joint_values.rows()));  // for any names
  result->signals.approach = approach_directions(*result);
  result->joints = std::move(stated);
  return result;
}

// A column of the observations.
template <class T, class Member>
py::array_t<T> column(const Measurements& measurements, const Member& member) {
  py::array_t<T> result(static_cast<py::ssize_t>(measurements.observations.size()));
  T* to = result.mutable_data();
  for (const Observation& observation : measurements.observations) {
    *to++ = static_cast<T>(member(observation));
  }
  return result;
}

py::array names_at(const std::vector<std::string>& names, const py::array& indices) {
  return text_array(names)[indices];
}

py::array positions(const Measurements& measurements) {
  Doubles result({static_cast<py::ssize_t>(measurements.observations.size()), py::ssize_t{3}});
  double* to = result.mutable_data();
  for (const Observation& observation : measurements.observations) {
    to = std::copy(observation.position().begin(), observation.position().end(), to);
  }
  return result;
}

}  // namespace

py::array observation_table(const Measurements& measurements,
                            const std::vector<std::pair<std::string, py::array>>& columns) {
  const auto of = [&](const auto& member) { return column<std::int64_t>(measurements, member); };
  std::vector<std::pair<std::string, py::array>> all;
  all.emplace_back("configuration",
                   names_at(measurements.configurations, of([](const Observation& o) { return o.configuration; })));
  all.emplace_back("target", names_at(measurements.targets, of([](const Observation& o) { return o.target; })));
  all.emplace_back("station", names_at(measurements.stations, of([](const Observation& o) { return o.station; })));
  all.emplace_back("repeat", of([](const Observation& o) { return o.repeat; }));
  all.emplace_back("test", column<bool>(measurements, [](const Observation& o) { return o.split == Split::test; }));
  all.insert(all.end(), columns.begin(), columns.end());
  return structured(all, static_cast<py::ssize_t>(measurements.observations.size()));
}

namespace {

py::array observations_of(const Measurements& measurements) {
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  const std::vector<std::string> kinds = {"point", "pose", "coordinates", "distance"};
  const auto kind = column<std::int64_t>(measurements, [](const Observation& o) { return o.reading.index(); });
  const auto length = [](const Observation& o) {
    const auto* const distance = std::get_if<Distance>(&o.reading);
    return distance == nullptr ? kNone : distance->length;
  };
  return observation_table(measurements,
                           {{"kind", names_at(kinds, kind)},
                            {"position", positions(measurements)},
                            {"length", column<double>(measurements, length)},
                            {"sigma", column<double>(measurements, [](const Observation& o) { return o.sigma; })}});
}

std::shared_ptr<Measurements> read_file(const Robot& robot, const std::filesystem::path& file,
                                        const JointConvention* convention, const std::string& orientation) {
  return std::make_shared<Measurements>(
      read_measurements(robot, std::filesystem::absolute(file), convention,
                        orientation.empty() ? OrientationReading::usual : orientation_reading(orientation)));
}

std::string measurements_text(const Measurements& measurements) {
  return "<Measurements: " + std::to_string(measurements.observations.size()) + " rows, " +
         std::to_string(measurements.configurations.size()) + " configurations, " +
         std::to_string(measurements.targets.size()) + " targets>";
}

}  // namespace

std::shared_ptr<const Measurements> named(const std::shared_ptr<const Measurements>& measurements, const Robot& robot) {
  require_links(*measurements, robot);
  if (!measurements->joints.empty()) {
    return measurements;
  }
  auto result = std::make_shared<Measurements>(*measurements);
  result->joints = joint_names(robot);
  if (static_cast<std::size_t>(result->joint_values.rows()) != result->joints.size()) {
    throw InputError("measurements of " + std::to_string(result->joint_values.rows()) + " joints, expected " +
                     std::to_string(result->joints.size()) + " as " + robot.source + " has");
  }
  return result;
}

void bind_measurements(py::module_& module) {
  py::class_<Measurements, std::shared_ptr<Measurements>>(module, "Measurements", "Measured points of targets.")
      .def_property_readonly(
          "source", [](const Measurements& m) { return file_name(m.source); }, "File name, for messages.")
      .def_readonly("joints", &Measurements::joints, "Names of the n joints; empty: those of the robot.")
      .def_readonly("configurations", &Measurements::configurations, "N labels.")
      .def_readonly("targets", &Measurements::targets)
      .def_readonly("stations", &Measurements::stations)
      .def_readonly("remark", &Measurements::remark, "How the reader interpreted the file; empty if as usual.")
      .def_property_readonly(
          "joint_values",
          [](const py::object& self) { return transposed_view(self.cast<const Measurements&>().joint_values, self); },
          "(N, n) joint values of each configuration [rad or m], a view.")
      .def_property_readonly("points", &positions, "(M, 3) measured positions [m]; of distances the anchors.")
      .def_property_readonly("observations", &observations_of,
                             "Structured array of the M rows: configuration, target, station, repeat, test, kind, "
                             "position [m], length [m], sigma [m].")
      .def(
          "csv", [](const Measurements& m) { return measurements_csv(m); }, "The text of a measurements file.")
      .def("__len__", [](const Measurements& m) { return m.observations.size(); })
      .def("__repr__", &measurements_text)
      .def(py::pickle(
          [](const Measurements& m) {
            Measurements written = m;
            if (m.joints.empty()) {
              written.joints = numbered_joints(m.joint_values.rows());
            }
            return py::make_tuple(measurements_csv(written), written.joints, file_name(m.source), m.joints.empty(),
                                  m.remark);
          },
          [](const py::tuple& state) {
            auto m = std::make_shared<Measurements>(parse_measurements(state[0].cast<std::string>(),
                                                                       state[1].cast<std::vector<std::string>>(),
                                                                       nullptr, bytes_of_name(state[2])));
            if (state[3].cast<bool>()) {
              m->joints.clear();
            }
            m->remark = state[4].cast<std::string>();
            return m;
          }));
  module.def(
      "_from_rows",
      [](const py::object& joint_values, std::size_t joints, const py::dict& rows, const py::dict& names) {
        return from_rows(Rows(joint_values, joints, "joints"), rows, names);
      },
      "joint_values"_a, "joints"_a, "rows"_a, "names"_a);
  module.def("read_measurements", &read_file, "robot"_a, "file"_a, "convention"_a = nullptr, "orientation"_a = "",
             "Reads a file of measurements (CSV). convention: a JointConvention. orientation: what three angles mean,\n"
             "'rotation-vector', 'fixed-xyz', 'moving-xyz' or 'moving-zyx'.\n\n"
             "Raises InputError that names file, line, column, value and rule.");
}

}  // namespace kdl_calibration::python
