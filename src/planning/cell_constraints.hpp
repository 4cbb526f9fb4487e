#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/robot.hpp"
#include "planning/workspace.hpp"

namespace kdl_calibration {

/// The constraints of a cell, prepared for many samples. Robot, targets and cell must outlive it.
class CellConstraints {
public:
  /// Throws InputError for sizes that do not fit the robot, an empty range, a number that is not finite, a clearance
  /// that no two parts of the arm ever have, and more than 64 constraints.
  CellConstraints(const Robot& robot, const std::vector<TargetFrame>& targets, const Cell& cell);

  const std::vector<std::string>& names() const { return names_; }
  /// Bit k: constraint k is violated at joint values `q`.
  std::uint64_t violations(const Eigen::VectorXd& q) const;
  /// "base_link and link_3" of the two parts that are closest to each other at joint values `q`; empty without a
  /// clearance.
  std::string closest_links(const Eigen::VectorXd& q) const;
  /// The place of the clearance in names(), if there is one.
  std::optional<std::size_t> clearance() const { return clearance_; }

private:
  struct Posture;
  using Condition = std::function<bool(const Posture&)>;

  Posture posture(const Eigen::VectorXd& q) const;
  void require_fit() const;
  bool are_numbers() const;
  void add(std::string name, Condition holds);
  void add_for_targets(std::string name, std::function<bool(const Eigen::Vector3d&)> holds);
  template <class Distance>
  void add_zone(const std::string& name, Distance distance);
  void add_sums();
  void add_room();
  void add_zones();
  void add_clearance();
  void add_tracker();
  bool faces_tracker(const Posture& posture) const;
  bool is_visible(const Posture& posture, std::size_t target) const;
  static bool passes_box(const Capsule& capsule, const Posture& posture, const Eigen::Vector3d& from,
                         const Eigen::Vector3d& to);
  bool moves_against_flange(std::size_t frame) const;

  const Robot& robot_;
  const std::vector<TargetFrame>& targets_;
  const Cell& cell_;
  std::vector<std::string> names_;
  std::vector<Condition> conditions_;
  std::vector<std::pair<std::size_t, std::size_t>> kept_apart_;  // capsules
  std::optional<std::size_t> clearance_;
};

}  // namespace kdl_calibration
