#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "kdl_calibration/error_model.hpp"

namespace kdl_calibration {

/// Values of all unknowns: the geometric errors of the complete model (zero where not free), the bases in the measuring
/// device's frame at each station, the targets on the flange and the effects of the joints.
struct Estimate {
  Eigen::VectorXd errors;
  Frames frames;
  Eigen::VectorXd effects;  ///< one per effect of the model; empty: none
};

/// Kinds of unknowns, in the order of their columns.
enum class UnknownGroup : std::uint8_t {
  base,       ///< Tx Ty Tz Rx Ry Rz: a motion of the base in its own frame
  geometric,  ///< ErrorModel::parameters
  effects,    ///< ErrorModel::effects
  targets     ///< per target x y z in the flange frame, then Rx Ry Rz in the target's frame
};
constexpr std::size_t kUnknownGroups = 4;

/// One unknown. `index`: 6 s + (0 to 5) for the base at station s, into the model's list, or 6 k + coordinate for
/// target k.
struct Unknown {
  UnknownGroup group = UnknownGroup::base;
  std::size_t index = 0;
  std::string name;
  bool length = false;  ///< [m] rather than [rad]
  double sigma = 0.0;   ///< prior 1 sigma of an effect, EffectTerm::sigma
};

/// A range of consecutive columns.
struct ColumnRange {
  Eigen::Index first = 0;
  Eigen::Index count = 0;

  Eigen::Index end() const { return first + count; }
  bool empty() const { return count == 0; }
};

/// The unknowns that a fit may change, each with its column. Ordered by UnknownGroup, then by index. Only this class
/// knows that order.
class Unknowns {
public:
  /// No unknowns.
  Unknowns() = default;
  /// The unknowns with these names, in any order. Throws InputError for an unknown name.
  Unknowns(const ErrorModel& model, const std::vector<TargetFrame>& targets, const std::vector<std::string>& names);

  /// A copy with exactly these indices (see Unknown::index) of one group.
  Unknowns with(const ErrorModel& model, UnknownGroup group, const std::vector<std::size_t>& indices) const;
  /// A copy with all unknowns of one group.
  Unknowns with_group(const ErrorModel& model, UnknownGroup group) const;
  /// A copy without a group.
  Unknowns without(UnknownGroup group) const;
  /// The unknowns whose columns are marked, one mark per column.
  Unknowns subset(const std::vector<bool>& marked) const;
  /// Marks of the columns that move the points of one station: all but the other stations' bases.
  std::vector<bool> columns_at_station(std::size_t station) const;
  /// The unknowns with these columns, as if that station were the only one, and without priors of effects.
  Unknowns of_station(std::size_t station) const;

  Eigen::Index size() const { return static_cast<Eigen::Index>(columns_.size()); }
  /// The unknowns in the order of their columns.
  const std::vector<Unknown>& columns() const { return columns_; }
  std::vector<std::string> names() const;

  /// The column of an unknown; empty if it is not free.
  std::optional<Eigen::Index> column(const std::string& name) const;
  std::optional<Eigen::Index> column(UnknownGroup group, std::size_t index) const;
  /// Columns of the base at a station, -1 if not free.
  const std::array<int, 6>& base_columns(std::size_t station) const;
  /// Columns of target k, -1 if not free.
  const std::array<int, 6>& target_columns(std::size_t k) const;

  ColumnRange range(UnknownGroup group) const;
  /// All columns before the targets': those that move the flange.
  ColumnRange chain() const { return {.first = 0, .count = range(UnknownGroup::targets).first}; }
  /// Indices of a group's unknowns, ascending.
  const std::vector<std::size_t>& of(UnknownGroup group) const { return indices_[static_cast<std::size_t>(group)]; }
  const std::vector<std::size_t>& geometric() const { return of(UnknownGroup::geometric); }
  const std::vector<std::size_t>& effects() const { return of(UnknownGroup::effects); }

  /// All columns by priority in the reduction, for columns that can replace each other: base, targets, geometric
  /// errors, effects.
  std::vector<Eigen::Index> order_of_choice() const;

  /// The estimate moved by a step in the columns' coordinates: X_WB and the orientations of targets by
  /// X <- X · Exp(step), everything else by addition. `result` must not be `estimate`.
  void move(const Estimate& estimate, const Eigen::VectorXd& step, Estimate& result) const;
  Estimate moved(const Estimate& estimate, const Eigen::VectorXd& step) const;
  /// The step that moves `from` to `to`, as far as the free unknowns allow.
  Eigen::VectorXd difference(const Estimate& from, const Estimate& to) const;

  /// The value that a prior refers to: that of an error or effect, or a target's coordinate [m]. Zero for base and
  /// orientations, which are relative to the present estimate.
  static double value(const Estimate& estimate, const Unknown& unknown);
  /// The same of every column.
  Eigen::VectorXd values(const Estimate& estimate) const;
  /// Prior information of each column, 1 / sigma^2; 0 without a prior.
  Eigen::VectorXd prior_information(const Priors& priors) const;

  friend bool operator==(const Unknowns& a, const Unknowns& b) { return a.indices_ == b.indices_; }
  friend bool operator!=(const Unknowns& a, const Unknowns& b) { return !(a == b); }

private:
  void arrange(std::vector<Unknown> unknowns);

  std::vector<TargetFrame> targets_;                      // for their names
  std::array<Eigen::Index, kUnknownGroups> listed_ = {};  // number of each group's unknowns, free or not
  std::vector<Unknown> columns_;
  std::array<std::vector<std::size_t>, kUnknownGroups> indices_;
  std::vector<std::array<int, 6>> base_columns_;  // of each station
  std::vector<std::array<int, 6>> target_columns_;
};

}  // namespace kdl_calibration
