#pragma once

#include <Eigen/Core>
#include <memory>

#include "estimation/linear_system.hpp"
#include "estimation/prediction.hpp"
#include "estimation/residual_options.hpp"
#include "estimation/unknowns.hpp"
#include "kdl_calibration/error_model.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/noise_model.hpp"

namespace kdl_calibration {

/// The residuals of a set of measurements and their linearisation. Only observations with Split::train take part.
/// Repeats of a configuration are gathered into one block of information, exactly: the cost changes by a constant.
/// With several stations it is the sum of the problems of each. All methods may be called from several threads at once.
class LeastSquaresProblem {
public:
  /// Keeps a reference to the model alone. Throws InputError if the independent noise is negligible beside the common
  /// part.
  LeastSquaresProblem(const ErrorModel& model, const Measurements& measurements, const Unknowns& unknowns,
                      const ResidualOptions& options = {});
  ~LeastSquaresProblem();

  /// Buffers of the passes over the data, for one thread at a time. Reusing them avoids allocation.
  class Workspace {
  public:
    Workspace();
    ~Workspace();

  private:
    friend class LeastSquaresProblem;
    struct Content;
    std::unique_ptr<Content> content_;
  };

  /// One pass over the data at an estimate.
  NormalEquations linearise(const Estimate& estimate) const;
  /// The same into existing equations, without allocation.
  void linearise(const Estimate& estimate, Workspace& workspace, NormalEquations& equations) const;
  /// The cost alone.
  double cost(const Estimate& estimate) const;
  double cost(const Estimate& estimate, Workspace& workspace) const;
  WhitenedSystem whitened(const Estimate& estimate) const;
  /// The sums of these rows, in constant memory. Above kManyConfigurations configurations on the lane pass,
  /// fewer with more than 30 columns, the triangular factor is a Cholesky factor of the information if its condition
  /// allows. Rotations of a station about the line or the point that its points are on get no information: only
  /// residuals would show them.
  WhitenedSummary whitened_summary(const Estimate& estimate) const;
  static constexpr std::size_t kManyConfigurations = 3000;

  const ErrorModel& model() const;
  const Unknowns& unknowns() const;
  Eigen::Index columns() const;
  long equations() const;          ///< measured coordinates, including repeats
  long points() const;             ///< measured points, including repeats
  double cost_of_repeats() const;  ///< the part of the cost independent of the estimate
  double total_weight() const;     ///< sum of the information of a coordinate over the points' means

private:
  struct Data;
  std::unique_ptr<const Data> data_;
};

}  // namespace kdl_calibration
