#include "planning/pose_selection.hpp"
#include "robot/joint_ranges.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "planning/point_rows.hpp"
#include "planning/simulation.hpp"
#include "planning/workspace.hpp"
#include "refusal.hpp"
#include "support.hpp"

namespace kdl_calibration::pose_selection_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using testing::circle_of_targets;
using testing::kDegree;

// Elevation of the forearm -80 to 90 degrees with |q3| < 150 degrees, targets above 0.2 m and 0.7 m from axis 1.
Cell free_space(const ErrorModel& model) {
  Cell cell;
  cell.ranges = limits_of(model.joints);
  cell.ranges[2].second = 150 * kDegree;
  Eigen::VectorXd weights = Eigen::VectorXd::Zero(6);
  weights[1] = 1.0;
  weights[2] = 1.0;
  cell.sums.push_back({.name = "elevation", .weights = weights, .lower = -80 * kDegree, .upper = 90 * kDegree});
  cell.height = 0.2;
  cell.radius = 0.7;
  return cell;
}

struct Fixture {
  explicit Fixture(int count, int elsewhere) {
    const Robot robot = testing::fanuc();
    const ErrorModel model = complete_model(robot);
    const Candidates found = candidates(robot, circle_of_targets(), free_space(model), {.count = count + elsewhere});
    experiment = nominal_experiment(model, circle_of_targets(), {.sigma = 3e-5});
    all = found.joint_values.leftCols(count);
    tasks = found.joint_values.rightCols(elsewhere);
    none = MatrixXd::Zero(columns(experiment), columns(experiment));
  }
  Experiment experiment;
  MatrixXd all;
  MatrixXd tasks;
  MatrixXd none;
};

double log_det(const MatrixXd& M) { return 2.0 * M.llt().matrixLLT().diagonal().array().log().sum(); }

TEST(PoseSelection, ChoosesForATrackersNoise) {
  Fixture f(500, 1);
  const Selection blind = select_configurations(f.experiment, {f.all, f.none}, {.starts = 2});
  f.experiment.noise.tracker = TrackerNoise{.range = 5e-6, .transverse = 2e-5, .transverse_per_metre = 2e-5};
  f.experiment.noise.tracker_position = {3.5, 0.0, 1.0};
  const Selection aware = select_configurations(f.experiment, {f.all, f.none}, {.starts = 2});
  EXPECT_GT(log_det(aware.information), log_det(information(f.experiment, f.all(Eigen::all, blind.chosen))) + 0.5);
  const double efficiency = d_efficiency(f.experiment, {f.all, f.none}, aware.information, 30);
  EXPECT_GT(efficiency, 0.9);
  EXPECT_LE(efficiency, 1.0);
}

TEST(PoseSelection, PromisesThePublishedAccuracyIn5000Candidates) {
  const Fixture f(5000, 5000);
  const Selection d = select_configurations(f.experiment, {f.all, f.none}, {.starts = 2});
  EXPECT_EQ(d.chosen.size(), 30U);
  EXPECT_GT(d.exchanges, 0);
  const Prediction d_promise = predicted(f.experiment, d.information, f.tasks);
  EXPECT_LE(d_promise.sigma.mean, 0.0180e-3);
  EXPECT_LE(d_promise.sigma.max, 0.0202e-3);

  const Selection i =
      select_configurations(f.experiment, {f.all, f.none}, {.criterion = Criterion::i_optimal, .starts = 2});
  const Prediction i_promise = predicted(f.experiment, i.information, f.tasks);
  EXPECT_LE(i_promise.sigma.mean, 0.0177e-3);

  const auto draws = predicted(f.experiment, random_designs(f.experiment, {f.all, f.none}, {.count = 30, .draws = 200}),
                               f.tasks.leftCols(500));
  double mean = 0.0;
  for (const Prediction& draw : draws) {
    mean += draw.sigma.mean / 200.0;
    EXPECT_GE(draw.worst_configuration, floor_of_worst_configuration(f.experiment, 30));
  }
  EXPECT_NEAR(mean, 0.0205e-3, 0.0005e-3);
  EXPECT_GE(d_promise.worst_configuration, floor_of_worst_configuration(f.experiment, 30));
  EXPECT_GE(i_promise.worst_configuration, floor_of_worst_configuration(f.experiment, 30));
  const double efficiency = d_efficiency(f.experiment, {f.all, f.none}, d.information, 30);
  EXPECT_GT(efficiency, 0.95);
  EXPECT_LE(efficiency, 1.0);
}

TEST(PoseSelection, GivesTheSameAnswerOnAnyNumberOfThreads) {
  const Fixture f(100, 40);
  for (const Criterion criterion : {Criterion::d_optimal, Criterion::g_optimal, Criterion::i_optimal}) {
    SelectionOptions options{.criterion = criterion, .count = 8, .starts = 3, .threads = 1};
    const Selection one = select_configurations(f.experiment, {f.all, f.none, f.tasks}, options);
    options.threads = 3;
    const Selection three = select_configurations(f.experiment, {f.all, f.none, f.tasks}, options);
    EXPECT_EQ(one.chosen, three.chosen);
    EXPECT_EQ(one.information, three.information);
    EXPECT_EQ(one.exchanges, three.exchanges);
    EXPECT_EQ(std::set<Index>(one.chosen.begin(), one.chosen.end()).size(), 8U);
  }
}

TEST(PoseSelection, FindsTheBestOfAllSubsetsWhereTheyCanBeCounted) {
  const Fixture f(12, 1);
  for (const Criterion criterion : {Criterion::d_optimal, Criterion::i_optimal}) {
    const SelectionOptions options{.criterion = criterion, .count = 6};
    double best = std::numeric_limits<double>::infinity();
    const MatrixXd tasks_information = information(f.experiment, f.all) * (9e-10 / 36.0);
    for (unsigned bits = 0; bits < 1U << 12U; ++bits) {
      std::vector<Index> members;
      for (Index i = 0; i < 12; ++i) {
        if ((bits >> static_cast<unsigned>(i) & 1U) != 0) {
          members.push_back(i);
        }
      }
      if (members.size() == 6) {
        const MatrixXd M = information(f.experiment, f.all(Eigen::all, members));
        const Eigen::LLT<MatrixXd> llt(M);
        best = std::min(best, criterion == Criterion::d_optimal ? -log_det(M) : llt.solve(tasks_information).trace());
      }
    }
    const Selection found = select_configurations(f.experiment, {f.all, f.none}, options);
    if (criterion == Criterion::d_optimal) {
      EXPECT_NEAR(found.objective, -best, 1e-6 * std::abs(best));
      EXPECT_NEAR(found.objective, log_det(found.information), 1e-9 * std::abs(best));
    } else {
      EXPECT_NEAR(found.objective / best, 1.0, 1e-5);
    }
  }
}

TEST(PoseSelection, EachCriterionIsBestAtWhatItAsksFor) {
  const Fixture f(1100, 1100);  // more than one block of them
  std::vector<Prediction> promises;
  std::vector<double> determinants;
  for (const Criterion criterion : {Criterion::d_optimal, Criterion::g_optimal, Criterion::i_optimal}) {
    const Selection found = select_configurations(f.experiment, {f.all, f.none, f.tasks},
                                                  {.criterion = criterion, .count = 20, .starts = 2});
    promises.push_back(predicted(f.experiment, found.information, f.tasks));
    determinants.push_back(log_det(found.information));
    if (criterion == Criterion::g_optimal) {
      EXPECT_NEAR(std::sqrt(found.objective) / promises.back().sigma.max, 1.0, 1e-3);
    }
    if (criterion == Criterion::i_optimal) {
      EXPECT_NEAR(std::sqrt(found.objective) / promises.back().sigma.rms, 1.0, 1e-3);
    }
  }
  EXPECT_GE(determinants[0], determinants[1]);
  EXPECT_GT(determinants[0], determinants[2]);
  EXPECT_LE(promises[1].sigma.max, promises[0].sigma.max);
  EXPECT_LT(promises[1].sigma.max, promises[2].sigma.max);
  EXPECT_LT(promises[2].sigma.rms, promises[0].sigma.rms);
  EXPECT_LT(promises[2].sigma.rms, promises[1].sigma.rms);
}

// ---- Against plain double arithmetic -------------------------------------------------------------------------------

// What is to be made small.
double value_of(const MatrixXd& M, const MatrixXd& weights) {
  const Eigen::LLT<MatrixXd> llt(M);
  if (llt.info() != Eigen::Success) {
    return std::numeric_limits<double>::infinity();
  }
  return weights.size() == 0 ? -2.0 * llt.matrixLLT().diagonal().array().log().sum() : llt.solve(weights).trace();
}

// The best value after adding one candidate that is no member, or after taking a member away.
double step(const std::vector<MatrixXd>& own, const MatrixXd& weights, bool adds, MatrixXd& M,
            std::vector<bool>& member) {
  double best = std::numeric_limits<double>::infinity();
  std::size_t which = own.size();
  for (std::size_t i = 0; i < own.size(); ++i) {
    if (member[i] != adds) {
      const double value = value_of(M + (adds ? 1.0 : -1.0) * own[i], weights);
      which = value < best ? i : which;
      best = std::min(best, value);
    }
  }
  M += (adds ? 1.0 : -1.0) * own[which];
  member[which] = adds;
  return best;
}

// Neither so many additions and then removals, nor the other way round, make a better design.
void expect_no_excursion_helps(const std::vector<MatrixXd>& own, const MatrixXd& weights, const Selection& found,
                               int length) {
  const double value = value_of(found.information, weights);
  for (const bool additions_first : {true, false}) {
    MatrixXd M = found.information;
    std::vector<bool> member(own.size(), false);
    for (const Index i : found.chosen) {
      member[static_cast<std::size_t>(i)] = true;
    }
    double after = value;
    for (int i = 0; i < 2 * length; ++i) {
      after = step(own, weights, (i < length) == additions_first, M, member);
    }
    EXPECT_GT(after, value - 1e-3 * (weights.size() == 0 ? 1.0 : value)) << length << " at once";
  }
}

TEST(PoseSelection, EndsWhereNoExcursionHelps) {
  const Fixture f(60, 40);
  std::vector<MatrixXd> own;
  for (const auto& q : f.all.colwise()) {
    own.push_back(information(f.experiment, MatrixXd(q)));
  }
  // Its product with the covariance is the mean variance of a target in the tasks.
  MatrixXd mean = MatrixXd::Zero(f.none.rows(), f.none.cols());
  const PointRows rows(f.experiment);
  for (const auto& q : f.tasks.colwise()) {
    const MatrixXd J = rows.rows(rows.points(), q);
    mean += J.transpose() * J / (3.0 * static_cast<double>(f.tasks.cols()));
  }
  for (const int depth : {1, 3}) {
    const SelectionTask task{f.all, f.none, f.tasks};
    SelectionOptions options{.count = 9, .starts = 1, .depth = depth};
    const Selection d = select_configurations(f.experiment, task, options);
    EXPECT_NEAR(d.objective, log_det(d.information), 1e-9 * std::abs(d.objective));
    for (int length = 1; length <= depth; ++length) {
      expect_no_excursion_helps(own, MatrixXd(), d, length);
    }
    options.criterion = Criterion::i_optimal;
    const Selection i = select_configurations(f.experiment, task, options);
    EXPECT_NEAR(i.objective / value_of(i.information, mean), 1.0, 1e-5);
    // Candidates are ranked to first order: longer ones may miss the best of them.
    expect_no_excursion_helps(own, mean, i, 1);
  }
}

// A bound on the best of all designs: none of them is above it, and it is not far above the best that is found.
TEST(PoseSelection, StatesAnEfficiencyThatNoDesignExceeds) {
  const Fixture f(80, 1);
  const SelectionTask task{f.all, f.none};
  const Selection best = select_configurations(f.experiment, task, {.count = 12, .starts = 8});
  const double of_best = d_efficiency(f.experiment, task, best.information, 12);
  EXPECT_LE(of_best, 1.0);
  EXPECT_GT(of_best, 0.85);
  const double size = static_cast<double>(f.none.rows());
  for (const MatrixXd& design : random_designs(f.experiment, task, {.count = 12, .draws = 20})) {
    const double efficiency = d_efficiency(f.experiment, task, design, 12);
    EXPECT_LT(efficiency, of_best);
    // The bound is the same for all designs: efficiencies differ as determinants do.
    EXPECT_NEAR(efficiency / of_best, std::exp((log_det(design) - log_det(best.information)) / size), 1e-4);
  }
}

TEST(PoseSelection, RandomDesignsHaveEachCandidateOnceAndAnyOfThem) {
  const Fixture f(6, 1);
  const MatrixXd given = 1e6 * MatrixXd::Identity(f.none.rows(), f.none.cols());
  const MatrixXd total = given + information(f.experiment, f.all);
  const std::vector<MatrixXd> designs = random_designs(f.experiment, {f.all, given}, {.count = 5, .draws = 240});
  ASSERT_EQ(designs.size(), 240U);
  std::vector<int> left_out(6, 0);
  for (const MatrixXd& design : designs) {
    int fits = 0;
    for (Index i = 0; i < 6; ++i) {
      const bool without =
          (total - design - information(f.experiment, MatrixXd(f.all.col(i)))).norm() < 1e-9 * total.norm();
      left_out[static_cast<std::size_t>(i)] += without ? 1 : 0;
      fits += without ? 1 : 0;
    }
    EXPECT_EQ(fits, 1) << "five of six, each once";
  }
  for (const int count : left_out) {
    EXPECT_GE(count, 20);  // of 40 on average
    EXPECT_LE(count, 65);
  }
  const std::vector<MatrixXd> all = random_designs(f.experiment, {f.all, given}, {.count = 6, .draws = 1});
  EXPECT_LT((all[0] - total).norm(), 1e-12 * total.norm());
  EXPECT_NE(random_designs(f.experiment, {f.all, given}, {.count = 2, .seed = 1})[0],
            random_designs(f.experiment, {f.all, given}, {.count = 2, .seed = 2})[0]);
}

TEST(PoseSelection, TellsTheShareOfTheStartsThatAreDone) {
  const Fixture f(40, 1);
  std::vector<double> shares;
  select_configurations(f.experiment, {f.all, f.none},
                        {.count = 6, .starts = 3, .threads = 1, .progress = [&](double s) { shares.push_back(s); }});
  EXPECT_THAT(shares, ::testing::ElementsAre(0.25, 0.5, 0.75));
}

TEST(PoseSelection, AddsWhatIsMissingToWhatWasMeasured) {
  const Fixture f(1000, 500);
  // Measured: a corner of the workspace, far too little for all parameters.
  std::vector<Index> corner;
  for (Index c = 0; c < f.all.cols() && corner.size() < 10; ++c) {
    if (f.all(0, c) > 1.0 && f.all(1, c) > 0.2) {
      corner.push_back(c);
    }
  }
  const MatrixXd measured = information(f.experiment, f.all(Eigen::all, corner));
  const Selection added = select_configurations(f.experiment, {f.all, measured}, {.count = 8, .starts = 4});
  const Selection blind = select_configurations(f.experiment, {f.all, f.none}, {.count = 8, .starts = 4});
  const MatrixXd chosen = f.all(Eigen::all, added.chosen);
  EXPECT_LT((added.information - measured - information(f.experiment, chosen)).norm(), 1e-9 * added.information.norm());
  EXPECT_GT(log_det(added.information), log_det(measured + blind.information));
}

TEST(PoseSelection, FindsTheSmallestNumberForAnAccuracy) {
  const Fixture f(150, 60);
  const SelectionOptions options{.count = 20, .starts = 2};
  const Selection found = select_for_accuracy(f.experiment, {f.all, f.none, f.tasks}, 0.03e-3, Figure::mean, options);
  EXPECT_LE(predicted(f.experiment, found.information, f.tasks).sigma.mean, 0.03e-3);
  SelectionOptions one_less = options;
  one_less.count = static_cast<int>(found.chosen.size()) - 1;
  const Selection fewer = select_configurations(f.experiment, {f.all, f.none, f.tasks}, one_less);
  EXPECT_GT(predicted(f.experiment, fewer.information, f.tasks).sigma.mean, 0.03e-3);
  EXPECT_THROW(select_for_accuracy(f.experiment, {f.all, f.none, f.tasks}, 1e-6, Figure::max, options), InputError);
}

TEST(PoseSelection, SaysWhyItCannotChoose) {
  const Fixture f(40, 1);
  const auto refused = [&](const MatrixXd& all, const MatrixXd& given, const SelectionOptions& options) {
    return testing::refusal([&] { select_configurations(f.experiment, {all, given}, options); });
  };
  for (const SelectionOptions& none : {SelectionOptions{.count = 0}, SelectionOptions{.count = 5, .starts = 0},
                                       SelectionOptions{.count = 5, .depth = 0}}) {
    EXPECT_EQ(refused(f.all, f.none, none), "the numbers of configurations, starts and the depth must be positive");
  }
  // Of 33 parameters 15 are known: nine coordinates of a configuration do not tell the others.
  MatrixXd known = f.none;
  known.diagonal().head(15).setConstant(1e8);
  EXPECT_THAT(
      refused(f.all, known, {.count = 1}),
      ::testing::HasSubstr("1 configurations of 3 targets cannot determine 33 parameters, expected at least 2"));
  EXPECT_THAT(refused(f.all, f.none, {.count = 3}), ::testing::HasSubstr("expected at least 4 configurations"));
  EXPECT_THAT(refused(f.all, f.none, {.count = 41}), ::testing::HasSubstr("40 candidates"));
  MatrixXd stiff = f.all;
  stiff.row(4).setConstant(0.3);
  EXPECT_THAT(refused(stiff, f.none, {.count = 30}), ::testing::HasSubstr("cannot tell apart"));
  // Priors make up for it.
  Experiment with_priors = f.experiment;
  with_priors.priors = {.length = 1e-3, .angle = 1e-3};
  const MatrixXd given = prior_information(with_priors);
  EXPECT_EQ(select_configurations(with_priors, {stiff, given}, {.count = 8, .starts = 2}).chosen.size(), 8U);
}

}  // namespace
}  // namespace kdl_calibration::pose_selection_test
