#include "calibration/parameter_estimates.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>

#include "calibration/noise_stage.hpp"
#include "dense_fit.hpp"
#include "effects/effect_terms.hpp"
#include "model/parameters.hpp"
#include "planning/simulation.hpp"
#include "support.hpp"

namespace kdl_calibration::parameter_estimates_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

std::vector<TargetFrame> a_point_and_a_frame() {
  std::vector<TargetFrame> targets = published_targets(2);
  targets[1].with_orientation = true;
  targets[1].X_FT.linear() = testing::turned_by({0.3, -0.1, 0.7});
  return targets;
}

// An answer of which everything is made up.
struct Answer {
  ErrorModel model = complete_model(parse_robot(testing::kOddArm));
  Estimate start;
  DeterminedFit fit;
  std::vector<std::string> fixed_by_gauge = {"B.Rz", "Rz1"};
  std::vector<std::vector<std::string>> tied = {{"dq4", "Tx2"}};
  MatrixXd covariance;
  NoiseReport noise;

  explicit Answer(const std::vector<std::string>& free) {
    model.effects = gain_terms(model);
    start = {.errors = testing::errors_of(model), .frames = {.targets = a_point_and_a_frame()}, .effects = {}};
    start.frames.base().linear() = testing::turned_by({0.1, 0.2, -0.4});
    start.frames.base().translation() = Eigen::Vector3d(1.0, 2.0, 3.0);
    Estimate& estimate = fit.identification.estimate;
    estimate = start;
    for (Index p = 0; p < start.errors.size(); ++p) {
      estimate.errors[p] = p % 3 == 0 ? 0.0 : 1e-3 * static_cast<double>(p + 1);
    }
    estimate.frames.base().translation() += Eigen::Vector3d(0.01, 0.02, 0.03);
    estimate.frames.base().linear() = testing::turned_by({0.15, 0.2, -0.5});
    estimate.frames.targets[0].X_FT.translation() += Eigen::Vector3d(0.001, 0.002, 0.003);
    estimate.frames.targets[1].X_FT.translation() += Eigen::Vector3d(0.004, 0.005, 0.006);
    estimate.frames.targets[1].X_FT.linear() = testing::turned_by({0.35, -0.1, 0.8});
    estimate.effects = Eigen::VectorXd::LinSpaced(static_cast<Index>(model.effects.size()), 1e-4, 5e-4);
    fit.free = Unknowns(model, start.frames.targets, free).with_group(model, UnknownGroup::effects);
    fit.reduction.kept = {"dq2", "dq4", "Tx1", "Rz3"};
    fit.reduction.gauge = {{.name = "dq1", .tied_to = {"base.Rz"}}};
    covariance = MatrixXd::Zero(fit.free.size(), fit.free.size());
    for (Index c = 0; c < fit.free.size(); ++c) {
      covariance(c, c) = 1e-6 * static_cast<double>(c + 1);
    }
    noise.source = NoiseSource::residuals;
    noise.degrees_of_freedom = 12.0;
  }

  std::vector<ParameterEstimate> estimates() const {
    return parameter_estimates(
        model, start, fit, {.fixed_by_gauge = fixed_by_gauge, .tied = tied, .covariance = covariance, .noise = noise});
  }
};

const std::vector<std::string> kFree = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz", "A.x",
                                        "A.y",     "A.z",     "B.x",     "dq2",     "dq4",     "Tx2",     "Rz3"};

struct Line {
  std::string name;
  ParameterKind kind;
  std::string axis;
  double nominal;
  double error;
  bool identifiable = false;
  bool gauge = false;
};

TEST(ParameterEstimates, LinesAreThoseOfTheEstimateWithTheUncertaintyOfTheirColumns) {
  Answer answer(kFree);
  const Index infinite = *answer.fit.free.column("A.y");
  const Index unknown = *answer.fit.free.column("Rz3");
  answer.covariance(infinite, infinite) = kInfinity;
  answer.covariance(unknown, unknown) = 0.6 * 0.6;  // of a radian
  const Estimate& estimate = answer.fit.identification.estimate;
  const std::vector<ValueUncertainty> uncertain =
      uncertainties(estimate, answer.fit.free, answer.covariance, answer.noise);
  std::map<std::string, ParameterEstimate> found;
  for (const ParameterEstimate& line : answer.estimates()) {
    EXPECT_TRUE(found.emplace(line.name, line).second) << line.name;
  }
  const auto error = [&](const char* name) {
    return estimate.errors[static_cast<Index>(parameter_index(answer.model, name))];
  };
  const double y = answer.start.frames.targets[0].X_FT.translation().y();
  for (const Line& expected :
       {Line{"base.Tx", ParameterKind::translation, "x", 1.0, 0.01, true},
        Line{"base.Rz", ParameterKind::rotation, "z", -0.4, -0.1, true},
        Line{"A.y", ParameterKind::translation, "y", y, 0.002}, Line{"B.Rx", ParameterKind::rotation, "x", 0.3, 0.05},
        Line{"B.Rz", ParameterKind::rotation, "z", 0.7, 0.1, false, true},
        Line{"dq1", ParameterKind::joint_offset, "z", 0.0, error("dq1"), false, true},
        Line{"dq2", ParameterKind::joint_offset, "x", 0.0, error("dq2"), true},
        Line{"dq4", ParameterKind::joint_offset, "y", 0.0, error("dq4")},
        Line{"Tx2", ParameterKind::translation, "x", found["Tx2"].nominal, error("Tx2")},
        Line{"Rz3", ParameterKind::rotation, "z", found["Rz3"].nominal, error("Rz3")},
        Line{"gain.1", ParameterKind::effect, "", 0.0, 1e-4, true}}) {
    SCOPED_TRACE(expected.name);
    ASSERT_EQ(found.count(expected.name), 1U);
    const ParameterEstimate& line = found[expected.name];
    EXPECT_EQ(line.kind, expected.kind);
    EXPECT_EQ(line.axis, expected.axis);
    EXPECT_NEAR(line.nominal, expected.nominal, 1e-14);
    EXPECT_NEAR(line.error, expected.error, 1e-14);
    EXPECT_NEAR(line.value, expected.nominal + expected.error, 1e-14);
    EXPECT_EQ(line.identifiable, expected.identifiable);
    EXPECT_EQ(line.gauge, expected.gauge);
    const std::optional<Index> column = answer.fit.free.column(expected.name);
    EXPECT_EQ(line.std, column ? uncertain[static_cast<std::size_t>(*column)].std : line.gauge ? kInfinity : 0.0);
    EXPECT_EQ(line.degrees_of_freedom, column ? 12.0 : 0.0);
  }
  const std::set<std::string> asked = {"dq1", "dq2", "dq4", "Tx1", "Tx2", "Rz1", "Rz3"};  // free, kept or gauge
  for (const ErrorParameter& parameter : answer.model.parameters) {
    EXPECT_EQ(found.count(parameter.name) > 0, asked.count(parameter.name) > 0 || error(parameter.name.c_str()) != 0.0)
        << parameter.name;
  }
}

TEST(ParameterEstimates, OfAnEstimateWithoutEffectsHaveNone) {
  Answer answer(kFree);
  answer.fit.identification.estimate.effects.resize(0);
  answer.fit.free = answer.fit.free.without(UnknownGroup::effects);
  answer.covariance = MatrixXd::Identity(answer.fit.free.size(), answer.fit.free.size());
  for (const ParameterEstimate& parameter : answer.estimates()) {
    EXPECT_NE(parameter.kind, ParameterKind::effect) << parameter.name;
  }
}

TEST(ParameterEstimates, AnAngleIsUnknownBeyondHalfARadianAndALengthBeyondItsLink) {
  ErrorModel model = complete_model(testing::fanuc());
  const auto expect_limit = [&](const std::string& name, double limit) {
    EXPECT_FALSE(is_unknown(model, {.name = name, .std = 0.999 * limit})) << name;
    EXPECT_TRUE(is_unknown(model, {.name = name, .std = 1.001 * limit})) << name;
  };
  for (const double share : {0.099, 0.101}) {  // of a mean link: as long is the third, which is none if shorter
    double others = model.tip_origin.p.Norm();
    for (std::size_t j = 0; j < model.joints.size(); ++j) {
      others += j == 2 ? 0.0 : model.joints[j].origin.p.Norm();
    }
    const double links = static_cast<double>(model.joints.size() + 1);
    const double length = share * others / (links - share);
    model.joints[2].origin.p = KDL::Vector(0.0, 0.6 * length, 0.8 * length);
    const double mean = (others + length) / links;
    for (const ErrorParameter& parameter : model.parameters) {
      const auto frame = static_cast<std::size_t>(parameter.frame);
      const double own = (frame < 6 ? model.joints[frame].origin.p : model.tip_origin.p).Norm();
      expect_limit(parameter.name, parameter.kind != ParameterKind::translation ? 0.5 : own > 0.1 * mean ? own : mean);
    }
  }
  EXPECT_FALSE(is_unknown(model, {.name = "base.Tx", .std = 1e6})) << "no link's";
  for (MovingJoint& joint : model.joints) {  // as those of a Cartesian arm
    joint.origin.p = KDL::Vector::Zero();
  }
  model.tip_origin.p = KDL::Vector::Zero();
  expect_limit("Tz2", 0.01);
}

TEST(ParameterEstimates, IntervalsAreThoseOfStudentsT) {
  EXPECT_NEAR(half_width_95(2.0, 7.0), 2.0 * 2.364624, 2e-6) << "tabulated: t of 97.5 %";
  EXPECT_NEAR(half_width_95(0.1, 3.0), 0.1 * 3.182446, 1e-7);
  EXPECT_EQ(half_width_95(0.0, std::nan("")), 0.0);
  EXPECT_EQ(half_width_95(kInfinity, 7.0), kInfinity);
}

}  // namespace
}  // namespace kdl_calibration::parameter_estimates_test
