// Options of a calibration together: each answer against the least squares problem written out (dense_fit.hpp) or
// against a loop written by hand.
#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <optional>
#include <set>

#include "dense_fit.hpp"
#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/covariance.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "kdl_calibration/noise_components.hpp"
#include "kdl_calibration/reduction.hpp"
#include "kdl_calibration/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::combinations_test {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::DenseFit;
using testing::DenseNoise;
using testing::fanuc;

struct Arm : testing::VirtualExperiment {
  Measurements measured;

  Arm(std::uint64_t seed, const std::vector<TargetFrame>& stated, int count, const MeasuringNoise& noise)
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
Arm posed_arm(std::uint64_t seed, int repeats, int configurations = 12) {
  std::vector<TargetFrame> targets = published_targets(2);
  targets[0].with_orientation = true;
  Arm arm(seed, targets, configurations, {.sigma = 1e-4, .orientation_sigma = 3e-4, .repeats = repeats});
  for (std::size_t row = 0; row < arm.measured.observations.size(); ++row) {
    const Observation& o = arm.measured.observations[row];
    if (o.target == 1 || (o.configuration % 5 == 2 && o.repeat == 1)) {
      arm.measured.orientations[row].coeffs().setConstant(std::nan(""));
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
  CalibrationOptions options;
  DenseNoise dense;
};

// Of the fit alone: nothing is held out, no other reading is tried.
const CalibrationOptions kFitAlone{.weights = Weights::equal, .held_out = false, .try_readings = false};

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
      statement.options.noise = noise;
      statement.options.noise.orientation = orientation;
    };
    const auto by_axis = [=](const Observation&) { return Matrix3d(per_axis.cwiseAbs2().asDiagonal()); };
    const auto by_tracker = [=](const Observation& o) {
      const double distance = o.position.norm();
      const Vector3d u = o.position / distance;
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
  EXPECT_LT((found.X_WB.matrix() - expected.X_WB.matrix()).cwiseAbs().maxCoeff(), 1e-8);
  for (std::size_t k = 0; k < expected.targets.size(); ++k) {
    const Eigen::Matrix4d difference = found.targets[k].X_FT.matrix() - expected.targets[k].X_FT.matrix();
    EXPECT_LT(difference.cwiseAbs().maxCoeff(), 1e-8) << "target " << k;
  }
}

// The noise with orientations weighed as the calibration found them from the residuals of both, where it did.
DenseNoise weighed_as_by(const Calibration& found, const DenseNoise& noise) {
  DenseNoise weighed = noise;
  if (found.noise.orientation_length) {
    const double ratio = kOrientationLength / *found.noise.orientation_length;
    weighed.orientation = [=](const Observation& o) { return ratio * ratio * noise.orientation(o); };
  }
  return weighed;
}

// Estimate, variance factor and covariance of a calibration are those of the dense problem.
void expect_dense_fit(const Arm& arm, const Calibration& found, const DenseNoise& noise) {
  ASSERT_EQ(found.identification.termination, Termination::converged) << found.identification.message;
  const Estimate& estimate = found.identification.estimate;
  const DenseFit dense(arm.model, arm.measured, found.free, weighed_as_by(found, noise));
  const Estimate expected = dense.fit(estimate);
  const double freedom = static_cast<double>(dense.equations() - dense.columns());
  const double reduced = dense.cost(expected) / freedom;
  EXPECT_EQ(found.noise.degrees_of_freedom, freedom);
  const bool stated = found.noise.model != "residuals";
  if (stated && found.noise.variance_factor == 1.0) {
    EXPECT_LT(reduced, 1.0 + 4.0 * std::sqrt(2.0 / freedom));
  } else if (stated) {
    EXPECT_NEAR(found.noise.variance_factor, reduced, 1e-3 * reduced);
  }
  const double factor = stated ? found.noise.variance_factor : reduced;
  const MatrixXd covariance = factor * dense.inverse_information(expected);
  EXPECT_LT(difference_in_sigmas(estimate, expected, found.free, covariance), 1e-4);
  expect_same_frames(estimate, expected);
  ASSERT_EQ(found.covariance.rows(), covariance.rows());
  const VectorXd std = covariance.diagonal().cwiseSqrt();
  const MatrixXd relative = (found.covariance - covariance).cwiseQuotient(std * std.transpose());
  EXPECT_LT(relative.cwiseAbs().maxCoeff(), 2e-3);
}

// The scatter of repeated orientations from their differences: sum |x_i - x_j|^2 over the pairs of n repeats is n times
// the sum of squares about the mean.
TEST(Combinations, RepeatsGiveTheSigmaOfOrientationsByTheirDifferences) {
  const Measurements measured = posed_arm(1, 3).measured;
  double squares = 0.0;
  double freedom = 0.0;
  for (Index c = 0; c < measured.joint_values.cols(); ++c) {
    std::vector<Eigen::Quaterniond> repeats;
    for (std::size_t row = 0; row < measured.observations.size(); ++row) {
      if (measured.observations[row].configuration == c && !std::isnan(measured.orientations[row].w())) {
        repeats.push_back(measured.orientations[row]);
      }
    }
    for (std::size_t i = 0; i < repeats.size(); ++i) {
      for (std::size_t j = 0; j < i; ++j) {
        const Matrix3d turn = (repeats[j].conjugate() * repeats[i]).toRotationMatrix();
        squares += testing::rotation_vector(turn).squaredNorm() / static_cast<double>(repeats.size());
      }
    }
    freedom += static_cast<double>(repeats.size()) - 1.0;
  }
  const RepeatNoise found = noise_from_repeats(measured);
  EXPECT_EQ(found.orientation_degrees_of_freedom, freedom);
  EXPECT_NEAR(found.orientation, std::sqrt(squares / (3.0 * freedom)), 1e-5 * found.orientation);
}

TEST(Combinations, MeasuredOrientationsWithEveryNoiseAreTheDenseFit) {
  for (const int repeats : {1, 3}) {
    const Arm arm = posed_arm(1, repeats);
    for (const Statement& statement : statements()) {
      if (repeats == 1 && statement.options.noise.orientation > 0.0) {
        continue;  // repeats make no difference there
      }
      SCOPED_TRACE(statement.name + ", repeats " + std::to_string(repeats));
      expect_dense_fit(arm, calibrate(arm.model, arm.measured, statement.options), statement.dense);
    }
  }
}

TEST(Combinations, KnownFramesWithEveryNoiseAreTheDenseFit) {
  const Arm arm = posed_arm(2, 2);
  Eigen::Isometry3d base = arm.robot.truth.X_WB;  // off, so that it matters that they are kept
  base.translation() += Vector3d(2e-4, -1e-4, 3e-4);
  std::vector<TargetFrame> targets = arm.robot.truth.targets;
  targets[0].X_FT.translate(Vector3d(-2e-4, 1e-4, 0.0));
  targets[0].X_FT.rotate(testing::turned_by({3e-4, 0.0, -2e-4}));
  for (Statement& statement : statements()) {
    // Every noise beside both: once with a stated sigma of orientations, once without.
    const bool stated = statement.options.noise.orientation > 0.0;
    for (const bool known_base : statement.dense.common.isZero() ? std::set{stated} : std::set{true, false}) {
      SCOPED_TRACE(statement.name + (known_base ? ", known base" : ", known targets"));
      CalibrationOptions options = statement.options;
      if (known_base) {
        options.known_base = base;
      } else {
        options.known_targets = targets;
      }
      const Calibration calibration = calibrate(arm.model, arm.measured, options);
      expect_dense_fit(arm, calibration, statement.dense);
      const Estimate& found = calibration.identification.estimate;
      if (known_base) {
        EXPECT_EQ(found.X_WB.matrix(), base.matrix());
      } else {
        EXPECT_EQ(found.targets[0].X_FT.matrix(), targets[0].X_FT.matrix());
        EXPECT_EQ(found.targets[1].X_FT.translation(), targets[1].X_FT.translation());
      }
    }
  }
}

TEST(Combinations, SigmasOfRowsStandBeforeWhatIsStatedForAll) {
  Arm arm = posed_arm(3, 2);
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
    const double orientation = statement.options.noise.orientation;
    expect_dense_fit(arm, calibrate(arm.model, arm.measured, statement.options),
                     dense_noise(position, orientation, statement.dense.common));
  }
}

TEST(Combinations, WeightsOfRowsAreSharesOfTheirOwnInformation) {
  const Arm arm = posed_arm(4, 2);
  std::vector<double> weights;
  for (const Observation& o : arm.measured.observations) {
    weights.push_back(o.configuration == 3 && o.target == 1 ? 0.0 : 0.2 + 0.1 * (o.configuration % 8));
  }
  const Estimate start = nominal_start(arm.model, arm.measured);
  const Unknowns free = Unknowns(arm.model, start.targets, reduced_model(arm.model, start.targets).kept);
  for (Statement& statement : statements()) {
    SCOPED_TRACE(statement.name);
    const JointOptions options{.residuals = {.noise = statement.options.noise, .row_weights = weights}};
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

// ---- Priors --------------------------------------------------------------------------------------------------------

TEST(Combinations, PriorsWithoutStatedNoiseAreThoseBesideTheNoiseOfThePlainFit) {
  const Arm points(5, published_targets(), 20, {.sigma = 1e-4});
  const Arm repeated(6, published_targets(), 16, {.sigma = 1e-4, .repeats = 3});
  const Arm poses = posed_arm(7, 1);
  const Arm repeated_poses = posed_arm(7, 2);
  for (const Arm* arm : {&points, &repeated, &poses, &repeated_poses}) {
    const Calibration plain = calibrate(arm->model, arm->measured, kFitAlone);
    const DenseNoise equal = weighed_as_by(plain, dense_noise([](const Observation&) { return isotropic(1.0); }, 0.0));
    const DenseFit dense(arm->model, arm->measured, plain.free, equal);
    const double freedom = static_cast<double>(dense.equations() - dense.columns());
    const double sigma = std::sqrt(dense.cost(plain.identification.estimate) / freedom);
    EXPECT_NEAR(sigma, 1e-4, 4e-4 / std::sqrt(2.0 * freedom));
    CalibrationOptions options = kFitAlone;
    options.priors = {.length = 2e-4, .angle = 2e-4};
    const Calibration unstated = calibrate(arm->model, arm->measured, options);
    options.noise.independent.setConstant(sigma);
    const Calibration stated = calibrate(arm->model, arm->measured, options);
    const auto difference = [&](const Calibration& other) {
      return difference_in_sigmas(unstated.identification.estimate, other.identification.estimate, stated.free,
                                  stated.covariance);
    };
    EXPECT_LT(difference(stated), 1e-4);
    EXPECT_GT(difference(plain), 0.1) << "the priors change nothing";
    const DenseNoise found =
        weighed_as_by(stated, dense_noise([=](const Observation&) { return isotropic(sigma); }, 0.0));
    const DenseFit with_priors(arm->model, arm->measured, stated.free, found, options.priors);
    const Estimate expected = with_priors.fit(stated.identification.estimate);
    EXPECT_LT(difference_in_sigmas(stated.identification.estimate, expected, stated.free, stated.covariance), 1e-4);
  }
}

// Sizes are found beside noise that is estimated with them: what was stated of it changes nothing.
TEST(Combinations, SizesOfPriorsAreThoseOfTheResidualsWhateverNoiseIsStated) {
  const Arm arm(8, published_targets(), 14, {.sigma = 2e-4});
  CalibrationOptions options{.weights = Weights::equal, .try_readings = false};
  options.automatic_priors = true;
  const Calibration unstated = calibrate(arm.model, arm.measured, options);
  options.noise.independent.setConstant(1e-4);
  const Calibration stated = calibrate(arm.model, arm.measured, options);
  ASSERT_EQ(unstated.tried.size(), 2U);  // none, and of these sizes
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(unstated.tried[i].priors.length, stated.tried[i].priors.length, 1e-3 * stated.tried[i].priors.length);
    EXPECT_NEAR(unstated.tried[i].held_out_rms, stated.tried[i].held_out_rms, 1e-3 * stated.tried[i].held_out_rms);
  }
  EXPECT_TRUE(unstated.tried.front().sized);
  EXPECT_GT(unstated.priors.length, 1e-4);
  EXPECT_LT(unstated.priors.length, 3e-3);
  EXPECT_EQ(unstated.priors.length, unstated.tried.front().priors.length);
}

// ---- Robust losses -------------------------------------------------------------------------------------------------

constexpr double kMedianOfChi3 = 1.5381722544550522;

double weight_of(Loss loss, double r) {
  if (loss == Loss::huber) {
    return r <= 2.5 ? 1.0 : 2.5 / r;
  }
  return r < 7.0 ? std::pow(1.0 - std::pow(r / 7.0, 2), 2) : 0.0;
}

struct Reweighted {
  Estimate estimate;
  std::vector<double> weights;
};

// From these on until the weights stay.
Reweighted reweighted_by_hand(const Arm& arm, const Unknowns& free, DenseNoise noise, Loss loss, Reweighted result) {
  const Matrix3d common = noise.common.cwiseAbs2().asDiagonal();
  double change = 1.0;
  for (int round = 0; round < 60 && change > 1e-7; ++round) {
    const KDL::Chain chain = error_chain(arm.model, result.estimate.errors);
    std::vector<double> distances;
    for (const Observation& o : arm.measured.observations) {
      const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(chain, arm.measured.joint_values.col(o.configuration)));
      const TargetFrame& target = result.estimate.targets[static_cast<std::size_t>(o.target)];
      const Vector3d e = o.position - result.estimate.X_WB * (X_BF * target.X_FT.translation());
      distances.push_back(std::sqrt(e.dot((noise.position(o) + common).ldlt().solve(e))));
    }
    std::vector<double> sorted = distances;
    std::sort(sorted.begin(), sorted.end());
    const std::size_t n = sorted.size();
    const double scale = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]) / kMedianOfChi3;
    change = 0.0;
    result.weights.resize(n, 1.0);
    noise.weights.resize(n, 1.0);
    for (std::size_t row = 0; row < n; ++row) {
      const double weight = weight_of(loss, distances[row] / scale);
      change = std::max(change, std::abs(weight - result.weights[row]));
      result.weights[row] = weight;
      noise.weights[row] = std::max(weight, 1e-9);
    }
    result.estimate = DenseFit(arm.model, arm.measured, free, noise).fit(result.estimate, 1);
  }
  return result;
}

TEST(Combinations, RobustLossesWithEveryNoiseAreReweightedDenseFits) {
  Arm arm(9, published_targets(), 14, {.sigma = 1e-4, .repeats = 2, .common = Vector3d(2e-4, 1e-4, 3e-4)});
  for (std::size_t row = 5; row < arm.measured.observations.size(); row += 17) {
    arm.measured.observations[row].position[static_cast<Index>(row % 3)] += 4e-3;  // outliers
  }
  for (const Statement& statement : statements()) {
    if (statement.options.noise.orientation > 0.0) {
      continue;  // points alone
    }
    const bool simple = statement.dense.common.isZero();
    std::optional<Reweighted> before;  // with the loss before, from which the next one goes on
    for (const Loss loss : simple ? std::vector<Loss>{Loss::huber} : std::vector<Loss>{Loss::huber, Loss::tukey}) {
      SCOPED_TRACE(statement.name + (loss == Loss::huber ? ", Huber" : ", Tukey"));
      CalibrationOptions options = statement.options;
      options.loss = loss;
      const Calibration found = calibrate(arm.model, arm.measured, options);
      ASSERT_EQ(found.identification.termination, Termination::converged) << found.identification.message;
      const Estimate& estimate = found.identification.estimate;
      if (!before) {
        const DenseFit unweighted(arm.model, arm.measured, found.free, statement.dense);
        before = Reweighted{.estimate = unweighted.fit(arm.robot.truth), .weights = {}};
      }
      const Reweighted expected = reweighted_by_hand(arm, found.free, statement.dense, loss, *before);
      before = expected;
      EXPECT_LT(difference_in_sigmas(estimate, expected.estimate, found.free, found.covariance), 1e-3);
      ASSERT_EQ(found.weights.size(), expected.weights.size());
      for (std::size_t row = 0; row < expected.weights.size(); ++row) {
        EXPECT_NEAR(found.weights[row], expected.weights[row], 1e-4) << "row " << row;
      }
      EXPECT_LT(*std::min_element(expected.weights.begin(), expected.weights.end()), 0.9) << "nothing was weighed down";
    }
  }
}

// ---- Held out ------------------------------------------------------------------------------------------------------

// The mean over the repeats of each target of a configuration, against the prediction from KDL's solver.
std::vector<double> distances_to_means(const Arm& arm, const Estimate& estimate, Index configuration) {
  const KDL::Chain chain = error_chain(arm.model, estimate.errors);
  const Eigen::Isometry3d X_BF = to_eigen(testing::kdl_pose(chain, arm.measured.joint_values.col(configuration)));
  std::vector<double> distances;
  for (std::size_t k = 0; k < arm.measured.targets.size(); ++k) {
    Vector3d sum = Vector3d::Zero();
    double count = 0.0;
    for (const Observation& o : arm.measured.observations) {
      if (o.configuration == configuration && o.target == static_cast<int>(k)) {
        sum += o.position;
        count += 1.0;
      }
    }
    if (count > 0.0) {
      distances.push_back((sum / count - estimate.X_WB * (X_BF * estimate.targets[k].X_FT.translation())).norm());
    }
  }
  return distances;
}

Measurements without(const Measurements& measurements, const std::vector<Index>& left_out) {
  return subset(measurements, [&](const Observation& o) {
    return o.split == Split::train && std::find(left_out.begin(), left_out.end(), o.configuration) == left_out.end();
  });
}

// Few configurations, much noise: what is best depends on which are there. The last four are held out by their split.
Arm arm_in_doubt() {
  Arm arm(29, published_targets(), 15, {.sigma = 4e-4, .repeats = 2});
  for (Observation& o : arm.measured.observations) {
    o.split = o.configuration >= 11 ? Split::test : Split::train;
  }
  return arm;
}

// Every choice, size and fit made by a calibration that has never seen the configuration. The nested prediction is
// linear and weighs means alike, so that it is not the same to the last digit.
TEST(Combinations, NestedLeaveOneOutChoosesWithoutTheConfigurationThatItPredicts) {
  const Arm arm = arm_in_doubt();
  CalibrationOptions options{.weights = Weights::equal, .try_readings = false};
  options.automatic_priors = true;
  options.leave_one_out = true;
  options.nested = true;
  const Calibration found = calibrate(arm.model, arm.measured, options);
  std::vector<double> expected;
  std::set<double> chosen;
  for (Index c = 0; c < 11; ++c) {
    const Calibration others =
        calibrate(arm.model, without(arm.measured, {c}),
                  {.automatic_priors = true, .weights = Weights::equal, .held_out = false, .try_readings = false});
    chosen.insert(others.priors.length);
    const auto own = distances_to_means(arm, others.identification.estimate, c);
    expected.insert(expected.end(), own.begin(), own.end());
  }
  EXPECT_GT(chosen.size(), 1U) << "the choice is the same without any of them: a leak would not show";
  const ErrorStatistics statistics = error_statistics(expected);
  ASSERT_TRUE(found.nested_leave_one_out.has_value());
  EXPECT_EQ(found.nested_leave_one_out->count, 33);
  EXPECT_NEAR(found.nested_leave_one_out->rms, statistics.rms, 0.02 * statistics.rms);
  EXPECT_NEAR(found.nested_leave_one_out->max, statistics.max, 0.05 * statistics.max);
  EXPECT_GT(std::abs(found.nested_leave_one_out->rms - found.leave_one_out->after.rms), 0.02 * statistics.rms);
}

TEST(Combinations, LeaveOneOutIsALoopWithTheSameLossNoiseAndPriors) {
  Arm arm = arm_in_doubt();
  arm.measured.observations[20].position.x() += 0.01;  // an outlier
  CalibrationOptions options{.weights = Weights::equal, .try_readings = false};
  options.priors = {.length = 1e-3, .angle = 1e-3};
  options.noise.independent = Vector3d(3e-4, 4e-4, 5e-4);
  options.noise.common.setConstant(1e-4);
  options.loss = Loss::tukey;
  options.leave_one_out = true;
  const Calibration found = calibrate(arm.model, arm.measured, options);
  const JointOptions joint{.residuals = {.priors = options.priors, .noise = options.noise}};
  const Estimate& start = found.identification.estimate;
  std::vector<double> after;
  std::vector<double> before;
  for (Index c = 0; c < 11; ++c) {
    const Measurements others = without(arm.measured, {c});
    const Estimate refit = identify_robustly({.model = arm.model,
                                              .measurements = others,
                                              .start = start,
                                              .free = found.free,
                                              .options = {.loss = Loss::tukey, .joint = joint}})
                               .fit.estimate;
    const auto own = distances_to_means(arm, refit, c);
    after.insert(after.end(), own.begin(), own.end());
    const auto nominal = distances_to_means(arm, nominal_start(arm.model, others), c);
    before.insert(before.end(), nominal.begin(), nominal.end());
  }
  ASSERT_TRUE(found.leave_one_out.has_value());
  EXPECT_EQ(found.leave_one_out->after.count, 33);
  const ErrorStatistics expected = error_statistics(after);
  EXPECT_NEAR(found.leave_one_out->after.rms, expected.rms, 1e-5 * expected.rms);
  EXPECT_NEAR(found.leave_one_out->after.p95, expected.p95, 1e-5 * expected.p95);
  // Without a fit of its own a fold is predicted to a tenth of the noise.
  EXPECT_NEAR(found.leave_one_out->before.rms, error_statistics(before).rms, 0.1 * found.noise.sigma);
}

TEST(Combinations, KFoldIsALoopOverFoldsOfTrainingConfigurations) {
  const Arm arm = arm_in_doubt();
  for (const int folds : {2, 3, 5}) {
    SCOPED_TRACE(folds);
    const std::vector<std::vector<Index>> groups = make_folds(arm.measured, folds);
    ASSERT_EQ(groups.size(), static_cast<std::size_t>(folds));
    std::vector<Index> all;
    for (const auto& group : groups) {
      all.insert(all.end(), group.begin(), group.end());
      EXPECT_GE(group.size(), static_cast<std::size_t>(11 / folds));
      EXPECT_LE(group.size(), static_cast<std::size_t>((11 + folds - 1) / folds));
    }
    std::vector<std::vector<Index>> in_turn(groups.size());
    for (Index c = 0; c < 11; ++c) {
      in_turn[static_cast<std::size_t>(c) % groups.size()].push_back(c);
    }
    EXPECT_NE(groups, in_turn) << "not dealt out by chance";
    std::sort(all.begin(), all.end());
    std::vector<Index> expected(11);
    std::iota(expected.begin(), expected.end(), Index{0});
    EXPECT_EQ(all, expected);
    CalibrationOptions options{.weights = Weights::equal, .try_readings = false};
    options.priors = {.length = 1e-3, .angle = 1e-3};  // so that half of the configurations suffice
    options.noise.independent.setConstant(4e-4);
    options.k_fold = folds;
    const Calibration found = calibrate(arm.model, arm.measured, options);
    const JointOptions joint{.residuals = {.priors = options.priors, .noise = options.noise}};
    std::vector<double> distances;
    for (const auto& group : groups) {
      const Estimate refit =
          identify_jointly(arm.model, without(arm.measured, group), found.identification.estimate, found.free, joint)
              .estimate;
      for (const Index c : group) {
        const auto own = distances_to_means(arm, refit, c);
        distances.insert(distances.end(), own.begin(), own.end());
      }
    }
    const ErrorStatistics statistics = error_statistics(distances);
    ASSERT_TRUE(found.k_fold.has_value());
    EXPECT_EQ(found.k_fold->after.count, 33);
    // Without a fit of its own a fold is predicted to a tenth of the noise.
    EXPECT_NEAR(found.k_fold->after.rms, statistics.rms, 0.1 * found.noise.sigma);
    EXPECT_NEAR(found.k_fold->after.mean, statistics.mean, 0.1 * found.noise.sigma);
    EXPECT_NEAR(found.k_fold->after.max, statistics.max, 0.1 * found.noise.sigma);
  }
}

// ---- Few degrees of freedom ----------------------------------------------------------------------------------------

// P(chi^2 > x), written out for 1, 2 and 3 degrees of freedom.
double chi_square_tail(int freedom, double x) {
  const double tail = std::erfc(std::sqrt(x / 2.0));
  return freedom == 2 ? std::exp(-x / 2.0)
                      : tail + (freedom == 3 ? std::sqrt(2.0 * x / std::numbers::pi) * std::exp(-x / 2.0) : 0.0);
}

// One point in so many configurations that as many degrees of freedom are left; some parameters are fixed for that.
struct Tight {
  Arm arm;
  CalibrationOptions options{.weights = Weights::equal, .try_readings = false};

  explicit Tight(int freedom, int configurations = 11)
      : arm(40 + static_cast<std::uint64_t>(freedom), published_targets(1), configurations, {.sigma = 1e-4}) {
    const Reduction& reduction = arm.reduction;
    const std::size_t unknowns = static_cast<std::size_t>(3 * configurations - freedom);
    std::size_t count = reduction.kept.size();
    for (auto name = reduction.kept.rbegin(); name != reduction.kept.rend() && count > unknowns; ++name, --count) {
      options.fix.push_back(*name);
    }
  }
};

TEST(Combinations, FewDegreesOfFreedomGiveTheVarianceOfTheTextbook) {
  for (const int freedom : {1, 2, 3}) {
    SCOPED_TRACE(freedom);
    const Tight tight(freedom, 9);
    const Calibration found = calibrate(tight.arm.model, tight.arm.measured, tight.options);
    ASSERT_EQ(found.identification.termination, Termination::converged) << found.identification.message;
    EXPECT_EQ(found.noise.degrees_of_freedom, freedom);
    const DenseNoise equal = dense_noise([](const Observation&) { return isotropic(1.0); }, 0.0);
    const DenseFit dense(tight.arm.model, tight.arm.measured, found.free, equal);
    ASSERT_EQ(dense.equations() - dense.columns(), freedom);
    const Estimate expected = dense.fit(found.identification.estimate);
    const double variance = dense.cost(expected) / freedom;
    EXPECT_NEAR(found.noise.sigma, std::sqrt(variance), 1e-6 * std::sqrt(variance));
    EXPECT_NEAR(found.noise.independent.x(), std::sqrt(variance), 1e-6 * std::sqrt(variance));
    EXPECT_EQ(found.noise.common, Vector3d::Zero());
    const MatrixXd covariance = variance * dense.inverse_information(expected);
    const VectorXd std = covariance.diagonal().cwiseSqrt();
    const MatrixXd relative = (found.covariance - covariance).cwiseQuotient(std * std.transpose());
    EXPECT_LT(relative.cwiseAbs().maxCoeff(), 1e-3);
  }
}

TEST(Combinations, FewDegreesOfFreedomDoubtTheStatedNoiseFromTheQuantileOn) {
  for (const int freedom : {1, 2, 3}) {
    SCOPED_TRACE(freedom);
    Tight tight(freedom, 9);
    const Calibration plain = calibrate(tight.arm.model, tight.arm.measured, tight.options);
    const double cost = std::pow(plain.noise.sigma, 2) * freedom;
    double below = 0.0;  // chi^2 that only one in a thousand exceeds
    double above = 100.0;
    for (int halving = 0; halving < 60; ++halving) {
      const double middle = 0.5 * (below + above);
      (chi_square_tail(freedom, middle) > 1e-3 ? below : above) = middle;
    }
    for (const double ratio : {0.99, 1.01}) {
      tight.options.noise.independent.setConstant(std::sqrt(cost / (ratio * above)));
      const Calibration stated = calibrate(tight.arm.model, tight.arm.measured, tight.options);
      const double factor = ratio > 1.0 ? ratio * above / freedom : 1.0;
      EXPECT_NEAR(stated.noise.variance_factor, factor, 1e-6 * factor) << ratio;
      EXPECT_THAT(stated.warnings,
                  ratio > 1.0 ? ::testing::Matcher<std::vector<std::string>>(
                                    ::testing::Contains(::testing::HasSubstr("times the stated noise")))
                              : ::testing::Not(::testing::Contains(::testing::HasSubstr("times the stated noise"))));
    }
  }
}

// ---- Joint limits --------------------------------------------------------------------------------------------------

TEST(Combinations, ConfigurationsAreOutsideTheLimitsBeyondBothButNotOnThem) {
  const ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  const auto outside = [&](Index joint, double value) {
    VectorXd q = VectorXd::Zero(5);
    q[joint] = value;
    Measurements measurements;
    measurements.joint_values = q;
    measurements.configurations = {"1"};
    return configurations_outside_limits(model, measurements);
  };
  for (Index joint = 0; joint < 5; ++joint) {
    const MovingJoint& limits = model.joints[static_cast<std::size_t>(joint)];
    SCOPED_TRACE(limits.name);
    ASSERT_EQ(limits.lower.has_value(), limits.name != "skew");
    for (const double side : {-1.0, 1.0}) {
      const double limit = side < 0.0 ? limits.lower.value_or(-100.0) : limits.upper.value_or(100.0);
      EXPECT_EQ(outside(joint, limit), 0);
      EXPECT_EQ(outside(joint, limit + side * 0.9e-9), 0) << "what rounding does is no violation";
      EXPECT_EQ(outside(joint, limit + side * 1.1e-9), limits.lower ? 1 : 0);
      EXPECT_EQ(outside(joint, limit - side * 1e-3), 0);
    }
  }
  Measurements three;
  three.joint_values = MatrixXd::Zero(5, 3);
  three.configurations = {"1", "2", "3"};
  three.joint_values(0, 1) = 3.5;
  three.joint_values(1, 1) = 0.6;  // twice outside counts once
  EXPECT_EQ(configurations_outside_limits(model, three), 1);
}

// ---- Test rows -----------------------------------------------------------------------------------------------------

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
std::vector<double> fitted_numbers(const Calibration& c, const std::vector<Observation>& rows) {
  std::vector<double> all;
  const Estimate& estimate = c.identification.estimate;
  append(all, estimate.errors);
  append(all, estimate.X_WB.matrix());
  for (const TargetFrame& target : estimate.targets) {
    append(all, target.X_FT.matrix());
  }
  append(all, estimate.effects);
  append(all, c.covariance);
  append(all, c.exported.estimate.errors);
  for (const ParameterEstimate& parameter : c.parameters) {
    all.insert(all.end(), {parameter.value, parameter.error, parameter.std});
  }
  all.insert(all.end(), {c.identification.rms, static_cast<double>(c.identification.iterations), c.noise.sigma,
                         c.noise.degrees_of_freedom, c.noise.variance_factor, c.identifiability.condition,
                         c.observability.O1, c.observability.O5, c.priors.length, c.priors.angle});
  append(all, c.noise.independent);
  append(all, c.noise.common);
  if (c.noise.repeats) {
    append(all, c.noise.repeats->independent);
    append(all, c.noise.repeats->common);
    all.push_back(c.noise.repeats->orientation);
  }
  for (const ModelOption& option : c.tried) {
    all.insert(all.end(), {option.priors.length, static_cast<double>(option.effects.size()), option.held_out_rms});
  }
  for (const ErrorStatistics& s : {c.train.before, c.train.after, c.iso_before.accuracy, c.iso_after.accuracy,
                                   c.iso_after.repeatability, c.predicted.workspace}) {
    append(all, s);
  }
  if (c.leave_one_out) {
    append(all, c.leave_one_out->before);
    append(all, c.leave_one_out->after);
  }
  append(all, c.nested_leave_one_out.value_or(ErrorStatistics{}));
  append(all, c.k_fold ? c.k_fold->after : ErrorStatistics{});
  if (c.lack_of_fit) {
    all.insert(all.end(), {c.lack_of_fit->f, c.lack_of_fit->p_value});
    all.insert(all.end(), c.lack_of_fit->explained_by_joint.begin(), c.lack_of_fit->explained_by_joint.end());
  }
  for (const ConfigurationInfluence& configuration : c.influence.configurations) {
    all.insert(all.end(), {configuration.leverage, configuration.cook});
  }
  for (std::size_t row = 0; row < c.weights.size(); ++row) {
    all.push_back(rows[row].split == Split::train ? c.weights[row] : 0.0);
  }
  return all;
}

bool same_bytes(const std::vector<double>& a, const std::vector<double>& b) {
  return a.size() == b.size() && std::memcmp(a.data(), b.data(), a.size() * sizeof(double)) == 0;
}

TEST(Combinations, TestRowsChangeNothingThatIsFitted) {
  std::vector<std::pair<std::string, CalibrationOptions>> cases(5);
  cases[0].first = "equal weights";
  cases[1].first = "chosen priors and effects, nested and folds";
  cases[1].second.automatic_priors = true;
  cases[1].second.effects.automatic = true;
  cases[1].second.leave_one_out = true;
  cases[1].second.nested = true;
  cases[1].second.k_fold = 3;
  cases[2].first = "repeats";
  cases[2].second.weights = Weights::repeats;
  cases[3].first = "Tukey and common noise";
  cases[3].second.loss = Loss::tukey;
  cases[3].second.noise = {.independent = Vector3d::Constant(1e-4), .common = Vector3d::Constant(1e-4)};
  cases[4].first = "tracker";
  cases[4].second.noise.tracker = TrackerNoise{.range = 1e-4, .transverse_per_metre = 1e-4};
  for (auto& entry : cases) {
    entry.second.try_readings = false;
  }
  Arm arm = posed_arm(10, 2, 16);
  for (Observation& o : arm.measured.observations) {
    o.split = o.configuration % 4 == 1 ? Split::test : Split::train;
  }
  Measurements spoilt = arm.measured;
  for (std::size_t row = 0; row < spoilt.observations.size(); ++row) {
    Observation& o = spoilt.observations[row];
    if (o.split == Split::test) {
      o.position += Vector3d(0.1, -0.2, 0.05) * (1.0 + 0.1 * static_cast<double>(row % 7));
      spoilt.orientations[row] = spoilt.orientations[row] * Eigen::Quaterniond(testing::turned_by({0.1, 0.2, -0.1}));
      spoilt.joint_values.col(o.configuration).setConstant(0.1 + 0.01 * o.configuration);
    }
  }
  const Measurements absent = subset(arm.measured, [](const Observation& o) { return o.split == Split::train; });
  for (const auto& [name, options] : cases) {
    SCOPED_TRACE(name);
    const Calibration found = calibrate(arm.model, arm.measured, options);
    const Calibration after = calibrate(arm.model, spoilt, options);
    const std::vector<double> expected = fitted_numbers(found, arm.measured.observations);
    EXPECT_TRUE(same_bytes(fitted_numbers(after, spoilt.observations), expected)) << "spoilt test rows";
    ASSERT_TRUE(found.test.has_value() && after.test.has_value());
    EXPECT_GT(after.test->after.rms, found.test->after.rms + 0.1);
    if (options.loss == Loss::none) {  // the weights of rows that are not there cannot be compared
      const Calibration alone = calibrate(arm.model, absent, options);
      EXPECT_TRUE(same_bytes(fitted_numbers(alone, absent.observations), expected)) << "no test rows";
    }
  }
}

}  // namespace
}  // namespace kdl_calibration::combinations_test
