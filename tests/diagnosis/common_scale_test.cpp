#include "diagnosis/common_scale.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/calibrate.hpp"

namespace kdl_calibration::common_scale_test {
namespace {

using ::testing::AllOf;
using testing::bundled_robot;
using ::testing::Contains;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::kNoise;

// The lengths of one station, multiplied by `factor`.
Measurements with_scale(Measurements measurements, int station, double factor) {
  for (Observation& observation : measurements.observations) {
    if (observation.station == station) {
      testing::scale_lengths(observation, factor);
    }
  }
  return measurements;
}

Calibration calibrated(const Measurements& measurements) {
  CalibrationOptions options = testing::geometry_alone();
  options.diagnosis.try_readings = true;
  return calibrate(bundled_robot(), measurements, options);
}

StationScales scales_of(const Measurements& measurements) {
  const Calibration found = calibrate(bundled_robot(), measurements, testing::geometry_alone());
  const CalibrationParts& parts = found.parts();
  return scales_of_stations(parts.model, measurements, parts.estimate, parts.free);
}

struct Way {
  const char* name;
  Measurements measurements;
  int station;
  double factor;
  double tolerance;  // five sigma of the factor, or more
};

std::vector<Way> ways(std::uint64_t seed) {
  return {{"a tracker", testing::Tracker(seed).measured(36, kNoise), 1, 1.002, 2e-4},
          {"a place of a plate", testing::Ball(seed).touched(6, 72, kNoise), 3, 0.97, 1e-3},
          {"heights", testing::Heights(seed).measured(48, kNoise), 2, 1.01, 1e-3},
          {"an unknown anchor", testing::Distances(seed).measured(3, false, 90, kNoise), 0, 0.99, 1e-3},
          {"a length between two poses", testing::Lengths(seed).measured(120, kNoise), 17, 1.02, 1e-3}};
}

TEST(StationScales, NameTheStationWhoseLengthsContradictTheOthersAndTheFactor) {
  for (const Way& way : ways(1)) {
    const StationScales found = scales_of(with_scale(way.measurements, way.station, way.factor));
    ASSERT_EQ(found.stations.size(), 1U) << way.name;
    EXPECT_EQ(found.stations[0].station, static_cast<std::size_t>(way.station)) << way.name;
    EXPECT_NEAR(found.stations[0].factor * way.factor, 1.0, way.tolerance) << way.name;
    EXPECT_LT(found.left, 0.2 * found.misfit) << way.name;
  }
}

TEST(StationScales, AccuseNoCorrectStation) {
  for (std::uint64_t seed = 11; seed <= 12; ++seed) {
    for (const Way& way : ways(seed)) {
      EXPECT_THAT(scales_of(way.measurements).stations, IsEmpty()) << way.name << ' ' << seed;
    }
  }
}

TEST(StationScales, AreDoubtedByName) {
  const Measurements correct = testing::Lengths(6).measured(120, kNoise);
  EXPECT_TRUE(calibrated(correct).trusted());
  const Calibration found = calibrated(with_scale(with_scale(correct, 17, 1.02), 30, 0.98));
  EXPECT_FALSE(found.trusted());
  ASSERT_FALSE(found.doubts().empty());
  EXPECT_EQ(found.doubts()[0].cause, Cause::scale);
  EXPECT_THAT(found.doubts()[0].message,
              AllOf(HasSubstr("lengths of the stations contradict each other"), HasSubstr("'L31' 1.02"),
                    HasSubstr("'L18' 0.98"), HasSubstr("(or a row there is wrong)")));
}

TEST(StationScales, OfTwoStationsOfFiveAreDoubted) {
  const Measurements correct = testing::Tracker(1, 5).measured(60, kNoise);
  const Calibration found = calibrated(with_scale(with_scale(correct, 0, 0.998), 3, 1.003));
  ASSERT_FALSE(found.doubts().empty());
  EXPECT_THAT(found.doubts()[0].message, AllOf(HasSubstr("'S1' 1.002"), HasSubstr("'S4' 0.997")));
}

// A wrong known base shifts the points of a station that are far from the origin of its frame. That is no scale.
TEST(StationScales, AreNoShiftOfAKnownBase) {
  testing::Tracker experiment(3);
  Measurements measurements = experiment.measured(36, kNoise);
  for (Observation& o : measurements.observations) {
    o.position() += Eigen::Vector3d(40.0, 10.0, 5.0);
    o.position() += o.station == 1 ? Eigen::Vector3d(0.004, 0.001, 0.0005) : Eigen::Vector3d::Zero();
  }
  CalibrationOptions options = testing::geometry_alone();
  options.diagnosis.try_readings = true;
  for (std::size_t s = 0; s < 3; ++s) {
    Eigen::Isometry3d X_WB = experiment.robot.truth.frames.base(s);
    X_WB.pretranslate(Eigen::Vector3d(40.0, 10.0, 5.0));
    options.parameters.known.bases.push_back({measurements.stations[s], X_WB});
  }
  for (const Doubt& doubt : calibrate(bundled_robot(), measurements, options).doubts()) {
    EXPECT_NE(doubt.cause, Cause::scale) << doubt.message;
  }
}

// Effects that are chosen automatically can absorb a wrong scale.
TEST(StationScales, AreNotHiddenByEffects) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const Measurements heights = testing::along(testing::Tracker(seed).measured(40, kNoise), testing::kHeight);
    EXPECT_THAT(calibrate(bundled_robot(), with_scale(heights, 0, 1.002)).doubts(),
                Contains(Field(&Doubt::message, HasSubstr("'S1' 0.998"))))
        << seed;
  }
}

}  // namespace
}  // namespace kdl_calibration::common_scale_test
