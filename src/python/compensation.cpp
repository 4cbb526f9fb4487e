// Compensated joint values, one or many.

#include "kdl_calibration/compensation.hpp"

#include <pybind11/stl.h>

#include "kdl_calibration/input_error.hpp"
#include "python/arm.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/options.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

namespace {

struct Compensating {
  Compensator compensator;
  std::shared_ptr<Found> calibration;
  py::dict options;  ///< as given
  std::size_t joints = 0;
};

Compensating compensating(const std::shared_ptr<Found>& found, const py::kwargs& keywords) {
  return {.compensator = Compensator(found->calibration, compensation_options(keywords)),
          .calibration = found,
          .options = py::dict(py::module_::import("copy").attr("deepcopy")(keywords)),
          .joints = found->robot->joints.size()};
}

// Poses (N, 4, 4) or (4, 4), one for each row.
std::vector<Eigen::Isometry3d> poses_of(const py::object& given, const Rows& rows) {
  const Doubles array = doubles(given, "X_BF");
  std::vector<Eigen::Isometry3d> poses;
  if (rows.is_single()) {
    poses.push_back(pose(array, "X_BF"));
    return poses;
  }
  if (array.ndim() != 3 || array.shape(0) != rows.count()) {
    throw InputError("X_BF: an array of shape " + std::string(py::str(array.attr("shape"))) + ", expected (" +
                     std::to_string(rows.count()) + ", 4, 4), a pose for each row of seed");
  }
  for (py::ssize_t i = 0; i < rows.count(); ++i) {
    poses.push_back(pose(array[py::int_(i)], "X_BF[" + std::to_string(i) + "]"));
  }
  return poses;
}

// solve(i) for each row.
template <class Solve>
py::tuple compensated(const Rows& rows, int threads, const Solve& solve) {
  const auto joints = static_cast<py::ssize_t>(rows.transposed().rows());
  Doubles joint_values(rows.shape_with({joints}));
  Doubles position_error(rows.shape_with({}));
  Doubles orientation_error(rows.shape_with({}));
  std::vector<std::string> status(static_cast<std::size_t>(rows.count()));
  for_each_row(rows, threads,
               [&, q = joint_values.mutable_data(), p = position_error.mutable_data(),
                o = orientation_error.mutable_data()](std::size_t i) {
                 const CompensatedPoint point = solve(i);
                 Eigen::Map<Eigen::VectorXd>(q + static_cast<py::ssize_t>(i) * joints, joints) = point.joint_values;
                 p[i] = point.position_error;
                 o[i] = point.orientation_error;
                 status[i] = to_string(point.status);
               });
  const py::object words = rows.is_single() ? py::object(py::str(status[0])) : py::object(text_array(status));
  return py::make_tuple(joint_values, words, position_error, orientation_error);
}

}  // namespace

void bind_compensation(py::module_& module) {
  const py::object type = py::module_::import("collections")
                              .attr("namedtuple")("Compensated", "joint_values status position_error orientation_error",
                                                  "module"_a = "kdl_calibration");
  module.attr("Compensated") = type;
  py::class_<Compensating>(module, "Compensator",
                           "Joint values with which the calibrated arm reaches the pose of the nominal arm.")
      .def(py::init(&compensating), "calibration"_a.none(false),
           "Keywords are the members of the C++ CompensationOptions: most_change [rad or m], position_first, held.\n\n"
           "Raises InputError for a calibration that is not trusted, and over 32 joints.")
      .def_readonly("calibration", &Compensating::calibration)
      .def_readonly("_options", &Compensating::options)
      .def(
          "solve",
          [type](const Compensating& self, const py::object& q, int threads) {
            const Rows rows(q, self.joints, "q");
            return type(
                *compensated(rows, threads, [&](std::size_t i) { return self.compensator.solve(rows.row(i)); }));
          },
          "q"_a, "threads"_a = 0,
          "q: (N, n) or (n,) nominal joint values [rad or m]. Returns the named tuple Compensated: joint_values (N, "
          "n),\n"
          "status (N,) of 'exact', 'position_only', 'unreachable', 'out_of_limits' and 'branch_changed',\n"
          "position_error (N,) [m] and orientation_error (N,) [rad] that remain. For (n,) all without N.")
      .def(
          "solve_poses",
          [type](const Compensating& self, const py::object& poses, const py::object& seed, int threads) {
            if (seed.is_none()) {
              throw py::type_error("seed: none, expected nominal joint values near the poses, (N, " +
                                   std::to_string(self.joints) + ") or (" + std::to_string(self.joints) + ",)");
            }
            const Rows seeds(seed, self.joints, "seed");
            const std::vector<Eigen::Isometry3d> X_BF = poses_of(poses, seeds);
            return type(*compensated(seeds, threads,
                                     [&](std::size_t i) { return self.compensator.solve(X_BF[i], seeds.row(i)); }));
          },
          "X_BF"_a, "seed"_a = py::none(), "threads"_a = 0,
          "The same for poses of the flange in the base frame, (N, 4, 4) or (4, 4), and nominal joint values near\n"
          "them, (N, n) or (n,).")
      .def(
          "nominal_poses",
          [](const Compensating& self, const py::object& q, int threads) -> py::array {
            const Rows rows(q, self.joints, "q");
            Doubles poses(rows.shape_with({4, 4}));
            for_each_row(rows, threads, [&, to = poses.mutable_data()](std::size_t i) {
              write_pose(self.compensator.nominal_pose(rows.row(i)), to + 16 * i);
            });
            return poses;
          },
          "q"_a, "threads"_a = 0,
          "(N, 4, 4) poses of the nominal robot: a controller that is told one sets these joint values.");
}

}  // namespace kdl_calibration::python
