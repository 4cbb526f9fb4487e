#include "kdl_calibration/noise_model.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "estimation/identification.hpp"
#include "estimation/residual_options.hpp"
#include "model/kinematics.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::noise_model_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Observation at(const Vector3d& position, double sigma = 0.0) { return {.reading = Point{position}, .sigma = sigma}; }

const TrackerNoise kTracker{.range = 1e-5, .range_per_metre = 3e-6, .transverse = 4e-5, .transverse_per_metre = 7e-6};

TEST(NoiseModel, CovarianceOfATrackerIsAlongAndAcrossItsLineOfSight) {
  const NoiseModel noise{.independent = Vector3d::Ones(), .tracker = kTracker};
  const Vector3d line = Vector3d(2.0, -3.0, 6.0) / 7.0;
  const Vector3d across = line.cross(Vector3d::UnitX()).normalized();
  const double range = 1e-5 + 14.0 * 3e-6;
  const double transverse = 4e-5 + 14.0 * 7e-6;
  const Matrix3d covariance = point_covariance(noise, at(14.0 * line));
  EXPECT_LT((covariance * line - range * range * line).norm(), 1e-22);
  EXPECT_LT((covariance * across - transverse * transverse * across).norm(), 1e-22);
  EXPECT_LT((covariance - covariance.transpose()).norm(), 1e-22);
  EXPECT_NEAR(covariance.trace(), range * range + 2.0 * transverse * transverse, 1e-22);
  EXPECT_NEAR(point_covariance(noise, at(Vector3d::Zero())).trace(), 1e-10 + 2.0 * 16e-10, 1e-22);
}

TEST(NoiseModel, StatedSigmasComeFirstAndAxesWithoutATracker) {
  const NoiseModel axes{.independent = Vector3d(1.0, 2.0, 3.0)};
  const NoiseModel tracker{.tracker = kTracker};
  EXPECT_EQ(point_covariance(axes, at(Vector3d::Ones())), Matrix3d(Vector3d(1.0, 4.0, 9.0).asDiagonal()));
  for (const NoiseModel& noise : {axes, tracker}) {
    EXPECT_EQ(point_covariance(noise, at(Vector3d::Ones(), 0.5)), Matrix3d(0.25 * Matrix3d::Identity()));
  }
  EXPECT_EQ(point_covariance({}, at(Vector3d::Ones())), Matrix3d(Matrix3d::Zero()));
}

TEST(NoiseModel, KnowsWhatIsAlikeInEveryDirectionAndWhatIsShared) {
  struct Case {
    NoiseModel noise;
    bool alike;
    bool isotropic;
    bool absolute;
    bool misfit;
  };
  const Vector3d even = Vector3d::Constant(2.0);
  const std::vector<Case> cases = {
      {{}, true, true, false, false},
      {{.independent = even}, true, true, true, false},
      {{.independent = Vector3d(2, 2, 1)}, false, false, true, false},
      {{.independent = Vector3d(2, 1, 2)}, false, false, true, false},
      {{.common = even}, true, false, true, false},
      {{.common = Vector3d(0, 0, 1)}, false, false, true, false},
      {{.tracker = kTracker}, false, false, true, false},
      {{.independent = even, .misfit = 1.0}, true, false, true, true},
      {{.independent = even, .target_misfit = 1.0}, true, false, true, true},
      {{.orientation = 1.0}, true, true, false, false},
  };
  for (std::size_t i = 0; i < cases.size(); ++i) {
    EXPECT_EQ(cases[i].noise.is_alike_in_every_direction(), cases[i].alike) << i;
    EXPECT_EQ(cases[i].noise.is_isotropic(), cases[i].isotropic) << i;
    EXPECT_EQ(cases[i].noise.is_absolute(), cases[i].absolute) << i;
    EXPECT_EQ(cases[i].noise.has_misfit(), cases[i].misfit) << i;
  }
}

TEST(NoiseModel, InformationIsOneOverTheSquareOfWhatIsStated) {
  const ResidualOptions plain{.orientation_length = 0.5};
  const ResidualOptions stated{.noise = {.independent = Vector3d::Constant(0.25), .orientation = 0.125}};
  EXPECT_EQ(position_information(plain, at(Vector3d::Zero())), 1.0);
  EXPECT_EQ(position_information(plain, at(Vector3d::Zero(), 0.5)), 4.0);
  EXPECT_EQ(position_information(stated, at(Vector3d::Zero())), 16.0);
  EXPECT_EQ(position_information(stated, at(Vector3d::Zero(), 0.5)), 4.0);
  EXPECT_EQ(orientation_information(plain, 8.0), 2.0);
  EXPECT_EQ(orientation_information(stated, 8.0), 64.0);
}

TEST(NoiseModel, ATrackersOwnNoiseIsWhitenedAlongAndAcrossTheLineOfSight) {
  // Range 10 um, transverse 20 um + 15 um/m: at 8 m the transverse error is fourteen times the other. Knowing that
  // must predict better than ignoring it.
  const TrackerNoise tracker{.range = 1e-5, .transverse = 2e-5, .transverse_per_metre = 1.5e-5};
  testing::VirtualExperiment experiment({.X_WB = Eigen::Isometry3d(Eigen::Translation3d(8.0, 0.0, 0.0))});
  const ErrorModel& model = experiment.model;
  const Unknowns& free = experiment.free;
  double with = 0.0;
  double without = 0.0;
  double chi_square = 0.0;
  const int runs = 40;
  for (int run = 0; run < runs; ++run) {
    experiment.restart(Random(9, static_cast<std::uint64_t>(run)));
    Random& random = experiment.random;
    Measurements measured = experiment.measure(30);
    for (Observation& o : measured.observations) {
      const double distance = o.position().norm();
      const Eigen::Vector3d line = o.position() / distance;
      const Eigen::Vector3d n{random.normal(), random.normal(), random.normal()};
      const double across = tracker.transverse + tracker.transverse_per_metre * distance;
      o.position() += tracker.range * line.dot(n) * line + across * (n - line.dot(n) * line);
    }
    JointOptions whitened;
    whitened.residuals.noise.tracker = tracker;
    const Identification aware = testing::joint_fit(experiment, measured, whitened);
    const Random fresh = random;  // both at the same configurations
    with += std::pow(testing::held_out_rms(experiment, aware.estimate, 50), 2);
    random = fresh;
    without += std::pow(testing::held_out_rms(experiment, testing::joint_fit(experiment, measured).estimate, 50), 2);
    chi_square += LeastSquaresProblem(model, measured, free, whitened.residuals).linearise(aware.estimate).cost / runs;
  }
  EXPECT_LT(with, 0.9 * without);
  EXPECT_NEAR(chi_square, 270.0 - 33.0, 4.0 * std::sqrt(2.0 * 237.0 / runs));
}

}  // namespace
}  // namespace kdl_calibration::noise_model_test
