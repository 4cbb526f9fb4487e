#include "noise/pseudo_values.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "planning/simulation.hpp"
#include "validation/validation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::pseudo_values_test {
namespace {

// Of w(r) r in three dimensions where the row has this weight: (w'(r) r + 3 w(r)) / 3.
double third_of_divergence(Loss loss, double w) {
  const auto weight = [&](double r) {
    return loss == Loss::huber ? std::min(1.0, 2.5 / r) : std::pow(1.0 - std::pow(r / 7.0, 2), 2);
  };
  const double r = loss == Loss::huber ? 2.5 / w : 7.0 * std::sqrt(1.0 - std::sqrt(w));
  const double step = 1e-5 * r;
  return w == 1.0 || loss == Loss::none ? 1.0 : w + r * (weight(r + step) - weight(r - step)) / (2.0 * step) / 3.0;
}

TEST(PseudoValues, AreOffByTheirWeightOverTheMeanSlope) {
  testing::VirtualExperiment experiment;
  const Measurements measured = experiment.measure(8, {.sigma = 1e-3, .repeats = 2});
  const Estimate estimate = nominal_start(experiment.model, measured);
  std::vector<double> weights;
  for (std::size_t row = 0; row < measured.observations.size(); ++row) {
    weights.push_back(row % 7 == 6 ? 1.0 : 0.2 + 0.1 * static_cast<double>(row % 7));
  }
  weights[4] = 0.0;
  weights[5] = 0.9e-6;
  weights[9] = 1.1e-6;
  for (const Loss loss : {Loss::none, Loss::huber, Loss::tukey}) {
    SCOPED_TRACE(static_cast<int>(loss));
    double sum = 0.0;
    double rows = 0.0;
    for (const double weight : weights) {
      sum += weight > 1e-6 ? third_of_divergence(loss, weight) : 0.0;
      rows += weight > 1e-6 ? 1.0 : 0.0;
    }
    const PseudoValues found = pseudo_values(experiment.model, measured, estimate, loss, weights);
    EXPECT_EQ(found.rows, rows);
    ASSERT_EQ(found.row_weights.size(), weights.size());
    ASSERT_EQ(found.measurements.observations.size(), weights.size());
    const KDL::Chain chain = error_chain(experiment.model, estimate.errors);
    for (std::size_t row = 0; row < weights.size(); ++row) {
      SCOPED_TRACE(row);
      EXPECT_EQ(found.row_weights[row], weights[row] > 1e-6 ? 1.0 : 1e-6);
      const Observation& o = measured.observations[row];
      const Eigen::Vector3d predicted =
          testing::kdl_point(chain, estimate, measured.joint_values.col(o.configuration), o.target);
      const Eigen::Vector3d expected = predicted + weights[row] / (sum / rows) * (o.position() - predicted);
      EXPECT_LT((found.measurements.observations[row].position() - expected).norm(), 1e-9);
    }
  }
}

TEST(PseudoValues, AreOfTrainingRowsAlone) {
  testing::VirtualExperiment experiment;
  Measurements measured = experiment.measure(4, {.sigma = 1e-3});
  std::vector<double> weights(12, 1.0);
  for (std::size_t row = 0; row < 3; ++row) {
    measured.observations[row].split = Split::test;
    weights[row] = 0.01;
  }
  const Estimate estimate = nominal_start(experiment.model, measured);
  const PseudoValues found = pseudo_values(experiment.model, measured, estimate, Loss::huber, weights);
  EXPECT_EQ(found.rows, 9.0);
  ASSERT_EQ(found.measurements.observations.size(), 9U);
  for (std::size_t row = 0; row < 9; ++row) {
    const Eigen::Vector3d& before = measured.observations[row + 3].position();
    EXPECT_LT((found.measurements.observations[row].position() - before).norm(), 1e-12) << "of full weight";
  }
}

TEST(PseudoValues, WithoutAnyWeightAreWhereTheyArePredicted) {
  testing::VirtualExperiment experiment;
  const Measurements measured = experiment.measure(2, {.sigma = 1e-3});
  const Estimate& truth = experiment.robot.truth;
  const std::vector<double> none(6, 0.0);
  const PseudoValues found = pseudo_values(experiment.model, measured, truth, Loss::tukey, none);
  EXPECT_EQ(found.rows, 0.0);
  for (const double distance : position_errors(experiment.model, truth, found.measurements)) {
    EXPECT_LT(distance, 1e-12);
  }
}

}  // namespace
}  // namespace kdl_calibration::pseudo_values_test
