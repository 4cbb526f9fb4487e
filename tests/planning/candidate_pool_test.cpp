// Packed candidates and tasks against their rows written out.

#include "planning/candidate_pool.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>

#include "kdl_calibration/noise_model.hpp"
#include "robot/joint_ranges.hpp"
#include "support.hpp"

namespace kdl_calibration::candidate_pool_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Fixture {
  ErrorModel model = complete_model(testing::fanuc());
  Random random{7};

  Experiment experiment(const PointNoise& noise) const {
    return nominal_experiment(model, testing::targets_at({{0.1, 0.2, 0.03}, {-0.05, 0.15, 0.1}}), noise);
  }
  MatrixXd configurations(int count) { return random_configurations(published_ranges(model.joints), count, random); }
  // Positive definite, with targets known as well as the chain in a basis where that is of size one.
  MatrixXd covariance(const Experiment& experiment) {
    MatrixXd R(columns(experiment), columns(experiment));
    for (double& element : R.reshaped()) {
      element = random.normal();
    }
    R.bottomRows(experiment.free.range(UnknownGroup::targets).count) *= experiment.noise.sigma;
    return R * R.transpose();
  }
};

std::vector<PointNoise> noises() {
  return {{.sigma = 5e-5},
          {.sigma = 5e-5, .configuration_sigma = 8e-5},
          {.configuration_sigma = 2e-5,
           .tracker = TrackerNoise{.range = 1e-5, .range_per_metre = 2e-6, .transverse = 4e-5},
           .tracker_position = {4.0, -1.0, 0.5}}};
}

TEST(CandidatePool, HasTheInformationOfItsCandidatesInABasisWhereItsMeanIsTheIdentity) {
  Fixture f;
  const MatrixXd q = f.configurations(1100);
  for (const PointNoise& noise : noises()) {
    const Experiment experiment = f.experiment(noise);
    const MatrixXd given = MatrixXd(1e3 * f.covariance(experiment));
    const CandidatePool pool(experiment, q, given, 2);
    const PointRows& rows = pool.rows();
    EXPECT_EQ(pool.size(), 1100);
    const MatrixXd first = information(experiment, MatrixXd(q.leftCols(1000))) / 1000.0;
    EXPECT_LT((pool.mean_information() - rows.in_basis(first)).norm(), 1e-9 * pool.mean_information().norm());
    // Once the targets are eliminated.
    const MatrixXd M = rows.in_basis(first + given);
    const Index c = rows.chain_columns();
    const Index t = rows.columns() - c;
    const MatrixXd schur = M.topLeftCorner(c, c) - M.topRightCorner(c, t) * M.bottomRightCorner(t, t).llt().solve(
                                                                                MatrixXd(M.bottomLeftCorner(t, c)));
    EXPECT_LT((schur - MatrixXd::Identity(c, c)).cwiseAbs().maxCoeff(), 1e-8);
    for (const Index i : {Index{0}, Index{1023}, Index{1024}, Index{1099}}) {
      const MatrixXd A = pool.block(i);
      const MatrixXd expected = rows.in_basis(information(experiment, MatrixXd(q.col(i))));
      EXPECT_LT((A.transpose() * A - expected).norm(), 1e-9 * expected.norm()) << i;
      const MatrixXd unpacked = rows.unpacked(pool.features().row(i).transpose().cast<double>(), 1.0);
      EXPECT_LT((unpacked - expected).norm(), 1e-5 * expected.norm()) << i;
    }
  }
}

TEST(CandidatePool, TracesAreThoseOfTheRows) {
  Fixture f;
  const MatrixXd q = f.configurations(1100);
  for (const PointNoise& noise : noises()) {
    const Experiment experiment = f.experiment(noise);
    const CandidatePool pool(experiment, q, MatrixXd::Zero(columns(experiment), columns(experiment)), 2);
    const std::vector<MatrixXd> forms = {f.covariance(experiment), f.covariance(experiment)};
    const Eigen::MatrixXf traces = pool.traces(forms, 1090, 2);
    ASSERT_EQ(traces.rows(), 1090);
    ASSERT_EQ(traces.cols(), 2);
    for (const Index i : {Index{0}, Index{500}, Index{1023}, Index{1024}, Index{1089}}) {
      for (Index k = 0; k < 2; ++k) {
        const MatrixXd A = pool.block(i);
        const double expected = (A * forms[static_cast<std::size_t>(k)] * A.transpose()).trace();
        EXPECT_NEAR(traces(i, k) / expected, 1.0, 1e-4) << i;
      }
    }
  }
}

// Rows of each target in each configuration.
std::vector<MatrixXd> dense_rows(const PointRows& rows, const MatrixXd& q) {
  std::vector<MatrixXd> result;
  for (Index c = 0; c < q.cols(); ++c) {
    for (const PointBlock& target : rows.target_blocks()) {
      result.push_back(rows.rows(target, q.col(c)));
    }
  }
  return result;
}

TEST(Tasks, HaveTheMeanTheLargestAndThePowerMeanOfTheVariances) {
  Fixture f;
  const Experiment experiment = f.experiment({.sigma = 5e-5});
  const MatrixXd q = f.configurations(1060);
  const CandidatePool pool(experiment, q, MatrixXd::Zero(columns(experiment), columns(experiment)), 1);
  const Tasks tasks(pool.rows(), q, true, 2);
  const MatrixXd C = f.covariance(experiment);
  const std::vector<MatrixXd> all = dense_rows(pool.rows(), q);
  VectorXd variances(static_cast<Index>(all.size()));
  for (Index i = 0; i < variances.size(); ++i) {
    const MatrixXd& J = all[static_cast<std::size_t>(i)];
    variances[i] = (J * C * J.transpose()).trace();
  }
  EXPECT_NEAR(C.cwiseProduct(tasks.mean()).sum() / variances.mean(), 1.0, 1e-10);
  EXPECT_NEAR(tasks.worst(C) / variances.maxCoeff(), 1.0, 1e-4);
  for (const double power : {1.0, 4.0, 16.0}) {
    MatrixXd B;
    const double found = tasks.power_mean(C, power, B);
    const double expected = std::pow(variances.array().pow(power).mean(), 1.0 / power);
    EXPECT_NEAR(found / expected, 1.0, 1e-4) << power;
    // The derivative by each variance: (v / mean)^(power - 1) / n.
    MatrixXd derivative = MatrixXd::Zero(C.rows(), C.cols());
    for (Index i = 0; i < variances.size(); ++i) {
      const MatrixXd& J = all[static_cast<std::size_t>(i)];
      derivative +=
          std::pow(variances[i] / expected, power - 1.0) / static_cast<double>(variances.size()) * J.transpose() * J;
    }
    EXPECT_LT((B - derivative).norm(), 1e-3 * derivative.norm()) << power;
  }
}

}  // namespace
}  // namespace kdl_calibration::candidate_pool_test
