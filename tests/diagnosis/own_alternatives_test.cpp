#include "diagnosis/own_alternatives.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/likely_mistake.hpp"
#include "geometry_alone.hpp"
#include "kdl_calibration/calibrate.hpp"
#include "kdl_calibration/input_error.hpp"
#include "kdl_calibration/validation.hpp"
#include "mistake_table.hpp"
#include "refusal.hpp"
#include "robot/joint_ranges.hpp"

namespace kdl_calibration::own_alternatives_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using testing::Draw;
using testing::for_rows;
using ::testing::HasSubstr;
using testing::large_arm;
using testing::Measured;
using testing::measured;
using testing::refusal;

// One column for each function.
OwnColumns columns(const std::vector<std::function<double(const Eigen::VectorXd& q)>>& functions) {
  return [functions](const MatrixXd& joint_values) {
    return MatrixXd(MatrixXd::NullaryExpr(joint_values.cols(), std::ssize(functions), [&](Index c, Index k) {
      return functions[static_cast<std::size_t>(k)](joint_values.col(c));
    }));
  };
}

double twice(const Eigen::VectorXd& q) { return std::sin(2.0 * q[0]); }
double swing(const Eigen::VectorXd& q) { return std::cos(3.0 * q[1]); }
double nothing(const Eigen::VectorXd& /*q*/) { return 0.0; }

constexpr double kTilt = 1e-3;   // [rad]
constexpr double kStray = 2e-3;  // [m]

// Its stand gives way about x of the base, twice a turn of joint 1.
const OwnAlternative kTilting = {
    .name = "tilt", .columns = columns({twice}), .joint = "joint_1", .axis = EffectAxis::across_x};
// The measured points stray along z of the measuring frame.
const OwnAlternative kStraying = {.name = "stray", .columns = columns({nothing, nothing, swing})};

// A point of the base frame after the tilt: joint 1 of this arm turns about z, somewhere above the base.
Vector3d tilted(const Measured& m, const Vector3d& in_base, const Eigen::VectorXd& q, double size) {
  const KDL::Vector above = m.model.joints.front().origin.p;
  const Vector3d pivot(above.x(), above.y(), above.z());
  return pivot + Eigen::AngleAxisd(size * twice(q), Vector3d::UnitX()) * (in_base - pivot);
}

void tilt(Measured& m, double size) {
  const Eigen::Isometry3d X_WB = m.truth.frames.base();
  for_rows(m, [&](Observation& o) {
    o.position() = X_WB * tilted(m, X_WB.inverse() * o.position(), m.data.joint_values.col(o.configuration), size);
  });
}

void stray(Measured& m, double size) {
  for_rows(m, [&](Observation& o) { o.position().z() += size * swing(m.data.joint_values.col(o.configuration)); });
}

Measured drawn(std::uint64_t seed) {
  return measured(large_arm(), seed, {.configurations = 30, .length = 0.0005, .angle = 0.0005});
}

Estimate fit_of(const Measured& m) {
  return identify_jointly(m.model, m.data, nominal_start(m.model, m.data), m.free).estimate;
}

MistakeSearch search(const Measured& m, const Estimate& fit, const std::vector<OwnAlternative>& alternatives) {
  return likely_mistake(
      {.model = m.model, .measurements = m.data, .estimate = fit, .known = {}, .alternatives = alternatives});
}

AlternativeReading reading_of(const Measured& m, const OwnAlternative& alternative) {
  return search(m, fit_of(m), {alternative}).own.at(0);
}

double figure(const AlternativeReading& reading, const std::string& name) {
  return reading.as_doubt().figure(name).value_or(std::numeric_limits<double>::quiet_NaN());
}

TEST(OwnAlternatives, AreFoundWithTheirSize) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    Measured tilts = drawn(seed);
    tilt(tilts, kTilt);
    const AlternativeReading of_tilt = reading_of(tilts, kTilting);
    EXPECT_TRUE(of_tilt.doubt) << of_tilt.message;
    EXPECT_EQ(of_tilt.cause, Cause::own_alternative);
    EXPECT_EQ(of_tilt.subjects, (std::vector<Subject>{{SubjectKind::alternative, "tilt"}}));
    EXPECT_EQ(figure(of_tilt, "columns"), 1.0);
    EXPECT_LT(figure(of_tilt, "p_value"), 1e-5);
    EXPECT_LT(figure(of_tilt, "estimate_sigma"), 0.05 * kTilt);
    EXPECT_NEAR(figure(of_tilt, "estimate"), kTilt, 3.0 * figure(of_tilt, "estimate_sigma")) << of_tilt.message;

    Measured strays = drawn(seed);
    stray(strays, kStray);
    const AlternativeReading of_stray = reading_of(strays, kStraying);
    EXPECT_TRUE(of_stray.doubt) << of_stray.message;
    EXPECT_NEAR(figure(of_stray, "estimate"), kStray, 3.0 * figure(of_stray, "estimate_sigma")) << of_stray.message;
    EXPECT_LT(figure(of_stray, "estimate_sigma"), 0.05 * kStray);

    EXPECT_FALSE(reading_of(tilts, kStraying).doubt);
    EXPECT_FALSE(reading_of(strays, kTilting).doubt);
  }
}

TEST(OwnAlternatives, InTheBaseFrameTurnWithIt) {
  Measured m = drawn(3);
  const Eigen::Matrix3d R_WB = m.truth.frames.base().linear();
  for_rows(m, [&](Observation& o) {
    const double share = swing(m.data.joint_values.col(o.configuration));
    o.position() += R_WB * Vector3d(0.002 * share, 0.0, -0.001 * share);
  });
  OwnAlternative both = {.name = "both",
                         .columns = columns({swing, nothing, nothing, nothing, nothing, swing}),
                         .frame = DisplacementFrame::base};
  const AlternativeReading found = reading_of(m, both);
  EXPECT_TRUE(found.doubt) << found.message;
  EXPECT_EQ(figure(found, "columns"), 2.0);
  EXPECT_NEAR(figure(found, "estimate_1"), 0.002, 3.0 * figure(found, "estimate_1_sigma")) << found.message;
  EXPECT_NEAR(figure(found, "estimate_2"), -0.001, 3.0 * figure(found, "estimate_2_sigma")) << found.message;
  EXPECT_TRUE(std::isnan(figure(found, "estimate")));
  both.frame = DisplacementFrame::measuring;
  const AlternativeReading elsewhere = reading_of(m, both);
  EXPECT_GT(figure(elsewhere, "misfit_without"), 3.0 * figure(found, "misfit_without"));
}

// [m] 3D RMS of what the fit predicts from where the points truly are, in the measured ranges.
double off_by(const Measured& m, const Estimate& fit, double true_tilt) {
  Random random(7);
  const MatrixXd q = random_configurations(m.model.joints, trained_ranges(m.data), 400, random);
  Estimate rigid = m.truth;
  rigid.effects.resize(0);
  double squares = 0.0;
  for (Index c = 0; c < q.cols(); ++c) {
    const Eigen::Isometry3d there = flange_poses(m.model, rigid, q.col(c)).front();
    const Eigen::Isometry3d said = fit.frames.base() * flange_poses(m.model, fit, q.col(c)).front();
    for (std::size_t k = 0; k < rigid.frames.targets.size(); ++k) {
      const Vector3d point = tilted(m, there * rigid.frames.targets[k].X_FT.translation(), q.col(c), true_tilt);
      squares += (rigid.frames.base() * point - said * fit.frames.targets[k].X_FT.translation()).squaredNorm();
    }
  }
  return std::sqrt(squares / static_cast<double>(q.cols() * std::ssize(rigid.frames.targets)));
}

// What the arm itself does is part of where it is; what displaces the measured points is not.
TEST(OwnAlternatives, MovePredictionsByWhatTheFitIsOff) {
  Measured tilts = drawn(4);
  tilt(tilts, kTilt);
  const double of_tilt = off_by(tilts, fit_of(tilts), kTilt);
  EXPECT_NEAR(figure(reading_of(tilts, kTilting), "moves"), of_tilt, 0.1 * of_tilt);
  Measured strays = drawn(4);
  stray(strays, kStray);
  const double of_stray = off_by(strays, fit_of(strays), 0.0);
  EXPECT_NEAR(figure(reading_of(strays, kStraying), "moves"), of_stray, 0.15 * of_stray);
  OwnAlternative of_arm = kStraying;  // the same displacement, if the arm made it
  of_arm.frame = DisplacementFrame::base;
  of_arm.columns = [&, z = Vector3d(strays.truth.frames.base().linear().transpose().col(2))](const MatrixXd& q) {
    return MatrixXd(columns({swing})(q) * z.transpose());
  };
  EXPECT_GT(figure(reading_of(strays, of_arm), "moves"), 1.2 * of_stray);
}

// Monte Carlo: the level is kept, and so is the sigma.
TEST(OwnAlternativesLongRun, AccuseNobodyBeyondTheirLevel) {
  constexpr int kCount = 200;
  int doubts = 0;
  double beyond = 0.0;
  double chi_square = 0.0;
  for (int seed = 1; seed <= kCount; ++seed) {
    const Measured m = drawn(static_cast<std::uint64_t>(seed));
    for (const AlternativeReading& reading : search(m, fit_of(m), {kTilting, kStraying}).own) {
      doubts += reading.doubt ? 1 : 0;
      beyond += figure(reading, "p_value") < 0.05 ? 1.0 : 0.0;
      chi_square += std::pow(figure(reading, "estimate") / figure(reading, "estimate_sigma"), 2);
    }
  }
  constexpr double kTrials = 2.0 * kCount;
  EXPECT_EQ(doubts, 0);
  EXPECT_LT(beyond, 0.05 * kTrials + 3.0 * std::sqrt(0.05 * 0.95 * kTrials));
  EXPECT_NEAR(chi_square / kTrials, 1.0, 4.0 * std::sqrt(2.0 / kTrials));
}

TEST(OwnAlternatives, ThatAreSmallAreRemarks) {
  Measured m = drawn(2);
  stray(m, 0.04 * kStray);
  const AlternativeReading found = reading_of(m, kStraying);
  EXPECT_FALSE(found.doubt);
  EXPECT_LT(figure(found, "p_value"), 1e-5);
  EXPECT_LT(figure(found, "moves"), figure(found, "radius"));
  EXPECT_THAT(found.message, HasSubstr("does not matter for predictions"));
}

TEST(OwnAlternatives, InTheSpanOfTheFitCannotBeSeen) {
  Measured m = drawn(5);
  tilt(m, kTilt);
  const auto one = [](const Eigen::VectorXd& /*q*/) { return 1.0; };
  const auto of_joint = [](const char* joint, EffectAxis axis, const OwnColumns& function) {
    return OwnAlternative{.name = "any", .columns = function, .joint = joint, .axis = axis};
  };
  const std::vector<std::pair<const char*, OwnAlternative>> hidden = {
      {"a zero", of_joint("joint_2", EffectAxis::own, columns({one}))},
      {"of the gauge", of_joint("joint_1", EffectAxis::own, columns({one}))},
      {"a tilt", of_joint("joint_3", EffectAxis::across_x, columns({one}))},
      {"a shift of all points", {.name = "any", .columns = columns({nothing, one, nothing})}},
      {"a shift of the base",
       {.name = "any", .columns = columns({one, nothing, nothing}), .frame = DisplacementFrame::base}},
      {"nothing", {.name = "any", .columns = columns({nothing, nothing, nothing})}},
      {"one column twice", of_joint("joint_1", EffectAxis::across_x, columns({twice, twice}))},
      {"a constant beside another", of_joint("joint_1", EffectAxis::across_x, columns({twice, one}))}};
  for (const auto& [name, alternative] : hidden) {
    const AlternativeReading found = reading_of(m, alternative);
    EXPECT_FALSE(found.doubt) << name;
    EXPECT_THAT(found.message, HasSubstr("alternative any cannot be seen")) << name;
    EXPECT_TRUE(std::isnan(figure(found, "estimate")) && std::isnan(figure(found, "estimate_1"))) << name;
    EXPECT_TRUE(std::isnan(figure(found, "p_value"))) << name;
  }
  const auto gain = [](const Eigen::VectorXd& q) { return q[1]; };
  const AlternativeReading seen = reading_of(m, of_joint("joint_2", EffectAxis::own, columns({gain})));
  EXPECT_FALSE(std::isnan(figure(seen, "estimate"))) << seen.message;
}

TEST(OwnAlternatives, TakeThePlaceOfMistakesThatExplainLess) {
  Measured tilts = drawn(6);
  tilt(tilts, 3.0 * kTilt);
  const Estimate fit = fit_of(tilts);
  const MistakeSearch alone = search(tilts, fit, {});
  const MistakeSearch with = search(tilts, fit, {kStraying, kTilting});
  EXPECT_TRUE(alone.own.empty());
  EXPECT_FALSE(with.mistake);
  ASSERT_EQ(with.own.size(), 2U);
  EXPECT_FALSE(with.own[0].doubt) << with.own[0].message;
  EXPECT_TRUE(with.own[1].doubt) << with.own[1].message;

  Measured moved = drawn(6);
  for_rows(moved, [](Observation& o) { o.position().x() += o.configuration >= 15 ? 0.004 : 0.0; });
  const MistakeSearch other = search(moved, fit_of(moved), {kTilting});
  ASSERT_TRUE(other.mistake);
  EXPECT_EQ(other.mistake->cause, Cause::moved_base);
  EXPECT_FALSE(other.own.at(0).doubt) << other.own.at(0).message;
}

TEST(OwnAlternatives, HaveADetectableSize) {
  const Measured right = drawn(8);
  const std::vector<DetectableMistake> table = search(right, fit_of(right), {kTilting}).detectable;
  EXPECT_TRUE(std::any_of(table.begin(), table.end(), [](const DetectableMistake& mistake) {
    return mistake.cause == Cause::own_alternative && mistake.subject == "alternative tilt" && mistake.size > 0.0 &&
           mistake.size < 0.01;
  }));
}

// Through the whole calibration, with the model that it chooses.
TEST(OwnAlternatives, AreDoubtsAndRemarksOfACalibration) {
  Measured m = drawn(9);
  tilt(m, kTilt);
  CalibrationOptions options = testing::geometry_alone();
  options.diagnosis = {.alternatives = {kTilting, kStraying}};
  const Calibration found = calibrate(testing::fanuc(), m.data, options);
  const auto about = [](const std::vector<Doubt>& all) {
    std::vector<std::string> names;
    for (const Doubt& doubt : all) {
      const std::vector<std::string> here = doubt.names(SubjectKind::alternative);
      names.insert(names.end(), here.begin(), here.end());
    }
    return names;
  };
  EXPECT_EQ(about(found.doubts()), std::vector<std::string>{"tilt"});
  EXPECT_EQ(about(found.remarks()), std::vector<std::string>{"stray"});
  EXPECT_FALSE(found.trusted());

  for_rows(m, [](Observation& o) { o.position().y() *= -1.0; });
  const Calibration mirrored = calibrate(testing::fanuc(), m.data, options);
  EXPECT_EQ(about(mirrored.doubts()), std::vector<std::string>());
  EXPECT_EQ(about(mirrored.remarks()), (std::vector<std::string>{"tilt", "stray"}));
  EXPECT_THAT(messages_of(mirrored.remarks()),
              ::testing::Contains(HasSubstr("alternative tilt was not tried, as the input seems to be wrong")));
}

TEST(OwnAlternatives, AreTriedInAValidation) {
  Measured m = drawn(10);
  stray(m, kStray);
  const PositionErrors errors = validate(testing::fanuc(), m.data, {}, {.alternatives = {kStraying}});
  ASSERT_EQ(errors.doubts.size(), 1U);
  EXPECT_EQ(errors.doubts.front().cause, Cause::own_alternative);
  const PositionErrors right = validate(testing::fanuc(), drawn(10).data, {}, {.alternatives = {kStraying}});
  EXPECT_TRUE(right.doubts.empty());
  EXPECT_THAT(right.warnings, ::testing::Contains(HasSubstr("alternative stray")));
}

TEST(OwnAlternatives, RefuseWhatIsWrongByName) {
  const Measured m = drawn(1);
  const auto refused = [&](const OwnAlternative& alternative, bool twice_given = false) {
    DiagnosisOptions options{.alternatives = {alternative}};
    if (twice_given) {
      options.alternatives.push_back(alternative);
    }
    const std::string by_validation = refusal([&] { validate(testing::fanuc(), m.data, {}, options); });
    EXPECT_EQ(refusal([&] { calibrate(testing::fanuc(), m.data, {.diagnosis = options}); }), by_validation);
    return by_validation;
  };
  const auto with = [](OwnAlternative alternative, const auto& change) {
    change(alternative);
    return alternative;
  };
  EXPECT_THAT(refused(with(kTilting, [](OwnAlternative& a) { a.name = "a b"; })), HasSubstr("'a b' is not accepted"));
  EXPECT_THAT(refused(kTilting, true), HasSubstr("diagnosis.alternatives: tilt is given twice"));
  EXPECT_THAT(refused(with(kTilting, [](OwnAlternative& a) { a.columns = {}; })), HasSubstr("tilt has no function"));
  EXPECT_THAT(refused(with(kTilting, [](OwnAlternative& a) { a.joint = "joint_9"; })),
              HasSubstr("diagnosis.alternatives: tilt moves joint_9, expected a moving joint"));
  const auto gives = [&](const OwnColumns& function) {
    return refused(with(kStraying, [&](OwnAlternative& a) { a.columns = function; }));
  };
  EXPECT_THAT(gives(columns({swing})), HasSubstr("stray gives 1 numbers for each configuration"));
  EXPECT_THAT(gives([](const MatrixXd&) { return MatrixXd(MatrixXd::Ones(2, 3)); }),
              HasSubstr("diagnosis.alternatives: stray gives 2 rows"));
  EXPECT_THAT(gives([](const MatrixXd& q) { return MatrixXd(MatrixXd::Constant(q.cols(), 3, std::nan(""))); }),
              HasSubstr("not finite"));
  EXPECT_THAT(gives([](const MatrixXd& q) {
                return MatrixXd(q.topRows(3).transpose().rowwise() - q.topRows(3).transpose().colwise().mean());
              }),
              HasSubstr("other values at one configuration than among all"));
  EXPECT_THAT(refusal([&] {
                calibrate(testing::fanuc(), m.data, {.diagnosis = {.try_readings = false, .alternatives = {kTilting}}});
              }),
              HasSubstr("diagnosis.alternatives: are other readings"));
}

}  // namespace
}  // namespace kdl_calibration::own_alternatives_test
