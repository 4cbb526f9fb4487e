#include "calibration/determined_fit.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>
#include <set>
#include <string>
#include <vector>

#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "calibration/option_check.hpp"
#include "dense_fit.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "model/kinematics.hpp"
#include "model/parameters.hpp"
#include "model/reduction.hpp"
#include "noise/noise_components.hpp"
#include "planning/simulation.hpp"
#include "refusal.hpp"
#include "two_step/two_step.hpp"
#include "uncertainty/covariance.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::determined_fit_test {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::DenseFit;
using testing::DenseNoise;

struct Arm : testing::VirtualExperiment {
  Measurements measured;
  CalibrationSettings options;
  Estimate start;

  explicit Arm(const testing::VirtualExperimentOptions& of = {}, int count = 20, const MeasuringNoise& noise = {})
      : VirtualExperiment(of),
        measured(testing::without_sigmas(measure(count, noise))),
        start(nominal_start(model, measured)) {}

  DeterminedFit fitted(const std::vector<std::string>& without = {}) const {
    const ParameterSelection choice =
        select_parameters(model, start.frames.targets, options.parameters, {.configurations = 20});
    std::vector<std::string> names = choice.free;
    for (const std::string& name : without) {
      std::erase(names, name);
    }
    const FitProblem problem{.model = model,
                             .measurements = measured,
                             .start = start,
                             .free = Unknowns(model, start.frames.targets, names),
                             .options = {.loss = options.estimator.loss}};
    require_two_step_data(problem.free, measured, options);
    return fit_determined_parameters(problem, choice,
                                     {.estimator = options.estimator, .parameters = options.parameters});
  }
};

TEST(DeterminedFit, TheTwoStepProcedureRefusesWhatItWasNotPublishedFor) {
  const Arm arm({}, 12, {.sigma = 1e-5, .repeats = 2});
  const auto refused = [&](const std::function<void(Arm&)>& change) {
    Arm changed = arm;
    changed.options.estimator.method = Method::two_step;
    changed.options.estimator.iterations = 2;
    change(changed);
    return testing::refusal([&] { changed.fitted(); });
  };
  EXPECT_EQ(refused([](Arm&) {}), "nothing was refused");
  const std::string frames = "method: the two-step procedure finds base and targets, which cannot be known or fixed";
  EXPECT_EQ(refused([](Arm& a) { a.options.parameters.known.bases = {{.X_WB = a.start.frames.base()}}; }), frames);
  EXPECT_EQ(refused([](Arm& a) { a.options.parameters.known.targets = a.start.frames.targets; }), frames);
  EXPECT_EQ(refused([](Arm& a) {
              a.options.parameters.known.targets = {a.start.frames.targets[0], a.start.frames.targets[2]};
            }),
            frames);
  EXPECT_EQ(refused([](Arm& a) {
              testing::set_orientations(a.measured, Orientation::Identity());
              a.measured.source = "poses.csv";
            }),
            "method: the two-step procedure fits points; the measured orientations of poses.csv need the joint "
            "estimate");
  const std::string more = "method: the published two-step procedure has no priors, effects, losses or noise model";
  EXPECT_EQ(refused([](Arm& a) { a.options.selection.automatic_priors = true; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.selection.priors.length = 1e-3; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.selection.priors.angle = 1e-3; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.selection.effects.automatic = true; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.selection.effects.groups = {EffectGroup::gain}; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.estimator.loss = Loss::huber; }), more);
  EXPECT_EQ(refused([](Arm& a) { a.options.noise.weights = Weights::repeats; }), more);
}

// Joints that hardly move tell so little that the two steps go on and on.
TEST(DeterminedFit, TheTwoStepProcedureTakesAThousandRoundsUnlessToldOtherwise) {
  const auto a_little = [](const std::vector<MovingJoint>& joints) { return JointRanges(joints.size(), {0.1, 0.4}); };
  Arm arm({.targets = published_targets(1), .ranges = a_little}, 10);
  arm.options.estimator.method = Method::two_step;
  const Identification found = arm.fitted().identification;
  EXPECT_EQ(found.termination, Termination::iteration_limit) << found.message;
  EXPECT_EQ(found.iterations, 1000);
  for (const int rounds : {1, 3}) {
    arm.options.estimator.iterations = rounds;
    EXPECT_EQ(arm.fitted().identification.iterations, rounds);
  }
}

// What was fixed must not come back under other names, and a limit that was set is one.
TEST(DeterminedFit, GoesOnInTheCompleteSetWhereThatExplainsMoreUnlessSomethingIsAskedOfIt) {
  const Arm arm;
  const auto misfit = [&](const std::function<void(Arm&)>& ask) {
    Arm asked = arm;
    ask(asked);
    return asked.fitted({"dq3", "Tx4"}).identification.rms;  // [m]
  };
  constexpr double kLeft = 1e-5;
  EXPECT_LT(misfit([](Arm&) {}), 1e-10);
  EXPECT_GT(misfit([](Arm& a) { a.options.parameters.fix = {"dq3"}; }), kLeft);
  EXPECT_GT(misfit([](Arm& a) { a.options.estimator.iterations = 50; }), kLeft);
  EXPECT_GT(misfit([](Arm& a) { a.options.estimator.method = Method::two_step; }), kLeft);
  EXPECT_GT(misfit([](Arm& a) { a.options.estimator.loss = Loss::huber; }), kLeft);
}

// The rank of the columns of these names at an estimate.
Eigen::Index rank_of(const Arm& arm, const Estimate& estimate, const Unknowns& columns) {
  const Eigen::MatrixXd J = LeastSquaresProblem(arm.model, arm.measured, columns).whitened(estimate).jacobian;
  const Eigen::VectorXd scale = J.colwise().norm().unaryExpr([](double n) { return n > 0.0 ? 1.0 / n : 0.0; });
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(Eigen::MatrixXd(J * scale.asDiagonal()));
  qr.setThreshold(1e-7);
  return qr.rank();
}

TEST(DeterminedFit, KeepsOfTheCandidatesAsManyAsTheMeasurementsTellAndTheFirstOfThem) {
  Arm arm({}, 2);
  for (const int held : {0, 2, 5}) {
    Eigen::MatrixXd q = arm.configurations(25);
    q.row(held).setConstant(0.3);
    arm.measured = arm.measure(q);
    arm.start = nominal_start(arm.model, arm.measured);
    const DeterminedFit found = arm.fitted();
    const Estimate& estimate = found.identification.estimate;
    EXPECT_EQ(found.free.size(), rank_of(arm, estimate, found.candidates)) << held;
    EXPECT_EQ(found.free.size(), rank_of(arm, estimate, found.free)) << held;
    EXPECT_LT(found.free.size(), found.candidates.size());
    EXPECT_EQ(found.free.range(UnknownGroup::base).count, 6) << "base comes first";
    EXPECT_LT(found.identification.rms, 1e-10);
    EXPECT_EQ(found.identification.rms_history.size(), static_cast<std::size_t>(found.identification.iterations));
  }
}

// A target a millimetre beside the last axis: what the tool turns about there moves it little.
DeterminedFit beside_the_last_axis(double noise, double turned) {
  Arm arm({.targets = testing::targets_at({{0.0, 0.2, 1e-3}})});
  arm.robot.truth.errors[static_cast<Eigen::Index>(parameter_index(arm.model, "Rz5"))] = turned;
  arm.measured = testing::without_sigmas(arm.measure(30, {.sigma = noise}));
  arm.start = nominal_start(arm.model, arm.measured);
  return arm.fitted();
}

TEST(DeterminedFit, HoldsWhatTheNoiseHidesUnlessThatCostsAMisfit) {
  const DeterminedFit clear = beside_the_last_axis(1e-6, 0.0);
  EXPECT_THAT(clear.reduction.replaceable, ::testing::UnorderedElementsAre("Tz5", "Rz5"));
  EXPECT_EQ(clear.candidates.size(), 27);
  const DeterminedFit hidden = beside_the_last_axis(1e-4, 0.0);
  EXPECT_EQ(hidden.candidates.size(), 25);
  EXPECT_FALSE(hidden.candidates.column("Tz5") || hidden.candidates.column("Rz5"));
  EXPECT_EQ(hidden.identification.rms_history.size(), static_cast<std::size_t>(hidden.identification.iterations));
  const auto held = [](double turned) { return !beside_the_last_axis(1e-4, turned).candidates.column("Rz5"); };
  EXPECT_TRUE(held(0.002));
  EXPECT_FALSE(held(0.2));
}

// ---- every kind of noise, against the least squares problem in its plainest form ------------------------------------

struct Measured : testing::VirtualExperiment {
  Measurements measured;

  Measured(std::uint64_t seed, const std::vector<TargetFrame>& stated, int count, const MeasuringNoise& noise)
      : VirtualExperiment({.targets = stated, .X_WB = askew(), .random = Random(seed)}),
        measured(testing::without_sigmas(measure(count, noise))) {}

private:
  static Eigen::Isometry3d askew() {  // the tracker, some metres away
    Eigen::Isometry3d X_WB = Eigen::Isometry3d::Identity();
    X_WB.linear() = testing::turned_by({0.3, -0.2, 1.1});
    X_WB.translation() = Vector3d(2.0, -3.0, 0.5);
    return X_WB;
  }
};

// One target is measured as a frame, the other one as a point; of the first some rows are points as well.
Measured posed_arm(std::uint64_t seed, int repeats, int configurations = 12) {
  std::vector<TargetFrame> targets = published_targets(2);
  targets[0].with_orientation = true;
  Measured arm(seed, targets, configurations, {.sigma = 1e-4, .orientation_sigma = 3e-4, .repeats = repeats});
  for (Observation& o : arm.measured.observations) {
    if (o.target == 1 || (o.configuration % 5 == 2 && o.repeat == 1)) {
      testing::remove_orientation(o);
    }
  }
  return arm;
}

constexpr double kOrientationLength = 0.3;  // [m] that 1 rad counts as where no sigma of orientations is stated

Matrix3d isotropic(double sigma) { return sigma * sigma * Matrix3d::Identity(); }

// Of a row whose position has this covariance.
double orientation_variance(const Matrix3d& position, double stated) {
  return stated > 0.0 ? stated * stated : position.trace() / 3.0 / (kOrientationLength * kOrientationLength);
}

DenseNoise dense_noise(const std::function<Matrix3d(const Observation&)>& position, double orientation,
                       const Vector3d& common = Vector3d::Zero()) {
  return {.position = position,
          .orientation = [=](const Observation& o) { return orientation_variance(position(o), orientation); },
          .common = common,
          .weights = {}};
}

struct Statement {
  std::string name;
  CalibrationSettings options;
  DenseNoise dense;
};

// Of the fit alone: nothing is held out, no other reading is tried.
const CalibrationSettings kFitAlone{
    .noise = {.weights = Weights::equal}, .validation = {.held_out = false}, .diagnosis = {.try_readings = false}};

std::vector<Statement> statements() {
  std::vector<Statement> all;
  all.push_back({"equal weights", kFitAlone, dense_noise([](const Observation&) { return isotropic(1.0); }, 0.0)});
  const Vector3d per_axis(1e-4, 3e-4, 0.5e-4);
  const Vector3d common(2e-4, 0.0, 1e-4);
  const TrackerNoise tracker{.range = 5e-5, .range_per_metre = 2e-5, .transverse = 3e-5, .transverse_per_metre = 1e-4};
  for (const double orientation : {0.0, 2e-4}) {
    const auto add = [&](const std::string& name, const NoiseModel& noise, const DenseNoise& dense) {
      Statement& statement = all.emplace_back(Statement{name, kFitAlone, dense});
      statement.name += orientation > 0.0 ? " and a sigma of orientations" : "";
      statement.options.noise.stated = noise;
      statement.options.noise.stated.orientation = orientation;
    };
    const auto by_axis = [=](const Observation&) { return Matrix3d(per_axis.cwiseAbs2().asDiagonal()); };
    const auto by_tracker = [=](const Observation& o) {
      const double distance = o.position().norm();
      const Vector3d u = o.position() / distance;
      const double along = 5e-5 + 2e-5 * distance;
      const double across = 3e-5 + 1e-4 * distance;
      return Matrix3d(along * along * (u * u.transpose()) +
                      across * across * (Matrix3d::Identity() - u * u.transpose()));
    };
    add("independent", {.independent = Vector3d::Constant(1e-4)},
        dense_noise([](const Observation&) { return isotropic(1e-4); }, orientation));
    add("per axis", {.independent = per_axis}, dense_noise(by_axis, orientation));
    add("common", {.independent = per_axis, .common = common}, dense_noise(by_axis, orientation, common));
    add("tracker", {.tracker = tracker}, dense_noise(by_tracker, orientation));
    add("tracker and common", {.tracker = tracker, .common = common}, dense_noise(by_tracker, orientation, common));
  }
  return all;
}

// Of the parameters that were fitted, the largest difference in standard deviations.
double difference_in_sigmas(const Estimate& a, const Estimate& b, const Unknowns& free, const MatrixXd& covariance) {
  double largest = 0.0;
  Index column = free.range(UnknownGroup::geometric).first;
  for (const std::size_t p : free.geometric()) {
    const auto i = static_cast<Index>(p);
    largest = std::max(largest, std::abs(a.errors[i] - b.errors[i]) / std::sqrt(covariance(column, column)));
    ++column;
  }
  return largest;
}

void expect_same_frames(const Estimate& found, const Estimate& expected) {
  EXPECT_LT((found.frames.base().matrix() - expected.frames.base().matrix()).cwiseAbs().maxCoeff(), 1e-8);
  for (std::size_t k = 0; k < expected.frames.targets.size(); ++k) {
    const Eigen::Matrix4d difference = found.frames.targets[k].X_FT.matrix() - expected.frames.targets[k].X_FT.matrix();
    EXPECT_LT(difference.cwiseAbs().maxCoeff(), 1e-8) << "target " << k;
  }
}

// The noise with orientations weighed as the calibration found them from the residuals of both, where it did.
DenseNoise weighed_as_by(const CalibrationResult& found, const DenseNoise& noise) {
  DenseNoise weighed = noise;
  if (found.noise.orientation_length) {
    const double ratio = kOrientationLength / *found.noise.orientation_length;
    weighed.orientation = [=](const Observation& o) { return ratio * ratio * noise.orientation(o); };
  }
  return weighed;
}

// Lengths of the simulated devices have no error.
CalibrationSettings by_exact_device(CalibrationSettings options) {
  options.noise.scale_sigma = 0.0;
  return options;
}

// Estimate, variance factor and covariance of a calibration are those of the dense problem.
void expect_dense_fit(const Measured& arm, const CalibrationResult& found, const DenseNoise& noise) {
  ASSERT_EQ(found.fit.identification.termination, Termination::converged) << found.fit.identification.message;
  const Estimate& estimate = found.fit.identification.estimate;
  const DenseFit dense(arm.model, arm.measured, found.fit.free, weighed_as_by(found, noise));
  const Estimate expected = dense.fit(estimate);
  const double freedom = static_cast<double>(dense.equations() - dense.columns());
  const double reduced = dense.cost(expected) / freedom;
  EXPECT_EQ(found.noise.degrees_of_freedom, freedom);
  const bool stated = found.noise.source != NoiseSource::residuals;
  if (stated && found.noise.variance_factor == 1.0) {
    EXPECT_LT(reduced, 1.0 + 4.0 * std::sqrt(2.0 / freedom));
  } else if (stated) {
    EXPECT_NEAR(found.noise.variance_factor, reduced, 1e-3 * reduced);
  }
  const double factor = stated ? found.noise.variance_factor : reduced;
  const MatrixXd covariance = factor * dense.inverse_information(expected);
  EXPECT_LT(difference_in_sigmas(estimate, expected, found.fit.free, covariance), 1e-4);
  expect_same_frames(estimate, expected);
  ASSERT_EQ(found.uncertainty.covariance.rows(), covariance.rows());
  const VectorXd std = covariance.diagonal().cwiseSqrt();
  const MatrixXd relative = (found.uncertainty.covariance - covariance).cwiseQuotient(std * std.transpose());
  EXPECT_LT(relative.cwiseAbs().maxCoeff(), 2e-3);
}

TEST(WholeFitOfEveryKind, MeasuredOrientationsWithEveryNoiseAreTheDenseFit) {
  for (const int repeats : {1, 3}) {
    const Measured arm = posed_arm(1, repeats);
    for (const Statement& statement : statements()) {
      if (repeats == 1 && statement.options.noise.stated.orientation > 0.0) {
        continue;  // repeats make no difference there
      }
      SCOPED_TRACE(statement.name + ", repeats " + std::to_string(repeats));
      expect_dense_fit(arm, calibrate(arm.model, arm.measured, by_exact_device(statement.options)), statement.dense);
    }
  }
}

TEST(WholeFitOfEveryKind, KnownFramesWithEveryNoiseAreTheDenseFit) {
  const Measured arm = posed_arm(2, 2);
  Eigen::Isometry3d base = arm.robot.truth.frames.base();  // off, so that it matters that they are kept
  base.translation() += Vector3d(2e-4, -1e-4, 3e-4);
  std::vector<TargetFrame> targets = arm.robot.truth.frames.targets;
  targets[0].X_FT.translate(Vector3d(-2e-4, 1e-4, 0.0));
  targets[0].X_FT.rotate(testing::turned_by({3e-4, 0.0, -2e-4}));
  for (Statement& statement : statements()) {
    // Every noise beside both: once with a stated sigma of orientations, once without.
    const bool stated = statement.options.noise.stated.orientation > 0.0;
    for (const bool known_base : statement.dense.common.isZero() ? std::set{stated} : std::set{true, false}) {
      SCOPED_TRACE(statement.name + (known_base ? ", known base" : ", known targets"));
      CalibrationSettings options = statement.options;
      if (known_base) {
        options.parameters.known.bases = {{.X_WB = base}};
      } else {
        options.parameters.known.targets = targets;
      }
      const CalibrationResult calibration = calibrate(arm.model, arm.measured, by_exact_device(options));
      expect_dense_fit(arm, calibration, statement.dense);
      const Estimate& found = calibration.fit.identification.estimate;
      if (known_base) {
        EXPECT_EQ(found.frames.base().matrix(), base.matrix());
      } else {
        EXPECT_EQ(found.frames.targets[0].X_FT.matrix(), targets[0].X_FT.matrix());
        EXPECT_EQ(found.frames.targets[1].X_FT.translation(), targets[1].X_FT.translation());
      }
    }
  }
}

TEST(WholeFitOfEveryKind, SigmasOfRowsStandBeforeWhatIsStatedForAll) {
  Measured arm = posed_arm(3, 2);
  const auto own_sigma = [](const Observation& o) {
    return o.configuration % 3 == 0 ? 0.0 : 5e-5 * (1 + o.configuration % 4 + 2 * o.target + o.repeat);
  };
  for (Observation& o : arm.measured.observations) {
    o.sigma = own_sigma(o);
  }
  for (Statement& statement : statements()) {
    if (statement.name == "equal weights") {
      continue;  // a row without a sigma would then have one of a metre
    }
    SCOPED_TRACE(statement.name);
    const auto stated = statement.dense.position;
    const auto position = [=](const Observation& o) { return o.sigma > 0.0 ? isotropic(o.sigma) : stated(o); };
    const double orientation = statement.options.noise.stated.orientation;
    expect_dense_fit(arm, calibrate(arm.model, arm.measured, by_exact_device(statement.options)),
                     dense_noise(position, orientation, statement.dense.common));
  }
}

TEST(WholeFitOfEveryKind, WeightsOfRowsAreSharesOfTheirOwnInformation) {
  const Measured arm = posed_arm(4, 2);
  std::vector<double> weights;
  for (const Observation& o : arm.measured.observations) {
    weights.push_back(o.configuration == 3 && o.target == 1 ? 0.0 : 0.2 + 0.1 * (o.configuration % 8));
  }
  const Estimate start = nominal_start(arm.model, arm.measured);
  const Unknowns free = Unknowns(arm.model, start.frames.targets, reduced_model(arm.model, start.frames.targets).kept);
  for (Statement& statement : statements()) {
    SCOPED_TRACE(statement.name);
    const JointOptions options{.residuals = {.noise = statement.options.noise.stated, .row_weights = weights}};
    const Identification found = identify_jointly(arm.model, arm.measured, start, free, options);
    ASSERT_EQ(found.termination, Termination::converged) << found.message;
    statement.dense.weights = weights;
    const DenseFit dense(arm.model, arm.measured, free, statement.dense);
    const Estimate expected = dense.fit(found.estimate);
    const double scale = statement.name == "equal weights" ? 1e-8 : 1.0;
    EXPECT_LT(difference_in_sigmas(found.estimate, expected, free, scale * dense.inverse_information(expected)), 1e-4);
    expect_same_frames(found.estimate, expected);
    const double cost = LeastSquaresProblem(arm.model, arm.measured, free, options.residuals).cost(found.estimate);
    EXPECT_NEAR(cost, dense.cost(expected), 1e-4 * cost);
  }
}

TEST(WholeFitOfEveryKind, PriorsWithoutStatedNoiseAreThoseBesideTheNoiseOfThePlainFit) {
  const Measured points(5, published_targets(), 20, {.sigma = 1e-4});
  const Measured repeated(6, published_targets(), 16, {.sigma = 1e-4, .repeats = 3});
  const Measured poses = posed_arm(7, 1);
  const Measured repeated_poses = posed_arm(7, 2);
  for (const Measured* arm : {&points, &repeated, &poses, &repeated_poses}) {
    const CalibrationResult plain = calibrate(arm->model, arm->measured, by_exact_device(kFitAlone));
    const DenseNoise equal = weighed_as_by(plain, dense_noise([](const Observation&) { return isotropic(1.0); }, 0.0));
    const DenseFit dense(arm->model, arm->measured, plain.fit.free, equal);
    const double freedom = static_cast<double>(dense.equations() - dense.columns());
    const double sigma = std::sqrt(dense.cost(plain.fit.identification.estimate) / freedom);
    EXPECT_NEAR(sigma, 1e-4, 4e-4 / std::sqrt(2.0 * freedom));
    CalibrationSettings options = kFitAlone;
    options.selection.priors = {.length = 2e-4, .angle = 2e-4};
    const CalibrationResult unstated = calibrate(arm->model, arm->measured, by_exact_device(options));
    options.noise.stated.independent.setConstant(sigma);
    const CalibrationResult stated = calibrate(arm->model, arm->measured, by_exact_device(options));
    const auto difference = [&](const CalibrationResult& other) {
      return difference_in_sigmas(unstated.fit.identification.estimate, other.fit.identification.estimate,
                                  stated.fit.free, stated.uncertainty.covariance);
    };
    EXPECT_LT(difference(stated), 1e-4);
    EXPECT_GT(difference(plain), 0.1) << "the priors change nothing";
    const DenseNoise found =
        weighed_as_by(stated, dense_noise([=](const Observation&) { return isotropic(sigma); }, 0.0));
    const DenseFit with_priors(arm->model, arm->measured, stated.fit.free, found, options.selection.priors);
    const Estimate expected = with_priors.fit(stated.fit.identification.estimate);
    EXPECT_LT(difference_in_sigmas(stated.fit.identification.estimate, expected, stated.fit.free,
                                   stated.uncertainty.covariance),
              1e-4);
  }
}

// Sizes are found beside noise that is estimated with them: what was stated of it changes nothing.
TEST(WholeFitOfEveryKind, SizesOfPriorsAreThoseOfTheResidualsWhateverNoiseIsStated) {
  const Measured arm(8, published_targets(), 14, {.sigma = 2e-4});
  CalibrationSettings options{.noise = {.weights = Weights::equal}, .diagnosis = {.try_readings = false}};
  options.selection.automatic_priors = true;
  const CalibrationResult unstated = calibrate(arm.model, arm.measured, by_exact_device(options));
  options.noise.stated.independent.setConstant(1e-4);
  const CalibrationResult stated = calibrate(arm.model, arm.measured, by_exact_device(options));
  ASSERT_EQ(unstated.selection.tried.size(), 2U);  // none, and of these sizes
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(unstated.selection.tried[i].priors.length, stated.selection.tried[i].priors.length,
                1e-3 * stated.selection.tried[i].priors.length);
    EXPECT_NEAR(unstated.selection.tried[i].held_out_rms, stated.selection.tried[i].held_out_rms,
                1e-3 * stated.selection.tried[i].held_out_rms);
  }
  EXPECT_TRUE(unstated.selection.tried.front().sized);
  EXPECT_GT(unstated.selection.priors.length, 1e-4);
  EXPECT_LT(unstated.selection.priors.length, 3e-3);
  EXPECT_EQ(unstated.selection.priors.length, unstated.selection.tried.front().priors.length);
}

// Weights are those of the estimate and the estimate is that of the weights: another dense fit with them moves nothing.
// Rows that are further off never weigh more.
TEST(WholeFitOfEveryKind, RobustLossesWithEveryNoiseAreDenseFitsWithTheirWeights) {
  Measured arm(9, published_targets(), 14, {.sigma = 1e-4, .repeats = 2, .common = Vector3d(2e-4, 1e-4, 3e-4)});
  std::set<std::size_t> outliers;
  for (std::size_t row = 5; row < arm.measured.observations.size(); row += 17) {
    arm.measured.observations[row].position()[static_cast<Index>(row % 3)] += 4e-3;
    outliers.insert(row);
  }
  for (const Statement& statement : statements()) {
    if (statement.options.noise.stated.orientation > 0.0) {
      continue;  // points alone
    }
    for (const Loss loss : {Loss::huber, Loss::tukey}) {
      SCOPED_TRACE(statement.name + (loss == Loss::huber ? ", Huber" : ", Tukey"));
      CalibrationSettings options = statement.options;
      options.estimator.loss = loss;
      const CalibrationResult found = calibrate(arm.model, arm.measured, by_exact_device(options));
      ASSERT_EQ(found.fit.identification.termination, Termination::converged) << found.fit.identification.message;
      const Estimate& estimate = found.fit.identification.estimate;
      DenseNoise weighed = statement.dense;
      weighed.weights.clear();
      for (const double weight : found.fit.robust.weights) {
        weighed.weights.push_back(std::max(weight, 1e-9));
      }
      const Estimate expected = DenseFit(arm.model, arm.measured, found.fit.free, weighed).fit(estimate, 1);
      EXPECT_LT(difference_in_sigmas(estimate, expected, found.fit.free, found.uncertainty.covariance), 1e-3);

      const KDL::Chain chain = error_chain(arm.model, estimate.errors);
      const Matrix3d common = statement.dense.common.cwiseAbs2().asDiagonal();
      std::vector<std::pair<double, double>> by_distance;  // with the weight
      for (std::size_t row = 0; row < found.fit.robust.weights.size(); ++row) {
        const Observation& o = arm.measured.observations[row];
        const VectorXd q = arm.measured.joint_values.col(o.configuration);
        const Vector3d e = o.position() - testing::kdl_point(chain, estimate, q, o.target);
        by_distance.emplace_back(std::sqrt(e.dot((statement.dense.position(o) + common).ldlt().solve(e))),
                                 found.fit.robust.weights[row]);
        if (outliers.count(row) > 0) {
          EXPECT_LT(found.fit.robust.weights[row], 0.7) << "row " << row;
        }
      }
      std::sort(by_distance.begin(), by_distance.end());
      EXPECT_NEAR(by_distance.front().second, 1.0, 0.01);
      for (std::size_t i = 1; i < by_distance.size(); ++i) {
        EXPECT_LE(by_distance[i].second, by_distance[i - 1].second + 1e-4) << by_distance[i].first;
      }
    }
  }
}

// One point in so many configurations that as many degrees of freedom are left; some parameters are fixed for that.
struct Tight {
  Measured arm;
  CalibrationSettings options{.noise = {.weights = Weights::equal}, .diagnosis = {.try_readings = false}};

  explicit Tight(int freedom, int configurations = 11)
      : arm(40 + static_cast<std::uint64_t>(freedom), published_targets(1), configurations, {.sigma = 1e-4}) {
    const Reduction& reduction = arm.reduction;
    const std::size_t unknowns = static_cast<std::size_t>(3 * configurations - freedom);
    std::size_t count = reduction.kept.size();
    for (auto name = reduction.kept.rbegin(); name != reduction.kept.rend() && count > unknowns; ++name, --count) {
      options.parameters.fix.push_back(*name);
    }
  }
};

TEST(WholeFitOfEveryKind, FewDegreesOfFreedomGiveTheVarianceOfTheTextbook) {
  for (const int freedom : {1, 2, 3}) {
    SCOPED_TRACE(freedom);
    const Tight tight(freedom, 9);
    const CalibrationResult found = calibrate(tight.arm.model, tight.arm.measured, by_exact_device(tight.options));
    ASSERT_EQ(found.fit.identification.termination, Termination::converged) << found.fit.identification.message;
    EXPECT_EQ(found.noise.degrees_of_freedom, freedom);
    const DenseNoise equal = dense_noise([](const Observation&) { return isotropic(1.0); }, 0.0);
    const DenseFit dense(tight.arm.model, tight.arm.measured, found.fit.free, equal);
    ASSERT_EQ(dense.equations() - dense.columns(), freedom);
    const Estimate expected = dense.fit(found.fit.identification.estimate);
    const double variance = dense.cost(expected) / freedom;
    EXPECT_NEAR(found.noise.sigma, std::sqrt(variance), 1e-6 * std::sqrt(variance));
    EXPECT_NEAR(found.noise.independent.x(), std::sqrt(variance), 1e-6 * std::sqrt(variance));
    EXPECT_EQ(found.noise.common, Vector3d::Zero());
    const MatrixXd covariance = variance * dense.inverse_information(expected);
    const VectorXd std = covariance.diagonal().cwiseSqrt();
    const MatrixXd relative = (found.uncertainty.covariance - covariance).cwiseQuotient(std * std.transpose());
    EXPECT_LT(relative.cwiseAbs().maxCoeff(), 1e-3);
  }
}

template <class Derived>
void append(std::vector<double>& all, const Eigen::MatrixBase<Derived>& values) {
  for (const double value : values.reshaped()) {
    all.push_back(value);
  }
}

void append(std::vector<double>& all, const ErrorStatistics& s) {
  all.insert(all.end(), {static_cast<double>(s.count), s.mean, s.rms, s.p95, s.max, s.std});
}

// Every number that is fitted, chosen or judged by the training rows.
std::vector<double> fitted_numbers(const CalibrationResult& c, const std::vector<Observation>& rows) {
  std::vector<double> all;
  const Estimate& estimate = c.fit.identification.estimate;
  append(all, estimate.errors);
  append(all, estimate.frames.base().matrix());
  for (const TargetFrame& target : estimate.frames.targets) {
    append(all, target.X_FT.matrix());
  }
  append(all, estimate.effects);
  append(all, c.uncertainty.covariance);
  append(all, c.exported.estimate.errors);
  for (const ParameterEstimate& parameter : c.uncertainty.parameters) {
    all.insert(all.end(), {parameter.value, parameter.error, parameter.std});
  }
  all.insert(all.end(), {c.fit.identification.rms, static_cast<double>(c.fit.identification.iterations), c.noise.sigma,
                         c.noise.degrees_of_freedom, c.noise.variance_factor, c.uncertainty.identifiability.condition,
                         c.uncertainty.observability.O1, c.uncertainty.observability.O5, c.selection.priors.length,
                         c.selection.priors.angle});
  append(all, c.noise.independent);
  append(all, c.noise.common);
  if (c.noise.repeats) {
    append(all, c.noise.repeats->independent);
    append(all, c.noise.repeats->common);
    all.push_back(c.noise.repeats->orientation);
  }
  for (const ModelOption& option : c.selection.tried) {
    all.insert(all.end(), {option.priors.length, static_cast<double>(option.effects.size()), option.held_out_rms});
  }
  for (const ErrorStatistics& s :
       {c.accuracy.train.before, c.accuracy.train.after, c.accuracy.iso_before.accuracy, c.accuracy.iso_after.accuracy,
        c.accuracy.iso_after.repeatability, c.uncertainty.predicted.workspace}) {
    append(all, s);
  }
  if (c.accuracy.leave_one_out) {
    append(all, c.accuracy.leave_one_out->before);
    append(all, c.accuracy.leave_one_out->after);
  }
  append(all, c.accuracy.nested_leave_one_out.value_or(ErrorStatistics{}));
  append(all, c.accuracy.k_fold ? c.accuracy.k_fold->after : ErrorStatistics{});
  if (c.noise.lack_of_fit) {
    all.insert(all.end(), {c.noise.lack_of_fit->f, c.noise.lack_of_fit->p_value});
    all.insert(all.end(), c.noise.lack_of_fit->explained_by_joint.begin(),
               c.noise.lack_of_fit->explained_by_joint.end());
  }
  for (const ConfigurationInfluence& configuration : c.uncertainty.influence.configurations) {
    all.insert(all.end(), {configuration.leverage, configuration.cook});
  }
  for (std::size_t row = 0; row < c.fit.robust.weights.size(); ++row) {
    all.push_back(rows[row].split == Split::train ? c.fit.robust.weights[row] : 0.0);
  }
  return all;
}

bool same_bytes(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

TEST(WholeFitOfEveryKind, TestRowsChangeNothingThatIsFitted) {
  std::vector<std::pair<std::string, CalibrationSettings>> cases(5);
  cases[0].first = "equal weights";
  cases[1].first = "chosen priors and effects, nested and folds";
  cases[1].second.selection.automatic_priors = true;
  cases[1].second.selection.effects.automatic = true;
  cases[1].second.validation.leave_one_out = true;
  cases[1].second.validation.nested = true;
  cases[1].second.validation.k_fold = 3;
  cases[2].first = "repeats";
  cases[2].second.noise.weights = Weights::repeats;
  cases[3].first = "Tukey and common noise";
  cases[3].second.estimator.loss = Loss::tukey;
  cases[3].second.noise.stated = {.independent = Vector3d::Constant(1e-4), .common = Vector3d::Constant(1e-4)};
  cases[4].first = "tracker";
  cases[4].second.noise.stated.tracker = TrackerNoise{.range = 1e-4, .transverse_per_metre = 1e-4};
  for (auto& entry : cases) {
    entry.second.diagnosis.try_readings = false;
  }
  Measured arm = posed_arm(10, 2, 16);
  for (Observation& o : arm.measured.observations) {
    o.split = o.configuration % 4 == 1 ? Split::test : Split::train;
  }
  Measurements spoilt = arm.measured;
  for (std::size_t row = 0; row < spoilt.observations.size(); ++row) {
    Observation& o = spoilt.observations[row];
    if (o.split == Split::test) {
      o.position() += Vector3d(0.1, -0.2, 0.05) * (1.0 + 0.1 * static_cast<double>(row % 7));
      if (o.orientation() != nullptr) {
        const Eigen::Quaterniond turn(testing::turned_by({0.1, 0.2, -0.1}));
        testing::set_orientation(o, testing::orientation_of(o) * turn);
      }
      spoilt.joint_values.col(o.configuration).setConstant(0.1 + 0.01 * o.configuration);
    }
  }
  const Measurements absent = subset(arm.measured, [](const Observation& o) { return o.split == Split::train; });
  for (const auto& [name, options] : cases) {
    SCOPED_TRACE(name);
    const CalibrationResult found = calibrate(arm.model, arm.measured, by_exact_device(options));
    const CalibrationResult after = calibrate(arm.model, spoilt, by_exact_device(options));
    const std::vector<double> expected = fitted_numbers(found, arm.measured.observations);
    EXPECT_TRUE(same_bytes(fitted_numbers(after, spoilt.observations), expected)) << "spoilt test rows";
    ASSERT_TRUE(found.accuracy.test.has_value() && after.accuracy.test.has_value());
    EXPECT_GT(after.accuracy.test->after.rms, found.accuracy.test->after.rms + 0.1);
    if (options.estimator.loss == Loss::none) {  // the weights of rows that are not there cannot be compared
      const CalibrationResult alone = calibrate(arm.model, absent, by_exact_device(options));
      EXPECT_TRUE(same_bytes(fitted_numbers(alone, absent.observations), expected)) << "no test rows";
    }
  }
}

Measured at_limits(double sigma) { return {5, published_targets(), 25, {.sigma = sigma}}; }

Unknowns irreducible(const Measured& s) {
  return Unknowns(s.model, s.robot.truth.frames.targets, reduced_model(s.model, s.robot.truth.frames.targets).kept);
}

void expect_end(const Identification& fit, Termination termination, const std::string& name,
                const std::string& message) {
  EXPECT_EQ(to_string(fit.termination), name);
  EXPECT_EQ(fit.termination, termination) << name;
  EXPECT_EQ(fit.message, message) << name;
}

TEST(Terminations, SayHowTheJointFitEnded) {
  Measured s = at_limits(3e-5);
  const Estimate start = nominal_start(s.model, s.measured);
  const Unknowns free = irreducible(s);
  expect_end(identify_jointly(s.model, s.measured, start, free), Termination::converged, "converged",
             "the last step moved the predicted points by less than the tolerance");
  expect_end(identify_jointly(s.model, s.measured, start, free, {.max_iterations = 2}), Termination::iteration_limit,
             "iteration_limit", "still moving after 2 iterations");
  expect_end(identify_jointly(s.model, s.measured, start, free, {.step_tolerance = 0.0}), Termination::converged,
             "converged", "no step can reduce the misfit by more than its rounding");
  s.measured.observations[10].position().x() = 1e200;  // finite, its square is not
  expect_end(identify_jointly(s.model, s.measured, start, free), Termination::diverged, "diverged",
             "the misfit is no longer finite");
}

TEST(Terminations, SayHowTheTwoStepsEnded) {
  const Measured s = at_limits(3e-5);
  const Estimate start = nominal_start(s.model, s.measured);
  const std::vector<std::size_t> geometric = irreducible(s).geometric();
  const auto same = [&](int) { return s.measured; };
  expect_end(identify_in_two_steps(s.model, same, start, geometric, {.rounds = 1000}), Termination::converged,
             "converged", "the last round moved the predicted points by less than the tolerance");
  expect_end(identify_in_two_steps(s.model, same, start, geometric, {.rounds = 3}), Termination::iteration_limit,
             "iteration_limit", "still moving after 3 rounds");
  Measurements broken = s.measured;
  broken.observations[0].position().x() = 1e200;
  expect_end(identify_in_two_steps(
                 s.model, [&](int) { return broken; }, start, geometric),
             Termination::diverged, "diverged", "the misfit is no longer finite");
}

}  // namespace
}  // namespace kdl_calibration::determined_fit_test
