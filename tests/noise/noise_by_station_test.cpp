// Instruments of different quality at several stations: their noise against closed forms and simulated truth.

#include <gmock/gmock.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/calibrated_arm.hpp"
#include "kdl_calibration/result_file.hpp"
#include "measurements/stations.hpp"
#include "noise/noise_parts.hpp"

namespace kdl_calibration::noise_by_station_test {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using ::testing::Contains;
using ::testing::HasSubstr;

constexpr double kFine = 2e-5;    // [m]
constexpr double kCoarse = 3e-4;  // [m]

CalibrationOptions geometry(Weights weights) {
  CalibrationOptions options = testing::geometry_alone();
  options.noise.weights = weights;
  return options;
}

std::vector<TargetFrame> one_target() { return testing::targets_at({{0.05, 0.2, 0.1}}); }

// Noise [m] and, of orientations, [rad] along every measured direction of the rows of each station.
Measurements disturbed(Measurements rows, const std::vector<double>& sigmas, Random& random,
                       const std::vector<double>& angles = {}) {
  for (Observation& row : rows.observations) {
    const double sigma = sigmas[station_of(row)];
    if (auto* const distance = std::get_if<Distance>(&row.reading)) {
      distance->length += sigma * random.normal();
      continue;
    }
    const Vector3d noise = sigma * Vector3d(random.normal(), random.normal(), random.normal());
    row.position() += directions(row.reading, row.position()) * noise;
    if (auto* const pose = std::get_if<Pose>(&row.reading)) {
      const double angle = angles[station_of(row)];
      const Vector3d turn = angle * Vector3d(random.normal(), random.normal(), random.normal());
      pose->orientation = pose->orientation * Eigen::Quaterniond(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
    }
  }
  return rows;
}

// The sum of squares that a rigid motion leaves (Umeyama 1991).
double left_by_rigid_motion(const MatrixXd& from, const MatrixXd& to) {
  const Eigen::Matrix4d X = Eigen::umeyama(from, to, false);
  return ((X * from.colwise().homogeneous()).topRows(3) - to).squaredNorm();
}

// A pure registration: arm and target are exact, each station's base is free. The stations are independent problems, so
// that Helmert's estimate of each variance is what is left of its 3 n coordinates over 3 n - 6.
TEST(NoiseByStation, OfFreeBasesIsWhatEachRigidMotionLeaves) {
  testing::VirtualExperiment experiment({.targets = one_target(), .sizes = {.length = 0.0, .angle = 0.0}});
  experiment.robot = robot_at_stations(experiment.robot, 3, experiment.random);
  const Measurements exact = testing::without_sigmas(experiment.measure(60));
  const std::vector<double> sigmas = {kFine, kCoarse, 4.0 * kFine};
  const Measurements rows = disturbed(exact, sigmas, experiment.random);
  const ErrorModel model = model_at_stations(rows, experiment.model);
  const Estimate truth = experiment.robot.truth;
  Unknowns bases = Unknowns(model, truth.frames.targets, {}).with_group(model, UnknownGroup::base);
  ASSERT_EQ(bases.size(), 18);
  const FitProblem problem{.model = model, .measurements = rows, .start = truth, .free = bases};
  FitProblem fitted = problem;
  fitted.start = fit(problem).estimate;

  std::vector<double> variances;
  for (std::size_t station = 0; station < 3; ++station) {
    const auto own = [&](const Measurements& all) {
      MatrixXd points(3, 20);
      Eigen::Index column = 0;
      for (const Observation& row : all.observations) {
        if (station_of(row) == station) {
          points.col(column++) = row.position();
        }
      }
      EXPECT_EQ(column, 20);
      return points;
    };
    variances.push_back(left_by_rigid_motion(own(exact), own(rows)) / (3.0 * 20.0 - 6.0));
  }
  const double least = *std::min_element(variances.begin(), variances.end());
  const std::vector<NoiseFactors> found = noise_by_station(fitted, {});
  ASSERT_EQ(found.size(), 3U);
  for (std::size_t station = 0; station < 3; ++station) {
    EXPECT_NEAR(found[station].length, std::sqrt(variances[station] / least), 1e-4 * found[station].length) << station;
    EXPECT_EQ(found[station].orientation, 1.0F);
  }

  // The same with a stated sigma: factors on it. Residuals and closed form are not as exact as 1 + (v / s^2 - 1).
  Measurements stated = rows;
  for (Observation& row : stated.observations) {
    row.sigma = kFine / 2.0;
  }
  const std::vector<NoiseFactors> of_stated =
      noise_by_station({.model = model, .measurements = stated, .start = fitted.start, .free = bases}, {});
  ASSERT_EQ(of_stated.size(), 3U);
  EXPECT_NEAR(of_stated[1].length, std::sqrt(variances[1]) / (kFine / 2.0), 1e-2 * of_stated[1].length);
}

// By chance alone in one of a thousand files.
TEST(NoiseByStation, OfLikeInstrumentsIsOne) {
  int found = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    testing::VirtualExperiment experiment(
        {.targets = one_target(), .sizes = {.length = 0.0, .angle = 0.0}, .random = Random(seed)});
    experiment.robot = robot_at_stations(experiment.robot, 2, experiment.random);
    const Measurements rows =
        disturbed(testing::without_sigmas(experiment.measure(40)), {kFine, kFine}, experiment.random);
    const ErrorModel model = model_at_stations(rows, experiment.model);
    const Estimate truth = experiment.robot.truth;
    const Unknowns bases = Unknowns(model, truth.frames.targets, {}).with_group(model, UnknownGroup::base);
    FitProblem problem{.model = model, .measurements = rows, .start = truth, .free = bases};
    problem.start = fit(problem).estimate;
    found += noise_by_station(problem, {}).empty() ? 0 : 1;
  }
  EXPECT_LE(found, 1);
}

// How an instrument measures.
struct Way {
  std::string name;
  bool poses = false;
  bool heights = false;
  int configurations = 60;
  double misfit = 0.0;  // [m] of the arm, which all stations see
};

Measurements measured(testing::VirtualExperiment& experiment, const Way& way) {
  experiment.robot = robot_at_stations(experiment.robot, way.heights ? 4 : 2, experiment.random);
  Measurements rows = testing::without_sigmas(experiment.measure(way.configurations));
  std::vector<Vector3d> shared;
  for (Eigen::Index c = 0; c < rows.joint_values.cols(); ++c) {
    shared.push_back(way.misfit * normal_vector(experiment.random));
  }
  for (Observation& row : rows.observations) {
    row.position() += shared[static_cast<std::size_t>(row.configuration)];
  }
  return way.heights ? testing::along(rows, testing::kHeight) : rows;
}

// The sizes that are found, and the weights that follow from them. Not of distances alone: stations are then anchors of
// one instrument.
TEST(NoiseByStation, WeighsTheRowsOfEveryKindOfReading) {
  for (const Way& way :
       {Way{.name = "points"}, Way{.name = "points, misfit", .misfit = 5e-5}, Way{.name = "poses", .poses = true},
        Way{.name = "heights", .heights = true, .configurations = 120}}) {
    testing::Distances experiment(3);
    if (way.poses) {
      static_cast<testing::VirtualExperiment&>(experiment) =
          testing::VirtualExperiment({.targets = testing::as_frames(one_target()), .random = Random(3)});
    }
    const Measurements exact = measured(experiment, way);
    const std::size_t stations = exact.stations.size();
    std::vector<double> sigmas(stations, kFine);
    sigmas.back() = kCoarse;
    const Measurements rows = disturbed(exact, sigmas, experiment.random, {1e-4, 1e-3});
    const Calibration found = calibrate(testing::bundled_robot(), rows, geometry(Weights::automatic));
    EXPECT_TRUE(found.trusted()) << way.name;
    const NoiseReport& noise = found.parts().fitted->noise;
    ASSERT_EQ(noise.stations.size(), stations) << way.name;
    EXPECT_NEAR(noise.stations.back().length / noise.stations.front().length, kCoarse / kFine,
                (way.misfit > 0.0 ? 0.6 : 0.3) * kCoarse / kFine)
        << way.name;
    EXPECT_NEAR(noise.sigma_at(0), std::hypot(kFine, way.misfit), 0.25 * noise.sigma_at(0)) << way.name;
    EXPECT_NEAR(noise.sigma_at(stations - 1), std::hypot(kCoarse, way.misfit), 0.2 * kCoarse) << way.name;
    if (way.poses) {
      EXPECT_NEAR(noise.stations.back().orientation / noise.stations.front().orientation, 10.0, 2.5);
    }
    EXPECT_THAT(found.warnings(), Contains(HasSubstr("the stations measure unlike: "))) << way.name;

    // As good as if the coarse station had been left out, where the others determine the arm.
    const double error = testing::distance_from_truth(found, experiment);
    EXPECT_LT(error, 8.0 * std::hypot(kFine, way.misfit)) << way.name;
    const Calibration equal = calibrate(testing::bundled_robot(), rows, geometry(Weights::equal));
    EXPECT_LT(error, 0.7 * testing::distance_from_truth(equal, experiment)) << way.name;
  }
}

TEST(NoiseByStation, IsThatOfTheRadiusAlsoAfterReading) {
  testing::Tracker experiment(5, 2);
  const Measurements rows = disturbed(experiment.measured(50), {kFine, kCoarse}, experiment.random);
  const Robot& robot = testing::bundled_robot();
  const Calibration found = calibrate(robot, rows, geometry(Weights::automatic));
  const std::filesystem::path file = std::filesystem::temp_directory_path() / "kdl_calibration_by_station_test.json";
  write_result(file, robot, rows, found);
  const Calibration read = load_calibration(file, robot);
  std::filesystem::remove(file);
  const MatrixXd q = experiment.configurations(1);
  for (const Calibration* each : {&found, &read}) {
    const auto radius = [&](const std::string& station) {
      return each->arm().predict(q.col(0), "A", PredictionFrame::measuring, station).radius_95;
    };
    // 95 % of the chi distribution with three degrees of freedom lie within 2.795 sigma.
    EXPECT_NEAR(radius("S2"), 2.795 * kCoarse, 0.25 * 2.795 * kCoarse);
    EXPECT_LT(radius("S1"), 2.0 * 2.795 * kFine);
    EXPECT_LT(each->arm().predict(q.col(0), "A", PredictionFrame::base).radius_95, 2.0 * 2.795 * kFine);
  }
  EXPECT_NEAR(read.arm().predict(q.col(0), "A", PredictionFrame::measuring, "S2").radius_95,
              found.arm().predict(q.col(0), "A", PredictionFrame::measuring, "S2").radius_95, 1e-12);
}

}  // namespace
}  // namespace kdl_calibration::noise_by_station_test
