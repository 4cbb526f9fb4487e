// Measured orientations are weighed by what their residuals say, not by a lever.

#include <gmock/gmock.h>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/simulation.hpp"
#include "record.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

// Mean square of the held-out errors [m^2] of calibrations that state both sigmas, none, or none and weigh by a lever.
struct HeldOut {
  double stated = 0.0;
  double estimated = 0.0;
  double lever = 0.0;
};

HeldOut held_out(double orientation_sigma) {
  testing::VirtualExperiment experiment({.targets = testing::as_frames(published_targets(1))});
  const ErrorModel& model = experiment.model;
  constexpr double kSigma = 0.00003;
  HeldOut sums;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    experiment.restart(Random(seed));
    const Measurements train =
        testing::without_sigmas(experiment.measure(30, {.sigma = kSigma, .orientation_sigma = orientation_sigma}));
    const Measurements test = experiment.measure(100, {}, Split::test);
    const auto square = [&](const Estimate& estimate) {
      const double rms = error_statistics(position_errors(model, estimate, joined(train, test), Rows::test)).rms;
      return rms * rms;
    };
    const CalibrationOptions fit_alone{.held_out = false, .try_readings = false};
    CalibrationOptions stated = fit_alone;
    stated.noise.independent.setConstant(kSigma);
    stated.noise.orientation = orientation_sigma;
    sums.stated += square(calibrate(model, train, stated).identification.estimate);
    sums.estimated += square(calibrate(model, train, fit_alone).identification.estimate);
    sums.lever += square(identify_jointly(model, train, nominal_start(model, train), experiment.free).estimate);
  }
  return sums;
}

TEST(VarianceComponents, AreAsGoodAsStatedSigmas) {
  for (const double sigma : {0.00001, 0.0001, 0.002}) {
    const HeldOut found = held_out(sigma);
    const std::string over_stated = "held out over stated sigmas, orientations to " + std::to_string(sigma) + " rad, ";
    testing::record(over_stated + "estimated", std::sqrt(found.estimated / found.stated));
    testing::record(over_stated + "by a lever of 0.3 m", std::sqrt(found.lever / found.stated));
    EXPECT_LT(found.estimated, 1.1 * found.stated) << sigma;
    if (sigma > 0.001) {
      EXPECT_LT(found.estimated, 0.5 * found.lever) << sigma;
    }
  }
}

TEST(VarianceComponents, LeaveExactPosesExact) {
  testing::VirtualExperiment experiment({.targets = testing::as_frames(published_targets(1))});
  const Calibration found = calibrate(experiment.model, experiment.measure(30));
  EXPECT_TRUE(found.trusted()) << found.identification.message;
  EXPECT_LT(found.train.after.max, 1e-12);
}

}  // namespace
}  // namespace kdl_calibration
