#pragma once

#include <Eigen/Geometry>
#include <nlohmann/json.hpp>
#include <string>

#include "estimation/unknowns.hpp"
#include "support.hpp"

namespace kdl_calibration::testing {

template <class Json>
Eigen::Vector3d vector_of(const Json& numbers) {
  return {numbers.at(0).template get<double>(), numbers.at(1).template get<double>(),
          numbers.at(2).template get<double>()};
}

/// Position and quaternion.
inline Eigen::Isometry3d placed_as(const nlohmann::json& frame) {
  const nlohmann::json& q = frame.at("quaternion_wxyz");
  return Eigen::Translation3d(vector_of(frame.at("position"))) *
         Eigen::Quaterniond(q.at(0).get<double>(), q.at(1).get<double>(), q.at(2).get<double>(), q.at(3).get<double>());
}

/// The first three rows of a matrix.
template <class Json>
Eigen::Isometry3d frame_of(const Json& numbers) {
  Eigen::Isometry3d frame = Eigen::Isometry3d::Identity();
  for (int i = 0; i < 12; ++i) {
    frame.matrix()(i / 4, i % 4) = numbers.at(static_cast<std::size_t>(i)).template get<double>();
  }
  return frame;
}

/// Base, targets and geometric errors that a result, a truth or an answer of kdlcal states.
inline Estimate estimate_in(const ErrorModel& model, const nlohmann::json& json) {
  Estimate estimate{.errors = errors_of(model), .frames = {.bases = {placed_as(json.at("base"))}}};
  for (const nlohmann::json& target : json.at("targets")) {
    estimate.frames.targets.emplace_back().X_FT.translation() = vector_of(target.at("position"));
  }
  for (const nlohmann::json& parameter : json.value("parameters", nlohmann::json::array())) {
    const std::string name = parameter.at("name");
    if (name.find('.') == std::string::npos) {
      estimate.errors[static_cast<Eigen::Index>(parameter_index(model, name))] = parameter.at("error");
    }
  }
  return estimate;
}

}  // namespace kdl_calibration::testing
