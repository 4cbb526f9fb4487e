// The calibrated arm: predictions for arrays of joint values.

#include "kdl_calibration/calibrated_arm.hpp"

#include <pybind11/stl.h>

#include <algorithm>

#include "base/parallel.hpp"
#include "base/text.hpp"
#include "kdl_calibration/input_error.hpp"
#include "python/arm.hpp"
#include "python/arrays.hpp"
#include "python/bindings.hpp"
#include "python/interruptible.hpp"

namespace kdl_calibration::python {

using namespace pybind11::literals;

namespace {

PredictionFrame frame_named(const std::string& name) {
  if (name != "base" && name != "measuring") {
    throw InputError("frame: '" + name + "', expected 'base' or 'measuring'");
  }
  return name == "base" ? PredictionFrame::base : PredictionFrame::measuring;
}

// What a prediction of a row would refuse.
void require_names(const CalibratedArm& arm, const PredictionQuery& query, PredictionFrame frame) {
  const std::vector<std::string> targets = arm.targets();
  if (std::find(targets.begin(), targets.end(), query.target) == targets.end()) {
    throw InputError("target " + shown(query.target) + " was not calibrated, expected one of " +
                     comma_separated(targets));
  }
  if (frame == PredictionFrame::measuring || !query.station.empty()) {
    arm.base(query.station);
  }
}

py::object named_tuple(const char* name, const char* fields) {
  return py::module_::import("collections").attr("namedtuple")(name, fields, "module"_a = "kdl_calibration");
}

}  // namespace

void for_each_row(const Rows& rows, int threads, const std::function<void(std::size_t)>& work) {
  if (rows.is_single()) {
    work(0);
    return;
  }
  constexpr std::size_t kBlock = 256;
  const auto count = static_cast<std::size_t>(rows.count());
  interruptible([&](const Interruption& interruption) {
    parallel_blocks(count, kBlock, threads, [&](std::size_t i, std::size_t end) {
      interruption.check();
      try {
        for (; i < end; ++i) {
          work(i);
        }
      } catch (const InputError& error) {
        throw InputError("row " + std::to_string(i) + ": " + error.what());
      }
    });
    return true;
  });
}

py::tuple predictions(const CalibratedArm& arm, const PredictionQuery& query) {
  const Rows q(query.q, arm.joints().size(), "q");
  const PredictionFrame frame = frame_named(query.frame);
  if (q.count() == 0) {
    require_names(arm, query, frame);
  }
  Doubles position(q.shape_with({3}));
  Doubles covariance(q.shape_with({3, 3}));
  Doubles radius_95(q.shape_with({}));
  py::array_t<bool> outside(q.shape_with({}));
  Doubles degrees_of_freedom(q.shape_with({}));
  for_each_row(q, query.threads,
               [&, p = position.mutable_data(), c = covariance.mutable_data(), r = radius_95.mutable_data(),
                o = outside.mutable_data(), d = degrees_of_freedom.mutable_data()](std::size_t i) {
                 const PredictedPoint point = arm.predict(q.row(i), query.target, frame, query.station);
                 Eigen::Map<Eigen::Vector3d>(p + 3 * i) = point.position;
                 Eigen::Map<Eigen::Matrix3d>(c + 9 * i) = point.covariance;
                 r[i] = point.radius_95;
                 o[i] = point.outside;
                 d[i] = point.degrees_of_freedom;
               });
  return py::make_tuple(position, covariance, radius_95, outside, degrees_of_freedom);
}

py::array flange_poses(const CalibratedArm& arm, const py::object& joint_values, int threads) {
  const Rows q(joint_values, arm.joints().size(), "q");
  Doubles poses(q.shape_with({4, 4}));
  for_each_row(q, threads,
               [&, to = poses.mutable_data()](std::size_t i) { write_pose(arm.flange_pose(q.row(i)), to + 16 * i); });
  return poses;
}

namespace {

py::tuple flange_jacobians(const CalibratedArm& arm, const py::object& joint_values, int threads) {
  const std::size_t joints = arm.joints().size();
  const Rows q(joint_values, joints, "q");
  Doubles poses(q.shape_with({4, 4}));
  Doubles jacobians(q.shape_with({6, static_cast<py::ssize_t>(joints)}));
  for_each_row(q, threads, [&, to = poses.mutable_data(), j = jacobians.mutable_data()](std::size_t i) {
    Eigen::Matrix<double, 6, Eigen::Dynamic> jacobian;
    write_pose(arm.flange_pose(q.row(i), jacobian), to + 16 * i);
    Eigen::Map<Eigen::Matrix<double, 6, Eigen::Dynamic, Eigen::RowMajor>>(j + 6 * joints * i, 6,
                                                                          static_cast<Eigen::Index>(joints)) = jacobian;
  });
  return py::make_tuple(poses, jacobians);
}

py::array undetermined_motion(const CalibratedArm& arm, const py::object& joint_values, int threads) {
  const Rows q(joint_values, arm.joints().size(), "q");
  Doubles motion(q.shape_with({}));
  for_each_row(q, threads,
               [&, to = motion.mutable_data()](std::size_t i) { to[i] = arm.undetermined_motion(q.row(i)); });
  return motion;
}

py::array measured_ranges(const CalibratedArm& arm) {
  const JointRanges& ranges = arm.measured_ranges();
  Doubles result({ranges.size(), std::size_t{2}});
  double* to = result.mutable_data();
  for (const auto& [lower, upper] : ranges) {
    *to++ = lower;
    *to++ = upper;
  }
  return result;
}

}  // namespace

void bind_arm(py::module_& module) {
  module.attr("Prediction") = named_tuple("Prediction", "position covariance radius_95 outside degrees_of_freedom");
  py::class_<CalibratedArm>(module, "Arm", "Where the calibrated arm really goes, effects included.")
      .def_property_readonly("joints", &CalibratedArm::joints)
      .def_property_readonly("targets", &CalibratedArm::targets)
      .def_property_readonly("stations", &CalibratedArm::stations)
      .def_property_readonly("measured_ranges", &measured_ranges,
                             "(n, 2) measured range of each joint and 5 % beyond [rad or m].")
      .def(
          "predict",
          [prediction = module.attr("Prediction")](const CalibratedArm& arm, const py::object& q, std::string target,
                                                   std::string frame, std::string station, int threads) {
            return prediction(*predictions(arm, {q, std::move(target), std::move(frame), std::move(station), threads}));
          },
          "q"_a, "target"_a, "frame"_a = "base", "station"_a = "", "threads"_a = 0, kPredictDocumentation)
      .def("flange_poses", &flange_poses, "q"_a, "threads"_a = 0,
           "q: (N, n) or (n,) [rad or m]. Returns (N, 4, 4) or (4, 4): the flange in the base frame [m].")
      .def("flange_jacobians", &flange_jacobians, "q"_a, "threads"_a = 0,
           "Returns the same poses and (N, 6, n): the flange's twist in the base frame per unit of each joint value,\n"
           "linear velocity of its origin, then angular velocity.")
      .def("undetermined_motion", &undetermined_motion, "q"_a, "threads"_a = 0,
           "(N,) [m] the largest motion of a target by parameters that the measurements do not determine.")
      .def(
          "base", [](const CalibratedArm& arm, const std::string& station) { return pose_array(arm.base(station)); },
          "station"_a = "", "(4, 4) the base in the frame of the measuring device [m].");
}

}  // namespace kdl_calibration::python
