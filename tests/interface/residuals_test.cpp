#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstddef>
#include <vector>

#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/simulation.hpp"
#include "kdl_calibration/validation.hpp"

namespace kdl_calibration::testing::residuals_test {
namespace {

using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr double kSigma = 3e-5;
const Vector3d kNormal = Vector3d(2.0, -1.0, 2.0) / 3.0;

/// Of each configuration one whole point, one coordinate of the second and two of the third.
struct Residuals : ::testing::Test {
  Residuals() {
    for (Observation& row : measurements.observations) {
      const Vector3d p = row.position();
      const Matrix3d along = kNormal * kNormal.transpose();
      if (row.target == 1) {
        row.reading = Coordinates{.position = along * p, .normal = kNormal, .count = 1};
      } else if (row.target == 2) {
        row.reading = Coordinates{.position = p - along * p, .normal = kNormal, .count = 2};
      }
      row.sigma = kSigma;
    }
    options.priors.automatic = false;
    options.effects.automatic = false;
    options.noise.weights = Weights::equal;
    options.diagnosis.try_readings = false;
  }

  static Matrix3d projector(const Observation& row) {
    const Matrix3d along = kNormal * kNormal.transpose();
    return row.target == 0 ? Matrix3d::Identity() : row.target == 1 ? along : Matrix3d(Matrix3d::Identity() - along);
  }

  Robot robot = load_robot(URDF_DIR "/fanuc_r2000ic_165f.urdf");
  Measurements measurements = simulate(robot, {.configurations = 60, .noise = kSigma, .seed = 3}).measurements;
  CalibrationOptions options;
};

TEST_F(Residuals, AreMeasuredMinusPredictedAlongTheMeasuredDirections) {
  const Calibration found = calibrate(robot, measurements, options);
  const CalibratedArm arm = found.arm();
  const std::vector<RowResidual> rows = residuals(robot, measurements, found);
  ASSERT_EQ(rows.size(), measurements.observations.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Observation& row = measurements.observations[i];
    const Vector3d predicted =
        arm.predict(measurements.joint_values.col(row.configuration),
                    measurements.targets[static_cast<std::size_t>(row.target)], PredictionFrame::measuring)
            .position;
    const Matrix3d P = projector(row);
    EXPECT_LT((rows[i].position - P * (row.position() - predicted)).norm(), 1e-12);
    EXPECT_LT((rows[i].whitened - P * rows[i].whitened).norm(), 1e-9);
    EXPECT_EQ(rows[i].rotation, Vector3d::Zero());
  }
}

TEST_F(Residuals, AreWhitenedByTheNoiseOfARow) {
  const std::vector<RowResidual> rows = residuals(robot, measurements, calibrate(robot, measurements, options));
  const double factor = rows[0].whitened.norm() / rows[0].position.norm();
  EXPECT_NEAR(factor * kSigma, 1.0, 0.2);  // but for the variance that the residuals show
  for (const RowResidual& row : rows) {
    EXPECT_LT((row.whitened - factor * row.position).norm(), 1e-6 * row.whitened.norm());
  }
}

TEST_F(Residuals, AreOrthogonalToTheJacobianWithEqualWeights) {
  const Calibration found = calibrate(robot, measurements, options);
  const MatrixXd J = position_jacobian(robot, measurements, found);
  const std::vector<RowResidual> rows = residuals(robot, measurements, found);
  ASSERT_EQ(J.rows(), 3 * static_cast<Eigen::Index>(rows.size()));
  ASSERT_EQ(J.cols(), static_cast<Eigen::Index>(found.estimated().size()));
  VectorXd r(J.rows());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    r.segment<3>(3 * static_cast<Eigen::Index>(i)) = rows[i].position;
  }
  for (Eigen::Index column = 0; column < J.cols(); ++column) {
    EXPECT_GT(J.col(column).norm(), 0.1);
    EXPECT_LT(std::abs(J.col(column).dot(r)), 1e-7 * J.col(column).norm() * r.norm()) << found.estimated()[column];
  }
}

TEST_F(Residuals, WantTheMeasurementsOfTheFit) {
  const Calibration found = calibrate(robot, measurements, options);
  Measurements others = measurements;
  others.observations.pop_back();
  EXPECT_THROW(residuals(robot, others, found), InputError);
  EXPECT_THROW(position_jacobian(robot, others, found), InputError);
}

}  // namespace
}  // namespace kdl_calibration::testing::residuals_test
