// Plans and virtual experiments.

#include <pybind11/stl.h>

#include "kdl_calibration/measuring_plan.hpp"
#include "kdl_calibration/simulation.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/interruptible.hpp"
#include "python/options.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

namespace {

struct Planned {
  MeasuringPlan plan;
  std::shared_ptr<const Robot> robot;
};

std::shared_ptr<Planned> planned(const std::shared_ptr<Robot>& robot, const py::kwargs& keywords) {
  const GivenPlanOptions stated = plan_options(keywords);
  MeasuringPlan plan = interruptible([&](Interruption& interruption) {
    PlanOptions options = stated.options;
    options.progress = progress_hook<double>(stated.progress, interruption);
    return plan_measurements(*robot, options);
  });
  return std::make_shared<Planned>(Planned{.plan = std::move(plan), .robot = robot});
}

py::tuple simulated(const Robot& robot, const py::kwargs& keywords) {
  SimulatedExperiment experiment = simulate(robot, simulation_options(keywords));
  return py::make_tuple(std::make_shared<Measurements>(std::move(experiment.measurements)), experiment.truth);
}

}  // namespace

void bind_planning(py::module_& module) {
  py::class_<Planned, std::shared_ptr<Planned>>(module, "MeasuringPlan", "Configurations to measure, in their order.")
      .def_property_readonly(
          "configurations", [](const Planned& p) { return p.plan.configurations; }, "N labels.")
      .def_property_readonly(
          "joint_values",
          [](const py::object& self) { return transposed_view(self.cast<const Planned&>().plan.joint_values, self); },
          "(N, n) [rad or m], a view.")
      .def_property_readonly("targets", [](const Planned& p) { return p.plan.targets; })
      .def_property_readonly(
          "predicted_mean", [](const Planned& p) { return p.plan.predicted_mean; },
          "[m] 3D 1 sigma of a predicted target, mean over the workspace.")
      .def_property_readonly(
          "warnings", [](const Planned& p) { return p.plan.warnings; }, "What measurements of it cannot tell.")
      .def_property_readonly("predicted_max", [](const Planned& p) { return p.plan.predicted_max; })
      .def(
          "csv",
          [](const Planned& p, const JointConvention* convention) {
            return plan_csv(p.plan, p.robot->joints, convention);
          },
          "convention"_a = nullptr, "A measurements file with empty coordinates to fill in.");
  module.def("plan", &planned, "robot"_a.none(false),
             "The D-optimal choice of configurations. Keywords are the members of the C++ PlanOptions: count, targets\n"
             "(a dict of names and positions (3,) on the flange [m]), ranges (n, 2), noise [m], least_height [m],\n"
             "least_radius [m], seed; progress: called with the completed share. after: a calibration since which the\n"
             "robot may have changed, at joints of the list suspect or anywhere; the new measurements are then for\n"
             "calibrate with priors={'earlier': after}.\n\n"
             "Raises InputError for too few configurations and ranges of other joints. Ctrl-C stops it.");
  module.def("simulate", &simulated, "robot"_a,
             "A virtual robot with known errors. Returns (Measurements, Arm): the measured points and the truth.\n"
             "Keywords are the members of the C++ SimulationOptions: configurations, test_configurations, targets,\n"
             "ranges, noise [m], repeats, length_error [m], angle_error [rad], seed.\n\n"
             "The truth's covariance is zero. Of base and joint offsets only what is not gauge agrees with it.");
}

}  // namespace kdl_calibration::python
