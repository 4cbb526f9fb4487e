#pragma once

// A fit linearised beside everything that is ordinary.

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/explanations.hpp"
#include "estimation/linear_system.hpp"
#include "estimation/residual_options.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/calibration_options.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// A fit at its end. Keeps references.
struct FitToDoubt {
  const ErrorModel& model;
  const Measurements& measurements;  ///< training rows
  const Estimate& estimate;
  const KnownFrames& known;
  std::vector<std::string> fix = {};  ///< patterns of errors that are held at zero
  double uncertainty = 0.0;           ///< [m] 3D 1 sigma of predictions, from the parameters alone
  NoiseModel stated = {};             ///< noise of the measurements
  double scale_sigma = 0.0;           ///< of a factor on all lengths: what is in every uncertainty is no mistake
  Eigen::Index unknowns = 0;          ///< that were fitted
  std::span<const OwnAlternative> alternatives = {};
  bool beside_effects = true;  ///< false: the effects of the model are doubted as well, and not held as ordinary
  int threads = 1;             ///< 0: one per core; the answer does not depend on it
};

/// Every geometric error, also those that would part kept axes, sag under gravity and gain has an ordinary size, the
/// fit's other effects a small one; frames are free unless they are stated. It is linearised at the most likely values
/// of these, of at most 3,000 configurations.
class OrdinaryFit {
public:
  /// Keeps a reference.
  explicit OrdinaryFit(const FitToDoubt& fit);

  const LinearisedFit& linear() const { return linear_; }
  const Measurements& rows() const { return rows_; }
  const ErrorModel& model() const { return model_; }
  const std::vector<TargetFrame>& targets() const { return estimate_.frames.targets; }
  const KnownFrames& known() const { return fit_.known; }
  double scale_sigma() const { return fit_.scale_sigma; }
  Eigen::Index columns() const { return wide_.size(); }
  /// Whether the noise is stated as that of a tracker, which is at the origin of W.
  bool has_tracker() const { return options_.noise.tracker.has_value(); }
  /// Whether the origin of W is clearly outside the box of the points, at every station: where a measuring device
  /// stands.
  bool is_seen_from_outside() const;
  /// [m] RMS of the doubted result over the rows, along their measured directions.
  double misfit() const { return misfit_; }
  bool is_beside_effects() const { return fit_.beside_effects; }
  /// The same that would be left by a model as good as the doubted one but with `columns` unknowns instead of its
  /// effects.
  double misfit_without_effects(Eigen::Index columns) const;

  std::size_t station(Eigen::Index configuration) const;
  /// First row of a configuration, and their number.
  std::pair<Eigen::Index, Eigen::Index> rows_of(Eigen::Index configuration) const;

  /// Columns of J as columns of the unit matrix.
  Eigen::MatrixXd unit_columns(UnknownGroup group, const std::vector<std::size_t>& indices) const;
  Eigen::MatrixXd of_base(std::size_t station) const;
  Eigen::MatrixXd of_target(std::size_t k) const;
  /// A motion of all targets in the flange frame.
  Eigen::MatrixXd of_tool() const;
  /// The zero of a joint; none if its offset is no error of the model.
  std::optional<Eigen::MatrixXd> of_zero(std::size_t joint) const;
  /// Indices of a group's effects.
  std::vector<std::size_t> effects_of(EffectGroup group) const;

  /// Adds an error of size `step` to a row whose point is predicted at `predicted` in W.
  using Disturbance = std::function<void(Observation& row, const Eigen::Vector3d& predicted, double step)>;
  /// The derivative of the residuals by an error of the measurements, at the predicted points: a factor on measured
  /// ones would explain their noise.
  Eigen::MatrixXd disturbed(const Disturbance& disturb) const;

  /// The base in the measuring frame of the row's station.
  const Eigen::Isometry3d& base_of(const Observation& row) const;
  /// The derivatives by further effects of the model, one column for each: of the rows, and of the predicted points.
  struct EffectColumns {
    Eigen::MatrixXd rows;
    Eigen::MatrixXd points;
  };
  EffectColumns of_effects(const std::vector<EffectTerm>& terms) const;
  /// Joint values of the places where predictions are looked at.
  const Eigen::MatrixXd& places() const { return places_; }
  /// Displacements of the flange there in the base frame, 3 x places, as those of the predicted points.
  Eigen::VectorXd at_points(const Eigen::Matrix3Xd& displacements) const;
  /// The columns of J that the result itself has: frames that are not stated, geometry and its effects.
  std::vector<Eigen::Index> columns_of_result() const;

private:
  WhitenedSystem whitened(const Measurements& rows, const Unknowns& unknowns) const;
  bool has_arm_alone() const;
  Eigen::VectorXd points_of(const ErrorModel& model, const Estimate& estimate) const;
  void linearise();
  void set_sizes();
  void predict();
  void split_into_strata();
  void turn(Eigen::MatrixXd& rows) const;
  Eigen::VectorXd turned(const Eigen::VectorXd& rows) const;
  bool is_held(const Unknown& unknown) const;

  const FitToDoubt& fit_;
  Measurements rows_;
  ErrorModel model_;
  Estimate estimate_;  // about which is linearised
  Unknowns wide_;
  std::vector<std::int16_t> stations_;
  ResidualOptions options_;
  std::vector<Eigen::Index> blocks_;
  std::vector<Eigen::Index> split_;  // points of each configuration that is split into strata, else 0
  double points_ = 0.0;
  double misfit_ = 0.0;
  Eigen::MatrixXd places_;
  DriveSignals signals_;  // there
  LinearisedFit linear_;
};

}  // namespace kdl_calibration
