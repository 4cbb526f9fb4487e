// Left-out configurations against the normal equations of the others, which are summed anew for every fold.

#include "validation/fold_prediction.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "model/kinematics.hpp"
#include "planning/simulation.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::fold_prediction_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Folds = std::vector<std::vector<Index>>;

Eigen::Isometry3d askew() {
  return Eigen::Translation3d(2.0, -3.0, 0.5) * Eigen::AngleAxisd(1.1, Vector3d(0.3, -0.2, 0.9).normalized());
}

// Three points on the tool of an arm that stands some metres away.
testing::VirtualExperiment arm() {
  static const testing::VirtualExperiment experiment({.X_WB = askew()});
  return experiment;
}

FitProblem at_optimum(const testing::VirtualExperiment& experiment, const Measurements& measured,
                      const FitOptions& options = {}) {
  FitProblem problem{.model = experiment.model,
                     .measurements = measured,
                     .start = nominal_start(experiment.model, measured),
                     .free = experiment.free,
                     .options = options};
  problem.start = fit(problem).estimate;
  return problem;
}

MatrixXd triangle_of(const FitProblem& problem) {
  return LeastSquaresProblem(problem.model, problem.measurements, problem.free, problem.options.joint.residuals)
      .whitened_summary(problem.start)
      .sqrt_information;
}

FoldPrediction predicted(const FitProblem& problem, const Folds& folds, double noise) {
  const MatrixXd sqrt_information = triangle_of(problem);
  return predict_folds({.problem = problem, .sqrt_information = sqrt_information, .noise = noise}, folds, 2);
}

Measurements others_than(const Measurements& measurements, const std::vector<Index>& fold) {
  return subset(measurements, [&](const Observation& o) {
    return o.split == Split::train && std::find(fold.begin(), fold.end(), o.configuration) == fold.end();
  });
}

// The step that the others ask for from the optimum of all, and the covariance that they give the columns.
struct ByTheOthers {
  VectorXd step;
  MatrixXd covariance;

  ByTheOthers(const FitProblem& problem, const std::vector<Index>& fold) {
    const Measurements others = others_than(problem.measurements, fold);
    const WhitenedSystem system =
        LeastSquaresProblem(problem.model, others, problem.free, problem.options.joint.residuals)
            .whitened(problem.start);
    const VectorXd scale = system.jacobian.colwise().norm().cwiseInverse();
    const Eigen::HouseholderQR<MatrixXd> qr(MatrixXd(system.jacobian * scale.asDiagonal()));
    step = scale.cwiseProduct(qr.solve(system.residual));
    const MatrixXd R = qr.matrixQR().topRows(scale.size()).triangularView<Eigen::Upper>();
    const MatrixXd root = R.triangularView<Eigen::Upper>().solve(MatrixXd::Identity(R.rows(), R.cols()));
    covariance = scale.asDiagonal() * root * root.transpose() * scale.asDiagonal();
  }
};

Vector3d expected_at(const FitProblem& problem, const Estimate& estimate, const HeldOutPoint& point) {
  const VectorXd q = problem.measurements.joint_values.col(point.configuration);
  return testing::kdl_point(error_chain(problem.model, estimate.errors), estimate, q, point.target);
}

// What was measured of a target in a configuration, by the mean of its training rows.
struct Mean {
  Vector3d position = Vector3d::Zero();
  double rows = 0.0;
};

Mean mean_of(const Measurements& measurements, Index configuration, int target) {
  Mean mean;
  for (const Observation& o : measurements.observations) {
    if (o.configuration == configuration && o.target == target && o.split == Split::train) {
      mean.rows += 1.0;
      mean.position += o.position();
    }
  }
  mean.position /= mean.rows;
  return mean;
}

// Configuration and target of each point that is to come.
std::vector<std::pair<int, int>> places_of(const Measurements& measurements, const Folds& folds) {
  std::vector<std::pair<int, int>> places;
  for (std::vector<Index> fold : folds) {
    std::sort(fold.begin(), fold.end());
    for (const Index c : fold) {
      for (int k = 0; k < static_cast<int>(measurements.targets.size()); ++k) {
        if (mean_of(measurements, c, k).rows > 0.0) {
          places.emplace_back(c, k);
        }
      }
    }
  }
  return places;
}

// `every`: of so many folds one is looked at closely.
void expect_by_the_others(const FitProblem& problem, const Folds& folds, const FoldPrediction& found,
                          std::size_t every = 1) {
  const auto places = places_of(problem.measurements, folds);
  ASSERT_EQ(found.points.size(), places.size());
  EXPECT_EQ(distances_of(found).size(), places.size());
  const PositionPredictor predictor(problem.model, problem.start, problem.free);
  for (std::size_t place = 0; place < places.size(); ++place) {
    EXPECT_EQ(std::pair(found.points[place].configuration, found.points[place].target), places[place]);
  }
  for (std::size_t f = 0; f < folds.size(); f += every) {
    const std::vector<Index>& fold = folds[f];
    const ByTheOthers others(problem, fold);
    for (std::size_t place = 0; place < places.size(); ++place) {
      const HeldOutPoint& point = found.points[place];
      if (std::find(fold.begin(), fold.end(), places[place].first) == fold.end()) {
        continue;
      }
      SCOPED_TRACE("point " + std::to_string(place));
      const Mean mean = mean_of(problem.measurements, point.configuration, point.target);
      EXPECT_EQ(point.repeats, mean.rows);
      EXPECT_LT((point.measured - mean.position).norm(), 1e-12);
      const MatrixXd J = predictor.jacobians(
          problem.measurements.joint_values.col(point.configuration))[static_cast<std::size_t>(point.target)];
      const Vector3d left = mean.position - expected_at(problem, problem.start, point) - J * others.step;
      EXPECT_LT((point.residual - left).norm(), 1e-10);
      EXPECT_NEAR(distances_of(found)[place], left.norm(), 1e-10);
      const Eigen::Matrix3d covariance = J * others.covariance * J.transpose();
      EXPECT_LT((point.covariance - covariance).norm(), 1e-7 * covariance.norm());
    }
  }
}

Folds one_by_one(Index count) {
  Folds folds(static_cast<std::size_t>(count));
  for (Index c = 0; c < count; ++c) {
    folds[static_cast<std::size_t>(c)] = {c};
  }
  return folds;
}

TEST(FoldPrediction, OfFoldsOfEverySizeIsThatOfTheNormalEquationsOfTheOthers) {
  testing::VirtualExperiment experiment = arm();
  Measurements measured = subset(experiment.measure(40, {.sigma = 1e-5, .repeats = 2}), [](const Observation& o) {
    return !(o.configuration % 5 == 1 && o.target == 1) && !(o.configuration % 7 == 3 && o.repeat == 2);
  });
  for (Observation& o : measured.observations) {
    o.split = o.configuration % 11 == 4 ? Split::test : Split::train;
  }
  FitOptions options;
  options.joint.residuals.noise = {.independent = Vector3d(1e-5, 2e-5, 1e-5), .common = Vector3d::Constant(1e-5)};
  const FitProblem problem = at_optimum(experiment, measured, options);
  std::vector<Index> wide;  // more rows than columns
  for (Index c = 18; c < 34; ++c) {
    if (c % 11 != 4) {
      wide.push_back(c);
    }
  }
  const Folds folds = {{12, 2, 7}, {0}, wide, {39, 38}};
  const FoldPrediction found = predicted(problem, folds, 1e-5);
  EXPECT_EQ(found.refits, 0);
  EXPECT_EQ(found.not_converged, 0);
  expect_by_the_others(problem, folds, found);
}

TEST(FoldPrediction, OfMoreFoldsThanAreLookedAtTogetherIsThatOfEachAlone) {
  testing::VirtualExperiment experiment = arm();
  const Measurements measured = testing::without_sigmas(experiment.measure(67, {.sigma = 1e-5}));
  const FitProblem problem = at_optimum(experiment, measured);
  const Folds folds = one_by_one(67);
  const FoldPrediction found = predicted(problem, folds, 1e-5);
  EXPECT_EQ(found.refits, 0);
  expect_by_the_others(problem, folds, found, 6);
}

TEST(FoldPrediction, OfPosesTakesTheirOrientationsIntoAccount) {
  testing::VirtualExperiment experiment({.targets = testing::as_frames(published_targets(2)), .X_WB = askew()});
  Measurements measured =
      testing::without_sigmas(experiment.measure(20, {.sigma = 1e-5, .orientation_sigma = 1e-5, .repeats = 2}));
  for (Observation& o : measured.observations) {
    if (o.configuration % 4 == 1 && o.target == 0) {
      testing::remove_orientation(o);
    }
  }
  const FitProblem problem = at_optimum(experiment, measured);
  const Folds folds = {{1}, {4, 3}, {19}};
  const FoldPrediction found = predicted(problem, folds, 1e-5);
  EXPECT_EQ(found.refits, 0);
  expect_by_the_others(problem, folds, found);
}

Estimate refitted(const FitProblem& problem, const std::vector<Index>& fold) {
  const Measurements others = others_than(problem.measurements, fold);
  return fit(with_measurements(problem, others)).estimate;
}

TEST(FoldPrediction, IsARefitWhereTheLinearOneIsOffBesideTheNoise) {
  testing::VirtualExperiment experiment = arm();
  const Measurements measured = testing::without_sigmas(experiment.measure(14, {.sigma = 1e-3}));
  FitProblem problem = at_optimum(experiment, measured);
  std::atomic<int> fits = 0;
  problem.options.after_fit = [&] { ++fits; };
  const Folds folds = {{5, 1}};
  const FoldPrediction linear = predicted(problem, folds, 1.0);
  EXPECT_EQ(linear.refits, 0);
  expect_by_the_others(problem, folds, linear);
  fits = 0;
  const FoldPrediction refit = predicted(problem, folds, 1e-9);
  EXPECT_EQ(fits, 1);
  EXPECT_EQ(refit.refits, 1);
  EXPECT_EQ(refit.not_converged, 0);
  const Estimate expected = refitted(problem, folds[0]);
  ASSERT_EQ(refit.points.size(), linear.points.size());
  for (std::size_t i = 0; i < refit.points.size(); ++i) {
    const HeldOutPoint& point = refit.points[i];
    EXPECT_EQ(point.configuration, linear.points[i].configuration);
    EXPECT_EQ(point.target, linear.points[i].target);
    EXPECT_EQ(point.measured, linear.points[i].measured);
    EXPECT_LT((point.residual - (point.measured - expected_at(problem, expected, point))).norm(), 1e-9);
    EXPECT_EQ(point.covariance, linear.points[i].covariance);
  }
  fits = 0;
  problem.options.joint.max_iterations = 1;
  const FoldPrediction halfway = predicted(problem, {{5, 1}, {2}, {3}}, 0.0);
  EXPECT_EQ(fits, 3);
  EXPECT_EQ(halfway.refits, 3);
  EXPECT_EQ(halfway.not_converged, 3);
}

TEST(FoldPrediction, CallsBehindEachFoldThatIsPredictedWithoutAFit) {
  testing::VirtualExperiment experiment = arm();
  const Measurements measured = experiment.measure(40, {.sigma = 1e-6});
  FitProblem problem = at_optimum(experiment, measured);
  std::atomic<int> fits = 0;
  problem.options.after_fit = [&] { ++fits; };
  EXPECT_EQ(predicted(problem, one_by_one(40), 1e-3).refits, 0);
  EXPECT_EQ(fits, 40);
}

TEST(FoldPrediction, IsARefitWhereAllTogetherDoNotDetermineTheColumns) {
  testing::VirtualExperiment experiment = arm();
  const Measurements measured = testing::without_sigmas(experiment.measure(14, {.sigma = 1e-5}));
  const FitProblem determined = at_optimum(experiment, measured);
  FitProblem problem = determined;
  std::vector<std::string> names = experiment.free.names();
  names.emplace_back("dq1");  // does what base.Rz does
  problem.free = Unknowns(experiment.model, experiment.targets, names);
  const FoldPrediction found = predicted(problem, {{3}, {4, 2}}, 1.0);
  const FoldPrediction expected = predicted(determined, {{3}, {4, 2}}, 0.0);
  EXPECT_EQ(found.refits, 2);
  ASSERT_EQ(found.points.size(), expected.points.size());
  for (std::size_t i = 0; i < found.points.size(); ++i) {
    EXPECT_EQ(found.points[i].configuration, expected.points[i].configuration);
    EXPECT_EQ(found.points[i].target, expected.points[i].target);
    EXPECT_LT((found.points[i].residual - expected.points[i].residual).norm(), 1e-7);
    EXPECT_TRUE((found.points[i].covariance.array() == std::numeric_limits<double>::infinity()).all());
  }
  const MatrixXd nothing = MatrixXd::Zero(3, determined.free.size());
  const FoldPrediction unknown =
      predict_folds({.problem = determined, .sqrt_information = nothing, .noise = 1.0}, {{3}, {4, 2}});
  EXPECT_EQ(unknown.refits, 2);
  EXPECT_TRUE(std::isinf(unknown.points.back().covariance(2, 0)));
}

}  // namespace
}  // namespace kdl_calibration::fold_prediction_test
