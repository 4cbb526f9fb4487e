#include "diagnosis/common_scale.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "base/distributions.hpp"
#include "diagnosis/trial_fit.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// Sums over all points z, with J the derivatives by what is free and J_all those by every geometric error.
struct NormalSums {
  MatrixXd information;  // J^T J
  MatrixXd cross;        // J^T J_all
  VectorXd right_side;   // J^T z
};

NormalSums normal_sums(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                       const Unknowns& free) {
  const Unknowns complete = Unknowns(model, fit.targets, {}).with_all(model, UnknownGroup::geometric);
  const PositionPredictor of_free(model, fit, free);
  const PositionPredictor of_all(model, fit, complete);
  std::vector<std::vector<Matrix3Xd>> J;
  std::vector<std::vector<Matrix3Xd>> J_all;
  for (Index i = 0; i < measurements.joint_values.cols(); ++i) {
    J.push_back(of_free.jacobians(measurements, i));
    J_all.push_back(of_all.jacobians(measurements, i));
  }
  const Index columns = J.front().front().cols();
  NormalSums sums{.information = MatrixXd::Zero(columns, columns),
                  .cross = MatrixXd::Zero(columns, static_cast<Index>(model.parameters.size())),
                  .right_side = VectorXd::Zero(columns)};
  for (const Observation& observation : measurements.observations) {
    const auto i = static_cast<std::size_t>(observation.configuration);
    const auto t = static_cast<std::size_t>(observation.target);
    sums.information += J[i][t].transpose() * J[i][t];
    sums.cross += J[i][t].transpose() * J_all[i][t];
    sums.right_side += J[i][t].transpose() * observation.position;
  }
  return sums;
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

}  // namespace

// Points that are f times too far apart give the errors e = (f - 1) / f x, where x is the least-squares solution of
// J x = z. Regression of e on x tests that. The covariance of e is that of the usual errors of the complete model,
// carried into the fit, plus that of the noise. Their common size is unknown, so the test is an F test.
CommonScale common_scale(const ErrorModel& model, const Measurements& measurements, const Estimate& fit,
                         const Unknowns& free) {
  constexpr Index kFewest = 6;  // errors
  constexpr Index kBase = 6;    // columns
  const bool base_free = free.range(UnknownGroup::base).count == kBase;
  const auto [first, count] = free.range(UnknownGroup::geometric);
  if (!base_free || count < kFewest || measurements.observations.empty()) {
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
  const double variance = std::pow(rms_of(model, measurements, fit), 2) / 3.0;
  const MatrixXd inverse = JtJ.solve(MatrixXd::Identity(sums.information.rows(), sums.information.cols()));
  const auto [slope, explained, left] =
      regression(x, errors, usual * usual.transpose() + variance * inverse.block(first, first, count, count));
  if (!std::isfinite(slope) || !(left > 0.0)) {
    return {};
  }
  const auto freedom = static_cast<double>(count - 1);
  return {.factor = 1.0 / (1.0 - slope), .p_value = f_upper_tail(explained / left * freedom, 1.0, freedom)};
}

}  // namespace kdl_calibration
