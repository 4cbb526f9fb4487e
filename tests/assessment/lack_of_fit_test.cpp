#include "kdl_calibration/lack_of_fit.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "assessment/noise_strata.hpp"
#include "base/f_distribution.hpp"
#include "kdl_calibration/identification.hpp"
#include "kdl_calibration/kinematics.hpp"
#include "record.hpp"
#include "refusal.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration {
namespace {

using testing::VirtualExperiment;

struct Sort {
  std::string name;
  int repeats = 2;
  double common = 0.0;  // [m] of a repeat
};

const std::vector<Sort>& sorts() {
  static const std::vector<Sort> all = {{"2 repeats", 2},
                                        {"3 repeats", 3},
                                        {"10 repeats", 10},
                                        {"2 repeats, common", 2, 4e-5},
                                        {"3 repeats, common", 3, 4e-5},
                                        {"10 repeats, common", 10, 4e-5}};
  return all;
}

struct Alarms {
  double of_twenty = 0.0;    // share of p-values below 0.05
  double of_thousand = 0.0;  // below 0.001
  double mean = 0.0;         // of the p-values
};

// Of arms that the model describes: 30 configurations, three targets.
Alarms false_alarms(const Sort& sort, int runs) {
  VirtualExperiment experiment;
  Alarms result;
  for (int run = 0; run < runs; ++run) {
    experiment.restart(Random(41, static_cast<std::uint64_t>(run)));
    const Measurements measured = testing::without_sigmas(experiment.measure(
        30, {.sigma = 1e-5, .repeats = sort.repeats, .common = Eigen::Vector3d::Constant(sort.common)}));
    const Identification fit = identify_jointly(experiment.model, measured, experiment.robot.truth, experiment.free);
    const double p = test_lack_of_fit(experiment.model, measured, fit.estimate, experiment.free).value().p_value;
    result.of_twenty += (p < 0.05 ? 1.0 : 0.0) / runs;
    result.of_thousand += (p < 0.001 ? 1.0 : 0.0) / runs;
    result.mean += p / runs;
  }
  return result;
}

// `sigmas` of the share that many runs scatter by.
void expect_as_many_alarms_as_stated(int runs, double sigmas) {
  for (const Sort& sort : sorts()) {
    const Alarms found = false_alarms(sort, runs);
    testing::record(sort.name + ", share below 0.05", found.of_twenty);
    testing::record(sort.name + ", share below 0.001", found.of_thousand);
    testing::record(sort.name + ", mean p", found.mean);
    EXPECT_NEAR(found.of_twenty, 0.05, 0.01 + sigmas * std::sqrt(0.05 * 0.95 / runs)) << sort.name;
    EXPECT_LE(found.of_thousand, 0.002 + sigmas * std::sqrt(0.001 / runs)) << sort.name;
    EXPECT_NEAR(found.mean, 0.5, 0.02 + sigmas * std::sqrt(1.0 / 12.0 / runs)) << sort.name;
  }
}

TEST(LackOfFit, IsFalselyFoundAsOftenAsItSays) { expect_as_many_alarms_as_stated(60, 2.5); }

TEST(LackOfFitLongRun, IsFalselyFoundAsOftenAsItSays) { expect_as_many_alarms_as_stated(400, 2.5); }

TEST(LackOfFitCampaign, IsFalselyFoundAsOftenAsItSays) { expect_as_many_alarms_as_stated(5000, 0.0); }

// Three configurations of one target give nine coordinates, and base and target take them all.
TEST(LackOfFit, IsNotAskedWhereTheMeansLeaveNoFreedom) {
  VirtualExperiment experiment({.targets = published_targets(1)});
  std::vector<std::string> names = experiment.free.names();
  std::erase_if(names, [](const std::string& name) { return !name.starts_with("base.") && !name.starts_with("A."); });
  const Unknowns free(experiment.model, experiment.targets, names);
  ASSERT_EQ(free.size(), 9);
  const auto tested = [&](int configurations) {
    const Measurements measured =
        testing::without_sigmas(experiment.measure(configurations, {.sigma = 1e-5, .repeats = 5}));
    return test_lack_of_fit(experiment.model, measured, experiment.robot.truth, free);
  };
  EXPECT_FALSE(tested(2).has_value());
  EXPECT_FALSE(tested(3).has_value());
  const auto four = tested(4);
  ASSERT_TRUE(four.has_value());
  EXPECT_NEAR(four->degrees_of_freedom, 3.0, 1e-6);
}

TEST(LackOfFit, IsTestedWhereNothingIsFree) {
  VirtualExperiment experiment;
  const Unknowns none(experiment.model, experiment.targets, {});
  const Measurements measured = testing::without_sigmas(experiment.measure(20, {.sigma = 1e-5, .repeats = 3}));
  const LackOfFit right = test_lack_of_fit(experiment.model, measured, experiment.robot.truth, none).value();
  EXPECT_NEAR(right.degrees_of_freedom, 180.0, 1e-9);
  EXPECT_GT(right.p_value, 0.01);
  Estimate off = experiment.robot.truth;
  off.X_WB.translation().x() += 5e-5;
  EXPECT_LT(test_lack_of_fit(experiment.model, measured, off, none).value().p_value, 1e-9);
}

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// Every target in every repeat of a configuration, which has more repeats or less.
struct Trial {
  VirtualExperiment experiment;
  std::vector<int> repeats;  // of each configuration
  Measurements measured;
  Unknowns free;
  Estimate estimate;

  Trial(int targets, std::vector<int> of_configurations, const std::vector<std::string>& names, double misfit)
      : experiment({.targets = published_targets(targets)}),
        repeats(std::move(of_configurations)),
        measured(experiment.measure(static_cast<int>(repeats.size()),
                                    {.sigma = 1e-5, .repeats = 6, .common = Vector3d(2e-5, 0.0, 1e-5)})),
        free(experiment.model, experiment.targets, names),
        estimate(experiment.robot.truth) {
    measured = subset(
        measured, [&](const Observation& o) { return o.repeat <= repeats[static_cast<std::size_t>(o.configuration)]; });
    Random random(7);
    std::map<int, Vector3d> of_configuration;
    for (Observation& o : measured.observations) {
      const Vector3d drawn{random.normal(), random.normal(), random.normal()};
      o.position += misfit * of_configuration.try_emplace(o.configuration, drawn).first->second;
    }
    estimate.X_WB.translation() += Vector3d(1e-4, -5e-5, 2e-5);
  }

  std::optional<LackOfFit> tested() const { return test_lack_of_fit(experiment.model, measured, estimate, free); }
};

/// Squares and degrees of freedom.
struct Sum {
  double squares = 0.0;
  double freedom = 0.0;

  double variance() const { return squares / freedom; }
};

/// Rows that have one variance by the repeats, and of how many degrees of freedom that is.
struct Group {
  MatrixXd J;
  VectorXd e;
  double variance = 0.0;
  double freedom = 0.0;
};

/// Analysis of variance of a balanced layout: what repeats share and the rest, and of the means the same.
class Balanced {
public:
  Balanced(const Trial& trial, int targets) : trial_(trial), targets_(targets) {
    for (std::size_t c = 0; c < trial.repeats.size(); ++c) {
      add_configuration(static_cast<int>(c));
    }
    share_axes();
    for (auto& [key, group] : groups_) {
      const auto [repeats, shared, axis] = key;
      const Sum& sum = (shared == 0 ? shared_ : own_)[static_cast<std::size_t>(axis)];
      group.variance = sum.variance() / repeats;
      group.freedom = sum.freedom;
    }
  }

  // Fisher's combination of the tests of all groups that keep half a degree of freedom.
  LackOfFit expected(std::vector<double>& freedoms) const {
    MatrixXd J(0, trial_.free.size());
    VectorXd e(0);
    for (const auto& [key, group] : groups_) {
      const Index before = J.rows();
      J.conservativeResize(before + group.J.rows(), Eigen::NoChange);
      e.conservativeResize(J.rows());
      J.bottomRows(group.J.rows()) = group.J / std::sqrt(group.variance);
      e.tail(group.e.size()) = group.e / std::sqrt(group.variance);
    }
    const Index columns = J.cols();
    const Eigen::HouseholderQR<MatrixXd> qr(J);
    const MatrixXd Q = qr.householderQ() * MatrixXd::Identity(J.rows(), columns);
    const VectorXd left = e - Q * (Q.transpose() * e);
    LackOfFit result;
    double half = 0.0;  // of Fisher's statistic
    int tests = 0;
    Index row = 0;
    for (const auto& [key, group] : groups_) {
      const Index n = group.e.size();
      const double freedom = static_cast<double>(n) - Q.middleRows(row, n).squaredNorm();
      const double squares = left.segment(row, n).squaredNorm();
      row += n;
      freedoms.push_back(freedom);
      if (freedom > 0.5) {
        half -= std::log(f_upper_tail(squares / freedom, freedom, group.freedom));
        ++tests;
        result.degrees_of_freedom += freedom;
        result.f += squares;
      }
    }
    result.f /= result.degrees_of_freedom;
    double term = std::exp(-half);
    result.p_value = 0.0;
    for (int i = 0; i < tests; ++i) {
      result.p_value += term;
      term *= half / (i + 1.0);
    }
    for (const int repeats : trial_.repeats) {
      result.repeat_degrees_of_freedom += 3.0 * targets_ * (repeats - 1.0);
    }
    return result;
  }

private:
  void add_configuration(int c) {
    const int repeats = trial_.repeats[static_cast<std::size_t>(c)];
    const PositionPredictor predictor(trial_.experiment.model, trial_.estimate, trial_.free);
    const auto jacobians = predictor.jacobians(trial_.measured, c);
    const auto X_BF = flange_poses(trial_.experiment.model, trial_.estimate, trial_.measured.joint_values.col(c));
    for (int axis = 0; axis < 3; ++axis) {
      MatrixXd x(repeats, targets_);
      for (const Observation& o : trial_.measured.observations) {
        if (o.configuration == c) {
          x(o.repeat - 1, o.target) = o.position[axis];
        }
      }
      const Eigen::RowVectorXd means = x.colwise().mean();
      const MatrixXd deviations = x.rowwise() - means;
      Sum& shared = shared_[static_cast<std::size_t>(axis)];
      Sum& own = own_[static_cast<std::size_t>(axis)];
      const double together = deviations.rowwise().mean().squaredNorm() * targets_;
      shared.squares += together;
      shared.freedom += repeats - 1.0;
      own.squares += deviations.squaredNorm() - together;
      own.freedom += (repeats - 1.0) * (targets_ - 1.0);
      // The first contrast of the means is what targets share.
      MatrixXd start = MatrixXd::Identity(targets_, targets_);
      start.col(0).setOnes();
      const MatrixXd H = MatrixXd(Eigen::HouseholderQR<MatrixXd>(start).householderQ()).transpose();
      MatrixXd J(targets_, trial_.free.size());
      VectorXd e(targets_);
      for (int t = 0; t < targets_; ++t) {
        const auto k = static_cast<std::size_t>(t);
        J.row(t) = jacobians[k].row(axis);
        e[t] = means[t] - (trial_.estimate.X_WB * X_BF[0] * trial_.estimate.targets[k].X_FT.translation())[axis];
      }
      append(groups_[{repeats, 0, axis}], (H * J).topRows(1), (H * e).head(1));
      if (targets_ > 1) {
        append(groups_[{repeats, 1, axis}], (H * J).bottomRows(targets_ - 1), (H * e).tail(targets_ - 1));
      }
    }
  }

  static void append(Group& group, const MatrixXd& J, const VectorXd& e) {
    const Index before = group.e.size();
    group.J.conservativeResize(before + J.rows(), J.cols());
    group.e.conservativeResize(before + e.size());
    group.J.bottomRows(J.rows()) = J;
    group.e.tail(e.size()) = e;
  }

  // Few repeats tell the axes not apart.
  void share_axes() {
    if (shared_[0].freedom + own_[0].freedom >= 20.0) {
      return;
    }
    for (auto* sums : {&shared_, &own_}) {
      Sum all;
      for (const Sum& sum : *sums) {
        all.squares += sum.squares;
        all.freedom += sum.freedom;
      }
      sums->fill(all);
    }
  }

  const Trial& trial_;
  int targets_;
  std::array<Sum, 3> shared_;
  std::array<Sum, 3> own_;
  std::map<std::array<int, 3>, Group> groups_;  // by repeats, whether shared, axis
};

/// Gives the degrees of freedom that each group keeps.
std::vector<double> expect_analysis_of_variance(const Trial& trial, int targets, const std::string& what) {
  std::vector<double> freedoms;
  const LackOfFit expected = Balanced(trial, targets).expected(freedoms);
  const auto found = trial.tested();
  EXPECT_TRUE(found.has_value()) << what;
  if (found) {
    EXPECT_NEAR(found->f / expected.f, 1.0, 1e-7) << what;
    EXPECT_NEAR(found->degrees_of_freedom, expected.degrees_of_freedom, 1e-7) << what;
    EXPECT_NEAR(found->repeat_degrees_of_freedom, expected.repeat_degrees_of_freedom, 1e-9) << what;
    EXPECT_NEAR(found->p_value / expected.p_value, 1.0, 1e-4) << what << ", " << expected.p_value;
    EXPECT_TRUE(found->explained_by_joint.empty()) << what;
  }
  return freedoms;
}

TEST(LackOfFit, IsThatOfTheAnalysisOfVarianceWrittenOut) {
  const std::vector<std::string> base = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz"};
  std::vector<std::string> more = base;
  more.insert(more.end(), {"A.x", "B.y", "C.z", "C.x"});
  for (const double misfit : {0.0, 1e-5}) {
    const std::string what = misfit > 0.0 ? "a misfit" : "none";
    expect_analysis_of_variance(Trial(3, {2, 4, 2, 4, 2, 2, 4, 2, 3, 2, 4, 2}, more, misfit), 3, what);
    expect_analysis_of_variance(Trial(3, {2, 2, 3, 1, 1, 1, 1, 1}, more, misfit), 3, what + ", few repeats");
    expect_analysis_of_variance(Trial(1, {6, 6, 3, 3, 6, 6, 3, 6}, base, misfit), 1, what + ", one target");
    expect_analysis_of_variance(Trial(3, {2, 4, 2, 4, 3, 4}, {}, misfit), 3, what + ", nothing free");
  }
}

TEST(LackOfFit, LeavesOutGroupsThatKeepLessThanHalfADegreeOfFreedom) {
  const Trial trial(3, {5, 4, 3, 2, 6},
                    {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz", "A.x", "B.y"}, 0.0);
  const std::vector<double> freedoms = expect_analysis_of_variance(trial, 3, "a configuration each");
  const auto between = [&](double low, double high) {
    return std::any_of(freedoms.begin(), freedoms.end(), [&](double f) { return f > low && f < high; });
  };
  EXPECT_TRUE(between(0.06, 0.45));
  EXPECT_TRUE(between(0.55, 0.95));
}

TEST(LackOfFit, LooksAtTrainingRowsAloneAndAtNoSigma) {
  Trial trial(3, {2, 4, 2, 4, 3, 4}, {"base.Tx", "base.Ty", "A.x"}, 1e-5);
  const LackOfFit before = trial.tested().value();
  Measurements& measured = trial.measured;
  for (std::size_t row = 0; row < measured.observations.size(); ++row) {
    measured.observations[row].sigma = row % 3 == 0 ? 1e-3 : 1e-6;
  }
  Observation held_out = measured.observations[4];
  held_out.split = Split::test;
  held_out.repeat = 9;
  held_out.position.x() += 1.0;
  measured.observations.insert(measured.observations.begin(), held_out);
  const LackOfFit after = trial.tested().value();
  EXPECT_EQ(after.f, before.f);
  EXPECT_EQ(after.p_value, before.p_value);
  EXPECT_EQ(after.repeat_degrees_of_freedom, before.repeat_degrees_of_freedom);
}

TEST(LackOfFit, OfManyConfigurationsIsThatOfASample) {
  const Trial trial(1, std::vector<int>(2100, 2), {"base.Tx"}, 1e-6);
  const NoiseSample sample = sampled(trial.measured, {});
  ASSERT_EQ(sample.measurements.joint_values.cols(), 2000);
  const LackOfFit expected =
      test_lack_of_fit(trial.experiment.model, sample.measurements, trial.estimate, trial.free).value();
  EXPECT_EQ(trial.tested().value().f, expected.f);
  EXPECT_EQ(trial.tested().value().repeat_degrees_of_freedom, 3.0 * 2000.0);
}

TEST(LackOfFit, SharesExplainedAreThoseOfARegressionOnEachJoint) {
  const Trial trial(3, {2, 4, 2, 4, 2, 2, 4, 2, 3, 2, 4, 2}, {}, 1e-5);
  const Measurements means = averaged(trial.measured);
  const auto X_BF = flange_poses(trial.experiment.model, trial.estimate, means);
  const auto n = static_cast<Index>(means.observations.size());
  MatrixXd residuals(n, 3);
  for (Index r = 0; r < n; ++r) {
    const Observation& o = means.observations[static_cast<std::size_t>(r)];
    const Eigen::Isometry3d& X = X_BF[static_cast<std::size_t>(o.configuration)];
    residuals.row(r) = o.position - trial.estimate.X_WB * X *
                                        trial.estimate.targets[static_cast<std::size_t>(o.target)].X_FT.translation();
  }
  const std::vector<double> found = explained_by_joints(trial.experiment.model, trial.estimate, trial.measured);
  ASSERT_EQ(found.size(), 6U);
  for (Index j = 0; j < 6; ++j) {
    MatrixXd terms = MatrixXd::Ones(n, 3);
    for (Index r = 0; r < n; ++r) {
      const double q = means.joint_values(j, means.observations[static_cast<std::size_t>(r)].configuration);
      terms(r, 1) = std::cos(q);
      terms(r, 2) = std::sin(q);
    }
    const MatrixXd Q = Eigen::HouseholderQR<MatrixXd>(terms).householderQ() * MatrixXd::Identity(n, 3);
    EXPECT_NEAR(found[static_cast<std::size_t>(j)], (Q.transpose() * residuals).squaredNorm() / residuals.squaredNorm(),
                1e-10)
        << "joint " << j;
  }
}

TEST(LackOfFit, NothingIsExplainedWhereNothingIsLeft) {
  Trial trial(3, std::vector<int>(8, 1), {}, 0.0);
  const auto X_BF = flange_poses(trial.experiment.model, trial.estimate, trial.measured);
  for (Observation& o : trial.measured.observations) {
    o.position = predicted_point(trial.estimate, X_BF, o);
  }
  EXPECT_EQ(explained_by_joints(trial.experiment.model, trial.estimate, trial.measured), std::vector<double>(6, 0.0));
}

TEST(LackOfFit, RefusesWhatDoesNotHoldTogether) {
  using testing::refusal;
  const Trial trial(1, {2, 2, 2, 2}, {"base.Tx"}, 0.0);
  const ErrorModel& model = trial.experiment.model;
  Measurements measured = trial.measured;
  measured.joints[0] = "another";
  Estimate estimate = trial.estimate;
  estimate.errors.conservativeResize(3);
  const VirtualExperiment three;
  const Unknowns free(three.model, three.targets, {"C.x"});
  const auto expect = [](const std::string& message, const std::string& part) {
    EXPECT_NE(message.find(part), std::string::npos) << message;
  };
  expect(refusal([&] { test_lack_of_fit(model, measured, trial.estimate, trial.free); }), "another");
  expect(refusal([&] { test_lack_of_fit(model, trial.measured, estimate, trial.free); }), "3 errors");
  expect(refusal([&] { test_lack_of_fit(model, trial.measured, trial.estimate, free); }), "coordinate of targets 12");
  expect(refusal([&] { explained_by_joints(model, trial.estimate, measured); }), "another");
  expect(refusal([&] { explained_by_joints(model, estimate, trial.measured); }), "3 errors");
}

TEST(LackOfFit, NeedsRepeats) {
  VirtualExperiment experiment;
  const Measurements measured = experiment.measure(20, {.sigma = 1e-5});
  EXPECT_FALSE(test_lack_of_fit(experiment.model, measured, experiment.robot.truth, experiment.free).has_value());
}

}  // namespace
}  // namespace kdl_calibration
