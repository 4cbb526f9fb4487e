#include "estimation/registration.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "effects/effect_terms.hpp"
#include "estimation/identification.hpp"
#include "estimation/least_squares.hpp"
#include "measurements/stations.hpp"
#include "virtual_experiment.hpp"
#include "whitened_systems.hpp"

namespace kdl_calibration::joint_registration_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// An arm and a tracker that was moved twice.
struct MovedTracker : testing::VirtualExperiment {
  explicit MovedTracker(std::uint64_t seed, int count = 30) : VirtualExperiment({.random = Random(seed)}) {
    robot = robot_at_stations(robot, 3, random);
    model = robot.model;
    q = configurations(count);
  }

  Measurements measured(double noise = 0.0) { return measure(q, {.sigma = noise}); }

  Registration registered(const Measurements& measurements, const RegistrationOptions& options = {}) const {
    return register_base_and_targets(flange_poses(folded(model, robot.truth.errors), q), measurements, options);
  }

  double distance(const Registration& found) const {
    double largest = 0.0;
    for (std::size_t s = 0; s < 3; ++s) {
      const Eigen::Matrix4d difference = found.frames.base(s).matrix() - robot.truth.frames.base(s).matrix();
      largest = std::max(largest, difference.cwiseAbs().maxCoeff());
    }
    for (std::size_t k = 0; k < found.frames.targets.size(); ++k) {
      largest = std::max(
          largest,
          (found.frames.targets[k].X_FT.translation() - robot.truth.frames.targets[k].X_FT.translation()).norm());
    }
    return largest;
  }

  MatrixXd q;
};

TEST(StationRegistration, FindsEachBaseAndTheSharedTargets) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    MovedTracker experiment(seed);
    const Registration found = experiment.registered(experiment.measured());
    EXPECT_LT(experiment.distance(found), 1e-9) << seed;
    EXPECT_EQ(found.undetermined, 0);
    EXPECT_LT(found.rms, 1e-10);
  }
}

// The third station sees three points of one configuration, the second one two targets of two: neither finds its base
// without the targets of the first.
TEST(StationRegistration, StationsWithFewPointsUseTheTargetsOfTheOthers) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    MovedTracker experiment(seed);
    const Measurements few = subset(experiment.measured(), [](const Observation& o) {
      return o.station == 0 || (o.station == 1 && o.configuration < 12 && o.target < 2) || o.configuration == 29;
    });
    const Registration found = register_base_and_targets(
        flange_poses(folded(experiment.model, experiment.robot.truth.errors), few.joint_values), few);
    EXPECT_LT(experiment.distance(found), 1e-8) << seed;
  }
}

TEST(StationRegistration, HoldsWhatIsKnown) {
  MovedTracker experiment(3);
  Eigen::Isometry3d known = experiment.robot.truth.frames.base(1);
  known.translation().x() += 1e-3;
  const Registration found = experiment.registered(experiment.measured(), {.known = {.bases = {{"S2", known}}}});
  EXPECT_EQ(found.frames.base(1).matrix(), known.matrix());
  const Registration exact =
      experiment.registered(experiment.measured(), {.known = {.targets = experiment.robot.truth.frames.targets}});
  EXPECT_LT(experiment.distance(exact), 1e-9);
  EXPECT_EQ(exact.frames.targets.front().X_FT.matrix(), experiment.robot.truth.frames.targets.front().X_FT.matrix());
}

TEST(StationRegistration, HoldsAKnownTargetThatNoTrainingRowShows) {
  MovedTracker experiment(4);
  Measurements measurements = experiment.measured();
  for (Observation& observation : measurements.observations) {
    observation.split = observation.target == 2 ? Split::test : Split::train;
  }
  const TargetFrame& known = experiment.robot.truth.frames.targets[2];
  const Registration found = experiment.registered(measurements, {.known = {.targets = {known}}});
  EXPECT_EQ(found.frames.targets[2].X_FT.matrix(), known.X_FT.matrix());
  EXPECT_LT(experiment.distance(found), 1e-9);
}

Estimate nearby(const MovedTracker& experiment) {
  Estimate estimate = experiment.robot.truth;
  estimate.errors *= 0.5;
  estimate.frames.targets[0].X_FT.translation().x() += 1e-3;
  estimate.frames.base(2).translation().y() += 1e-3;
  return estimate;
}

// All unknowns of the three stations.
Unknowns unknowns(const MovedTracker& experiment) {
  std::vector<std::string> names = base_parameter_names(experiment.model);
  for (const std::string& name : experiment.reduction.kept) {
    if (name.rfind("base.", 0) != 0) {
      names.push_back(name);
    }
  }
  return {experiment.model, experiment.targets, names};
}

TEST(StationLeastSquares, PriorsOfEffectsCountOnce) {
  MovedTracker experiment(5, 12);
  const Measurements measurements = experiment.measured();
  Estimate estimate = nearby(experiment);
  ErrorModel model = experiment.model;
  model.effects = effect_terms(model, EffectGroup::gravity, experiment.q);
  for (EffectTerm& term : model.effects) {
    term.sigma = 1e-4;
  }
  const auto count = std::ssize(model.effects);
  estimate.effects = VectorXd::Constant(count, 2e-4);
  const Unknowns geometry = unknowns(experiment);
  const Unknowns all = geometry.with_group(model, UnknownGroup::effects);
  const LeastSquaresProblem beside(model, measurements, all);
  const double without = LeastSquaresProblem(model, measurements, geometry).cost(estimate);
  EXPECT_NEAR(beside.cost(estimate) - without, 4.0 * static_cast<double>(count), 1e-6);
  EXPECT_NEAR(beside.linearise(estimate).cost - without, 4.0 * static_cast<double>(count), 1e-6);
}

// Whitened rows against central differences of the predicted points, whatever the noise.
TEST(StationLeastSquares, RowsAreTheDerivativesOfEachStationsPoints) {
  MovedTracker experiment(4, 12);
  Measurements measurements = experiment.measured();
  for (Observation& observation : measurements.observations) {
    observation.sigma = 1e-3;
  }
  const Unknowns free = unknowns(experiment);
  ASSERT_EQ(free.size(), 18 + 27);
  const Estimate estimate = nearby(experiment);
  const LeastSquaresProblem problem(experiment.model, measurements, free);
  const WhitenedSystem system = problem.whitened(estimate);
  ASSERT_EQ(system.blocks.size(), 13U);
  const auto residuals = [&](const Estimate& at) {
    const auto X_BF = flange_poses(experiment.model, at, measurements);
    VectorXd all(system.residual.size());
    Index row = 0;
    for (const Observation& o : measurements.observations) {  // whitened in the flange frame at `estimate`
      const Eigen::Matrix3d R_WF =
          estimate.frames.base(station_of(o)).linear() *
          flange_poses(experiment.model, estimate, measurements)[static_cast<std::size_t>(o.configuration)].linear();
      all.segment<3>(row) = R_WF.transpose() * (o.position() - predicted_point(at, X_BF, o)) / o.sigma;
      row += 3;
    }
    return all;
  };
  EXPECT_LT((residuals(estimate) - system.residual).norm(), 1e-9 * system.residual.norm());
  const MatrixXd slopes = testing::central_differences(
      free.size(), 1e-6, [&](const VectorXd& step) { return residuals(free.moved(estimate, -step)); });
  for (Index column = 0; column < free.size(); ++column) {
    EXPECT_LT((slopes - system.jacobian).col(column).norm(), 1e-5 * (1.0 + slopes.col(column).norm()))
        << free.names()[static_cast<std::size_t>(column)];
  }
  const NormalEquations equations = problem.linearise(estimate);
  testing::expect_equations_of(system, equations, 1e-10, 1e-10);
  EXPECT_NEAR(equations.cost, system.residual.squaredNorm(), 1e-10 * equations.cost);
  EXPECT_NEAR(problem.cost(estimate), equations.cost, 1e-10 * equations.cost);
  const MatrixXd R = problem.whitened_summary(estimate).sqrt_information;
  EXPECT_LT((R.transpose() * R - equations.hessian).norm(), 1e-10 * equations.hessian.norm());
}

TEST(StationLeastSquares, AFitOfAllStationsIsExact) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    MovedTracker experiment(seed);
    const Measurements measurements = experiment.measured();
    const Identification found = identify_jointly(experiment.model, measurements,
                                                  nominal_start(experiment.model, measurements), unknowns(experiment));
    EXPECT_EQ(found.termination, Termination::converged) << found.message;
    EXPECT_LT(found.rms, 1e-10);
  }
}

// ---- Single coordinates --------------------------------------------------------------------------------------------

// The coordinates of all rows along the columns of R, a row for each.
Measurements along(const Measurements& points, const Eigen::Matrix3Xd& R) {
  Measurements result = points;
  result.observations.clear();
  for (const Observation& observation : points.observations) {
    for (const auto& n : R.colwise()) {
      result.observations.push_back(observation);
      testing::keep_coordinate_along(result.observations.back(), n);
    }
  }
  return result;
}

// A height has three numbers of the plane in the base frame: three of the six directions of each base stay open.
TEST(SingleCoordinateRegistration, FindsTargetsAndPlanesFromHeights) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    MovedTracker experiment(seed, 45);
    const Registration found = experiment.registered(along(experiment.measured(), Eigen::Vector3d::UnitZ()));
    EXPECT_LT(found.rms, 1e-9) << seed;
    EXPECT_EQ(found.undetermined, 3 * 3) << seed;
    for (std::size_t s = 0; s < 3; ++s) {
      const Eigen::Isometry3d& truth = experiment.robot.truth.frames.base(s);
      EXPECT_LT((found.frames.base(s).linear().row(2) - truth.linear().row(2)).norm(), 1e-8) << seed;
      EXPECT_NEAR(found.frames.base(s).translation().z(), truth.translation().z(), 1e-8) << seed;
    }
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_LT(
          (found.frames.targets[k].X_FT.translation() - experiment.robot.truth.frames.targets[k].X_FT.translation())
              .norm(),
          1e-8)
          << seed;
    }
  }
}

TEST(SingleCoordinateLeastSquares, ThreeOfAPointAreItsEquations) {
  MovedTracker experiment(4, 12);
  const Measurements points = experiment.measured(1e-3);
  const Eigen::Matrix3d R = Eigen::Quaterniond(0.5, -0.1, 0.7, 0.3).normalized().toRotationMatrix();
  const Unknowns free = unknowns(experiment);
  const Estimate estimate = nearby(experiment);
  const LeastSquaresProblem of_points(experiment.model, points, free);
  const LeastSquaresProblem of_rows(experiment.model, along(points, R), free);
  EXPECT_EQ(of_points.equations(), of_rows.equations());
  const NormalEquations one = of_points.linearise(estimate);
  const NormalEquations other = of_rows.linearise(estimate);
  EXPECT_LT((one.hessian - other.hessian).norm(), 1e-10 * one.hessian.norm());
  EXPECT_LT((one.gradient - other.gradient).norm(), 1e-10 * one.gradient.norm());
  EXPECT_NEAR(one.cost, other.cost, 1e-10 * one.cost);
}

// Two repeats of two coordinates each: the cost is the sum of squares of all rows, and the whitened system has a row
// for each direction.
TEST(SingleCoordinateLeastSquares, CostAndRowsAreThoseOfTheCoordinates) {
  MovedTracker experiment(5, 12);
  Eigen::Matrix<double, 3, 2> R;
  R << 1.0, 0.6, 0.0, 0.0, 0.0, 0.8;
  const Measurements rows =
      along(measure(experiment.robot, experiment.q, {.sigma = 1e-3, .repeats = 2}, experiment.random), R);
  const Estimate estimate = nearby(experiment);
  const LeastSquaresProblem problem(experiment.model, rows, unknowns(experiment));
  double cost = 0.0;
  for (const Observation& row : rows.observations) {
    const auto X_BF = flange_poses(experiment.model, estimate, rows);
    cost += measured_minus_predicted(row, estimate, X_BF).squaredNorm() / 1e-6;
  }
  EXPECT_NEAR(problem.cost(estimate), cost, 1e-9 * cost);
  EXPECT_EQ(problem.equations(), 12 * 3 * 2 * 2);
  const WhitenedSystem system = problem.whitened(estimate);
  EXPECT_EQ(system.residual.size(), 12 * 3 * 2);
  const NormalEquations equations = problem.linearise(estimate);
  testing::expect_equations_of(system, equations, 1e-10, 1e-10);
}

// Two repeats of each distance from the station's origin: the cost is the sum of squares of the differences, and half
// the derivative of the cost is the gradient.
TEST(DistanceLeastSquares, CostAndGradientAreThoseOfTheDistances) {
  MovedTracker experiment(6, 12);
  Measurements rows = measure(experiment.robot, experiment.q, {.sigma = 1e-3, .repeats = 2}, experiment.random);
  for (Observation& observation : rows.observations) {
    testing::keep_distance(observation, Eigen::Vector3d::Zero());
  }
  const Estimate estimate = nearby(experiment);
  const Unknowns free = unknowns(experiment);
  const LeastSquaresProblem problem(experiment.model, rows, free);
  const auto cost = [&](const Estimate& at) {
    const auto X_BF = flange_poses(experiment.model, at, rows);
    double sum = 0.0;
    for (const Observation& row : rows.observations) {
      const double difference = testing::length_of(row) - predicted_point(at, X_BF, row).norm();
      sum += difference * difference / 1e-6;
    }
    return sum;
  };
  EXPECT_NEAR(problem.cost(estimate), cost(estimate), 1e-9 * cost(estimate));
  EXPECT_EQ(problem.equations(), 12 * 3 * 2);
  const NormalEquations equations = problem.linearise(estimate);
  const MatrixXd slopes = testing::central_differences(free.size(), 1e-6, [&](const VectorXd& step) {
    return VectorXd::Constant(1, cost(free.moved(estimate, -step)));
  });
  EXPECT_LT((equations.gradient - 0.5 * slopes.row(0).transpose()).norm(), 1e-6 * equations.gradient.norm());
  const WhitenedSystem system = problem.whitened(estimate);
  EXPECT_EQ(system.residual.size(), 12 * 3);
  EXPECT_LT((equations.hessian - system.jacobian.transpose() * system.jacobian).norm(),
            1e-10 * equations.hessian.norm());
}

}  // namespace
}  // namespace kdl_calibration::joint_registration_test
