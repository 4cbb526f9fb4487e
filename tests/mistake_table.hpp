#pragma once

// The mistakes that people make with measurements, each with what it is to be called.

#include <algorithm>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "mistakes_support.hpp"

namespace kdl_calibration::testing {

inline const ErrorModel& large_arm() {
  static const ErrorModel model = complete_model(fanuc());
  return model;
}

inline const ErrorModel& light_arm() {
  static const ErrorModel model = complete_model(parse_robot(kLightArm));
  return model;
}

struct Mistake {
  std::string name;
  std::function<void(Measured&)> make;
  std::string cause;
  std::string words;  // that the message has
  Draw draw = {};
};

inline void for_rows(Measured& m, const std::function<void(Observation&)>& change) {
  std::for_each(m.data.observations.begin(), m.data.observations.end(), change);
}

inline Mistake scaled(const std::string& name, double factor, const std::string& cause, const std::string& words,
                      const Draw& draw = {}) {
  return {name, [=](Measured& m) { for_rows(m, [&](Observation& o) { o.position() *= factor; }); }, cause, words, draw};
}

inline Mistake joint_times(Eigen::Index j, double factor, const std::string& cause, const std::string& words,
                           const Draw& draw = {}) {
  return {"joint " + std::to_string(j + 1) + " times " + std::to_string(factor),
          [=](Measured& m) { m.data.joint_values.row(j) *= factor; }, cause, words, draw};
}

inline Mistake exchanged(Eigen::Index j, Eigen::Index k) {
  return {"joints " + std::to_string(j + 1) + " and " + std::to_string(k + 1),
          [=](Measured& m) { m.data.joint_values.row(j).swap(m.data.joint_values.row(k)); }, "joint_columns",
          "exchanged"};
}

inline Mistake coupled(double sign) {
  return {"J3 counted with J2", [=](Measured& m) { m.data.joint_values.row(2) += sign * m.data.joint_values.row(1); },
          "joint_convention", sign > 0.0 ? " - " : " + "};
}

inline Mistake swapped_from(int first) {
  return {"targets exchanged",
          [=](Measured& m) {
            for_rows(m, [&](Observation& o) {
              o.target = o.configuration >= first && o.target != 2 ? 1 - o.target : o.target;
            });
          },
          "exchanged_targets", "A and B exchanged from configuration " + std::to_string(first + 1) + " on"};
}

inline Mistake moved_from(int first, const Eigen::Vector3d& step) {
  return {"step of the base",
          [=](Measured& m) {
            for_rows(
                m, [&](Observation& o) { o.position() += o.configuration >= first ? step : Eigen::Vector3d::Zero(); });
          },
          "moved_base", "after configuration " + std::to_string(first)};
}

inline Mistake turned_from(int first, double angle) {
  return {"turn of the base",
          [=](Measured& m) {
            for_rows(m, [&](Observation& o) {
              if (o.configuration >= first) {
                o.position() = rotation_exp({angle, 0.0, 0.0}) * o.position();
              }
            });
          },
          "moved_base", "after configuration " + std::to_string(first)};
}

inline std::vector<Mistake> joint_mistakes() {
  const double degree = 1.0 / kDegree;
  const Draw short_lever{.lever = 0.005};
  std::vector<Mistake> all = {joint_times(2, degree, "joint_unit", "in degrees, read as radians"),
                              joint_times(5, degree, "joint_unit", "in degrees, read as radians"),
                              joint_times(0, kDegree, "joint_unit", "in radians, read as degrees"),
                              joint_times(5, -1.0, "joint_sign", "opposite sign", short_lever),
                              joint_times(4, -1.0, "joint_sign", "opposite sign", short_lever),
                              exchanged(0, 1),
                              exchanged(1, 2),
                              exchanged(2, 4),
                              exchanged(3, 5),
                              exchanged(4, 5),
                              coupled(1.0),
                              coupled(-1.0),
                              joint_times(3, 1.0 / 0.9, "joint_unit", "in gradians, read as degrees"),
                              joint_times(1, 0.97, "joint_gain", "turning 1.03"),
                              joint_times(2, 1.05, "joint_gain", "turning 0.952")};
  for (Eigen::Index j = 0; j < 6; ++j) {
    all.push_back(joint_times(j, -1.0, "joint_sign", "opposite sign"));
  }
  all.push_back({"degrees as radians", [=](Measured& m) { m.data.joint_values *= degree; }, "joint_unit",
                 "all joint angles in degrees"});
  all.push_back({"radians as degrees", [](Measured& m) { m.data.joint_values *= kDegree; }, "joint_unit",
                 "all joint angles in radians"});
  all.push_back({"gradians as degrees", [=](Measured& m) { m.data.joint_values /= 0.9; }, "joint_unit",
                 "all joint angles in gradians, read as degrees"});
  all.push_back({"turns as radians", [](Measured& m) { m.data.joint_values /= 2.0 * std::numbers::pi; }, "joint_unit",
                 "all joint angles in turns, read as radians"});
  all.push_back({"reversed", [](Measured& m) { m.data.joint_values = m.data.joint_values.colwise().reverse().eval(); },
                 "joint_columns", "reversed order"});
  return all;
}

inline std::vector<Mistake> point_mistakes() {
  const auto change = [](const std::function<void(Eigen::Vector3d&)>& what) {
    return [what](Measured& m) { for_rows(m, [&](Observation& o) { what(o.position()); }); };
  };
  return {scaled("feet", 1.0 / 0.3048, "length_unit", "feet read as metres"),
          scaled("inches", 1.0 / 0.0254, "length_unit", "inches read as metres"),
          scaled("centimetres", 100.0, "length_unit", "centimetres read as metres"),
          scaled("millimetres", 1000.0, "length_unit", "millimetres read as metres"),
          scaled("metres as millimetres", 0.001, "length_unit", "metres read as millimetres"),
          scaled("inches as millimetres", 0.001 / 0.0254, "length_unit", "inches read as millimetres"),
          scaled("three per cent", 1.03, "scale", "temperature or "),
          scaled("one per cent", 1.01, "scale", "1.0", {.length = 0.0003, .angle = 0.001}),
          {"z in millimetres", change([](Eigen::Vector3d& p) { p.z() *= 1000.0; }), "length_unit", "z in another unit"},
          {"left-handed", change([](Eigen::Vector3d& p) { p.y() = -p.y(); }), "mirrored", "mirrored"},
          {"x and y exchanged", change([](Eigen::Vector3d& p) { std::swap(p.x(), p.y()); }), "mirrored", "exchanged"},
          {"all three signs", change([](Eigen::Vector3d& p) { p = -p; }), "mirrored", "mirrored"},
          {"frame of the tool",
           [](Measured& m) {
             for_rows(m,
                      [&](Observation& o) { o.position() = true_flange(m, o.configuration).inverse() * o.position(); });
           },
           "tool_frame", "frame of the tool"}};
}

inline std::vector<Mistake> order_mistakes() {
  return {swapped_from(6),
          swapped_from(17),
          moved_from(14, {0.0006, -0.0006, 0.0003}),
          moved_from(5, {0.006, -0.008, 0.0}),
          moved_from(24, {0.0, 0.0, 0.0015}),
          turned_from(20, 0.001),
          turned_from(9, 0.001),
          {"drift",
           [](Measured& m) {
             for_rows(m, [&](Observation& o) {
               o.position() += o.configuration / 29.0 * Eigen::Vector3d(6e-4, -6e-4, 3e-4);
             });
           },
           "drift", "drifts"}};
}

}  // namespace kdl_calibration::testing
