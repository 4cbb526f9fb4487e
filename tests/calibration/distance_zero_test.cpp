#include "calibration/distance_zero.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "effects/effect_terms.hpp"
#include "geometry_alone.hpp"
#include "interface/calibration_parts.hpp"
#include "interface/ways_to_measure.hpp"
#include "kdl_calibration/calibrate.hpp"

namespace kdl_calibration::distance_zero_test {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

Measurements longer(Measurements measurements, double zero) {
  for (Observation& row : measurements.observations) {
    if (auto* const distance = std::get_if<Distance>(&row.reading)) {
      distance->length += zero;
    }
  }
  return measurements;
}

const DistanceZero& zero_of(const Calibration& found) { return *found.parts().fitted->distance_zero; }

// Known to the tests alone: all distances are too long by the same length.
TEST(DistanceZero, IsFoundAndTakenOffTheDistances) {
  testing::Distances experiment(3);
  const Measurements right = experiment.measured(3, false, 80, testing::kNoise);
  for (const double zero : {-0.005, 0.002}) {
    const Calibration found = calibrate(testing::bundled_robot(), longer(right, zero), testing::geometry_alone());
    EXPECT_TRUE(found.trusted());
    EXPECT_NEAR(zero_of(found).length, zero, 4.0 * zero_of(found).sigma);
    EXPECT_LT(zero_of(found).sigma, 0.1 * std::abs(zero));
    EXPECT_LT(testing::distance_from_truth(found, experiment), 4.0 * testing::kNoise);
    EXPECT_THAT(found.warnings(), Contains(HasSubstr(zero > 0.0 ? "too long (1 sigma" : "too short (1 sigma")));
  }
}

// Monte Carlo: the stated sigma is the scatter of the zeros that are found.
TEST(DistanceZero, HasTheSigmaOfItsScatter) {
  double squares = 0.0;
  const int count = 30;
  for (int seed = 1; seed <= count; ++seed) {
    testing::Distances experiment(static_cast<std::uint64_t>(seed));
    const Measurements rows = longer(experiment.measured(2, false, 60, testing::kNoise), 0.01);
    const DistanceZero zero = zero_of(calibrate(testing::bundled_robot(), rows, testing::geometry_alone()));
    squares += (zero.length - 0.01) * (zero.length - 0.01) / (zero.sigma * zero.sigma);
  }
  EXPECT_GT(squares / count, 0.5);  // chi-squared over 30: within 0.5 and 1.75 but for one in a hundred
  EXPECT_LT(squares / count, 1.75);
}

// The zero that was found but is not significant is uncertain in its own right: the same distances, longer by a length
// that is significant, tell what was found.
TEST(DistanceZero, ThatIsNotSignificantIsUncertainByWhatWasFound) {
  const double length = 0.01;
  double largest = 0.0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    testing::Distances experiment(seed);
    const Measurements rows = experiment.measured(2, false, 60, testing::kNoise);
    const auto zero = [&](const Measurements& some) {
      return zero_of(calibrate(testing::bundled_robot(), some, testing::geometry_alone()));
    };
    const DistanceZero without = zero(rows);
    const DistanceZero with = zero(longer(rows, length));
    const double found = with.length - length;
    if (without.length != 0.0) {
      EXPECT_NEAR(without.length, found, 0.02 * with.sigma) << seed;
      continue;
    }
    EXPECT_NEAR(without.sigma, std::hypot(with.sigma, found), 0.03 * with.sigma) << seed;
    largest = std::max(largest, std::abs(found) / with.sigma);
  }
  EXPECT_GT(largest, 0.7);  // else both would be alike
}

// Joints that sag under gravity lengthen and shorten distances, too. What is found beside the effects is the zero
// alone, and the arm is right.
TEST(DistanceZero, IsNotMistakenForSag) {
  CalibrationOptions options;
  options.noise = {.scale_sigma = 0.0, .length_sigma = 0.0};  // the devices are exact
  options.threads = 1;
  for (const auto& [seed, zero] : {std::pair{1, 0.0}, std::pair{2, 0.003}, std::pair{3, 0.0}, std::pair{4, -0.001}}) {
    testing::Distances experiment(static_cast<std::uint64_t>(seed));
    VirtualRobot& robot = experiment.robot;
    robot.model.effects = load_terms(experiment.model);
    robot.truth.effects.resize(std::ssize(robot.model.effects));
    for (double& sag : robot.truth.effects) {
      sag = 3e-4 * experiment.random.normal();
    }
    const Calibration found =
        calibrate(testing::bundled_robot(), longer(experiment.measured(3, false, 100, testing::kNoise), zero), options);
    EXPECT_THAT(found.doubts(), IsEmpty()) << seed;
    EXPECT_NEAR(zero_of(found).length, zero, 4.0 * zero_of(found).sigma) << seed;
    EXPECT_LT(zero_of(found).sigma, 5e-4) << seed;
    EXPECT_LT(testing::distance_from_truth(found, experiment), 2e-4) << seed;
  }
}

// Right distances keep their lengths; points, and the length of a bar that is stated, have no zero.
TEST(DistanceZero, IsNoneWhereNothingIsWrongOrMeasured) {
  testing::Distances experiment(5);
  const Calibration right = calibrate(testing::bundled_robot(), experiment.measured(3, false, 80, testing::kNoise),
                                      testing::geometry_alone());
  EXPECT_EQ(zero_of(right).length, 0.0);
  EXPECT_GT(zero_of(right).sigma, 0.0);
  const Calibration points =
      calibrate(testing::bundled_robot(), testing::without_sigmas(experiment.measure(20, {.sigma = testing::kNoise})),
                testing::geometry_alone());
  EXPECT_FALSE(points.parts().fitted->distance_zero);
}

}  // namespace
}  // namespace kdl_calibration::distance_zero_test
