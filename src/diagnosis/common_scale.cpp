#include "diagnosis/common_scale.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "base/decompositions.hpp"
#include "base/distributions.hpp"
#include "diagnosis/trial_fit.hpp"
#include "diagnosis/trial_sample.hpp"
#include "estimation/least_squares.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// With all measured lengths `factor` times as long, and without weights.
Measurements longer(Measurements measurements, double factor) {
  for (Observation& observation : measurements.observations) {
    observation.sigma = 0.0;
    observation.position() *= factor;
    if (auto* const distance = std::get_if<Distance>(&observation.reading)) {
      distance->length *= factor;
    }
  }
  return measurements;
}

// The same about the mean of each station's points (or anchors).
Measurements longer_about_means(const Measurements& measurements, double factor) {
  MatrixXd sums = MatrixXd::Zero(4, std::ssize(measurements.stations));
  for (const Observation& observation : measurements.observations) {
    sums.col(observation.station) += observation.position().homogeneous();
  }
  Measurements result = longer(measurements, factor);
  for (Observation& observation : result.observations) {
    observation.position() += (1.0 - factor) * sums.col(observation.station).hnormalized();
  }
  return result;
}

// Sums over all measured coordinates and distances z, with J the derivatives by what is free and J_all those by every
// geometric error.
struct NormalSums {
  MatrixXd information;   // J^T J
  MatrixXd cross;         // J^T J_all
  VectorXd right_side;    // J^T z
  double variance = 0.0;  // of a coordinate [m^2]
};

NormalSums normal_sums(const ErrorModel& model, Measurements measurements, const Estimate& fit, const Unknowns& free) {
  constexpr double kStep = 1e-3;
  measurements = longer(without_orientations(std::move(measurements)), 1.0);
  const Unknowns complete = free.with_group(model, UnknownGroup::geometric);
  const auto linearised = [&](const Measurements& rows, const Unknowns& unknowns) {
    NormalEquations equations = LeastSquaresProblem(model, rows, unknowns).linearise(fit);
    equations.hessian = MatrixXd(equations.hessian.selfadjointView<Eigen::Lower>());
    return equations;
  };
  const NormalEquations at_fit = linearised(measurements, free);
  std::vector<Index> columns;
  for (const Unknown& unknown : free.columns()) {
    columns.push_back(*complete.column(unknown.group, unknown.index));
  }
  const auto [first, count] = complete.range(UnknownGroup::geometric);
  return {.information = at_fit.hessian,
          .cross = linearised(measurements, complete).hessian(columns, Eigen::seqN(first, count)),
          .right_side = (linearised(longer(measurements, 1.0 + kStep), free).gradient - at_fit.gradient) / kStep,
          .variance = at_fit.cost / dimension(measurements)};
}

// What a regression of y on x in the metric of C gives: the slope x' C^-1 y / x' C^-1 x, and the sums of squares of y
// that it explains and leaves.
struct Regression {
  double slope = 0.0;
  double explained = 0.0;
  double left = 0.0;
};

Regression regression(const VectorXd& x, const VectorXd& y, const MatrixXd& covariance) {
  const Eigen::LDLT<MatrixXd> C(covariance);
  const VectorXd weighted = C.solve(x);
  const double total = y.dot(C.solve(y));
  const double slope = weighted.dot(y) / weighted.dot(x);
  const double left = std::max(total - slope * weighted.dot(y), 1e-12 * total);
  return {.slope = slope, .explained = total - left, .left = left};
}

bool has_known_base(const ErrorModel& model, const Unknowns& free) {
  for (std::size_t station = 0; station < model.stations.size(); ++station) {
    const std::array<int, 6>& columns = free.base_columns(station);
    if (std::all_of(columns.begin(), columns.end(), [](int column) { return column < 0; })) {
      return true;
    }
  }
  return false;
}

}  // namespace

// Points that are f times too far apart give the errors e = (f - 1) / f x, where x is the least-squares solution of
// J x = z. Regression of e on x tests that. The covariance of e is that of the usual errors of the complete model,
// carried into the fit, plus that of the noise. Their common size is unknown, so the test is an F test.
CommonScale common_scale(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                         const Unknowns& free) {
  constexpr Index kFewest = 6;  // errors
  const auto [first, count] = free.range(UnknownGroup::geometric);
  if (has_known_base(model, free) || count < kFewest || measurements.observations.empty()) {
    return {};
  }
  const NormalSums sums = normal_sums(model, measurements, fit, free);
  const Eigen::LDLT<MatrixXd> JtJ(sums.information);
  const VectorXd x = JtJ.solve(sums.right_side).segment(first, count);
  MatrixXd usual = JtJ.solve(sums.cross).middleRows(first, count);
  for (Index p = 0; p < usual.cols(); ++p) {
    usual.col(p) *= usual_error(model, model.parameters[static_cast<std::size_t>(p)]);
  }
  VectorXd errors(count);
  for (Index i = 0; i < count; ++i) {
    errors[i] = fit.errors[static_cast<Index>(free.geometric()[static_cast<std::size_t>(i)])];
  }
  const MatrixXd inverse = JtJ.solve(MatrixXd::Identity(sums.information.rows(), sums.information.cols()));
  const auto [slope, explained, left] =
      regression(x, errors, usual * usual.transpose() + sums.variance * inverse.block(first, first, count, count));
  if (!std::isfinite(slope) || !(left > 0.0)) {
    return {};
  }
  const auto freedom = static_cast<double>(count - 1);
  return {.factor = 1.0 / (1.0 - slope), .p_value = f_upper_tail(explained / left * freedom, 1.0, freedom)};
}

namespace {

// Residuals e and, for each station, their derivative c by a factor on its lengths, without the part that the unknowns
// explain.
struct ScaleColumns {
  MatrixXd columns;  // the last one is e
  VectorXd squares;  // of the columns with that part
  double rows = 0.0;
};

ScaleColumns scale_columns(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                           const Unknowns& free) {
  constexpr std::size_t kMostConfigurations = 3000;
  constexpr double kStep = 1e-3;
  constexpr double kLeastPivot = 1e-9;
  const TrialSample sample = trial_sample(model, measurements, free, kMostConfigurations);
  const auto whitened = [&](const Measurements& rows) {
    return LeastSquaresProblem(model, rows, sample.free).whitened(fit);
  };
  const WhitenedSystem system = whitened(sample.measurements);
  const WhitenedSystem stretched = whitened(longer_about_means(sample.measurements, 1.0 + kStep));
  const Index rows = system.blocks.back();
  MatrixXd columns = MatrixXd::Zero(rows, std::ssize(measurements.stations) + 1);
  const std::vector<std::int16_t> station = stations_of_configurations(sample.measurements);
  for (std::size_t c = 0; c + 1 < system.blocks.size(); ++c) {
    const auto own = Eigen::seq(system.blocks[c], system.blocks[c + 1] - 1);
    columns(own, station[c]) = (stretched.residual(own) - system.residual(own)) / kStep;
  }
  columns.rightCols<1>() = system.residual.head(rows);
  return {.columns = outside_span(range_basis(system.jacobian.topRows(rows), kLeastPivot), columns),
          .squares = columns.colwise().squaredNorm(),
          .rows = static_cast<double>(rows)};
}

}  // namespace

// Least squares of e on one c after the other.
StationScales scales_of_stations(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                                 const Unknowns& free) {
  constexpr double kLeastShown = 1e-6;   // share of c^2
  constexpr double kFalseAlarms = 1e-4;  // among all stations
  const auto count = std::ssize(measurements.stations);
  const auto [columns, squares, rows] = scale_columns(model, measurements, fit, free);
  MatrixXd left = columns;
  const auto rms = [&, n = rows] { return std::sqrt(left.rightCols<1>().squaredNorm() / n); };
  StationScales result{.stations = {}, .misfit = rms(), .freedom = static_cast<double>(left.rows())};
  std::vector<Index> chosen;
  const Index most = std::max<Index>({1, std::min<Index>((count - 1) / 2, 3), count / 10});
  while (std::ssize(chosen) < most && result.freedom > 1.0) {
    const VectorXd shown = left.colwise().squaredNorm();
    const VectorXd along = left.transpose() * left.rightCols<1>();
    const VectorXd gains =
        (shown.array() > kLeastShown * squares.array()).select(along.array().square() / shown.array(), 0.0).head(count);
    Index best = 0;
    const double gain = gains.maxCoeff(&best);
    const double F = gain / std::max(shown[count] - gain, 1e-300) * (result.freedom - 1.0);
    if (!(static_cast<double>(count) * f_upper_tail(F, 1.0, result.freedom - 1.0) < kFalseAlarms)) {
      break;
    }
    chosen.push_back(best);
    const VectorXd unit = left.col(best).normalized();
    left -= unit * (unit.transpose() * left).eval();
    result.freedom -= 1.0;
  }
  result.left = rms();
  if (!chosen.empty()) {
    const VectorXd x = shortest_solution(columns(Eigen::all, chosen), VectorXd(columns.rightCols<1>()));
    for (Index i = 0; i < x.size(); ++i) {
      result.stations.push_back(
          {.station = static_cast<std::size_t>(chosen[static_cast<std::size_t>(i)]), .factor = 1.0 - x[i]});
    }
  }
  return result;
}

double nominal_misfit(const ErrorModel& model, const Measurements& measurements, double factor) {
  const Measurements rows = longer(measurements, factor);
  const Estimate nominal = nominal_start(model, rows);
  const double cost = LeastSquaresProblem(model, rows, Unknowns(model, nominal.frames.targets, {})).cost(nominal);
  return std::sqrt(cost / dimension(rows));
}

}  // namespace kdl_calibration
