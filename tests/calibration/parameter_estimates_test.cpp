#include "calibration/parameter_estimates.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "base/distributions.hpp"
#include "calibration/noise_stage.hpp"
#include "dense_fit.hpp"
#include "effects/effect_terms.hpp"
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
    start = {.errors = Eigen::VectorXd::Zero(static_cast<Index>(model.parameters.size())),
             .targets = a_point_and_a_frame()};
    start.X_WB.linear() = testing::turned_by({0.1, 0.2, -0.4});
    start.X_WB.translation() = Eigen::Vector3d(1.0, 2.0, 3.0);
    Estimate& estimate = fit.identification.estimate;
    estimate = start;
    for (Index p = 0; p < start.errors.size(); ++p) {
      estimate.errors[p] = p % 3 == 0 ? 0.0 : 1e-3 * static_cast<double>(p + 1);
    }
    estimate.X_WB.translation() += Eigen::Vector3d(0.01, 0.02, 0.03);
    estimate.X_WB.linear() = testing::turned_by({0.15, 0.2, -0.5});
    estimate.targets[0].X_FT.translation() += Eigen::Vector3d(0.001, 0.002, 0.003);
    estimate.targets[1].X_FT.translation() += Eigen::Vector3d(0.004, 0.005, 0.006);
    estimate.targets[1].X_FT.linear() = testing::turned_by({0.35, -0.1, 0.8});
    estimate.effects = Eigen::VectorXd::LinSpaced(static_cast<Index>(model.effects.size()), 1e-4, 5e-4);
    fit.free = Unknowns(model, start.targets, free).with_all(model, UnknownGroup::effects);
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

// Of a frame as six lines.
void add_frame(const std::string& name, const std::vector<std::string>& places, const Eigen::Isometry3d& before,
               const Eigen::Isometry3d& after, std::vector<ParameterEstimate>& all) {
  for (std::size_t i = 0; i < places.size(); ++i) {
    const auto axis = static_cast<Index>(i % 3);
    const auto value_of = [&](const Eigen::Isometry3d& X) {
      return i < 3 ? X.translation()[axis] : testing::rotation_vector(X.linear())[axis];
    };
    all.push_back({.name = name + "." + places[i],
                   .joint = "",
                   .kind = i < 3 ? ParameterKind::translation : ParameterKind::rotation,
                   .axis = std::string(1, "xyz"[axis]),
                   .nominal = value_of(before),
                   .value = value_of(after),
                   .error = value_of(after) - value_of(before)});
  }
}

// Every line that there may be, as far as the estimate alone says it.
std::vector<ParameterEstimate> lines_of(const Answer& answer) {
  const Estimate& estimate = answer.fit.identification.estimate;
  std::vector<ParameterEstimate> all;
  add_frame("base", {"Tx", "Ty", "Tz", "Rx", "Ry", "Rz"}, answer.start.X_WB, estimate.X_WB, all);
  add_frame("A", {"x", "y", "z"}, answer.start.targets[0].X_FT, estimate.targets[0].X_FT, all);
  add_frame("B", {"x", "y", "z", "Rx", "Ry", "Rz"}, answer.start.targets[1].X_FT, estimate.targets[1].X_FT, all);
  for (std::size_t p = 0; p < answer.model.parameters.size(); ++p) {
    const ErrorParameter& parameter = answer.model.parameters[p];
    const double error = estimate.errors[static_cast<Index>(p)];
    all.push_back({.name = parameter.name,
                   .joint = parameter.joint,
                   .kind = parameter.kind,
                   .axis = parameter.axis == 'q' ? std::string() : std::string{parameter.axis},
                   .nominal = parameter.nominal,
                   .value = parameter.nominal + error,
                   .error = error});
  }
  for (std::size_t e = 0; e < answer.model.effects.size(); ++e) {
    const double value = estimate.effects[static_cast<Index>(e)];
    all.push_back({.name = answer.model.effects[e].name,
                   .joint = answer.model.effects[e].joint,
                   .kind = ParameterKind::effect,
                   .axis = "",
                   .nominal = 0.0,
                   .value = value,
                   .error = value});
  }
  return all;
}

const std::vector<std::string> kFree = {"base.Tx", "base.Ty", "base.Tz", "base.Rx", "base.Ry", "base.Rz", "A.x",
                                        "A.y",     "A.z",     "B.x",     "dq2",     "dq4",     "Tx2",     "Rz3"};

TEST(ParameterEstimates, EveryLineIsThatOfTheEstimateWithTheUncertaintyOfItsColumn) {
  Answer answer(kFree);
  const Index infinite = *answer.fit.free.column("A.y");
  const Index unknown = *answer.fit.free.column("Rz3");
  answer.covariance(infinite, infinite) = kInfinity;
  answer.covariance(unknown, unknown) = 0.6 * 0.6;  // of a radian
  const std::vector<ValueUncertainty> uncertain =
      uncertainties(answer.fit.identification.estimate, answer.fit.free, answer.covariance, answer.noise);
  const std::vector<ParameterEstimate> found = answer.estimates();
  const auto among = [](const std::vector<std::string>& names, const std::string& name) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  std::size_t line = 0;
  for (const ParameterEstimate& expected : lines_of(answer)) {
    const std::optional<Index> column = answer.fit.free.column(expected.name);
    const bool gauge = among({"dq1", "B.Rz", "Rz1"}, expected.name);
    const bool frame = expected.joint.empty() && expected.name.find('.') != std::string::npos;
    if (!column && !gauge && !frame && expected.error == 0.0 && !among(answer.fit.reduction.kept, expected.name)) {
      continue;
    }
    ASSERT_LT(line, found.size()) << expected.name;
    const ParameterEstimate& p = found[line++];
    ASSERT_EQ(p.name, expected.name);
    SCOPED_TRACE(p.name);
    EXPECT_EQ(p.joint, expected.joint);
    EXPECT_EQ(p.kind, expected.kind);
    EXPECT_EQ(p.axis, expected.axis);
    EXPECT_NEAR(p.nominal, expected.nominal, 1e-14);
    EXPECT_NEAR(p.value, expected.value, 1e-14);
    EXPECT_NEAR(p.error, expected.error, 1e-14);
    EXPECT_EQ(p.gauge, gauge);
    EXPECT_EQ(p.std, column ? uncertain[static_cast<std::size_t>(*column)].std : gauge ? kInfinity : 0.0);
    EXPECT_EQ(p.degrees_of_freedom, column ? 12.0 : 0.0);
    EXPECT_EQ(p.identifiable, column && !among({"A.y", "Rz3", "dq4", "Tx2"}, p.name));
  }
  EXPECT_EQ(line, found.size());
  EXPECT_LT(line, lines_of(answer).size()) << "what is zero and nobody asked for";
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
}

TEST(ParameterEstimates, IntervalsAreThoseOfStudentsT) {
  EXPECT_DOUBLE_EQ(half_width_95(2.0, 7.0), 2.0 * t_critical_95(7.0));
  EXPECT_DOUBLE_EQ(half_width_95(0.1, 3.0), 0.1 * t_critical_95(3.0));
  EXPECT_EQ(half_width_95(0.0, std::nan("")), 0.0);
  EXPECT_EQ(half_width_95(kInfinity, 7.0), kInfinity);
}

}  // namespace
}  // namespace kdl_calibration::parameter_estimates_test
