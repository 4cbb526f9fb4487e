// What one configuration adds, against the whole whitened system and the covariance of means in closed form.

#include "uncertainty/configuration_system.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <string>
#include <utility>
#include <vector>

#include "kdl_calibration/noise_model.hpp"
#include "model/kinematics.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::configuration_system_test {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::VirtualExperiment;

TEST(ConfigurationSystem, RowsAreThoseOfEachConfiguration) {
  Measurements measured;
  for (const int configuration : {3, 1, 3, 0, 1, 3}) {
    measured.observations.push_back({.reading = Point{Vector3d::Zero()}, .configuration = configuration});
  }
  const std::vector<std::pair<std::int32_t, std::vector<std::size_t>>> expected = {
      {0, {3}}, {1, {1, 4}}, {3, {0, 2, 5}}};
  EXPECT_EQ(rows_by_configuration(measured), expected);
}

/// Two repeats of nine configurations, some of them without some targets and orientations.
struct Trial {
  VirtualExperiment experiment;
  Measurements measured;
  FitProblem fit;
  MatrixXd R;

  Trial(const NoiseModel& noise, bool weights)
      : experiment({.targets = testing::as_frames(published_targets())}),
        measured(
            testing::without_sigmas(experiment.measure(9, {.sigma = 1e-4, .orientation_sigma = 2e-4, .repeats = 2}))),
        fit{.model = experiment.model,
            .measurements = measured,
            .start = experiment.robot.truth,
            .free = Unknowns(experiment.model, experiment.targets,
                             {"base.Tx", "base.Ty", "base.Rz", "A.x", "B.y", "B.Rx", "C.Ry"}),
            .options = {.joint = {.residuals = {.noise = noise}}}} {
    measured = subset(measured, [](const Observation& o) {
      return (o.configuration != 4 || o.target == 1) && (o.configuration != 5 || o.target != 1 || o.repeat == 2);
    });
    std::swap(measured.observations[0], measured.observations[7]);
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      Observation& o = measured.observations[row];
      if (o.target == 0 || (o.target == 2 && o.configuration % 3 == 1) || (o.target == 1 && o.repeat == 2)) {
        testing::remove_orientation(o);
      }
      if (weights) {
        fit.options.joint.residuals.row_weights.push_back(row % 3 == 1 ? 0.3 : 1.0);
      }
    }
    fit.start.frames.base().translation().x() += 1e-4;
    R = MatrixXd::Identity(7, 7);
    R.triangularView<Eigen::StrictlyUpper>().setConstant(0.3);
    R *= 2.0;
  }

  std::vector<std::size_t> rows(int configuration) const {
    std::vector<std::size_t> result;
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      if (measured.observations[row].configuration == configuration) {
        result.push_back(row);
      }
    }
    return result;
  }
  double weight(std::size_t row) const { return fit.options.joint.residuals.row_weight(row); }
};

void expect_systems(const Trial& t, const std::string& what) {
  const ConfigurationSystems systems(t.fit, t.R);
  const WhitenedSystem whole =
      LeastSquaresProblem(t.fit.model, t.measured, t.fit.free, t.fit.options.joint.residuals).whitened(t.fit.start);
  const std::vector<int> asked = {3, 0, 8, 4, 5};
  std::vector<std::vector<std::size_t>> rows;
  rows.reserve(asked.size());
  for (const int c : asked) {
    rows.push_back(t.rows(c));
  }
  const std::vector<ConfigurationSystem> found = systems.of(rows);
  ASSERT_EQ(found.size(), asked.size());
  for (std::size_t i = 0; i < asked.size(); ++i) {
    const std::string which = what + ", configuration " + std::to_string(asked[i]);
    const auto block = static_cast<std::size_t>(asked[i]);
    const Index first = whole.blocks[block];
    const MatrixXd J = whole.jacobian.middleRows(first, whole.blocks[block + 1] - first);
    const VectorXd e = whole.residual.segment(first, J.rows());
    const MatrixXd own = found[i].B * t.R;
    EXPECT_LT((own.transpose() * own - J.transpose() * J).norm(), 1e-9 * J.squaredNorm()) << which;
    EXPECT_LT((own.transpose() * found[i].e - J.transpose() * e).norm(), 1e-9 * J.norm() * e.norm()) << which;
    EXPECT_NEAR(found[i].e.squaredNorm(), e.squaredNorm(), 1e-9 * e.squaredNorm()) << which;
  }
}

TEST(ConfigurationSystem, IsThatBlockOfTheWholeSystem) {
  expect_systems(Trial({}, false), "equal weights");
  expect_systems(Trial({}, true), "rows of any weight");
  const NoiseModel noise{.independent = Vector3d::Constant(1e-4), .misfit = 1e-4, .orientation = 3e-4};
  expect_systems(Trial(noise, false), "a misfit");
}

// The covariance of positions along the axes of the flange, of two repeats.
TEST(ConfigurationSystem, HasTheInformationOfItsMeans) {
  const NoiseModel noise{.independent = Vector3d(1e-4, 2e-4, 3e-4),
                         .common = Vector3d(3e-4, 1e-4, 2e-4),
                         .misfit = 2e-4,
                         .target_misfit = 1e-4,
                         .orientation = 3e-4};
  const Trial t(noise, false);
  const ConfigurationSystem found = ConfigurationSystems(t.fit, t.R).of({t.rows(6)})[0];
  const auto X_BF = flange_poses(t.fit.model, t.fit.start, t.measured.joint_values.col(6));
  const Matrix3d R = (t.fit.start.frames.base() * X_BF[0]).linear();
  const MatrixXd covariance = MatrixXd(found.U.transpose() * found.U).inverse();
  for (Index i = 0; i < 3; ++i) {
    for (Index j = 0; j < 3; ++j) {
      const Vector3d shared = noise.common.cwiseAbs2() / 2.0 + Vector3d::Constant(4e-8);
      const Vector3d own = noise.independent.cwiseAbs2() / 2.0 + Vector3d::Constant(1e-8);
      const Matrix3d expected = R.transpose() * Vector3d(shared + (i == j ? own : Vector3d(0, 0, 0))).asDiagonal() * R;
      EXPECT_LT((covariance.block<3, 3>(3 * i, 3 * j) - expected).norm(), 1e-9 * expected.norm()) << i << ", " << j;
    }
  }
}

}  // namespace
}  // namespace kdl_calibration::configuration_system_test
